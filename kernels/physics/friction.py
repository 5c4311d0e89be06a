"""Dry friction after Coulomb, without a slip-speed parameter, of contacts, joints and bearings.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2), friction Q is at most
mu(v) N. What sticks is held by a bristle (Dahl), which a step of length h stretches by v h:

    b <- clamp(b + k h v, -mu N, mu N),    Q = clamp(b + c v, -mu N, mu N)   against the sliding,

c = t sqrt(k m_e / s), s = 0.2, t = 0.5, m_e the mass that friction has to stop. The bristle's stiffness k is that of
the contact along its surface, at most s m_e / h^2, which the step can follow. There is no creep at rest, at any step. A
contact that opens forgets b. Of the power Q v the bristle stores the energy b^2 / (2 k).

Joint i is at roller i, between the links i - 1 and i, of lengths L and unit vectors u, n being u turned by +90 degrees.
Link i turns at dphi_i = (v_{i+1} - v_i) . n_i / L_i, the joint at g_i = dphi_i - dphi_{i-1}. The pin, of radius r_p, is
pressed by N_i = max(|T_{i-1}|, |T_i|) and slides at |g_i| r_p; the moment on link i is

    |M_i| <= mu kappa r_p N_i   against g_i,

kappa by how the pressure is spread: 1 for line contact, 4/pi worn in, pi/2 new. A bristle holds it as above, g_i for v
and 0.6 (m p^2 / 6) for m_e, with which all joints at once still decay. The moments M_i and -M_{i+1} on link i act as
the couple of forces

    F_i = (M_{i+1} - M_i) n_i / L_i   on roller i,   -F_i on roller i + 1,

so that forces and moments of all sum to zero; the power is the sum of M_i g_i.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, multiply_add, quotient, smaller

SPRING = 0.2
"""s: share of the speed that a friction bristle takes in a step at most; it oscillates at 0.45 / h."""
DAMPER = 0.5
"""t: share of the speed that a friction bristle's damper takes in a step, the bristle as stiff as `SPRING` lets."""


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
    """Friction [N] against a sliding speed, at most `most` = mu N, and the force [N] that its bristle then holds.

    Args:
        speed: v [m/s].
        bristle: force b held until now [N].
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
    """Friction moment M_i [N m] of a chain's joint on the link after it, and what its bristle then holds of -M_i [N m].

    `tension_*` [N] and `turn_*` [rad/s] are those of the links before and after; see `bristle_friction`.
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
    """Power -M_i g_i [W] of friction in a joint with `moment` M_i [N m], whose links turn at `turn_*` [rad/s]."""
    return moment * (turn_before - turn_after)


@wp.func
def couple_force(moment: Any, next_moment: Any, lever: Any):
    """Force [N] on roller i of the couple by which joints i and i + 1 act on link i; its opposite is on roller i + 1.

    `moment`, `next_moment`: M_i, M_{i+1} [N m]; `lever`: n / L [1/m].
    """
    return (next_moment - moment) * lever
