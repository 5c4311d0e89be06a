"""Strokes and events of tensioners against signals that are known."""

import numpy as np
import pytest

from warpchain.results.signals import events, stroke


def test_a_sine_goes_back_and_forth_four_amplitudes_a_period():
    time = np.linspace(0.0, 2.0, 20001)
    found = stroke(time, 3.0 + 0.5 * np.sin(2.0 * np.pi * 10.0 * time))
    assert (found.low, found.high) == pytest.approx((2.5, 3.5), rel=1e-5)
    assert found.travel == pytest.approx(1.0, rel=1e-5)
    assert found.mean == pytest.approx(3.0, rel=1e-6)
    assert found.path == pytest.approx(4 * 0.5 * 10.0, rel=1e-4)  # a thousand samples a period


def test_openings_of_a_valve():
    time = np.arange(1000) * 1e-3
    lift = np.maximum(np.sin(2.0 * np.pi * 5.0 * (time - 0.05)), 0.0)  # opens at 0.05, 0.25, ... for 0.1 s
    found = events(time, lift)
    assert found.openings == 5 and found.rate == pytest.approx(5.0, rel=1e-9)
    assert found.share == pytest.approx(0.5, abs=6e-3)  # a sample at either end of five spells
    assert found.longest == pytest.approx(0.1, abs=2e-3)


def test_what_is_open_from_the_beginning_did_not_open():
    assert events(np.arange(4.0), np.array([1.0, 1.0, 0.0, 1.0])).openings == 1
    assert events(np.arange(4.0), np.ones(4))[0] == 0 and events(np.arange(4.0), np.ones(4)).share == 1.0
    assert events(np.arange(4.0), np.zeros(4)) == (0, 0.0, 0.0, 0.0)
