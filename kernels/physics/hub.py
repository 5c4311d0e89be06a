"""Hubs: arms that carry sprockets, friction in the sprockets' bearings, and arms that carry arms.

A sprocket on an arm, d from its pivot, takes moments, the arm the chain's force F:

    J omega' = M + load - Q,    (I + m d^2) alpha'' = r_d x F + Q + other moments,    r_d = Rot(alpha) d,    (a)

with m, J its mass and inertia. Q, the friction moment of its bearing of radius r_b, is at most mu_b r_b |F|, against
omega - alpha' (omega without an arm), with a bristle (`friction`).

Arm 1 may carry arm 2. With d from pivot 1 to pivot 2, absolute angles and s = m_2 (r_c - p_2) of arm 2,

    (I_1 + m_2 d^2) alpha_1 + d.s alpha_2 = M_1 + r_d x F_2 + w_2^2 (r_d x s)
    I_2 alpha_2 + d.s alpha_1 = M_2 - w_1^2 (r_d x s),                                                        (b)

F_2 all forces on arm 2. Beside its mass at the pivot, the turning arm 2 leaves there

    F_2 + w_2^2 s - alpha_2 e_z x s.                                                                          (c)
"""

from typing import Any

import warp as wp

from ..number import Pair, PairVector, add, difference, leading_value, mul, number_of, sub  # noqa: F401
from .friction import DAMPER, SPRING, bristle_friction
from .guide import world_vector
from .mount import left_normal


@wp.func
def carried_body(body: Any, carrier: Any, hub: Any):
    """A body's state with its center on its carrier, where `hub` says."""
    lever = world_vector(hub.lever, carrier)
    body.center = carrier.center + lever
    body.velocity = carrier.velocity + number_of(leading_value(carrier.speed) * left_normal(leading_value(lever)))
    body.straight = carrier.straight + carrier.angular * left_normal(leading_value(lever))
    return body


@wp.func
def relative_body(body: Any, carrier: Any):
    """A body's state, angle and speed relative to its carrier."""
    body.angle = body.angle - carrier.angle
    body.speed = body.speed - carrier.speed
    return body


@wp.func
def moment_about_pivot(lever: Any, force: Any):
    """Moment [N m] about an arm's pivot of a force [N]."""
    return lever[0] * force[1] - lever[1] * force[0]


@wp.func
def carried_arm_coefficients(lever: Any, s: Any, w1: Any, w2: Any, led: Any, moment: Any):
    """Coefficients of a carried arm in (b): d.s [kg m^2], arm 2's right side and arm 1's last term [N m].

    `lever` is d [m], `led` arm 1's pivot acceleration, `moment` M_2.
    """
    across = moment_about_pivot(lever, s)
    right = moment - w1 * w1 * across - moment_about_pivot(s, led)
    return wp.vector(wp.dot(lever, s), right, w2 * w2 * across)


@wp.func
def eliminate_carried_arm(moment: Any, inertia: Any, terms: Any, inverse: Any):
    """Moment [N m] and inertia [kg m^2] of an arm, its carried one eliminated, (b)."""
    moment = moment + terms[2] - terms[0] * inverse * terms[1]
    return moment, inertia - terms[0] * terms[0] * inverse


@wp.func
def carried_arm_acceleration(angular: Any, terms: Any, inverse: Any):
    """Angular acceleration alpha_2 [rad/s^2] of a carried arm, (b)."""
    return inverse * (terms[1] - terms[0] * angular)


@wp.func
def pivot_force(speed: Any, angular: Any, s: Any):
    """Force [N] that a turning arm leaves on its pivot, (c) without F_2."""
    return speed * speed * s - angular * left_normal(s)


@wp.func
def carried_arm_energy(speed: Any, s: Any, lever: Any, carrier: Any):
    """Kinetic energy [J] of a carried arm by its pivot's motion."""
    return speed * wp.dot(left_normal(s), carrier.velocity + carrier.speed * left_normal(lever))


@wp.func
def bearing_moment(force: Any, turning: Any, bristle: Any, hub: Any, stretch_part: Any):
    """Friction moment -Q [N m] of a sprocket's bearing, and what its bristle then holds [N m].

    `force` is the chain's, `turning` relative to the arm [rad/s].
    """
    most = hub.bearing * wp.length(force)
    drag, bristle_after = bristle_friction(
        most, turning, bristle, type(turning)(SPRING) * hub.inertia, type(turning)(DAMPER) * hub.inertia, stretch_part
    )
    return -drag, bristle_after
