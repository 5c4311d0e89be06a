"""Drive files written from drive files: what has not changed keeps its words, units and comments."""

import math

import pytest
from drives import example

from warpchain import dumps_drive, load_drive, loads_drive
from warpchain.drive.drive_text import DIGITS, drive_text, self_contained_text, text_with_changes
from warpchain.drive.examples import drive_path, example_names
from warpchain.errors import DriveError

GIVEN = """\
# a drive of our own
[chain]
size = "16B"              # of the catalogue
links = 82
stiffness = "estimate"    # to be measured
damping_ratio = 0.02

[[sprockets]]
name = "driver"
teeth = 17
center = ["0 mm", 0.0]
wrap = "ccw"
prescribed = { speed = "350 rpm", ramp_time = "50 ms" }   # as built

[[sprockets]]
name = "driven"
teeth = 25
center = [0.77, 0.0]
wrap = "ccw"
inertia = 0.05
load = { torque = 100 }   # rated

[contact.sprocket]
profile = "circular"
clearance = 1e-4
restitution = 0.3
stiffness = 1e8
friction = 0.05
impact_speed_floor = 0.02

[run]
duration = 0.3
step = "auto"
sample_rate = 1000
"""


def test_a_drive_that_has_not_changed_keeps_its_text():
    assert drive_text(GIVEN, loads_drive(GIVEN)) == GIVEN
    for name in example_names():
        text = drive_path(name).read_text()
        assert drive_text(text, loads_drive(text)) == text


def test_what_changes_keeps_its_unit_has_few_digits_and_no_comment_on_another_value():
    """350 rpm are 36.65 rad/s; 1/3 of that is 116.666... rpm, and 100/3 N m are 33.33...: nine digits of each."""
    drive = loads_drive(GIVEN)
    speed = drive.sprockets[0].prescribed.speed / 3.0
    other = drive.with_values(
        {"sprockets.driver.prescribed.speed": speed, "sprockets.driven.load.torque": 100.0 / 3.0, "run.duration": 0.4}
    )
    text = drive_text(GIVEN, other)
    expected = GIVEN.replace('"350 rpm"', '"116.666667 rpm"').replace("torque = 100", "torque = 33.3333333")
    expected = expected.replace("   # as built", "").replace("   # rated", "")
    assert text == expected.replace("duration = 0.3", "duration = 0.4")
    assert "# rated" in text_with_changes(GIVEN, drive, other)  # as `warpchain fit` edits one's own file
    again = loads_drive(text)
    assert again.sprockets[0].prescribed.speed == pytest.approx(speed, rel=10.0 ** (1 - DIGITS))
    assert again.chain.stiffness == drive.chain.stiffness


def test_values_that_follow_another_are_written_where_they_would_not_be_the_same():
    """The estimate goes by the size: where only the size is another, the number takes the word's place."""
    drive = loads_drive(GIVEN)
    other = drive.with_values({"chain.size": "16A", "chain.stiffness": drive.chain.stiffness})
    again = loads_drive(drive_text(GIVEN, other))
    assert "# to be measured" not in drive_text(GIVEN, other) and again.chain.size == "16A"
    assert again.chain.stiffness == pytest.approx(other.chain.stiffness, rel=10.0 ** (1 - DIGITS))


def test_values_appear_and_go():
    drive = loads_drive(GIVEN)
    other = drive.with_values({"sprockets.driven.mass": 2.5, "temperature": 60.0})
    text = drive_text(GIVEN, other)
    assert loads_drive(text) == other and "# rated" in text and "# a drive of our own" in text
    assert loads_drive(drive_text(text, drive)) == drive


@pytest.mark.parametrize("name", ["car", "conveyor", "v6"])
def test_numbers_of_examples_change_in_their_text(name):
    """Every seventh number, a thousandth more where that is allowed: it reads back, and comments stay."""
    text, drive = drive_path(name).read_text(), example(name)
    comments = [line for line in text.splitlines() if line.startswith("#")]
    changed = 0
    for path in [path for path in drive.paths() if isinstance(drive.get_value(path), float)][::7]:
        value = 1.001 * drive.get_value(path) + 1e-15
        try:
            other = drive.with_values({path: value})
        except DriveError:
            continue
        written = drive_text(text, other)
        assert math.isclose(loads_drive(written).get_value(path), value, rel_tol=10.0 ** (1 - DIGITS)), path
        assert [line for line in written.splitlines() if line.startswith("#")] == comments, path
        changed += 1
    assert changed > 5


def test_files_that_a_drive_names_are_read_in(tmp_path):
    """The text stands in another folder than these files then; their numbers keep every bit."""
    (tmp_path / "load.csv").write_text("time,torque\n0,0\n0.1,33.333333333333336\n")
    file = tmp_path / "drive.toml"
    file.write_text(GIVEN.replace("load = { torque = 100 }", 'load = { torque = 0, table = { file = "load.csv" } }'))
    text = self_contained_text(file)
    assert loads_drive(text) == load_drive(file) and "load.csv" not in text and "# rated" in text


def test_a_text_of_which_no_edit_gives_the_drive_is_written_anew():
    assert drive_text("[chain]\n", loads_drive(GIVEN)) == dumps_drive(loads_drive(GIVEN))
    assert drive_text("no drive", loads_drive(GIVEN)) == dumps_drive(loads_drive(GIVEN))


def test_centers_keep_the_digits_that_are_asked_for():
    drive = loads_drive(GIVEN)
    other = drive.with_values({"sprockets.driven.center": (1.0042336209, 0.0)})
    assert "center = [1.0042336209, 0.0]" in text_with_changes(GIVEN, drive, other, 15)
