"""What is not looked at every step is as good as if it were."""

import pytest
from drives import two_sprockets
from loading import load_script

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
