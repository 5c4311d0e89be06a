"""Measured signals read from files, with units: text tables such as CSV, MAT, MDF, TDMS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warpchain.drive import quantities
from warpchain.drive.text_table import TIME_NAMES, TableError, TextTable, column_place, read_text_table
from warpchain.errors import SimulationError, warn_caller
from warpchain.results.measured_binary import COLUMN_READERS, read_binary_columns
from warpchain.results.measured_columns import Array, MeasuredColumn, MeasuredColumns
from warpchain.results.measured_times import clock_seconds, has_clock, spread_equal_times

SIGNAL_STATISTICS: dict[str, Callable[[Array], float]] = {
    "mean": lambda x: float(x.mean()),
    "std": lambda x: float(x.std()),
    "smallest": lambda x: float(x.min()),
    "0.1th percentile": lambda x: float(np.quantile(x, 0.001)),
    "99.9th percentile": lambda x: float(np.quantile(x, 0.999)),
    "largest": lambda x: float(x.max()),
}
LATEST_TIME = 1e9


@dataclass(frozen=True)
class MeasuredSignal:
    """Signal measured on a rig.

    Attributes:
        name: what was measured, of `measured.signal_sources`.
        unit: SI unit.
        time: (K,) ascending [s].
        values: (K,) in SI.
    """

    name: str
    unit: str
    time: Array
    values: Array


def read_signal(path: str | Path, name: str, unit: str, columns: MeasuredColumns | None = None) -> MeasuredSignal:
    """Measured signal read from a file, in SI.

    Instants without a value are left out, equal times spread, with a warning.

    Args:
        name: what was measured.
        unit: SI unit that it must have.

    Raises:
        SimulationError: a file, column, unit, number or time not understood, or a missing package.
    """
    columns = columns or MeasuredColumns()
    if columns.decimal not in (None, ".", ","):
        raise SimulationError(f"{path}: --decimal {columns.decimal}: must be . or ,")
    is_binary = Path(path).suffix.lower() in COLUMN_READERS
    for option in ("decimal", "head"):
        if is_binary and getattr(columns, option) is not None:
            raise SimulationError(f"{path}: --{option} {getattr(columns, option)}: only of text")
    (head, said, time), (column, its, signal) = (read_binary_columns if is_binary else _columns_of_text)(path, columns)
    to_seconds = _unit_factor(
        path, f"the time, {head},", columns.time_unit or said or "s", "s", "must be a time; say --time-unit"
    )
    to_si = _unit_factor(path, column, columns.unit or its or unit, unit, f"{name} is in {unit}; say --unit")
    time, signal = _values_without_gaps(path, head, to_seconds * time, to_si * signal)
    if len(time) < 2 or not (np.diff(time) >= 0.0).all() or time[0] == time[-1]:
        raise SimulationError(f"{path}: {head}: must ascend over at least two lines with values")
    if time[0] > LATEST_TIME:  # seconds since 1970, say
        warn_caller(f"{path}: {head}: begins at {time[0]:.10g} s; it counts from the first instant")
        time = time - time[0]
    if max(-time[0], time[-1]) > LATEST_TIME:
        raise SimulationError(f"{path}: {head}: must be within {LATEST_TIME:g} s of 0")
    equal = int((np.diff(time) == 0.0).sum())
    if equal:
        warn_caller(
            f"{path}: {head}: {equal} of {len(time)} times are those of the line before; they are spread evenly"
        )
        time = spread_equal_times(time)
    return MeasuredSignal(name, unit, time, signal)


def _values_without_gaps(path: str | Path, head: str, time: Array, signal: Array) -> tuple[Array, Array]:
    """Times and values (K,) of a measured signal without gaps.

    Raises:
        SimulationError: a value without a time.
    """
    is_gap = np.isnan(signal)
    untimed = np.flatnonzero(np.isnan(time) & ~is_gap)
    if len(untimed):
        raise SimulationError(f"{path}: {head}: value {untimed[0] + 1} of {len(time)} has no time: must have one")
    count = int(is_gap.sum())
    if 0 < count < len(time):
        warn_caller(f"{path}: {count} of {len(time)} instants have no value; they are left out")
    return time[~is_gap], signal[~is_gap]


def _columns_of_text(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a measured text table."""
    known = {"time", "t", *(word.lower() for word in (columns.column, columns.time) if word)}
    try:
        table = read_text_table(path, columns.decimal, columns.head, known)
        heads, names = table.heads, table.names
        at = column_place(names, columns.time, 0, "time")
        if columns.time is None:
            _check_first_column(table)
        of = column_place(names, columns.column, (at + 1) % max(len(names), 2), "column")
        unit_of_time = heads[at].unit
        if has_clock(table, at):
            time, unit_of_time = clock_seconds(table, at), "s"
            if columns.column is None and of == at + 1 and has_clock(table, of):  # the time of day beside the date
                of = column_place(names, None, of + 1, "column")
        else:
            time = np.array(table.numbers(at))
        return (heads[at].name, unit_of_time, time), (heads[of].name, heads[of].unit, np.array(table.numbers(of)))
    except TableError as error:
        raise SimulationError(f"{path}: {error}") from None


def _check_first_column(table: TextTable) -> None:
    """Raises TableError if time is not the table's first column."""
    is_time = [
        head.name in TIME_NAMES or quantities.unit_factor(head.unit, "s") is not None or has_clock(table, k)
        for k, head in enumerate(table.heads)
    ]
    if not is_time[0] and any(is_time):
        at = is_time.index(True)
        first, other = (f"column #{k + 1}, {table.heads[k]}" for k in (0, at))
        raise TableError(f"{first}, may be no time, since {other}, is one: say --time '#{at + 1}', or another")


def _unit_factor(path: str | Path, what: str, given: str, si: str, hint: str) -> float:
    """Factor from a measured column's unit to SI.

    Raises:
        SimulationError: no such unit, or one of another kind.
    """
    found, fit = quantities.unit_factor(given, si), ", ".join(quantities.equivalent_units(si))
    if found is None and quantities.unit_from_text(given) is None:
        raise SimulationError(
            f"{path}: {what} has the unit {given!r}: allowed are {fit}, and products of units; {hint}"
        )
    if found is None:
        raise SimulationError(f"{path}: {what} is in {given}: {hint}")
    return found
