"""Probes: what passes a place in space, as a sensor there would see it.

At a frame the probe sees the link that comes nearest to its place, if it comes within its radius: its tension, and at
the foot of the perpendicular the chain's velocity and its displacement, from the place to the left of travel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.results.run import Trajectory, need
from warpchain.results.scene import BLOCK

Array = NDArray[np.float64]


class Seen(NamedTuple):
    """What a probe sees; nan at frames at which the chain is not within its radius.

    Attributes:
        link: (F,) that passes, -1 for none.
        tension: (F,) of that link [N].
        speed: (F,) of the chain along itself, in the order of its rollers [m/s].
        displacement: (F,) of the chain from the probe's place, to the left of that direction [m].
        normal_speed: (F,) of the chain to the left [m/s].
    """

    link: NDArray[np.intp]
    tension: Array
    speed: Array
    displacement: Array
    normal_speed: Array


def seen_at(trajectory: Trajectory, at: tuple[float, float], radius: float) -> Seen:
    """What a probe at a place [m] sees of the chain within a radius [m].

    Raises:
        SimulationError: recorded without positions, velocities or tensions.
    """
    need(trajectory, "position", "velocity", "tension")
    assert trajectory.position is not None
    assert trajectory.velocity is not None
    assert trajectory.tension is not None
    count = len(trajectory.time)
    link, values = np.full(count, -1, dtype=np.intp), np.full((4, count), np.nan)
    place = np.asarray(at, dtype=float)
    for first in range(0, count, BLOCK):
        part = slice(first, first + BLOCK)
        x = np.asarray(trajectory.position[part], dtype=float)
        across = np.roll(x, -1, axis=1) - x
        square = (across**2).sum(axis=-1)
        share = np.clip(((place - x) * across).sum(axis=-1) / square, 0.0, 1.0)
        foot = x + share[..., None] * across
        apart = np.hypot(*np.moveaxis(foot - place, -1, 0))
        rows, nearest = np.arange(len(x)), apart.argmin(axis=1)
        near = apart[rows, nearest] <= radius
        rows, nearest = rows[near], nearest[near]
        t = across[rows, nearest] / np.sqrt(square[rows, nearest])[:, None]
        left = np.stack([-t[:, 1], t[:, 0]], axis=-1)
        v = np.asarray(trajectory.velocity[part], dtype=float)
        part_of = share[rows, nearest][:, None]
        moving = (1.0 - part_of) * v[rows, nearest] + part_of * v[rows, (nearest + 1) % x.shape[1]]
        link[first + rows] = nearest
        seen = (
            np.asarray(trajectory.tension[part], dtype=float)[rows, nearest],
            (moving * t).sum(axis=-1),
            ((foot[rows, nearest] - place) * left).sum(axis=-1),
            (moving * left).sum(axis=-1),
        )
        values[:, first + rows] = seen
    return Seen(link, *values)
