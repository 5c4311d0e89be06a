"""What is not looked at every step is as good as if it were."""

import pytest
from drives import example, two_sprockets
from loading import load_script

from warpchain.assembly.timestep import resolve_step
from warpchain.engine.simulation import longest_sample_interval, sample_interval
from warpchain.kernels.sums import MERGE_EVERY
from warpchain.model import single_chain
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.schedule import LOOK_EVERY

looks_study = load_script("drawings.sampling")


@pytest.fixture(scope="module", params=[8000, 24000], ids=["looks every 32 steps", "every 64"])
def missed(request):
    drive = two_sprockets(speed=20.0, duration=1.0, ramp=0.1, load_ramp=0.1, viscous=5.0, span=20.0 * (1 + 1e-3))
    every = sample_interval(int(longest_sample_interval(drive, resolve_step(drive))), request.param)
    assert every == (32 if request.param == 8000 else 64)
    return looks_study.sampling_misses(drive, 0.3, request.param) | {"looks": request.param // every}


@pytest.mark.parametrize("name", ["tension_mean", "hub_force_mean", "speed_mean", "displacement_mean"])
def test_means_are_off_by_a_small_part_of_their_standard_error(missed, name):
    assert missed[name] < 0.1


def test_spreads_and_integrals_stay(missed):
    for name in ("tension_std", "impulse", "speed_std"):
        assert missed[name] < 1e-3, name
    # of L looks the window's first is one too many: so the mean square is off by its share of it, and the root by half
    # of that, 1 / 2 L for a sample of twice the mean square; with L = 375 looks less often that is 1.3e-3
    assert missed["displacement_rms"] < {250: 1e-3, 375: 2e-3}[missed["looks"]]


def test_of_peaks_nothing_is_missed(missed):
    for name in ("tension_max", "tension_min", "force_max", "hub_force_max", "speed_range"):
        assert abs(missed[name]) < 1e-9, name


def test_looks_are_further_apart_where_sixteen_of_them_are_in_a_pitch_all_the_same():
    """64 steps h are at most a sixteenth of the time p / v in which the chain moves on by a pitch, v = omega R."""
    assert int(MERGE_EVERY) == LOOK_EVERY
    drive = two_sprockets(speed=20.0)
    most = drive.chain.pitch / (16 * 64 * single_chain(drive).chain_speed)
    assert single_chain(drive).chain_speed == pytest.approx(20.0 * single_chain(drive).pitch_radius(0), rel=1e-12)
    assert [int(longest_sample_interval(drive, step)) for step in (0.999 * most, 1.001 * most)] == [64, 32]
    assert int(longest_sample_interval(two_sprockets(speed=0.0), 1e-5)) == 32  # of which nobody knows how it will move


def test_looks_of_many_variants_are_found_together():
    drives = [two_sprockets(speed=speed) for speed in (5.0, 20.0, 80.0, 320.0, 1280.0)]
    (stack,) = stacks_of_drives(drives)
    together = longest_sample_interval(stack.one, 1e-5)
    assert together.tolist() == [int(longest_sample_interval(drive, 1e-5)) for drive in drives]
    assert set(together.tolist()) == {32, 64}


@pytest.mark.parametrize(("longest", "window", "expected"), [(64, 20480, 64), (64, 20479, 32), (32, 10**6, 32)])
def test_a_batch_of_a_window_has_sixteen_looks_that_are_further_apart(longest, window, expected):
    assert sample_interval(longest, window) == expected


LOOKS = [("marine", 1e-5, 64), ("marine", None, 32), ("industrial", None, 64)]  # None: the automatic 1.7e-5, 8e-6 s


@pytest.mark.parametrize(("name", "step", "looks"), LOOKS)
def test_examples_with_slow_teeth_are_looked_at_every_64_steps(name, step, looks):
    drive = example(name)
    assert int(longest_sample_interval(drive, resolve_step(drive, step))) == looks
