"""Rainflow counting and Miner damage against the standard's example and closed forms."""

import sys
from collections import Counter

import numpy as np
import pytest

from warpchain.errors import SimulationError
from warpchain.results.fatigue import Woehler, count_links, equivalent_range, miner_damage

ASTM = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]
"""Fig. 6 of ASTM E1049-85; its table counts half cycles of 3, 4, 6, 8, 8, 9 and a whole one of 4."""


def test_example_of_the_standard():
    counted = Counter()
    (found,) = count_links(np.array(ASTM)[:, None])
    for size, _, part in found:
        counted[size] += part
    assert counted == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}


def test_damage_is_the_sum_over_the_packages_cycles():
    rng = np.random.default_rng(1)
    tension = 5e3 + 2e3 * np.cumsum(rng.standard_normal((2000, 5)), axis=0)
    curve = Woehler(exponent=5.0, reference_range=1e4, reference_cycles=2e6)
    found = count_links(tension)
    expected = [(c[:, 2] / curve.cycles_to_failure(c[:, 0])).sum() for c in found]
    # the same terms; the order of the sum and pow differ in the last digits
    assert miner_damage(tension, curve) == pytest.approx(expected, rel=1e-12)
    assert miner_damage(tension, curve, found).tolist() == miner_damage(tension, curve).tolist()


def test_links_whose_tension_stands_still_take_no_damage():
    still = np.full((4, 2), 1e3)
    assert miner_damage(still, Woehler(5.0, 1e4)).tolist() == equivalent_range(still, 5.0, 1.0).tolist() == [0.0, 0.0]


def test_without_the_package_a_line_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rainflow", None)
    line = r"fatigue: needs rainflow; install it with: pip .*\[rainflow\]'"
    with pytest.raises(SimulationError, match=line):
        miner_damage(np.zeros((4, 2)), Woehler(5.0, 1e4))


def test_sine_damage_is_one_cycle_a_period():
    """n periods of amplitude A between peaks: n cycles of 2 A."""
    t = np.arange(0, 401) / 4.0  # quarter periods: samples on the peaks
    tension = 1e3 + 500.0 * np.sin(2.0 * np.pi * t)[:, None]
    curve = Woehler(exponent=4.0, reference_range=2e3, reference_cycles=1e6)
    # 99.5 cycles between first and last peak, and half cycles of 1 A at both ends
    expected = (99.5 * 0.5**4 + 2 * 0.5 * 0.25**4) / 1e6
    assert miner_damage(tension, curve)[0] == pytest.approx(expected, rel=1e-9)
    assert equivalent_range(tension, 4.0, 100.0)[0] == pytest.approx(2e3 * (expected * 1e6 / 100.0) ** 0.25, rel=1e-9)
    # Miner: twice the range, 2^m the damage
    assert miner_damage(2.0 * tension, curve)[0] == pytest.approx(16.0 * expected, rel=1e-9)


def test_refusals():
    with pytest.raises(SimulationError, match=r"fatigue\.exponent = 0\.0: must be"):
        Woehler(0.0, 1e3)
    for bad in (np.zeros(4), np.full((3, 2), np.nan), np.zeros((0, 2))):
        with pytest.raises(SimulationError, match="finite tensions"):
            miner_damage(bad, Woehler(3.0, 1e3))
