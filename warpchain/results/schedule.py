"""Schedule of a variant: when it steps, is sampled, and is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import SimulationError

LOOK_EVERY = 32
"""Fewest steps between two samples for sums."""

MOST_STEPS = 2**31 - 2
"""Most steps of a run, counted in 32 bits."""


def whole_steps(what: str, count: float) -> int:
    """Rounded number of a schedule's steps, named by `what`.

    Raises:
        SimulationError: it is more than can be counted.
    """
    if not (math.isfinite(count) and count <= MOST_STEPS):
        raise SimulationError(f"{what} is {count:.3g} steps; allowed are at most {MOST_STEPS}")
    return round(count)


@dataclass(frozen=True)
class Schedule:
    """Schedule of a variant in steps: end, window, samples."""

    step: float
    steps: int
    window_start: int
    window_end: int
    frame_interval: int  # 0: not recorded
    sample_interval: int = LOOK_EVERY  # steps between two samples for sums (`engine.simulation`)

    def __post_init__(self) -> None:
        times, rest = divmod(self.sample_interval, LOOK_EVERY)
        if rest or times < 1 or times & (times - 1):
            raise ValueError(f"sample_interval = {self.sample_interval}: allowed is {LOOK_EVERY} times a power of two")

    @property
    def frames(self) -> int:
        """Number of frames of the whole run."""
        return self.steps // self.frame_interval + 1 if self.frame_interval else 0


def schedule_columns(schedules: Sequence[Schedule]) -> dict[str, NDArray[np.float64 | np.int64]]:
    """Fields of schedules as arrays (V,), by name."""
    known = {id(schedule): schedule for schedule in schedules}
    places = {key: place for place, key in enumerate(known)}
    which = np.array([places[id(schedule)] for schedule in schedules], dtype=np.int64)
    return {
        field.name: np.array([getattr(schedule, field.name) for schedule in known.values()])[which]
        for field in fields(Schedule)
    }
