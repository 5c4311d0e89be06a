"""Measured signals as files, with units, as rigs write them: comma-separated values, MAT, MDF4."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.schema import HUGE
from warpchain.errors import SimulationError, without_package
from warpchain.files import open_regular, read_text
from warpchain.results.units import DISPLAYED

Array = NDArray[np.float64]

SPELLED: dict[str, tuple[str, float]] = {
    word: (unit, 1.0 / factor) for unit, steps in DISPLAYED.items() for _, word, factor in steps
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
STATISTICS: dict[str, Callable[[Array], float]] = {
    "mean": lambda x: float(x.mean()),
    "std": lambda x: float(x.std()),
    "smallest": lambda x: float(x.min()),
    "0.1 % below": lambda x: float(np.quantile(x, 0.001)),
    "99.9 % below": lambda x: float(np.quantile(x, 0.999)),
    "largest": lambda x: float(x.max()),
}
"""Values by which a measured signal is compared with that of a run."""
LATEST = 1e9
"""Times beyond are mistakes [s]; recordings count nanoseconds in 64 bits."""


@dataclass(frozen=True)
class Measured:
    """A signal from a rig.

    Attributes:
        name: what was measured, one of `measured.sources`.
        unit: SI unit.
        time: (K,) of the run [s], ascending.
        values: (K,) in SI.
    """

    name: str
    unit: str
    time: Array
    values: Array


@dataclass(frozen=True)
class Columns:
    """Columns and units of a file of measured values.

    Attributes:
        column: name of the values' column, variable or channel; None is the first after the time.
        time: name of the column of time; None is the first. Channels of MDF4 have their own.
        unit, time_unit: of them; None takes what the head says in brackets or parentheses, else SI.
    """

    column: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None


def read_signal(path: str | Path, name: str, unit: str, columns: Columns | None = None) -> Measured:
    """Reads a signal: of a MAT file (.mat), of MDF4 (.mf4), else of comma-separated values.

    CSV has a head of names, then numbers, separated by commas, semicolons or tabs. Names may end in a unit,
    "tension [kN]" or "time (ms)", or the line below the names may hold the units. With semicolons or tabs numbers may
    have decimal commas. Lines that begin with # are passed over. The variables of a MAT file are vectors.

    Args:
        name: what was measured.
        unit: SI unit that it must have.

    Raises:
        SimulationError: a file, column, unit or number that is not understood, a time that does not ascend, or MDF4
            without the package asammdf.
    """
    columns = columns or Columns()
    read = {".mat": _of_mat, ".mf4": _of_mdf}.get(Path(path).suffix.lower(), _of_csv)
    (head, said, time), (column, its, signal) = read(path, columns)
    second, to_seconds = _factor(path, columns.time_unit or said or "s")
    si, to_si = _factor(path, columns.unit or its or unit)
    if second != "s":
        raise SimulationError(f"{path}: the time is in {second}: must be a time")
    if si != unit:
        raise SimulationError(f"{path}: {column} is in {si}: {name} is in {unit}; say --unit")
    time, signal = to_seconds * time, to_si * signal
    if len(time) < 2 or not (np.diff(time) > 0.0).all():
        raise SimulationError(f"{path}: {head}: must ascend over at least two lines")
    if max(-time[0], time[-1]) > LATEST:
        raise SimulationError(f"{path}: {head}: must be within {LATEST:g} s of 0")
    return Measured(name, unit, time, signal)


_Column = tuple[str, str, Array]
"""Name, unit ("" where it is not said) and values (K,)."""


def _of_csv(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    text = read_text(path, "a file of measured values", lambda reason: SimulationError(f"{path}: {reason}"))
    heads, below, rows = _table(str(path), text)
    at = _index(path, heads, columns.time, 0)
    of = _index(path, heads, columns.column, 1 if at == 0 else 0)
    values = np.array([_numbers(path, k, row, (at, of)) for k, row in rows]).reshape(-1, 2)
    time, signal = (
        (heads[k][0], heads[k][1] or below[k], column) for k, column in zip((at, of), values.T, strict=True)
    )
    return time, signal


def _of_mat(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    from scipy.io import loadmat

    try:
        with open(open_regular(path), "rb") as file:
            held = loadmat(file)
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: is not a MAT file of version 4 to 7.2 ({str(error).splitlines()[0]})") from None
    vectors = {
        name: np.asarray(value, dtype=float).ravel()
        for name, value in held.items()
        if not name.startswith("__") and value.dtype.kind in "iuf" and value.size == max(value.shape, default=0) > 1
    }
    heads = [(name, "") for name in vectors]
    at = _index(path, heads, columns.time, 0)
    of = _index(path, heads, columns.column, 1 if at == 0 else 0)
    time, signal = ((heads[k][0], "", _finite(path, heads[k][0], vectors[heads[k][0]])) for k in (at, of))
    if len(time[2]) != len(signal[2]):
        raise SimulationError(f"{path}: {signal[0]} has {len(signal[2])} values, {time[0]} {len(time[2])}")
    return time, signal


def _of_mdf(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    try:
        import asammdf
    except ImportError:
        raise without_package("MDF4", "asammdf", "mdf") from None
    try:
        os.close(open_regular(path))
        with asammdf.MDF(path) as mdf:
            names = [name for name in mdf.channels_db if name not in ("time", "t", "Time")]
            at = _index(path, [(name, "") for name in names], columns.column, 0)
            signal = mdf.get(names[at], *mdf.channels_db[names[at]][0])
    except SimulationError:
        raise
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: is not MDF4 ({str(error).splitlines()[0]})") from None
    if getattr(signal.samples, "dtype", np.dtype(object)).kind not in "iuf" or signal.samples.ndim != 1:
        raise SimulationError(f"{path}: channel {names[at]!r}: must hold numbers")
    time = _finite(path, "time", np.asarray(signal.timestamps, dtype=float))
    return ("time", "s", time), (names[at], signal.unit or "", _finite(path, names[at], signal.samples.astype(float)))


def _finite(path: str | Path, name: str, values: Array) -> Array:
    if not (np.abs(values) <= HUGE).all():
        raise SimulationError(f"{path}: {name}: must be finite numbers within {HUGE:g} of 0")
    return values


def _table(path: str, text: str) -> tuple[list[tuple[str, str]], list[str], list[tuple[int, list[str]]]]:
    """Names with their units, units of the line below (or ""), and the lines of numbers with their numbers in the
    file."""
    lines = [(k + 1, line) for k, line in enumerate(text.splitlines()) if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise SimulationError(f"{path}: must have a line of names and lines of numbers below it")
    mark = max(";\t,", key=lambda sign: (sign in lines[0][1], sign != ","))
    try:
        cells = [(k, next(csv.reader(io.StringIO(line), delimiter=mark))) for k, line in lines]
    except csv.Error as error:  # a cell of more than 131,072 characters, say
        raise SimulationError(f"{path}: is not CSV ({error})") from None
    if mark != ",":
        cells = [cells[0], *((k, [cell.replace(",", ".") for cell in row]) for k, row in cells[1:])]
    heads = []
    for cell in cells[0][1]:
        found = re.fullmatch(r"\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", cell)
        heads.append((found[1] or found[2] or "", found[2] or "") if found else (cell.strip(), ""))
    below = [""] * len(heads)
    if not any(_is_number(cell) for cell in cells[1][1]):
        below = [cell.strip(" []()") for cell in cells.pop(1)[1]] + below
    return heads, below, cells[1:]


def _index(path: str | Path, heads: list[tuple[str, str]], wanted: str | None, default: int) -> int:
    names = [name for name, _ in heads]
    if wanted is None:
        if default < len(names):
            return default
        raise SimulationError(f"{path}: has one column: must have a time and values")
    if wanted not in names:
        raise SimulationError(f"{path}: no column {wanted!r}: allowed are {', '.join(names)}")
    return names.index(wanted)


def _factor(path: str | Path, word: str) -> tuple[str, float]:
    word = word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    if word in SPELLED:
        return SPELLED[word]
    raise SimulationError(f"{path}: unit {word!r}: allowed are {', '.join(sorted(SPELLED, key=str.lower))}")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(path: str | Path, line: int, row: list[str], places: tuple[int, int]) -> list[float]:
    cells = [row[k] if k < len(row) else "" for k in places]
    if not all(_is_number(cell) and abs(float(cell)) <= HUGE for cell in cells):
        raise SimulationError(f"{path}: line {line}: {', '.join(cells)!r}: must be finite numbers within {HUGE:g} of 0")
    return [float(cell) for cell in cells]
