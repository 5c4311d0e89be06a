"""Ties between a drive's sprockets and shafts, and the speed ratios that they fix.

Bodies are numbered sprockets, then shafts.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

from warpchain.drive.schema import Part, are_numbers, node_list, node_value
from warpchain.drive.sprocket import END_TEETH

DRIVING_KEYS = ("prescribed", "motor", "initial_speed")
"""Keys of driving bodies, the strongest first."""


class BodyTie(NamedTuple):
    """Tie of two bodies in a fixed ratio, q_b = ratio q_a.

    Attributes:
        path: key path in the drive file.
        kind: "shaft", "gears" or "couplings".
    """

    a: int
    b: int
    ratio: Fraction
    kind: str
    path: tuple[str | int, ...]


class TiedRatios:
    """Speed ratios of tied bodies, each to its first."""

    def __init__(self, count: int) -> None:
        self.root = list(range(count))
        self.ratio = [Fraction(1)] * count

    def tie(self, a: int, b: int, ratio: Fraction) -> Fraction | None:
        """Ties bodies, q_b = ratio q_a; returns another ratio they have."""
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


def body_names(drive: Any) -> list[Any]:
    """Names of a drive's sprockets, then shafts."""
    return [node_value(part, "name") for kind in ("sprockets", "shafts") for part in node_list(drive, kind)]


def first_coupling_ratio(coupling: Any) -> Fraction | None:
    """First ratio of a coupling that is not open, or None."""
    ratios = node_value(coupling, "ratios")
    if ratios is None:
        return Fraction(1)
    engaged = [value for value in node_list(ratios, "ratio") if are_numbers(value) and value != 0.0]
    return (Fraction(engaged[0]).limit_denominator(1_000_000) or None) if engaged else None


def body_ties(drive: Any) -> list[BodyTie]:
    """Ties between bodies of a drive, freewheels last, without wrong ones."""
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
    """Whether a tie is a freewheel."""
    return tie.kind == "couplings" and node_value(node_list(drive, "couplings")[int(tie.path[1])], "freewheel") is True


def rotation_owners(drive: Any) -> dict[str, str]:
    """Names of shafts by those of the sprockets on them."""
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
    """Speed ratios of bodies, then chains, and ties that contradict them.

    Args:
        couplings: whether couplings tie.
        without: tie left out.
    """
    count, wrong = len(body_names(drive)), []
    chains = [node_value(chain, "name") for chain in node_list(drive, "chains")] or [None]
    found = TiedRatios(count + len(chains))
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        teeth, chain = node_value(sprocket, "teeth"), node_value(sprocket, "chain") if chains[0] is not None else None
        if isinstance(teeth, int) and not isinstance(teeth, bool) and teeth > END_TEETH and chain in chains:
            turns = Fraction(-1 if node_value(sprocket, "wrap") == "cw" else 1, teeth)
            found.tie(count + chains.index(chain), s, turns)
    for tie in body_ties(drive):
        if tie != without and (couplings or tie.kind != "couplings"):
            known = found.tie(tie.a, tie.b, tie.ratio)
            if known is not None and not is_freewheel(drive, tie):
                wrong.append((tie, known))
    return found, wrong


def part_of_body(drive: Any, b: int) -> Any:
    """Sprocket or shaft of body number b."""
    count = len(drive.sprockets)
    return drive.sprockets[b] if b < count else drive.shafts[b - count]


def driving_body(drive: Any) -> int:
    """Number of the driving body: prescribed, with a motor, started, loaded, or the first.

    Bodies tied to a chain come first, ends of chains last.
    """
    parts = [
        (b, part) for b, part in enumerate((*drive.sprockets, *drive.shafts)) if not getattr(part, "is_end", False)
    ]
    keys = (*DRIVING_KEYS, "load")
    driving = [b for key in keys for b, part in parts if getattr(part, key, None) is not None]
    return next((b for b in driving if nearest_sprocket(drive, b) is not None), (driving or [0])[0])


def driving_sprocket(drive: Any) -> int:
    """Index of the sprocket nearest to the driving body."""
    return nearest_sprocket(drive, driving_body(drive)) or 0


def nearest_sprocket(drive: Any, body: int) -> int | None:
    """Index of the sprocket nearest to a body by ties, or None."""
    if body < len(drive.sprockets):
        return body
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
