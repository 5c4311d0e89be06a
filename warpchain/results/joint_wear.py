"""Sliding of the chain's joints under load, and the elongation by wear that it forecasts (Archard, docs/wear.md).

While links turn by d(phi) against each other, the pin slides r_p |d(phi)| in its bush under the force N:

    s = r_p sum |d(phi)|  [m],    L = r_p sum N |d(phi)|  [N m],    sliding work W = mu kappa L.                 (a)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.model import ChainModel
from warpchain.results.losses import joint_loads
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]


class JointWear(NamedTuple):
    """Sliding of the chain's joints in a window."""

    seconds: float  # length of the window [s]
    distance: Array  # (N,) sliding distance s [m] (a)
    loaded: Array  # (N,) force times sliding distance L [N m] (a)
    work: Array  # (N,) sliding work W [J] (a)


def joint_wear(trajectory: Trajectory) -> JointWear | None:
    """Sliding of each joint over a recording, (a), or None.

    Frames must come at least twice as often as links turn back and forth.

    Raises:
        SimulationError: recorded without positions or tensions.
    """
    position, _ = require_channels(trajectory, "position", "tension")
    chain, radius = trajectory.model.chain, trajectory.model.chain.pin_radius
    if radius is None or len(trajectory.time) < 2:
        return None
    across = np.roll(position, -1, axis=1) - position
    heading = np.arctan2(across[..., 1], across[..., 0])
    bend = heading - np.roll(heading, 1, axis=1)
    turned = np.abs((np.diff(bend, axis=0) + np.pi) % (2.0 * np.pi) - np.pi)
    load = joint_loads(trajectory)
    distance = radius * turned.sum(axis=0)
    loaded = radius * (0.5 * (load[1:] + load[:-1]) * turned).sum(axis=0)
    rub = 0.0 if chain.joint is None else chain.joint.friction * chain.joint.factor
    return JointWear(float(trajectory.time[-1] - trajectory.time[0]), distance, loaded, rub * loaded)


def elongation_rate(model: ChainModel, wear: JointWear, coefficient: float, area: float) -> float:
    """Rate at which joint wear elongates the chain [1/s]."""
    return float(wear.loaded.mean()) * coefficient / (area * model.chain.pitch * wear.seconds)
