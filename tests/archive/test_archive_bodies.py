"""Arms and tensioners in archives: every channel comes back as it was, whole and recovered, and outlines turn."""

import numpy as np
import pytest
from drives import timing

from warpchain import Record, read_archive, simulate
from warpchain.archive.recover import recover_archive

OF_BODIES = ("arm_angle", "arm_speed", "arm_moment", "tensioner_extension", "tensioner_force", "chamber_pressure")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run in memory, and the same one archived."""
    drive, archive = timing(**{"run.duration": 2e-3}), tmp_path_factory.mktemp("bodies") / "a.mcap"
    kept = simulate(drive, record=Record(rate=1e4), device="cpu")
    simulate(drive, record=Record(rate=1e4), device="cpu", archive=archive)
    return kept, archive


def test_channels_of_bodies_come_back(runs):
    kept, archive = runs
    found = read_archive(archive)[0]
    assert set(OF_BODIES) <= set(found.channels())
    for name, values in kept[0].channels().items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)
    assert found.arm_angle.shape == found.chamber_pressure.shape == (21, 1)
    assert np.ptp(found.arm_angle) > 0.0 and found.chamber_pressure.min() > 1e5
    assert found.drive == kept.drives[0]


def test_a_recovered_archive_has_them_too(runs, tmp_path):
    kept, archive = runs
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(archive.read_bytes()[:-200])
    recover_archive(cut, tmp_path / "whole.mcap")
    np.testing.assert_array_equal(read_archive(tmp_path / "whole.mcap")[0].arm_angle, kept[0].arm_angle)


def test_a_drive_without_bodies_has_no_such_channel(tmp_path):
    from drives import two_sprockets

    run = simulate(two_sprockets(duration=1e-4), record=Record(rate=1e5), device="cpu")
    assert not set(OF_BODIES) & set(run[0].channels()) and run[0].arm_angle is None
