"""Pivots of a drive's arms over time: as drawn, led by tables, or on other arms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.drive import Drive
from warpchain.model import ChainModel


def arm_pivots(parts: Drive | ChainModel, time: ArrayLike, angle: ArrayLike | None) -> NDArray[np.float64]:
    """Pivots (F, A, 2) [m] of a drive's arms over time."""
    at, numbers = np.asarray(time, dtype=float), {arm.name: a for a, arm in enumerate(parts.arms)}
    found = np.empty((len(at), len(parts.arms), 2))
    for a, arm in enumerate(parts.arms):
        found[:, a] = arm.pivot
        if arm.pivot_table is not None:
            found[:, a] += arm.pivot_table.at(at)
    for a, arm in enumerate(parts.arms):
        if arm.arm is not None and angle is not None:
            parent = numbers[arm.arm]
            turned = np.asarray(angle, dtype=float)[:, parent]
            (x, y), cosine, sine = np.subtract(arm.pivot, parts.arms[parent].pivot), np.cos(turned), np.sin(turned)
            found[:, a] = found[:, parent] + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
    return found
