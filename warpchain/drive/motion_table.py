"""Speeds and torques as tables over time or angle: in the drive itself, or in a CSV file that its file names.

A drive holds the numbers, so that it stays whole wherever it goes: `load_drive` reads the CSV file that stands beside
the drive file (`warpchain.drive.csv_files`), and what is written (saved drives, archives) has the table in it.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from warpchain.drive.schema import BARE, Column, Finite, Name, Part, Problem, Value, elements, get, numbers
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError
from warpchain.files import read_text

Interpolation = Annotated[Literal["linear", "cubic"], Value('must be "linear" or "cubic" (monotone between rows)')]
Factor = Finite

TURN_TOLERANCE = 1e-3
"""Revolutions by which the angles of a table may miss a whole number: they are rounded in files."""

MOST_ROWS = 1_000_000
"""Most rows of a table."""

HEADS = {
    "time": ("time", 1.0),
    "angle": ("angle", 1.0),
    "angle_deg": ("angle", math.pi / 180.0),
    "speed": ("speed", 1.0),
    "speed_rpm": ("speed", math.pi / 30.0),
    "torque": ("torque", 1.0),
}
"""Heads of a CSV file's columns: the key that they become, and its unit in the column's."""


class Table(Part):
    """A quantity over time or over angle, row by row.

    Attributes:
        time: instants [s], ascending; before the first and after the last the quantity stays as there.
        angle: forward angle turned since the start [rad], ascending over a whole number of revolutions, after which
            the table begins anew; the last row repeats the first row's quantity.
        shaft: sprocket whose revolutions `angle` counts, in the ratio of teeth; None is the sprocket itself.
        interpolation: "linear", or "cubic": a monotone cubic, smooth and never beyond its neighboring rows.
        factor: the quantity is multiplied by it.
    """

    time: Column | None = None
    angle: Column | None = None
    shaft: Name | None = None
    interpolation: Interpolation = "linear"
    factor: Factor = 1.0

    _quantity: ClassVar[str] = ""

    @property
    def over(self) -> tuple[float, ...]:
        """The column of times or angles."""
        column = self.time if self.time is not None else self.angle
        assert column is not None  # the table's own rule
        return column

    @property
    def values(self) -> tuple[float, ...]:
        """The column of the quantity, multiplied by the factor."""
        return tuple(self.factor * value for value in getattr(self, self._quantity))

    @property
    def revolutions(self) -> int:
        """Revolutions that the angles span."""
        return round((self.over[-1] - self.over[0]) / (2.0 * math.pi))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        given = [key for key in ("time", "angle") if get(node, key) is not None]
        if get(node, "file") is not None:
            text = "is read by load_drive alone; give the columns themselves, such as time and " + cls._quantity
            yield Problem(("file",), get(node, "file"), text)
            return
        if not given:
            yield Problem(("time",), None, "missing; must be a list of numbers, or give angle or file instead", BARE)
        if len(given) == 2:
            yield Problem(("angle",), get(node, "angle"), "not together with time; give one of the two")
        if get(node, "shaft") is not None and given == ["time"]:
            yield Problem(("shaft",), get(node, "shaft"), "only together with angle")
        values = elements(node, cls._quantity)
        for key in given:
            over = elements(node, key)
            if len(over) > MOST_ROWS:
                yield Problem((key,), None, f"has {len(over)} elements; must have at most {MOST_ROWS}", BARE)
                return
            if not (numbers(*over) and numbers(*values)) or len(over) < 2:
                return
            if len(values) != len(over):
                yield Problem((cls._quantity,), list(values), f"must have as many elements as {key}, {len(over)}")
            for i in range(1, len(over)):
                if over[i] <= over[i - 1]:
                    yield Problem((key, i), over[i], f"must be above the element before, {over[i - 1]:g}")
                    return
            if key == "angle" and len(values) == len(over):
                yield from _closing(over, values, cls._quantity)


def _closing(over: Any, values: Any, quantity: str) -> Iterator[Problem]:
    turns = (over[-1] - over[0]) / (2.0 * math.pi)
    last = len(over) - 1
    if round(turns) < 1 or abs(turns - round(turns)) > TURN_TOLERANCE:
        text = f"must be a whole number of revolutions after the first, {over[0]:g} rad; it is {turns:.4g} after it"
        yield Problem(("angle", last), over[last], text)
    elif values[last] != values[0]:
        text = f"must repeat the first element, {values[0]:g}, where the next revolution begins"
        yield Problem((quantity, last), values[last], text)


class SpeedTable(Table):
    """Forward angular speed over time or over the angle turned (see `Table`).

    Attributes:
        speed: forward speed [rad/s], at least 0; over angle above 0.
    """

    speed: Column

    _quantity: ClassVar[str] = "speed"

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        yield from super()._rules(node)
        strict = get(node, "angle") is not None
        for i, value in enumerate(elements(node, "speed")):
            if numbers(value) and (value < 0.0 or (strict and value == 0.0)):
                yield Problem(("speed", i), value, "must be above 0 over angle" if strict else "must be at least 0")
        factor = get(node, "factor")
        if numbers(factor) and factor <= 0.0:
            yield Problem(("factor",), factor, "must be a positive number")


class TorqueTable(Table):
    """Torque against forward rotation over time or over the angle turned (see `Table`).

    Attributes:
        torque: moment against forward rotation [N m].
    """

    torque: Column

    _quantity: ClassVar[str] = "torque"


# --------------------------------------------------------------------------------------------------------- files


def read_csv(path: Path) -> dict[str, list[float]]:
    """The two columns of a CSV file by key, in SI units; a head, then numbers; blank lines and lines from # on pass.

    Raises:
        DriveError: in one line, with the row's number in the file.
    """
    rows = csv_rows(path)
    if not rows:
        raise DriveError("has no rows; the first must name the columns, such as time,torque")
    number, head = rows[0]
    known = [HEADS.get(cell, ("", 0.0)) for cell in head]
    if len(known) != 2 or [key in ("time", "angle") for key, _ in known] != [True, False] or not known[1][0]:
        raise DriveError(
            f"row {number}: {value_text(','.join(head))} is no head of two columns; the first must be time, angle or "
            f"angle_deg, the second speed, speed_rpm or torque"
        )
    columns: dict[str, list[float]] = {key: [] for key, _ in known}
    for number, row in rows[1:]:
        if len(row) != 2:
            raise DriveError(f"row {number}: has {len(row)} cells; must have 2, separated by a comma")
        for (key, unit), cell in zip(known, row, strict=True):
            columns[key].append(unit * read_number(cell, number))
        over = columns[known[0][0]]
        if len(over) > 1 and over[-1] <= over[-2]:
            raise DriveError(f"row {number}: {head[0]} = {row[0]} must be above that of the row before")
    if len(rows) < 3:
        raise DriveError(f"has {len(rows) - 1} rows of numbers; must have at least 2")
    return columns


def csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """The cells of a CSV file's rows and their numbers in the file; blank lines and lines from # on pass.

    Raises:
        DriveError: if it cannot be read, in one line.
    """
    lines = read_text(path, "CSV", DriveError).splitlines()
    return [
        (number, _cells(line, number))
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]


def _cells(line: str, row: int) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:  # a cell of more than 131,072 characters, say
        raise DriveError(f"row {row}: is not CSV ({error})") from None


def read_number(cell: str, row: int) -> float:
    """A cell's finite number.

    Raises:
        DriveError: if it is none, with the row.
    """
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DriveError(f"row {row}: {value_text(cell)} is not a finite number")
    return value
