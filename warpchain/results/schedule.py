"""Schedules of variants: when each steps, is sampled, and is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import SimulationError

LOOK_EVERY = 32
"""Fewest steps between two samples for sums."""

MOST_STEPS = 2**31 - 2


def whole_steps(what: str, counts: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers of steps (V,) in schedules, rounded.

    Args:
        what: where the first comes from, for the error.

    Raises:
        SimulationError: one is more than can be counted.
    """
    wrong = ~(np.isfinite(counts) & (counts <= MOST_STEPS))
    if wrong.any():
        raise SimulationError(f"{what} is {counts[wrong][0]:.3g} steps; allowed are at most {MOST_STEPS}")
    return np.rint(counts).astype(np.int64)


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


class Schedules(Sequence[Schedule]):
    """Schedules of V variants, kept as columns (V,) by field."""

    def __init__(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self.columns = columns

    def __len__(self) -> int:
        return len(self.columns["step"])

    @overload
    def __getitem__(self, v: int) -> Schedule: ...
    @overload
    def __getitem__(self, v: slice | NDArray[Any]) -> Schedules: ...
    def __getitem__(self, v: int | slice | NDArray[Any]) -> Schedule | Schedules:
        own = {name: column[v] for name, column in self.columns.items()}
        if isinstance(v, slice | np.ndarray):
            return Schedules(own)
        return Schedule(**{name: value.item() for name, value in own.items()})


def schedules_as_columns(schedules: Sequence[Schedule]) -> Schedules:
    """Schedules of variants, as columns."""
    if isinstance(schedules, Schedules):
        return schedules
    return Schedules(
        {of.name: np.array([getattr(schedule, of.name) for schedule in schedules]) for of in fields(Schedule)}
    )


def join_schedules(parts: Sequence[Sequence[Schedule]]) -> Schedules:
    """Schedules of groups of variants, joined."""
    columns = [schedules_as_columns(part).columns for part in parts]
    return Schedules({of.name: np.concatenate([each[of.name] for each in columns]) for of in fields(Schedule)})
