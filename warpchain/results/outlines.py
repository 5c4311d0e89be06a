"""Outlines of a drive's parts for pictures: teeth, guides, arms, tensioners and chain, where they stand."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.path import ChainPath
from warpchain.drive.face_profile import Profile
from warpchain.drive.tooth_shape import teeth_outline
from warpchain.model import ChainModel
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.plate_outlines import wheel_outline
from warpchain.results.run import Trajectory

Array = NDArray[np.float64]


class DrivePose(NamedTuple):
    """Pose of a drive's bodies at an instant."""

    center: Array  # (S, 2) of the sprockets [m]
    angle: Array  # (S,) of the sprockets [rad]
    arm: Array  # (A,) angles of the arms [rad]
    pivot: Array | None = None  # (A, 2) of the arms [m]; None is as drawn


class OutlinePart(NamedTuple):
    """Outline of a drive's part for pictures."""

    kind: str  # "teeth", "guide", "arm", "spring", "housing" or "plunger"
    name: str  # of the sprocket, guide, arm or tensioner; of a spring that of its arm
    points: Array  # (P, 2) [m]
    carried: bool = False  # whether an arm or a tensioned sprocket carries it


def pose_at_start(model: ChainModel, path: ChainPath | None = None) -> DrivePose:
    """Pose of a drive's bodies as assembled, chain unloaded.

    Raises:
        DriveError: as of `chain_path`.
    """
    path = chain_path(model) if path is None else path
    arms = np.zeros(len(model.arms))
    for a in range(len(arms)):
        arms[a] = sum(path.arm_angle[on] for on in (a, model.parent(a)) if on is not None)
    rims = np.array([sprocket.rim is not None for sprocket in model.sprockets])
    center = np.where(rims[:, None], [sprocket.center for sprocket in model.sprockets], path.center)
    return DrivePose(center, np.zeros(len(center)), arms, arm_pivots(model, [0.0], arms[None])[0])


def pose_at_frame(trajectory: Trajectory, f: int) -> DrivePose:
    """Pose of a drive's bodies at a recording's frame."""
    values = (getattr(trajectory, name) for name in ("sprocket_center", "sprocket_angle", "arm_angle"))
    start = pose_at_start(trajectory.model)[:3]
    center, angle, arm = (
        own if of is None else np.asarray(of[f], dtype=float) for of, own in zip(values, start, strict=True)
    )
    return DrivePose(center, angle, arm, arm_pivots(trajectory.model, trajectory.time[f, None], arm[None])[0])


def chain_line(model: ChainModel, points: NDArray[Any]) -> NDArray[Any]:
    """Line (..., P + 1, 2) of the chain through points, closed unless open."""
    first = points.shape[-2] - 1 if model.chain.is_open else 0
    return np.concatenate([points, points[..., first : first + 1, :]], axis=-2)


def chain_outline(model: ChainModel, path: ChainPath) -> Array:
    """Line (P, 2) [m] of the chain's path."""
    spacing, line = 0.25 * model.chain.pitch, []
    for s, sprocket in enumerate(model.sprockets):
        count = math.ceil(path.wrap_angle[s] * path.radius[s] / spacing) + 1
        angles = path.arrival_angle[s] + sprocket.sign * np.linspace(0.0, path.wrap_angle[s], count)
        line.append(path.center[s] + path.radius[s] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        string = path.strings[s]
        if string is not None:
            line.append(Profile(string.pieces).points(spacing))
    return chain_line(model, np.concatenate(line))


def teeth_parts(model: ChainModel, pose: DrivePose, arc_points: int = 9) -> list[OutlinePart]:
    """Outlines of sprockets' teeth in a pose."""
    turns = zip(model.sprockets, pose.center, pose.angle, strict=True)
    return [
        OutlinePart(
            "teeth", sprocket.name, turn_points(tooth_outline(model, s, arc_points), (0.0, 0.0), angle) + center
        )
        for s, (sprocket, center, angle) in enumerate(turns)
    ]


def points_on_arm(model: ChainModel, pose: DrivePose, a: int, points: Array) -> Array:
    """Points (..., 2) [m] on a posed arm."""
    drawn = model.arms[a].pivot
    return turn_points(points, drawn, pose.arm[a]) + (0.0 if pose.pivot is None else pose.pivot[a] - np.asarray(drawn))


def guide_arm_tensioner_parts(model: ChainModel, pose: DrivePose) -> list[OutlinePart]:
    """Outlines of guides, arms and tensioners in a pose."""
    parts = []
    for g, guide in enumerate(model.guides):
        outline, a = guide_outline(model, g), model.arm_of(g)
        moved = outline if a is None else points_on_arm(model, pose, a, outline)
        parts.append(OutlinePart("guide", guide.name, moved, a is not None))
    for a, arm in enumerate(model.arms):
        parts += [
            OutlinePart("arm", arm.name, points_on_arm(model, pose, a, line), True) for line in arm_outline(model, a)
        ]
    for a, arm in enumerate(model.arms):
        if arm.spring is not None:
            at, anchor = (np.asarray(end, dtype=float) for end in (arm.spring.at, arm.spring.anchor))
            on = model.parent(a)
            held = anchor + (0.0 if pose.pivot is None else pose.pivot[a] - np.asarray(arm.pivot))
            held = held if on is None else points_on_arm(model, pose, on, anchor)
            parts.append(OutlinePart("spring", arm.name, coil_outline(held, points_on_arm(model, pose, a, at)), True))
    for t, tensioner in enumerate(model.tensioners):
        housing, plunger = tensioner_outline(model, t)
        body, at = model.tensioner_body(t), np.asarray(tensioner.at, dtype=float)
        if body < len(model.sprockets):
            way = pose.center[body] - model.sprockets[body].center
        else:
            a = body - model.first_arm_body
            way = points_on_arm(model, pose, a, at) - at
        along = np.array(tensioner.unit_direction)
        parts.append(OutlinePart("plunger", tensioner.name, plunger + (way @ along) * along, True))
        parts.append(OutlinePart("housing", tensioner.name, housing))
    return parts


def tooth_outline(model: ChainModel, s: int, arc_points: int = 9) -> Array:
    """Closed outline (P, 2) [m] of a sprocket's teeth, or an end."""
    if model.sprockets[s].is_end:
        turn = np.linspace(0.0, 2.0 * math.pi, 12 * arc_points + 1)
        return (model.sprockets[s].rim or model.chain.roller_radius) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    teeth = model.sprockets[s].teeth
    if model.chain.is_silent:
        return wheel_outline(model.chain.plate, teeth, model.sprocket_pitch(s), arc_points)
    return teeth_outline(model.tooth(s), teeth, model.pitch_radius(s), arc_points)


def guide_outline(model: ChainModel, g: int) -> Array:
    """Outline (P, 2) [m] of a guide, as drawn."""
    if not model.guides[g].straight:
        return model.profile(g).points(model.chain.pitch / 12)
    bar = model.guides[g].bar
    start, end = np.asarray(bar.start, dtype=float), np.asarray(bar.end, dtype=float)
    t = (end - start) / np.hypot(*(end - start))
    n = np.array([-t[1], t[0]])
    angle = np.linspace(0.0, 0.5 * math.pi, 12)[:, None]
    radius = bar.end_radius
    before = start - radius * n + radius * (np.cos(angle) * n - np.sin(angle) * t)
    after = end - radius * n + radius * (np.cos(angle) * n + np.sin(angle) * t)
    return np.vstack([before[::-1], after])


def arm_outline(model: ChainModel, a: int) -> list[Array]:
    """Lines (2, 2) [m] of an arm, as drawn."""
    arm, faces = model.arms[a], [model.profile(g).face for g in model.guides_of(a)]
    ends = [end for face in faces for end in (face[0].start, face[-1].end)]
    ends += [model.sprockets[s].center for s in model.sprockets_on(a)]
    ends += [tensioner.at for tensioner in model.tensioners if tensioner.on == arm.name]
    return [np.array([arm.pivot, end], dtype=float) for end in ends]


COILS = 6


def coil_outline(begin: Array, end: Array) -> Array:
    """Zigzag line (P, 2) [m] of a coil spring."""
    way = end - begin
    across = 0.08 * np.array([-way[1], way[0]])
    sides = np.tile([1.0, -1.0], COILS)
    along = np.linspace(0.2, 0.8, len(sides))
    turns = begin + along[:, None] * way + sides[:, None] * across
    return np.vstack([begin, begin + 0.17 * way, turns, begin + 0.83 * way, end])


def tensioner_outline(model: ChainModel, k: int) -> tuple[Array, Array]:
    """Outlines (5, 2) [m] of a tensioner's housing and plunger."""
    tensioner = model.tensioners[k]
    plunger = tensioner.plunger
    wide = model.chain.pitch if plunger is None or plunger.diameter is None else plunger.diameter
    along = np.asarray(tensioner.direction, dtype=float)
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])

    def rectangle(begin: float, end: float, half: float) -> Array:
        """Closed rectangle (5, 2) [m] along the tensioner."""
        corners = ((begin, -half), (end, -half), (end, half), (begin, half), (begin, -half))
        return np.array([np.asarray(tensioner.at) + u * along + w * across for u, w in corners])

    return rectangle(-3.0 * wide, -wide, 0.8 * wide), rectangle(-2.0 * wide, 0.0, 0.5 * wide)


def turn_points(points: Array, pivot: tuple[float, float], angle: float) -> Array:
    """Points (..., 2) turned about a pivot, counter-clockwise."""
    c, d, center = math.cos(angle), math.sin(angle), np.asarray(pivot, dtype=float)
    return np.asarray((points - center) @ np.array([[c, d], [-d, c]]) + center)
