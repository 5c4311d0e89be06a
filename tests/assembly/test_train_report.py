"""Figures of `check` on shafts, gears, couplings and motors."""

import math
import tomllib

import pytest
from drives import example, two_sprockets
from parts import coupling, gears, part, shaft

from warpchain import Drive, dumps_drive, loads_drive
from warpchain.assembly.statics import at_rest
from warpchain.assembly.summary import derived_quantities, report
from warpchain.fit import fit_position
from warpchain.model import Model, single_chain


@pytest.fixture(scope="module")
def conveyor():
    return example("conveyor")


def test_check_tells_of_shafts_gears_and_couplings(conveyor):
    # the motor sees its train, 0.036 + 0.05 / 5^2; the coupling the drum and the driven sprocket, which turns alone
    found = derived_quantities(conveyor)
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
    found = derived_quantities(conveyor)
    tight, slack = (strand["working_tension"] for strand in (found["strands"][1], found["strands"][0]))
    load = 550.0 + 15.0 * found["shafts"][2]["speed"]
    assert tight - slack == pytest.approx(load / single_chain(conveyor).pitch_radius(1), rel=5e-3)


def test_a_motor_too_weak_to_start_is_named(conveyor):
    drive = conveyor.with_values({"shafts.drum.load.torque": 3000.0})
    (line,) = (line for line in derived_quantities(drive)["advice"] if line.startswith("shafts"))
    assert line.startswith(
        "shafts.motor.motor: pulls 150 N m at rest, as this shaft sees it, where loads ask for 200 N m"
    )
    assert not [line for line in derived_quantities(conveyor)["advice"] if line.startswith("shafts")]


def test_a_coupling_is_twisted_by_what_it_passes_on(conveyor):
    # M = 550 + 15 w at the drum, from the coupling, e = M / k + b; both as the equilibrium leaves them, 1e-4 of the
    # largest force at work
    (coupling,) = derived_quantities(conveyor)["couplings"]
    load = 550.0 + 15.0 * derived_quantities(conveyor)["shafts"][2]["speed"]
    sign = conveyor.sprockets[1].sign
    assert sign * coupling["working_torque"] == pytest.approx(load, rel=1e-3)
    assert sign * coupling["working_twist"] == pytest.approx(load / 2.5e4 + 0.003, rel=1e-3)
    cells = next(line for line in report(derived_quantities(conveyor)).splitlines() if line.split()[:1] == ["coupling"])
    assert cells.endswith("torque at work")


SHAFTS = shaft("second shaft", inertia=0.1) + shaft("third shaft", inertia=0.1, load={"torque": 300.0})
BOTH = ["second shaft", "third shaft"]
GEARED = SHAFTS + gears("pair", BOTH, [30, 30], internal=True)


def triangle(text):
    """A taut chain around three equal sprockets, 20 links a strand; the first drives, the others are on shafts."""
    values = two_sprockets(links=80, span=20.02).model_dump(exclude_none=True)
    side = 20.02 * 0.05
    driver, driven = values["sprockets"]
    del driven["load"]
    values["sprockets"] = [
        driver,
        {**driven, "name": "second", "shaft": "second shaft"},
        {**driven, "name": "third", "center": [0.5 * side, math.sqrt(0.75) * side], "shaft": "third shaft"},
    ]
    return Drive(**(values | tomllib.loads(text)))


@pytest.mark.parametrize("sag", [0.02, 0.03])
def test_a_slack_chain_between_couplings_with_play_stands(sag):
    # within its play a coupling would hold nothing: the search for where it stands had no end
    drive = fit_position(example("motorcycle_drivetrain"), "rear", (1.0, 0.0), sag=sag)
    found, chain = at_rest(single_chain(drive)), drive.chain
    length = math.hypot(*drive.sprockets[1].center)
    assert found.failure is None
    assert found.tension == pytest.approx(9.81 * chain.mass / chain.pitch * length**2 / (8.0 * sag), rel=0.06)


def test_geared_sprockets_share_what_the_chain_passes_on():
    # the two turn alike, so that the strand between them keeps its length and tension; chain and elongation are as at
    # rest, so that the tight one gains what the slack one loses, M / 2R: each passes on half. What seats give is 2 %
    drive = triangle(GEARED)
    found = derived_quantities(drive)
    assert found["tensions_estimated"] is None
    pull = 300.0 / found["sprockets"][1]["pitch_radius"]
    slack, between, tight = (strand["working_tension"] for strand in found["strands"])
    assert tight - slack == pytest.approx(pull, rel=5e-3)
    assert (between - slack) / pull == pytest.approx(0.5, abs=0.02)
    assert between - found["strands"][1]["standing_tension"] == pytest.approx(0.0, abs=0.02 * pull)


def test_coupled_sprockets_share_by_how_stiff_the_coupling_is():
    # a soft one leaves all to the sprocket that is loaded, a stiff one makes them share as gears do
    soft, stiff = (derived_quantities(triangle(SHAFTS + coupling("pair", BOTH, k))) for k in (1.0, 1e10))
    assert abs(soft["couplings"][0]["working_torque"]) < 0.01
    assert abs(stiff["couplings"][0]["working_torque"]) == pytest.approx(150.0, rel=0.05)
    geared = derived_quantities(triangle(GEARED))
    for one, other in zip(stiff["strands"], geared["strands"], strict=True):
        assert one["working_tension"] == pytest.approx(other["working_tension"], rel=1e-4)
    lost = [strand["working_tension"] for strand in soft["strands"]]
    assert lost[1] == pytest.approx(lost[0], rel=1e-2)


def test_a_motor_that_nothing_balances_is_named(conveyor):
    # 150 N m on 0.036 + 0.05 / 25 + (0.8 + 12) / 225 kg m^2 and the chain's own, with nothing against it, for 2 s less
    # half the ramp: over 3000 rad/s; a viscous load balances it again
    motor = {"torque": 150.0, "ramp_time": 0.15}
    constant = conveyor.with_values({"shafts.motor.motor": motor, "shafts.drum.load": None})
    motor = derived_quantities(constant)["shafts"][0]
    inertia = (
        0.038 + 12.8 / 225.0 + conveyor.links * conveyor.chain.mass * single_chain(conveyor).pitch_radius(0) ** 2 / 25.0
    )
    assert motor["speed"] == pytest.approx(150.0 / inertia * (2.0 - 0.075), rel=1e-9)
    (line,) = (line for line in derived_quantities(constant)["advice"] if line.startswith("shafts"))
    assert line.startswith(
        f"shafts.motor.motor: no load balances it at any speed: this shaft comes to {motor['speed']:.4g} rad/s"
    )
    held = constant.with_values({"shafts.drum.load": {"viscous": 15.0}})
    assert not [line for line in derived_quantities(held)["advice"] if line.startswith("shafts")]


SPRING = {"preload": 100.0, "stiffness": 2e4}
PROFILE = {"lift": 0.01, "rise": 60.0, "dwell": 10.0, "fall": 50.0}


@pytest.mark.parametrize(("cam", "speed"), [({"prescribed": {"speed": 50.0}}, 50.0), ({"initial_speed": 50.0}, None)])
def test_what_nothing_ties_to_the_chain_has_no_speed_of_the_drivers(cam, speed):
    # led by itself at 50 rad/s, or left to itself: neither turns with the chain, which has no part in its valves' float
    valves = part("valves", "inlets", on="cam", mass=0.1, spring=SPRING, profile=PROFILE)
    drive = loads_drive(dumps_drive(two_sprockets()) + shaft("cam", inertia=0.1, **cam) + valves)
    found = derived_quantities(drive)
    assert found["shafts"][0]["speed"] == speed
    assert found["valves"][0]["driver_float_speed"] is None and found["valves"][0]["float_speed"] > 0.0
    (line,) = (line for line in found["advice"] if line.startswith("valves"))
    assert line.startswith('valves.inlets.on = "cam": nothing ties this shaft to the chain')
    rows = [line.split() for line in report(found).splitlines()]
    assert next(row for row in rows if row[:2] == ["inlets", "cam"])[-1] == "-"


def test_a_motor_that_nothing_ties_to_the_chain_drives_no_chain():
    # the flywheel's 10 rad/s are the driver's; a fan beside it, with a motor of its own, has no part in that
    values = tomllib.loads(
        dumps_drive(two_sprockets(torque=0.0, viscous=40.0))
        + shaft("fan", inertia=0.1, motor={"torque": 5.0})
        + shaft("flywheel", inertia=20.0, initial_speed=10.0)
    )
    del values["sprockets"][0]["prescribed"]
    values["sprockets"][0]["shaft"] = "flywheel"
    drive = Drive(**values)
    assert Model(drive).driver_speed == 10.0 and drive.sprockets[drive.driver].name == "driver"
    found = derived_quantities(drive)
    assert [of["speed"] for of in found["shafts"]] == [None, 10.0]
    # nothing drives it: 40 N m s brake the wheel, the sprocket's 2 kg m^2 and the chain's rollers
    slower = 400.0 / (22.0 + drive.chain.links * drive.chain.mass * single_chain(drive).pitch_radius(0) ** 2)
    assert found["driver"]["acceleration"] == pytest.approx(-slower, rel=1e-12)
    line = f'speed: "driver" has 10 rad/s at the start, which counts as work, and slows down by {slower:.4g} rad/s^2'
    assert line in report(found).splitlines()
