"""Rainflow counting and Miner damage against the standard's example, the package rainflow, and closed forms."""

from collections import Counter

import numpy as np
import pytest
import rainflow
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from warpchain.errors import SimulationError
from warpchain.kernels.rainflow import rainflow_kernel, vec2d, vec3d
from warpchain.results.fatigue import Woehler, count_links, cycles, damage, equivalent_range

ASTM = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]
"""Fig. 6 of ASTM E1049-85; its table counts half cycles of 3, 4, 6, 8, 8, 9 and a whole one of 4."""


def multiset(found):
    return Counter(map(tuple, np.asarray(found).tolist()))


def test_example_of_the_standard():
    counted = Counter()
    for size, _, part in cycles(ASTM):
        counted[size] += part
    assert counted == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    (ours,) = count_links(np.array(ASTM)[:, None])
    assert ours.tolist() == cycles(ASTM).tolist()


@given(st.integers(0, 2**32 - 1), st.integers(3, 120), st.integers(1, 40))
def test_streaming_counter_equals_the_package_exactly(seed, length, levels):
    """Coarse integers give plateaus and equal ranges, the cases that implementations differ in."""
    rng = np.random.default_rng(seed)
    series = np.stack([rng.integers(-levels, levels + 1, length).astype(float), rng.standard_normal(length)], axis=1)
    series = np.hstack([series, np.cumsum(series[:, 1:], axis=0), np.zeros((length, 1))])
    for column, ours in enumerate(count_links(series)):
        assert ours.tolist() == [list(c[:3]) for c in rainflow.extract_cycles(series[:, column].tolist())]


def test_damage_is_the_sum_over_the_packages_cycles():
    rng = np.random.default_rng(1)
    tension = 5e3 + 2e3 * np.cumsum(rng.standard_normal((2000, 5)), axis=0)
    curve = Woehler(exponent=5.0, reference_range=1e4, reference_cycles=2e6)
    found = [cycles(column) for column in tension.T]
    expected = [(c[:, 2] / curve.endurance(c[:, 0])).sum() for c in found]
    # the same terms in the same order; pow differs in the last digit
    assert damage(tension, curve) == pytest.approx(expected, rel=1e-12)


def test_sine_damage_is_one_cycle_a_period():
    """n periods of amplitude A between peaks: n cycles of 2 A."""
    t = np.arange(0, 401) / 4.0  # quarter periods: samples on the peaks
    tension = 1e3 + 500.0 * np.sin(2.0 * np.pi * t)[:, None]
    curve = Woehler(exponent=4.0, reference_range=2e3, reference_cycles=1e6)
    # 99.5 cycles between first and last peak, and half cycles of 1 A at both ends
    expected = (99.5 * 0.5**4 + 2 * 0.5 * 0.25**4) / 1e6
    assert damage(tension, curve)[0] == pytest.approx(expected, rel=1e-9)
    assert equivalent_range(tension, 4.0, 100.0)[0] == pytest.approx(2e3 * (expected * 1e6 / 100.0) ** 0.25, rel=1e-9)
    # Miner: twice the range, 2^m the damage
    assert damage(2.0 * tension, curve)[0] == pytest.approx(16.0 * expected, rel=1e-9)


def test_a_small_stack_loses_whole_cycles_only():
    """Diverging, then converging swings fill the stack; a full one counts its oldest range as half a cycle."""
    k = np.arange(40)
    series = (np.where(k % 2 == 0, 1.0, -1.0) * np.concatenate([k[:20], k[20:0:-1]]))[:, None]
    exact = count_links(series)[0]
    stack = wp.zeros(6, dtype=wp.float64)
    log, counts, sums = wp.zeros(64, dtype=vec3d), wp.zeros(1, dtype=wp.int32), wp.zeros(1, dtype=wp.float64)
    inputs = [wp.array(series), vec2d(1.0, 1.0), 6, 64]
    wp.launch(rainflow_kernel, 1, inputs=inputs, outputs=[stack, log, counts, sums], device="cpu")
    small = log.numpy()[: counts.numpy()[0]]
    # a range is counted once in any case: the sum of ranges is that of half cycles or whole ones
    assert sums.numpy()[0] == pytest.approx((small[:, 0] * small[:, 2]).sum())
    assert small[:, 0].max() == exact[:, 0].max()
    assert 0.5 * (exact[:, 0] * exact[:, 2]).sum() <= sums.numpy()[0] <= (exact[:, 0] * exact[:, 2]).sum()


def test_refusals():
    with pytest.raises(SimulationError, match=r"fatigue\.exponent = 0\.0: allowed"):
        Woehler(0.0, 1e3)
    with pytest.raises(SimulationError, match="one row of finite"):
        cycles([[1.0, 2.0]])
    for bad in (np.zeros(4), np.full((3, 2), np.nan), np.zeros((0, 2))):
        with pytest.raises(SimulationError, match="finite tensions"):
            damage(bad, Woehler(3.0, 1e3))


@pytest.mark.parametrize("arch", [75, 90])
def test_counter_compiles_for_cuda_without_a_gpu(tmp_path, arch):
    wp.compile_aot_module(rainflow_kernel.module, device=None, arch=arch, module_dir=str(tmp_path))
    assert [path for path in tmp_path.iterdir() if path.suffix in (".cubin", ".ptx")]
