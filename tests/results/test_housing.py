"""Loads on the housing: against Newton's second law for the whole drive, and read back from UFF58 and MDF4."""

import math
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from command import refused
from command import run as command
from drives import BLADE, example, two_sprockets
from pyarrow.csv import read_csv

from warpchain import Record, loads_drive, simulate, write_archive
from warpchain.archive.export import export, export_orders
from warpchain.errors import SimulationError, WarpchainError
from warpchain.results import housing
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.housing import housing_components, housing_loads, order_levels

SCREWED = BLADE.replace('side = "right"\n', 'side = "right"\nbolts = [[0.06, 0.22], [0.05, 0.15], [0.045, 0.08]]\n')


@pytest.fixture(scope="module")
def run():
    drive = loads_drive(SCREWED).with_values({"sprockets.crank.mass": 0.5, "sprockets.cam.mass": 1.5})
    return simulate(drive, record=Record(rate=1e9, channels=CHANNEL_NAMES), duration=0.01, device="cpu")


@pytest.fixture(scope="module")
def archive(run, tmp_path_factory):
    return write_archive(run, tmp_path_factory.mktemp("housing") / "a.mcap")


def test_all_loads_together_are_weight_less_change_of_momentum(run):
    """Nothing else holds the drive: sum of the loads = m g - d(momentum)/dt of rollers, arm and plunger (which has no
    weight). Every step is recorded, and nothing rubs: only the arm's acceleration, by differences, is not exact."""
    trajectory, drive = run[0], run.drives[0]
    loads = {load.name: load for load in housing_loads(trajectory)}
    names = ["hub crank", "hub cam", *(f"bolt fixed rail {k}" for k in (1, 2, 3)), "pivot tensioner arm"]
    assert list(loads) == [*names, "seat chain tensioner"]
    time, weight = trajectory.time, drive.links * drive.chain.mass + drive.arms[0].mass + 2.0
    total = sum(load.force for load in loads.values())
    speed, angle = trajectory.arm_speed[:, 0], trajectory.arm_angle[:, 0]
    r = np.subtract(drive.arms[0].center, drive.arms[0].pivot)
    heading = math.atan2(r[1], r[0]) + angle
    arm = drive.arms[0].mass * np.hypot(*r) * speed[:, None] * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    plunger = drive.tensioners[0].plunger_mass * np.gradient(trajectory.tensioner_extension[:, 0], time)
    momentum = drive.chain.mass * trajectory.velocity.sum(axis=1) + arm
    momentum += np.outer(plunger, drive.tensioners[0].unit_direction)
    gravity = weight * np.asarray(drive.run.gravity)
    change = (momentum[-10] - momentum[10]) / (time[-10] - time[10])
    mean = np.trapezoid(total[10:-9], time[10:-9], axis=0) / (time[-10] - time[10])
    size = np.abs(loads["hub cam"].force).max()
    np.testing.assert_allclose(mean, gravity - change, atol=1e-3 * size)
    assert size > 10.0 * abs(gravity[1])


def test_bolts_share_force_and_moment(run):
    trajectory = run[0]
    bolts = [load for load in housing_loads(trajectory) if load.name.startswith("bolt")]
    bare = replace(trajectory, drive=run.drives[0].with_values({"guides.fixed rail.bolts": ()}))
    (whole,) = [load for load in housing_loads(bare) if load.name == "guide fixed rail"]
    assert np.abs(whole.force).max() > 1.0
    np.testing.assert_allclose(sum(load.force for load in bolts), whole.force, atol=1e-9)
    arms = [np.subtract(load.place, whole.place) for load in bolts]
    moment = sum(r[0] * load.force[:, 1] - r[1] * load.force[:, 0] for r, load in zip(arms, bolts, strict=True))
    np.testing.assert_allclose(moment, whole.moment, atol=1e-9)
    one = replace(trajectory, drive=run.drives[0].with_values({"guides.fixed rail.bolts": ((0.05, 0.15),)}))
    (alone,) = [load for load in housing_loads(one) if load.name.startswith("bolt")]
    np.testing.assert_array_equal(alone.force, whole.force)
    assert alone.moment is not None


def test_mounts_pass_on_their_springs_and_wheels_turn():
    """A held sprocket with a balance wheel adds m r w^2 along its phase, and weight; one on springs k u + c v - F."""
    mount = {"kind": "elastic", "stiffness": (4e6, 5e6), "damping": (10.0, 20.0), "preload": (-300.0, 40.0)}
    wheel = {"mass": 0.4, "radius": 0.03, "phase": 0.5}
    changes = {"sprockets.driven.mount": mount, "sprockets.driven.mass": 3.0, "sprockets.driver.balance_wheel": wheel}
    drive = two_sprockets(duration=0.002, settle="false", gravity=-9.81).with_values(changes)
    trajectory = simulate(drive, record=Record(rate=1e9), device="cpu")[0]
    loads = {load.name: load.force for load in housing_loads(trajectory)}
    angle = trajectory.sprocket_angle[:, 0] + 0.5
    centrifugal = 0.4 * 0.03 * 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    chain = housing.hub_forces(trajectory)
    np.testing.assert_allclose(loads["hub driver"], chain[:, 0] + centrifugal + [0.0, -0.4 * 9.81], atol=1e-6)
    off = trajectory.sprocket_center[:, 1] - drive.sprockets[1].center
    held = off * (4e6, 5e6) + np.gradient(off, trajectory.time, axis=0) * (10.0, 20.0) - (-300.0, 40.0)
    np.testing.assert_allclose(loads["hub driven"], held, rtol=1e-9)


def momentum_of(arm, time, pivot, angle):
    """Momentum of an arm over time (F, 2), its pivot moving."""
    x, y = np.subtract(arm.center, arm.pivot)
    cosine, sine = np.cos(angle), np.sin(angle)
    center = pivot + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
    return arm.mass * np.gradient(center, time, axis=0)


def test_an_arm_on_another_one_loads_the_pivot_of_that():
    """Sum of the loads = m g - d(momentum)/dt of rollers and both arms, as above; the sprockets have no mass."""
    time = np.linspace(0.0, 0.02, 5)
    upper = {"name": "upper", "pivot": [0.5, -1.0], "mass": 2.0, "center": [0.5, -1.2], "inertia": 0.1}
    lower = upper | {"name": "lower", "arm": "upper", "pivot": [0.5, -1.3], "center": [0.6, -1.5], "mass": 1.0}
    lead = {"time": time.tolist(), "x": (20.0 * time**2).tolist(), "y": (-5.0 * time**2).tolist()}
    drive = two_sprockets(speed=0.0, torque=0.0, gravity=-9.81, step=5e-6)
    drive = drive.with_values({"arms": [upper | {"pivot_table": lead}, lower]})
    trajectory = simulate(drive, record=Record(rate=1e9, channels=CHANNEL_NAMES), duration=0.015, device="cpu")[0]
    loads = {load.name: load.force for load in housing_loads(trajectory)}
    assert list(loads) == ["hub driver", "hub driven", "pivot upper"]
    t, angle = trajectory.time, np.asarray(trajectory.arm_angle, dtype=float)
    at = arm_pivots(drive, t, angle)
    momentum = sum(momentum_of(arm, t, at[:, a], angle[:, a]) for a, arm in enumerate(drive.arms))
    change = (momentum[-10] - momentum[10]) / (t[-10] - t[10])
    mean = np.trapezoid(loads["pivot upper"][10:-9], t[10:-9], axis=0) / (t[-10] - t[10])
    np.testing.assert_allclose(mean, [-change[0], -9.81 * 3.0 - change[1]], atol=0.02)  # second differences
    assert abs(change[0]) > 20.0


def test_a_plunger_s_inertia_takes_its_part_of_the_push():
    """Oil comes in and pushes by F, at the lever l, a plunger of mass m and an arm of inertia I about its center of
    mass: the pivot bears F - m x'' of (I + m l^2) x'' = l^2 F, I / (I + m l^2) of F; second differences have 2e-3
    of its largest where F has kinks, as the oil begins to push and the supply is all there.
    """
    arm = {"name": "arm", "pivot": [0.5, -1.0], "center": [0.5, -1.0], "mass": 1.0, "inertia": 0.02}
    (push,) = tomllib.loads(BLADE)["tensioners"]
    del push["ratchet"]
    push |= {"on": "arm", "at": [0.7, -1.0], "direction": [0.0, 1.0], "spring": {"stiffness": 100.0, "preload": 0.0}}
    push["plunger"]["mass"] = 0.25
    push["oil"] |= {"supply": 1e5, "supply_table": {"time": [0.0, 2e-3], "pressure": [1e5, 6e5]}}
    drive = two_sprockets(speed=0.0, torque=0.0, settle="false").with_values({"arms": [arm], "tensioners": [push]})
    trajectory = simulate(drive, record=Record(rate=2e4, channels=CHANNEL_NAMES), duration=0.006, device="cpu")[0]
    loads = {load.name: load.force for load in housing_loads(trajectory)}
    seat, pivot = loads["seat chain tensioner"][2:-2], loads["pivot arm"][2:-2]
    np.testing.assert_allclose(pivot, seat * -0.02 / (0.02 + 0.25 * 0.2**2), atol=3e-3 * np.abs(seat).max())
    assert np.abs(seat).max() > 20.0


def test_several_chains_have_their_hubs_each():
    drive = example("v6").with_values({"run.settle": False})
    trajectory = simulate(drive, record=Record(rate=1e9), duration=2e-5, device="cpu")[0]
    names = [load.name for load in housing_loads(trajectory)]
    assert len(set(names)) == len(names) and {f"hub {s.name}" for s in drive.sprockets} <= set(names)


@pytest.mark.parametrize("ending", ["unv", "uff"])
def test_pyuff_reads_the_universal_file_back(run, archive, tmp_path, ending):
    pyuff = pytest.importorskip("pyuff")
    path = export(archive, tmp_path / f"a.{ending}")
    units, nodes, *functions = pyuff.UFF(str(path)).read_sets()
    loads, parts = housing_loads(run[0]), housing_components(run[0])
    assert (units["type"], units["units_code"], units["length"], units["force"]) == (164, 1, 1.0, 1.0)
    np.testing.assert_allclose(np.stack([nodes["x"], nodes["y"]], axis=1), [load.place for load in loads], atol=1e-12)
    assert len(functions) == len(parts)
    for held, (name, values) in zip(functions, parts.items(), strict=True):
        load = next(k for k, load in enumerate(loads) if name.startswith(load.name))
        assert (held["type"], held["func_type"], held["rsp_node"]) == (58, 1, load + 1)
        assert held["id1"] == f"{loads[load].name} {name.rpartition('.')[2]}"
        assert held["rsp_dir"] == {"x": 1, "y": 2, "moment": 6}[name.rpartition(".")[2]]
        assert (held["ordinate_axis_units_lab"].strip(), held["ordinate_spec_data_type"]) == ("N", 13)
        np.testing.assert_array_equal(held["data"], values)
        np.testing.assert_allclose(held["x"], run[0].time, rtol=1e-6, atol=1e-9)


def test_asammdf_reads_the_measured_data_back(run, archive, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = export(archive, tmp_path / "a.mf4")
    with asammdf.MDF(path) as held:
        assert held.version.startswith("4")
        for name, values in housing_components(run[0]).items():
            signal = held.get(name)
            np.testing.assert_array_equal(signal.samples, values)
            np.testing.assert_array_equal(signal.timestamps, run[0].time)
            assert signal.unit == "N"
        assert held.get("sprocket_speed.cam").unit == "rad/s"


def test_a_sine_of_an_order_has_its_level_over_a_micronewton(monkeypatch, tmp_path):
    """3 N of the fourth order: 20 log10(3 / sqrt 2 / 1e-6) dB; whole turns, Hann window, on a line of the spectrum."""
    drive = two_sprockets(duration=2.6, step=2e-5, settle="false", speed=10.0)
    time = np.linspace(0.0, 8.0 * math.pi / 10.0, 4001)
    angle = np.stack([10.0 * time, 10.0 * time], axis=1)
    trajectory = replace(simulate(drive, duration=1e-3, device="cpu")[0], time=time, sprocket_angle=angle)
    monkeypatch.setattr(housing, "housing_components", lambda _: {"hub driver.x": 3.0 * np.cos(4.0 * angle[:, 0])})
    table = order_levels(trajectory)
    order, level = (np.asarray(table[name]) for name in ("order", "hub driver.x"))
    at = int(np.argmin(np.abs(order - 4.0)))
    assert level[at] == pytest.approx(20.0 * math.log10(3.0 / math.sqrt(2.0) / 1e-6), abs=0.05) and at == level.argmax()
    assert table.schema.field("hub driver.x").metadata[b"unit"] == b"dB re 1 uN"


def test_orders_are_written_where_the_driver_turns(tmp_path, capsys):
    drive = two_sprockets(duration=0.35, step=2e-5, settle="false", speed=60.0)
    archive = write_archive(simulate(drive, record=Record(rate=5e3), device="cpu"), tmp_path / "a.mcap")
    status, out, _ = command(capsys, "export", archive, "--orders", "-o", tmp_path / "orders.csv")
    assert status == 0 and out == [str(tmp_path / "orders.csv")]
    table = read_csv(tmp_path / "orders.csv")
    assert table.column_names[:2] == ["order", "hub driver.x [dB re 1 uN]"]
    assert "--orders: not with --metrics" in refused(
        capsys, "export", archive, "--orders", "--metrics", "-o", tmp_path / "b.csv"
    )


def test_refusals(run, archive, tmp_path, monkeypatch, capsys):
    with pytest.raises(SimulationError, match="orders: the driver must turn one way"):
        export_orders(archive, tmp_path / "a.csv")
    with pytest.raises(SimulationError, match="arm_angle"):
        housing_loads(replace(run[0], arm_angle=None))
    for module, ending, extra in (("pyuff", "unv", "uff"), ("asammdf", "mf4", "mdf")):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(WarpchainError, match=rf"needs {module}; install it with: pip .*\[{extra}\]'"):
            export(archive, tmp_path / f"a.{ending}")
        assert not (tmp_path / f"a.{ending}").exists()
    held = SCREWED.replace("free_angle = 5.0", "free_angle = 5.0").replace(
        'radius = 0.25\narm = "tensioner arm"', 'radius = 0.25\narm = "tensioner arm"\nbolts = [[0.0, 0.0]]'
    )
    (tmp_path / "drive.toml").write_text(held)
    assert "guides.blade.bolts: only on the ground" in refused(capsys, "check", tmp_path / "drive.toml")
