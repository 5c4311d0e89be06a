"""What is not looked at every step is as good as if it were."""

import numpy as np
import pytest
from drives import two_sprockets
from loading import load_script

from warpchain.engine.batches import batch_durations, note_steps, watched_in_batches
from warpchain.engine.sums import watched_time
from warpchain.kernels.structs import Drive
from warpchain.kernels.sums import WATCH_EVERY

looks_study = load_script("looks_study")


@pytest.fixture(scope="module")
def missed():
    drive = two_sprockets(speed=20.0, duration=1.0, ramp=0.1, load_ramp=0.1, viscous=5.0, span=20.0 * (1 + 1e-3))
    return looks_study.misses(drive, 0.3, 8000)


@pytest.mark.parametrize("name", ["tension_mean", "hub_force_mean", "speed_mean", "displacement_mean"])
def test_means_are_off_by_a_small_part_of_their_standard_error(missed, name):
    assert missed[name] < 0.1


def test_spreads_and_integrals_stay(missed):
    for name in ("tension_std", "displacement_rms", "impulse", "speed_std"):
        assert missed[name] < 1e-3, name


def test_of_peaks_next_to_nothing_is_missed(missed):
    # two watched steps are 0.8 rad of the fastest oscillation apart: 1 - cos(0.4) = 8 % of its part at most
    for name in ("tension_max", "tension_min", "force_max", "hub_force_max", "speed_range"):
        assert -1e-9 <= missed[name] < 0.02, name


@pytest.mark.parametrize("window", [(0, 640), (3, 1000), (101, 2111), (160, 4001)])
def test_what_watched_steps_add_up_to_is_scaled_to_what_they_stand_for(window):
    start, end = window
    drives = np.zeros(1, dtype=Drive.numpy_dtype())
    drives["window_start"], drives["window_end"], drives["step"] = start, end, 1e-5
    weight = int(WATCH_EVERY) * 1e-5  # which every watched step is added with
    watched = np.array([n for n in range(start, end + 1) if n % int(WATCH_EVERY) == 0 or n == start])
    assert watched_time(drives)[0] * len(watched) * weight == pytest.approx((end - start) * 1e-5, rel=1e-12)
    edges = [start, *note_steps(start, end), end + 1]  # a batch's note is taken before its step is added
    counts = np.histogram(watched, np.array(edges) - 0.5)[0]
    np.testing.assert_allclose(watched_in_batches(drives)[0] * counts * weight, batch_durations(drives)[0], rtol=1e-12)
