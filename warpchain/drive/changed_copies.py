"""Changed copies of a drive in the same numbers, only these checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import TypeAdapter, ValidationError

from warpchain.drive.paths import element_index, python_number
from warpchain.drive.schema import Part

if TYPE_CHECKING:
    from warpchain.drive.drive import Drive

PartPlace = tuple[str | int, ...]
"""Keys and list indices of a drive's value."""


class DriveChanges:
    """Maker of changed copies of a drive."""

    def __init__(self, base: Drive) -> None:
        self.base = base
        self.forms: dict[tuple[str, ...], _DriveForm | None] = {}

    def changed_drive(self, values: Mapping[str, Any]) -> Drive:
        """Copy of the drive with other values by key path, checked as `Drive.with_values`."""
        paths = tuple(values)
        if paths not in self.forms:
            found = self.base.with_values(values)
            self.forms[paths] = _form_of_paths(found, paths)
            return found
        form = self.forms[paths]
        copied = None if form is None else form.changed_copy([python_number(value) for value in values.values()])
        return self.base.with_values(values) if copied is None else copied


def drive_with_numbers(drive: Drive, numbers: Mapping[PartPlace, float]) -> Drive:
    """Copy of a drive with other numbers, checked as `Drive.with_values`, without warnings."""
    copied = _DriveForm(drive, list(numbers)).changed_copy(list(numbers.values()))
    if copied is None:
        return drive.with_values({".".join(map(str, way)): value for way, value in numbers.items()})
    return copied


class _DriveForm:
    """A drive prepared for copies with other numbers."""

    def __init__(self, drive: Drive, ways: Sequence[PartPlace]) -> None:
        tree: dict[str | int, Any] = {}
        for place, way in enumerate(ways):
            branch = tree
            for key in way[:-1]:
                branch = branch.setdefault(key, {})
            branch[way[-1]] = place
        self.change = _PartChange(drive.as_read, tree)

    def changed_copy(self, values: Sequence[Any]) -> Drive | None:
        """Copy of the drive with other numbers; None if wrong."""
        try:
            drive: Drive = self.change.changed_copy(values)
            drive.apply_temperature()
        except (ValidationError, _BrokenRule):
            return None
        return drive


class _PartChange:
    """Changer of a part: copies it with other numbers, checked.

    Args:
        tree: places of values by keys and list indices.
    """

    def __init__(self, part: Part, tree: Mapping[Any, Any]) -> None:
        kind = type(part)
        self.part, self.rules = part, kind._number_rules(tree)
        self.numbers: list[tuple[str, Any, Any, TypeAdapter[Any]]] = []
        self.parts: list[tuple[str, _PartChange]] = []
        self.lists: list[tuple[str, Sequence[Any], list[tuple[int, _PartChange]]]] = []
        for key, inner in tree.items():
            own = part.__dict__[key]
            if isinstance(own, Part):
                self.parts.append((key, _PartChange(own, inner)))
            elif isinstance(inner, dict) and isinstance(own[min(inner)], Part):
                self.lists.append((key, own, [(i, _PartChange(own[i], within)) for i, within in inner.items()]))
            else:
                self.numbers.append((key, own, inner, _field_validator(kind, key)))

    def changed_copy(self, values: Sequence[Any]) -> Any:
        """Copy of the part with other numbers.

        Raises:
            ValidationError: a wrong number.
            _BrokenRule: numbers that break a rule.
        """
        changed: dict[str, Any] = {}
        for key, own, inner, checker in self.numbers:
            changed[key] = checker.validate_python(_value_with_numbers(own, inner, values))
        for key, change in self.parts:
            changed[key] = change.changed_copy(values)
        for key, own, changes in self.lists:
            parts = list(own)
            for i, change in changes:
                parts[i] = change.changed_copy(values)
            changed[key] = tuple(parts)
        copied = self.part.model_copy(update=changed)
        for rule in self.rules:
            for _ in rule(copied):
                raise _BrokenRule
        return copied


class _BrokenRule(Exception):
    """Raised where changed numbers break a part's rule."""


def _value_with_numbers(own: Any, inner: Any, values: Sequence[Any]) -> Any:
    """A drive's number or nested tuples, with other values by `inner`."""
    if not isinstance(inner, dict):
        return values[inner]
    return tuple(_value_with_numbers(part, inner[i], values) if i in inner else part for i, part in enumerate(own))


@cache
def _field_validator(kind: type[Part], key: str) -> TypeAdapter[Any]:
    """Validator of one field of a part."""
    field = kind.model_fields[key]
    plain: Any = field.annotation
    return TypeAdapter(Annotated[plain, *field.metadata] if field.metadata else plain)


def _form_of_paths(drive: Drive, paths: Sequence[str]) -> _DriveForm | None:
    """Form of a drive for numbers at some paths, or None."""
    ways = [tuple(_place_of_path(drive, path.split("."))) for path in paths]
    ends = [_value_at_place(drive.as_read, way) for way in ways]
    if len(set(ways)) < len(ways) or not all(type(end) in (int, float) for end in ends):
        return None
    return _DriveForm(drive, ways)


def _place_of_path(node: Any, keys: Sequence[str]) -> Iterator[str | int]:
    """Keys of a path, with list indices for names."""
    for depth, key in enumerate(keys):
        step = element_index(node, key, depth) if isinstance(node, tuple) else key
        yield step
        node = node[step] if isinstance(step, int) else node.__dict__.get(step) if isinstance(node, Part) else None


def _value_at_place(node: Any, way: PartPlace) -> Any:
    """Value of a part at keys and indices, or None."""
    for step in way:
        node = node[step] if isinstance(step, int) else node.__dict__.get(step) if isinstance(node, Part) else None
    return node
