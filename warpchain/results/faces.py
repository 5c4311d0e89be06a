"""Places of rollers on the faces of guides (`warpchain.drive.profile`): many at once, also where arms turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.profile import Profile
from warpchain.results.run import Trajectory

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def on_face(face: Profile, points: Array) -> tuple[Array, Array]:
    """Arc length along a face and height above it of points (K, 2) [m]; nan beyond its rounded ends.

    Where several pieces have a point, as at the back of a bend, the one that it is nearest to counts.
    """
    place, height = np.full(len(points), np.nan), np.full(len(points), np.inf)
    for piece, before in zip(face.pieces, face.places, strict=True):
        on = piece.rise(points)
        mine = (on.place >= 0.0) & (on.place <= piece.length) & (np.abs(on.height) < np.abs(height))
        place[mine], height[mine] = before + on.place[mine], on.height[mine]
    return place, np.where(np.isfinite(height), height, np.nan)


def tangent_at(face: Profile, place: Array) -> Array:
    """Unit tangents (K, 2) of a face at arc lengths (K,)."""
    begin, heading, curvature = (
        np.array(values)
        for values in (face.places, [p.heading for p in face.pieces], [p.curvature for p in face.pieces])
    )
    piece = np.clip(np.searchsorted(begin, place, side="right") - 1, 0, len(begin) - 1)
    heading = heading[piece] + curvature[piece] * (place - begin[piece])
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
