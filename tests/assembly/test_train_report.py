"""Figures of `check` on shafts, gears, couplings and motors."""

import math

import pytest

from warpchain import load_drive
from warpchain.assembly.summary import derive, report
from warpchain.drive.examples import drive_path


@pytest.fixture(scope="module")
def conveyor():
    return load_drive(drive_path("conveyor"))


def test_check_tells_of_shafts_gears_and_couplings(conveyor):
    # the motor sees its train, 0.036 + 0.05 / 5^2; the coupling the drum and the driven sprocket, which turns alone
    found = derive(conveyor)
    motor, output, drum = found["shafts"]
    assert motor["inertia"] == pytest.approx(0.036 + 0.05 / 25.0, rel=1e-12)
    assert motor["with"] == ["driver", "output"]
    assert motor["speed"] == pytest.approx(15.0 * drum["speed"], rel=1e-12)
    assert (motor["motor_at_rest"], output["motor_at_rest"]) == (150.0, None)
    assert found["gears"][0]["ratio"] == -0.2
    (coupling,) = found["couplings"]
    omega = math.sqrt(2.5e4 * (1.0 / 0.8 + 1.0 / 12.0))
    assert coupling["frequency"] == pytest.approx(omega / math.tau, rel=1e-12)
    assert coupling["damping_ratio"] == pytest.approx(60.0 * omega / (2.0 * 2.5e4), rel=1e-12)
    lines = report(found).splitlines()
    assert any(line.split() == ["reducer", "motor", "and", "output", "19", "to", "95", "-0.2"] for line in lines)


def test_work_at_balance_is_what_the_run_comes_to(conveyor):
    # tensions differ by the load over the driven sprocket's pitch radius, (550 + 15 w) / R, at the motor's
    # speed; rollers do not lie right on the pitch circle, and the slack strand sags: half a percent
    found = derive(conveyor)
    tight, slack = (strand["working_tension"] for strand in (found["strands"][1], found["strands"][0]))
    load = 550.0 + 15.0 * found["shafts"][2]["speed"]
    assert tight - slack == pytest.approx(load / conveyor.pitch_radius(1), rel=5e-3)


def test_a_motor_too_weak_to_start_is_named(conveyor):
    drive = conveyor.with_values({"shafts.drum.load.torque": 3000.0})
    (line,) = (line for line in derive(drive)["advice"] if line.startswith("shafts"))
    assert line.startswith(
        "shafts.motor.motor: pulls 150 N m at rest, as this shaft sees it, where loads ask for 200 N m"
    )
    assert not [line for line in derive(conveyor)["advice"] if line.startswith("shafts")]
