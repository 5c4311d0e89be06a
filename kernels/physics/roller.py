"""A roller as a mass point: its equation of motion, how it is moved without loss at float32, and its energy."""

from typing import Any

import warp as wp


@wp.func
def roller_acceleration(force: Any, inverse_mass: Any, gravity: Any):
    """Acceleration [m/s^2] of a roller, eq. (1), from the force of its two links and its contacts [N]."""
    return type(gravity)(inverse_mass * force[0] + gravity[0], inverse_mass * force[1] + gravity[1])


@wp.func
def two_sum(high: Any, low: Any, change: Any):
    """A coordinate, kept as a value and what the value rounds off, plus a small `change` (fast two-sum)."""
    rest = low + change
    moved = high + rest
    return moved, rest - (moved - high)


@wp.func
def spring_force(tension: Any, rate: Any, damping: Any):
    """The elastic part of a link's tension [N], eq. (2): all but its damper's."""
    return tension - damping * rate
