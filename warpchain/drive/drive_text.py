"""Drive files written from drive files: the text of the file a drive comes from, with what has changed since.

Comments, order, units and words such as "estimate" stay where the values do.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.drive import toml as drive_toml
from warpchain.drive.csv_files import with_files
from warpchain.drive.drive import dumps_drive, loads_drive, read_drive_text, values_of
from warpchain.drive.quantities import QUANTITY
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.drive.drive import Drive

DIGITS, ALL = 9, 17
"""Significant digits of a number that has changed, and of one whose every bit is kept."""
LONGEST = 200_000
"""Characters of a text that is edited; tomlkit takes time that grows with the square of an array's length."""
PASSES = 3
"""Most times that a text is edited: a value may stand for others that change with it, as `size` for `pitch`."""


def text_alone(path: Path) -> str:
    """A drive file's text with the files that it names read in.

    Raises:
        DriveError: a file that cannot be read.
    """
    import tomlkit

    text = read_drive_text(path)
    values = drive_toml.parse(text, str(path))
    whole = with_files(copy.deepcopy(values), path.parent, str(path))
    if whole == values:
        return text
    drive = loads_drive(text, str(path), path.parent)
    if len(drive_toml.dumps({"drive": whole})) > LONGEST:
        return dumps_drive(drive)
    document = tomlkit.parse(text)
    _merge(document, values, whole, ALL)
    return _checked(tomlkit.dumps(document), drive) or dumps_drive(drive)


def drive_text(text: str, drive: Drive) -> str:
    """The text of a drive file for a drive that differs from that file's in some values.

    What is the same keeps its words; what differs is written with `DIGITS` digits, in the unit that stood there.

    Args:
        text: of the file; it names no other files.
        drive: with values for the keys of the file.

    Returns:
        A text that reads back as `drive` within these digits; that of `dumps_drive` where none can be made of `text`.
    """
    edited = text
    for _ in range(PASSES if len(text) <= LONGEST else 0):
        if found := _checked(edited, drive):
            return found
        try:
            edited = with_changes(edited, loads_drive(edited), drive)
        except DriveError:
            break
    return _checked(edited, drive) or dumps_drive(drive)


def with_changes(text: str, before: Drive, after: Drive, digits: int = DIGITS) -> str:
    """A drive file's text with the values in which a drive differs from the file's own, all else as it is.

    Args:
        text: TOML.
        before: the drive that the file gives.
        after: the other one.
        digits: significant digits of numbers that differ.
    """
    import tomlkit

    document = tomlkit.parse(text)
    _merge(document, values_of(before), values_of(after), digits)
    return tomlkit.dumps(document)


def _checked(text: str, drive: Drive) -> str | None:
    """The text if it reads back as a drive within the digits that are written."""
    try:
        return text if _near(values_of(loads_drive(text)), values_of(drive)) else None
    except DriveError:
        return None


def _near(one: Any, other: Any) -> bool:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_near(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_near, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=10.0 ** (1 - DIGITS))
    return bool(one == other)


def _merge(node: Any, before: Any, after: Any, digits: int) -> None:
    """Sets in a table or list of tomlkit what differs between two states of its values.

    Args:
        digits: of floats that differ.
    """
    import tomlkit

    if isinstance(after, Mapping):
        pairs = [(key, before.get(key), after.get(key)) for key in {**before, **after}]
    else:
        pairs = [(i, *of) for i, of in enumerate(zip(before, after, strict=True))]
    for key, old, new in pairs:
        if old == new:
            continue
        there = node.get(key) if isinstance(node, Mapping) else node[key]
        if new is None:
            if there is not None:
                del node[key]
        elif _alike(there, old, new):
            _merge(there, old, new, digits)
        else:
            node[key] = tomlkit.value(_written(there, old, new, digits))


def _alike(*values: Any) -> bool:
    """Whether all are tables, or lists of one length."""
    if all(isinstance(value, Mapping) for value in values):
        return True
    return all(isinstance(value, list | tuple) for value in values) and len(set(map(len, values))) == 1


def _written(there: Any, old: Any, new: Any, digits: int) -> str:
    """A new value as TOML, a number in the unit that the text has for the old one."""
    quantity = QUANTITY.fullmatch(there) if isinstance(there, str) else None
    if quantity and old and isinstance(old, int | float) and isinstance(new, int | float):
        return drive_toml.inline(f"{new * (float(quantity[1]) / old):.{min(digits, 15)}g} {quantity[2]}")
    return drive_toml.inline(new, lambda value: repr(float(f"{value:.{digits}g}")))
