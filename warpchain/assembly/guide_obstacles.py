"""Guides as obstacles of strands: each guide's strand, and arcs of rollers' centers over its face."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warpchain.assembly.taut_string import Arc, obstacle_arcs
from warpchain.drive.face_profile import Piece, Point, Profile, unit_vector
from warpchain.drive.stack_math import (
    Number,
    arctan2,
    array_of_columns,
    maximum,
    quick_hypot,
    shared_value,
    where,
    with_last_axis,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from warpchain.model import ChainModel

OWN = 0.25
"""Farthest that a guide's strand may be behind its face, over the strand's length."""
BEHIND = 1.5
"""Factor on the distance of strands behind a guide."""

_ALONG = 0.3  # cosine between a face's chord and a strand that may be its own
_PLACES = 9  # along a face

Line = tuple[Point, Point]
Run = tuple[Arc, ...]


def turned_profile(profile: Profile, pivot: Point, angle: float) -> Profile:
    """Guide face turned about a pivot by an angle [rad]."""
    if angle == 0.0:
        return profile

    def moved_piece(piece: Piece) -> Piece:
        """The piece turned about the pivot."""
        return replace(piece, start=rotated_place(pivot, piece.start, angle), heading=piece.heading + angle)

    return replace(profile, pieces=tuple(moved_piece(piece) for piece in profile.pieces))


def profile_at(model: ChainModel, g: int, arm_angle: Sequence[float]) -> Profile:
    """Face of guide g with arms at angles (A,)."""
    arm, profile = model.arm_of(g), model.profile(g)
    while arm is not None:
        profile, arm = turned_profile(profile, model.arms[arm].pivot, float(arm_angle[arm])), model.parent(arm)
    return profile


def own_strand(model: ChainModel, g: int, strands: Sequence[Line]) -> tuple[int, bool] | None:
    """Index of guide g's strand, as drawn, and whether it runs along its pieces; or None."""
    found = nearest_strand(model, g, strands)
    if found is None:
        return None
    k, along, height = found
    (sx, sy), (ex, ey) = strands[k]
    return None if shared_value(-height > OWN * quick_hypot(sx - ex, sy - ey)) else (k, along)


def nearest_strand(model: ChainModel, g: int, strands: Sequence[Line]) -> tuple[int, bool, float] | None:
    """Index of the strand nearest to guide g, whether it runs along its pieces, and its mean height [m]; or None."""
    profile, offset = model.profile(g), model.guide_offset(g)
    length = profile.face_length
    feet = [profile.at(length * i / (_PLACES - 1)) for i in range(_PLACES)]
    rides = [(x - offset * math.sin(h), y + offset * math.cos(h)) for (x, y), h in feet]
    fx, fy = rides[-1][0] - rides[0][0], rides[-1][1] - rides[0][1]
    span = quick_hypot(fx, fy)
    nearest: Number = math.inf
    found: tuple[int, bool, float] | None = None
    for k, ((sx, sy), (ex, ey)) in enumerate(strands):
        length = quick_hypot(ex - sx, ey - sy)
        ux, uy = (ex - sx) / length, (ey - sy) / length
        cosine = (fx * ux + fy * uy) / span
        if shared_value(abs(cosine) < _ALONG):
            continue
        side = 1.0 if shared_value(cosine > 0.0) else -1.0
        count: Number = 0
        height: Number = 0.0
        for x, y in rides:
            ahead = (x - sx) * ux + (y - sy) * uy
            beside = (ahead > 0.0) & (ahead < length)
            count = count + beside
            height = height + beside * (side * ((sy - y) * ux - (sx - x) * uy))
        if shared_value(count == 0):
            continue
        height = height / maximum(count, 1)
        apart = maximum(height, -BEHIND * height)
        if shared_value(apart < nearest):
            nearest, found = apart, (k, side > 0.0, height)
    return found


def cut_depth(run: Run, line: Line) -> float:
    """Depth to which a straight strand cuts into a guide's arcs [m]; negative where clear."""
    (sx, sy), (ex, ey) = line
    heading, length = arctan2(ey - sy, ex - sx), quick_hypot(ex - sx, ey - sy)
    ux, uy = unit_vector(heading)
    deepest: Number = -math.inf
    for arc in run:
        x, y = arc.at(arc.nearest_heading(heading))
        ahead = (x - sx) * ux + (y - sy) * uy
        cut = arc.sign * ((sy - y) * ux - (sx - x) * uy)
        deepest = where((ahead > 0.0) & (ahead < length), maximum(deepest, cut), deepest)
    return deepest


@dataclass(frozen=True)
class PlacedGuide:
    """Guide, as drawn, that a strand may have to go around.

    Attributes:
        run: convex arcs over its face, in the order of the chain's travel.
        arm: the arm that carries it; None on the ground.
        pivots: of that arm and its parent arm, by arm [m].
    """

    strand: int
    run: Run
    arm: int | None
    pivots: tuple[tuple[int, Point], ...]

    def run_at(self, arm_angle: Sequence[float]) -> Run:
        """Arcs over a guide's face with the arms at angles (A,) [rad]."""
        run = self.run
        for arm, pivot in self.pivots:
            angle = arm_angle[arm]
            run = run if shared_value(angle == 0.0) else tuple(_turned_arc(arc, pivot, angle) for arc in run)
        return run


def strand_obstacles(model: ChainModel, strands: Sequence[Line]) -> tuple[PlacedGuide, ...]:
    """Guides that straight strands may have to go around, in place.

    Raises:
        UnlikeVariants: where they differ within a stack.
    """
    found: list[PlacedGuide] = []
    for g, guide in enumerate(model.guides):
        own = own_strand(model, g, strands)
        if own is None:
            continue
        k, along = own
        run, arm = obstacle_arcs(model.profile(g), model.guide_offset(g), g, along), model.arm_of(g)
        if guide.straight and arm is None:
            cut = cut_depth(run, strands[k])
            if not shared_value((0.5 * model.chain.roller_radius < cut) & (cut <= model.chain.pitch)):
                continue
        found.append(PlacedGuide(k, run, arm, arm_pivots(model, arm)))
    return tuple(found)


def has_obstructed_strand(model: ChainModel, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether any strand may have to go around a straight bar on the ground (V,).

    Args:
        start, end: of the straight strands (V, S, 2) [m].
    """
    found = np.zeros(len(start), dtype=bool)
    for g in range(len(model.guides)):
        cut = _cut_depths(model, g, start, end)
        found |= (0.5 * model.chain.roller_radius < cut) & (cut <= model.chain.pitch)
    return found


def _cut_depths(model: ChainModel, g: int, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth to which its strand cuts into straight bar g on the ground (V,) [m]; -inf without one."""
    bar, offset = model.guides[g].bar, model.guide_offset(g)
    first, last = np.atleast_2d(array_of_columns(bar.start)), np.atleast_2d(array_of_columns(bar.end))
    face = last - first
    size = np.hypot(face[:, 0], face[:, 1])
    t = face / size[:, None]
    square = _left_normals(t)
    shares = np.arange(_PLACES) / (_PLACES - 1)
    rides = (first + with_last_axis(offset) * square)[:, None, :] + shares[:, None] * face[:, None, :]

    chord = end - start
    length = np.hypot(chord[..., 0], chord[..., 1])
    u = chord / length[..., None]
    cosine = dot(t[:, None], u)
    side = np.sign(cosine)
    ahead = dot(rides[:, None] - start[:, :, None], u[:, :, None])
    height = side[..., None] * cross(u[:, :, None], start[:, :, None] - rides[:, None])
    beside = (ahead > 0.0) & (ahead < length[..., None])
    count = beside.sum(axis=-1)
    height = np.where(beside, height, 0.0).sum(axis=-1) / np.maximum(count, 1)
    runs = (np.abs(cosine) >= _ALONG) & (count > 0)
    apart = np.where(runs, np.maximum(height, -BEHIND * height), np.inf)
    own = (np.arange(len(apart)), apart.argmin(axis=1))
    mine = runs[own] & (-height[own] <= OWN * length[own])

    start, u, length, side = start[own], u[own], length[own], side[own]
    way = side[:, None] * u  # of the strand, as the bar runs
    rises = cross(t, way) > 0.0
    cut = np.full(len(apart), -np.inf)
    # an end's arc is cut first where its normal n is square to the strand, or at the other end to the bar
    for center, leaning in ((first, rises), (last, ~rises)):
        n = np.where(leaning[:, None], _left_normals(way), square)
        point = center - with_last_axis(bar.end_radius) * square + with_last_axis(bar.end_radius + offset) * n
        place = dot(point - start, u)
        depth = side * cross(u, point - start)
        cut = np.where((place > 0.0) & (place < length), np.maximum(cut, depth), cut)
    return np.where(mine, cut, -np.inf)


def _left_normals(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (..., 2) turned left by a right angle."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Dot products of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross products of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _turned_arc(arc: Arc, pivot: Point, angle: Number) -> Arc:
    """Guide's arc turned about a pivot by an angle [rad]."""
    return replace(arc, center=rotated_place(pivot, arc.center, angle), begin=arc.begin + angle, end=arc.end + angle)


def arm_pivots(model: ChainModel, arm: int | None) -> tuple[tuple[int, Point], ...]:
    """Arm and parent arm with their drawn pivots [m]."""
    found: list[tuple[int, Point]] = []
    while arm is not None:
        found.append((arm, model.arms[arm].pivot))
        arm = model.parent(arm)
    return tuple(found)


def place_on_arm(
    model: ChainModel, arm: int | None, place: Point, arm_angle: Sequence[Number]
) -> tuple[Number, Number]:
    """Drawn place on an arm, moved with arms at angles (A,) [m]."""
    found: tuple[Number, Number] = place
    for a, pivot in arm_pivots(model, arm):
        found = rotated_place(pivot, found, arm_angle[a])
    return found


def rotated_place(pivot: Point, place: Point, angle: Number) -> tuple[Number, Number]:
    """Place turned about a pivot by an angle [rad]."""
    cosine, sine = unit_vector(angle)
    x, y = place[0] - pivot[0], place[1] - pivot[1]
    return pivot[0] + cosine * x - sine * y, pivot[1] + sine * x + cosine * y
