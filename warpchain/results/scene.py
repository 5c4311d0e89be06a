"""Geometry for pictures of a drive: its parts where they stand, contact directions, displacement of a strand."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.assembly import assembled_path
from warpchain.assembly.path import ChainPath
from warpchain.drive import Drive
from warpchain.drive.face_profile import Profile
from warpchain.drive.tooth_shape import teeth_outline
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.guide_load import face_coordinates, face_tangents, rollers_in_guide_frame
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FRAMES_AT_ONCE = 4096
"""Frames that are worked on together, so that long recordings need little memory beside themselves."""


class ContactForces(NamedTuple):
    """Contact forces on K rollers, in order of frames.

    Attributes:
        frame, roller: (K,) when and where.
        force: (K, 2) the forces [N].
    """

    frame: Index
    roller: Index
    force: Array


class DrivePose(NamedTuple):
    """Places of a drive's bodies at an instant.

    Attributes:
        center: (S, 2) of the sprockets [m].
        angle: (S,) of the sprockets [rad].
        arm: (A,) angles of the arms [rad].
        pivot: (A, 2) of the arms [m]; None is as drawn.
    """

    center: Array
    angle: Array
    arm: Array
    pivot: Array | None = None


class OutlinePart(NamedTuple):
    """A line of a picture of a drive.

    Attributes:
        kind: "teeth", "guide", "arm", "housing" or "plunger".
        name: of the sprocket, guide, arm or tensioner.
        points: (P, 2) [m].
        carried: whether an arm or a tensioned sprocket takes it along.
    """

    kind: str
    name: str
    points: Array
    carried: bool = False


def pose_at_start(drive: Drive, path: ChainPath | None = None) -> DrivePose:
    """Pose of a drive's bodies around the path of the unloaded chain, sprockets at angle zero.

    Args:
        drive: the drive.
        path: of its chain; None works it out.

    Raises:
        DriveError: as `chain_path`.
    """
    path = chain_path(drive) if path is None else path
    arms = np.zeros(len(drive.arms))
    for a in range(len(arms)):
        arms[a] = sum(path.arm_angle[on] for on in (a, drive.parent(a)) if on is not None)
    return DrivePose(path.center, np.zeros(len(path.center)), arms, arm_pivots(drive, [0.0], arms[None])[0])


def pose_at_frame(trajectory: Trajectory, f: int) -> DrivePose:
    """Pose of a drive's bodies at a frame; those that were not recorded are where the run began."""
    values = (getattr(trajectory, name) for name in ("sprocket_center", "sprocket_angle", "arm_angle"))
    start = pose_at_start(trajectory.drive)[:3]
    center, angle, arm = (
        own if of is None else np.asarray(of[f], dtype=float) for of, own in zip(values, start, strict=True)
    )
    return DrivePose(center, angle, arm, arm_pivots(trajectory.drive, trajectory.time[f, None], arm[None])[0])


def chain_outline(drive: Drive, path: ChainPath) -> Array:
    """Path of the chain as a closed line (P, 2) [m], around sprockets and guides, points a quarter pitch apart."""
    spacing, line = 0.25 * drive.chain.pitch, []
    for s, sprocket in enumerate(drive.sprockets):
        count = math.ceil(path.wrap_angle[s] * path.radius[s] / spacing) + 1
        angles = path.arrival_angle[s] + sprocket.sign * np.linspace(0.0, path.wrap_angle[s], count)
        line.append(path.center[s] + path.radius[s] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        string = path.strings[s]
        if string is not None:
            line.append(Profile(string.pieces).points(spacing))
    return np.concatenate([*line, line[0][:1]])


def teeth_parts(drive: Drive, pose: DrivePose, arc_points: int = 9) -> list[OutlinePart]:
    """Closed outlines of the sprockets' teeth, where the sprockets stand."""
    turns = zip(drive.sprockets, pose.center, pose.angle, strict=True)
    return [
        OutlinePart(
            "teeth", sprocket.name, turn_points(tooth_outline(drive, s, arc_points), (0.0, 0.0), angle) + center
        )
        for s, (sprocket, center, angle) in enumerate(turns)
    ]


def points_on_arm(drive: Drive, pose: DrivePose, a: int, points: Array) -> Array:
    """Points (..., 2) [m] of arm a, given as drawn, where it stands."""
    drawn = drive.arms[a].pivot
    return turn_points(points, drawn, pose.arm[a]) + (0.0 if pose.pivot is None else pose.pivot[a] - np.asarray(drawn))


def guide_arm_tensioner_parts(drive: Drive, pose: DrivePose) -> list[OutlinePart]:
    """Outlines of guides, arms and tensioners, where the bodies stand."""
    parts = []
    for g, guide in enumerate(drive.guides):
        outline, a = guide_outline(drive, g), drive.arm_of(g)
        moved = outline if a is None else points_on_arm(drive, pose, a, outline)
        parts.append(OutlinePart("guide", guide.name, moved, a is not None))
    for a, arm in enumerate(drive.arms):
        parts += [
            OutlinePart("arm", arm.name, points_on_arm(drive, pose, a, line), True) for line in arm_outline(drive, a)
        ]
    for t, tensioner in enumerate(drive.tensioners):
        housing, plunger = tensioner_outline(drive, t)
        body, at = drive.tensioner_body(t), np.asarray(tensioner.at, dtype=float)
        if body < len(drive.sprockets):
            way = pose.center[body] - drive.sprockets[body].center
        else:
            a = body - drive.first_arm_body
            way = points_on_arm(drive, pose, a, at) - at
        along = np.array(tensioner.unit_direction)
        parts.append(OutlinePart("plunger", tensioner.name, plunger + (way @ along) * along, True))
        parts.append(OutlinePart("housing", tensioner.name, housing))
    return parts


def tooth_outline(drive: Drive, s: int, arc_points: int = 9) -> Array:
    """Closed outline of sprocket s's teeth at angle zero about its center (P, 2) [m]: seat arcs, flanks and tips."""
    return teeth_outline(drive.tooth(s), drive.sprockets[s].teeth, drive.pitch_radius(s), arc_points)


def guide_outline(drive: Drive, g: int) -> Array:
    """Outline of guide g (P, 2) [m] as drawn: its face and both rounded ends."""
    if not drive.guides[g].straight:
        return drive.profile(g).points(drive.chain.pitch / 12)
    bar = drive.guides[g].bar
    start, end = np.asarray(bar.start, dtype=float), np.asarray(bar.end, dtype=float)
    t = (end - start) / np.hypot(*(end - start))
    n = np.array([-t[1], t[0]])
    angle = np.linspace(0.0, 0.5 * math.pi, 12)[:, None]
    radius = bar.end_radius
    before = start - radius * n + radius * (np.cos(angle) * n - np.sin(angle) * t)
    after = end - radius * n + radius * (np.cos(angle) * n + np.sin(angle) * t)
    return np.vstack([before[::-1], after])


def arm_outline(drive: Drive, a: int) -> list[Array]:
    """Lines (2, 2) [m] of arm a as drawn, from its pivot to its guides' ends, its sprockets and tensioners."""
    arm, faces = drive.arms[a], [drive.profile(g).face for g in drive.guides_of(a)]
    ends = [end for face in faces for end in (face[0].start, face[-1].end)]
    ends += [drive.sprockets[s].center for s in drive.sprockets_on(a)]
    ends += [tensioner.at for tensioner in drive.tensioners if tensioner.on == arm.name]
    return [np.array([arm.pivot, end], dtype=float) for end in ends]


def tensioner_outline(drive: Drive, k: int) -> tuple[Array, Array]:
    """Closed outlines of housing (5, 2) and plunger (5, 2) [m] of tensioner k as drawn."""
    tensioner = drive.tensioners[k]
    plunger = tensioner.plunger
    wide = drive.chain.pitch if plunger is None or plunger.diameter is None else plunger.diameter
    along = np.asarray(tensioner.direction, dtype=float)
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])

    def rectangle(begin: float, end: float, half: float) -> Array:
        """Closed rectangle (5, 2) [m] along a tensioner's direction."""
        corners = ((begin, -half), (end, -half), (end, half), (begin, half), (begin, -half))
        return np.array([np.asarray(tensioner.at) + u * along + w * across for u, w in corners])

    return rectangle(-3.0 * wide, -wide, 0.8 * wide), rectangle(-2.0 * wide, 0.0, 0.5 * wide)


def turn_points(points: Array, pivot: tuple[float, float], angle: float) -> Array:
    """Points (..., 2) turned counter-clockwise about a pivot."""
    c, d, center = math.cos(angle), math.sin(angle), np.asarray(pivot, dtype=float)
    return np.asarray((points - center) @ np.array([[c, d], [-d, c]]) + center)


def roller_contact_forces(trajectory: Trajectory, least: float = 0.0) -> tuple[ContactForces, ContactForces]:
    """Contact forces on the rollers that are above `least` [N]: those of sprockets, those of guide-bars."""
    sprocket_force, guide_force = require_channels(trajectory, "sprocket_force", "guide_force")
    frame, roller = np.nonzero(sprocket_force > least)
    near, _ = nearest_sprockets_of_rollers(trajectory, frame, roller)
    normals = np.zeros((len(frame), 2))
    for s in range(len(trajectory.drive.sprockets)):
        on = near == s
        normals[on] = sprocket_normals(trajectory, s, frame[on], roller[on])
    sprockets = ContactForces(frame, roller, normals * np.asarray(sprocket_force, float)[frame, roller, None])
    frame, roller = np.nonzero(guide_force > least)
    _, normals = nearest_guides_of_rollers(trajectory, frame, roller)
    guides = ContactForces(frame, roller, normals * np.asarray(guide_force, float)[frame, roller, None])
    return sprockets, guides


def nearest_sprockets_of_rollers(trajectory: Trajectory, frame: Index, roller: Index) -> tuple[Index, Array]:
    """Sprocket whose pitch circle each of K rollers is nearest to (K,), and how far it is from that circle [m]."""
    position, sprocket_center = require_channels(trajectory, "position", "sprocket_center")
    x = np.asarray(position, dtype=float)[frame, roller]
    near, apart = np.zeros(len(frame), dtype=np.intp), np.full(len(frame), np.inf)
    for s in range(len(trajectory.drive.sprockets)):
        r = x - sprocket_center[frame, s]
        off = np.abs(np.sqrt(r[:, 0] ** 2 + r[:, 1] ** 2) - trajectory.drive.pitch_radius(s))
        closer = off < apart
        near[closer], apart[closer] = s, off[closer]
    return near, apart


def sprocket_normals(trajectory: Trajectory, s: int, frame: Index | None = None, roller: Index | None = None) -> Array:
    """Direction of the contact force of sprocket s on rollers, wherever they are: that of the nearest gap's surface.

    Args:
        trajectory: with positions, sprocket angles and sprocket centers.
        s: the sprocket.
        frame, roller: (K,) which frames and rollers; None is all of them.

    Returns:
        (K, 2) unit vectors, or (F, N, 2) of all frames and rollers.
    """
    drive, tooth = trajectory.drive, trajectory.drive.tooth(s)
    position, sprocket_center, sprocket_angle = require_channels(
        trajectory, "position", "sprocket_center", "sprocket_angle"
    )
    if frame is None:
        frame = np.arange(len(trajectory.time))[:, None]
    if roller is None:
        roller = np.arange(drive.chain.links)
    pitch_angle = 2.0 * math.pi / drive.sprockets[s].teeth
    r = np.asarray(position, dtype=float)[frame, roller] - sprocket_center[frame, s]
    turned = np.asarray(sprocket_angle, dtype=float)[frame, s]
    seat = np.rint((np.arctan2(r[..., 1], r[..., 0]) - turned) / pitch_angle) * pitch_angle + turned
    c, d = np.cos(seat), np.sin(seat)
    xi, eta = r[..., 0] * c + r[..., 1] * d - drive.pitch_radius(s), r[..., 1] * c - r[..., 0] * d
    outward, lateral = tooth.normal(xi, eta, drive.chain.roller_radius)
    return np.stack([outward * c - lateral * d, outward * d + lateral * c], axis=-1)


def nearest_guides_of_rollers(trajectory: Trajectory, frame: Index, roller: Index) -> tuple[Index, Array]:
    """Guide whose face each of K rollers at frames (K,) is nearest to (K,), and the face's normal there (K, 2).

    By the height of the roller's center over the face less that at which it touches; 0 normals beyond all faces.
    """
    count = len(frame)
    near, normals, apart = np.zeros(count, dtype=np.intp), np.zeros((count, 2)), np.full(count, np.inf)
    for g in range(len(trajectory.drive.guides)):
        face = trajectory.drive.profile(g)
        points, angle = rollers_in_guide_frame(trajectory, g, frame, roller)
        place, height = face_coordinates(face, points)
        off = np.abs(height - trajectory.drive.guide_offset(g))
        closer = np.nan_to_num(off, nan=np.inf) < apart
        t, c, s = face_tangents(face, place[closer]), np.cos(angle[closer]), np.sin(angle[closer])
        normals[closer] = np.stack([-t[:, 1] * c - t[:, 0] * s, t[:, 0] * c - t[:, 1] * s], axis=1)
        near[closer], apart[closer] = g, off[closer]
    return near, normals


def engaged_sprockets(trajectory: Trajectory, rollers: Index | None = None) -> Index:
    """Sprocket whose pitch circle each roller is nearest to (F, N), -1 beyond its `engagement`.

    Args:
        rollers: only these, (N,); all if None.
    """
    drive = trajectory.drive
    which = np.arange(drive.chain.links) if rollers is None else rollers
    frame, roller = np.meshgrid(np.arange(len(trajectory.time)), which, indexing="ij")
    near, apart = nearest_sprockets_of_rollers(trajectory, frame.ravel(), roller.ravel())
    band = np.array([drive.engagement(s) for s in range(len(drive.sprockets))])
    return np.where(apart < band[near], near, -1).reshape(frame.shape)


def contact_force_vectors(trajectory: Trajectory) -> tuple[Array, Array]:
    """Contact forces on the rollers as vectors (F, N, 2) [N]: those of sprockets, those of guide-bars."""
    (position,) = require_channels(trajectory, "position")
    both = []
    for arrows in roller_contact_forces(trajectory):
        vectors = np.zeros(position.shape)
        vectors[arrows.frame, arrows.roller] = arrows.force
        both.append(vectors)
    return both[0], both[1]


class PassingLink(NamedTuple):
    """Link that passes the middle of a strand, and where.

    Attributes:
        link: (F,) its number, -1 where no link does.
        displacement: (F,) of the chain from the straight common tangent there [m], left of travel positive; else nan.
    """

    link: Index
    displacement: Array


def passing_link(trajectory: Trajectory, strand: int) -> PassingLink:
    """Link that passes the middle of a strand, and its displacement, at every frame."""
    (position,) = require_channels(trajectory, "position")
    path = assembled_path(trajectory.drive)
    start, end = path.strand_start[strand], path.strand_end[strand]
    count = len(trajectory.time)
    link, displacement = np.full(count, -1, dtype=np.intp), np.full(count, np.nan)
    for first in range(0, count, FRAMES_AT_ONCE):
        block = slice(first, first + FRAMES_AT_ONCE)
        _fill_passing_link(position[block], start, end, link[block], displacement[block])
    return PassingLink(link, displacement)


def _fill_passing_link(
    position: NDArray[np.floating], start: Array, end: Array, link: Index, displacement: Array
) -> None:
    """Writes link and displacement of a block of frames into arrays, where a link passes."""
    length = float(np.hypot(*(end - start)))
    tx, ty = (end - start) / length
    x, y = position[..., 0], position[..., 1]
    along = np.asarray(tx * x + ty * y, dtype=float) - float(start @ (tx, ty)) - 0.5 * length
    across = np.asarray(tx * y - ty * x, dtype=float) - float(tx * start[1] - ty * start[0])
    beyond = along > 0.0
    frame, near = np.nonzero(~beyond & np.roll(beyond, -1, axis=1))
    far = (near + 1) % along.shape[1]
    # other strands cross the middle too: the nearest is the one
    order = np.lexsort((np.abs(across[frame, near]) + np.abs(across[frame, far]), frame))
    frame, first = np.unique(frame[order], return_index=True)
    near, far = near[order][first], far[order][first]
    part = -along[frame, near] / (along[frame, far] - along[frame, near])
    link[frame] = near
    displacement[frame] = across[frame, near] * (1.0 - part) + across[frame, far] * part


def strand_displacement(trajectory: Trajectory, strand: int) -> Array:
    """Transverse displacement of the chain where it passes the middle of a strand (F,) [m]; nan where no link does.

    Distance from the straight common tangent, left of travel positive (the paper's Figures 9 and 10).
    """
    return passing_link(trajectory, strand).displacement
