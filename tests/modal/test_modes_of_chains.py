"""Modes of drives with several chains, against closed forms and against one chain."""

import math

import numpy as np
import pytest
from chains import CONTACT, chain, plus, run, side_by_side, span, sprocket, two_stages
from drives import example, of_long
from parts import coupling, gears, shaft

from warpchain import dumps_drive, loads_drive
from warpchain.assembly.frequencies import excitation_orders
from warpchain.cli import main
from warpchain.modal.campbell import campbell, modal_assurance, mode_metrics, pitch_averaged_campbell
from warpchain.modal.eigenmodes import lowest_modes, modes
from warpchain.modal.mode_figures import mode_campbell_figure
from warpchain.modal.small_motion import drive_motion


def test_equal_chains_side_by_side_have_the_modes_of_one_of_twice_all():
    # all that the chains do alike is a mode of the one; what differences leave is 1e-6
    twin, one = modes(side_by_side(2), 16), modes(side_by_side(0), 8)
    off = np.abs(twin.eigenvalue[:, None] - one.eigenvalue).min(axis=0)
    assert (off < 1e-5 * np.abs(one.eigenvalue)).all()
    assert twin.tension[:60] == pytest.approx(0.5 * one.tension, rel=1e-6)  # and half of the load each
    assert twin.tension[60:] == pytest.approx(0.5 * one.tension, rel=1e-6)
    assert np.allclose(twin.participation.sum(axis=1), 1.0)


def three_shafts(inertia):
    """A crank, a shaft and a last one, chain "first" of 40 and 40 teeth and "second" of 30 and 30, both taut."""
    mid = span(40, 40, 80, 0.05, 2e-3)
    end = mid + span(30, 30, 78, 0.04, 2e-3)
    return loads_drive(
        chain("first", 80, 0.05, damping=0.0)
        + chain("second", 78, 0.04, stiffness=3e7, damping=0.0)
        + shaft("middle", inertia=inertia[0] - 100.0)
        + sprocket("crank", 40, (0.0, 0.0), "first", more="prescribed = { speed = 1.0 }")
        + sprocket("mid in", 40, (mid, 0.0), "first", "middle", "inertia = 60.0")
        + sprocket("mid out", 30, (mid, 0.0), "second", "middle", "inertia = 40.0")
        + sprocket("out", 30, (end, 0.0), "second", more=f"inertia = {inertia[1]}")
        + CONTACT.replace("2e8", "5e6").replace("clearance = 1e-4", "clearance = 0.0").replace("125.0", "145.0")
        + run()
    )


def strand(k, n, teeth, seat=5e6):
    """Of n links k, in series with the ladders of seats at both ends (`test_modes`, a driven sprocket)."""
    give = 1.0 / (1.0 / k + (2.0 * math.pi / teeth) ** 2 / seat)
    arc = 0.5 * (-seat + math.sqrt(seat**2 + 4.0 * give * seat)) + seat
    return 1.0 / (n / k + 2.0 / arc)


@pytest.mark.long
def test_torsion_of_three_shafts_on_two_chains():
    # J q'' = -K q with K = R^2 (k/n + k/n) a chain of two strands of n links and what seats give, the crank as one of
    # 1e12 kg m^2; 0.4 %: the lever of an outer link, cos(pi/z), is up to 0.55 % short, of the frequency half of that,
    # and chains have up to 0.6 % of the inertia, of which less than half turns
    drive = three_shafts((2000.0, 1500.0))
    radii = [p / (2.0 * math.sin(math.pi / z)) for p, z in ((0.05, 40), (0.04, 30))]
    strands = strand(5e7, 20, 40), strand(3e7, 24, 30)
    first, second = (2.0 * r * r * own for r, own in zip(radii, strands, strict=True))
    stiffness = np.array([[first, -first, 0.0], [-first, first + second, -second], [0.0, -second, second]])
    square = np.linalg.eigvals(np.diag(1.0 / np.array([1e12, 2000.0, 1500.0])) @ stiffness)
    omega = np.sqrt(np.sort(square.real)[1:])
    found = modes(drive, 30)
    turning = found.participation[:, [found.parts.index(name) for name in ("mid in", "out")]].sum(axis=1)
    own = np.sort(np.argsort(turning)[-2:])
    assert np.abs(found.eigenvalue[own]) == pytest.approx(omega, rel=4e-3)
    assert (turning[own] > 0.95).all()
    # both sprockets and the shaft between the chains turn as one
    assert found.bodies[own][:, [1, 2], 2] == pytest.approx(found.bodies[own][:, [4, 4], 2], rel=1e-12)


FLYWHEEL = shaft("flywheel", inertia=1600.0) + gears("pair", ["middle", "flywheel"], [20, 40])
"""Turns half as fast as the shaft between the chains."""


@pytest.mark.long
def test_a_geared_inertia_is_a_fourth_of_it_on_the_shaft():
    # differences of forces over small steps have eight digits, of which a mode that hardly turns shows fewer
    geared, plain = modes(plus(three_shafts((1600.0, 1500.0)), FLYWHEEL), 30), modes(three_shafts((2000.0, 1500.0)), 30)
    assert geared.eigenvalue == pytest.approx(plain.eigenvalue, rel=1e-5)
    turned = [drive.bodies[:, 1, 2] for drive in (geared, plain)]
    assert np.abs(turned[0]) == pytest.approx(np.abs(turned[1]), abs=1e-3 * np.abs(turned[1]).max())
    flywheel = len(geared.drive.sprockets) + [shaft.name for shaft in geared.drive.shafts].index("flywheel")
    assert geared.bodies[:, flywheel, 2] == pytest.approx(-0.5 * geared.bodies[:, 1, 2], rel=1e-9, abs=1e-15)


def test_torsion_of_a_wheel_on_a_coupling_behind_two_chains():
    # as of three shafts, with a fourth on the coupling's spring
    wheel = shaft("wheel", inertia=800.0) + coupling("soft", ["out", "wheel"], 3e5)
    drive = plus(three_shafts((2000.0, 1500.0)), wheel)
    radii = [p / (2.0 * math.sin(math.pi / z)) for p, z in ((0.05, 40), (0.04, 30))]
    strands = strand(5e7, 20, 40), strand(3e7, 24, 30)
    first, second = (2.0 * r * r * own for r, own in zip(radii, strands, strict=True))
    springs = [(None, 0, first), (0, 1, second), (1, 2, 3e5)]
    stiffness = np.zeros((3, 3))
    for a, b, k in springs:
        at = [b] if a is None else [a, b]
        stiffness[np.ix_(at, at)] += k * (np.array([[1.0]]) if a is None else np.array([[1.0, -1.0], [-1.0, 1.0]]))
    square = np.linalg.eigvals(np.diag(1.0 / np.array([2000.0, 1500.0, 800.0])) @ stiffness)
    found = modes(drive, 30)
    turning = found.participation[:, [found.parts.index(name) for name in ("mid in", "out", "wheel")]].sum(axis=1)
    own = np.sort(np.argsort(turning)[-3:])
    assert np.abs(found.eigenvalue[own]) == pytest.approx(np.sqrt(np.sort(square.real)), rel=4e-3)
    assert (turning[own] > 0.95).all()


@pytest.mark.long
def test_modes_of_a_drive_are_followed_over_its_speed_and_its_phase():
    drive = two_stages(gravity=-9.81)
    found = campbell(drive, [5.0, 6.0], 4)
    assert np.isfinite(found.frequency).all()
    mean, every = pitch_averaged_campbell(drive, [5.0, 6.0], 2, 2)
    assert np.isfinite(mean.frequency).all()
    assert every.shape == (2, 2, 2)
    whole = drive_motion(drive, 5.0)
    result = lowest_modes(whole, 6)
    assert np.diag(modal_assurance(result, result, whole)) == pytest.approx(1.0)


def test_modes_of_geared_chains_are_followed_and_drawn():
    # the home of the train has shafts that stand for sprockets of the other chain
    drive = example("balance_shafts")
    whole = drive_motion(drive)
    result = lowest_modes(whole, 6)
    assert np.diag(modal_assurance(result, result, whole)) == pytest.approx(1.0)
    for part, own in zip(whole.parts, result.of_chains(), strict=True):
        there = part.at.roller_and_body_parts(part.at.coordinate_vector(own.shape, own.bodies))
        turning = part.at.basis.reshape(-1, 3, part.at.basis.shape[1])[:, 2].any(axis=1)
        assert there[0] == pytest.approx(own.shape) and there[1][:, turning, 2] == pytest.approx(
            own.bodies[:, turning, 2]
        )
    assert np.isfinite(campbell(drive, [100.0, 110.0], 4).frequency).all()
    assert len(mode_metrics(result, drive)) == 12


@pytest.mark.parametrize("ending", ["html", "rrd"])
def test_modes_of_geared_chains_with_an_arm_are_drawn(ending, tmp_path):
    # the arm's place among a chain's bodies comes after shafts that the chain alone has
    text = dumps_drive(example("v6")) + shaft("pump", inertia=1e-3) + coupling("drive", ["idler shaft", "pump"], 100.0)
    file, out = tmp_path / "drive.toml", tmp_path / f"modes.{ending}"
    file.write_text(text)
    assert main(["modes", str(file), "--count", "2", "-o", str(out)]) == 0
    assert out.stat().st_size > 1000


def test_orders_are_those_of_all_chains():
    # crank 20 -> 30, 18 -> 36 teeth: teeth of the second chain pass 18 (20 / 30) times a turn of the crank
    by_cause = {cause: order.value for order in excitation_orders(two_stages()) for cause in order.cause.split(", ")}
    assert by_cause["tooth passing of first"] == 20.0
    assert by_cause["tooth passing of second"] == pytest.approx(12.0)
    assert by_cause["revolution of the chain second"] == pytest.approx(12.0 / 68.0)
    assert by_cause["revolution of out"] == pytest.approx(1.0 / 3.0)


def test_valves_are_among_the_orders_of_their_chain_and_of_the_others():
    # eight cams a turn of a shaft that turns 1 / 3 times as fast as the crank, and 4 of car's half as fast
    valves = {"name": "lifters", "on": "out", "phases": tuple(45.0 * k for k in range(8)), "mass": 0.1}
    valves |= {"spring": {"preload": 50.0}, "profile": {"lift": 5e-3, "rise": 20.0, "fall": 20.0}}
    by_cause = {
        order.cause: order.value for order in excitation_orders(two_stages().with_values({"valves": (valves,)}))
    }
    assert by_cause["valves lifters"] == pytest.approx(8.0 / 3.0)
    causes = ", ".join(order.cause for order in excitation_orders(example("car")) if order.value == pytest.approx(2.0))
    assert "valves intake valves" in causes and "valves exhaust valves" in causes


def test_names_of_slow_orders_lie_apart_in_the_diagram():
    figure = mode_campbell_figure(campbell(example("balance_shafts"), [0.0, 30.0], 3))
    figure.canvas.draw()
    names = [text for text in figure.axes[0].texts if "revolution of" in text.get_text()]
    boxes = sorted(text.get_window_extent().y0 for text in names if text.get_rotation() == 0.0)
    assert len(boxes) > 3 and np.diff(boxes).min() > 0.018 * figure.axes[0].bbox.height


@pytest.mark.parametrize("ending", [".html", ".png", ".npz", *of_long(".rrd")])
def test_the_command_writes_modes_of_v6(ending, tmp_path, capsys):
    out = tmp_path / f"modes{ending}"
    assert main(["modes", "v6", "--count", "4", "-o", str(out)]) == 0
    assert "exhaust.exhaust drive->exhaust cam 1" in capsys.readouterr().out
    assert out.stat().st_size > 1000
