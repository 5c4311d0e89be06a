"""Dimensions in the picture of a drive at rest: radii and wraps, links of strands, travel of arms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.assembly import assemble
from warpchain.drive import Drive
from warpchain.errors import DriveError
from warpchain.results.scene import Pose, parts_at, turned
from warpchain.results.units import display_unit

Array = NDArray[np.float64]

LINE = 17.0
"""Space that a text at a sprocket takes [pt]."""
TRAVEL: dict[str, Any] = {"color": "0.3", "lw": 0.7, "ls": (0, (4, 3)), "zorder": 1.5}


def draw_dimensions(axis: Any, drive: Drive, pose: Pose, travel: list[Array], factor: float) -> None:
    """Writes what a drawing states beside the names, and draws arms where they stand on their stops, in dashes.

    Args:
        axis: of the picture.
        drive: a drive of one chain.
        pose: where its bodies stand.
        travel: lines of `arm_travel`.
        factor: units of the axes in a meter.
    """
    from matplotlib.patheffects import withStroke

    path = chain_path(drive)
    middle = np.mean(pose.center, axis=0)

    def write(text: str, at: Any, x: float, y: float, **more: Any) -> None:
        halo = [withStroke(linewidth=2.0, foreground="white")]
        place: Any = {"xytext": (x, y), "textcoords": "offset points", "ha": "center", "va": "center"} | more
        axis.annotate(text, factor * np.asarray(at), fontsize=7, zorder=5, path_effects=halo, **place)

    for s, (sprocket, center) in enumerate(zip(drive.sprockets, pose.center, strict=True)):
        wrap = math.degrees(float(path.wrap_angle[s]))
        text = f"{sprocket.teeth} teeth, r {_length(drive.pitch_radius(s))}\nwrap {wrap:.1f}\N{DEGREE SIGN}"
        write(text, center, 0.0, -7.0 - LINE * (written(axis, factor * center) - 1), va="top")
    for g in range(len(drive.guides)):
        face, a = drive.profile(g), drive.arm_of(g)
        radii = dict.fromkeys(_length(1.0 / abs(piece.curvature)) for piece in face.face if piece.curvature)
        place, heading = face.at(0.3 * face.face_length)
        at = np.array(place)
        if a is not None:
            at, heading = turned(at, drive.arms[a].pivot, pose.arm[a]), heading + pose.arm[a]
        x, y = math.sin(heading), -math.cos(heading)  # to the right, where no chain is
        text = f"R {', '.join(radii)}" if radii else _length(face.face_length)
        write(text, at, 5.0 * x, 5.0 * y, color="tab:brown", ha="left" if x > 0.0 else "right")
    for k, text in enumerate(_strands(drive, path.strand_length / path.pitch)):
        mid = 0.5 * (path.strand_start[k] + path.strand_end[k])
        x, y = (middle - mid) / max(float(np.hypot(*(middle - mid))), 1e-12)
        write(text, mid, 24.0 * x, 10.0 * y, color="tab:blue")
    for arm, angle in zip(drive.arms, pose.arm, strict=True):
        stops = "no stops" if arm.stops is None else "{:+g} to {:+g}\N{DEGREE SIGN}".format(*arm.stops)
        away = 1.0 if arm.pivot[0] > middle[0] else -1.0
        text = f"{arm.name} at {math.degrees(angle):+.1f}\N{DEGREE SIGN}\n{stops}"
        write(text, arm.pivot, 7.0 * away, 0.0, color="0.3", ha="left" if away > 0.0 else "right")
    for points in travel:
        axis.plot(*factor * points.T, **TRAVEL)


def arm_travel(drive: Drive, pose: Pose) -> list[Array]:
    """Lines of the arms and of the guides on them, on either stop [m]."""
    lines = []
    for a, arm in enumerate(drive.arms):
        own = {arm.name, *(drive.guides[g].name for g in drive.guides_of(a))}
        for stop in arm.stops or ():
            angles = np.array(pose.arm, dtype=float)
            angles[a] = math.radians(stop)
            moved = parts_at(drive, pose._replace(arm=angles))
            lines += [part.points for part in moved if part.kind in ("arm", "guide") and part.name in own]
    return lines


def written(axis: Any, point: Any) -> int:
    """Number of texts that stand at a point of a picture: sprockets of several chains may have one center."""
    return sum(np.allclose(text.xy, point) for text in axis.texts)


def _strands(drive: Drive, pitches: Any) -> list[str]:
    """Links of each strand; its length in pitches where the chain does not fit."""
    try:
        return [f"{links} links" for links in assemble(drive).strand_links]
    except DriveError:
        return [f"{length:.2f} pitches" for length in pitches]


def _length(meters: float) -> str:
    """A length with its unit, to four figures."""
    unit, factor = display_unit("m", meters)
    return f"{factor * meters:.4g} {unit}"
