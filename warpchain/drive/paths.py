"""Values of a part by key path: read, listed, and changed in a checked copy.

A key path joins keys by dots; an element of a list is named by its own `name` or counted from 0:
"sprockets.camshaft.load.harmonics.0.amplitude".
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar, get_args

from warpchain.drive.schema import Part, get, is_name, nearest
from warpchain.drive.toml import word_text
from warpchain.errors import DriveError, drive_error

PartType = TypeVar("PartType", bound=Part)


class _UnknownPath(Exception):
    """Signals a key path that leads nowhere; args: how many of its keys are known, the keys that could follow."""


@cache
def _inside(cls: type[Part]) -> Mapping[str, type[Part]]:
    """The fields of a part that hold parts, or lists of parts, and of which class; a union gives its first class."""

    def search(source: Any) -> Iterator[type[Part]]:
        if isinstance(source, type) and issubclass(source, Part):
            yield source
        for inner in get_args(source):
            yield from search(inner)

    found = {key: next(search(field.annotation), None) for key, field in cls.model_fields.items()}
    return {key: part for key, part in found.items() if part is not None}


def _class_of(cls: type[Part], key: str, value: Any) -> type[Part] | None:
    """The class of the part under a key, or of a list's element: its own if there is one, else the declared."""
    return type(value) if isinstance(value, Part) else _inside(cls).get(key)


def index_of(elements: Sequence[Any], key: str, depth: int) -> int:
    """Which element of a list a word of a path, the one at `depth`, means.

    Raises:
        _UnknownPath: if there is none.
    """
    for i, element in enumerate(elements):
        if get(element, "name") == key:
            return i
    if key.isascii() and key.isdigit() and len(key) < 10 and int(key) < len(elements):
        return int(key)
    raise _UnknownPath(depth, _words(elements))


def _words(elements: Sequence[Any]) -> list[str]:
    """The names of a list's elements in a path."""
    names = [get(element, "name") for element in elements]
    return [name if is_name(name) else str(i) for i, name in enumerate(names)]


# ----------------------------------------------------------------------------------------------------------- read


def lookup(part: Part, path: str) -> Any:
    """The value at a key path; None if it is optional and not given.

    Raises:
        DriveError: for an unknown path.
    """
    try:
        return _follow(part, type(part), path.split("."), 0)
    except _UnknownPath as unknown:
        raise drive_error([_unknown_line(part, path, *unknown.args)]) from None


def _follow(value: Any, cls: type[Part] | None, keys: Sequence[str], depth: int) -> Any:
    """The value that the keys from `depth` on lead to, from a part (or the class of an absent one) or from a list.

    Raises:
        _UnknownPath: if they lead nowhere.
    """
    if depth == len(keys):
        return value
    key = keys[depth]
    if isinstance(value, tuple):
        element = value[index_of(value, key, depth)]
        return _follow(element, type(element) if isinstance(element, Part) else None, keys, depth + 1)
    key = key if cls is None else cls._renamed.get(key, key)
    if cls is None or key not in cls.model_fields:
        raise _UnknownPath(depth, list(cls.model_fields) if cls else [])
    inner = get(value, key)
    return _follow(inner, None if inner is None and _is_list(cls, key) else _class_of(cls, key, inner), keys, depth + 1)


# ----------------------------------------------------------------------------------------------------------- list


def settable(part: Part) -> Iterator[str]:
    """Every key path that can be set, in the order of the file."""
    yield from _paths(type(part), part, "")


def _paths(cls: type[Part], part: Part | None, above: str) -> Iterator[str]:
    for key in cls.model_fields:
        path, value = above + key, get(part, key)
        yield path
        if isinstance(value, tuple):
            for word, element in zip(_words(value), value, strict=True):
                yield f"{path}.{word}"
                if isinstance(element, Part):
                    yield from _paths(type(element), element, f"{path}.{word}.")
        elif not _is_list(cls, key) and (inner := _class_of(cls, key, value)) is not None:
            yield from _paths(inner, value, path + ".")


@cache
def _is_list(cls: type[Part], key: str) -> bool:
    """True for a field that is a list, such as harmonics."""
    return isinstance(cls.model_fields[key].default, tuple)


# --------------------------------------------------------------------------------------------------------- change


class _Table(dict[str, Any]):
    """A part taken apart to be changed, its class, and which of its keys were set."""

    def __init__(self, cls: type[Part], values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.cls = cls
        self.assigned: set[str] = set()

    def put(self, key: str, value: Any) -> None:
        """Sets a key, or takes it away if the value is None.

        What stands for the same thing gives way, unless it was set in the same call; to an empty list nothing does.
        """
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


class _List(list[Any]):
    """A list taken apart to be changed, and the class of its elements."""

    def __init__(self, cls: type[Part] | None, values: Iterable[Any]) -> None:
        super().__init__(values)
        self.cls = cls


def changed(part: PartType, values: Mapping[str, Any]) -> PartType:
    """A changed copy, checked as a whole; what does not change is shared.

    Raises:
        DriveError: for unknown paths and for values that are not allowed; one line each.
    """
    tree = _Table(type(part), part.__dict__)
    unknown = {}
    for path, value in values.items():
        try:
            _assign(tree, path.split("."), 0, native(value))
        except _UnknownPath as error:
            unknown[path] = _unknown_line(part, path, *error.args)
    if unknown:  # the errors of the known paths, too
        lines = list(unknown.values())
        try:
            changed(part, {path: value for path, value in values.items() if path not in unknown})
        except DriveError as error:
            lines.extend(error.errors)
        raise drive_error(lines)
    return type(part)(**tree)


def native(value: Any) -> Any:
    """A numpy scalar as Python's own number, so that a study may hand over what it draws."""
    return value.item() if type(value).__module__ == "numpy" and getattr(value, "ndim", 1) == 0 else value


def _assign(node: Any, keys: Sequence[str], depth: int, value: Any) -> None:
    """Sets the value to which the keys from `depth` on lead, taking the parts on their way apart.

    Raises:
        _UnknownPath: if they lead nowhere.
    """
    key, last = keys[depth], depth == len(keys) - 1
    if isinstance(node, _List):
        place = index_of(node, key, depth)
        if not last:
            node[place] = _opened(node[place], node.cls)
        else:
            node[place] = value
            return
        _assign(node[place], keys, depth + 1, value)
        return
    if isinstance(node, _Table):
        key = node.cls._renamed.get(key, key)
    if not isinstance(node, _Table) or key not in node.cls.model_fields:
        raise _UnknownPath(depth, list(node.cls.model_fields) if isinstance(node, _Table) else [])
    if last:
        node.put(key, value)
        return
    child = node.get(key)
    inner = _class_of(node.cls, key, child)
    if child is None and value is None:  # nothing to take away; but there must be a place for it
        _follow(None, inner, keys, depth + 1)
        return
    opened = _opened(child, inner)
    if child is None:
        node.put(key, opened)  # a new table replaces what stands for the same thing
    else:
        node[key] = opened
    _assign(opened, keys, depth + 1, value)


def _opened(node: Any, cls: type[Part] | None) -> Any:
    """A part or list as one that can be changed; an absent optional table as an empty one."""
    if isinstance(node, (_Table, _List)):
        return node
    if isinstance(node, Part):
        return _Table(type(node), node.__dict__)
    if isinstance(node, (tuple, list)):
        return _List(cls, node)
    if cls is not None and (node is None or isinstance(node, Mapping)):
        return _Table(cls, node or {})
    return node


def _unknown_line(part: Part, path: str, depth: int, allowed: Iterable[str]) -> str:
    """The error line of an unknown path: the nearest that there is, else what could stand where it goes wrong."""
    close = difflib.get_close_matches(path, list(settable(part)), n=1, cutoff=0.8)
    if close:
        return f"{word_text(path)}: unknown path; did you mean {close[0]}?"
    shown, keys = word_text(path), path.split(".")
    words = list(allowed)
    above = ".".join(keys[:depth])
    if not words:
        return f"{shown}: unknown path; {above} has no keys"
    hint = nearest(keys[depth], words)
    if hint.startswith("did"):
        near = ".".join([*keys[:depth], hint.removeprefix("did you mean ").rstrip("?")])
        return f"{shown}: unknown path; did you mean {near}?"
    return f"{shown}: unknown path; {hint}" + (f" under {above}" if above else "")
