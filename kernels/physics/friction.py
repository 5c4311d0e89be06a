r"""Dry friction of whatever slides, after Coulomb, without a slip-speed parameter.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2), friction Q is at most
mu(v) N. What sticks is held by a bristle (Dahl): over a step of length h it is stretched by v h, and

    b <- clamp(b + k h v, -mu N, mu N),    Q = clamp(b + c v, -mu N, mu N)   against the sliding,

c = t sqrt(k m_e / s), s = 0.2, t = 0.5, m_e the mass that friction has to stop. The bristle's stiffness k is that of
the contact along its surface, s m_e / h^2 at most, which the step can follow: so results do not depend on the step
where that is short. There is no creep at rest, at any step. A contact that opens forgets b. Of the power Q v that
friction takes, the bristle stores the energy b^2 / (2 k).

The joints' pins turn in bushes as neighboring links turn against each other. Joint i lies at roller i, between the
links i - 1 and i, of lengths L and unit vectors u, n being u turned by +90 degrees. Link i turns at dphi_i = (v_{i+1} -
v_i) . n_i / L_i, the joint at g_i = dphi_i - dphi_{i-1}. The pin, of radius r_p, is pressed by N_i = max(|T_{i-1}|,
|T_i|) and slides at |g_i| r_p; the moment on link i is

    |M_i| <= mu kappa r_p N_i   against g_i,

kappa telling how the pressure is spread: 1 for line contact, 4/pi worn in, pi/2 new. A joint that sticks is held as
above, g_i for v and 0.6 (m p^2 / 6) for m_e, with which all joints at once still decay. The moments M_i and -M_{i+1} of
its two joints on link i act as the couple of forces

    F_i = (M_{i+1} - M_i) n_i / L_i   on roller i,   -F_i on roller i + 1,

which stands beside the link's tension: forces and moments of all sum to zero, the power is the sum of M_i g_i.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, multiply_add, quotient, smaller

SPRING = 0.2
"""s: of the speed in a step, what a bristle takes at most; it then oscillates at 0.45 / h."""
DAMPER = 0.5
"""t: the same of the damper beside it, where the bristle is as stiff as that."""


@wp.func
def friction_coefficient(speed: Any, friction: Any):
    """mu(v) [-] at a sliding speed v >= 0.

    Args:
        speed: v [m/s].
        friction: of what rubs (`structs.Friction`).
    """
    mu = friction.mu_dynamic
    if friction.mu_static != friction.mu_dynamic:
        part = quotient(speed, friction.stribeck_speed)
        mu += (friction.mu_static - friction.mu_dynamic) * wp.exp(-part * part)
    return mu


@wp.func
def bristle_friction(most: Any, speed: Any, bristle: Any, spring: Any, damper: Any, stretch_part: Any):
    """Friction [N] against a sliding speed, at most mu N either way, and the force that its bristle then holds [N].

    Args:
        most: mu N [N].
        speed: v [m/s].
        bristle: force b that the bristle has held until now [N].
        spring: k h [N s/m].
        damper: c [N s/m].
        stretch_part: part of a step over which the bristle is stretched (`integrate.stretched_part`).
    """
    bristle_after = smaller(larger(-most, multiply_add(stretch_part * spring, speed, bristle)), most)
    return smaller(larger(-most, multiply_add(damper, speed, bristle_after)), most), bristle_after


@wp.func
def link_turning(d: Any, w: Any):
    """n / L (vector) [1/m] and rate of turning dphi [rad/s] of one link.

    Args:
        d: vector from roller i to roller i + 1 [m].
        w: velocity of roller i + 1 relative to roller i [m/s].
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
    """Moment M_i [N m] of a joint's friction on the link after it, and what its bristle then holds of -M_i [N m].

    Args:
        mu: [-].
        tension_before, tension_after: of the links before and after the joint [N].
        turn_before, turn_after: rates at which they turn [rad/s].
        bristle: moment that it has held until now [N m].
        chain: whose joint it is (`structs.Chain`).
        stretch_part: as in `bristle_friction`.
    """
    most = mu * chain.joint_arm * larger(wp.abs(tension_before), wp.abs(tension_after))
    drag, bristle_after = bristle_friction(
        most, turn_after - turn_before, bristle, chain.joint.spring, chain.joint.damper, stretch_part
    )
    return -drag, bristle_after


@wp.func
def joint_friction_coefficient(turn_before: Any, turn_after: Any, chain: Any):
    """mu [-] at the speed at which a joint's pin slides."""
    return friction_coefficient(wp.abs(turn_after - turn_before) * chain.pin_radius, chain.joint)


@wp.func
def joint_friction_power(moment: Any, turn_before: Any, turn_after: Any):
    """Power -M_i g_i [W] that a joint's friction takes.

    Args:
        moment: M_i [N m].
        turn_before, turn_after: rates at which the links before and after the joint turn [rad/s].
    """
    return moment * (turn_before - turn_after)


@wp.func
def couple_force(moment: Any, next_moment: Any, lever: Any):
    """Force [N] on roller i of the couple that joints i and i + 1 make on link i; its opposite acts on roller i + 1.

    Args:
        moment, next_moment: M_i and M_{i+1} [N m].
        lever: n / L of the link [1/m].
    """
    return (next_moment - moment) * lever
