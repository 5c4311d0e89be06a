"""Silent chains in drive files: what they fill, the way there and back, and what does not go with them."""

import pytest
from silent import silent_drive

from warpchain import dumps_drive, loads_drive


def test_a_file_says_the_back_once_and_reads_back_equal():
    drive = silent_drive()
    text = dumps_drive(drive)
    assert 'kind = "silent"' in text and "roller_radius" not in text
    assert loads_drive(text) == drive
    assert drive.chain.roller_radius == pytest.approx(0.4 * 9.525e-3, rel=1e-12)


def test_the_back_follows_a_changed_pitch_and_a_changed_height():
    other = {"chain.pitch": 0.0127, "sprockets.driven.center": [0.296, 0.0]}
    assert silent_drive(**other).chain.roller_radius == pytest.approx(0.4 * 0.0127, rel=1e-12)
    assert silent_drive(**{"chain.back_height": 0.003}).chain.roller_radius == 0.003
