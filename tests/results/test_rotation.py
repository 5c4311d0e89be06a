"""Order tracking, averages over the engine cycle and phase errors against signals of known orders."""

import numpy as np
import pytest
from drives import two_sprockets

from warpchain import Trajectory
from warpchain.results.order_tracking import (
    cycle_average,
    driver_turns,
    last_rising_frames,
    order_amplitudes,
    order_cuts,
)
from warpchain.results.shaft_signals import phase_error, phase_error_in_window

UNEVEN = np.linspace(0.0, 2.0, 20001)


def swaying(time):
    """Revolutions of a driver at 50 1/s whose speed sways by 10 %."""
    return 50.0 * time + 5.0 / (2.0 * np.pi * 3.0) * np.sin(2.0 * np.pi * 3.0 * time)


def test_amplitudes_of_orders_of_a_driver_that_sways():
    turns = swaying(UNEVEN)
    angle = 2.0 * np.pi * turns
    values = 7.0 + 3.0 * np.sin(0.5 * angle) + 2.0 * np.cos(2.0 * angle + 1.0) + 0.25 * np.sin(20.0 * angle)
    found = order_amplitudes(turns, values, [0.5, 1.0, 2.0, 19.5, 20.0])
    # a cubic spline through 180 samples a revolution: (2 pi 20 / 180)^4 / 60 = 0.4 % of order 20, less of the others
    np.testing.assert_allclose(found, [3.0, 0.0, 2.0, 0.0, 0.25], atol=2e-3)


def test_no_amplitudes_without_a_whole_cycle():
    turns = np.linspace(0.0, 1.9, 500)
    assert order_amplitudes(turns, np.sin(turns), [1.0]) is None
    assert order_amplitudes(turns * 1.1, np.sin(turns), [1.0]) is not None
    assert cycle_average(turns, turns) is None


def test_cuts_of_a_run_up_follow_the_speed():
    # speed rises evenly from 10 to 60 revolutions a second in 8 s; order 2 grows as the square of it, order 20 stays
    time = np.linspace(0.0, 8.0, 80001)
    turns = 10.0 * time + 0.5 * 6.25 * time**2
    rate = 10.0 + 6.25 * time
    values = 100.0 + 4.0 * rate + rate**2 * 1e-3 * np.cos(4.0 * np.pi * turns) + 0.3 * np.sin(40.0 * np.pi * turns)
    cuts = order_cuts(time, turns, values, [2.0, 7.3, 20.0])
    speed = cuts.speed / (2.0 * np.pi)
    assert speed[0] < 20.0 and speed[-1] > 55.0 and (np.diff(speed) > 0.0).all()
    np.testing.assert_allclose(speed, 10.0 + 6.25 * cuts.time, rtol=0.02)  # mean over a block
    # the amplitude is the Hann-weighted mean over a block, over which the speed changes by up to half at the beginning
    later = speed > 25.0
    np.testing.assert_allclose(cuts.amplitude[later, 0], 1e-3 * speed[later] ** 2, rtol=0.03)
    np.testing.assert_allclose(cuts.amplitude[:, 2], 0.3, rtol=0.02)  # samples a turn at 60 1/s: 166, as above
    assert cuts.amplitude[later, 1].max() < 1e-3  # neither the trend nor the neighbors leak there


def test_no_cuts_of_less_than_a_block():
    time = np.linspace(0.0, 1.0, 1001)
    assert len(order_cuts(time, 7.0 * time, time, [1.0]).speed) == 0


def test_mean_and_envelope_of_the_engine_cycle():
    turns = swaying(UNEVEN)  # 50 cycles of two revolutions
    cycle = np.floor(turns / 2.0)
    sway = 0.2 * np.where(cycle % 2 == 0, 1.0, -1.0) * np.sin(np.pi * np.mod(turns, 2.0)) ** 4
    found = cycle_average(turns, np.cos(np.pi * turns) + sway)  # order a half, and what differs from cycle to cycle
    assert found.cycles == 50 and len(found.angle) == 720
    assert found.angle[-1] == pytest.approx(4.0 * np.pi * 719 / 720)
    part = found.angle / (2.0 * np.pi)
    # straight lines between 180 samples a revolution: (2 pi o / 180)^2 / 8 of order o, 4e-5 at 0.5, 6e-4 at 2
    np.testing.assert_allclose(found.mean, np.cos(np.pi * part), atol=5e-5)
    swing = 0.2 * np.sin(np.pi * part) ** 4
    np.testing.assert_allclose(found.high - found.mean, swing, atol=2e-4)
    np.testing.assert_allclose(found.mean - found.low, swing, atol=2e-4)


def test_cycles_of_a_slice_keep_their_angle():
    turns = swaying(UNEVEN)
    values = np.cos(np.pi * turns + 0.4)
    whole, part = cycle_average(turns, values), cycle_average(turns[3777:], values[3777:])
    assert part.cycles < whole.cycles
    np.testing.assert_allclose(part.mean, whole.mean, atol=5e-5)


def test_the_part_that_rises():
    assert last_rising_frames(np.array([0.0, 1.0, 1.0, 2.0, 1.5, 1.6, 2.0])) == slice(4, None)
    assert last_rising_frames(np.arange(3.0)) == slice(0, None)


def test_phase_error_of_a_camshaft():
    # a camshaft of twice the teeth, 0.4 degrees of the crank behind from the start's end on, swaying by 0.2 at order 2
    drive = two_sprockets().with_values({"sprockets.driven.teeth": 40, "chain.links": 80})
    turns = swaying(UNEVEN)
    degree = np.pi / 180.0
    lag = np.where(UNEVEN > 0.1, -0.4 * degree, 0.0) + 0.2 * degree * np.sin(2.0 * np.pi * 2.0 * turns)
    crank = 2.0 * np.pi * turns
    angle = np.stack([crank + 0.3, 0.5 * (crank + lag) - 1.1], axis=1)
    trajectory = Trajectory(drive, UNEVEN, sprocket_angle=angle)
    np.testing.assert_allclose(driver_turns(trajectory), turns, atol=1e-12)
    np.testing.assert_allclose(phase_error(trajectory, 1), lag, atol=1e-12)
    window = (UNEVEN >= 0.2) & (turns <= turns[-1])
    found = phase_error_in_window(trajectory, 1, window, orders=(0.5, 1.0, 2.0, 4.0))
    assert found.shift == pytest.approx(-0.4 * degree, abs=1e-3 * degree)  # an uncounted part of a period is left
    assert found.high - found.low == pytest.approx(0.4 * degree, rel=1e-3)
    np.testing.assert_allclose(found.amplitude, np.array([0.0, 0.0, 0.2, 0.0]) * degree, atol=1e-5 * degree)
