"""Drives alike in all but their loads: what does not hang on a load is worked out once for them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from warpchain.drive import Drive, Sprocket
from warpchain.drive.part import Part

LISTS = ("sprockets", "guides", "arms", "tensioners")
"""Parts of a drive that changed copies list anew; their elements are shared."""


def _mark(value: object) -> Hashable:
    """A part by its identity, which changed copies share and long tables need not be hashed for; others by value."""
    return id(value) if isinstance(value, Part | tuple | list) else value or str(value)


def _sprocket(sprocket: Sprocket) -> Hashable:
    fields = sprocket.__dict__
    center = tuple(map(_mark, sprocket.center))
    others = (_mark(fields[key]) for key in fields if key not in ("center", "load"))
    return (center, sprocket.load is None, *others)


def alike(drives: Sequence[Drive]) -> tuple[list[int], list[int]]:
    """Sorts drives that share all parts but their sprockets' loads into kinds.

    Returns:
        The first drive of each kind, and the kind of each drive (by its index in the former).
    """
    kinds: dict[Hashable, int] = {}
    sprockets: dict[int, Hashable] = {}
    firsts: list[int] = []
    which: list[int] = []
    for v, drive in enumerate(drives):
        for sprocket in drive.sprockets:
            if id(sprocket) not in sprockets:
                sprockets[id(sprocket)] = _sprocket(sprocket)
        key = (
            *(id(value) for name, value in drive.__dict__.items() if name not in LISTS),
            *(tuple(map(id, parts)) for parts in (drive.guides, drive.arms, drive.tensioners)),
            tuple(sprockets[id(sprocket)] for sprocket in drive.sprockets),
        )
        if key not in kinds:
            kinds[key] = len(firsts)
            firsts.append(v)
        which.append(kinds[key])
    return firsts, which
