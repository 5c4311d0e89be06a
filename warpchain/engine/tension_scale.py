"""How large link tensions of a drive are, roughly: what the bins of their histograms are spaced by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.drive import Drive
from warpchain.drive.batch_math import power
from warpchain.drive.sprocket import ElasticMount, Load, SliderMount

SHARE = 0.1
"""Scale of the bins over the working tension."""

LEAST = 1e-6
"""Least working tension, over what stretches a link by its own length."""


def _moment(load: Load, speed: float) -> float:
    """Most that a load asks for at an angular velocity, harmonics aside [N m]."""
    table = 0.0 if load.table is None else load.table.factor * float(np.abs(load.table.torque).max())
    return abs(load.torque) + abs(table) + load.viscous * speed + load.quadratic * speed * speed


def tension_scale(drive: Drive, assembly: Assembly) -> NDArray[np.float64]:
    """A tenth of the sum of what loads, preloads and the chain's speed pull with [N], positive.

    Loads and preloads of mounts are taken to act on the same strand, so that it is rather too large than too small.

    Args:
        drive: one, or a stack, and
        assembly: its states, (V, ...) of a stack.
    """
    chain = drive.chain
    speed = drive.chain_speed
    stretched = np.maximum(0.0, chain.stiffness * assembly.path.pitch * assembly.strain)
    tension = stretched + chain.mass / chain.pitch * power(speed, 2)
    for s, sprocket in enumerate(drive.sprockets):
        radius = drive.pitch_radius(s)
        if sprocket.load is not None:
            tension = tension + _moment(sprocket.load, speed / radius) / radius
        if isinstance(sprocket.mount, ElasticMount | SliderMount):
            preload = sprocket.mount.preload
            tension = tension + np.hypot(*(preload if isinstance(preload, tuple) else (preload, preload)))
    return SHARE * np.maximum(tension, LEAST * chain.stiffness * chain.pitch)
