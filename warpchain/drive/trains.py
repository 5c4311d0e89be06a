"""Trains: sprockets and shafts that shafts, gears and couplings tie, and their speed ratios.

Sprockets and shafts are counted as bodies: the S sprockets, then the H shafts. Those that teeth or a shaft tie are a
train: one coordinate, of which body b has rho_b times the speed and sees the inertia sum rho^2 J / rho_b^2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from warpchain.drive.schema import Part, are_numbers, node_list, node_value
from warpchain.drive.sprocket import LedSprocket, Load

GEAR_PRESSURE_ANGLE = 20.0
"""Pressure angle of gears' teeth [degrees]."""


class BodyTie(NamedTuple):
    """Two bodies that turn in a fixed ratio, q_b = ratio q_a: by a shaft, teeth, or a coupling in the mean.

    Attributes:
        path: where the drive file says so.
        kind: "shaft", "gears" or "couplings".
    """

    a: int
    b: int
    ratio: Fraction
    kind: str
    path: tuple[str | int, ...]


class TiedRatios:
    """Speed ratios of bodies that are tied one by one: of each the first body tied to it, `root`, and the ratio."""

    def __init__(self, count: int) -> None:
        self.root = list(range(count))
        self.ratio = [Fraction(1)] * count

    def tie(self, a: int, b: int, ratio: Fraction) -> Fraction | None:
        """Ties q_b = ratio q_a; returns the ratio that they have already where it is another one."""
        if self.root[a] == self.root[b]:
            known = self.ratio[b] / self.ratio[a]
            return known if known != ratio else None
        keep, give = self.root[a], self.root[b]
        factor = ratio * self.ratio[a] / self.ratio[b]
        if give < keep:
            keep, give, factor = give, keep, 1 / factor
        for node, root in enumerate(self.root):
            if root == give:
                self.root[node], self.ratio[node] = keep, factor * self.ratio[node]
        return None


def has_trains(drive: Any) -> bool:
    """Whether a drive has shafts, gears or couplings."""
    return any(node_list(drive, kind) for kind in ("shafts", "gears", "couplings"))


def body_names(drive: Any) -> list[Any]:
    """Names of the bodies of a drive, sprockets then shafts."""
    return [node_value(part, "name") for kind in ("sprockets", "shafts") for part in node_list(drive, kind)]


def first_coupling_ratio(coupling: Any) -> Fraction | None:
    """The first ratio of a coupling, or mapping, that is not open; None where its ratios are not right."""
    ratios = node_value(coupling, "ratios")
    if ratios is None:
        return Fraction(1)
    engaged = [value for value in node_list(ratios, "ratio") if are_numbers(value) and value != 0.0]
    return (Fraction(engaged[0]).limit_denominator(1_000_000) or None) if engaged else None


def body_ties(drive: Any) -> list[BodyTie]:
    """Every tie between bodies of a drive: sprockets to their shafts, gears, couplings.

    Takes a drive or the mapping that should become one; what is not whole there is left out, and so are couplings with
    the ground. Freewheels are last.
    """
    names, found = body_names(drive), []
    pairs = [set(map(str, node_list(part, "between"))) for part in node_list(drive, "couplings")]
    count = len(node_list(drive, "sprockets"))
    on_shafts = list(enumerate(node_list(drive, "sprockets")))
    on_shafts += [(b, of) for b, of in enumerate(node_list(drive, "shafts"), count) if isinstance(of, Part)]
    for b, part in on_shafts:
        shaft = node_value(part, "shaft")
        if shaft in names and {str(node_value(part, "name")), str(shaft)} not in pairs:
            path = ("sprockets", b, "shaft") if b < count else ("shafts", b - count, "shaft")
            found.append(BodyTie(names.index(shaft), b, Fraction(1), "shaft", path))
    for kind in ("gears", "couplings"):
        for i, part in enumerate(node_list(drive, kind)):
            between, teeth = node_list(part, "between"), node_list(part, "teeth")
            if len(between) != 2 or between[0] == between[1] or any(name not in names for name in between):
                continue
            ratio = Fraction(1)
            if kind == "gears":
                if len(teeth) != 2 or not all(isinstance(z, int) and z > 0 for z in teeth):
                    continue
                ratio = Fraction(teeth[0], teeth[1]) * (1 if node_value(part, "internal") is True else -1)
            else:
                engaged = first_coupling_ratio(part)
                if engaged is None:
                    continue
                ratio = 1 / engaged
            found.append(BodyTie(names.index(between[0]), names.index(between[1]), ratio, kind, (kind, i)))
    return sorted(found, key=lambda tie: is_freewheel(drive, tie))


def is_freewheel(drive: Any, tie: BodyTie) -> bool:
    """Whether a tie of a drive, or of a mapping, is a freewheel, whose bodies may turn unlike."""
    return tie.kind == "couplings" and node_value(node_list(drive, "couplings")[int(tie.path[1])], "freewheel") is True


def rotation_owners(drive: Any) -> dict[str, str]:
    """Names of the sprockets that turn as a shaft, with the shaft's name."""
    names = body_names(drive)
    return {names[tie.b]: names[tie.a] for tie in body_ties(drive) if tie.kind == "shaft"}


def rigid_ratios(drive: Any) -> TiedRatios:
    """Speed ratios of the bodies that shafts and gears tie."""
    found = TiedRatios(len(body_names(drive)))
    for tie in body_ties(drive):
        if tie.kind != "couplings":
            found.tie(tie.a, tie.b, tie.ratio)
    return found


def ratios_with_chains(
    drive: Any, couplings: bool = True, without: BodyTie | None = None
) -> tuple[TiedRatios, list[tuple[BodyTie, Fraction]]]:
    """Speed ratios of all bodies with the chains as further ones, at 1/z to sprockets; and contradicting ties.

    A freewheel ties where nothing else does, and contradicts nothing.

    Args:
        couplings: whether what couplings couple turns alike.
        without: a tie that is left out.
    """
    count, wrong = len(body_names(drive)), []
    chains = [node_value(chain, "name") for chain in node_list(drive, "chains")] or [None]
    found = TiedRatios(count + len(chains))
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        teeth, chain = node_value(sprocket, "teeth"), node_value(sprocket, "chain") if chains[0] is not None else None
        if isinstance(teeth, int) and not isinstance(teeth, bool) and teeth > 0 and chain in chains:
            turns = Fraction(-1 if node_value(sprocket, "wrap") == "cw" else 1, teeth)
            found.tie(count + chains.index(chain), s, turns)
    for tie in body_ties(drive):
        if tie != without and (couplings or tie.kind != "couplings"):
            known = found.tie(tie.a, tie.b, tie.ratio)
            if known is not None and not is_freewheel(drive, tie):
                wrong.append((tie, known))
    return found, wrong


class Train(NamedTuple):
    """The bodies that turn as one train, and their speeds over that of one of them."""

    bodies: tuple[int, ...]
    ratios: tuple[float, ...]


def train_of_body(drive: Any, b: int) -> Train:
    """The train of body b, itself with ratio 1."""
    if not has_trains(drive):
        return Train((b,), (1.0,))
    tied = rigid_ratios(drive)
    bodies = tuple(other for other, root in enumerate(tied.root) if root == tied.root[b])
    return Train(bodies, tuple(float(tied.ratio[other] / tied.ratio[b]) for other in bodies))


def part_of_body(drive: Any, b: int) -> Any:
    """The sprocket or shaft of a drive that body b is."""
    count = len(drive.sprockets)
    return drive.sprockets[b] if b < count else drive.shafts[b - count]


def inertia_of_body(drive: Any, b: int) -> Any:
    """Inertia of body b alone, balance wheel included [kg m^2]; 0 where it is not given."""
    from warpchain.drive.mounts import wheel_inertia  # here, since it takes numpy

    part = part_of_body(drive, b)
    inertia = 0.0 if part.inertia is None else part.inertia
    return inertia + wheel_inertia(part) if b < len(drive.sprockets) else inertia


def inertia_behind_body(drive: Any, b: int) -> Any:
    """Inertia of body b [kg m^2], with that of the chains that it turns as another chain's sprocket."""
    return inertia_of_body(drive, b) + getattr(part_of_body(drive, b), "driven_inertia", 0.0)


def train_inertia(drive: Any, b: int) -> Any:
    """Inertia of the whole train of body b as that sees it [kg m^2]: sum rho^2 J / rho_b^2."""
    train = train_of_body(drive, b)
    parts = [r * r * inertia_of_body(drive, other) for other, r in zip(*train, strict=True)]
    return sum(parts[1:], parts[0])


def prescribed_leader(drive: Any, b: int) -> tuple[int, float] | None:
    """The body of b's train whose motion is prescribed, and the speed of b over that body's; None where b is free."""
    for other, ratio in zip(*train_of_body(drive, b), strict=True):
        part = part_of_body(drive, other)
        if part.prescribed is not None and not isinstance(part, LedSprocket):
            return other, 1.0 / ratio
    return None


def is_free_body(drive: Any, s: int) -> bool:
    """Whether nothing prescribes the angle of body s."""
    return prescribed_leader(drive, s) is None


def turns_per_roller(drive: Any) -> list[float]:
    """Revolutions of each body, counter-clockwise, while a roller passes; its ratio where no chain turns it."""
    found, _ = ratios_with_chains(drive)
    chain = found.ratio[-1]
    of_chain = found.root[-1]
    return [float(r / chain if root == of_chain else r) for r, root in zip(found.ratio[:-1], found.root, strict=False)]


def body_turning_sign(drive: Any, b: int) -> int:
    """+1 where forward rotation of body b is counter-clockwise, else -1."""
    if b < len(drive.sprockets):
        return drive.sprockets[b].sign
    return 1 if turns_per_roller(drive)[b] > 0.0 else -1


def body_speed_ratio(drive: Any, b: int, other: int) -> float:
    """Forward speed of body b over that of another, as the chain, shafts, gears and couplings tie them."""
    count = len(drive.sprockets)
    if drive.chains:
        found, _ = ratios_with_chains(drive)
        return abs(float(found.ratio[b] / found.ratio[other])) if found.root[b] == found.root[other] else 1.0
    if b < count and other < count:
        return drive.sprockets[other].teeth / drive.sprockets[b].teeth
    turns = turns_per_roller(drive)
    return abs(turns[b] / turns[other])


def bodies_beyond_gear(drive: Any, g: int) -> list[int]:
    """Bodies on the second shaft's side that only gear pair g ties to its first; none where gears go round."""
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
    """Yields the loads of bodies that nothing prescribes, with the body's number."""
    for b, part in enumerate((*drive.sprockets, *drive.shafts)):
        if part.load is not None and is_free_body(drive, b):
            yield b, part.load


def driving_body(drive: Any) -> int:
    """The body that drives: the first sprocket or shaft that is prescribed, else with a motor, else started.

    Bodies that something ties to a chain come first.
    """
    parts: Sequence[Any] = (*drive.sprockets, *drive.shafts)
    keys = ("prescribed", "motor", "initial_speed", "load")
    driving = [b for key in keys for b, part in enumerate(parts) if getattr(part, key, None) is not None]
    return next((b for b in driving if nearest_sprocket(drive, b) is not None), (driving or [0])[0])


def driving_sprocket(drive: Any) -> int:
    """Index of the sprocket nearest to the body that drives."""
    return nearest_sprocket(drive, driving_body(drive)) or 0


def nearest_sprocket(drive: Any, body: int) -> int | None:
    """Index of the sprocket nearest to a body, over shafts and gears, then couplings; None where there is none."""
    seen = [body]
    edges = sorted(body_ties(drive), key=lambda tie: tie.kind == "couplings")
    for b in seen:
        if b < len(drive.sprockets):
            return b
        for tie in edges:
            for a, other in ((tie.a, tie.b), (tie.b, tie.a)):
                if a == b and other not in seen:
                    seen.append(other)
    return None


def is_held_body(drive: Any, b: int) -> bool:
    """Whether body b is held where moments are in balance: prescribed, or in the train of what drives all others."""
    driving = driving_body(drive)
    held = drive.driver if nearest_sprocket(drive, driving) is None else driving
    return not is_free_body(drive, b) or held in train_of_body(drive, b).bodies


def coupled_bodies(drive: Any, coupling: Any) -> tuple[int, int]:
    """The two bodies of a coupling; the ground is -1."""
    names = body_names(drive)
    return -1 if coupling.is_grounded else names.index(coupling.between[0]), names.index(coupling.between[1])


def coupling_rest_angle(drive: Any, c: int, ratio: Any, laid: Any) -> tuple[int, int, Any]:
    """The two bodies of coupling c, and the first's angle less `ratio` times the second's where it is relaxed [rad].

    The ground is body -1, at angle 0.

    Args:
        laid: (..., S) angles of the sprockets as the chain has been laid around them [rad].
    """
    first, second = coupled_bodies(drive, drive.couplings[c])
    rest = 0.0
    for b, turns in ((first, 1.0), (second, -ratio)):
        if 0 <= b < len(drive.sprockets):
            rest = rest + turns * laid[..., b]
    return first, second, rest
