"""Text tables and DXF files that a drive file names, read into its values."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from warpchain.drive.file_columns import FILE_KEYS, LIFT_KEYS, OWN_KEY, columns_of, read_columns, read_points
from warpchain.drive.motion_table import ClutchTable, MotorTable, PlaceTable, SpeedTable, SupplyTable, TorqueTable
from warpchain.drive.own_loads import own_columns
from warpchain.drive.schema import Part, node_list, node_value
from warpchain.drive.toml import value_text
from warpchain.drive.valves import LiftTable
from warpchain.errors import DriveError, drive_error

TABLES: dict[tuple[str, ...], dict[str, type[Part]]] = {
    ("sprockets", "shafts"): {
        "prescribed.table": SpeedTable, "load.table": TorqueTable, "motor.table": MotorTable, "mount.table": PlaceTable
    },
    ("couplings",): {"clutch.table": ClutchTable},
    ("arms",): {"pivot_table": PlaceTable},
    ("tensioners",): {"oil.supply_table": SupplyTable},
    ("valves",): {"table": LiftTable},
}  # fmt: skip
"""Tables that may name a file, by the drive's lists and keys."""


_OWNER = {OWN_KEY: "the load", "file": "the file"}


def has_own_load(kind: type[Part]) -> bool:
    """Whether tables of a kind may name a plug-in's load."""
    return getattr(kind, "_quantity", "") == "torque"


def values_with_files(values: dict[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """A drive file's values with contents of files that it names.

    Args:
        folder: of relative file names.
        source: drive file's name in errors.

    Raises:
        DriveError: one line for each unreadable or wrong file.
    """
    problems = [*_read_tables(values, folder), *_read_profiles(values, folder), *_read_teeth(values, folder)]
    if problems:
        raise drive_error(problems, source)
    return values


def _read_tables(values: dict[str, Any], folder: Path) -> list[str]:
    """Reads CSV files and plug-ins' loads into `values`; returns error lines."""
    problems: list[str] = []
    for holder, key, kind, where in _named_tables(values):
        table = node_value(holder, key)
        source = OWN_KEY if OWN_KEY in table else "file"
        place = f"{where}.{source} = {value_text(table[source])}"
        try:
            if source == OWN_KEY:
                columns = own_columns(table[source], kind._axes)  # type: ignore[attr-defined]
            else:
                columns = read_columns(_path_inside(folder, table["file"]), table, columns_of(kind), kind is LiftTable)
        except DriveError as error:
            problems += [f"{place}: {line}" for line in error.errors]
            continue
        for column in columns.keys() & table.keys():
            problems.append(f"{place}: not together with {column}; {_OWNER[source]} has that column")
        kept = {name: value for name, value in table.items() if name not in {*FILE_KEYS, *LIFT_KEYS, OWN_KEY}}
        holder[key] = kept | columns
    return problems


def _named_tables(values: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, type[Part], str]]:
    """Tables that name a file or plug-in's load: owner, key, kind, path."""
    for lists, kinds in TABLES.items():
        for parts in lists:
            for i, part in enumerate(node_list(values, parts)):
                for path, kind in kinds.items():
                    *outer, key = path.split(".")
                    holder = node_value(part, outer[0]) if outer else part
                    table = node_value(holder, key)
                    if not (isinstance(holder, dict) and isinstance(table, dict)):
                        continue
                    if isinstance(table.get("file"), str) or (OWN_KEY in table and has_own_load(kind)):
                        yield holder, key, kind, f"{parts}.{_part_label(part, i)}.{path}"


def dxf_name(file: str) -> tuple[str, str | None] | None:
    """File and layer of FILE.dxf or FILE.dxf#LAYER, or None."""
    path, mark, layer = file.partition("#")
    return (path, layer if mark else None) if path.lower().endswith(".dxf") else None


def _drawn_unit(holder: Any, key: str, is_drawing: bool) -> str | None:
    """Unit of a drawing, taken out of a part's values.

    Raises:
        DriveError: it is no unit, or there is no drawing.
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
    """Reads guides' profile files into `values`; returns error lines."""
    problems: list[str] = []
    for i, guide in enumerate(node_list(values, "guides")):
        file = node_value(guide, "profile")
        if isinstance(file, dict) and isinstance(file.get("file"), str):
            try:
                guide["profile"] = read_points(_path_inside(folder, file["file"]), file)
            except DriveError as error:
                where = f"guides.{_part_label(guide, i)}.profile.file = {value_text(file['file'])}"
                problems += [f"{where}: {line}" for line in error.errors]
        if isinstance(file, str):
            drawing = dxf_name(file)
            try:
                unit = _drawn_unit(guide, "profile_unit", drawing is not None)
                if drawing is None:
                    guide["profile"] = read_points(_path_inside(folder, file), {})
                else:
                    from warpchain.drive.dxf_files import read_face

                    guide["profile"] = read_face(_path_inside(folder, drawing[0]), drawing[1], unit)
            except DriveError as error:
                where = f"guides.{_part_label(guide, i)}.profile = {value_text(file)}"
                problems += [f"{where}: {line}" for line in error.errors]
    return problems


def _read_teeth(values: dict[str, Any], folder: Path) -> list[str]:
    """Reads sprockets' drawings into `values`; returns error lines."""
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
    """Path of a file in a folder or below it.

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
    """Name or number of a drive's part in error lines."""
    name = node_value(part, "name")
    return name if isinstance(name, str) else str(i)
