"""Link that passes the middle of a strand, frame by frame, and the chain's displacement there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import assembled_path
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]
Index = NDArray[np.intp]


FRAMES_AT_ONCE = 4096


class PassingLink(NamedTuple):
    """Link that passes a strand's middle, and displacement."""

    link: Index  # (F,) number, -1 for none
    displacement: Array  # (F,) from the straight common tangent [m], left of travel positive, or nan


def passing_link(trajectory: Trajectory, strand: int) -> PassingLink:
    """Link (F,) that passes a strand's middle, and displacement [m]."""
    (position,) = require_channels(trajectory, "position")
    path = assembled_path(trajectory.model)
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
    """Writes passing links and displacements (F,) of a strand."""
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
    """Transverse displacement (F,) [m] of a strand, left positive."""
    return passing_link(trajectory, strand).displacement
