"""What is drawn of arms, guides and tensioners in a mode."""

from __future__ import annotations

import numpy as np

from warpchain.drive import Drive
from warpchain.modal.coordinates import Array
from warpchain.results.scene import arm_outline, guide_outline, tensioner_outline, turned


def moved_lines(drive: Drive, bodies: Array) -> list[Array]:
    """Lines (P, 2) [m] of arms, the guides on them, and tensioners' plungers where bodies (B, 3) stand: as many at
    each time."""
    first, lines = len(drive.sprockets), []
    for a, arm in enumerate(drive.arms):
        own = arm_outline(drive, a) + [guide_outline(drive, g) for g in drive.guides_of(a)]
        lines += [turned(line, arm.pivot, float(bodies[first + a, 2])) for line in own]
    for t, tensioner in enumerate(drive.tensioners):
        b, along = drive.tensioner_body(t), np.array(tensioner.unit_direction)
        if b >= first:
            touched = turned(np.array(tensioner.at), drive.arms[b - first].pivot, float(bodies[b, 2]))
            out = (touched - tensioner.at) @ along
        else:
            out = (bodies[b, :2] - drive.sprockets[b].center) @ along
        lines.append(tensioner_outline(drive, t)[1] + out * along)
    return lines


def still_lines(drive: Drive) -> list[Array]:
    """Lines (P, 2) [m] of guides on the ground and of tensioners' housings."""
    own = [guide_outline(drive, g) for g in range(len(drive.guides)) if drive.arm_of(g) is None]
    return own + [tensioner_outline(drive, t)[0] for t in range(len(drive.tensioners))]
