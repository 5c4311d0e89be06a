"""Signals of shafts from recorded frames: force of the chain on hubs, phase error of driven shafts (docs/report.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.results.nearest_parts import engaged_sprockets, sprocket_normals
from warpchain.results.order_tracking import driver_turns, last_rising_frames, order_amplitudes
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import angle_ahead_of_driver

Array = NDArray[np.float64]


def hub_forces(trajectory: Trajectory) -> Array:
    """Force (F, S, 2) [N] of the chain on hubs, recorded or of contacts.

    Raises:
        SimulationError: recorded without positions, sprocket forces, angles or centers.
    """
    if trajectory.hub_force is not None:
        return np.asarray(trajectory.hub_force, dtype=float)
    _, sprocket_force, _, _ = require_channels(
        trajectory, "position", "sprocket_force", "sprocket_angle", "sprocket_center"
    )
    frames, sprockets = len(trajectory.time), len(trajectory.parts.sprockets)
    near = engaged_sprockets(trajectory)
    found = np.zeros((frames, sprockets, 2))
    for s in range(sprockets):
        frame, roller = np.nonzero((sprocket_force > 0.0) & (near == s))
        size = np.asarray(sprocket_force, dtype=float)[frame, roller]
        push = -size[:, None] * sprocket_normals(trajectory, s, frame, roller)
        for k in range(2):
            found[:, s, k] = np.bincount(frame, push[:, k], minlength=frames)
    return found


ENGINE_ORDERS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0)


def phase_error(trajectory: Trajectory, s: int) -> Array:
    """Phase error (F,) [rad of the driver] of a sprocket, below 0 where it lags.

    Raises:
        SimulationError: recorded without sprocket angles.
    """
    parts = trajectory.parts
    gear = parts.sprockets[s].teeth / parts.sprockets[parts.driver].teeth
    return gear * angle_ahead_of_driver(trajectory, s)


class PhaseError(NamedTuple):
    """Phase error of a sprocket over a window [rad]."""

    shift: float  # mean
    low: float  # smallest
    high: float  # largest
    amplitude: Array | None  # (O,) of `orders` of the driver; None without a whole cycle
    orders: tuple[float, ...]


def phase_error_in_window(
    trajectory: Trajectory, s: int, window: NDArray[np.bool_] | slice, orders: Sequence[float] = ENGINE_ORDERS
) -> PhaseError:
    """Phase error of a sprocket over a window, with orders."""
    error, turns = phase_error(trajectory, s)[window], driver_turns(trajectory)[window]
    part = last_rising_frames(turns)
    found = order_amplitudes(turns[part], error[part], orders) if len(turns[part]) > 8 else None
    return PhaseError(float(error.mean()), float(error.min()), float(error.max()), found, tuple(orders))
