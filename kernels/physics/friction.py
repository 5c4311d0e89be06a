"""Dry friction after Coulomb, without a slip-speed parameter, of contacts, joints and bearings.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2), friction Q is at most
mu(v) N. What sticks is held by a bristle (Dahl), which a step of length h stretches by v h:

    b <- clamp(b + k h v, -mu N, mu N),    Q = clamp(b + c v, -mu N, mu N)   against the sliding,

c = t sqrt(k m_e / s), s = 0.2, t = 0.5, m_e the mass that friction has to stop, k the contact's stiffness along its
surface, at most s m_e / h^2. There is no creep at rest. A contact that opens forgets b. The bristle stores b^2 / (2 k).

Joint i is at roller i, between the links i - 1 and i, of lengths L and unit vectors u, n being u turned by +90 degrees.
Link i turns at dphi_i = (v_{i+1} - v_i) . n_i / L_i, the joint at g_i = dphi_i - dphi_{i-1}. The pin, of radius r_p, is
pressed by N_i = max(|T_{i-1}|, |T_i|) and slides at |g_i| r_p; the moment on link i is

    |M_i| <= mu kappa r_p N_i   against g_i,

kappa by the spread of pressure: 1 for line contact, 4/pi worn in, pi/2 new. Its bristle has g_i for v and
0.6 (m p^2 / 6) for m_e, with which all joints at once still decay. M_i and -M_{i+1} act on link i as the couple

    F_i = (M_{i+1} - M_i) n_i / L_i   on roller i,   -F_i on roller i + 1;

the power is the sum of M_i g_i.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, multiply_add, quotient, smaller

SPRING = 0.2
"""s: most of its speed that a friction bristle takes in a step."""
DAMPER = 0.5
"""t: share of the speed that the stiffest friction bristle's damper takes."""


@wp.func
def friction_coefficient(speed: Any, friction: Any):
    """Coefficient of friction mu(v) [-] at a sliding speed v >= 0 [m/s]."""
    mu = friction.mu_dynamic
    if friction.mu_static != friction.mu_dynamic:
        part = quotient(speed, friction.stribeck_speed)
        mu += (friction.mu_static - friction.mu_dynamic) * wp.exp(-part * part)
    return mu


@wp.func
def bristle_friction(most: Any, speed: Any, bristle: Any, spring: Any, damper: Any, stretch_part: Any):
    """Friction [N] against a sliding speed, and the force [N] that its bristle then holds.

    Args:
        most: mu N [N].
        speed: v [m/s].
        bristle: b until now [N].
        spring, damper: k h and c [N s/m].
        stretch_part: of a step over which the bristle is stretched (`integrate.stretched_part`).
    """
    bristle_after = smaller(larger(-most, multiply_add(stretch_part * spring, speed, bristle)), most)
    return smaller(larger(-most, multiply_add(damper, speed, bristle_after)), most), bristle_after


@wp.func
def link_turning(d: Any, w: Any):
    """n / L (vector) [1/m] and rate of turning dphi [rad/s] of a link.

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

    `tension_*` [N] and `turn_*` [rad/s] are those of the links before and after.
    """
    most = mu * chain.joint_arm * larger(wp.abs(tension_before), wp.abs(tension_after))
    drag, bristle_after = bristle_friction(
        most, turn_after - turn_before, bristle, chain.joint.spring, chain.joint.damper, stretch_part
    )
    return -drag, bristle_after


@wp.func
def joint_friction_coefficient(turn_before: Any, turn_after: Any, chain: Any):
    """Coefficient of friction [-] at the speed at which a joint's pin slides."""
    return friction_coefficient(wp.abs(turn_after - turn_before) * chain.pin_radius, chain.joint)


@wp.func
def joint_friction_power(moment: Any, turn_before: Any, turn_after: Any):
    """Power -M_i g_i [W] of friction in a chain's joint."""
    return moment * (turn_before - turn_after)


@wp.func
def couple_force(moment: Any, next_moment: Any, lever: Any):
    """Force [N] on roller i of the couple by which link i's joints act; opposite on roller i + 1.

    `moment`, `next_moment`: M_i, M_{i+1} [N m]; `lever`: n / L [1/m].
    """
    return (next_moment - moment) * lever
