"""Silent chains in drive files: what they fill, the way there and back, and what does not go with them."""

import math
import re
from pathlib import Path

import pytest
from silent_chains import pulled_silent_drive

from warpchain import dumps_drive, loads_drive
from warpchain.assembly.summary import derived_quantities, report
from warpchain.drive.catalogue import CHAINS
from warpchain.drive.plate import PLATE_KEYS
from warpchain.errors import DriveError

ROOT = Path(__file__).resolve().parent.parent.parent


def test_a_file_says_the_back_once_and_reads_back_equal():
    drive = pulled_silent_drive()
    text = dumps_drive(drive)
    assert 'kind = "silent"' in text and "roller_radius" not in text
    assert loads_drive(text) == drive
    assert drive.chain.roller_radius == pytest.approx(0.4 * 9.525e-3, rel=1e-12)


def test_the_back_follows_a_changed_pitch_and_a_changed_height():
    other = {"chain.pitch": 0.0127, "sprockets.driven.center": [0.296, 0.0]}
    assert pulled_silent_drive(**other).chain.roller_radius == pytest.approx(0.4 * 0.0127, rel=1e-12)
    assert pulled_silent_drive(**{"chain.back_height": 0.003}).chain.roller_radius == 0.003


def sized_drive(**values):
    """Two wheels with a chain of size SC304 and what its file must say beside it, with values replaced."""
    text = """
[chain]
size = "SC304"
[[sprockets]]
teeth = 23
center = [0.0, 0.0]
prescribed = { speed = 200.0 }
[[sprockets]]
teeth = 23
center = [0.22225, 0.0]
load = { torque = 5.0 }
"""
    return loads_drive(text).with_values(values)


def test_a_size_fills_the_kind_and_what_follows():
    drive, size = sized_drive(), CHAINS["SC304"]
    chain = drive.chain
    assert (chain.kind, chain.pitch, chain.links) == ("silent", 9.525e-3, 70)  # 2 * 0.22225 / 9.525e-3 + 23 = 69.67
    assert chain.roller_radius == pytest.approx(0.4 * 9.525e-3, rel=1e-15)
    assert chain.stiffness == size.estimated_stiffness and chain.mass_per_length == size.mass_per_length
    assert chain.joint_area == pytest.approx(0.3 * 9.525e-3 * 0.0254 / 2, rel=1e-12)
    assert drive.contact.sprocket.clearance == 0.0
    assert loads_drive(dumps_drive(drive)) == drive


def test_another_size_is_another_kind():
    rollers = sized_drive(**{"chain.size": "06B"})
    assert not rollers.chain.is_silent and rollers.chain.roller_radius == CHAINS["06B"].roller_radius
    back = rollers.with_values({"chain.size": "SC304"})
    assert back.chain == sized_drive().chain


def test_a_given_back_is_the_radius_of_a_sized_chain():
    assert sized_drive(**{"chain.back_height": 0.003}).chain.roller_radius == 0.003


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"chain.kind": "roller"}, 'chain.kind = "roller": must be "silent", as size SC304 is'),
        ({"chain.size": "06B", "chain.kind": "silent"}, 'chain.kind = "silent": must be "roller", as size 06B is'),
        ({"chain.roller_radius": 0.003},
         'chain.roller_radius = 0.003: not together with kind = "silent"; give back_height'),
    ],
)  # fmt: skip
def test_what_does_not_go_with_a_size_is_refused(values, line):
    with pytest.raises(DriveError) as refused:
        sized_drive(**values)
    assert line in refused.value.errors


@pytest.mark.parametrize("key", ["pitch", *PLATE_KEYS])
@pytest.mark.parametrize("value", [[], [1.0, "a"], (0.002, 0.004, 0.006), -1.0, "x", {}, math.inf])
def test_wrong_values_of_plates_are_errors_of_the_drive(key, value):
    with pytest.raises(DriveError, match=f"^chain.{key}") as refused:
        pulled_silent_drive(**{f"chain.{key}": value})
    assert len(refused.value.errors) == 1


def test_check_speaks_of_links_and_gaps_and_rates_no_silent_chain():
    drive = sized_drive()
    text = report(derived_quantities(drive))
    assert "kg a link" in text and "a free link rebounds" in text and "roller rebounds" not in text
    assert "rating: none; ASME B29.1 and ISO 10823 rate roller chains only" in text
    assert "d2 by half the width" in text and "ISO 606" not in text
    # the gap's two flanks are 2 (30 - 180 / 23) degrees apart
    assert "gap angle" in text and f"{2 * (30 - 180 / 23):.1f} deg" in text


def test_the_pages_drive_is_that_of_its_picture():
    page = (ROOT / "docs" / "silent-chains.md").read_text()
    (text,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert text == (ROOT / "scripts" / "drawings" / "silent.toml").read_text()
    assert derived_quantities(loads_drive(text))["layout"] == []


GUIDED = """
[[guides]]
name = "rail"
start = {start}
end = {end}
side = "{side}"
end_radius = 0.01
[contact.guide]
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 1e7
"""
LOW, HIGH = ([0.02, -0.0385], [0.2, -0.0385]), ([0.02, 0.0385], [0.2, 0.0385])


@pytest.mark.parametrize("wrap", ["ccw", "cw"])
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("ends", [LOW, HIGH])
def test_guides_on_the_toes_are_refused_and_those_on_the_back_are_not(ends, side, backward, wrap):
    start, end = ends[::-1] if backward else ends
    text = dumps_drive(pulled_silent_drive(wrap=wrap)) + GUIDED.format(start=start, end=end, side=side)
    if (ends is LOW) == (backward == (side == "right")):  # the face looks up, from below
        assert loads_drive(text).guides[0].name == "rail"
        return
    strand = "drive->driven" if (ends is LOW) == (wrap == "ccw") else "driven->drive"
    with pytest.raises(DriveError) as refused:
        loads_drive(text)
    line = f'guides.rail: its face is turned to the toes of strand "{strand}"; must be turned to the chain\'s back'
    assert refused.value.errors == (f"<text>: {line}",)


def test_check_speaks_of_pins():
    lines = report(derived_quantities(pulled_silent_drive())).splitlines()
    assert "  with it the largest forces on single pins, and what single contacts dissipate, keep 5 to 8 %" in lines
    assert lines[-1].endswith('is, because of pins on the teeth of "drive"')


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"chain.kind": "quiet"}, 'chain.kind = "quiet": must be "roller" or "silent"'),
        ({"chain.back_height": 1.0}, "chain.back_height = 1.0: must be below the pitch, 0.009525"),
        ({"chain.flank_angle": 89.0}, "chain.flank_angle = 89.0: must be a number of degrees from 20 to 45"),
        ({"sprockets.drive.teeth": 1}, "sprockets.drive.teeth = 1: must be an integer of at least 5"),
        ({"sprockets.drive.teeth": 16}, "sprockets.drive.teeth = 16: must be at least 17 with a silent chain"),
        ({"sprockets.drive.wrap": "cw"},
         'sprockets.driven.wrap = "ccw": must be "cw", as of "drive": the toes of a silent chain point to one side'),
    ],
)  # fmt: skip
def test_a_wrong_value_is_one_line(values, line):
    with pytest.raises(DriveError) as refused:
        pulled_silent_drive(**values)
    assert refused.value.errors == (line,)


def test_a_sized_chain_on_a_wheel_without_teeth_is_refused():
    with pytest.raises(DriveError, match="teeth = 0: must be an integer of at least 5"):
        loads_drive(dumps_drive(sized_drive()).replace("teeth = 23", "teeth = 0").split("[run]")[0])


def test_quantities_of_plates_are_read_in_their_units():
    text = dumps_drive(pulled_silent_drive()).replace(
        'kind = "silent"', 'kind = "silent"\ntoe_depths = ["1.905 mm", "0.1875 in"]\nback_height = "0.15 in"'
    )
    chain = loads_drive(text).chain
    assert chain.toe_depths == pytest.approx((1.905e-3, 4.7625e-3), rel=1e-12)
    assert chain.roller_radius == pytest.approx(3.81e-3, rel=1e-12)
