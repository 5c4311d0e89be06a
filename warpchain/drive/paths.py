"""Values of a drive's part by key path: read, listed, and changed in a checked copy.

A path joins keys by dots, list elements by name or index.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar, get_args

from warpchain.drive.schema import Part, is_name, nearest_key_text, node_value
from warpchain.drive.toml import key_text
from warpchain.errors import DriveError, drive_error

PartType = TypeVar("PartType", bound=Part)


class _UnknownPath(Exception):
    """Raised for an unknown key path; args: known keys, keys that could follow."""


@cache
def _part_fields(cls: type[Part]) -> Mapping[str, type[Part]]:
    """Fields of a part that hold parts, with their class."""

    def search(source: Any) -> Iterator[type[Part]]:
        """Parts that an annotation names."""
        if isinstance(source, type) and issubclass(source, Part):
            yield source
        for inner in get_args(source):
            yield from search(inner)

    found = {key: next(search(field.annotation), None) for key, field in cls.model_fields.items()}
    return {key: part for key, part in found.items() if part is not None}


def _part_class(cls: type[Part], key: str, value: Any) -> type[Part] | None:
    """Class of the part under a key or in its list."""
    return type(value) if isinstance(value, Part) else _part_fields(cls).get(key)


def element_index(elements: Sequence[Any], key: str, depth: int) -> int:
    """Index of a list element by name or index.

    Raises:
        _UnknownPath: none.
    """
    for i, element in enumerate(elements):
        if node_value(element, "name") == key:
            return i
    if key.isascii() and key.isdigit() and len(key) < 10 and int(key) < len(elements):
        return int(key)
    raise _UnknownPath(depth, _element_names(elements))


def _element_names(elements: Sequence[Any]) -> list[str]:
    """Names of a list's elements in a key path."""
    names = [node_value(element, "name") for element in elements]
    return [name if is_name(name) else str(i) for i, name in enumerate(names)]


# ----------------------------------------------------------------------------------------------------------- read


def value_at_path(part: Part, path: str) -> Any:
    """Value of a part at a key path, or None.

    Raises:
        DriveError: an unknown path.
    """
    try:
        return _value_below(part, type(part), path.split("."), 0)
    except _UnknownPath as unknown:
        raise drive_error([_unknown_line(part, path, *unknown.args)]) from None


def _value_below(value: Any, cls: type[Part] | None, keys: Sequence[str], depth: int) -> Any:
    """Value at a key path's keys from `depth` on.

    Raises:
        _UnknownPath: none.
    """
    if depth == len(keys):
        return value
    key = keys[depth]
    if isinstance(value, tuple):
        element = value[element_index(value, key, depth)]
        return _value_below(element, type(element) if isinstance(element, Part) else None, keys, depth + 1)
    key = key if cls is None else cls._renamed.get(key, key)
    if cls is None or key not in cls.model_fields:
        raise _UnknownPath(depth, list(cls.model_fields) if cls else [])
    inner = node_value(value, key)
    return _value_below(
        inner, None if inner is None and _is_list_field(cls, key) else _part_class(cls, key, inner), keys, depth + 1
    )


# ----------------------------------------------------------------------------------------------------------- list


def settable_paths(part: Part) -> Iterator[str]:
    """Key paths of a part that can be set."""
    yield from _settable_below(type(part), part, "")


def _settable_below(cls: type[Part], part: Part | None, above: str) -> Iterator[str]:
    """Key paths below `above` of a part or class of parts."""
    for key in cls.model_fields:
        path, value = above + key, node_value(part, key)
        yield path
        if isinstance(value, tuple):
            for word, element in zip(_element_names(value), value, strict=True):
                yield f"{path}.{word}"
                if isinstance(element, Part):
                    yield from _settable_below(type(element), element, f"{path}.{word}.")
        elif not _is_list_field(cls, key) and (inner := _part_class(cls, key, value)) is not None:
            yield from _settable_below(inner, value, path + ".")


@cache
def _is_list_field(cls: type[Part], key: str) -> bool:
    """Whether a part's field is a list."""
    return isinstance(cls.model_fields[key].default, tuple)


# --------------------------------------------------------------------------------------------------------- change


class _EditableTable(dict[str, Any]):
    """Values of a part to be changed, and the keys set."""

    def __init__(self, cls: type[Part], values: Mapping[str, Any]) -> None:
        unsaid = cls._unsaid_values(values)
        super().__init__({key: value for key, value in values.items() if key not in unsaid or value != unsaid[key]})
        self.cls = cls
        self.assigned: set[str] = set()

    def set_key(self, key: str, value: Any) -> None:
        """Sets a part's key, or removes it for None; other keys for the same go."""
        if value is None:
            self.pop(key, None)
            return
        self[key] = value
        self.assigned.add(key)
        if isinstance(value, list | tuple) and not value:
            return
        for other in self.cls._replaces.get(key, ()):
            if other not in self.assigned:
                self.pop(other, None)


class _EditableList(list[Any]):
    """Elements of a list to be changed, and their class."""

    def __init__(self, cls: type[Part] | None, values: Iterable[Any]) -> None:
        super().__init__(values)
        self.cls = cls


def changed_part(part: PartType, values: Mapping[str, Any]) -> PartType:
    """Changed copy of a part, checked as a whole.

    Raises:
        DriveError: one line for each unknown path or wrong value.
    """
    tree = _EditableTable(type(part), part.__dict__)
    unknown = {}
    for path, value in values.items():
        try:
            _set_at_path(tree, path.split("."), 0, python_number(value))
        except _UnknownPath as error:
            unknown[path] = _unknown_line(part, path, *error.args)
    if unknown:  # the errors of the known paths, too
        lines = list(unknown.values())
        try:
            changed_part(part, {path: value for path, value in values.items() if path not in unknown})
        except DriveError as error:
            lines.extend(error.errors)
        raise drive_error(lines)
    return type(part)(**tree)


def python_number(value: Any) -> Any:
    """A number of numpy as Python's; other values stay."""
    return value.item() if type(value).__module__ == "numpy" and getattr(value, "ndim", 1) == 0 else value


def _set_at_path(node: Any, keys: Sequence[str], depth: int, value: Any) -> None:
    """Sets the value at a key path's keys from `depth` on.

    Raises:
        _UnknownPath: none.
    """
    key, last = keys[depth], depth == len(keys) - 1
    if isinstance(node, _EditableList):
        place = element_index(node, key, depth)
        if not last:
            node[place] = _editable_node(node[place], node.cls)
        else:
            node[place] = value
            return
        _set_at_path(node[place], keys, depth + 1, value)
        return
    if isinstance(node, _EditableTable):
        key = node.cls._renamed.get(key, key)
    if not isinstance(node, _EditableTable) or key not in node.cls.model_fields:
        raise _UnknownPath(depth, list(node.cls.model_fields) if isinstance(node, _EditableTable) else [])
    if last:
        node.set_key(key, value)
        return
    child = node.get(key)
    inner = _part_class(node.cls, key, child)
    if child is None and value is None:  # nothing to take away; but there must be a place for it
        _value_below(None, inner, keys, depth + 1)
        return
    opened = _editable_node(child, inner)
    if child is None:
        node.set_key(key, opened)  # a new table replaces what stands for the same thing
    else:
        node[key] = opened
    _set_at_path(opened, keys, depth + 1, value)


def _editable_node(node: Any, cls: type[Part] | None) -> Any:
    """Editable form of a part or list for key paths."""
    if isinstance(node, (_EditableTable, _EditableList)):
        return node
    if isinstance(node, Part):
        return _EditableTable(type(node), node.__dict__)
    if isinstance(node, (tuple, list)):
        return _EditableList(cls, node)
    if cls is not None and (node is None or isinstance(node, Mapping)):
        return _EditableTable(cls, node or {})
    return node


def _unknown_line(part: Part, path: str, depth: int, allowed: Iterable[str]) -> str:
    """Error line of an unknown key path, with the nearest keys."""
    close = difflib.get_close_matches(path, list(settable_paths(part)), n=1, cutoff=0.8)
    if close:
        return f"{key_text(path)}: unknown path; did you mean {close[0]}?"
    shown, keys = key_text(path), path.split(".")
    words = list(allowed)
    above = ".".join(keys[:depth])
    if not words:
        return f"{shown}: unknown path; {above} has no keys"
    hint = nearest_key_text(keys[depth], words)
    if hint.startswith("did"):
        near = ".".join([*keys[:depth], hint.removeprefix("did you mean ").rstrip("?")])
        return f"{shown}: unknown path; did you mean {near}?"
    return f"{shown}: unknown path; {hint}" + (f" under {above}" if above else "")
