"""What to look at in a drive before it runs: rules of thumb that a drive may break and still run, unlike its layout.

    wrap       a sprocket that passes on a moment, the driver or one with a load, is wrapped by at least 90 degrees
    idler      one that passes on none has at least three teeth in mesh, z phi / 2 pi, or rollers hammer it one by one
    bars       a guide-bar's face meets a strand: not farther off than half a pitch, nor pushing it out by more
    safety     breaking load over the largest tension at work, centrifugal part and all, is at least 7

The wraps and teeth in mesh are those that makers of roller chains ask for, 7 is their static safety. A bar that pushes
its strand out by more than a pitch, or cuts through it, is told by `warpchain.assembly.layout`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from warpchain.assembly.path import ChainPath
from warpchain.assembly.route import chain_path
from warpchain.drive import Drive

LEAST_WRAP = 90.0
"""Of a sprocket that passes on a moment [degrees]."""
LEAST_TEETH = 3.0
"""In mesh, of one that passes on none."""
NEAR = 0.5
"""Of a pitch: how far a strand may be from where it would ride on a guide-bar, either way."""
LEAST_SAFETY = 7.0
"""Breaking load over the largest tension at work."""


def advice(drive: Drive, path: ChainPath | None = None, tensions: Sequence[float] = ()) -> tuple[str, ...]:
    """What to look at, a line each: what, by how much, what to change; mostly nothing.

    Args:
        path: the chain's path, if it is known.
        tensions: of the strands at work [N]; without them nothing is told of the breaking load.

    Raises:
        DriveError: a path that cannot be drawn.
    """
    path = chain_path(drive) if path is None else path
    return (*_wraps(drive, path), *_bars(drive, path), *_safety(drive, tensions))


def _wraps(drive: Drive, path: ChainPath) -> list[str]:
    lines = []
    for s, sprocket in enumerate(drive.sprockets):
        wrap = math.degrees(float(path.wrap_angle[s]))
        mesh = sprocket.teeth * wrap / 360.0
        if sprocket.prescribed is not None or sprocket.load is not None:
            if wrap < LEAST_WRAP:
                lines.append(
                    f"sprockets.{sprocket.name}: passes on a moment with {wrap:.0f} degrees of wrap, where "
                    f"{LEAST_WRAP:g} are the least ({mesh:.1f} teeth in mesh): move it or its neighbors"
                )
        elif mesh < LEAST_TEETH:
            lines.append(
                f"sprockets.{sprocket.name}: {mesh:.1f} teeth in mesh ({wrap:.0f} degrees), where an idler wants "
                f"{LEAST_TEETH:g}: rollers hammer it one by one; push it further into the chain, or give it more teeth"
            )
    return lines


def _bars(drive: Drive, path: ChainPath) -> list[str]:
    """Of bars of a straight face."""
    lines = []
    radius, pitch = drive.chain.roller_radius, drive.chain.pitch
    for guide in drive.guides:
        if guide.start is None or guide.end is None or guide.arm is not None:
            continue
        (ax, ay), (bx, by) = guide.start, guide.end
        length = math.hypot(bx - ax, by - ay)
        tx, ty = (bx - ax) / length, (by - ay) / length
        gaps = []
        for k, ((sx, sy), (ex, ey)) in enumerate(zip(path.strand_start, path.strand_end, strict=True)):
            first, last = (sx - ax) * tx + (sy - ay) * ty, (ex - ax) * tx + (ey - ay) * ty
            ends = [(sy - ay) * tx - (sx - ax) * ty, (ey - ay) * tx - (ex - ax) * ty]
            if (shares := _over(first, last, length)) is not None:
                # of rollers that ride on the face the center is a radius in front of it
                gaps.append((min(ends[0] + share * (ends[1] - ends[0]) for share in shares) - radius, k))
        nearest = min(gaps, key=lambda gap: abs(gap[0]), default=None)
        if nearest is None:
            lines.append(f"guides.{guide.name}: misses the chain: no strand passes over its face; move start and end")
            continue
        gap, k = nearest
        named = f'strand "{drive.strand_names[k]}"'
        if gap > NEAR * pitch:
            lines.append(
                f"guides.{guide.name}: misses the chain: its face stands {1e3 * gap:.3g} mm, {gap / pitch:.2g} "
                f"pitches, off {named}; move start and end toward it unless it is there to catch swings"
            )
        elif -pitch <= gap < -NEAR * pitch:
            lines.append(
                f"guides.{guide.name}: dents {named} by {-1e3 * gap:.3g} mm, {-gap / pitch:.2g} pitches: its ends bear "
                "hard; move start and end back, or take a curved face"
            )
    return lines


def _over(first: float, last: float, length: float) -> tuple[float, float] | None:
    """Shares of a line from `first` to `last` between which it is over 0 to `length`; None where it nowhere is."""
    if first == last:
        return None
    low, high = sorted(((0.0 - first) / (last - first), (length - first) / (last - first)))
    low, high = max(low, 0.0), min(high, 1.0)
    return (low, high) if low < high else None


def _safety(drive: Drive, tensions: Sequence[float]) -> list[str]:
    load = drive.chain.breaking_load
    if load is None or not len(tensions) or max(tensions) <= 0.0:
        return []
    largest = max(tensions)
    if load / largest >= LEAST_SAFETY:
        return []
    return [
        f"chain: {1e-3 * largest:.4g} kN at work is a safety of {load / largest:.2g} against the breaking load of "
        f"{1e-3 * load:.4g} kN, where {LEAST_SAFETY:g} is the least, before any vibration: take a larger chain.size or "
        "less load"
    ]
