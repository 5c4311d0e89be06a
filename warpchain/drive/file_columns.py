"""Columns of the text tables that a drive file names, units, and lifts for a whole turn."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from warpchain.drive.motion_table import MOST_ROWS, TURN_TOLERANCE, PlaceTable
from warpchain.drive.quantities import equivalent_units, unit_factor, unit_from_text
from warpchain.drive.text_table import Head, TableError, TextTable, column_place, options_as_keys, read_text_table
from warpchain.drive.toml import value_text
from warpchain.drive.valves import LiftTable
from warpchain.errors import DriveError


class FileColumns(NamedTuple):
    """The columns that a text table of a drive may have.

    Attributes:
        over: keys of which it has one, ascending.
        of: keys of which it has one at least.
        needs_all: whether it needs all of them.
    """

    over: tuple[str, ...]
    of: tuple[str, ...]
    needs_all: bool = False

    def __str__(self) -> str:
        of = (" and " if self.needs_all else " or ").join(self.of)
        return f"{of} over {' or '.join(self.over)}" if self.over else of


COLUMN_UNITS = {
    "time": "s", "angle": "rad", "speed": "rad/s", "torque": "N m", "pressure": "Pa", "lift": "m", "x": "m", "y": "m"
}  # fmt: skip
"""Units of a text table's columns by key."""
FILE_KEYS = {
    "file": "file with the columns, such as CSV, in the drive file's folder or below it",
    "columns": "names, or numbers such as #3, of the file's columns, by the keys that they stand for",
    "units": "units of the file's columns, by the keys that they stand for; default what their heads say",
    "decimal": "sign before decimals in the file, a point or a comma; default the one that all its numbers have",
    "head": "line of the names in the file; default the one above the numbers",
}
"""Keys that say how a text table is read, with descriptions."""
OWN_KEY = "own"
"""Key of a drive file that names a plug-in's load."""
LIFT_KEYS = {
    "event": "true: the file has the lift while it is open, and it rests for the rest of the turn; false: it repeats",
    "crank_turns": "turns of the crank for one of the cams, where the file has degrees of the crank: 2 of four strokes",
}
"""Further keys for a table of valve lifts."""
_CRANK = re.compile(r"crank|kurbel|\b(CA|KW|CAD|CRK)\b|°(CA|KW|CRK)|deg(CA|KW|CRK)", re.IGNORECASE)
POINTS = FileColumns((), ("x", "y"), needs_all=True)


def columns_of(kind: type) -> FileColumns:
    """Columns that a kind of part's text table may have."""
    if issubclass(kind, PlaceTable):
        return FileColumns(("time",), ("x", "y"))
    if issubclass(kind, LiftTable):
        return FileColumns(("angle",), ("lift",))
    return FileColumns(kind._axes, (kind._quantity,))  # type: ignore[attr-defined]


def read_columns(
    path: Path, table: Mapping[str, Any], allowed: FileColumns, is_lift: bool = False
) -> dict[str, list[float]]:
    """Columns of a text table by key, in SI units.

    Args:
        table: keys of `FILE_KEYS`, of a lift also of `LIFT_KEYS`.

    Raises:
        DriveError: names the file's line.
    """
    _check_file_keys(table, allowed, is_lift)
    names = {key: str(name) for key, name in (table.get("columns") or {}).items()}
    known = {*allowed.over, *allowed.of, *(name.lower() for name in names.values())}
    try:
        found = read_text_table(path, table.get("decimal"), table.get("head"), known)
        places = _named_column_places(found, names, allowed) if names else _column_places(found, allowed)
        units = table.get("units") or {}
        for key in units.keys() - places.keys():
            raise TableError(f"units.{key} = {value_text(units[key])}: the file has no {key}")
        columns = {key: _si_column(found, key, k, units) for key, k in places.items()}
        _check_rows(found, columns, places, allowed)
    except TableError as error:
        raise DriveError(options_as_keys(str(error))) from None
    if is_lift:
        said = f"{found.heads[places['angle']]} {units.get('angle', '')}".strip()
        _turn_to_cam(columns, table.get("crank_turns"), said)
        _close_lift(columns, table.get("event"))
    return columns


def _check_file_keys(table: Mapping[str, Any], allowed: FileColumns, is_lift: bool) -> None:
    """Raises a DriveError for wrong keys beside a text table's `file`."""
    keys = (*allowed.over, *allowed.of)
    for key in ("columns", "units"):
        given = table.get(key, {})
        if not isinstance(given, dict) or any(k not in keys or not isinstance(v, str) for k, v in given.items()):
            example = "{ " + ", ".join(f'{k} = "{"#2" if key == "columns" else COLUMN_UNITS[k]}"' for k in keys) + " }"
            raise DriveError(f"{key} = {value_text(given)}: must be a table of texts, such as {example}")
    rules = {
        "decimal": (table.get("decimal") in (None, ".", ","), 'must be "." or ","'),
        "head": (_is_count(table.get("head", 1)), "must be the number of a line, 1 or more"),
        "event": (isinstance(table.get("event", True), bool), "must be true or false"),
        "crank_turns": (_is_count(table.get("crank_turns", 1)), "must be a whole number of at least 1"),
    }
    for key, (is_right, text) in rules.items():
        if key in table and key in LIFT_KEYS and not is_lift:
            raise DriveError(f"{key} = {value_text(table[key])}: only of valves; leave it out")
        if not is_right:
            raise DriveError(f"{key} = {value_text(table[key])}: {text}")


def _is_count(value: Any) -> bool:
    """Whether a value counts lines or turns, from 1."""
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_ROWS


def _named_column_places(found: TextTable, names: dict[str, str], allowed: FileColumns) -> dict[str, int]:
    """Indices of columns that a drive file names, by key."""
    _check_column_keys(list(names), allowed, "columns: ")
    places = {key: column_place(found.names, name, 0, "columns") for key, name in names.items()}
    for key, k in places.items():
        if list(places.values()).count(k) > 1:
            raise TableError(f"columns.{key} = {value_text(names[key])}: must be a column of its own")
    return places


def _column_places(found: TextTable, allowed: FileColumns) -> dict[str, int]:
    """Indices of a text table's columns by key, by name or unit.

    Raises:
        TableError: no or two columns for a key.
    """
    keys = (*allowed.over, *allowed.of)
    found_keys = [_key_of_head(head, keys) for head in found.heads]
    places = {key: found_keys.index(key) for key in found_keys if key}
    over = [key for key in allowed.over if key in places][:1] or list(allowed.over[:1])
    named = {
        key: found.heads[places[key]].name if key in places else f"#{i + 1}"
        for i, key in enumerate((*over, *allowed.of))
    }
    example = "say which count, as in columns = { " + ", ".join(f'{key} = "{of}"' for key, of in named.items()) + " }"
    for k, (key, head) in enumerate(zip(found_keys, found.heads, strict=True)):
        column = f"line {found.line}: column #{k + 1}, {value_text(str(head)) if head.name else 'without a name'},"
        if not key:
            nor = ", nor is its unit" if head.unit and unit_from_text(head.unit) is None else ""
            raise TableError(f"{column} is not known{nor}; must be {allowed}; {example}")
        if places[key] != k:
            both = f"columns #{places[key] + 1}, {found.heads[places[key]]}, and #{k + 1}, {head}, are both {key}"
            raise TableError(f"line {found.line}: {both}; {example}")
    _check_column_keys(list(places), allowed, f"line {found.line}: ")
    return places


def _key_of_head(head: Head, keys: tuple[str, ...]) -> str:
    """Key that a column's name or unit means, or ""."""
    if head.name.lower() in keys:
        return head.name.lower()
    alike = [key for key in keys if unit_factor(head.unit, COLUMN_UNITS[key]) is not None]
    return alike[0] if len(alike) == 1 else ""


def _check_column_keys(keys: list[str], allowed: FileColumns, where: str) -> None:
    """Raises a TableError for a text table's wrong or missing columns."""
    over = [key for key in keys if key in allowed.over]
    of = [key for key in keys if key in allowed.of]
    if len(over) != min(len(allowed.over), 1) or not of or (allowed.needs_all and len(of) < len(allowed.of)):
        raise TableError(f"{where}has {', '.join(keys)}; must be {allowed}, no more and no less")


def _si_column(found: TextTable, key: str, k: int, units: Mapping[str, str]) -> list[float]:
    """Numbers of a text table's column in SI units."""
    head = found.heads[k]
    word = units.get(key) or head.unit or (COLUMN_UNITS[key] if head.name.lower() == key else "")
    if not word:
        raise TableError(f'line {found.line}: column "{head}" has no unit; give it, as in units = {{ {key} = '
                         f'"{COLUMN_UNITS[key]}" }}')  # fmt: skip
    scale = unit_factor(word, COLUMN_UNITS[key])
    if scale is None:
        fit = ", ".join(equivalent_units(COLUMN_UNITS[key]))
        raise TableError(f'line {found.line}: column "{head}" is in {value_text(word)}; {key} must be in one of {fit}')
    column = found.numbers(k)
    for row, value in zip(found.rows, column, strict=True):
        if math.isnan(value):
            raise TableError(f'line {row.line}: column "{head}" has no number; each line must have one')
    return [scale * value for value in column]


def _check_rows(
    found: TextTable, columns: dict[str, list[float]], places: dict[str, int], allowed: FileColumns
) -> None:
    """Raises a TableError for a text table's wrong rows."""
    rows = found.rows
    if not 2 <= len(rows) <= MOST_ROWS:
        raise TableError(f"has {len(rows)} rows of numbers; must have 2 to {MOST_ROWS}")
    for key, k in places.items():
        for before, after, row in zip(columns[key], columns[key][1:], rows[1:], strict=False):
            if key in allowed.over and after <= before:
                raise TableError(
                    f"line {row.line}: {found.heads[k]} = {row.cells[k]} must be above that of the row before"
                )
    if not allowed.over:
        points = list(zip(*columns.values(), strict=True))
        for here, there, row in zip(points, points[1:], rows[1:], strict=False):
            if here == there:
                text = ", ".join(row.cells[k] for k in places.values())
                raise TableError(f"line {row.line}: {text} must be another point than that of the row before")


def read_points(path: Path, table: Mapping[str, Any]) -> list[list[float]]:
    """Points of a guide face in a text table [m]."""
    columns = read_columns(path, table, POINTS)
    return [list(point) for point in zip(columns["x"], columns["y"], strict=True)]


# --------------------------------------------------------------------------------------------------------- lifts


def _turn_to_cam(columns: dict[str, list[float]], crank_turns: int | None, head: str) -> None:
    """Turns a lift's crank angles into cam angles."""
    if crank_turns is None and _CRANK.search(head):
        raise DriveError(
            f"{value_text(head)} counts degrees of the crank; give crank_turns, its turns for one of the cams"
        )
    columns["angle"] = [angle / (crank_turns or 1) for angle in columns["angle"]]


def _close_lift(columns: dict[str, list[float]], event: bool | None) -> None:
    """Closes a valve lift by zeros over the turn."""
    angle, lift = columns["angle"], columns["lift"]
    span, turn = angle[-1] - angle[0], 2.0 * math.pi
    if event is False or abs(span / turn - 1.0) <= TURN_TOLERANCE:
        if event:
            raise DriveError("event = true: the file has a whole turn; leave it out")
        return
    spans = f"angle spans {math.degrees(span):.6g} degrees of the cams' shaft"
    if span > turn:
        raise DriveError(f"{spans}, more than a turn; give crank_turns if it counts degrees of the crank")
    if event is None:
        text = "give event = true if the lift then rests, or event = false if it repeats"
        raise DriveError(f"{spans}, less than a turn; {text}")
    if lift[-1] != lift[0]:
        raise DriveError(
            f"event = true: the last lift, {lift[-1]:g} m, must be the first, {lift[0]:g} m, where it rests"
        )
    rest = max(1, round((turn - span) / (angle[-1] - angle[-2])))
    if len(angle) + rest > MOST_ROWS:
        raise DriveError(f"event = true: with rows for the rest of the turn there are more than {MOST_ROWS}")
    angle += [angle[-1] + (turn - span) * k / rest for k in range(1, rest + 1)]
    lift += [lift[0]] * rest
