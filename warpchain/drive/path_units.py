"""Units of values at key paths of drives, from the docstrings of parts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, get_args, get_origin

from warpchain.drive.quantities import unit_of_key
from warpchain.drive.schema import Part


@cache
def path_unit(kind: type[Part], path: str) -> str:
    """Unit of the value at a part's key path, or ""."""
    kinds, owners, key, is_listed = {kind}, {kind}, "", False
    for word in path.split("."):
        if is_listed:  # the name or place of one of several parts
            is_listed = False
            continue
        found = {(owner, owner._renamed.get(word, word)) for owner in kinds}
        found = {(owner, name) for owner, name in found if name in owner.model_fields}
        if not found:
            if kinds or not word.isdigit():
                return ""
            continue  # an element of a list of numbers
        owners, key = {owner for owner, _ in found}, next(iter(found))[1]
        shapes = [owner.model_fields[name].annotation for owner, name in found]
        kinds = {part for shape in shapes for part, _ in _field_parts(shape)}
        is_listed = any(listed for shape in shapes for _, listed in _field_parts(shape))
    units = {unit_of_key(owner, key) for owner in owners}
    return units.pop() if len(units) == 1 and not kinds else ""


def _field_parts(shape: Any, listed: bool = False) -> Iterator[tuple[type[Part], bool]]:
    """Parts that a field may hold, and whether listed."""
    if isinstance(shape, type) and issubclass(shape, Part):
        yield shape, listed
        return
    for inner in get_args(shape):
        yield from _field_parts(inner, listed or get_origin(shape) is tuple)
