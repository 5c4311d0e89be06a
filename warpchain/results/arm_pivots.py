"""Pivots of a drive's arms over time: as drawn, led by tables, or on other arms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.drive import Drive


def arm_pivots(drive: Drive, time: ArrayLike, angle: ArrayLike | None) -> NDArray[np.float64]:
    """Pivots (F, A, 2) [m] of a drive's arms over time."""
    at = np.asarray(time, dtype=float)
    found = np.empty((len(at), len(drive.arms), 2))
    for a, arm in enumerate(drive.arms):
        found[:, a] = arm.pivot
        if arm.pivot_table is not None:
            found[:, a] += arm.pivot_table.at(at)
    for a, arm in enumerate(drive.arms):
        parent = drive.parent(a)
        if parent is not None and angle is not None:
            turned = np.asarray(angle, dtype=float)[:, parent]
            (x, y), cosine, sine = np.subtract(arm.pivot, drive.arms[parent].pivot), np.cos(turned), np.sin(turned)
            found[:, a] = found[:, parent] + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
    return found
