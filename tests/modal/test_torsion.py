"""Torsional modes of shafts on couplings and gears, against their own eigenvalue problems."""

import math
import tomllib

import numpy as np
import pytest
from drives import example, two_sprockets
from parts import coupling, gears, part, shaft

from warpchain import Drive, dumps_drive, loads_drive
from warpchain.modal.eigenmodes import modes
from warpchain.modal.mode_page import state_remarks
from warpchain.model import Model, single_chain

SOFT = shaft("a", inertia=0.5) + coupling("soft", ["driven", "a"], 1e3)
MANY = 100
"""Modes: nearly all that a chain of 60 links has."""

PAIR = (
    shaft("a", inertia=0.5, initial_speed=2.0)
    + shaft("b", inertia=0.3)
    + coupling("link", ["a", "b"], 3e4, damping=2.0, lash=0.001)
)
GEARED = shaft("c", inertia=0.2) + gears("pair", ["b", "c"], [30, 20], module=0.003)


def rest(text):
    """Two sprockets that stand under a load, and shafts."""
    return loads_drive(dumps_drive(two_sprockets()) + text)


GEARBOX = PAIR + "ratios = { time = [0.0, 1.0], ratio = [-2.0, 1.0] }\nclutch = { torque = 1e-6 }\n"


ONE_WAY = PAIR + "freewheel = true\n"
GROUNDED = (
    ONE_WAY
    + coupling("backstop", ["ground", "b"], 3e4, freewheel=True)
    + coupling("brake", ["ground", "a"], 3e4, clutch={"torque": 5.0})
)


@pytest.mark.parametrize(
    ("text", "second", "ratio"),
    [
        (PAIR, 0.3, 1.0),
        (PAIR + GEARED, 0.3 + 0.2 * 2.25, 1.0),
        (GEARBOX, 0.3, -2.0),
        (ONE_WAY, 0.3, 1.0),
        (GROUNDED, 0.3, 1.0),
    ],
)
def test_two_inertias_on_a_coupling(text, second, ratio):
    # omega^2 = k (1/Ja + i^2/Jb), zeta = c omega / 2 k, the second with what is geared to it, and i of the gear that is
    # in at the start; what slips in a run holds in a small motion, but to the ground it is open; 1e-6 by differences
    found = modes(rest(text), count=MANY)
    omega = math.sqrt(3e4 * (1.0 / 0.5 + ratio**2 / second))
    k = int(np.argmin(np.abs(np.abs(found.eigenvalue) - omega)))
    assert abs(found.eigenvalue[k]) == pytest.approx(omega, rel=1e-6)
    assert -found.eigenvalue[k].real / omega == pytest.approx(2.0 * omega / (2.0 * 3e4), rel=1e-5)
    assert (found.rotations, found.zeros) == (1, 0)  # the pair turns freely
    angles = found.bodies[k, 2:, 2]
    assert angles[1] / angles[0] == pytest.approx(-ratio * 0.5 / second, rel=1e-5)
    if len(angles) > 2:
        assert angles[2] / angles[1] == pytest.approx(-1.5, rel=1e-12)


@pytest.mark.long
def test_a_soft_coupling_behind_the_driven_sprocket():
    # the driver stands, the driven sprocket hangs on its tight strand of n links, K_s = k R^2 / n, a shaft behind a
    # coupling soft beside that: both springs in series, 1.5 % of k; teeth that give too are within a tenth of that
    drive = rest(SOFT)
    found = modes(drive, count=MANY)
    strand = drive.chain.stiffness * single_chain(drive).pitch_radius(1) ** 2 / 20.0
    omega = math.sqrt(1.0 / (1.0 / 1e3 + 1.0 / strand) / 0.5)
    k = found.names.index("a 1")
    assert abs(found.eigenvalue[k]) == pytest.approx(omega, rel=2e-3)
    assert found.participation[k, found.parts.index("a")] > 0.99


def test_a_motor_holds_the_driver_of_a_running_conveyor():
    # as steep as its torque falls near its final speed the motor is a damper of 25 * 75 / 7 = 270 N m s at the driver,
    # which stands beside the drum's swing; the drum, 12 kg m^2, hangs on the coupling and the tight strand in series,
    # k R^2 / n = 3.2e5 N m/rad beside 2.5e4; chain, driven sprocket and what the driver gives are within 3 %
    drive = example("conveyor")
    found = modes(drive, count=8, speed=Model(drive).driver_speed)
    strand = drive.chain.stiffness * single_chain(drive).pitch_radius(1) ** 2 / 39.0
    omega = math.sqrt(1.0 / (1.0 / 2.5e4 + 1.0 / strand) / 12.0)
    k = found.names.index("drum 1")
    assert abs(found.eigenvalue[k]) == pytest.approx(omega, rel=0.03)
    assert 0.04 < -found.eigenvalue[k].real / abs(found.eigenvalue[k]) < 0.3


def test_a_free_drive_turns_at_no_frequency_and_swings_against_itself():
    """Two equal inertias J: omega^2 = 2 k / J in place of k / J where one is led, and a load of the slope c makes the
    rotation decay with c / 2 J; 0.5 %, of which 0.25 % is the chain's mass."""
    inertia, drag = 300.0, 600.0
    led = two_sprockets(inertia=inertia)
    free = tomllib.loads(dumps_drive(led) + shaft("engine", inertia=inertia, motor={"torque": 600.0, "power": 3e5}))
    del free["sprockets"][0]["prescribed"]
    free["sprockets"][0]["shaft"] = "engine"
    drive = Drive(**free)
    swings = []
    for one in (led, drive):
        found = modes(one, count=MANY)
        swings.append(found.frequency[found.participation[:, found.parts.index("driven")] > 0.4][0])
        assert (found.rotations, found.zeros) == (int(one is drive), 0)
    assert (swings[1] / swings[0]) ** 2 == pytest.approx(2.0, rel=5e-3)
    slowed = modes(drive.with_values({"sprockets.driven.load.viscous": drag}), count=4)
    assert slowed.creeping[0] == pytest.approx(drag / (2.0 * inertia), rel=5e-3)


def test_the_polygon_of_the_chain_does_not_hold_a_free_drive():
    """At 900 rad/s it made the drive as a whole, of which the vehicle has 86 % of the energy, swing at 0.43 Hz."""
    found = modes(example("motorcycle_drivetrain"), count=4, speed=900.0)
    assert found.rotations == 1 and not len(found.growing)
    assert found.participation[:, found.parts.index("vehicle")].max() < 0.05
    assert [line for line in state_remarks(found) if "0 Hz" in line] == [
        "rigid rotation at 0 Hz, as nothing prescribes a speed there: left out"
    ]


@pytest.mark.long
def test_valves_have_the_inertia_of_where_they_stand():
    # J_e = J + m l'^2 with l' = 35/16 of the lift over its angle, in the middle of the flank; 1e-6 by differences
    spring, profile = {"preload": 100.0, "stiffness": 1e4}, {"lift": 0.02, "rise": 60.0, "fall": 60.0}
    valves = part("valves", "valves", on="b", mass=400.0, spring=spring, profile=profile, phase=-30.0)
    found = modes(rest(PAIR + valves), count=MANY)
    slope = 0.02 * 35.0 / 16.0 / math.radians(60.0)
    omega = math.sqrt(3e4 * (1.0 / 0.5 + 1.0 / (0.3 + 400.0 * slope**2)))
    assert np.abs(np.abs(found.eigenvalue) / omega - 1.0).min() < 1e-6
