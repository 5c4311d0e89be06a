"""Settling: static equilibrium of rollers and arms, sprockets held, by dynamic relaxation with kinetic damping.

They move from rest by elastic forces and gravity; after a peak of kinetic energy velocities are zeroed. A restart takes
half a kick. Settled: no net force exceeds a fraction of the largest of link force, a roller's weight, and the force
that stretches a link by a nanometer.
"""

from typing import Any

import warp as wp

ENERGY_EVERY = wp.constant(4)  # steps between two checks of the kinetic energy
LEAST_STRETCH = wp.constant(wp.float64(1.0e-9))  # of a link [m], whose force is the least that counts


@wp.struct
class Settling:
    """State of one variant's settling: its step, tolerance and progress."""

    step: wp.float64  # h [s]
    tolerance: wp.float64  # residual to reach
    steps: wp.int32  # taken so far
    limit: wp.int32  # most steps to take
    residual: wp.float64  # largest net force over the largest link force or weight
    energy: wp.float64  # kinetic energy at the last check [J]
    settled: wp.int32


@wp.func
def finite_size(acceleration: Any):
    """Magnitude of an acceleration [m/s^2] in settling; huge if not finite."""
    size = wp.length(acceleration)
    if not size < type(size)(1.0e30):
        size = type(size)(1.0e30)
    return size


@wp.func
def relative_residual(
    worst: wp.float64, tension: wp.float64, mass: wp.float64, gravity: wp.vec2d, stiffness: wp.float64
):
    """Largest net force in settling over the largest link force or a roller's weight [-].

    `worst` is a roller's largest acceleration [m/s^2], `tension` the largest link force [N].
    """
    scale = wp.max(wp.max(tension, mass * wp.length(gravity)), stiffness * LEAST_STRETCH)
    if scale == wp.float64(0.0):
        return worst
    return mass * worst / scale


@wp.func
def relaxation_after_check(now: Settling, energy: wp.float64, residual: wp.float64):
    """Settling after a check of kinetic energy [J] and residual; 1 to restart."""
    restart = int(0)
    now.residual = residual
    if residual < now.tolerance:
        now.settled = 1
    if energy < now.energy:
        restart = 1
        energy = wp.float64(0.0)
    now.energy = energy
    return now, restart


@wp.func
def relaxation_kick(now: Settling, restart: int):
    """Time [s] over which settling accelerates velocities."""
    return wp.where(now.steps == 0 or restart == 1, wp.float64(0.5) * now.step, now.step)
