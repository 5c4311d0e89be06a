"""Chain path: pitch circles joined by common tangents, with wrapped angles and straight strands.

A chain that turns with sign w (+1 counter-clockwise) about a sprocket at c with pitch radius R leaves it along the unit
vector u, of left normal n, at c - w R n. For the strand of length S from sprocket k to l, with D = c_l - c_k and D' = D
turned by +90 degrees,

    D = S u + h n,   h = w_l R_l - w_k R_k,                                  (a)
    S = sqrt(|D|^2 - h^2),   u = (S D - h D') / |D|^2.                       (b)

A strand into which guides reach is a taut string (`assembly.taut_string`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from itertools import combinations, product
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.guide_obstacles import PlacedGuide, Run, has_obstructed_strand, place_on_arm, strand_obstacles
from warpchain.assembly.taut_string import Arc, TautError, TautString, circle_end, runs_under_links, taut_string
from warpchain.drive.plate import top_radius
from warpchain.drive.stack_math import (
    Condition,
    Number,
    UnlikeVariants,
    arctan2,
    array_of_columns,
    has_arrays,
    is_true_somewhere,
    maximum,
    minimum,
    pairwise_sum,
    rint,
    sqrt,
    table_of_columns,
    where,
)
from warpchain.errors import DriveError
from warpchain.model.mounts import initial_place
from warpchain.model.stacks import pick_variants, variant_count

if TYPE_CHECKING:
    from warpchain.model import ChainModel

MAX_STRAIN = 0.05
"""Largest nominal strain, taut or slack, of a chain that fits its path."""

FEW = 16
"""Least drives with chains on guides that are faster as a stack than alone."""

Found = TypeVar("Found")
Item = TypeVar("Item")
Pair = tuple[Number, Number]
"""Two coordinates, each a number or an array (V,)."""

_NO_WRAP = 1e-9  # rad


@dataclass(frozen=True)
class ChainPath:
    """Path of a chain on pitch circles and common tangents; strand k leaves sprocket k of S and reaches the next.

    Paths of V variants have a first axis more.

    Attributes:
        pitch: mean unloaded length of the links [m].
        radius: (S,) at which rollers ride [m]: pitch radii, or more for a worn chain.
        wrap_angle: (S,) heading that leaves less heading that arrives [rad], in (0, 2 pi).
        arrival_angle: (S,) polar angles about sprocket centers at which the path arrives [rad].
        turning: counter-clockwise angle of one round [rad]: +-2 pi of a plain loop or open chain, 0 of a crossed pair.
        center: (S, 2) sprockets [m].
        strand_start: (S, 2) where strand k leaves sprocket k [m].
        strand_end: (S, 2) where it reaches the next [m].
        strand_length: (S,) on guides by chords [m], 0 of an open chain's gap.
        wrapped_pitches: sum of wrapped angle over pitch angle.
        nominal_strain: of the strands' links; infinite where wrapped arcs alone take more links.
        strings: (S,) taut string of strand k; None where straight.
        obstacles: (S,) guides that strand k meets or could meet.
        arm_angle: (A,) [rad].
    """

    pitch: float
    radius: NDArray[np.float64]
    wrap_angle: NDArray[np.float64]
    arrival_angle: NDArray[np.float64]
    turning: float
    center: NDArray[np.float64]
    strand_start: NDArray[np.float64]
    strand_end: NDArray[np.float64]
    strand_length: NDArray[np.float64]
    wrapped_pitches: float
    nominal_strain: float
    strings: tuple[TautString | None, ...]
    obstacles: tuple[tuple[Run, ...], ...]
    arm_angle: NDArray[np.float64]

    def __getitem__(self, variants: int | NDArray[np.int64]) -> ChainPath:
        """Chain paths of chosen variants of a stack."""
        guided = {name: pick_variants(getattr(self, name), variants) for name in ("strings", "obstacles")}
        own = guided | {
            field.name: getattr(self, field.name)[variants] for field in fields(self) if field.name not in guided
        }
        if not isinstance(variants, np.ndarray):
            own |= {name: float(own[name]) for name in ("pitch", "turning", "wrapped_pitches", "nominal_strain")}
        return replace(self, **own)

    def free_lengths(self, k: int) -> tuple[float, ...]:
        """Lengths of strand k's parts on no guide, in order [m]."""
        string = self.strings[k]
        return (float(self.strand_length[k]),) if string is None else string.free

    def strain(self, links: int) -> float:
        """Nominal strain of a path's strands for a number of links; infinite where wrapped arcs take them.

        It solves wrapped pitches + sum(strand length) / (pitch (1 + strain)) = links.
        """
        free = links - self.wrapped_pitches
        return float(self.strand_length.sum()) / self.pitch / free - 1.0 if free > 0.0 else math.inf

    def fitting_links(self) -> tuple[int, ...]:
        """Numbers of links whose nominal strain is within `MAX_STRAIN`, ascending."""
        straight = float(self.strand_length.sum()) / self.pitch
        fewest = math.ceil(self.wrapped_pitches + straight / (1.0 + MAX_STRAIN))
        most = math.floor(self.wrapped_pitches + straight / (1.0 - MAX_STRAIN))
        return tuple(links for links in range(fewest, most + 1) if abs(self.strain(links)) <= MAX_STRAIN)


def path_at(model: ChainModel, arm_angle: Sequence[float]) -> ChainPath:
    """Chain path with arms at angles (A,); the number of links need not fit.

    Raises:
        DriveError: pitch circles that overlap, a sprocket without wrap or with a chain that meets itself, or a strand
            through another sprocket.
    """
    return PathPlan(model).path(arm_angle)[0]


def results_in_parts(
    model: ChainModel, count: int, worked_out: Callable[[ChainModel], Found]
) -> list[tuple[NDArray[np.int64], Found]]:
    """Results of a function of a stack, by variants (K,): all at once, `UnlikeVariants` apart."""
    try:
        return [(np.arange(count), worked_out(model))]
    except UnlikeVariants as parted:
        way = parted.way
    assert len(way) == count  # or variants would be lost
    found = []
    for value in np.unique(way):
        mine = np.flatnonzero(way == value)
        parts = results_in_parts(pick_variants(model, mine), len(mine), worked_out)
        found += [(mine[places], part) for places, part in parts]
    return found


def allowed_results(
    model: ChainModel, count: int, worked_out: Callable[[ChainModel], Found]
) -> list[tuple[NDArray[np.int64], Found]]:
    """Results of a function of a stack, by variants (K,), without those that it refuses."""
    try:
        return results_in_parts(model, count, worked_out)
    except DriveError:
        if count == 1:
            return []
    found = []
    for half in np.array_split(np.arange(count), 2):
        parts = allowed_results(pick_variants(model, half), len(half), worked_out)
        found += [(half[places], part) for places, part in parts]
    return found


@dataclass(frozen=True)
class PathValues:
    """Values of a chain path as numbers or arrays (V,), in lists (S,) or alone."""

    pitch: Number
    center: list[Pair]
    wrap: list[Number]
    arriving: list[Number]  # headings
    start: list[Pair]
    end: list[Pair]
    length: list[Number]
    wrapped_pitches: Number
    nominal_strain: Number
    strings: tuple[TautString | None, ...]
    obstacles: tuple[tuple[Run, ...], ...]


class PathPlan:
    """Part of a chain path that arm angles do not change: pitch circles, tangents, guides as drawn.

    Raises:
        DriveError: pitch circles that overlap; of the first such variant.
        UnlikeVariants: variants unlike on guides, or too few.
    """

    def __init__(self, model: ChainModel) -> None:
        sprockets = model.sprockets
        self.model, self.variants = model, variant_count(model)
        pitch = np.atleast_2d(model.chain.pulled_lengths)[:, : model.chain.links].mean(axis=-1)
        self.pitch = pitch if len(pitch) > 1 else float(pitch[0])
        self.center = [initial_place(sprocket) for sprocket in sprockets]
        self.carrier = [model.carrier(s) for s in range(len(sprockets))]
        self.radius = [model.riding_radius(s) for s in range(len(sprockets))]
        self.sign = [float(sprocket.sign) for sprocket in sprockets]
        self.strands = len(sprockets) - model.chain.is_open  # the gap of an open chain is none
        self.teeth = [float(sprocket.teeth) for sprocket in sprockets]
        _check_tips(model, self.radius)
        self.lines = self._common_tangents(self.center)
        self.placed = self._obstacles()
        self.ends = self._pitch_circles(self.center)
        self.known: dict[int, TautString | None] = {}  # the strings that no arm can move, once they are found

    def _common_tangents(self, center: Sequence[Pair]) -> list[_StraightStrand]:
        """Common tangents of pitch circles about centers."""
        _check_apart(self.model, center, self.radius)
        arms = [w * r for w, r in zip(self.sign, self.radius, strict=True)]
        return [
            _common_tangent(one, other, arm, following)
            for (one, arm), (other, following) in _neighbor_pairs(zip(center, arms, strict=True))
        ]

    def _pitch_circles(self, center: Sequence[Pair]) -> list[Arc]:
        """Pitch circles of strands that may have to go around guides."""
        if not self.placed:
            return []
        return [circle_end(c, r, w) for c, r, w in zip(center, self.radius, self.sign, strict=True)]

    def _plan_at_angles(self, arm_angle: Sequence[Number]) -> PathPlan:
        """Path plan with sprockets moved by arms at angles (A,)."""
        if all(a is None for a in self.carrier):
            return self
        at = copy(self)
        at.center = [
            place if a is None else place_on_arm(self.model, a, place, arm_angle)
            for place, a in zip(self.center, self.carrier, strict=True)
        ]
        at.lines, at.ends = at._common_tangents(at.center), at._pitch_circles(at.center)
        return at

    def _obstacles(self) -> tuple[PlacedGuide, ...]:
        """Guides that strands of the path may have to go around."""
        model = self.model
        if not model.guides:
            return ()
        bars = all(guide.straight and guide.arm is None for guide in model.guides)
        if self.variants > 1 and bars:
            start, end = (self._point_array([getattr(line, name) for line in self.lines]) for name in ("start", "end"))
            which = has_obstructed_strand(model, start, end)
            if not which.any():
                return ()
            raise UnlikeVariants(np.where(which, np.arange(1, self.variants + 1), 0))
        if 1 < self.variants < FEW:
            raise UnlikeVariants(np.arange(self.variants))
        return strand_obstacles(model, [(line.start, line.end) for line in self.lines[: self.strands]])

    def path_values(self, arm_angle: Sequence[Number]) -> PathValues:
        """Values of the chain path with arms at angles (A,).

        Raises:
            DriveError: as `path_at`.
            UnlikeVariants: chains that touch unlike arcs of guides.
        """
        return self._plan_at_angles(arm_angle)._path_values(arm_angle)

    def _path_values(self, arm_angle: Sequence[Number]) -> PathValues:
        """Values of the chain path, sprockets on arms already in place."""
        sign, strands = self.sign, range(len(self.sign))
        start, end = [line.start for line in self.lines], [line.end for line in self.lines]
        length = [line.length for line in self.lines]
        leaving = [line.heading for line in self.lines]
        arriving = [leaving[k - 1] for k in strands]
        met: list[tuple[Run, ...]] = [
            tuple(placed.run_at(arm_angle) for placed in self.placed if placed.strand == k) for k in strands
        ]
        strings = tuple(self._string(k, runs) for k, runs in enumerate(met))
        for k, string in enumerate(strings):
            if k == self.strands:
                length[k] = 0.0 * length[k]
            if string is not None:
                following = (k + 1) % len(strings)
                leaving[k], arriving[following] = string.first, string.last
                start[k], end[k] = self.ends[k].at(string.first), self.ends[following].at(string.last)
                length[k] = string.chain_length(self.pitch)
        turned = zip(sign, leaving, arriving, strict=True)
        wrap = [w * (leave - arrive) % (2.0 * math.pi) for w, leave, arrive in turned]
        if self.model.chain.is_open:
            wrap[0], wrap[-1] = 0.0 * wrap[0], 0.0 * wrap[-1]
        _check_wraps(self.model, wrap, [2.0 * math.pi / z for z in self.teeth])
        _check_clear(self, start, length, [k for k in strands[: self.strands] if strings[k] is None])
        wrapped = pairwise_sum([angle * z for angle, z in zip(wrap, self.teeth, strict=True)]) / (2.0 * math.pi)
        strain = _nominal_strain(self.model.chain.links, wrapped, pairwise_sum(length[: self.strands]) / self.pitch)
        return PathValues(
            self.pitch, self.center, wrap, arriving, start, end, length, wrapped, strain, strings, tuple(met)
        )

    def path(self, arm_angle: Sequence[Number]) -> ChainPath:
        """Chain path with arms at angles (A,), with the first axis of a stack.

        Raises:
            DriveError, UnlikeVariants: as `path_values`.
        """
        course, variants = self.path_values(arm_angle), self.variants
        turned = pairwise_sum([w * angle for w, angle in zip(self.sign, course.wrap, strict=True)]) / (2.0 * math.pi)
        turns = where(turned < 0.0, -1.0, 1.0) if self.model.chain.is_open else rint(turned)
        arrival = [angle - w * (0.5 * math.pi) for angle, w in zip(course.arriving, self.sign, strict=True)]
        own = course.pitch, 2.0 * math.pi * turns, course.wrapped_pitches, course.nominal_strain
        pitch, turning, wrapped, strain = (np.broadcast_to(value, variants) for value in own)
        return ChainPath(
            pitch=pitch,  # type: ignore[arg-type]  # (V,), as are the others
            radius=table_of_columns(self.radius, variants),
            wrap_angle=table_of_columns(course.wrap, variants),
            arrival_angle=table_of_columns(arrival, variants),
            turning=turning,  # type: ignore[arg-type]
            center=self._point_array(course.center),
            strand_start=self._point_array(course.start),
            strand_end=self._point_array(course.end),
            strand_length=table_of_columns(course.length, variants),
            wrapped_pitches=wrapped,  # type: ignore[arg-type]
            nominal_strain=strain,  # type: ignore[arg-type]
            strings=course.strings,
            obstacles=course.obstacles,
            arm_angle=np.broadcast_to(array_of_columns(arm_angle), (variants, len(arm_angle))),
        )

    def _point_array(self, points: Sequence[Pair]) -> NDArray[np.float64]:
        """Array (V, S, 2) of a path's S pairs of coordinates."""
        return table_of_columns([part for pair in points for part in pair], self.variants).reshape(self.variants, -1, 2)

    def _string(self, k: int, runs: tuple[Run, ...]) -> TautString | None:
        """Taut string of strand k around its guides; None where straight."""
        if not runs:
            return None
        if k not in self.known:
            following = (k + 1) % len(self.ends)
            string = _taut_string(self.model, self.ends[k], self.ends[following], runs)
            moved = self.carrier[k] is not None or self.carrier[following] is not None
            if moved or any(placed.strand == k and placed.arm is not None for placed in self.placed):
                return string
            self.known[k] = string
        return self.known[k]


def _taut_string(model: ChainModel, first: Arc, last: Arc, runs: tuple[Run, ...]) -> TautString | None:
    """Taut string of a strand from arc to arc, None where it touches no guide.

    Raises:
        DriveError: a guide in its way.
    """
    try:
        string = taut_string(first, last, runs)
        if model.chain.is_silent:
            string = taut_string(first, last, runs_under_links(runs, string.touches, model.chain.pitch), string.numbers)
    except TautError as error:
        raise DriveError(f"guides.{model.guides[error.guide].name}: {error}") from None
    return string if string.touches else None


def check_fit(model: ChainModel, path: ChainPath) -> None:
    """Raises a DriveError, with link counts that fit, for a nominal strain beyond `MAX_STRAIN`."""
    wrong = np.atleast_1d(~(np.abs(path.nominal_strain) <= MAX_STRAIN))
    if not wrong.any():
        return
    path = path[int(wrong.argmax())] if path.radius.ndim > 1 else path
    fitting = path.fitting_links()
    best = round(path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch)
    if fitting:
        best = min(fitting, key=lambda links: abs(path.strain(links)))
        span = f"{fitting[0]} to {fitting[-1]}, best {best}" if len(fitting) > 1 else str(best)
    else:
        span = "none"
    nearest = ", ".join(f"{links}: {_percent_text(path.strain(links))}" for links in (best - 1, best, best + 1))
    crossing = ""
    if abs(path.turning) != 2.0 * math.pi:
        most = int(np.argmax(path.wrap_angle))
        crossing = (
            f"; the path crosses itself, turning {math.degrees(path.wrap_angle[most]):.4g} degrees around sprocket "
            f'"{model.sprockets[most].name}": look at its center and wrap'
        )
    raise DriveError(
        f"chain.links = {model.chain.links}: does not fit the path, strain {_percent_text(path.nominal_strain)}, "
        f"allowed is {-100.0 * MAX_STRAIN:g} % to {100.0 * MAX_STRAIN:+g} %; links that fit: {span} "
        f"(strain by links: {nearest}){crossing}"
    )


@dataclass(frozen=True)
class _StraightStrand:
    """Straight strand: unit vector, heading [rad], ends and length [m]; numbers, or arrays (V,)."""

    direction: Pair
    heading: Number
    start: Pair
    end: Pair
    length: Number


def _common_tangent(one: Pair, other: Pair, arm: Number, following: Number) -> _StraightStrand:
    """Common tangent of two circles with signed radii w R, (a), (b)."""
    dx, dy = other[0] - one[0], other[1] - one[1]
    h = following - arm
    square = dx * dx + dy * dy
    length = sqrt(square - h * h)
    ux, uy = (length * dx + h * dy) / square, (length * dy - h * dx) / square
    start = one[0] + arm * uy, one[1] - arm * ux
    end = other[0] + following * uy, other[1] - following * ux
    return _StraightStrand((ux, uy), arctan2(uy, ux), start, end, length)


def _nominal_strain(links: int, wrapped: Number, straight: Number) -> Number:
    """Nominal strain of a path's strands for a number of links, () or (V,)."""
    free = links - wrapped
    if not has_arrays(free):
        return straight / free - 1.0 if free > 0.0 else math.inf
    with np.errstate(divide="ignore"):
        return np.where(free > 0.0, straight / free - 1.0, math.inf)


def _variant_number(value: Number, v: int) -> float:
    """Number of a stack's variant v, from a number or array (V,)."""
    return float(value[v]) if isinstance(value, np.ndarray) else float(value)


def _percent_text(strain: float) -> str:
    """Text of a strain in percent."""
    return f"{100.0 * strain:+.3f} %" if math.isfinite(strain) else "too short to go round"


def _neighbor_pairs(values: Iterable[Item]) -> Iterator[tuple[Item, Item]]:
    """Pairs of values around a chain's path, the last with the first."""
    items = list(values)
    return zip(items, items[1:] + items[:1], strict=True)


def _first_variant(condition: Condition) -> int | None:
    """First variant of a stack for which a condition holds, or None."""
    return int(np.argmax(condition)) if is_true_somewhere(condition) else None


def _check_tips(model: ChainModel, radius: Sequence[Number]) -> None:
    """Raises a DriveError where rollers or toes of long links ride over a sprocket's tips."""
    for s, sprocket in enumerate(model.sprockets):
        if sprocket.is_end:
            continue
        tips = model.tip_radius(s)
        if model.chain.is_silent:
            tips = top_radius(model.chain.plate, sprocket.teeth, model.sprocket_pitch(s))
        v = _first_variant(radius[s] > tips)
        if v is not None:
            tip = _variant_number(tips, v)
            limit = 2.0 * tip * math.sin(math.pi / sprocket.teeth)
            link, at = _variant_number(model.chain.worn_pitch, v), _variant_number(radius[s], v)
            raise DriveError(
                f'sprocket "{sprocket.name}": links of {link:.6g} m would ride over its '
                f"tips, at {at:.6g} m against {tip:.6g} m; allowed are links of at most {limit:.6g} m"
            )


def _check_apart(model: ChainModel, center: Sequence[Pair], radius: Sequence[Number]) -> None:
    """Raises a DriveError where pitch circles overlap."""
    for a, b in combinations(range(len(center)), 2):
        dx, dy = center[b][0] - center[a][0], center[b][1] - center[a][1]
        square, reach = dx * dx + dy * dy, radius[a] + radius[b]
        v = _first_variant(square <= reach * reach)
        if v is not None:
            first, second = model.sprockets[a].name, model.sprockets[b].name
            if model.sprockets[a].is_end or model.sprockets[b].is_end:
                raise DriveError(
                    f'sprockets "{first}" and "{second}": an end of the chain lies at or within the other; allowed is '
                    f"a distance of more than {_variant_number(reach, v):.6g} m"
                )
            raise DriveError(
                f'sprockets "{first}" and "{second}": pitch circles overlap, no tangent joins them; their centers are '
                f"{math.sqrt(_variant_number(square, v)):.6g} m apart, allowed is more than the sum of pitch radii, "
                f"{_variant_number(reach, v):.6g} m"
            )


def _check_wraps(model: ChainModel, wrap: Sequence[Number], pitch_angle: Sequence[float]) -> None:
    """Raises a DriveError where a sprocket's wrap is none, or over a turn less a pitch."""
    for s, sprocket in enumerate(model.sprockets):
        if sprocket.is_end:
            continue
        v = _first_variant((wrap[s] < _NO_WRAP) | (wrap[s] > 2.0 * math.pi - pitch_angle[s]))
        if v is not None:
            degrees = math.degrees(_variant_number(wrap[s], v))
            allowed = 360.0 - math.degrees(pitch_angle[s])
            raise DriveError(
                f'sprocket "{sprocket.name}": with wrap = "{sprocket.wrap}" the chain turns {degrees:.4g} degrees '
                f"around it, allowed is more than 0 and at most {allowed:.4g}; it stands on the other side of the "
                f"chain's path, or its wrap is the other one"
            )


def _check_clear(plan: PathPlan, start: Sequence[Pair], length: Sequence[Number], free: Sequence[int]) -> None:
    """Raises a DriveError where a strand of those in `free` passes through another sprocket."""
    model, count = plan.model, len(plan.lines)
    for k, s in product(free, range(count)):
        if s in (k, (k + 1) % count):
            continue
        (x, y), (ux, uy), radius = start[k], plan.lines[k].direction, plan.radius[s]
        dx, dy = plan.center[s][0] - x, plan.center[s][1] - y
        along = minimum(maximum(dx * ux + dy * uy, 0.0), length[k])
        gx, gy = dx - along * ux, dy - along * uy
        if is_true_somewhere(gx * gx + gy * gy < radius * radius):
            raise DriveError(
                f'strand "{model.strand_names[k]}": passes through the pitch circle of sprocket '
                f'"{model.sprockets[s].name}"; allowed is a path clear of the other sprockets'
            )
