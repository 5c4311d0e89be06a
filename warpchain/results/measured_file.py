"""Measured signals as files, with units, as rigs write them: CSV, MAT, MDF4."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from warpchain.drive.schema import HUGE
from warpchain.errors import SimulationError
from warpchain.files import read_text_file
from warpchain.results.measured_binary import read_binary_columns
from warpchain.results.measured_columns import Array, MeasuredColumn, MeasuredColumns, column_index
from warpchain.results.units import DISPLAY_UNITS

UNIT_SPELLINGS: dict[str, tuple[str, float]] = {
    word: (unit, 1.0 / factor) for unit, steps in DISPLAY_UNITS.items() for _, word, factor in steps
} | {
    "rad/s": ("rad/s", 1.0),
    "rpm": ("rad/s", math.pi / 30.0),
    "1/min": ("rad/s", math.pi / 30.0),
    "us": ("s", 1e-6),
    "um": ("m", 1e-6),
    "Nm": ("N m", 1.0),
    "kNm": ("N m", 1e3),
    "daN": ("N", 10.0),
    "lbf": ("N", 4.4482216152605),
    "in": ("m", 0.0254),
}
"""SI unit and factor of each unit that a measured signal can have."""
SIGNAL_STATISTICS: dict[str, Callable[[Array], float]] = {
    "mean": lambda x: float(x.mean()),
    "std": lambda x: float(x.std()),
    "smallest": lambda x: float(x.min()),
    "0.1th percentile": lambda x: float(np.quantile(x, 0.001)),
    "99.9th percentile": lambda x: float(np.quantile(x, 0.999)),
    "largest": lambda x: float(x.max()),
}
BINARY_ENDINGS = (".mat", ".mf4")
"""Endings of files that `measured_binary` reads; all others are CSV."""
LATEST_TIME = 1e9
"""Times beyond are mistakes [s]."""


@dataclass(frozen=True)
class MeasuredSignal:
    """A signal from a rig.

    Attributes:
        name: what was measured, one of `measured.signal_sources`.
        unit: SI unit.
        time: (K,) ascending [s].
        values: (K,) in SI.
    """

    name: str
    unit: str
    time: Array
    values: Array


def read_signal(path: str | Path, name: str, unit: str, columns: MeasuredColumns | None = None) -> MeasuredSignal:
    """Measured signal of a MAT (.mat), MDF4 (.mf4) or else CSV file.

    CSV has a head of names, then numbers, separated by commas, semicolons or tabs. Names may end in a unit, "tension
    [kN]" or "time (ms)", or the line below them may hold the units. With semicolons or tabs all numbers may have
    decimal commas. Lines that begin with # are passed over. Variables of a MAT file are vectors.

    Args:
        name: what was measured.
        unit: SI unit that it must have.

    Raises:
        SimulationError: a file, column, unit or number that is not understood, points and commas in numbers, a time
            that does not ascend, or MDF4 without the package asammdf.
    """
    columns = columns or MeasuredColumns()
    if columns.decimal not in (None, ".", ","):
        raise SimulationError(f"{path}: --decimal {columns.decimal}: must be . or ,")
    if Path(path).suffix.lower() in BINARY_ENDINGS:
        (head, said, time), (column, its, signal) = read_binary_columns(path, columns)
    else:
        (head, said, time), (column, its, signal) = _columns_from_csv(path, columns)
    second, to_seconds = _si_unit_and_factor(path, columns.time_unit or said or "s")
    si, to_si = _si_unit_and_factor(path, columns.unit or its or unit)
    if second != "s":
        raise SimulationError(f"{path}: the time is in {second}: must be a time")
    if si != unit:
        raise SimulationError(f"{path}: {column} is in {si}: {name} is in {unit}; say --unit")
    time, signal = to_seconds * time, to_si * signal
    if len(time) < 2 or not (np.diff(time) > 0.0).all():
        raise SimulationError(f"{path}: {head}: must ascend over at least two lines")
    if max(-time[0], time[-1]) > LATEST_TIME:
        raise SimulationError(f"{path}: {head}: must be within {LATEST_TIME:g} s of 0")
    return MeasuredSignal(name, unit, time, signal)


def _columns_from_csv(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Columns of time and values of a CSV file."""
    text = read_text_file(path, "a file of measured values", lambda reason: SimulationError(f"{path}: {reason}"))
    heads, rows, decimal = _csv_table(str(path), text, columns.decimal)
    named = [(name, f"{name} [{unit}]" if unit else name) for name, unit in heads]
    at = column_index(path, named, columns.time, 0, "time")
    of = column_index(path, named, columns.column, 1 if at == 0 else 0)
    values = np.array([_numbers_from_cells(path, k, [row[at], row[of]], decimal) for k, row in rows])
    time, signal = ((*heads[k], column) for k, column in zip((at, of), values.reshape(-1, 2).T, strict=True))
    return time, signal


def _csv_table(
    path: str, text: str, decimal: str | None
) -> tuple[list[tuple[str, str]], list[tuple[int, list[str]]], Callable[[str], float]]:
    """Names with units (or ""), numbered rows of cells, and the function that reads a cell, of a CSV text."""
    lines = [(k + 1, line) for k, line in enumerate(text.splitlines()) if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise SimulationError(f"{path}: must have a line of names and lines of numbers below it")
    mark = max(";\t,", key=lambda sign: (sign in lines[0][1], sign != ","))
    try:
        cells = [(k, next(csv.reader(io.StringIO(line), delimiter=mark))) for k, line in lines]
    except csv.Error as error:  # a cell of more than 131,072 characters, say
        raise SimulationError(f"{path}: is not CSV ({error})") from None
    heads = []
    for cell in cells.pop(0)[1]:
        found = re.fullmatch(r"\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", cell)
        heads.append((found[1] or found[2] or "", found[2] or "") if found else (cell.strip(), ""))
    if all(math.isnan(_number_from_cell(cell.replace(",", "."))) for cell in cells[0][1]):
        below = [cell.strip(" []()") for cell in cells.pop(0)[1]] + [""] * len(heads)
        heads = [(name, unit or under) for (name, unit), under in zip(heads, below, strict=False)]
    for k, row in cells:
        if any(cell.strip() for cell in row[len(heads) :]):
            text = "; decimal commas need semicolons or tabs between the columns" if mark == "," else ""
            raise SimulationError(f"{path}: line {k}: has {len(row)} cells below {len(heads)} names{text}")
        row += [""] * (len(heads) - len(row))
    if decimal:
        return heads, cells, partial(_number_from_grouped_cell, decimal=decimal)
    sign = "." if mark == "," else _decimal_sign(path, cells)
    return heads, cells, lambda cell: _number_from_cell(cell if sign == "." else cell.replace(",", "."))


_DECIMAL_NUMBER = re.compile(r"\s*[+-]?(?=.*\d)\d*([.,])\d*(?:([.,])\d*)?(?:[eE][+-]?\d+)?\s*")
"""A number with a point or a comma, or two."""


def _decimal_sign(path: str, rows: list[tuple[int, list[str]]]) -> str:
    """Decimal sign that all of a CSV file's numbers have, else a point."""
    first: dict[str, tuple[int, str]] = {}
    for k, row in rows:
        for cell in row:
            found = _DECIMAL_NUMBER.fullmatch(cell)
            if found and found[1] != found[2]:  # 24.12.2026 is a date
                for sign in filter(None, found.groups()):
                    first.setdefault(sign, (k, cell.strip()))
        if len(first) == 2:
            (one, this), (other, that) = first.values()
            both = f"{that}, but line {one} has {this}" if this != that else that
            text = (
                "numbers of one file have points and commas; say --decimal , or . and the other sign is for thousands"
            )
            raise SimulationError(f"{path}: line {other}: {both}: {text}")
    return next(iter(first), ".")


def _number_from_cell(cell: str) -> float:
    """Number of a cell with a decimal point, nan if it is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _number_from_grouped_cell(cell: str, decimal: str) -> float:
    """Number of a cell with signs between its thousands, nan if it is none."""
    other = re.escape("." if decimal == "," else ",")
    if re.search(other, cell) and not re.fullmatch(
        rf"\s*[+-]?\d{{1,3}}({other}\d{{3}})+({re.escape(decimal)}\d*)?\s*", cell
    ):
        return math.nan
    return _number_from_cell(re.sub(other, "", cell).replace(decimal, "."))


def _si_unit_and_factor(path: str | Path, word: str) -> tuple[str, float]:
    """SI unit of a unit's spelling, and the factor to it."""
    word = word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    if word in UNIT_SPELLINGS:
        return UNIT_SPELLINGS[word]
    raise SimulationError(f"{path}: unit {word!r}: allowed are {', '.join(sorted(UNIT_SPELLINGS, key=str.lower))}")


def _numbers_from_cells(path: str | Path, line: int, cells: list[str], read: Callable[[str], float]) -> list[float]:
    """Numbers of a line's cells; raises SimulationError where one is not finite."""
    values = [read(cell) for cell in cells]
    if not all(abs(value) <= HUGE for value in values):
        raise SimulationError(f"{path}: line {line}: {', '.join(cells)!r}: must be finite numbers within {HUGE:g} of 0")
    return values
