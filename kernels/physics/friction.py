"""Dry friction after Coulomb, without a slip-speed parameter, of contacts, joints and bearings.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2), friction Q is at most
mu(v) N. A bristle (Dahl), stretched by v h in a step h, holds what sticks:

    b <- clamp(b + k h v, -mu N, mu N),    Q = clamp(b + c v, -mu N, mu N)   against the sliding,

c = t sqrt(k m_e / s), m_e the mass to stop, k the stiffness along the surface, at most s m_e / h^2. A contact that
opens forgets b. The bristle stores b^2 / (2 k).

Link i, of direction n turned by +90 degrees, turns at dphi_i = (v_{i+1} - v_i) . n_i / L_i, its joint at roller i at
g_i = dphi_i - dphi_{i-1}. With the pin's radius r_p and kappa by the spread of pressure, the joint's moment on link i
and the force on roller i of the couple of link i's two joints (opposite on roller i + 1) are

    |M_i| <= mu kappa r_p max(|T_{i-1}|, |T_i|)   against g_i,    F_i = (M_{i+1} - M_i) n_i / L_i.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, multiply_add, quotient, smaller

SPRING = 0.2
"""s: largest share of the sliding speed that a friction bristle takes in a step."""
DAMPER = 0.5
"""t: share of sliding speed that the stiffest friction bristle's damper takes."""


@wp.func
def friction_coefficient(speed: Any, friction: Any):
    """Coefficient of friction mu(v) [-] at sliding speed v >= 0 [m/s]."""
    mu = friction.mu_dynamic
    if friction.mu_static != friction.mu_dynamic:
        part = quotient(speed, friction.stribeck_speed)
        mu += (friction.mu_static - friction.mu_dynamic) * wp.exp(-part * part)
    return mu


@wp.func
def bristle_friction(most: Any, speed: Any, bristle: Any, spring: Any, damper: Any, stretch_part: Any):
    """Friction [N] against a sliding speed, and the force [N] that its bristle then holds.

    `most` is mu N [N], `speed` v [m/s], `bristle` b before [N], `spring` k h and `damper` c [N s/m], `stretch_part` a
    step's share that stretches the bristle.
    """
    bristle_after = smaller(larger(-most, multiply_add(stretch_part * spring, speed, bristle)), most)
    return smaller(larger(-most, multiply_add(damper, speed, bristle_after)), most), bristle_after


@wp.func
def link_turning(d: Any, w: Any):
    """n / L (vector) [1/m] and rate of turning dphi [rad/s] of a link, for joint friction.

    `d` [m] and `w` [m/s] are roller i + 1 less roller i.
    """
    inverse = inverse_root(dot(d, d))
    unit = d * inverse
    lever = type(d)(-unit[1] * inverse, unit[0] * inverse)
    return lever, dot(lever, w)


@wp.func
def joint_friction_moment(
    mu: Any,
    tension_before: Any,
    turn_before: Any,
    tension_after: Any,
    turn_after: Any,
    bristle: Any,
    chain: Any,
    stretch_part: Any,
):
    """Friction moment M_i [N m] of a joint on the link after it, and its bristle's [N m].

    `tension_*` [N] and `turn_*` [rad/s] are the links'.
    """
    most = mu * chain.joint_arm * larger(wp.abs(tension_before), wp.abs(tension_after))
    drag, bristle_after = bristle_friction(
        most, turn_after - turn_before, bristle, chain.joint.spring, chain.joint.damper, stretch_part
    )
    return -drag, bristle_after


@wp.func
def joint_friction_coefficient(turn_before: Any, turn_after: Any, chain: Any):
    """Coefficient of friction [-] of a joint at its pin's sliding speed."""
    return friction_coefficient(wp.abs(turn_after - turn_before) * chain.pin_radius, chain.joint)


@wp.func
def joint_friction_power(moment: Any, turn_before: Any, turn_after: Any):
    """Power -M_i g_i [W] of friction in a chain's joint."""
    return moment * (turn_before - turn_after)


@wp.func
def couple_force(moment: Any, next_moment: Any, lever: Any):
    """Force [N] on roller i of link i's joint moments' couple; its opposite acts on roller i + 1.

    `moment` is M_i, `next_moment` M_{i+1} [N m], `lever` n / L.
    """
    return (next_moment - moment) * lever
