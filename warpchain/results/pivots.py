"""Where the pivots of a drive's arms are over time: as drawn, or where tables lead them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.drive import Drive


def pivots(drive: Drive, time: ArrayLike) -> NDArray[np.float64]:
    """Pivots (F, A, 2) [m] of a drive's arms at instants (F,) [s]."""
    at = np.asarray(time, dtype=float)
    found = np.empty((len(at), len(drive.arms), 2))
    for a, arm in enumerate(drive.arms):
        found[:, a] = arm.pivot
        if arm.pivot_table is not None:
            found[:, a] += arm.pivot_table.at(at)
    return found
