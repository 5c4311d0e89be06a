"""Measured guide faces: a smooth line through points, and pairs of arcs (biarcs) along it.

Arcs with tangents T_0, T_1 at P_0, P_1 join at J = (P_0 + P_1 + d (T_0 - T_1)) / 2 (Bolton 1975), v = P_1 - P_0,

    2 (1 - T_0.T_1) d^2 + 2 v.(T_0 + T_1) d - v.v = 0.                                                     (a)

The line is a cubic spline (Dierckx 1993).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from warpchain.drive.face_profile import SHORTEST, Piece, Point, ProfileError, straight_face, unit_vector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TOLERANCE = 1e-5
"""Largest distance of a face from its points [m]."""
_SAMPLES = 12
"""Places between two points to compare arcs at."""


def biarc(start: Point, heading: float, end: Point, end_heading: float) -> tuple[Piece, Piece]:
    """Biarc: pair of arcs between two points with given headings, (a)."""
    (ax, ay), (bx, by) = unit_vector(heading), unit_vector(end_heading)
    vx, vy = end[0] - start[0], end[1] - start[1]
    along = vx * (ax + bx) + vy * (ay + by)
    square = vx * vx + vy * vy
    apart = 2.0 * (1.0 - (ax * bx + ay * by))
    d = square / (along + math.sqrt(along * along + apart * square))
    joint = (0.5 * (start[0] + end[0] + d * (ax - bx)), 0.5 * (start[1] + end[1] + d * (ay - by)))
    first = _arc_between(start, heading, joint)
    return first, _arc_between(joint, first.end_heading, end)


def _arc_between(start: Point, heading: float, end: Point) -> Piece:
    """Arc of a biarc from a heading point to another."""
    u, w = Piece(start, heading, 0.0, 0.0).local_coordinates(end)
    half = math.atan2(w, u)
    chord = math.hypot(u, w)
    length = chord * (half / math.sin(half) if half else 1.0)
    return Piece(start, heading, 2.0 * half / length if length else 0.0, length)


def fitted_face(points: Sequence[Point], tolerance: float = TOLERANCE) -> tuple[Piece, ...]:
    """Guide face along measured points in order, within a tolerance [m].

    Raises:
        ProfileError: neighbors are one point.
    """
    import numpy as np

    places = np.array(points, dtype=float)
    steps = np.hypot(*np.diff(places, axis=0).T)
    if (steps < SHORTEST).any():
        raise ProfileError(int(np.argmin(steps >= SHORTEST)) + 1, "must be another point than the one before")
    if len(points) == 2:
        return straight_face(points[0], points[1])
    samples, headings = _spline_samples(places, steps, 0.5 * tolerance)
    pieces: list[Piece] = []
    a = 0
    while a < len(samples) - 1:
        b = _farthest_sample(samples, headings, a, 0.5 * tolerance)
        pieces += _biarc_of_samples(samples, headings, a, b)
        a = b
    return tuple(piece for piece in pieces if piece.length > SHORTEST)


def _spline_samples(
    places: NDArray[np.float64], steps: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (M, 2) [m] and headings (M,) [rad] of a measured face's spline."""
    import numpy as np
    from scipy.interpolate import splev, splprep

    over = np.concatenate([[0.0], np.cumsum(steps)])
    degree = min(3, len(places) - 1)
    for share in (1.0, 0.5, 0.25, 0.1, 0.0):  # a sum of squares bounds no single point: as smooth as will do
        square = len(places) * (share * tolerance) ** 2
        (spline, _), *_ = splprep(places.T, u=over, k=degree, s=square, full_output=True)  # which says no warnings
        if np.hypot(*(np.array(splev(over, spline)) - places.T)).max() <= tolerance:
            break
    fine = np.interp(np.arange((len(over) - 1) * _SAMPLES + 1) / _SAMPLES, np.arange(len(over)), over)
    samples, slopes = np.array(splev(fine, spline)).T, splev(fine, spline, der=1)
    return samples, np.unwrap(np.arctan2(slopes[1], slopes[0]))


def _biarc_of_samples(
    samples: NDArray[np.float64], headings: NDArray[np.float64], a: int, b: int
) -> tuple[Piece, Piece]:
    """Biarc between samples a and b of a measured face's spline."""
    (ax, ay), (bx, by) = samples[a].tolist(), samples[b].tolist()
    return biarc((ax, ay), float(headings[a]), (bx, by), float(headings[b]))


def _farthest_sample(samples: NDArray[np.float64], headings: NDArray[np.float64], a: int, tolerance: float) -> int:
    """Last sample of a face's spline that a biarc from sample a reaches."""

    def follows(b: int) -> bool:
        """Whether a biarc to sample `b` keeps the tolerance."""
        if abs(headings[b] - headings[a]) > 0.5 * math.pi:
            return False
        return _largest_deviation(_biarc_of_samples(samples, headings, a, b), samples[a : b + 1]) <= tolerance

    last = len(samples) - 1
    good, step = a + 1, 1  # neighboring samples are joined whatever comes
    while good < last and follows(min(good + step, last)):
        good, step = min(good + step, last), 2 * step
    bad = min(good + step, last + 1)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if follows(middle) else (good, middle)
    return good


def _largest_deviation(pair: tuple[Piece, Piece], samples: NDArray[np.float64]) -> float:
    """Largest distance of spline samples from a biarc [m]."""
    import numpy as np

    heights = []
    for piece in pair:
        tx, ty = unit_vector(piece.heading)
        dx, dy = (samples - np.array(piece.start)).T
        u, w, k = dx * tx + dy * ty, dy * tx - dx * ty, piece.curvature
        g = 2.0 * w - k * (u * u + w * w)
        heights.append((u, np.abs(g / (1.0 + np.sqrt(np.maximum(1.0 - k * g, 0.0))))))
    (_, first), (ahead, second) = heights
    return float(np.where(ahead >= 0.0, second, first).max())
