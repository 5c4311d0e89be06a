"""Places on a guide's face: arc length along it and height above it, for faces of straight pieces and arcs.

The chain rides on the left of the pieces' direction. With r the way from a piece's start to a point, u and w its parts
along and to the left of the piece's first tangent, and k the curvature (positive where it turns left):

    g = 2 w - k (u^2 + w^2),   height d = g / (1 + sqrt(1 - k g)),   arc length s = atan2(k u, 1 - k w) / k     (a)

which is w and u themselves for a straight piece. A piece has the points between the normals at its two ends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.results.run import Trajectory

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Face(NamedTuple):
    """The surface of a guide: P pieces, each continuing the one before in place and heading.

    Attributes:
        start: (P, 2) where pieces begin [m].
        heading: (P,) of their first tangents [rad].
        curvature: (P,) [1/m], positive where they turn left.
        length: (P,) [m].
        place: (P,) arc length at which they begin, 0 where the face itself does: the first end is before it [m].
    """

    start: Array
    heading: Array
    curvature: Array
    length: Array
    place: Array

    @property
    def face_length(self) -> float:
        """From the first rounded end to the last [m]."""
        return float(self.place[-1])


def face_of(drive: Drive, g: int) -> Face:
    """The face of guide g in the coordinates of the drawing: its pieces and both rounded ends."""
    profile = drive.profile(g)
    return Face(
        start=np.array([piece.start for piece in profile.pieces]),
        heading=np.array([piece.heading for piece in profile.pieces]),
        curvature=np.array([piece.curvature for piece in profile.pieces]),
        length=np.array([piece.length for piece in profile.pieces]),
        place=np.array(profile.places),
    )


def on_face(face: Face, points: Array) -> tuple[Array, Array]:
    """Arc length along a face and height above it (a) of points (K, 2) [m]; nan beyond its ends.

    Where several pieces have a point, as at the back of a bend, the one that it is nearest to counts.
    """
    place, height = np.full(len(points), np.nan), np.full(len(points), np.inf)
    for start, heading, k, length, before in zip(*face, strict=True):
        t = np.array([math.cos(heading), math.sin(heading)])
        r = points - start
        u, w = r @ t, r @ np.array([-t[1], t[0]])
        if k == 0.0:
            s, d = u, w
        else:
            square = 2.0 * w - k * (u * u + w * w)
            s = np.arctan2(k * u, 1.0 - k * w) / k
            d = square / (1.0 + np.sqrt(np.maximum(1.0 - k * square, 0.0)))
        mine = (s >= 0.0) & (s <= length) & (np.abs(d) < np.abs(height))
        place[mine], height[mine] = before + s[mine], d[mine]
    return place, np.where(np.isfinite(height), height, np.nan)


def tangent_at(face: Face, place: Array) -> Array:
    """Unit tangents (K, 2) of a face at arc lengths (K,)."""
    piece = np.clip(np.searchsorted(face.place, place, side="right") - 1, 0, len(face.place) - 1)
    heading = face.heading[piece] + face.curvature[piece] * (place - face.place[piece])
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def on_guide_frame(trajectory: Trajectory, g: int, frame: Index, roller: Index) -> tuple[Array, Array]:
    """Rollers (K,) at frames (K,) in the coordinates in which guide g is drawn (K, 2) [m], and its angle (K,) [rad].

    A guide on an arm turns with it about its pivot; the others stay where they are.
    """
    assert trajectory.position is not None
    x = np.asarray(trajectory.position, dtype=float)[frame, roller]
    arm = trajectory.drive.arm_of(g)
    if arm is None or trajectory.arm_angle is None:
        return x, np.zeros(len(x))
    angle = np.asarray(trajectory.arm_angle, dtype=float)[frame, arm]
    pivot, c, s = np.asarray(trajectory.drive.arms[arm].pivot, dtype=float), np.cos(angle), np.sin(angle)
    r = x - pivot
    return pivot + np.stack([c * r[:, 0] + s * r[:, 1], c * r[:, 1] - s * r[:, 0]], axis=-1), angle
