"""Trains: sprockets and shafts, numbered so, that shafts, gears and couplings tie.

Body b has rho_b times the train's speed, and the inertia sum rho^2 J / rho_b^2.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from warpchain.drive.body_ties import (
    TiedRatios,
    body_names,
    body_ties,
    driving_body,
    nearest_sprocket,
    part_of_body,
    ratios_with_chains,
    rigid_ratios,
)
from warpchain.drive.sprocket import Load
from warpchain.drive.stack_math import Number
from warpchain.model.mounts import wheel_inertia
from warpchain.model.parts_between_chains import LedSprocket

GEAR_PRESSURE_ANGLE = 20.0
"""Pressure angle of gear teeth [degrees]."""


class Train(NamedTuple):
    """Bodies of a train, and their speeds over one's."""

    bodies: tuple[int, ...]
    ratios: tuple[float, ...]


def has_trains(drive: Any) -> bool:
    """Whether a drive or chain has shafts, gears or couplings."""
    return bool(drive.shafts or drive.gears or drive.couplings)


def train_of_body(drive: Any, b: int) -> Train:
    """Train of body b, itself at ratio 1."""
    if not has_trains(drive):
        return Train((b,), (1.0,))
    tied = rigid_ratios(drive)
    bodies = tuple(other for other, root in enumerate(tied.root) if root == tied.root[b])
    return Train(bodies, tuple(float(tied.ratio[other] / tied.ratio[b]) for other in bodies))


def inertia_of_body(drive: Any, b: int) -> Number:
    """Inertia of body b alone [kg m^2]."""
    part = part_of_body(drive, b)
    inertia = 0.0 if part.inertia is None else part.inertia
    return inertia + wheel_inertia(part) if b < len(drive.sprockets) else inertia


def inertia_behind_body(drive: Any, b: int) -> Number:
    """Inertia of body b with chains that it turns [kg m^2]."""
    return inertia_of_body(drive, b) + getattr(part_of_body(drive, b), "driven_inertia", 0.0)


def train_inertia(drive: Any, b: int) -> Number:
    """Inertia of body b's train at body b [kg m^2]."""
    train = train_of_body(drive, b)
    parts = [r * r * inertia_of_body(drive, other) for other, r in zip(*train, strict=True)]
    return sum(parts[1:], parts[0])


def prescribed_leader(drive: Any, b: int) -> tuple[int, float] | None:
    """Number of the prescribed body in body b's train, and b's speed over its; or None."""
    for other, ratio in zip(*train_of_body(drive, b), strict=True):
        part = part_of_body(drive, other)
        if part.prescribed is not None and not isinstance(part, LedSprocket):
            return other, 1.0 / ratio
    return None


def is_free_body(drive: Any, s: int) -> bool:
    """Whether nothing prescribes body b's angle."""
    return prescribed_leader(drive, s) is None


def turns_per_roller(drive: Any) -> list[float]:
    """Counter-clockwise revolutions of each body a roller of the chain."""
    found, _ = ratios_with_chains(drive)
    chain = found.ratio[-1]
    of_chain = found.root[-1]
    return [float(r / chain if root == of_chain else r) for r, root in zip(found.ratio[:-1], found.root, strict=False)]


def body_turning_sign(drive: Any, b: int) -> int:
    """+1 where body b turns forward counter-clockwise, else -1."""
    if b < len(drive.sprockets):
        return drive.sprockets[b].sign
    return 1 if turns_per_roller(drive)[b] > 0.0 else -1


def body_speed_ratio(drive: Any, b: int, other: int) -> float:
    """Forward speed of body b over another's, by chain and ties."""
    count = len(drive.sprockets)
    if b < count and other < count:
        return drive.sprockets[other].teeth / drive.sprockets[b].teeth
    turns = turns_per_roller(drive)
    return abs(turns[b] / turns[other])


def bodies_beyond_gear(drive: Any, g: int) -> list[int]:
    """Bodies that only gear pair g ties to its first shaft."""
    edges, mine, tied = [], None, TiedRatios(len(body_names(drive)))
    for tie in body_ties(drive):
        if tie.kind != "couplings" and tied.root[tie.a] != tied.root[tie.b]:
            tied.tie(tie.a, tie.b, tie.ratio)
            if tie.path == ("gears", g):
                mine = tie
            else:
                edges.append(tie)
    if mine is None:
        return []
    side, grown = {mine.b}, True
    while grown:
        more = {b for tie in edges for a, b in ((tie.a, tie.b), (tie.b, tie.a)) if a in side} - side
        side, grown = side | more, bool(more)
    return sorted(side)


def free_body_loads(drive: Any) -> Iterator[tuple[int, Load]]:
    """Numbers and loads of bodies that nothing prescribes."""
    for b, part in enumerate((*drive.sprockets, *drive.shafts)):
        if part.load is not None and is_free_body(drive, b):
            yield b, part.load


def is_held_body(drive: Any, b: int) -> bool:
    """Whether body b is prescribed, or in the driving train."""
    driving = driving_body(drive)
    held = drive.driver if nearest_sprocket(drive, driving) is None else driving
    return not is_free_body(drive, b) or held in train_of_body(drive, b).bodies


def coupled_bodies(drive: Any, coupling: Any) -> tuple[int, int]:
    """Two bodies of a coupling; the ground is -1."""
    names = body_names(drive)
    return -1 if coupling.is_grounded else names.index(coupling.between[0]), names.index(coupling.between[1])


def coupling_rest_angle(drive: Any, c: int, ratio: Number, laid: Number) -> tuple[int, int, Number]:
    """Bodies of coupling c, -1 the ground, and its relaxed angle [rad].

    Args:
        ratio: factor of the second body's angle.
        laid: (..., S) sprocket angles [rad].
    """
    first, second = coupled_bodies(drive, drive.couplings[c])
    rest = 0.0
    for b, turns in ((first, 1.0), (second, -ratio)):
        if 0 <= b < len(drive.sprockets):
            rest = rest + turns * laid[..., b]
    return first, second, rest
