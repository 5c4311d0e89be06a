"""What arms and tensioners do over a window: stroke, events of a valve or of a contact that opens and closes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Stroke(NamedTuple):
    """How a quantity moves: an extension, an angle, a force, a pressure.

    Attributes:
        low, mean, high: smallest, mean, largest.
        path: the way that it goes back and forth in a second, sum of |dx| over the time.
    """

    low: float
    mean: float
    high: float
    path: float

    @property
    def travel(self) -> float:
        """From the smallest to the largest."""
        return self.high - self.low


class Events(NamedTuple):
    """How often something opens.

    Attributes:
        openings: samples above the threshold after one that is not.
        rate: of them a second [1/s].
        share: of the time that it is open.
        longest: it stays open [s].
    """

    openings: int
    rate: float
    share: float
    longest: float


def stroke(time: Array, values: Array) -> Stroke:
    """How samples (F,) at times (F,) [s] move."""
    seconds = float(time[-1] - time[0])
    path = float(np.abs(np.diff(values)).sum()) / seconds if seconds > 0.0 else 0.0
    return Stroke(float(values.min()), float(values.mean()), float(values.max()), path)


def events(time: Array, values: Array, threshold: float = 0.0) -> Events:
    """Spells of samples (F,) at even times (F,) [s] above a threshold, such as a valve's lift above 0."""
    open_ = np.concatenate([[False], np.asarray(values) > threshold, [False]])
    begins, ends = np.flatnonzero(open_[1:] & ~open_[:-1]), np.flatnonzero(~open_[1:] & open_[:-1])
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    count = len(begins) - int(bool(len(begins)) and begins[0] == 0)
    seconds = step * len(time)
    longest = step * int((ends - begins).max()) if len(begins) else 0.0
    return Events(count, count / seconds if seconds > 0.0 else 0.0, float((ends - begins).sum()) / len(time), longest)
