"""Drives alike in all but their loads: what does not hang on a load is worked out once for them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive, Sprocket
from warpchain.drive_base import Part
from warpchain.kernels.rollers import STATE_ROWS

if TYPE_CHECKING:
    from warpchain.ensemble import Packed


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
            *(id(value) for name, value in drive.__dict__.items() if name not in ("sprockets", "guides")),
            tuple(map(id, drive.guides)),
            tuple(sprockets[id(sprocket)] for sprocket in drive.sprockets),
        )
        if key not in kinds:
            kinds[key] = len(firsts)
            firsts.append(v)
        which.append(kinds[key])
    return firsts, which


def taken(packed: Packed, which: Sequence[int]) -> Packed:
    """The variants of `packed` of these indices, each as often as it is named, as an ensemble of their own."""
    chosen = np.asarray(which, dtype=np.int64)
    drives = packed.drives[chosen]
    rollers, wheels, bars = (drives[name].astype(np.int64) for name in ("rollers", "sprockets", "guides"))
    memories = rollers * (wheels + bars)

    def spread(first: str, per: NDArray[np.int64], width: int = 1) -> NDArray[np.int64]:
        """Where the values stand now; `drives` then says where they will stand."""
        old, new = width * drives[first].astype(np.int64), width * (np.cumsum(per) - per)
        drives[first] = new // width
        return np.repeat(old - new, width * per) + np.arange(int(width * per.sum()))

    rows = spread("first_roller", rollers, STATE_ROWS)
    drives["first_roller"] = packed.drives["first_roller"][chosen]
    chain, disks = spread("first_roller", rollers), spread("first_sprocket", wheels)
    rails, seats = spread("first_guide", bars), spread("first_contact", memories)
    spread("first_tally", rollers * (wheels + 1))
    return replace(
        packed,
        drives=drives,
        chains=packed.chains[chosen],
        lengths=packed.lengths[chain],
        sprockets=packed.sprockets[disks],
        motions=packed.motions[disks],
        mounts=packed.mounts[disks],
        guides=packed.guides[rails] if len(rails) else packed.guides[:1],
        rollers=packed.rollers[rows],
        bodies=packed.bodies[disks],
        strands=packed.strands[disks],
        seat=packed.seat[seats],
        assemblies=tuple(packed.assemblies[v] for v in which),
    )
