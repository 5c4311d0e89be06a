"""A roller as a mass point: its equation of motion, how it is moved without loss at float32, and its energy."""

from typing import Any

import warp as wp


@wp.func
def roller_acceleration(force: Any, inverse_mass: Any, gravity: Any):
    """Acceleration [m/s^2] of a roller, eq. (1), from the force of its two links and its contacts [N]."""
    return type(gravity)(
        acceleration_along(force[0], inverse_mass, gravity[0]), acceleration_along(force[1], inverse_mass, gravity[1])
    )


@wp.func
def acceleration_along(force: Any, inverse_mass: Any, gravity: Any):
    """A component of `roller_acceleration`."""
    return inverse_mass * force + gravity


@wp.func
def two_sum(high: Any, low: Any, change: Any):
    """A coordinate, kept as a value and what the value rounds off, plus a small `change` (fast two-sum)."""
    rest = low + change
    moved = high + rest
    return moved, rest - (moved - high)


@wp.func
def roller_energy(position: Any, velocity: Any, tension: Any, rate: Any, chain: Any):
    """What a roller and the link after it hold, kinetic and elastic, and what their weight does, m g . x [J].

    Args:
        position: of the roller [m].
        velocity: of the roller [m/s].
        tension: of the link [N]; all but its damper's part is elastic, eq. (2).
        rate: of the link's elongation [m/s].
        chain: the chain (`structs.Chain`).
    """
    spring = wp.float64(tension - chain.damping * rate)
    vx = wp.float64(velocity[0])
    vy = wp.float64(velocity[1])
    lift = wp.float64(chain.gravity[0]) * wp.float64(position[0]) + wp.float64(chain.gravity[1]) * wp.float64(
        position[1]
    )
    held = wp.float64(0.5) * (
        wp.float64(chain.mass) * (vx * vx + vy * vy) + spring * spring / wp.float64(chain.stiffness)
    )
    return held, wp.float64(chain.mass) * lift
