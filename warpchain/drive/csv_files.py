"""Reads the CSV and DXF files that a drive file names into its values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from warpchain.drive.motion_table import csv_rows, read_csv, read_number
from warpchain.drive.schema import node_list, node_value
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, drive_error

UNITS = {"x,y": 1.0, "x_mm,y_mm": 1e-3}
"""Heads of a CSV file of points, and their unit in meters."""


def values_with_files(values: dict[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """A drive file's values with the contents of the files that its tables, guides and sprockets name.

    Args:
        folder: where relative file names begin.
        source: the drive file's name in error lines.

    Raises:
        DriveError: one line for each file that cannot be read or is wrong, with the file and the row.
    """
    problems = [*_read_tables(values, folder), *_read_profiles(values, folder), *_read_teeth(values, folder)]
    if problems:
        raise drive_error(problems, source)
    return values


def _read_tables(values: dict[str, Any], folder: Path) -> list[str]:
    """Reads the CSV files of tables into `values`; returns error lines."""
    problems: list[str] = []
    kinds = ("sprockets", "shafts", "couplings", "arms", "tensioners", "valves")
    named = [(kind, i, part) for kind in kinds for i, part in enumerate(node_list(values, kind))]
    for kind, i, part in named:
        holding = ("prescribed", "load", "motor", "clutch", "mount")
        holders = [(f".{key}.table", node_value(part, key), "table") for key in holding]
        holders += [
            (".pivot_table", part, "pivot_table"),
            (".oil.supply_table", node_value(part, "oil"), "supply_table"),
        ]
        holders += [(".table", part, "table")]
        for keys, holder, key in holders:
            table = node_value(holder, key)
            if not isinstance(table, dict) or not isinstance(table.get("file"), str):
                continue
            where = f"{kind}.{_part_label(part, i)}{keys}.file = {value_text(table['file'])}"
            try:
                columns = read_csv(_path_inside(folder, table["file"]), places=keys in (".mount.table", ".pivot_table"))
            except DriveError as error:
                problems += [f"{where}: {line}" for line in error.errors]
                continue
            for column in columns.keys() & table.keys():
                problems.append(f"{where}: not together with {column}; the file has that column")
            holder[key] = {column: value for column, value in table.items() if column != "file"} | columns
    return problems


def dxf_name(file: str) -> tuple[str, str | None] | None:
    """File and layer of a word FILE.dxf or FILE.dxf#LAYER; None of other words."""
    path, mark, layer = file.partition("#")
    return (path, layer if mark else None) if path.lower().endswith(".dxf") else None


def _drawn_unit(holder: Any, key: str, is_drawing: bool) -> str | None:
    """The unit that a guide or sprocket says of its drawing, taken out of its values.

    Raises:
        DriveError: it is no unit of drawings, or there is no drawing.
    """
    from warpchain.drive.dxf_files import LENGTHS

    if node_value(holder, key) is None:
        return None
    unit = holder.pop(key)
    if not is_drawing:
        raise DriveError(f"{key} = {value_text(unit)}: only together with the name of a DXF file")
    if not isinstance(unit, str) or unit not in LENGTHS:
        raise DriveError(f"{key} = {value_text(unit)}: must be one of {', '.join(LENGTHS)}")
    return unit


def _read_profiles(values: dict[str, Any], folder: Path) -> list[str]:
    """Reads the files of guides' profiles into `values`; returns error lines."""
    problems: list[str] = []
    for i, guide in enumerate(node_list(values, "guides")):
        file = node_value(guide, "profile")
        if isinstance(file, str):
            drawing = dxf_name(file)
            try:
                unit = _drawn_unit(guide, "profile_unit", drawing is not None)
                if drawing is None:
                    guide["profile"] = read_points(_path_inside(folder, file))
                else:
                    from warpchain.drive.dxf_files import read_face

                    guide["profile"] = read_face(_path_inside(folder, drawing[0]), drawing[1], unit)
            except DriveError as error:
                where = f"guides.{_part_label(guide, i)}.profile = {value_text(file)}"
                problems += [f"{where}: {line}" for line in error.errors]
    return problems


def _read_teeth(values: dict[str, Any], folder: Path) -> list[str]:
    """Reads the drawings of sprockets into `values`, and their pitch where the file gives none; returns error lines."""
    problems: list[str] = []
    for i, sprocket in enumerate(node_list(values, "sprockets")):
        file, teeth = node_value(sprocket, "tooth"), node_value(sprocket, "teeth")
        if not isinstance(file, str) or not isinstance(teeth, int):
            continue
        where, drawing = f"sprockets.{_part_label(sprocket, i)}.tooth = {value_text(file)}", dxf_name(file)
        if drawing is None:
            problems.append(f"{where}: must be a file FILE.dxf, or FILE.dxf#LAYER, or a table")
            continue
        from warpchain.drive.dxf_files import read_teeth

        try:
            unit = _drawn_unit(sprocket, "tooth_unit", True)
            found = read_teeth(_path_inside(folder, drawing[0]), drawing[1], teeth, unit)
        except DriveError as error:
            problems += [f"{where}: {line}" for line in error.errors]
            continue
        pitch = found.pop("pitch")
        sprocket["tooth"] = {key: value for key, value in found.items() if value is not None}
        sprocket.setdefault("pitch", pitch)
    return problems


def _path_inside(folder: Path, file: str) -> Path:
    """The path of a file in a folder or below it.

    Raises:
        DriveError: it is elsewhere, also by a link.
    """
    try:
        if (folder / file).resolve().is_relative_to(folder.resolve()):
            return folder / file
    except (OSError, ValueError, RuntimeError):  # a zero byte, links that go round
        pass
    raise DriveError("must be a file in the drive file's folder, or below it")


def _part_label(part: Any, i: int) -> str:
    """Name or number of a part for error lines."""
    name = node_value(part, "name")
    return name if isinstance(name, str) else str(i)


def read_points(path: Path) -> list[list[float]]:
    """The points of a CSV file [m]: a head, x,y or x_mm,y_mm, then numbers; blank lines and lines from # on pass.

    Raises:
        DriveError: in one line, with the row's number in the file.
    """
    rows = csv_rows(path)
    if not rows:
        raise DriveError("has no rows; the first must name the columns, " + " or ".join(UNITS))
    number, head = rows[0]
    unit = UNITS.get(",".join(head))
    if unit is None:
        text = f"{value_text(','.join(head))} is no head of two columns"
        raise DriveError(f"row {number}: {text}; must be {' or '.join(UNITS)}")
    points: list[list[float]] = []
    for number, row in rows[1:]:
        if len(row) != 2:
            raise DriveError(f"row {number}: has {len(row)} cells; must have 2, separated by a comma")
        points.append([unit * read_number(cell, number) for cell in row])
        if len(points) > 1 and points[-1] == points[-2]:
            raise DriveError(f"row {number}: {','.join(row)} must be another point than that of the row before")
    if len(points) < 2:
        raise DriveError(f"has {len(points)} rows of numbers; must have at least 2")
    return points
