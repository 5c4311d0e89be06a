"""Replicates: copies of a drive with other initial states, for the scatter of chaotic motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from warpchain.argument_checks import AllowedRange, check_arguments
from warpchain.drive.drive import Drive
from warpchain.drive.run_settings import RunSettings
from warpchain.errors import SimulationError

MOST_COPIES = 10_000
CopyCount = Annotated[
    int, AllowedRange(f"a whole number from 1 to {MOST_COPIES}", lambda count: 1 <= count <= MOST_COPIES)
]
REPLICATE_WAYS = ("build", "phase", "perturbation")
"""Ways in which copies of a drive differ, the default first."""
FORMER_WAYS = {"nudge": "perturbation"}


@check_arguments(SimulationError, "replicates.")
@dataclass(frozen=True)
class Replicates:
    """Number of runs of each drive, and what they differ in.

    Attributes:
        count: copies, the drive itself among them.
        by: "build", "phase" or "perturbation".

    Raises:
        SimulationError: wrong count or unknown way.
    """

    count: CopyCount = 1
    by: str = REPLICATE_WAYS[0]

    def __post_init__(self) -> None:
        if self.by not in (*REPLICATE_WAYS, *FORMER_WAYS):
            raise SimulationError(f"replicate_by = {self.by!r}: allowed are {', '.join(REPLICATE_WAYS)}")


def copy_phase(copy: int) -> float:
    """Teeth by which a numbered copy of a drive is turned, -0.5 to 0.5 (van der Corput)."""
    share, part = 0.0, 0.5
    while copy:
        share += part * (copy & 1)
        copy, part = copy >> 1, 0.5 * part
    return share - 1.0 if share >= 0.5 else share


def numbered_copies(drives: Sequence[Drive], numbers: Sequence[int], by: str = REPLICATE_WAYS[0]) -> list[Drive]:
    """Copy of each drive by number, 0 the drive itself."""
    known: dict[tuple[int, int], RunSettings] = {}
    found = []
    for drive, number in zip(drives, numbers, strict=True):
        if number == 0:
            found.append(drive)
            continue
        key = id(drive.run), number
        if key not in known:
            known[key] = _copy_run_settings(drive.run, number, by)
        found.append(drive.model_copy(update={"run": known[key]}))
    return found


def all_copies(drives: Sequence[Drive], replicates: Replicates) -> list[Drive]:
    """All numbered copies of all drives, by drive."""
    count = replicates.count
    if count == 1:
        return list(drives)
    numbers = list(range(count)) * len(drives)
    return numbered_copies([drive for drive in drives for _ in range(count)], numbers, replicates.by)


def _copy_run_settings(run: RunSettings, number: int, by: str) -> RunSettings:
    """Run settings of a numbered copy of a drive."""
    if FORMER_WAYS.get(by, by) == "perturbation":
        return run.model_copy(update={"perturbation": (run.perturbation or 0) + number})
    phase = (run.phase or 0.0) + copy_phase(number)
    seating = (run.seating or 0) + number if by == "build" else run.seating
    return run.model_copy(update={"phase": phase - math.floor(phase + 0.5), "seating": seating})
