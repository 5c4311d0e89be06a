"""Stacks: drives alike as one whose numbers are arrays over its variants.

Alike are parts, names, whole numbers, given values and zeros, bent faces, and arms' pivots.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from operator import itemgetter
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.arms import Arm
from warpchain.drive.chain import Chain, NamedChain, WornLink
from warpchain.drive.drive import Drive
from warpchain.drive.motion_table import TABLES
from warpchain.drive.schema import Part
from warpchain.drive.shafts import Ratios
from warpchain.drive.stack_math import UnlikeVariants, has_arrays
from warpchain.drive.valves import LiftProfile, LiftTable, Valves
from warpchain.errors import DriveError
from warpchain.model.chain_model import ChainModel

StackedValue = TypeVar("StackedValue")
Of = TypeVar("Of", bound=Drive | ChainModel)
"""Drives or chain models."""

_MODEL_NAMES = tuple(field.name for field in fields(ChainModel))
_WHOLE_TABLES = (*TABLES, LiftTable)
_PLAIN_TYPES = frozenset((float, int, str, bool, type(None)))

_FACE_NUMBERS: set[tuple[type, str]] = {(Drive, "guides"), (ChainModel, "guides"), (Arm, "pivot")}
_FACE_NUMBERS |= {(kind, name) for kind in (Chain, NamedChain) for name in ("pitch", "roller_radius")}
"""The numbers that guides' faces depend on, by class and key."""

_LIFT_NUMBERS = {(LiftProfile, "rise"), (LiftProfile, "dwell"), (LiftProfile, "fall"), (Valves, "phases")}
"""Numbers of valve lifts equal in a stack."""

_FREE_PARTS = {WornLink}
"""Parts whose numbers may be 0 in some variants."""

_UNSTACKED_SETTINGS = {"seating", "perturbation", "temperature", "expansion", "places"}
"""Settings that may differ in a stack, their effect in other numbers."""

LARGEST_STACK = 4096


@dataclass(frozen=True)
class Stack(Generic[Of]):
    """Drives, or chain models, alike, as one.

    Attributes:
        members: (V,) numbers of the variants, ascending.
        one: all of them.
    """

    members: NDArray[np.int64]
    one: Of


def stacks_of_drives(drives: Sequence[Of], largest: int = LARGEST_STACK) -> list[Stack[Of]]:
    """Stacks of drives or chain models, by first members."""
    bent = np.array(_bent_drives(drives), dtype=bool)
    counts = np.array([len(getattr(drive, "chains", ())) for drive in drives])
    ways = ((faces, count) for faces in (False, True) for count in np.unique(counts))
    groups = [(np.flatnonzero((bent == faces) & (counts == count)), faces) for faces, count in ways]
    kinds = [stack for members, faces in groups if len(members) for stack in _stacks_by_kind(drives, members, faces)]
    found = (part for stack in kinds for part in split_stack(stack, largest))
    return sorted(found, key=lambda stack: int(stack.members[0]))


def split_stack(stack: Stack[Of], largest: int = LARGEST_STACK) -> Iterator[Stack[Of]]:
    """Parts of a stack, of at most `largest` variants."""
    count = len(stack.members)
    for part in (slice(begin, begin + largest) for begin in range(0, count, largest)):
        yield stack if count <= largest else Stack(stack.members[part], pick_variants(stack.one, part))


def stack_of_chosen(stack: Stack[Of], chosen: NDArray[np.bool_]) -> Stack[Of]:
    """Stack of the chosen variants (V,), renumbered."""
    places = np.flatnonzero(chosen[stack.members])
    numbers = np.cumsum(chosen) - 1
    whole = len(places) == len(stack.members)
    one = stack.one if whole or not len(places) else pick_variants(stack.one, places)
    return Stack(numbers[stack.members[places]], one)


def _stacks_by_kind(drives: Sequence[Of], members: NDArray[np.int64], faces: bool) -> Iterator[Stack[Of]]:
    """Stacks of some drives, one of each kind."""
    columns = _ColumnStacker(faces)
    drive = columns.stack_column([drives[v] for v in members.tolist()])
    if not columns.kinds and has_arrays(drive.run.phase) and _has_phased_tables(drive):
        columns.kinds.append([drives[v].run.phase for v in members.tolist()])
    if not columns.kinds:
        yield Stack(members, drive)
        return
    kinds: dict[Hashable, list[int]] = {}
    for v, key in zip(members.tolist(), zip(*columns.kinds, strict=True), strict=True):
        kinds.setdefault(key, []).append(v)
    for alike in kinds.values():
        yield from _stacks_by_kind(drives, np.array(alike, dtype=np.int64), faces)


def _has_phased_tables(drive: Drive | ChainModel) -> bool:
    """Whether a drive has tables that its phase moves."""
    kinds = ("prescribed", "load", "motor")
    motions = (getattr(part, kind, None) for part in (*drive.sprockets, *drive.shafts) for kind in kinds)
    return any(motion is not None and motion.table is not None for motion in motions)


def _bent_drives(drives: Sequence[Drive | ChainModel]) -> list[bool]:
    """Whether each drive has arms, tensioners or bent guides."""
    fields = [drive.__dict__ for drive in drives]
    faces = {id(guide): guide for of in fields for guide in of["guides"]}
    bars = {key for key, guide in faces.items() if guide.straight and guide.arm is None}
    straight = len(bars) == len(faces)
    return [
        bool(of["arms"] or of["tensioners"] or not (straight or all(id(guide) in bars for guide in of["guides"])))
        for of in fields
    ]


class _ColumnStacker:
    """Stacker of parts or values of drives, column by column.

    Args:
        faces: whether guides' faces must be the same.

    Attributes:
        kinds: columns that differ.
    """

    def __init__(self, faces: bool) -> None:
        self.exact, self.faces = False, faces
        self.kinds: list[Sequence[Hashable]] = []

    def stack_column(self, values: Sequence[Any]) -> Any:
        """Values of several drives as one, differing numbers as arrays."""
        first = values[0]
        if isinstance(first, Part | ChainModel | tuple):
            if first is values[-1] and len(set(map(id, values))) == 1:
                return first
        elif first != 0.0 and values.count(first) == len(values):  # not 0, which has two signs
            return first
        types = set(map(type, values))
        if types == {float}:
            return self._stack_numbers(values)
        if (
            len(types) > 1
            or not isinstance(first, tuple | Part | ChainModel)
            or isinstance(first, (*_WHOLE_TABLES, Ratios))
        ):
            known = [_kind_key(value) for value in values]
            return first if len(set(known)) == 1 else self._note_difference(known)
        if isinstance(first, tuple):
            if len(set(map(len, values))) > 1:
                return self._note_difference([len(value) for value in values])
            if first and type(first[0]) in _FREE_PARTS:
                return _stack_free_parts(values)
            return _tuple_if_changed(first, tuple(map(self.stack_column, zip(*values, strict=True))))
        changed = self._stack_fields(first, [value.__dict__ for value in values])
        return _changed_copy(first, changed)

    def _stack_fields(self, first: Part | ChainModel, fields: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Stacked fields of parts that differ from the first's."""
        exact, columns, kind = self.exact, {}, type(first)
        names = [name for name in _given_names(first) if name not in _UNSTACKED_SETTINGS]
        rows = map(itemgetter(*names), fields)  # all at once, which takes half the time of name by name
        for name, values in zip(names, zip(*rows, strict=True) if len(names) > 1 else [tuple(rows)], strict=True):
            self.exact = exact or (self.faces and (kind, name) in _FACE_NUMBERS) or (kind, name) in _LIFT_NUMBERS
            columns[name] = self.stack_column(values)
        self.exact = exact
        return {name: value for name, value in columns.items() if value is not first.__dict__[name]}

    def _stack_numbers(self, values: Sequence[float]) -> float | NDArray[np.float64]:
        """Stacked numbers: one if equal, else an array (V,)."""
        column = np.array(values)
        bits = column.view(np.int64)
        if (bits == bits[0]).all():
            return values[0]
        zero = column == 0.0
        if self.exact or (zero.any() and not zero.all()):
            self._note_difference(bits.tolist() if self.exact else zero.tolist())
        return column

    def _note_difference(self, kinds: Sequence[Hashable]) -> None:
        """Notes by what a stack's variants (V,) differ."""
        self.kinds.append(kinds)


def _stack_free_parts(values: Sequence[tuple[Part, ...]]) -> tuple[Part, ...]:
    """Stacked free parts, with all numbers arrays or none."""
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


def _kind_key(value: Any) -> Hashable:
    """Hashable key of a stacked value's kind."""
    if isinstance(value, _WHOLE_TABLES):
        return id(value)  # long ones are slow to compare
    if isinstance(value, Ratios):
        return value
    return (
        type(value).__name__ if isinstance(value, tuple | Part | ChainModel | float) else (value, "")
    )  # no text is a type's name


def stack_of_values(values: Sequence[StackedValue]) -> StackedValue:
    """Stack of drives or parts alike, unequal numbers as arrays (V,)."""
    found: StackedValue = _ColumnStacker(faces=False).stack_column(values)
    return found


def pick_variants(value: StackedValue, places: Any) -> StackedValue:
    """Chosen variants of a stack or its part, by index; a single one is plain."""
    if isinstance(value, np.ndarray):
        found = value[places]
        return found if found.size > 1 else found.item()
    if isinstance(value, tuple):
        return _tuple_if_changed(value, tuple(pick_variants(inner, places) for inner in value))  # type: ignore[return-value]
    if is_dataclass(value) and not isinstance(value, type | ChainModel):
        found = {field.name: pick_variants(getattr(value, field.name), places) for field in fields(value)}
        return replace(value, **found)
    if not isinstance(value, Part | ChainModel) or isinstance(value, _WHOLE_TABLES):
        return value
    new = {name: pick_variants(value.__dict__[name], places) for name in _given_names(value)}
    changed = {name: inner for name, inner in new.items() if inner is not value.__dict__[name]}
    return _changed_copy(value, changed)


def _given_names(value: Part | ChainModel) -> Iterable[str]:
    """Names of a part's or chain model's values, without those that a model has computed of them."""
    return _MODEL_NAMES if isinstance(value, ChainModel) else value.__dict__


def _changed_copy(value: Any, changed: Mapping[str, Any]) -> Any:
    """Changed copy of a stacked part or model, itself without changes."""
    if not changed:
        return value
    return replace(value, **changed) if isinstance(value, ChainModel) else value.model_copy(update=changed)


def variants_of_either(chosen: NDArray[np.bool_], one: Any, other: Any) -> Any:
    """Stack of one stack's variants where `chosen` (V,), else another's.

    Raises:
        UnlikeVariants: they differ in more than numbers.
    """
    if has_arrays(one, other):
        rows = np.shape(other) if np.ndim(other) else np.shape(one)
        return np.where(chosen.reshape(-1, *(1 for _ in rows[1:])), one, other)
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return tuple(variants_of_either(chosen, *pair) for pair in zip(one, other, strict=True))
    if is_dataclass(one) and is_dataclass(other) and not isinstance(one, type):
        pairs = {of.name: (getattr(one, of.name), getattr(other, of.name)) for of in fields(one)}
        return replace(one, **{name: variants_of_either(chosen, *pair) for name, pair in pairs.items()})
    if one != other:
        raise UnlikeVariants(chosen)
    return one


def _tuple_if_changed(old: tuple[Any, ...], new: tuple[Any, ...]) -> tuple[Any, ...]:
    """The new tuple of stacked items, or the old equal one."""
    return old if all(a is b for a, b in zip(old, new, strict=True)) else new


def variant_count(drive: Drive | ChainModel) -> int:
    """Number of variants of a stack; 1 without arrays."""
    todo: list[Iterable[Any]] = [[drive.__dict__[name] for name in _given_names(drive)]]
    while todo:
        for value in todo.pop():
            kind = type(value)
            if kind in _PLAIN_TYPES or kind is dict or issubclass(kind, _WHOLE_TABLES):
                continue
            if kind is np.ndarray:
                return len(value)
            todo.append(value if kind is tuple else value.__dict__.values())
    return 1


def stack_arrays(value: Any) -> Iterator[NDArray[np.float64]]:
    """Arrays of a stack or of its parts."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for inner in value:
            yield from stack_arrays(inner)
    elif isinstance(value, Part | ChainModel) and not isinstance(value, _WHOLE_TABLES):
        yield from stack_arrays(tuple(value.__dict__[name] for name in _given_names(value)))


def first_refused_variant(stack: Stack[Of], attempt: Callable[[Of], object]) -> tuple[int, DriveError]:
    """First variant of a stack that `attempt` refuses, and its DriveError."""
    begin, end = 0, len(stack.members)

    def refusal(end: int) -> DriveError | None:
        """Error of the variants from `begin` to `end`, or None."""
        try:
            attempt(pick_variants(stack.one, slice(begin, end)))
        except DriveError as error:
            return error
        return None

    while end - begin > 1:
        middle = (begin + end) // 2
        begin, end = (begin, middle) if refusal(middle) is not None else (middle, end)
    error = refusal(end)
    assert error is not None  # as one of them is refused
    return int(stack.members[begin]), error


def first_refusal(refused: Sequence[tuple[int, DriveError]], numbers: NDArray[np.int64] | None = None) -> DriveError:
    """Error of a stack's first refused variant, which it names.

    Args:
        numbers: of all variants; None counts from 0.
    """
    v, error = min(refused, key=lambda pair: pair[0])
    return DriveError(f"variant {v if numbers is None else int(numbers[v])}: {error}")
