"""How often a run looks at its chain: at tensions for means, deviations and quantiles, mid-strand displacements, slips.

A look takes about as long as two steps, so they are as far apart as what is looked at allows
(`scripts/drawings/sampling.py` says what that misses).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.kernels.batches import BATCHES
from warpchain.results.schedule import LOOK_EVERY

OF_A_PITCH = 16
"""Fewest looks while the chain moves on by a pitch, in which polygon action and contacts repeat themselves."""

OF_A_BATCH = 16
"""Fewest looks in each batch of a window (`kernels.batches`), where they are further apart than `LOOK_EVERY`."""

FURTHER = 2 * LOOK_EVERY
"""Steps between two looks where these leave enough of them; still further apart they would miss more than they save."""


def longest_apart(drive: Drive, step: float | NDArray[np.float64]) -> NDArray[np.int64]:
    """() or (V,) steps between two looks at the chain that its speed, harmonics aside, allows at a time step [s].

    Args:
        drive: one, or a stack; where the driver stands still nothing is known of how the chain moves.
        step: of it, or (V,) of each variant.
    """
    moved = np.asarray(drive.chain_speed * step / drive.chain.pitch)
    return np.where((moved > 0.0) & (OF_A_PITCH * FURTHER * moved <= 1.0), FURTHER, LOOK_EVERY)


def look_every(longest: int, window: int) -> int:
    """Steps between two looks in a window of so many steps, of the most that the chain's speed allows."""
    return longest if window >= int(BATCHES) * OF_A_BATCH * longest else LOOK_EVERY
