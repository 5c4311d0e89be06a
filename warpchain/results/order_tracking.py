"""Order tracking: signals over the driver's angle, amplitudes of orders, averages over the working cycle.

An order is a number of oscillations a revolution of the driver. Over whole periods of even angles, its amplitude is

    a_o = 2/K |sum over samples of x_k exp(-2 pi i o n_k)|,   n_k the revolutions.                              (a)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import forward_values

Array = NDArray[np.float64]

CYCLE_TURNS = 2.0
LEAST_SAMPLES_A_TURN = 256
CYCLE_POINTS = 720
BLOCK_TURNS = 8.0


def driver_turns(trajectory: Trajectory) -> Array:
    """Revolutions (F,) of the driver, forward."""
    (sprocket_angle,) = require_channels(trajectory, "sprocket_angle")
    angle = forward_values(trajectory.parts, sprocket_angle, trajectory.parts.driver)
    return (angle - angle[0]) / (2.0 * np.pi)


def last_rising_frames(turns: Array) -> slice:
    """Last frames over which the driver's revolutions (F,) rise."""
    still = np.flatnonzero(np.diff(turns) <= 0.0)
    return slice(int(still[-1]) + 1 if len(still) else 0, None)


def resample_at_turns(turns: Array, values: Array, at: Array) -> Array:
    """Signal (K,) at given revolutions of the driver, by spline."""
    from scipy.interpolate import CubicSpline

    finite = np.isfinite(values)
    if finite.sum() < 4:
        return np.full(len(at), np.nan)
    return np.asarray(CubicSpline(turns[finite], values[finite], axis=0)(at), dtype=float)


def _samples_a_turn(turns: Array) -> int:
    """Samples a revolution that keep all frames."""
    return max(LEAST_SAMPLES_A_TURN, int(np.ceil(1.0 / float(np.diff(turns).max()))))


def order_amplitudes(turns: Array, values: Array, orders: Sequence[float]) -> Array | None:
    """Amplitudes (O,) of orders over whole working cycles, (a), or None."""
    cycles = int((turns[-1] - turns[0]) / CYCLE_TURNS * (1.0 + 1e-9))
    if cycles < 1 or not np.isfinite(values).all():
        return None
    count = int(np.ceil(cycles * CYCLE_TURNS * _samples_a_turn(turns)))
    at = turns[-1] - cycles * CYCLE_TURNS * (1.0 - np.arange(count) / count)
    x = resample_at_turns(turns, values, at)
    return np.abs(np.exp(-2j * np.pi * np.outer(orders, at)) @ x) * 2.0 / count


class OrderCuts(NamedTuple):
    """Amplitudes of orders over speed in a run-up."""

    speed: Array  # (B,) mean of each block [rad/s]
    time: Array  # (B,) middle of each block [s]
    orders: Array  # (O,)
    amplitude: Array  # (B, O) in the signal's unit


def order_cuts(time: Array, turns: Array, values: Array, orders: Sequence[float]) -> OrderCuts:
    """Amplitudes of orders over speed, from a run-up's blocks.

    Args:
        time, turns: (F,) [s], ascending revolutions.
    """
    wanted = np.asarray(orders, dtype=float)
    rate = _samples_a_turn(turns)
    count = int(BLOCK_TURNS * rate)
    at = turns[0] + np.arange(int((turns[-1] - turns[0]) * rate) + 1) / rate
    x, t = resample_at_turns(turns, values, at), np.interp(at, turns, time)
    step = max(1, count // 4)
    firsts = range(0, max(len(at) - count, 0) + 1, step) if len(at) >= count else range(0)
    window = np.hanning(count + 1)[:-1]
    weights = window * 2.0 / window.sum()
    line = np.arange(count) - 0.5 * (count - 1)
    found = np.zeros((len(firsts), len(wanted)))
    for b, first in enumerate(firsts):
        part = x[first : first + count]
        part = part - part.mean() - line * (line @ part) / (line @ line)
        found[b] = np.abs(np.exp(-2j * np.pi * np.outer(wanted, at[first : first + count])) @ (part * weights))
    begins, ends = t[list(firsts)], t[[first + count - 1 for first in firsts]]
    speed = 2.0 * np.pi * (count - 1) / rate / np.where(ends > begins, ends - begins, np.nan)
    return OrderCuts(speed, 0.5 * (begins + ends), wanted, found)


class CycleAverage(NamedTuple):
    """Average of a signal over the working cycle's angle."""

    angle: Array  # (A,) of the driver from where the recording began [rad]
    mean: Array  # (A,) of all cycles at that angle
    low: Array
    high: Array
    cycles: int  # number


def cycle_average(turns: Array, values: Array) -> CycleAverage | None:
    """Average of a signal over working cycles, or None."""
    first = int(np.ceil(turns[0] / CYCLE_TURNS * CYCLE_POINTS - 1e-9))
    last = int(np.floor(turns[-1] / CYCLE_TURNS * CYCLE_POINTS + 1e-9))
    count = (last - first + 1) // CYCLE_POINTS
    if count < 1:
        return None
    steps = last + 1 - count * CYCLE_POINTS + np.arange(count * CYCLE_POINTS)
    x = np.interp(steps * (CYCLE_TURNS / CYCLE_POINTS), turns, values)
    x = np.roll(x.reshape(count, CYCLE_POINTS), steps[0] % CYCLE_POINTS, axis=1)
    angle = 2.0 * np.pi * CYCLE_TURNS * np.arange(CYCLE_POINTS) / CYCLE_POINTS
    return CycleAverage(angle, x.mean(axis=0), x.min(axis=0), x.max(axis=0), count)
