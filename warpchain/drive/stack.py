"""Drives of a kind as one drive whose numbers are arrays over the variants.

Drives are of a kind where they have the same parts, names and whole numbers, and are alike in what decides about the
way of a calculation: which values are given, and which are 0. A stack of them is a drive like any other but that
numbers in which they differ are arrays (V,); what all share is a plain number. What is calculated from a drive's values
by the functions of `warpchain.drive.each` then gives all of them at once, a drive alone being a stack of one.

Guides that are no straight bars on the ground, arms, tensioners, and chains of unlike links are calculated number by
number: of drives with these a stack differs in their sprockets' loads alone.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.drive import Drive
from warpchain.drive.motion import Load
from warpchain.drive.part import Part
from warpchain.drive.table import Table
from warpchain.errors import DriveError

Value = TypeVar("Value")

LARGEST = 1024
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


def stacks_of(drives: Sequence[Drive]) -> list[Stack]:
    """Drives sorted into stacks, in the order of their first members."""
    keys = _Keys()
    found: dict[Hashable, list[int]] = {}
    for v, drive in enumerate(drives):
        found.setdefault(keys.of_drive(drive), []).append(v)
    return [
        Stack(np.array(part, dtype=np.int64), stacked([drives[v] for v in part]))
        for members in found.values()
        for part in _parts(members)
    ]


def _parts(members: list[int]) -> Iterator[list[int]]:
    for begin in range(0, len(members), LARGEST):
        yield members[begin : begin + LARGEST]


def single(drive: Drive) -> bool:
    """Whether a drive has parts that are calculated number by number."""
    chain = drive.chain
    uneven = chain.outer is not None or chain.play is not None or bool(chain.worn_links)
    return uneven or bool(drive.arms or drive.tensioners) or not all(g.straight and g.arm is None for g in drive.guides)


class _Keys:
    """What of a part must be the same within a kind; each part is looked at once, as changed copies share them."""

    def __init__(self) -> None:
        self.known: dict[tuple[int, bool], Hashable] = {}

    def of_drive(self, drive: Drive) -> Hashable:
        exact = single(drive)
        tables = any(m is not None and m.table is not None for s in drive.sprockets for m in (s.prescribed, s.load))
        phase = drive.run.phase if tables else None  # tables over an angle move by it
        return exact, phase, *(self._of(value, exact) for value in drive.__dict__.values())

    def _of(self, value: Any, exact: bool) -> Hashable:
        if isinstance(value, float):
            return (value or str(value)) if exact else value == 0.0
        if isinstance(value, tuple):
            return tuple(self._of(inner, exact) for inner in value)
        if not isinstance(value, Part):
            return value
        if isinstance(value, Table):
            return id(value)  # long ones are slow to compare
        key = id(value), exact
        if key not in self.known:
            inner = exact and not isinstance(value, Load)
            fields = (field for name, field in value.__dict__.items() if name != "nudge")  # it is no part of a stack
            self.known[key] = type(value), *(self._of(field, inner) for field in fields)
        return self.known[key]


def stacked(values: Sequence[Value]) -> Value:
    """Drives, parts or values of a kind as one."""
    found: Value = _stacked(values)
    return found


def _stacked(values: Sequence[Any]) -> Any:
    first = values[0]
    if len(values) == 1 or len(set(map(id, values))) == 1:
        return first
    if isinstance(first, float):
        column = np.array(values, dtype=float)
        bits = column.view(np.int64)
        return first if (bits == bits[0]).all() else column
    if isinstance(first, tuple):
        return _same(first, tuple(_stacked(column) for column in zip(*values, strict=True)))
    if not isinstance(first, Part) or isinstance(first, Table):
        return first
    fields = [value.__dict__ for value in values]
    columns = {name: _stacked([of[name] for of in fields]) for name in first.__dict__}
    changed = {name: value for name, value in columns.items() if value is not first.__dict__[name]}
    return first.model_copy(update=changed) if changed else first


def picked(value: Value, places: Any) -> Value:
    """Some variants of a stack, or of a part of one, as a stack; `places` is an index of arrays (V,).

    One number gives that variant alone.
    """
    if isinstance(value, np.ndarray):
        found = value[places]
        return found if found.ndim else float(found)  # type: ignore[return-value]
    if isinstance(value, tuple):
        return _same(value, tuple(picked(inner, places) for inner in value))  # type: ignore[return-value]
    if not isinstance(value, Part) or isinstance(value, Table):
        return value
    new = {name: picked(inner, places) for name, inner in value.__dict__.items()}
    changed = {name: inner for name, inner in new.items() if inner is not value.__dict__[name]}
    return value.model_copy(update=changed) if changed else value


def _same(old: tuple[Any, ...], new: tuple[Any, ...]) -> tuple[Any, ...]:
    """The old one, where nothing of it has changed."""
    return old if all(a is b for a, b in zip(old, new, strict=True)) else new


def size_of(drive: Drive) -> int:
    """Number of variants of a stack; 1 where they do not differ."""
    return next((len(column) for column in arrays_of(drive)), 1)


def arrays_of(value: Any) -> Iterator[NDArray[np.float64]]:
    """All arrays of a stack, or of parts of one."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for inner in value:
            yield from arrays_of(inner)
    elif isinstance(value, Part) and not isinstance(value, Table):
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
            attempt(picked(stack.drive, slice(begin, end) if end > begin + 1 else begin))
        except DriveError as error:
            return error
        return None

    while end - begin > 1:
        middle = (begin + end) // 2
        begin, end = (begin, middle) if refusal(middle) is not None else (middle, end)
    error = refusal(end)
    assert error is not None  # as one of them is refused
    return int(stack.members[begin]), error


def first_of(refused: Sequence[tuple[int, DriveError]]) -> DriveError:
    """What to raise of variants that are refused: the first of them, named."""
    v, error = min(refused, key=lambda pair: pair[0])
    return DriveError(f"variant {v}: {error}")
