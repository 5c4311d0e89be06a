"""Drives of a kind as one drive whose numbers are arrays over the variants.

Drives are of a kind where they have the same parts, names and whole numbers, and are alike in what decides about the
way of a calculation: which values are given, and which are 0. A stack of them is a drive like any other but that
numbers in which they differ are arrays (V,); what all share is a plain number. What is calculated from a drive's values
by the functions of `warpchain.drive.batch_math` then gives all of them at once, a drive alone being a stack of one.

Guides that are no straight bars on the ground are the same in all drives of a stack, and so are what their faces hang
on and the pivots of arms. Links may be unlike, those of each variant in their own way: how many are worn is of the
kind, which ones and by how much is not, not even by nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.arms import Arm
from warpchain.drive.batch_math import many
from warpchain.drive.chain import Chain, NamedChain, WornLink
from warpchain.drive.drive import Drive
from warpchain.drive.motion_table import TABLES
from warpchain.drive.schema import Part
from warpchain.drive.shafts import Ratios
from warpchain.drive.valves import LiftProfile, LiftTable, Valves
from warpchain.errors import DriveError

Value = TypeVar("Value")

_TABLES = (*TABLES, LiftTable)
_PLAIN = frozenset((float, int, str, bool, type(None)))

_OF_FACES: set[tuple[type, str]] = {(Drive, "guides"), (Arm, "pivot")}
_OF_FACES |= {(kind, name) for kind in (Chain, NamedChain) for name in ("pitch", "roller_radius")}
"""The numbers that guides' faces hang on."""

_OF_LIFTS = {(LiftProfile, "rise"), (LiftProfile, "dwell"), (LiftProfile, "fall"), (Valves, "phases")}
"""The numbers that tables of lifts, and the places of cams, hang on."""

_FREE = {WornLink}
"""Parts, of numbers, whole ones among them, that decide nothing, and so may be 0 in some of a stack only."""

_APART = {"seating", "perturbation", "temperature", "expansion"}
"""Settings that a stack's variants may have of their own, as they are in other numbers already."""

LARGEST = 4096
"""Most variants of a stack: more are several, so that what is worked on stays in the processor's caches."""


@dataclass(frozen=True)
class Stack:
    """Drives of a kind.

    Attributes:
        members: (V,) their numbers among all drives, ascending.
        drive: all of them as one; of a single one, the drive itself.
    """

    members: NDArray[np.int64]
    drive: Drive


def stacks_of(drives: Sequence[Drive], largest: int = LARGEST) -> list[Stack]:
    """Drives sorted into stacks of at most `largest`, in the order of their first members."""
    bent = np.array(_bent(drives), dtype=bool)
    several = np.array([bool(drive.chains) for drive in drives])
    ways = ((faces, chains) for faces in (False, True) for chains in (False, True))
    groups = [(np.flatnonzero((bent == faces) & (several == chains)), faces) for faces, chains in ways]
    kinds = [stack for members, faces in groups if len(members) for stack in _kinds(drives, members, faces)]
    found = (part for stack in kinds for part in stack_parts(stack, largest))
    return sorted(found, key=lambda stack: int(stack.members[0]))


def stack_parts(stack: Stack, largest: int = LARGEST) -> Iterator[Stack]:
    """A stack as stacks of at most `largest` variants, one after the other."""
    count = len(stack.members)
    for part in (slice(begin, begin + largest) for begin in range(0, count, largest)):
        yield stack if count <= largest else Stack(stack.members[part], picked(stack.drive, part))


def stack_among(stack: Stack, chosen: NDArray[np.bool_]) -> Stack:
    """Those of a stack's variants that are chosen, (V,) of all drives, numbered among the chosen ones."""
    places = np.flatnonzero(chosen[stack.members])
    numbers = np.cumsum(chosen) - 1
    whole = len(places) == len(stack.members)
    drive = stack.drive if whole or not len(places) else picked(stack.drive, places)
    return Stack(numbers[stack.members[places]], drive)


def _kinds(drives: Sequence[Drive], members: NDArray[np.int64], faces: bool) -> Iterator[Stack]:
    """A stack of each kind of some drives: as if they were of one; then, where they are not, of each."""
    columns = _Columns(faces)
    drive = columns.of([drives[v] for v in members.tolist()])
    if not columns.kinds and many(drive.run.phase) and _turns_tables(drive):
        columns.kinds.append([drives[v].run.phase for v in members.tolist()])
    if not columns.kinds:
        yield Stack(members, drive)
        return
    kinds: dict[Hashable, list[int]] = {}
    for v, key in zip(members.tolist(), zip(*columns.kinds, strict=True), strict=True):
        kinds.setdefault(key, []).append(v)
    for alike in kinds.values():
        yield from _kinds(drives, np.array(alike, dtype=np.int64), faces)


def _turns_tables(drive: Drive) -> bool:
    """Whether tables of a drive move on by its phase."""
    kinds = ("prescribed", "load", "motor")
    motions = (getattr(part, kind, None) for part in (*drive.sprockets, *drive.shafts) for kind in kinds)
    return any(motion is not None and motion.table is not None for motion in motions)


def _bent(drives: Sequence[Drive]) -> list[bool]:
    """Which drives have guides that are no straight bars on the ground, arms, or tensioners."""
    fields = [drive.__dict__ for drive in drives]
    faces = {id(guide): guide for of in fields for guide in of["guides"]}
    bars = {key for key, guide in faces.items() if guide.straight and guide.arm is None}
    straight = len(bars) == len(faces)
    return [
        bool(of["arms"] or of["tensioners"] or not (straight or all(id(guide) in bars for guide in of["guides"])))
        for of in fields
    ]


class _Columns:
    """Puts parts or values together, column by column.

    Args:
        faces: whether what guides' faces hang on must be the same within a kind. Which numbers are 0 always must, but
            for those of worn links.

    Attributes:
        kinds: columns of values that differ among kinds; without any, all were of one.
    """

    def __init__(self, faces: bool) -> None:
        self.exact, self.faces = False, faces
        self.kinds: list[Sequence[Hashable]] = []

    def of(self, values: Sequence[Any]) -> Any:
        """All of them as one; of several kinds, anything."""
        first = values[0]
        if isinstance(first, Part | tuple):
            if first is values[-1] and len(set(map(id, values))) == 1:
                return first
        elif first != 0.0 and values.count(first) == len(values):  # not 0, which has two signs
            return first
        types = set(map(type, values))
        if types == {float}:
            return self._numbers(values)
        if len(types) > 1 or not isinstance(first, tuple | Part) or isinstance(first, (*_TABLES, Ratios)):
            known = [_mark(value) for value in values]
            return first if len(set(known)) == 1 else self._differ(known)
        if isinstance(first, tuple):
            if len(set(map(len, values))) > 1:
                return self._differ([len(value) for value in values])
            if first and type(first[0]) in _FREE:
                return _free(values)
            return _same(first, tuple(map(self.of, zip(*values, strict=True))))
        changed = self._fields(first, [value.__dict__ for value in values])
        return first.model_copy(update=changed) if changed else first

    def _fields(self, first: Part, fields: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """The fields that differ from the first part's, but for those that are no part of a stack."""
        exact, columns, kind = self.exact, {}, type(first)
        for name in fields[0]:
            if name not in _APART:
                self.exact = exact or (self.faces and (kind, name) in _OF_FACES) or (kind, name) in _OF_LIFTS
                columns[name] = self.of(list(map(itemgetter(name), fields)))
        self.exact = exact
        return {name: value for name, value in columns.items() if value is not first.__dict__[name]}

    def _numbers(self, values: Sequence[float]) -> float | NDArray[np.float64]:
        column = np.array(values)
        bits = column.view(np.int64)
        if (bits == bits[0]).all():
            return values[0]
        zero = column == 0.0
        if self.exact or (zero.any() and not zero.all()):
            self._differ(bits.tolist() if self.exact else zero.tolist())
        return column

    def _differ(self, kinds: Sequence[Hashable]) -> None:
        self.kinds.append(kinds)


def _free(values: Sequence[tuple[Part, ...]]) -> tuple[Part, ...]:
    """As many parts of numbers that decide nothing of each variant as those of a stack: all are arrays, or none."""
    first, fields = values[0], [part.__dict__ for parts in values for part in parts]
    tables = {}
    for name in fields[0]:
        table = np.array(list(map(itemgetter(name), fields))).reshape(len(values), len(first))
        tables[name] = table.T.copy()
    if all((bits == bits[:, :1]).all() for bits in (table.view(np.int64) for table in tables.values())):
        return first
    return tuple(
        part.model_copy(update={name: table[i] for name, table in tables.items()}) for i, part in enumerate(first)
    )


def _mark(value: Any) -> Hashable:
    """A key that distinguishes a value of several types, or one that is no number, from others."""
    if isinstance(value, _TABLES):
        return id(value)  # long ones are slow to compare
    if isinstance(value, Ratios):
        return value
    return type(value).__name__ if isinstance(value, tuple | Part | float) else (value, "")  # no text is a type's name


def stacked(values: Sequence[Value]) -> Value:
    """Drives or parts of a kind as one."""
    found: Value = _Columns(faces=False).of(values)
    return found


def picked(value: Value, places: Any) -> Value:
    """Some variants of a stack, or of a part of one, as a stack; `places` is an index of arrays (V,).

    A single one is a drive alone, of plain numbers.
    """
    if isinstance(value, np.ndarray):
        found = value[places]
        return found if found.size > 1 else found.item()
    if isinstance(value, tuple):
        return _same(value, tuple(picked(inner, places) for inner in value))  # type: ignore[return-value]
    if is_dataclass(value) and not isinstance(value, type):
        found = {field.name: picked(getattr(value, field.name), places) for field in fields(value)}
        return replace(value, **found)
    if not isinstance(value, Part) or isinstance(value, _TABLES):
        return value
    new = {name: picked(inner, places) for name, inner in value.__dict__.items()}
    changed = {name: inner for name, inner in new.items() if inner is not value.__dict__[name]}
    return value.model_copy(update=changed) if changed else value


def _same(old: tuple[Any, ...], new: tuple[Any, ...]) -> tuple[Any, ...]:
    """The old one, where nothing of it has changed."""
    return old if all(a is b for a, b in zip(old, new, strict=True)) else new


def size_of(drive: Drive) -> int:
    """Number of variants of a stack; 1 where they do not differ."""
    todo: list[Iterable[Any]] = [drive.__dict__.values()]
    while todo:
        for value in todo.pop():
            kind = type(value)
            if kind in _PLAIN or issubclass(kind, _TABLES):
                continue
            if kind is np.ndarray:
                return len(value)
            todo.append(value if kind is tuple else value.__dict__.values())
    return 1


def arrays_of(value: Any) -> Iterator[NDArray[np.float64]]:
    """All arrays of a stack, or of parts of one."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for inner in value:
            yield from arrays_of(inner)
    elif isinstance(value, Part) and not isinstance(value, _TABLES):
        yield from arrays_of(tuple(value.__dict__.values()))


def first_refused(stack: Stack, attempt: Callable[[Drive], object]) -> tuple[int, DriveError]:
    """The first variant of a stack that is refused, and why, by halving.

    Args:
        stack: of which some are refused.
        attempt: raises a DriveError for a stack of which any is refused.
    """
    begin, end = 0, len(stack.members)

    def refusal(end: int) -> DriveError | None:
        try:
            attempt(picked(stack.drive, slice(begin, end)))
        except DriveError as error:
            return error
        return None

    while end - begin > 1:
        middle = (begin + end) // 2
        begin, end = (begin, middle) if refusal(middle) is not None else (middle, end)
    error = refusal(end)
    assert error is not None  # as one of them is refused
    return int(stack.members[begin]), error


def first_of(refused: Sequence[tuple[int, DriveError]], numbers: NDArray[np.int64] | None = None) -> DriveError:
    """The error to raise of refused variants: that of the first, which it names.

    Args:
        refused: variants and errors.
        numbers: what all variants are called; None counts them from 0.
    """
    v, error = min(refused, key=lambda pair: pair[0])
    return DriveError(f"variant {v if numbers is None else int(numbers[v])}: {error}")
