"""Measured signals as files, with units, as rigs write them: comma-separated values, MAT, MDF4."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.schema import HUGE
from warpchain.errors import SimulationError
from warpchain.extras import require_extra
from warpchain.files import open_regular, read_text, reason
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
    "0.1th percentile": lambda x: float(np.quantile(x, 0.001)),
    "99.9th percentile": lambda x: float(np.quantile(x, 0.999)),
    "largest": lambda x: float(x.max()),
}
"""Values by which a measured signal is compared with that of a run."""
MOST_VALUES = 2**25
"""Values of a signal of MAT or MDF4, at most; 256 MiB, as a chunk of an archive."""
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
        column: the values' column, variable or channel: its name, its name and unit as they stand in the file, or its
            number, "#2"; None is the first after the time.
        time: the same of the column of time; None is the first. Channels of MDF4 have their own.
        unit, time_unit: of them; None takes what the head says in brackets or parentheses, else SI.
        decimal: "." or ",", which ends the whole part of numbers in CSV; the other one is then between thousands. None
            takes the one that all numbers of the file have.
    """

    column: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None
    decimal: str | None = None


def read_signal(path: str | Path, name: str, unit: str, columns: Columns | None = None) -> Measured:
    """Reads a signal: of a MAT file (.mat), of MDF4 (.mf4), else of comma-separated values.

    CSV has a head of names, then numbers, separated by commas, semicolons or tabs. Names may end in a unit,
    "tension [kN]" or "time (ms)", or the line below the names may hold the units. With semicolons or tabs numbers may
    have decimal commas, all of them or none. Lines that begin with # are passed over. The variables of a MAT file are
    vectors.

    Args:
        name: what was measured.
        unit: SI unit that it must have.

    Raises:
        SimulationError: a file, column, unit or number that is not understood, a name that stands twice, points and
            commas in numbers, a time that does not ascend, or MDF4 without the package asammdf.
    """
    columns = columns or Columns()
    if columns.decimal not in (None, ".", ","):
        raise SimulationError(f"{path}: --decimal {columns.decimal}: must be . or ,")
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


_NUMBERS = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "single", "double", "logical")
"""Kinds of variables in MAT files that are arrays of numbers."""
_TIMES = ("time", "t", "Time")
"""Channels of MDF4 that have the time of others."""
_Column = tuple[str, str, Array]
"""Name, unit ("" where it is not said) and values (K,)."""


def _of_csv(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    text = read_text(path, "a file of measured values", lambda reason: SimulationError(f"{path}: {reason}"))
    heads, rows, decimal = _table(str(path), text, columns.decimal)
    named = [(name, f"{name} [{unit}]" if unit else name) for name, unit in heads]
    at = _index(path, named, columns.time, 0, "time")
    of = _index(path, named, columns.column, 1 if at == 0 else 0)
    values = np.array([_numbers(path, k, [row[at], row[of]], decimal) for k, row in rows])
    time, signal = ((*heads[k], column) for k, column in zip((at, of), values.reshape(-1, 2).T, strict=True))
    return time, signal


def _of_mat(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    from scipy.io import loadmat, whosmat

    try:
        with open(open_regular(path), "rb") as file:
            listed = whosmat(file)
            twice = [name for name, count in Counter(name for name, *_ in listed).items() if count > 1]
            if twice:
                raise SimulationError(
                    f"{path}: variable {twice[0]!r} stands twice: must stand once; rename one of the two"
                )
            lengths = {
                name: math.prod(shape)
                for name, shape, kind in listed
                if kind in _NUMBERS and math.prod(shape) == max(shape, default=0) > 1
            }
            names = [(name, name) for name in lengths]
            at = _index(path, names, columns.time, 0, "time")
            of = _index(path, names, columns.column, 1 if at == 0 else 0)
            wanted = [names[at][0], names[of][0]]
            for name in wanted:
                _check_length(path, name, lengths[name])
            file.seek(0)
            held = loadmat(file, variable_names=wanted)
            found = [np.asarray(held[name]).ravel() for name in wanted]
    except SimulationError:
        raise
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: is not a MAT file of version 4 to 7.2 ({reason(error)})") from None
    for name, values in zip(wanted, found, strict=True):
        if values.dtype.kind not in "iuf":
            raise SimulationError(f"{path}: variable {name!r}: must hold real numbers")
    time, signal = (
        (name, "", _finite(path, name, values.astype(float))) for name, values in zip(wanted, found, strict=True)
    )
    if len(time[2]) != len(signal[2]):
        raise SimulationError(f"{path}: {signal[0]} has {len(signal[2])} values, {time[0]} {len(time[2])}")
    return time, signal


def _check_length(path: str | Path, name: str, count: int) -> None:
    """Refuses more values than a signal may have, before they are read: a small file can state any number of zeros."""
    if count > MOST_VALUES:
        raise SimulationError(f"{path}: {name} has {count} values; allowed are at most {MOST_VALUES}")


def _of_mdf(path: str | Path, columns: Columns) -> tuple[_Column, _Column]:
    require_extra("mdf", "MDF4", SimulationError)
    import asammdf

    try:
        os.close(open_regular(path))
        with asammdf.MDF(path) as mdf:
            places = [(name, *at) for name, all_of in mdf.channels_db.items() for at in all_of if name not in _TIMES]
            names = [(name, f"{name} of group {group}") for name, group, _ in places]
            name, group, channel = places[_index(path, names, columns.column, 0)]
            _check_length(path, name, mdf.groups[group].channel_group.cycles_nr)
            signal = mdf.get(name, group, channel)
    except SimulationError:
        raise
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: is not MDF4 ({reason(error)})") from None
    if getattr(signal.samples, "dtype", np.dtype(object)).kind not in "iuf" or signal.samples.ndim != 1:
        raise SimulationError(f"{path}: channel {name!r}: must hold numbers")
    time = _finite(path, "time", np.asarray(signal.timestamps, dtype=float))
    return ("time", "s", time), (name, signal.unit or "", _finite(path, name, signal.samples.astype(float)))


def _finite(path: str | Path, name: str, values: Array) -> Array:
    if not (np.abs(values) <= HUGE).all():
        raise SimulationError(f"{path}: {name}: must be finite numbers within {HUGE:g} of 0")
    return values


def _table(
    path: str, text: str, decimal: str | None
) -> tuple[list[tuple[str, str]], list[tuple[int, list[str]]], Callable[[str], float]]:
    """Names with their units (or ""), the lines of numbers with their numbers in the file, and what reads a number."""
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
    if all(math.isnan(_plain(cell.replace(",", "."))) for cell in cells[0][1]):
        below = [cell.strip(" []()") for cell in cells.pop(0)[1]] + [""] * len(heads)
        heads = [(name, unit or under) for (name, unit), under in zip(heads, below, strict=False)]
    for k, row in cells:
        if any(cell.strip() for cell in row[len(heads) :]):
            text = "; decimal commas need semicolons or tabs between the columns" if mark == "," else ""
            raise SimulationError(f"{path}: line {k}: has {len(row)} cells below {len(heads)} names{text}")
        row += [""] * (len(heads) - len(row))
    if decimal:
        return heads, cells, partial(_grouped, decimal=decimal)
    sign = "." if mark == "," else _decimal(path, cells)
    return heads, cells, lambda cell: _plain(cell if sign == "." else cell.replace(",", "."))


_SIGNS = re.compile(r"\s*[+-]?(?=.*\d)\d*([.,])\d*(?:([.,])\d*)?(?:[eE][+-]?\d+)?\s*")
"""A number with a point or a comma, or two."""


def _decimal(path: str, rows: list[tuple[int, list[str]]]) -> str:
    """The sign before the decimals of a file's numbers: the one that all of them have, a point if none has one."""
    first: dict[str, tuple[int, str]] = {}
    for k, row in rows:
        for cell in row:
            found = _SIGNS.fullmatch(cell)
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


def _plain(cell: str) -> float:
    """The number of a cell with a decimal point, NaN if it is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _grouped(cell: str, decimal: str) -> float:
    """The number of a cell whose thousands may be apart by the sign that is not the decimal one, NaN if it is none."""
    other = re.escape("." if decimal == "," else ",")
    if re.search(other, cell) and not re.fullmatch(
        rf"\s*[+-]?\d{{1,3}}({other}\d{{3}})+({re.escape(decimal)}\d*)?\s*", cell
    ):
        return math.nan
    return _plain(re.sub(other, "", cell).replace(decimal, "."))


def _index(
    path: str | Path, names: list[tuple[str, str]], wanted: str | None, default: int, option: str = "column"
) -> int:
    """The place of a column among all, each given by its name, and by its name with its unit.

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


def _factor(path: str | Path, word: str) -> tuple[str, float]:
    word = word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    if word in SPELLED:
        return SPELLED[word]
    raise SimulationError(f"{path}: unit {word!r}: allowed are {', '.join(sorted(SPELLED, key=str.lower))}")


def _numbers(path: str | Path, line: int, cells: list[str], read: Callable[[str], float]) -> list[float]:
    values = [read(cell) for cell in cells]
    if not all(abs(value) <= HUGE for value in values):
        raise SimulationError(f"{path}: line {line}: {', '.join(cells)!r}: must be finite numbers within {HUGE:g} of 0")
    return values
