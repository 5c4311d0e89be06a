"""Which guides lie on which strand, and as what obstacles the chain then meets them.

A guide belongs to the strand that runs nearest to its face, as drawn and with straight strands: by the mean height of
the strand over the places where rollers would ride, those that the strand has behind it counting more. It must run
roughly along that strand and not stand farther into it than a quarter of the strand's length.

A straight bar on the ground that the straight strand only presses on is left to settling: up to half a roller's radius,
the depth to which contacts take a roller for one that rides. Beyond a pitch such a bar is a mistake of the layout, as
`warpchain.assembly.layout` tells, and the strand is drawn straight as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from warpchain.assembly.taut import Arc, obstacle
from warpchain.drive.profile import Piece, Point, Profile, direction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from warpchain.drive import Drive

OWN = 0.25
"""A guide's own strand is no farther behind its face than this share of the strand's length."""
BEHIND = 1.5
"""How much farther a strand counts that is behind a guide, when its own strand, the nearest, is looked for."""

_ALONG = 0.3  # cosine between a face's chord and a strand that may be its own
_PLACES = 9  # along a face

Line = tuple[Point, Point]
Run = tuple[Arc, ...]


def turned(profile: Profile, pivot: Point, angle: float) -> Profile:
    """A face turned about a pivot by an angle [rad]."""
    if angle == 0.0:
        return profile
    cosine, sine = direction(angle)

    def moved(piece: Piece) -> Piece:
        x, y = piece.start[0] - pivot[0], piece.start[1] - pivot[1]
        start = (pivot[0] + cosine * x - sine * y, pivot[1] + sine * x + cosine * y)
        return replace(piece, start=start, heading=piece.heading + angle)

    return replace(profile, pieces=tuple(moved(piece) for piece in profile.pieces))


def standing_profile(drive: Drive, g: int, arm_angle: Sequence[float]) -> Profile:
    """The face of guide g where its arm stands at its angle [rad]."""
    arm, profile = drive.arm_of(g), drive.profile(g)
    return profile if arm is None else turned(profile, drive.arms[arm].pivot, float(arm_angle[arm]))


def own_strand(drive: Drive, g: int, strands: Sequence[Line]) -> tuple[int, bool] | None:
    """The strand on which guide g lies and whether it travels along the face's pieces; None for no strand.

    Args:
        drive: the drive.
        g: the guide, as drawn.
        strands: ends of the straight strands [m].
    """
    found = nearest_strand(drive, g, strands)
    if found is None:
        return None
    k, along, height = found
    return None if -height > OWN * math.dist(*strands[k]) else (k, along)


def nearest_strand(drive: Drive, g: int, strands: Sequence[Line]) -> tuple[int, bool, float] | None:
    """The strand nearest to guide g, whether it travels along the face's pieces, and its mean height [m].

    Heights are over where rollers would ride, negative behind the face; None where no strand runs along it.
    """
    profile, offset = drive.profile(g), drive.guide_offset(g)
    feet = [profile.at(profile.face_length * i / (_PLACES - 1)) for i in range(_PLACES)]
    rides = [(x - offset * math.sin(h), y + offset * math.cos(h)) for (x, y), h in feet]
    fx, fy = rides[-1][0] - rides[0][0], rides[-1][1] - rides[0][1]
    nearest = math.inf
    found: tuple[int, bool, float] | None = None
    for k, ((sx, sy), (ex, ey)) in enumerate(strands):
        length = math.hypot(ex - sx, ey - sy)
        ux, uy = (ex - sx) / length, (ey - sy) / length
        cosine = (fx * ux + fy * uy) / math.hypot(fx, fy)
        if abs(cosine) < _ALONG:
            continue
        side = math.copysign(1.0, cosine)
        beside = [(x, y) for x, y in rides if 0.0 < (x - sx) * ux + (y - sy) * uy < length]
        if not beside:
            continue
        height = sum(side * ((sy - y) * ux - (sx - x) * uy) for x, y in beside) / len(beside)
        apart = max(height, -BEHIND * height)
        if apart < nearest:
            nearest, found = apart, (k, side > 0.0, height)
    return found


def depth(run: Run, line: Line) -> float:
    """How deep a straight strand cuts into an obstacle [m]; negative where it passes clear of it."""
    (sx, sy), (ex, ey) = line
    heading, length = math.atan2(ey - sy, ex - sx), math.hypot(ex - sx, ey - sy)
    ux, uy = direction(heading)
    deepest = -math.inf
    for arc in run:
        x, y = arc.at(arc.held(heading))
        if 0.0 < (x - sx) * ux + (y - sy) * uy < length:
            deepest = max(deepest, arc.sign * ((sy - y) * ux - (sx - x) * uy))
    return deepest


@dataclass(frozen=True)
class Placed:
    """A guide that a strand may have to go around, as drawn.

    Attributes:
        strand: its strand.
        run: convex arcs over its face, in the order of the chain's travel.
        arm: the arm that carries it; None on the ground.
        pivot: of that arm [m].
    """

    strand: int
    run: Run
    arm: int | None
    pivot: Point

    def standing(self, arm_angle: Sequence[float]) -> Run:
        """The arcs where the arms stand at angles (A,) [rad]."""
        angle = 0.0 if self.arm is None else float(arm_angle[self.arm])
        return self.run if angle == 0.0 else tuple(_turned(arc, self.pivot, angle) for arc in self.run)


def obstacles(drive: Drive, strands: Sequence[Line]) -> tuple[Placed, ...]:
    """The guides that strands may have to go around; mostly none.

    Args:
        drive: the drive.
        strands: ends of the straight strands [m].
    """
    found: list[Placed] = []
    for g, guide in enumerate(drive.guides):
        own = own_strand(drive, g, strands)
        if own is None:
            continue
        k, along = own
        run, arm = obstacle(drive.profile(g), drive.guide_offset(g), g, along), drive.arm_of(g)
        if guide.straight and arm is None:
            cut = depth(run, strands[k])
            if not 0.5 * drive.chain.roller_radius < cut <= drive.chain.pitch:
                continue
        found.append(Placed(k, run, arm, (0.0, 0.0) if arm is None else drive.arms[arm].pivot))
    return tuple(found)


def _turned(arc: Arc, pivot: Point, angle: float) -> Arc:
    """An arc turned about a pivot by an angle [rad]."""
    cosine, sine = direction(angle)
    x, y = arc.center[0] - pivot[0], arc.center[1] - pivot[1]
    center = (pivot[0] + cosine * x - sine * y, pivot[1] + sine * x + cosine * y)
    begin, end = arc.begin + angle, arc.end + angle
    return Arc(center, arc.radius, arc.sign, begin, end, arc.guide, arc.place, arc.slope, arc.before, arc.after)
