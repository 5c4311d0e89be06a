"""Sprocket or guide nearest to each roller of a recording, and direction of its contact force."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.results.guide_load import face_coordinates, face_tangents, rollers_in_guide_frame
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class ContactForces(NamedTuple):
    """Contact forces on K rollers of a recording."""

    frame: Index  # (K,)
    roller: Index  # (K,)
    force: Array  # (K, 2) [N]


def roller_contact_forces(trajectory: Trajectory, least: float = 0.0) -> tuple[ContactForces, ContactForces]:
    """Contact forces above `least` [N] of sprockets, and of guides."""
    sprocket_force, guide_force = require_channels(trajectory, "sprocket_force", "guide_force")
    frame, roller = np.nonzero(sprocket_force > least)
    near, _ = nearest_sprockets_of_rollers(trajectory, frame, roller)
    normals = np.zeros((len(frame), 2))
    for s in range(len(trajectory.model.sprockets)):
        on = near == s
        normals[on] = sprocket_normals(trajectory, s, frame[on], roller[on])
    sprockets = ContactForces(frame, roller, normals * np.asarray(sprocket_force, float)[frame, roller, None])
    frame, roller = np.nonzero(guide_force > least)
    _, normals = nearest_guides_of_rollers(trajectory, frame, roller)
    guides = ContactForces(frame, roller, normals * np.asarray(guide_force, float)[frame, roller, None])
    return sprockets, guides


def nearest_sprockets_of_rollers(trajectory: Trajectory, frame: Index, roller: Index) -> tuple[Index, Array]:
    """Nearest sprocket (K,) of each roller, and distance [m]."""
    position, sprocket_center = require_channels(trajectory, "position", "sprocket_center")
    x = np.asarray(position, dtype=float)[frame, roller]
    near, apart = np.zeros(len(frame), dtype=np.intp), np.full(len(frame), np.inf)
    for s in range(len(trajectory.model.sprockets)):
        r = x - sprocket_center[frame, s]
        off = np.abs(np.sqrt(r[:, 0] ** 2 + r[:, 1] ** 2) - trajectory.model.pitch_radius(s))
        closer = off < apart
        near[closer], apart[closer] = s, off[closer]
    return near, apart


def sprocket_normals(trajectory: Trajectory, s: int, frame: Index | None = None, roller: Index | None = None) -> Array:
    """Unit vectors (K, 2) of a sprocket's contact forces."""
    model, tooth = trajectory.model, trajectory.model.tooth(s)
    position, sprocket_center, sprocket_angle = require_channels(
        trajectory, "position", "sprocket_center", "sprocket_angle"
    )
    if frame is None:
        frame = np.arange(len(trajectory.time))[:, None]
    if roller is None:
        roller = np.arange(model.chain.rollers)
    pitch_angle = 2.0 * math.pi / model.sprockets[s].teeth
    r = np.asarray(position, dtype=float)[frame, roller] - sprocket_center[frame, s]
    turned = np.asarray(sprocket_angle, dtype=float)[frame, s]
    seat = np.rint((np.arctan2(r[..., 1], r[..., 0]) - turned) / pitch_angle) * pitch_angle + turned
    c, d = np.cos(seat), np.sin(seat)
    xi, eta = r[..., 0] * c + r[..., 1] * d - model.pitch_radius(s), r[..., 1] * c - r[..., 0] * d
    outward, lateral = tooth.normal(xi, eta, model.chain.roller_radius)
    return np.stack([outward * c - lateral * d, outward * d + lateral * c], axis=-1)


def nearest_guides_of_rollers(trajectory: Trajectory, frame: Index, roller: Index) -> tuple[Index, Array]:
    """Nearest guide (K,) of each roller, and normal (K, 2)."""
    count = len(frame)
    near, normals, apart = np.zeros(count, dtype=np.intp), np.zeros((count, 2)), np.full(count, np.inf)
    for g in range(len(trajectory.model.guides)):
        face = trajectory.model.profile(g)
        points, angle = rollers_in_guide_frame(trajectory, g, frame, roller)
        place, height = face_coordinates(face, points)
        off = np.abs(height - trajectory.model.guide_offset(g))
        closer = np.nan_to_num(off, nan=np.inf) < apart
        t, c, s = face_tangents(face, place[closer]), np.cos(angle[closer]), np.sin(angle[closer])
        normals[closer] = np.stack([-t[:, 1] * c - t[:, 0] * s, t[:, 0] * c - t[:, 1] * s], axis=1)
        near[closer], apart[closer] = g, off[closer]
    return near, normals


def engaged_sprockets(trajectory: Trajectory, rollers: Index | None = None) -> Index:
    """Sprocket (F, N) that each roller engages, -1 for none."""
    model = trajectory.model
    which = np.arange(model.chain.rollers) if rollers is None else rollers
    frame, roller = np.meshgrid(np.arange(len(trajectory.time)), which, indexing="ij")
    near, apart = nearest_sprockets_of_rollers(trajectory, frame.ravel(), roller.ravel())
    band = np.array([model.engagement(s) for s in range(len(model.sprockets))])
    return np.where(apart < band[near], near, -1).reshape(frame.shape)


def contact_force_vectors(trajectory: Trajectory) -> tuple[Array, Array]:
    """Contact forces (F, N, 2) [N] of sprockets, and of guides."""
    (position,) = require_channels(trajectory, "position")
    both = []
    for arrows in roller_contact_forces(trajectory):
        vectors = np.zeros(position.shape)
        vectors[arrows.frame, arrows.roller] = arrows.force
        both.append(vectors)
    return both[0], both[1]
