"""Columns of files of measured values, by their names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.schema import HUGE
from warpchain.errors import SimulationError

Array = NDArray[np.float64]
MeasuredColumn = tuple[str, str, Array]
"""Name, unit ("" where it is not said) and values (K,)."""


@dataclass(frozen=True)
class MeasuredColumns:
    """Columns and units of a file of measured values.

    Attributes:
        column: of the values: name, name and unit as in the file, or number, "#2"; None is the first after the time.
        time: of the time, likewise; None is the first. Channels of MDF4 have their own.
        unit, time_unit: None takes what the head says in brackets or parentheses, else SI.
        decimal: "." or ",", before decimals in CSV; the other one is then between thousands. None takes the one that
            all numbers have.
    """

    column: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None
    decimal: str | None = None


def column_index(
    path: str | Path, names: list[tuple[str, str]], wanted: str | None, default: int, option: str = "column"
) -> int:
    """Place of a column among all, each given by its name, and by its name with unit.

    Raises:
        SimulationError: there is none of that name, or several.
    """
    known = [name for name, _ in names]
    if wanted is None and default >= len(known):
        raise SimulationError(f"{path}: has one column: must have a time and values")
    name = known[default] if wanted is None else wanted
    numbered = [(each, whole, f"#{k + 1}") for k, (each, whole) in enumerate(names)]
    for form in range(3):
        at = [k for k, forms in enumerate(numbered) if forms[form] == name]
        if len(at) > 1:
            all_of = " and ".join(f"{numbered[k][2]}, {numbered[k][1]}" for k in at)
            raise SimulationError(
                f"{path}: {name!r} names the columns {all_of}: say --{option} '#{at[0] + 1}', or another"
            )
        if at:
            return at[0]
    raise SimulationError(f"{path}: no column {name!r}: allowed are {', '.join(known)}")


def require_finite_values(path: str | Path, name: str, values: Array) -> Array:
    """Values of a measured column; raises SimulationError where one is not finite."""
    if not (np.abs(values) <= HUGE).all():
        raise SimulationError(f"{path}: {name}: must be finite numbers within {HUGE:g} of 0")
    return values
