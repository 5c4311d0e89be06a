"""Taut string: the shortest way of a strand between two ends past guides, as arcs and tangents.

An obstacle is a run of convex arcs of rollers' centers over a face: circles of center c and radius R about which the
string turns with the sign w (+1 counter-clockwise, the guide on its left), each between two headings of its tangent.
From k to l the string runs along u over S, by (a) and (b) of `warpchain.assembly.path`.

Arcs touched are an active set: dropped where the string would pull; taken in where cut deepest, and next in a run where
a tangent point lies beyond an arc's end. Strings of variants that touch the same arcs are one with arrays (V,).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from warpchain.drive.face_profile import Piece, Point, Profile, unit_vector, wrapped_angle
from warpchain.drive.stack_math import (
    Condition,
    Number,
    arctan2,
    cos,
    index_of_maximum,
    is_true_somewhere,
    maximum,
    minimum,
    ordered_sum,
    quick_arcsin,
    shared_value,
    sin,
    sqrt,
    where,
)

_CUT = 1e-11
"""Depth to which round-off may let a tangent cut an arc [m]."""
_NO_WRAP = 1e-12  # rad
_ROUNDS = 500


class TautError(ValueError):
    """Error of a taut string that cannot run.

    Attributes:
        guide: index of the guide in its way, -1 for none.
    """

    def __init__(self, guide: int, text: str) -> None:
        super().__init__(text)
        self.guide = guide


@dataclass(frozen=True)
class Arc:
    """Convex arc of rollers' centers over a guide, or with guide -1 an end of a taut string.

    Attributes:
        center: [m].
        radius: R [m].
        sign: w, +1 where the string turns counter-clockwise, else -1.
        begin, end: first and last headings of its tangent [rad]; w (end - begin) > 0.
        place: on the guide's face at `begin` [m].
        slope: change of the place per heading [m/rad].
        before, after: straight pieces to the neighbor arcs [m]; None without such, or over a concave piece.
    """

    center: Point
    radius: float
    sign: float = 1.0
    begin: float = -math.inf
    end: float = math.inf
    guide: int = -1
    place: float = 0.0
    slope: float = 0.0
    before: float | None = None
    after: float | None = None

    def nearest_heading(self, heading: Number) -> Number:
        """Heading of an arc's tangent nearest to a given one [rad]."""
        if self.guide < 0:
            return heading
        middle = 0.5 * (self.begin + self.end)
        half = 0.5 * abs(self.end - self.begin)
        return middle + maximum(-half, minimum(half, wrapped_angle(heading - middle)))

    def at(self, heading: Number) -> tuple[Number, Number]:
        """Point at which an arc's tangent has a heading [m]."""
        x, y = unit_vector(heading)
        reach = self.sign * self.radius
        return self.center[0] + reach * y, self.center[1] - reach * x

    def is_past(self, heading: Number, last: bool) -> Condition:
        """Whether a tangent's heading lies beyond an arc's end, or before its begin unless `last`."""
        if self.guide < 0:
            return False
        off = wrapped_angle(heading - (self.end if last else self.begin))
        return (self.sign if last else -self.sign) * off > _NO_WRAP


@dataclass(frozen=True)
class GuideTouch:
    """Arc that a taut string touches, between two headings [rad]."""

    arc: Arc
    arrive: float
    leave: float

    @property
    def wrap(self) -> float:
        """Wrapped angle of a touch [rad], negative where the string would pull."""
        return self.arc.sign * wrapped_angle(self.leave - self.arrive)

    @property
    def places(self) -> tuple[float, float]:
        """Places on a guide's face where the chain's touch begins and ends [m]."""
        ends = [self.arc.place + self.arc.slope * wrapped_angle(heading - self.arc.begin) for heading in self._headings]
        return minimum(*ends), maximum(*ends)

    @property
    def _headings(self) -> tuple[float, float]:
        """Headings at which a taut string arrives and leaves."""
        return self.arrive, self.leave


@dataclass(frozen=True)
class TautString:
    """Taut string of arcs and tangents.

    Attributes:
        pieces: straight parts and arcs, in order.
        first, last: headings at the ends [rad].
        touches: of guides' arcs, in order.
        free: lengths of the straight parts on no guide, in order [m].
        numbers: of its arcs among all obstacles'.
    """

    pieces: tuple[Piece, ...]
    first: float
    last: float
    touches: tuple[GuideTouch, ...]
    free: tuple[float, ...]
    numbers: tuple[int, ...]

    @property
    def length(self) -> float:
        """Length of a taut string [m]."""
        return ordered_sum(piece.length for piece in self.pieces)

    def levers(self, guides: Iterable[int], pivot: Point) -> float:
        """Lever of a taut string on some guides about a pivot: moment over tension [m]."""
        known, total = set(guides), 0.0
        for touch in self.touches:
            if touch.arc.guide in known:
                for heading, side in ((touch.leave, 1.0), (touch.arrive, -1.0)):
                    (x, y), (ux, uy) = touch.arc.at(heading), unit_vector(heading)
                    total = total + side * ((x - pivot[0]) * uy - (y - pivot[1]) * ux)
        return total

    def chain_length(self, pitch: float) -> float:
        """Length of a taut string as links of a pitch measure it by chords [m]."""
        total = 0.0
        for piece in self.pieces:
            total = total + piece.length * _chord_ratio(0.5 * pitch * abs(piece.curvature))
        return total


def obstacle_arcs(profile: Profile, offset: float, guide: int, along: bool) -> tuple[Arc, ...]:
    """Convex arcs of rollers' centers over a guide's face, in the order of the chain's travel.

    Args:
        profile: the face where it stands.
        offset: of the rollers' centers [m].
        guide: its index.
        along: whether the chain travels along the profile's pieces, the guide on its right.
    """
    arcs: list[Arc] = []
    gap: float | None = None
    last = len(profile.pieces) - 1
    for i, (place, piece) in enumerate(zip(profile.places, profile.pieces, strict=True)):
        if piece.curvature == 0.0:
            gap = None if gap is None else gap + piece.length
            continue
        if piece.curvature > 0.0:
            gap = None
            continue
        nx, ny = unit_vector(piece.heading + 0.5 * math.pi)
        reach = 1.0 / piece.curvature
        center = (piece.start[0] + reach * nx, piece.start[1] + reach * ny)
        begin, end = piece.heading, piece.end_heading
        begin, end = (begin + 0.4 * math.pi * (i == 0), end - 0.4 * math.pi * (i == last))  # rounded ends go on
        start = place + (begin - piece.heading) / piece.curvature
        if arcs and gap is not None:
            arcs[-1] = replace(arcs[-1], after=gap)
        arcs.append(Arc(center, offset - reach, -1.0, begin, end, guide, start, 1.0 / piece.curvature, gap))
        gap = 0.0
    return tuple(arcs) if along else tuple(_reversed_arc(arc) for arc in reversed(arcs))


def runs_under_links(
    runs: Sequence[tuple[Arc, ...]], touches: Iterable[GuideTouch], pitch: Number
) -> tuple[tuple[Arc, ...], ...]:
    """Runs of arcs, raised until links of a pitch clear in their middles the arcs that a string touches.

    Over an arc of radius R that turns the string by b it is R (1 - cos(b/2)) + (p - R b) sin(b/2) / 2, b at most p / R.
    """
    raised: dict[int, Number] = {}
    for touch in touches:
        radius, guide = touch.arc.radius, touch.arc.guide
        half = 0.5 * minimum(touch.wrap, pitch / radius)
        lift = radius * (1.0 - cos(half)) + (0.5 * pitch - radius * half) * sin(half)
        raised[guide] = maximum(raised.get(guide, 0.0), lift)
    return tuple(tuple(replace(arc, radius=arc.radius + raised.get(arc.guide, 0.0)) for arc in run) for run in runs)


def taut_string(first: Arc, last: Arc, obstacles: Sequence[tuple[Arc, ...]], like: Sequence[int] = ()) -> TautString:
    """Taut string from circle or point `first` to `last` around obstacles.

    Args:
        obstacles: runs of arcs, in order.
        like: numbers of the arcs that it probably touches.

    Raises:
        TautError: a guide and an end overlap so that no tangent joins them.
        UnlikeVariants: strings of a stack's variants, not all of which touch the same arcs.
    """
    runs = [arc for run in obstacles for arc in run]
    known = {id(arc): (run, i) for run in obstacles for i, arc in enumerate(run)}
    chosen = [first, *(runs[i] for i in like), last]
    for _ in range(_ROUNDS):
        missing = _tangents_or_arc(chosen, known)
        if isinstance(missing, tuple):
            chosen.insert(*missing)
            continue
        touches = [GuideTouch(arc, missing[k][1], missing[k + 1][0]) for k, arc in enumerate(chosen[1:-1])]
        if touches:
            lifted = [-touch.wrap for touch in touches]
            worst = shared_value(where(maximum(*lifted) > _NO_WRAP, index_of_maximum(lifted), -1))
            if worst >= 0:
                del chosen[worst + 1]
                continue
        more = _arc_beyond(touches, chosen, known) or _deepest_cut_arc(chosen, missing, runs)
        if more is None:
            return _string_of_tangents(chosen, missing, touches, runs)
        chosen.insert(*more)
    raise TautError(next((arc.guide for arc in chosen[1:-1]), -1), "no taut string was found around it")


def point_end(place: Sequence[Number]) -> Arc:
    """End of a taut string at a point [m]."""
    return Arc((place[0], place[1]), 0.0)


def circle_end(center: Sequence[Number], radius: Number, sign: float) -> Arc:
    """End of a taut string on a sprocket, turning with a sign."""
    return Arc((center[0], center[1]), radius, sign)


# --------------------------------------------------------------------------------------------------------- details

_Tangent = tuple[Number, Number, Number, bool]  # heading where it leaves, where it arrives, length, along a joint
_Where = dict[int, tuple[tuple[Arc, ...], int]]


def _chord_ratio(bend: Number) -> Number:
    """Length of chords over arcs that bend by 2 asin(b) under each."""
    bends = (bend > 0.0) & (bend < 1.0)
    if not is_true_somewhere(bends):
        return 1.0
    safe = where(bends, bend, 1.0)
    return where(bends, safe / quick_arcsin(safe), 1.0)


def _reversed_arc(arc: Arc) -> Arc:
    """Arc of a guide for a chain in the opposite direction."""
    place = arc.place + arc.slope * (arc.end - arc.begin)
    begin, end = arc.end + math.pi, arc.begin + math.pi
    return Arc(arc.center, arc.radius, 1.0, begin, end, arc.guide, place, arc.slope, arc.after, arc.before)


def _neighbor_arc(arc: Arc, known: _Where, step: int) -> Arc | None:
    """Arc before (-1) or after (1) another in its guide's run, or None."""
    if id(arc) not in known or (arc.after if step > 0 else arc.before) is None:
        return None
    run, i = known[id(arc)]
    return run[i + step]


def _tangents_or_arc(chosen: list[Arc], known: _Where) -> list[_Tangent] | tuple[int, Arc]:
    """Tangents between neighboring arcs; or an arc to take in, and its place."""
    found: list[_Tangent] = []
    for k, (one, other) in enumerate(pairwise(chosen), 1):
        if _neighbor_arc(one, known, 1) is other:
            assert one.after is not None
            found.append((one.end, one.end, one.after, True))
            continue
        dx, dy = other.center[0] - one.center[0], other.center[1] - one.center[1]
        h = other.sign * other.radius - one.sign * one.radius
        square = dx * dx + dy * dy
        if shared_value(square <= h * h):
            for arc, step in ((other, -1), (one, 1)):
                between = _neighbor_arc(arc, known, step)
                if between is not None and between is not (one if step < 0 else other):
                    return k, between
            guide = other.guide if other.guide >= 0 else one.guide
            raise TautError(guide, "stands where no tangent of the chain reaches it")
        length = sqrt(square - h * h)
        heading = arctan2(length * dy - h * dx, length * dx + h * dy)
        found.append((heading, heading, length, False))
    return found


def _arc_beyond(touches: list[GuideTouch], chosen: list[Arc], known: _Where) -> tuple[int, Arc] | None:
    """Arc, and its place, to take in where a string passes an arc's end, or None."""
    for k, touch in enumerate(touches, 1):
        for heading, step in ((touch.arrive, -1), (touch.leave, 1)):
            between = _neighbor_arc(touch.arc, known, step)
            if between is None or chosen[k + step] is between:
                continue
            if shared_value(touch.arc.is_past(heading, step > 0)):
                return k + (step > 0), between
    return None


def _deepest_cut_arc(chosen: list[Arc], tangents: list[_Tangent], runs: list[Arc]) -> tuple[int, Arc] | None:
    """Arc, and its place, that a string's tangent cuts deepest, or None."""
    worst: Number = _CUT
    found: Number = -1
    taken = {id(arc) for arc in chosen}
    places: list[tuple[int, Arc]] = []
    for k, (heading, _, length, joint) in enumerate(tangents):
        if joint:
            continue
        (x, y), (ux, uy) = chosen[k].at(heading), unit_vector(heading)
        for arc in runs:
            if id(arc) in taken:
                continue
            px, py = arc.at(arc.nearest_heading(heading))
            ahead = (px - x) * ux + (py - y) * uy
            depth = arc.sign * ((y - py) * ux - (x - px) * uy)
            cuts = (depth > worst) & (ahead > 0.0) & (ahead < length)
            worst, found = where(cuts, depth, worst), where(cuts, len(places), found)
            places.append((k + 1, arc))
    found = shared_value(found)
    return None if found < 0 else places[found]


def _string_of_tangents(
    chosen: list[Arc], tangents: list[_Tangent], touches: list[GuideTouch], runs: list[Arc]
) -> TautString:
    """Taut string of chosen arcs and tangents."""
    pieces: list[Piece] = []
    for k, (heading, _, length, _) in enumerate(tangents):
        if k:
            touch = touches[k - 1]
            arc = touch.arc
            if shared_value(touch.wrap > 0.0):
                start = arc.at(touch.arrive)
                pieces.append(Piece(start, touch.arrive, arc.sign / arc.radius, touch.wrap * arc.radius))
        if shared_value(length > 0.0):
            pieces.append(Piece(chosen[k].at(heading), heading, 0.0, length))
    free = tuple(length for _, _, length, joint in tangents if not joint)
    pressed = tuple(t for t in touches if shared_value(t.wrap > _NO_WRAP))
    order = {id(arc): i for i, arc in enumerate(runs)}
    numbers = tuple(order[id(touch.arc)] for touch in pressed)
    return TautString(tuple(pieces), tangents[0][0], tangents[-1][1], pressed, free, numbers)
