"""The example drives of the package: each loads, fits, and runs; what their comments claim holds."""

import warnings

import numpy as np
import pytest

from warpchain import Record, cli, load_drive, simulate
from warpchain.assembly import assemble
from warpchain.assembly.fit import strand_sag
from warpchain.assembly.path import chain_path
from warpchain.assembly.summary import derive
from warpchain.drive import dumps_drive, loads_drive
from warpchain.drive.examples import drive_path, example_names, is_example

NAMES = example_names()


def load(name):
    return load_drive(drive_path(name))


def test_names():
    assert NAMES == ("engine", "industrial", "marine", "marine_no_guides", "motorcycle")
    assert all(is_example(drive_path(name)) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_loads_and_fits_without_warnings(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drive = load(name)
    assembly = assemble(drive)
    assert abs(assembly.strain) < 5e-3
    assert loads_drive(dumps_drive(drive)) == drive
    values = derive(drive)
    assert values["step"] < 0.5 * values["step_limit"]
    if drive.chain.breaking_load is not None:
        largest = max(strand["working_tension"] for strand in values["strands"])
        assert 0.01 < largest / drive.chain.breaking_load < 1 / 7  # a usual least safety factor


@pytest.mark.parametrize("name", NAMES)
def test_check_works(name, capsys):
    assert cli.main(["check", name]) == 0
    assert capsys.readouterr().err == ""


def test_all_run():
    """Each for 4 ms in one ensemble: nothing diverges, the chain stays in one piece."""
    drives = [load(name).with_values({"run.duration": 4e-3, "run.step": 2e-6}) for name in NAMES]
    run = simulate(drives, record=Record(channels=("position", "tension")))
    for i, (name, row) in enumerate(zip(NAMES, run.metrics.to_pylist(), strict=True)):
        assert not row["diverged"], name
        x = run[i].position.astype(float)
        length = np.hypot(*np.moveaxis(np.roll(x, -1, axis=1) - x, -1, 0))
        assert length == pytest.approx(drives[i].chain.pitch, rel=2e-3), name


def test_conveyor_balances_its_load():
    """Steady: (tight - slack) R = moment = 900 + 15 omega; 1 % since the speed's ripple is averaged over 0.2 s only."""
    drive = load("industrial").with_values({"run.duration": 0.6, "run.step": 4e-6})
    (row,) = simulate(drive, record=Record("none"), window=(0.4, 0.6)).metrics.to_pylist()
    moment = 900.0 + 15.0 * 31.4 / 3.0
    assert row["conveyor.moment_mean"] == pytest.approx(moment, rel=0.01)
    pull = row["conveyor->motor.tension_mean"] - row["motor->conveyor.tension_mean"]
    assert pull * drive.pitch_radius(1) == pytest.approx(moment, rel=0.01)


@pytest.mark.parametrize(("name", "sag"), [("industrial", 0.02), ("motorcycle", 0.02)])
def test_sags_are_as_the_comments_say(name, sag):
    """Centers are rounded to 1e-6 m: dh = 3 C / (16 h) 1e-6 is 1e-5 m at most."""
    drive = load(name)
    assert strand_sag(drive, assemble(drive), 0) == pytest.approx(sag, abs=1.5e-5)


def test_engine_fits_and_its_blade_indents_by_a_millimeter():
    drive = load("engine")
    assert abs(assemble(drive).strain) < 1e-6
    path, (blade,) = chain_path(drive), drive.guides
    t = path.strand_end[3] - path.strand_start[3]
    t /= np.hypot(*t)
    for point in (blade.start, blade.end):
        off = (np.array(point) - path.strand_start[3]) @ np.array([-t[1], t[0]])
        assert off + drive.chain.roller_radius == pytest.approx(1e-3, abs=2e-6)


def test_engines_tensioner_holds_its_preload():
    """Steady: the mount pushes with the preload less its spring's travel, and that is what the chain's pull on the
    tensioner comes to: (T - (m/p) v^2) along the slide from each of its strands. Over the window the damper adds
    c dx / 0.1 s, dx twice the largest travel at most. Strands swing and curve: 2 %."""
    drive = load("engine").with_values({"run.duration": 0.2, "run.step": 1e-6})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = simulate(drive, record=Record("none"), window=(0.1, 0.2))
    (row,) = run.metrics.to_pylist()
    mount, pitch = drive.sprockets[1].mount, drive.chain.pitch
    assert mount.kind == "slider" and drive.sprockets[1].name == "tensioner"
    force = row["tensioner.mount_force_mean"]
    damped = mount.damping * 2.0 * row["tensioner.travel_max"] / 0.1
    assert force == pytest.approx(mount.preload + mount.stiffness * row["tensioner.travel_x_mean"], abs=damped)
    assert force == pytest.approx(mount.preload, rel=0.02)
    assert row["tensioner.travel_max"] < 1e-3
    path, speed = (
        chain_path(drive),
        drive.sprockets[0].prescribed.speed * drive.sprockets[0].teeth * pitch / (2 * np.pi),
    )
    pull = 0.0
    for strand, away in ((0, -1.0), (1, 1.0)):
        x = path.strand_end[strand] - path.strand_start[strand]
        tension = row[f"{drive.strand_names[strand]}.tension_mean"] - drive.chain.mass / pitch * speed**2
        pull += tension * away * x[0] / np.hypot(*x)
    assert force == pytest.approx(pull, rel=0.02)


def test_marine_without_guides_is_the_marine_drive_otherwise():
    bare = load("marine").with_values({"guides": (), "contact.guide": None})
    assert load("marine_no_guides") == bare
