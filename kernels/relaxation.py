"""Settling: static equilibrium of rollers and arms with all sprockets held, by dynamic relaxation with kinetic damping.

They move from rest under link elasticity, elastic contact, guides, tensioners and gravity; whenever their kinetic
energy has passed a peak, all velocities are set to zero. A little damping in the links keeps fast axial oscillation
from setting the peaks; it does not change the equilibrium. A restart takes half a kick: a whole one would feed the
fastest oscillations. The state is settled when no roller's net force, and no arm's where the chain may touch it
farthest from its pivot, exceeds a fraction of the largest link force (or of a roller's weight, or of the force that
stretches a link by a nanometer: a slack chain without weight has neither).
"""

from typing import Any

import warp as wp

ENERGY_EVERY = wp.constant(4)  # steps between two checks of the kinetic energy
LEAST_STRETCH = wp.constant(wp.float64(1.0e-9))  # of a link [m], whose force is the least that counts


@wp.struct
class Settling:
    """One variant's relaxation: its step, tolerance, and how it stands."""

    step: wp.float64  # h [s]
    tolerance: wp.float64  # residual to reach
    steps: wp.int32  # taken so far
    limit: wp.int32  # most steps to take
    residual: wp.float64  # largest net force over the largest link force or weight
    energy: wp.float64  # kinetic energy at the last check [J]
    settled: wp.int32


@wp.func
def finite_size(acceleration: Any):
    """Magnitude of an acceleration [m/s^2]; huge where it is not finite."""
    size = wp.length(acceleration)
    if not size < type(size)(1.0e30):
        size = type(size)(1.0e30)
    return size


@wp.func
def relative_residual(
    worst: wp.float64, tension: wp.float64, mass: wp.float64, gravity: wp.vec2d, stiffness: wp.float64
):
    """Largest net force on a roller over the largest link force, a roller's weight, or the least force that counts.

    Args:
        worst: largest acceleration of a roller [m/s^2].
        tension: largest link force, in size [N].
        mass: of a roller [kg].
        gravity: [m/s^2].
        stiffness: of a link [N/m].
    """
    scale = wp.max(wp.max(tension, mass * wp.length(gravity)), stiffness * LEAST_STRETCH)
    if scale == wp.float64(0.0):
        return worst
    return mass * worst / scale


@wp.func
def relaxation_after_check(now: Settling, energy: wp.float64, residual: wp.float64):
    """The relaxation after a check of its kinetic energy [J] and residual, and whether it stops and restarts."""
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
    """Time over which velocities are accelerated [s]: half a step from rest."""
    return wp.where(now.steps == 0 or restart == 1, wp.float64(0.5) * now.step, now.step)
