"""Faces of guides: arcs and straight pieces with a continuous normal, and rounded ends.

The chain rides on the left. A point at u along and w left of a piece's first tangent, of curvature k (positive:
concave), has over the face the height and the place

    d = g / (1 + sqrt(1 - k g)),   g = 2 w - k (u^2 + w^2),                                                (a)
    s = atan2(k u, 1 - k w) / k,                                                                           (b)

over straight pieces d = w, s = u.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from warpchain.drive.stack_math import Number, has_arrays, quick_cos, quick_sin, where

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Point = tuple[float, float]

SHORTEST = 1e-9
"""Shortest piece of a face that is kept [m]."""
JOINT_GAP = 1e-5
"""Largest gap between a face's arcs [m]."""
ALIGN = math.radians(0.05)
"""Largest angle between a face's arcs [rad]."""


class ProfileError(ValueError):
    """A guide face that cannot be drawn.

    Attributes:
        index: point or arc at fault.
    """

    def __init__(self, index: int, text: str) -> None:
        super().__init__(text)
        self.index = index


def wrapped_angle(angle: Number) -> Number:
    """Angle between -pi and pi, or a stack's angles [rad]."""
    if not has_arrays(angle):
        return math.remainder(angle, 2.0 * math.pi)
    import numpy as np

    return angle - 2.0 * math.pi * np.rint(angle / (2.0 * math.pi))


def unit_vector(heading: Number) -> tuple[Number, Number]:
    """Unit vector of a heading, or of a stack's headings."""
    if type(heading) is float:
        return math.cos(heading), math.sin(heading)
    return quick_cos(heading), quick_sin(heading)


def _sinc(angle: Number) -> Number:
    """sin(x) / x of an angle; 1 at 0."""
    if not has_arrays(angle):
        return math.sin(angle) / angle if angle else 1.0
    safe = where(angle == 0.0, 1.0, angle)
    return where(angle == 0.0, 1.0, quick_sin(safe) / safe)


class PieceHeights(NamedTuple):
    """Places and heights (K,) of points over a face's piece, (a), (b).

    Attributes:
        along, across: u and w [m].
        place: s [m].
        height: d [m].
        root: sqrt(1 - k g).
    """

    along: NDArray[np.float64]
    across: NDArray[np.float64]
    place: NDArray[np.float64]
    height: NDArray[np.float64]
    root: NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """Arc or straight piece of a guide face.

    Attributes:
        start: [m].
        heading: of its first tangent [rad].
        curvature: [1/m], positive to the left.
        length: [m].
    """

    start: Point
    heading: float
    curvature: float
    length: float

    @property
    def end(self) -> Point:
        """Last point of a face's piece [m]."""
        return self.at(self.length)[0]

    @property
    def end_heading(self) -> float:
        """Heading of a face piece's last tangent [rad]."""
        return self.heading + self.curvature * self.length

    def at(self, s: float) -> tuple[Point, float]:
        """Point [m] and heading [rad] of a face's piece at s."""
        half = 0.5 * self.curvature * s
        chord = s * _sinc(half)
        x, y = unit_vector(self.heading + half)
        return (self.start[0] + chord * x, self.start[1] + chord * y), self.heading + 2.0 * half

    def reversed_piece(self) -> Piece:
        """The face's piece from its end to its start."""
        return Piece(self.end, self.end_heading + math.pi, -self.curvature, self.length)

    def local_coordinates(self, point: Sequence[float]) -> tuple[float, float]:
        """Coordinates u, w of a point over a face's piece [m]."""
        (x, y), (tx, ty) = self.start, unit_vector(self.heading)
        dx, dy = point[0] - x, point[1] - y
        return dx * tx + dy * ty, dy * tx - dx * ty

    def heights(self, points: NDArray[np.float64]) -> PieceHeights:
        """Places and heights of points (K, 2) over a face's piece, (a), (b)."""
        import numpy as np

        t, k = np.array(unit_vector(self.heading)), self.curvature
        r = points - np.asarray(self.start)
        u, w = r @ t, r @ np.array([-t[1], t[0]])
        g = 2.0 * w - k * (u * u + w * w)
        root = np.sqrt(np.maximum(1.0 - k * g, 0.0))
        return PieceHeights(u, w, np.arctan2(k * u, 1.0 - k * w) / k if k else u, g / (1.0 + root), root)

    def place_and_height(self, point: Sequence[float]) -> tuple[float, float]:
        """Place (b) and height (a) of a point over a face's piece [m]."""
        (u, w), k = self.local_coordinates(point), self.curvature
        g = 2.0 * w - k * (u * u + w * w)
        height = g / (1.0 + math.sqrt(max(1.0 - k * g, 0.0)))
        return (math.atan2(k * u, 1.0 - k * w) / k if k else u), height


@dataclass(frozen=True)
class Profile:
    """Face of a guide with rounded ends; the chain rides on the left.

    Places are arc lengths from the face's begin [m].

    Attributes:
        pieces: with the ends' quarter circles.
        reversed: whether they run against the drive file.
    """

    pieces: tuple[Piece, ...]
    reversed: bool = False

    @property
    def face(self) -> tuple[Piece, ...]:
        """Pieces of a guide's face without rounded ends."""
        return self.pieces[1:-1]

    @property
    def straight(self) -> bool:
        """Whether a guide's face is one straight piece."""
        return len(self.pieces) == 3 and self.pieces[1].curvature == 0.0

    @cached_property
    def places(self) -> tuple[float, ...]:
        """Places (P,) at which a face's pieces begin [m]."""
        begins = [-self.pieces[0].length]
        for piece in self.pieces[:-1]:
            begins.append(begins[-1] + piece.length if len(begins) > 1 else 0.0)
        return tuple(begins)

    @property
    def face_length(self) -> float:
        """Length of a guide's face [m]."""
        return self.places[-1]

    @property
    def end_radius(self) -> float:
        """Radius of a face's rounded ends [m]."""
        return -1.0 / self.pieces[0].curvature

    def at(self, s: float) -> tuple[Point, float]:
        """Point [m] and heading [rad] at a guide face's place."""
        i = max(bisect_right(self.places, s) - 1, 0)
        return self.pieces[i].at(s - self.places[i])

    def locate(self, point: Sequence[float]) -> tuple[float, float] | None:
        """Place and height of a point over a guide's face [m], or None."""
        found: list[tuple[float, float]] = []
        last = self.pieces[-1]
        ahead = [
            piece.local_coordinates(point)[0] for piece in (*self.pieces, Piece(last.end, last.end_heading, 0.0, 0.0))
        ]
        for i, (begin, piece) in enumerate(zip(self.places, self.pieces, strict=True)):
            if ahead[i] >= 0.0 > ahead[i + 1]:
                s, height = piece.place_and_height(point)
                found.append((begin + s, height))
        return min(found, key=lambda pair: abs(pair[1]), default=None)

    def points(self, spacing: float, caps: bool = True) -> NDArray[np.float64]:
        """Points (n, 2) along a guide's face [m].

        Args:
            spacing: largest distance of two [m].
            caps: whether rounded ends are included.
        """
        return self.offset_points(0.0, spacing, caps)

    def offset_points(self, offset: float, spacing: float, caps: bool = True) -> NDArray[np.float64]:
        """Points (n, 2) at a height over a guide's face [m].

        Args:
            spacing, caps: as of `points`.
        """
        import numpy as np

        points = []
        pieces = self.pieces if caps else self.face
        for piece in pieces:
            count = max(1, math.ceil(piece.length / spacing - 1e-9))
            places = [piece.length * i / count for i in range(count + (piece is pieces[-1]))]
            for (x, y), heading in map(piece.at, places):
                tx, ty = unit_vector(heading)
                points.append((x - offset * ty, y + offset * tx))
        return np.array(points)


# ----------------------------------------------------------------------------------------------------------- make


def make_profile(face: Iterable[Piece], end_radius: float, side: str = "left") -> Profile:
    """Face of a guide with its rounded ends.

    Args:
        side: on which the chain rides, "left" or "right".
    """
    pieces = tuple(face)
    if side == "right":
        pieces = tuple(piece.reversed_piece() for piece in reversed(pieces))
    quarter, bend = 0.5 * math.pi * end_radius, -1.0 / end_radius
    first, last = pieces[0], pieces[-1]
    before = Piece(first.start, first.heading + math.pi, -bend, quarter).reversed_piece()
    after = Piece(last.end, last.end_heading, bend, quarter)
    return Profile((before, *pieces, after), side == "right")


def straight_face(start: Point, end: Point) -> tuple[Piece, ...]:
    """Guide face of a straight bar between two points."""
    x, y = end[0] - start[0], end[1] - start[1]
    return (Piece((start[0], start[1]), math.atan2(y, x), 0.0, math.hypot(x, y)),)


def rounded_face(points: Sequence[Point], radius: float) -> tuple[Piece, ...]:
    """Guide face along points, corners rounded with a radius.

    Raises:
        ProfileError: equal neighbors, or no room for an arc.
    """
    sides: list[Piece] = []
    for i, (a, b) in enumerate(pairwise(points), 1):
        if math.dist(a, b) < SHORTEST:
            raise ProfileError(i, "must be another point than the one before")
        sides += straight_face(a, b)
    turns = [wrapped_angle(b.heading - a.heading) for a, b in pairwise(sides)]
    cuts = [radius * math.tan(0.5 * min(abs(angle), math.pi - 1e-9)) for angle in turns]
    for i, side in enumerate(sides):
        used = [cuts[c] for c in (i - 1, i) if 0 <= c < len(cuts)]
        if sum(used) > side.length * (1.0 + 1e-9):
            worst = i if i < len(cuts) and (i == 0 or cuts[i] >= cuts[i - 1]) else i - 1
            raise ProfileError(
                worst + 1,
                f"leaves no room for radius {radius:g}: its corner of {math.degrees(abs(turns[worst])):.3g} degrees "
                f"and the next need {sum(used):.4g} m of the {side.length:.4g} m between points {i} and {i + 1}",
            )
    faces: list[Piece] = []
    place = sides[0].start
    for i, side in enumerate(sides):
        before, after = (cuts[c] if 0 <= c < len(cuts) else 0.0 for c in (i - 1, i))
        faces.append(Piece(place, side.heading, 0.0, max(side.length - before - after, 0.0)))
        place = faces[-1].end
        if i < len(turns) and turns[i]:
            faces.append(Piece(place, side.heading, math.copysign(1.0 / radius, turns[i]), radius * abs(turns[i])))
            place = faces[-1].end
    return _long_pieces(faces)


def arc_face(circles: Sequence[tuple[Point, float, float, float]]) -> tuple[Piece, ...]:
    """Guide face along arcs, with straight pieces on common tangents.

    Args:
        circles: centers, radii [m], angles of entry and exit [rad].

    Raises:
        ProfileError: arcs that do not join.
    """
    faces: list[Piece] = []
    for i, (center, radius, begin, end) in enumerate(circles):
        sense = math.copysign(1.0, end - begin)
        start = (center[0] + radius * math.cos(begin), center[1] + radius * math.sin(begin))
        heading = begin + sense * 0.5 * math.pi
        if faces:
            last = faces[-1]
            gap = (start[0] - last.end[0], start[1] - last.end[1])
            ahead, aside = Piece(last.end, last.end_heading, 0.0, 1.0).local_coordinates(start)
            bend = wrapped_angle(heading - last.end_heading)
            if abs(bend) > ALIGN:
                text = f"turns by {math.degrees(bend):.3g} degrees against the end of the arc before"
                raise ProfileError(i, f"{text}; both must head the same way, within {math.degrees(ALIGN):g} degrees")
            if ahead < -JOINT_GAP or abs(aside) > max(JOINT_GAP, math.sin(ALIGN) * ahead):
                text = f"begins {math.hypot(*gap):.3g} m from the end of the arc before"
                raise ProfileError(i, f"{text}; it must begin there, or straight ahead of it, within {JOINT_GAP:g} m")
            if ahead > JOINT_GAP:
                faces.append(Piece(last.end, last.end_heading, 0.0, ahead))
            start, heading = faces[-1].end, faces[-1].end_heading
        faces.append(Piece(start, heading, sense / radius, radius * abs(end - begin)))
    return _long_pieces(faces)


def _long_pieces(pieces: Iterable[Piece]) -> tuple[Piece, ...]:
    """Pieces of a face longer than `SHORTEST`."""
    return tuple(piece for piece in pieces if piece.length > SHORTEST)
