"""Valves in drive files: lifts from tables and profiles, and what is refused."""

import math

import numpy as np
import pytest
from drives import AT_REST, two_sprockets
from parts import part

from warpchain import dumps_drive, load_drive, loads_drive
from warpchain.assembly.table_cells import table_cells
from warpchain.errors import DriveError

SPRING = {"preload": 100.0, "stiffness": 2e4}
TEXT = dumps_drive(two_sprockets(**AT_REST)) + part("valves", "inlets", on="driven", mass=0.1, spring=SPRING)
PROFILE = "profile = { lift = 0.01, rise = 60.0, dwell = 10.0, fall = 50.0 }\n"
ANGLES = np.linspace(0.0, 360.0, 37)


def csv(folder, lifts, angles=ANGLES):
    rows = (f"{angle!r},{lift!r}" for angle, lift in zip(angles.tolist(), lifts.tolist(), strict=True))
    (folder / "lift.csv").write_text("\n".join(["angle_deg,lift_mm", *rows]))
    (folder / "drive.toml").write_text(TEXT + 'table = { file = "lift.csv", factor = 1.1 }\n')
    return folder / "drive.toml"


def smooth(angles):
    """A lift of 9 mm over 180 degrees [mm]."""
    lift = np.where(angles < 180.0, 9.0 * np.sin(np.radians(np.minimum(angles, 180.0))) ** 4, 0.0)
    lift[-1] = lift[0]
    return lift


def test_a_table_of_a_file(tmp_path):
    drive = load_drive(csv(tmp_path, smooth(ANGLES)))
    valves = drive.valves[0]
    assert valves.curve.over == pytest.approx(np.radians(ANGLES), rel=1e-12)
    assert valves.curve.values == pytest.approx(1e-3 * smooth(ANGLES), rel=1e-12)
    assert valves.height == 1.1
    assert loads_drive(dumps_drive(drive)) == drive
    # cells meet the spline, and slope and bend of neighboring ones agree
    cells = table_cells(valves.curve, 1.0)
    c = cells.coefficients
    assert (cells.over_angle, cells.repeats) == (True, True)
    assert np.roll(c[:, 0], -1) == pytest.approx(c.sum(axis=1), abs=1e-12)
    assert np.roll(c[:, 2], -1) == pytest.approx(c[:, 2] + 3.0 * c[:, 3], abs=1e-12)


@pytest.mark.parametrize("shape", ["polynomial", "cycloid", "cosine"])
def test_profiles(shape):
    drive = loads_drive(TEXT + PROFILE.replace("{ lift", f'{{ shape = "{shape}", lift'))
    lift, slope, bend = drive.valves[0].lifts()
    degrees = np.arange(720) / 2.0
    assert lift[(degrees >= 60.0) & (degrees <= 70.0)] == pytest.approx(0.01, rel=1e-9)
    assert lift[degrees >= 120.0] == pytest.approx(0.0, abs=1e-12)
    assert lift[degrees == 30.0] == lift[degrees == 95.0] == pytest.approx(0.005, rel=1e-9)
    # in the middle of a flank the slope is the lift over its angle times 35/16, 2, pi/2
    steep = {"polynomial": 35.0 / 16.0, "cycloid": 2.0, "cosine": 0.5 * math.pi}[shape]
    assert slope[degrees == 30.0] == pytest.approx(0.01 * steep / math.radians(60.0), rel=1e-4)
    assert np.sum(bend) == pytest.approx(0.0, abs=1e-9)


JUMP = smooth(ANGLES)
JUMP[5:20] = 9.0
OPEN = smooth(ANGLES)
OPEN[-1] = 0.5


@pytest.mark.parametrize(
    ("lifts", "angles", "text"),
    [
        (JUMP, ANGLES, ": jumps from 0.00153643; must change by at most 0.00225 from row to row"),
        (OPEN, ANGLES, "table.lift.36 = 0.0005: must repeat the first element, 0, where the next period"),
        (
            smooth(ANGLES),
            ANGLES / 360.0 * 350.0,
            '.file = "lift.csv": angle spans 350 degrees of the cams\' shaft, less than a turn; give event = true if',
        ),
        (1e3 * smooth(ANGLES), ANGLES, "valves.inlets.table.lift: reaches 9.9 m; must be at most 0.25 m"),  # factor 1.1
        (0.0 * ANGLES, ANGLES, "valves.inlets.table.lift: must not be the same throughout"),
    ],
)
def test_lifts_of_a_file_that_are_refused(tmp_path, lifts, angles, text):
    with pytest.raises(DriveError) as caught:
        load_drive(csv(tmp_path, lifts, angles))
    (line,) = caught.value.errors
    assert "valves.inlets.table" in line and text in line


def test_a_lift_that_is_said_to_repeat_must_do_so_a_whole_number_of_times(tmp_path):
    """Of two thirds of a turn it does not, of a third it does."""
    path = csv(tmp_path, smooth(ANGLES), ANGLES / 360.0 * 240.0)
    path.write_text(path.read_text().replace("factor = 1.1", "event = false"))
    with pytest.raises(
        DriveError, match=r"must be a revolution, or 1/2, 1/3 ... of one, after the first, 0 rad; it is 0.66"
    ):
        load_drive(path)
    csv(tmp_path, smooth(ANGLES), ANGLES / 3.0)
    path.write_text(path.read_text().replace("factor = 1.1", "event = false"))
    assert load_drive(path).valves[0].curve.revolutions == pytest.approx(1.0 / 3.0, rel=1e-12)


@pytest.mark.parametrize(
    ("head", "angles", "keys"),
    [
        ("angle_deg,lift_mm", ANGLES / 3.0 - 60.0, "event = true"),
        ("crank angle [deg],lift [mm]", ANGLES / 1.5 - 120.0, "event = true, crank_turns = 2"),
        ("°CA,mm", ANGLES / 1.5 - 120.0, "event = true, crank_turns = 2"),
        ("cam angle [deg],lift [mm]", ANGLES - 180.0, ""),
        ("cam angle / °NW,lift / in", ANGLES - 180.0, "crank_turns = 1"),
        ("deg crank,mm", 2.0 * ANGLES - 360.0, "crank_turns = 2"),
    ],
)
def test_lifts_about_their_middle_over_a_turn_or_alone(tmp_path, head, angles, keys):
    """An event of 120 degrees of the cam, and one of 360 that is the whole turn; both are symmetric about angle 0."""
    bump = np.round(9.0 * np.sin(np.pi * (np.arange(37) / 36.0)) ** 4, 9)
    path = csv(tmp_path, bump, angles)
    csv_text = (tmp_path / "lift.csv").read_text().replace("angle_deg,lift_mm", head)
    (tmp_path / "lift.csv").write_text(csv_text)
    path.write_text(TEXT + f'table = {{ file = "lift.csv"{", " if keys else ""}{keys} }}\n')
    curve = load_drive(path).valves[0].curve
    half = np.radians(angles[-1]) / (2.0 if "crank_turns = 2" in keys else 1.0)
    length = 0.0254 if "/ in" in head else 1e-3
    assert curve.revolutions == 1.0
    places = np.linspace(-half, half, 37)
    assert curve.spline(places) == pytest.approx(length * bump, abs=1e-9)
    if "event" in keys:  # it rests: the spline swings about 0 by less than a row's part of the rise beside the event
        assert abs(curve.spline(np.linspace(half, 2.0 * np.pi - half, 500))).max() < 1e-6
        assert curve.spline(np.pi) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("head", "angles", "keys", "text"),
    [
        (
            "angle_deg,lift_mm",
            ANGLES / 3.0,
            "",
            "spans 120 degrees of the cams' shaft, less than a turn; give event = true",
        ),
        ("°CA,mm", ANGLES, "", '"°CA" counts degrees of the crank; give crank_turns'),
        ("Kurbelwinkel [deg],mm", ANGLES, "", '"Kurbelwinkel [deg]" counts degrees of the crank; give crank_turns'),
        (
            "angle_deg,lift_mm",
            2.0 * ANGLES,
            "",
            "spans 720 degrees of the cams' shaft, more than a turn; give crank_turns",
        ),
        ("angle_deg,lift_mm", ANGLES, "event = true", "event = true: the file has a whole turn; leave it out"),
        ("angle_deg,lift_mm", ANGLES, "event = 1", "event = 1: must be true or false"),
        ("angle_deg,lift_mm", ANGLES, "crank_turns = 0.5", "crank_turns = 0.5: must be a whole number of at least 1"),
        ("angle_deg,lift", ANGLES, "", "reaches 9 m; must be at most 0.25 m"),
    ],
)
def test_lifts_of_which_it_is_not_clear_what_they_are(tmp_path, head, angles, keys, text):
    path = csv(tmp_path, smooth(ANGLES), angles)
    (tmp_path / "lift.csv").write_text((tmp_path / "lift.csv").read_text().replace("angle_deg,lift_mm", head))
    path.write_text(TEXT + f'table = {{ file = "lift.csv"{", " if keys else ""}{keys} }}\n')
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    (line,) = caught.value.errors
    assert text in line


def test_an_event_that_ends_at_another_lift_is_told(tmp_path):
    path = csv(tmp_path, OPEN, ANGLES / 3.0)
    path.write_text(path.read_text().replace("factor = 1.1", "event = true"))
    with pytest.raises(
        DriveError, match=r"event = true: the last lift, 0.0005 m, must be the first, 0 m, where it rests"
    ):
        load_drive(path)


@pytest.mark.parametrize(
    ("part", "text"),
    [
        ("", "valves.inlets.profile: missing; must be a table, or give table instead"),
        (PROFILE.replace("60.0", "320.0"), "with dwell and fall must be at most 360 degrees; it is 380"),
        (PROFILE.replace("60.0", "1.0"), "valves.inlets.profile.rise = 1.0: must be at least 4 degrees"),
        (PROFILE.replace("0.01", "9.2"), "profile.lift = 9.2: must be a number above 0, at most 0.25 m"),
        (PROFILE + "phases = []\n", "valves.inlets.phases = []: must be a list of 1 to 64 finite numbers"),
        (PROFILE + f"phases = {[1.0] * 65}\n", "...: must be a list of 1 to 64 finite numbers"),
        (PROFILE + "table = { angle = [0.0, 1.0], lift = [0.0, 1.0] }\n", "not together with profile"),
    ],
)
def test_valves_that_are_refused(part, text):
    with pytest.raises(DriveError) as caught:
        loads_drive(TEXT + part)
    assert any(text in line for line in caught.value.errors)


def test_valves_are_on_something_that_turns():
    with pytest.raises(DriveError, match=r'valves.inlets.on = "drivn": must be the name of a sprocket or a shaft; did'):
        loads_drive(TEXT.replace('on = "driven"', 'on = "drivn"') + PROFILE)
