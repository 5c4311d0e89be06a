"""Copies of a drive: what a phase turns on, what it leaves alone, and how copies are numbered."""

import math

import numpy as np
import pytest
from drives import MARINE, two_sprockets

from warpchain import assemble, dumps_drive, load_drive, loads_drive
from warpchain.drive.replicates import Replicates, all_copies, copy_phase, numbered_copies
from warpchain.errors import DriveError, SimulationError
from warpchain.model import single_chain
from warpchain.model.start_phase import motion_from_start_phase

TABLE = {"angle": [0.0, 1.0, 3.0, 2.0 * math.pi], "torque": [1.0, 5.0, 2.0, 1.0]}


def test_phases_are_van_der_corputs():
    assert [copy_phase(k) for k in range(8)] == [0.0, -0.5, 0.25, -0.25, 0.125, -0.375, 0.375, -0.125]


def test_copies_of_drives_that_share_their_settings_share_theirs():
    drive = two_sprockets()
    other = drive.with_values({"sprockets.driven.load.torque": 1.0})
    copies = all_copies([drive, other], Replicates(3))
    assert [copy.run.phase for copy in copies] == [None, -0.5, 0.25] * 2
    assert [copy.run.seating for copy in copies] == [None, 1, 2] * 2
    assert [copy.run.seating for copy in all_copies([drive], Replicates(3, "phase"))] == [None] * 3
    assert copies[0] is drive and copies[3] is other
    assert copies[1].run is copies[4].run
    assert [copy.run.perturbation for copy in all_copies([drive], Replicates(3, "perturbation"))] == [None, 1, 2]
    (again,) = numbered_copies([copies[1]], [1])  # half a tooth twice is none
    assert again.run.phase == 0.0
    assert loads_drive(dumps_drive(copies[2])) == copies[2]


@pytest.mark.parametrize("phase", [-0.5, -0.2, 0.125, 0.4999])
def test_sprockets_turn_on_by_the_phase(phase):
    """Every sprocket turns on by the phase times its pitch angle, all but the driver to first order of the chain's fit.

    A straight taut chain of links on pitch polygons closes at any phase only to the polygon's effect, some (pi/z)^2 / 6
    of a pitch: 0.4 % at 20 teeth.
    """
    drive = two_sprockets()
    still, turned = assemble(drive), assemble(drive.with_values({"run.phase": phase}))
    pitch = 2.0 * math.pi / 20
    moved = (turned.sprocket_angle - still.sprocket_angle) / pitch - phase
    moved -= np.round(moved)  # seats are alike
    assert moved[drive.driver] == pytest.approx(0.0, abs=1e-12)
    assert moved == pytest.approx(np.zeros(2), abs=5e-3)
    assert (turned.seat_sprocket >= 0).sum() == pytest.approx((still.seat_sprocket >= 0).sum(), abs=2)
    assert turned.strand_links.sum() + (turned.seat_sprocket >= 0).sum() - 2 == drive.chain.links


@pytest.mark.parametrize("name", ["marine", "engine", "motorcycle", "industrial"])
def test_example_drives_assemble_at_all_phases(name):
    drive = load_drive(MARINE.with_name(f"{name}.toml"))
    strains = [assemble(copy).strain for copy in all_copies([drive], Replicates(16))]
    assert np.ptp(strains) < 2e-3


def test_what_goes_by_an_angle_turns_on_with_the_shaft():
    """A harmonic of order h is cos(h phi + psi): a shaft that has turned on by d begins at psi + h d. A table begins at
    its value at d."""
    harmonics = [
        {"order": 3.0, "amplitude": 2.0, "phase": 0.1},
        {"order": 0.5, "amplitude": 1.0, "shaft": "driver"},
    ]
    drive = two_sprockets().with_values({
        "sprockets.driver.teeth": 21, "chain.links": 60, "sprockets.driven.load.harmonics": harmonics,
        "sprockets.driven.load.table": TABLE, "run.phase": 0.25,
    })  # fmt: skip
    sprocket = drive.sprockets[1]
    turned = motion_from_start_phase(single_chain(drive), sprocket, sprocket.load)
    own, driver = 0.25 * 2.0 * math.pi / 20, 0.25 * 2.0 * math.pi / 21
    assert [h.phase for h in turned.harmonics] == pytest.approx([0.1 + 3.0 * own, 0.5 * driver], rel=1e-14)
    assert turned.table.angle == pytest.approx(np.array(TABLE["angle"]) - own, rel=1e-14)
    still = drive.with_values({"run.phase": None})
    assert motion_from_start_phase(single_chain(still), sprocket, sprocket.load) is sprocket.load


def test_the_driver_begins_at_the_speed_of_its_harmonics():
    """Speed (1 + a cos(h d)) at the start."""
    drive = two_sprockets().with_values(
        {"sprockets.driver.prescribed.harmonics": [{"order": 2.0, "amplitude": 0.3}], "run.phase": 0.5}
    )
    speed = assemble(drive).sprocket_speed[0]
    assert speed == pytest.approx(10.0 * (1.0 + 0.3 * math.cos(2.0 * 0.5 * 2.0 * math.pi / 20)), rel=1e-14)


def test_words_of_earlier_versions_are_read():
    drive = two_sprockets().with_values({"run.perturbation": 3})
    text = dumps_drive(drive)
    assert "perturbation = 3" in text
    assert loads_drive(text.replace("perturbation", "nudge")) == drive
    assert two_sprockets().with_values({"run.nudge": 3}) == drive and drive.get_value("run.nudge") == 3
    assert all_copies([drive], Replicates(2, "nudge")) == all_copies([drive], Replicates(2, "perturbation"))
    with pytest.raises(DriveError, match="unknown key"):
        loads_drive(text.replace("perturbation = 3", "perturbation = 3\nnudge = 4"))


def test_refusals():
    for count in (0, 10_001):
        with pytest.raises(
            SimulationError, match=rf"replicates\.count = {count}: must be a whole number from 1 to 10000"
        ):
            Replicates(count)
    with pytest.raises(SimulationError, match="replicate_by = 'chance': allowed are build, phase, perturbation"):
        Replicates(2, "chance")
    with pytest.raises(DriveError, match=r"run\.phase = 0\.7: must be a number from -0.5 to 0.5"):
        two_sprockets().with_values({"run.phase": 0.7})
