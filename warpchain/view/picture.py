"""A drive as an SVG picture by itself: sprockets, guide-bars and the chain, in the color of its tension or in one."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.route import chain_path
from warpchain.drive import Drive
from warpchain.results.run import Trajectory
from warpchain.results.scene import guide_outline, tooth_outline
from warpchain.view.colors import tension_scale, tension_steps
from warpchain.view.scale import scale_top

Array = NDArray[np.float64]

WIDE, TALL = 420.0, 380.0
"""Most pixels across and up."""
MARGIN = 12.0
STEEL, RUBBER, CHAIN = "#8a93a0", "#b9773c", "#3b78c2"


def drive_svg(drive: Drive) -> str:
    """A drive as it is drawn: the chain along pitch circles and tangents.

    Raises:
        DriveError: a path that cannot be drawn.
    """
    path = chain_path(drive)
    line = []
    for s, sprocket in enumerate(drive.sprockets):
        angles = path.arrival_angle[s] + sprocket.sign * np.linspace(0.0, path.wrap_angle[s], 40)
        line.append(np.asarray(sprocket.center) + path.radius[s] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    chain = np.concatenate(line)
    centers = np.array([sprocket.center for sprocket in drive.sprockets])
    return _svg(drive, centers, np.zeros(len(centers)), [(np.vstack([chain, chain[:1]]), CHAIN)])


def frame_svg(trajectory: Trajectory, frame: int) -> str:
    """A drive at a frame, each link in the color of its tension where that was recorded."""
    drive = trajectory.drive
    assert trajectory.position is not None
    x = np.asarray(trajectory.position[frame], dtype=float)
    pairs = np.stack([x, np.roll(x, -1, axis=0)], axis=1)
    colors = [CHAIN] * len(x)
    if trajectory.tension is not None:
        steps = tension_steps(trajectory.tension[frame], scale_top([trajectory]))
        colors = ["#{:02x}{:02x}{:02x}".format(*color[:3]) for color in tension_scale()[steps]]
    centers = np.array([sprocket.center for sprocket in drive.sprockets])
    angles = np.zeros(len(centers))
    if trajectory.sprocket_center is not None:
        centers = np.asarray(trajectory.sprocket_center[frame], dtype=float)
    if trajectory.sprocket_angle is not None:
        angles = np.asarray(trajectory.sprocket_angle[frame], dtype=float)
    return _svg(drive, centers, angles, list(zip(pairs, colors, strict=True)))


def _svg(drive: Drive, centers: Array, angles: Array, chain: list[tuple[Array, str]]) -> str:
    teeth = []
    for s, (center, angle) in enumerate(zip(centers, angles, strict=True)):
        c, d = np.cos(angle), np.sin(angle)
        teeth.append(tooth_outline(drive, s, 3) @ np.array([[c, d], [-d, c]]) + center)
    bars = [guide_outline(drive, g, 6) for g in range(len(drive.guides))]
    every = np.concatenate([*teeth, *bars, *(points for points, _ in chain)])
    every = every[np.isfinite(every).all(axis=1)]
    low, high = every.min(axis=0), every.max(axis=0)
    scale = min(WIDE / (high - low)[0], TALL / (high - low)[1])

    def spots(points: Array) -> str:
        at = np.stack([points[:, 0] - low[0], high[1] - points[:, 1]], axis=1) * scale + MARGIN
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in at.tolist())

    width, height = (high - low) * scale + 2.0 * MARGIN
    parts = [f'<polygon points="{spots(points)}" fill="{STEEL}33" stroke="{STEEL}"/>' for points in teeth]
    parts += [f'<polyline points="{spots(p)}" fill="none" stroke="{RUBBER}" stroke-width="3"/>' for p in bars]
    thick = max(0.25 * drive.chain.pitch * scale, 1.5)
    parts += [
        f'<polyline points="{spots(points)}" fill="none" stroke="{color}" stroke-width="{min(thick, 4.0):.1f}"/>'
        for points, color in chain
    ]
    parts += _names(
        drive, ((center - low) * [1.0, -1.0] * scale + [0.0, (high - low)[1] * scale] for center in centers)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img">{"".join(parts)}</svg>'
    )


def _names(drive: Drive, places: Iterable[Array]) -> list[str]:
    style = (
        'text-anchor="middle" dominant-baseline="middle" font-size="11" font-family="sans-serif" fill="currentColor"'
    )
    return [
        f'<text x="{x + MARGIN:.1f}" y="{y + MARGIN:.1f}" {style}>{escape(sprocket.name)}</text>'
        for sprocket, (x, y) in zip(drive.sprockets, places, strict=True)
    ]
