"""Text of a changed drive that keeps its drive file's words."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.drive import toml as drive_toml
from warpchain.drive.csv_files import values_with_files
from warpchain.drive.drive import drive_values, dumps_drive, loads_drive, read_drive_text
from warpchain.drive.quantities import QUANTITY
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.drive.drive import Drive

DIGITS, ALL = 9, 17
"""Significant digits of a changed number, and for every bit."""
LONGEST = 200_000
"""Most characters of a text that is edited."""
PASSES = 3
"""Most edits of a text, as values change others."""


def self_contained_text(path: Path) -> str:
    """Text of a drive file with its files read in.

    Raises:
        DriveError: a file cannot be read.
    """
    import tomlkit

    text = read_drive_text(path)
    values = drive_toml.parse_toml(text, str(path))
    whole = values_with_files(copy.deepcopy(values), path.parent, str(path))
    if whole == values:
        return text
    drive = loads_drive(text, str(path), path.parent)
    if len(drive_toml.toml_text({"drive": whole})) > LONGEST:
        return dumps_drive(drive)
    document = tomlkit.parse(text)
    _write_differences(document, values, whole, ALL)
    return _text_if_equal(tomlkit.dumps(document), drive) or dumps_drive(drive)


def drive_text(text: str, drive: Drive) -> str:
    """Text of a changed drive that keeps a drive file's words.

    Args:
        text: of a file that names no other files.

    Returns:
        Text of `drive` within `DIGITS`; `dumps_drive`'s where `text` cannot be edited.
    """
    edited = text
    for _ in range(PASSES if len(text) <= LONGEST else 0):
        if found := _text_if_equal(edited, drive):
            return found
        try:
            edited = text_with_changes(edited, loads_drive(edited), drive, comments=False)
        except DriveError:
            break
    return _text_if_equal(edited, drive) or dumps_drive(drive)


def text_with_changes(text: str, before: Drive, after: Drive, digits: int = DIGITS, comments: bool = True) -> str:
    """Text of a drive file with differences of `after` from `before`.

    Args:
        digits: significant digits of changed numbers.
        comments: whether changed lines keep theirs.
    """
    import tomlkit

    document = tomlkit.parse(text)
    _write_differences(document, drive_values(before), drive_values(after), digits, comments)
    return tomlkit.dumps(document)


def _text_if_equal(text: str, drive: Drive) -> str | None:
    """Text that reads back as a drive within `DIGITS`, else None."""
    try:
        return text if _is_near(drive_values(loads_drive(text)), drive_values(drive)) else None
    except DriveError:
        return None


def _is_near(one: Any, other: Any) -> bool:
    """Whether two drives' values agree within the written digits."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_is_near(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_is_near, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=10.0 ** (1 - DIGITS))
    return bool(one == other)


def _write_differences(node: Any, before: Any, after: Any, digits: int, comments: bool = True) -> None:
    """Writes differences of two drives' values into a tomlkit table."""
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
        elif _has_one_shape(there, old, new):
            _write_differences(there, old, new, digits, comments)
        else:
            node[key] = tomlkit.value(_new_value_text(there, old, new, digits))
        if new is not None and not comments and isinstance(node, Mapping):
            _drop_comment(node, key)


def _drop_comment(node: Any, key: str) -> None:
    """Drops the comment behind a value of a tomlkit table."""
    from tomlkit.container import Container
    from tomlkit.items import AoT, Item, Table

    container = node if isinstance(node, Container) else getattr(node, "value", None)
    item = container.item(key) if isinstance(container, Container) else None  # None in a table in several places
    if isinstance(item, Item) and not isinstance(item, AoT | Table):
        item.trivia.comment = item.trivia.comment_ws = ""


def _has_one_shape(*values: Any) -> bool:
    """Whether all values are tables, or lists of one length."""
    if all(isinstance(value, Mapping) for value in values):
        return True
    return all(isinstance(value, list | tuple) for value in values) and len(set(map(len, values))) == 1


def _new_value_text(there: Any, old: Any, new: Any, digits: int) -> str:
    """A new value as TOML, in the old one's unit."""
    quantity = QUANTITY.fullmatch(there) if isinstance(there, str) else None
    if quantity and old and isinstance(old, int | float) and isinstance(new, int | float):
        return drive_toml.inline_value(f"{new * (float(quantity[1]) / old):.{min(digits, 15)}g} {quantity[2]}")
    return drive_toml.inline_value(new, lambda value: repr(float(f"{value:.{digits}g}")))
