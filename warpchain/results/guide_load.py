"""Load of a guide: force of the chain over arc length, sliding speed, and their product p v (docs/report.md)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.face_profile import Profile
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def face_coordinates(face: Profile, points: Array) -> tuple[Array, Array]:
    """Arc lengths and heights [m] of points on a guide's face."""
    place, height = np.full(len(points), np.nan), np.full(len(points), np.inf)
    for piece, before in zip(face.pieces, face.places, strict=True):
        on = piece.heights(points)
        mine = (on.place >= 0.0) & (on.place <= piece.length) & (np.abs(on.height) < np.abs(height))
        place[mine], height[mine] = before + on.place[mine], on.height[mine]
    return place, np.where(np.isfinite(height), height, np.nan)


def face_tangents(face: Profile, place: Array) -> Array:
    """Unit tangents (K, 2) of a guide's face."""
    begin, heading, curvature = (
        np.array(values)
        for values in (face.places, [p.heading for p in face.pieces], [p.curvature for p in face.pieces])
    )
    piece = np.clip(np.searchsorted(begin, place, side="right") - 1, 0, len(begin) - 1)
    heading = heading[piece] + curvature[piece] * (place - begin[piece])
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def _values_at_contacts(
    trajectory: Trajectory, values: NDArray[np.floating], frame: Index, roller: Index
) -> NDArray[np.float64]:
    """Values (K, 2) at rollers, of a silent chain in the middles of the links after its pins, where backs touch."""
    own = np.asarray(values[frame, roller], dtype=float)
    if not trajectory.model.chain.is_silent:
        return own
    return 0.5 * (own + values[frame, (roller + 1) % values.shape[1]])


def rollers_in_guide_frame(trajectory: Trajectory, g: int, frame: Index, roller: Index) -> tuple[Array, Array]:
    """Contacts of rollers (K, 2) [m] in a guide's frame, and angle (K,)."""
    (position,) = require_channels(trajectory, "position")
    x = _values_at_contacts(trajectory, position, frame, roller)
    arm = trajectory.model.arm_of(g)
    if arm is None or trajectory.arm_angle is None:
        return x, np.zeros(len(x))
    angle = np.asarray(trajectory.arm_angle, dtype=float)[frame, arm]
    drawn, c, s = np.asarray(trajectory.model.arms[arm].pivot, dtype=float), np.cos(angle), np.sin(angle)
    r = x - arm_pivots(trajectory.model, trajectory.time, trajectory.arm_angle)[frame, arm]
    return drawn + np.stack([c * r[:, 0] + s * r[:, 1], c * r[:, 1] - s * r[:, 0]], axis=-1), angle


STRETCHES_A_PITCH = 4


class GuideContacts(NamedTuple):
    """Contacts of rollers with a guide in a recording."""

    frame: Index  # (K,)
    roller: Index  # (K,)
    place: Array  # (K,) arc length along the face; beyond it on the rounded ends [m]
    force: Array  # (K,) normal force [N]
    speed: Array  # (K,) of the chain along the face [m/s]; 0 without recorded velocities


def recorded_guide_contacts(trajectory: Trajectory) -> list[GuideContacts]:
    """Contacts of rollers with each guide in a recording.

    Raises:
        SimulationError: recorded without positions or guide forces.
    """
    _, guide_force = require_channels(trajectory, "position", "guide_force")
    model = trajectory.model
    frame, roller = np.nonzero(guide_force > 0.0)
    force = np.asarray(guide_force, dtype=float)[frame, roller]
    v = np.zeros((len(frame), 2))
    if trajectory.velocity is not None:
        v = _values_at_contacts(trajectory, trajectory.velocity, frame, roller)
    faces = [model.profile(g) for g in range(len(model.guides))]
    seen = [rollers_in_guide_frame(trajectory, g, frame, roller) for g in range(len(faces))]
    places = [face_coordinates(face, points) for face, (points, _) in zip(faces, seen, strict=True)]
    off = [np.abs(height - model.guide_offset(g)) for g, (_, height) in enumerate(places)]
    nearest = np.argmin(np.nan_to_num(off, nan=np.inf), axis=0) if off else np.zeros(len(frame), dtype=np.intp)
    found = []
    for g, face in enumerate(faces):
        mine = (nearest == g) & np.isfinite(places[g][0])
        place, angle = places[g][0][mine], seen[g][1][mine]
        t = face_tangents(face, place)
        c, s = np.cos(angle), np.sin(angle)
        along = v[mine, 0] * (c * t[:, 0] - s * t[:, 1]) + v[mine, 1] * (s * t[:, 0] + c * t[:, 1])
        found.append(GuideContacts(frame[mine], roller[mine], place, force[mine], along))
    return found


class GuideLoad(NamedTuple):
    """Load of a guide in B stretches of its length."""

    place: Array  # (B,) middles of the stretches [m]
    mean: Array  # (B,) mean normal force per length, p [N/m]
    peak: Array  # (B,) largest force of one roller [N]
    speed: Array  # (B,) mean sliding speed, weighted by force [m/s]
    pv: Array  # (B,) mean of p v [W/m]
    pv_peak: Array  # (B,) largest force of a roller times its speed, over the pitch [W/m]
    touching: float  # share of the frames at which a roller presses


def guide_load_by_stretch(contacts: GuideContacts, frames: int, edges: Array, pitch: float) -> GuideLoad:
    """Load of a guide in stretches between `edges` [m]."""
    count, widths = len(edges) - 1, np.diff(edges)
    inside = (contacts.place >= edges[0]) & (contacts.place <= edges[-1])
    stretch = np.minimum(np.searchsorted(edges, contacts.place[inside], side="right") - 1, count - 1)
    force, speed = contacts.force[inside], np.abs(contacts.speed[inside])
    total, work = (np.bincount(stretch, values, minlength=count) for values in (force, force * speed))
    peak, hottest = np.zeros(count), np.zeros(count)
    np.maximum.at(peak, stretch, force)
    np.maximum.at(hottest, stretch, force * speed / pitch)
    rate = np.where(total > 0.0, work / np.where(total > 0.0, total, 1.0), np.nan)
    touching = len(np.unique(contacts.frame)) / max(frames, 1)
    scale = max(frames, 1) * widths
    return GuideLoad(0.5 * (edges[:-1] + edges[1:]), total / scale, peak, rate, work / scale, hottest, touching)


def guide_loads(trajectory: Trajectory, contacts: list[GuideContacts] | None = None) -> list[GuideLoad]:
    """Load of each guide in a recording."""
    model = trajectory.model
    found = []
    for g, mine in enumerate(recorded_guide_contacts(trajectory) if contacts is None else contacts):
        face = model.profile(g)
        first, last = face.places[0], face.places[-1] + face.pieces[-1].length
        stretches = max(8, round(STRETCHES_A_PITCH * face.face_length / model.chain.pitch))
        width = face.face_length / stretches
        before, after = int(np.ceil(-first / width)), int(np.ceil((last - face.face_length) / width))
        edges = np.arange(-before, stretches + after + 1) * np.float64(width)
        found.append(guide_load_by_stretch(mine, len(trajectory.time), edges, model.chain.pitch))
    return found
