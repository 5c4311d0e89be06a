"""Columns of files of measured values, chosen by name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.schema import HUGE
from warpchain.drive.text_table import TableError, column_place
from warpchain.errors import SimulationError

Array = NDArray[np.float64]
MeasuredColumn = tuple[str, str, Array]
"""Measured column: name, unit and values (K,)."""


@dataclass(frozen=True)
class MeasuredColumns:
    """Choice of a measured file's time and value columns.

    Attributes:
        column: of the values, by name or number, "#2"; None is the first after the time.
        time: of the time, likewise; None is the first, or the channel's own.
        unit, time_unit: None takes the head's, else SI.
        decimal: "." or "," in text; None takes the one that all numbers have.
        head: line of the names in text; None finds it.
    """

    column: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None
    decimal: str | None = None
    head: int | None = None


def column_index(
    path: str | Path, names: list[tuple[str, str]], wanted: str | None, default: int, option: str = "column"
) -> int:
    """Index of a measured file's column, by name or number."""
    try:
        return column_place(names, wanted, default, option)
    except TableError as error:
        raise SimulationError(f"{path}: {error}") from None


def require_bounded_values(path: str | Path, name: str, values: Array) -> Array:
    """Values of a measured column; raises if too large."""
    if (np.abs(values) > HUGE).any():
        raise SimulationError(f"{path}: {name}: must be finite numbers within {HUGE:g} of 0")
    return values
