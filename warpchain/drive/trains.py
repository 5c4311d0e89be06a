"""Trains: sprockets on shafts, shafts on gears, and the speeds of all at one speed of the chain.

Sprockets and shafts are counted as bodies: the S sprockets, then the H shafts. Those that teeth or a shaft tie are a
train: one coordinate, of which body b has rho_b times the speed and sees the inertia sum rho^2 J / rho_b^2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from warpchain.drive.schema import Part, elements, get, numbers
from warpchain.drive.sprocket import Led, Load

PRESSURE_ANGLE = 20.0
"""Of gears' teeth [degrees]."""


class Tie(NamedTuple):
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


class Ratios:
    """Bodies that turn in fixed ratios, as they are tied one by one."""

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
    return any(elements(drive, kind) for kind in ("shafts", "gears", "couplings"))


def names_of(drive: Any) -> list[Any]:
    """Names of the bodies."""
    return [get(part, "name") for kind in ("sprockets", "shafts") for part in elements(drive, kind)]


def first_ratio(coupling: Any) -> Fraction | None:
    """The first ratio of a coupling that is not open; None where its ratios are not right. Takes a mapping, too."""
    ratios = get(coupling, "ratios")
    if ratios is None:
        return Fraction(1)
    engaged = [value for value in elements(ratios, "ratio") if numbers(value) and value != 0.0]
    return (Fraction(engaged[0]).limit_denominator(1_000_000) or None) if engaged else None


def ties(drive: Any) -> list[Tie]:
    """Everything that ties bodies, or that couples them: sprockets to their shafts, gears, couplings.

    Takes a drive or the mapping that should become one; what is not whole there is left out.
    """
    names, found = names_of(drive), []
    pairs = [set(map(str, elements(part, "between"))) for part in elements(drive, "couplings")]
    count = len(elements(drive, "sprockets"))
    on_shafts = list(enumerate(elements(drive, "sprockets")))
    on_shafts += [(b, of) for b, of in enumerate(elements(drive, "shafts"), count) if isinstance(of, Part)]
    for b, part in on_shafts:
        shaft = get(part, "shaft")
        if shaft in names and {str(get(part, "name")), str(shaft)} not in pairs:
            path = ("sprockets", b, "shaft") if b < count else ("shafts", b - count, "shaft")
            found.append(Tie(names.index(shaft), b, Fraction(1), "shaft", path))
    for kind in ("gears", "couplings"):
        for i, part in enumerate(elements(drive, kind)):
            between, teeth = elements(part, "between"), elements(part, "teeth")
            if len(between) != 2 or between[0] == between[1] or any(name not in names for name in between):
                continue
            ratio = Fraction(1)
            if kind == "gears":
                if len(teeth) != 2 or not all(isinstance(z, int) and z > 0 for z in teeth):
                    continue
                ratio = Fraction(teeth[0], teeth[1]) * (1 if get(part, "internal") is True else -1)
            else:
                engaged = first_ratio(part)
                if engaged is None:
                    continue
                ratio = 1 / engaged
            found.append(Tie(names.index(between[0]), names.index(between[1]), ratio, kind, (kind, i)))
    return found


def rigid(drive: Any) -> Ratios:
    """The trains: bodies that shafts and gears tie, to the first of each."""
    found = Ratios(len(names_of(drive)))
    for tie in ties(drive):
        if tie.kind != "couplings":
            found.tie(tie.a, tie.b, tie.ratio)
    return found


def with_chain(
    drive: Any, couplings: bool = True, without: Tie | None = None
) -> tuple[Ratios, list[tuple[Tie, Fraction]]]:
    """All bodies, the chains after them as more, of which a sprocket of z teeth has 1/z; and contradicting ties.

    Args:
        couplings: whether what couplings couple turns alike.
        without: a tie that is left out.
    """
    count, wrong = len(names_of(drive)), []
    chains = [get(chain, "name") for chain in elements(drive, "chains")] or [None]
    found = Ratios(count + len(chains))
    for s, sprocket in enumerate(elements(drive, "sprockets")):
        teeth, chain = get(sprocket, "teeth"), get(sprocket, "chain") if chains[0] is not None else None
        if isinstance(teeth, int) and not isinstance(teeth, bool) and teeth > 0 and chain in chains:
            turns = Fraction(-1 if get(sprocket, "wrap") == "cw" else 1, teeth)
            found.tie(count + chains.index(chain), s, turns)
    for tie in ties(drive):
        if tie != without and (couplings or tie.kind != "couplings"):
            known = found.tie(tie.a, tie.b, tie.ratio)
            if known is not None:
                wrong.append((tie, known))
    return found, wrong


class Train(NamedTuple):
    """The train of a body: all that turn with it, and how fast beside it."""

    bodies: tuple[int, ...]
    ratios: tuple[float, ...]


def train_of(drive: Any, b: int) -> Train:
    """The train of body b, itself with ratio 1."""
    if not has_trains(drive):
        return Train((b,), (1.0,))
    tied = rigid(drive)
    bodies = tuple(other for other, root in enumerate(tied.root) if root == tied.root[b])
    return Train(bodies, tuple(float(tied.ratio[other] / tied.ratio[b]) for other in bodies))


def turned_part(drive: Any, b: int) -> Any:
    """The sprocket or shaft that body b is."""
    count = len(drive.sprockets)
    return drive.sprockets[b] if b < count else drive.shafts[b - count]


def own_inertia(drive: Any, b: int) -> Any:
    """Inertia of body b itself [kg m^2]; 0 where it is not given."""
    from warpchain.drive.mounts import wheel_inertia  # here, since it takes numpy

    part = turned_part(drive, b)
    inertia = 0.0 if part.inertia is None else part.inertia
    return inertia + wheel_inertia(part) if b < len(drive.sprockets) else inertia


def seen_inertia(drive: Any, b: int) -> Any:
    """Inertia that turns with body b, as it sees it [kg m^2]: sum rho^2 J / rho_b^2."""
    train = train_of(drive, b)
    parts = [r * r * own_inertia(drive, other) for other, r in zip(*train, strict=True)]
    return sum(parts[1:], parts[0])


def leader_of(drive: Any, b: int) -> tuple[int, float] | None:
    """The body of b's train whose motion is prescribed, and how fast b turns beside it; None where b is free."""
    for other, ratio in zip(*train_of(drive, b), strict=True):
        part = turned_part(drive, other)
        if part.prescribed is not None and not isinstance(part, Led):
            return other, 1.0 / ratio
    return None


def is_free(drive: Any, s: int) -> bool:
    """Whether nothing prescribes the angle of body s."""
    return leader_of(drive, s) is None


def signed_turns(drive: Any) -> list[float]:
    """Revolutions of each body, counter-clockwise, while a roller passes; of what hangs on no chain its ratio."""
    found, _ = with_chain(drive)
    chain = found.ratio[-1]
    of_chain = found.root[-1]
    return [float(r / chain if root == of_chain else r) for r, root in zip(found.ratio[:-1], found.root, strict=False)]


def turning_sign(drive: Any, b: int) -> int:
    """+1 where forward rotation of body b is counter-clockwise, else -1."""
    if b < len(drive.sprockets):
        return drive.sprockets[b].sign
    return 1 if signed_turns(drive)[b] > 0.0 else -1


def speed_ratio(drive: Any, b: int, other: int) -> float:
    """Forward speed of body b over that of another, as the chain, shafts, gears and couplings tie them."""
    count = len(drive.sprockets)
    if drive.chains:
        found, _ = with_chain(drive)
        return abs(float(found.ratio[b] / found.ratio[other])) if found.root[b] == found.root[other] else 1.0
    if b < count and other < count:
        return drive.sprockets[other].teeth / drive.sprockets[b].teeth
    turns = signed_turns(drive)
    return abs(turns[b] / turns[other])


def gear_side(drive: Any, g: int) -> list[int]:
    """Bodies that gear pair g alone ties to its first shaft, on the side of its second; none where gears go round."""
    edges, mine, tied = [], None, Ratios(len(names_of(drive)))
    for tie in ties(drive):
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


def loads_of(drive: Any) -> Iterator[tuple[int, Load]]:
    """The loads of bodies that nothing prescribes, by body."""
    for b, part in enumerate((*drive.sprockets, *drive.shafts)):
        if part.load is not None and is_free(drive, b):
            yield b, part.load


def driving_body(drive: Any) -> int:
    """The body that drives: the first sprocket or shaft that is prescribed, else with a motor, else started; of those
    that something ties to a chain, where there is one."""
    parts: Sequence[Any] = (*drive.sprockets, *drive.shafts)
    keys = ("prescribed", "motor", "initial_speed", "load")
    driving = [b for key in keys for b, part in enumerate(parts) if getattr(part, key, None) is not None]
    return next((b for b in driving if nearest_sprocket(drive, b) is not None), (driving or [0])[0])


def driving_sprocket(drive: Any) -> int:
    """The sprocket nearest to the body that drives."""
    return nearest_sprocket(drive, driving_body(drive)) or 0


def nearest_sprocket(drive: Any, body: int) -> int | None:
    """The sprocket nearest to a body, over shafts and gears, then over couplings; None where there is none."""
    seen = [body]
    edges = sorted(ties(drive), key=lambda tie: tie.kind == "couplings")
    for b in seen:
        if b < len(drive.sprockets):
            return b
        for tie in edges:
            for a, other in ((tie.a, tie.b), (tie.b, tie.a)):
                if a == b and other not in seen:
                    seen.append(other)
    return None


def stands(drive: Any, b: int) -> bool:
    """Whether body b is held where moments are in balance: prescribed, or in the train of what drives all others."""
    driving = driving_body(drive)
    held = drive.driver if nearest_sprocket(drive, driving) is None else driving
    return not is_free(drive, b) or held in train_of(drive, b).bodies


def untwisted(drive: Any, c: int, ratio: Any, laid: Any) -> tuple[int, int, Any]:
    """The bodies that coupling c couples, and the first's angle less `ratio` times the second's where it is not twisted
    [rad].

    Args:
        laid: (..., S) angles of the sprockets as the chain has been laid around them [rad].
    """
    first, second = (names_of(drive).index(name) for name in drive.couplings[c].between)
    rest = 0.0
    for b, turns in ((first, 1.0), (second, -ratio)):
        if b < len(drive.sprockets):
            rest = rest + turns * laid[..., b]
    return first, second, rest
