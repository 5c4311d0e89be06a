"""What pictures of a drive need: outlines of teeth and guide-bars, contact directions, displacement of a strand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.geometry import chain_path
from warpchain.record import Trajectory
from warpchain.teeth import half_gap_outline

Array = NDArray[np.float64]


def tooth_outline(drive: Drive, s: int, arc_points: int = 9) -> Array:
    """Closed outline of sprocket s's teeth at angle zero about its center (P, 2) [m]: seat arcs, flanks and tips.

    The surface itself, not the offset curve of the rollers' centers (eq. (5)-(8)).
    """
    teeth = drive.sprockets[s].teeth
    half = half_gap_outline(drive.tooth(s), teeth, drive.pitch_radius(s), arc_points)
    gap = np.vstack([half[::-1] * [1.0, -1.0], half[1:]])
    turn = 2.0 * math.pi / teeth * np.arange(teeth)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    points = np.stack([gap[:, 0] * cosine - gap[:, 1] * sine, gap[:, 0] * sine + gap[:, 1] * cosine], axis=-1)
    outline = points.reshape(-1, 2)
    return np.vstack([outline, outline[:1]])


def guide_outline(drive: Drive, g: int, points: int = 12) -> Array:
    """Outline of guide-bar g (P, 2) [m]: its face and both rounded ends."""
    guide = drive.guides[g]
    start, end = np.asarray(guide.start, dtype=float), np.asarray(guide.end, dtype=float)
    t = (end - start) / np.hypot(*(end - start))
    n = np.array([-t[1], t[0]])
    angle = np.linspace(0.0, 0.5 * math.pi, points)[:, None]
    radius = guide.end_radius
    before = start - radius * n + radius * (np.cos(angle) * n - np.sin(angle) * t)
    after = end - radius * n + radius * (np.cos(angle) * n + np.sin(angle) * t)
    return np.vstack([before[::-1], after])


def sprocket_normals(trajectory: Trajectory, s: int) -> Array:
    """Direction of the contact force of sprocket s on each roller (F, N, 2), as eq. (8) and the flank give it."""
    drive = trajectory.drive
    assert trajectory.position is not None
    assert trajectory.sprocket_center is not None
    assert trajectory.sprocket_angle is not None
    r = np.asarray(trajectory.position - trajectory.sprocket_center[:, None, s], dtype=float)
    turned = np.asarray(trajectory.sprocket_angle[:, s, None], dtype=float)
    pitch_angle = 2.0 * math.pi / drive.sprockets[s].teeth
    seat = np.rint((np.arctan2(r[..., 1], r[..., 0]) - turned) / pitch_angle) * pitch_angle + turned
    e = np.stack([np.cos(seat), np.sin(seat)], axis=-1)
    tau = np.stack([-e[..., 1], e[..., 0]], axis=-1)
    xi, eta = (r * e).sum(axis=-1) - drive.pitch_radius(s), (r * tau).sum(axis=-1)
    tooth = drive.tooth(s)
    half, curvature = 0.5 * tooth.seat_angle, 1.0 / (tooth.flank_radius + drive.chain.roller_radius)
    clearance = tooth.seat_radius - drive.chain.roller_radius
    across = 1.0 - curvature * (np.abs(eta) * math.sin(half) - xi * math.cos(half) - clearance)
    along = curvature * (np.abs(eta) * math.cos(half) + xi * math.sin(half))
    flank = np.hypot(across, along)
    size = np.maximum(np.hypot(xi, eta), 1e-15)
    on_arc = np.abs(eta) * math.cos(half) <= -xi * math.sin(half)
    radial = np.where(on_arc, -xi / size, (across * math.cos(half) + along * math.sin(half)) / flank)
    lateral = np.where(on_arc, -eta / size, np.sign(eta) * (along * math.cos(half) - across * math.sin(half)) / flank)
    return radial[..., None] * e + lateral[..., None] * tau


def nearest_sprocket(trajectory: Trajectory) -> NDArray[np.intp]:
    """The sprocket whose pitch circle each roller is nearest to (F, N), or -1 beyond half a pitch from all."""
    drive = trajectory.drive
    assert trajectory.position is not None
    assert trajectory.sprocket_center is not None
    apart = np.stack(
        [
            np.abs(
                np.hypot(*np.moveaxis(trajectory.position - trajectory.sprocket_center[:, None, s], -1, 0))
                - drive.pitch_radius(s)
            )
            for s in range(len(drive.sprockets))
        ]
    )
    return np.where(apart.min(axis=0) < 0.5 * drive.chain.pitch, apart.argmin(axis=0), -1)


def contact_arrows(trajectory: Trajectory) -> tuple[Array, Array]:
    """Contact forces on the rollers as vectors (F, N, 2) [N]: those of sprockets, those of guide-bars."""
    drive = trajectory.drive
    assert trajectory.position is not None
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    sprockets = np.zeros_like(trajectory.position, dtype=float)
    nearest = nearest_sprocket(trajectory)
    for s in range(len(drive.sprockets)):
        mine = (nearest == s)[..., None]
        sprockets += np.where(mine, sprocket_normals(trajectory, s) * trajectory.sprocket_force[..., None], 0.0)
    guides = np.zeros_like(sprockets)
    for guide in drive.guides:
        t = np.subtract(guide.end, guide.start)
        length = float(np.hypot(*t))
        t = t / length
        along = (trajectory.position - np.asarray(guide.start)) @ t
        reach = guide.end_radius + drive.chain.roller_radius
        near = (along > -reach) & (along < length + reach)
        normal = np.array([-t[1], t[0]])
        guides += np.where(near[..., None], trajectory.guide_force[..., None] * normal, 0.0)
    return sprockets, guides


def strand_displacement(trajectory: Trajectory, strand: int) -> Array:
    """Transverse displacement of the chain where it passes the middle of a strand (F,) [m], left of travel positive.

    The paper's Figures 9 and 10: distance from the straight common tangent.
    """
    assert trajectory.position is not None
    path = chain_path(trajectory.drive)
    start, end = path.strand_start[strand], path.strand_end[strand]
    length = float(np.hypot(*(end - start)))
    t = (end - start) / length
    q = np.asarray(trajectory.position, dtype=float) - start
    along, across = q @ t, q @ np.array([-t[1], t[0]])
    following, beside = np.roll(along, -1, axis=1), np.roll(across, -1, axis=1)
    crosses = (along <= 0.5 * length) & (following > 0.5 * length)
    link = np.where(crosses, np.abs(across) + np.abs(beside), np.inf).argmin(axis=1)
    frame = np.arange(len(along))
    a, b = along[frame, link], following[frame, link]
    part = (0.5 * length - a) / (b - a)
    return across[frame, link] * (1.0 - part) + beside[frame, link] * part
