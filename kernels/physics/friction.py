r"""Dry friction of whatever slides, after Coulomb, without a slip-speed parameter.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2):

    F = min(mu(v) N, stop |v|)   against the sliding,

`stop` being what takes away a given part of the speed in a step of length h (beta m_e / h; beta = 1/2 for contacts).
The second bound never reverses a speed and never chatters: what should rest creeps, the slower the smaller the step.

The joints' pins turn in bushes as neighboring links turn against each other. Joint i lies at roller i, between the
links i - 1 and i, of lengths L and unit vectors u, n being u turned by +90 degrees. Link i turns at dphi_i = (v_{i+1} -
v_i) . n_i / L_i, the joint at g_i = dphi_i - dphi_{i-1}. The pin, of radius r_p, is pressed by N_i = max(|T_{i-1}|,
|T_i|) and slides at |g_i| r_p; the moment on link i is

    |M_i| = min(mu kappa r_p N_i, 0.375 (m p^2 / 6) |g_i| / h)   against g_i,

kappa telling how the pressure is spread: 1 for line contact, 4/pi worn in, pi/2 new. With the second bound all joints
at once still decay. The moments M_i and -M_{i+1} of its two joints on link i act as the couple of forces

    F_i = (M_{i+1} - M_i) n_i / L_i   on roller i,   -F_i on roller i + 1,

which stands beside the link's tension: forces and moments of all sum to zero, the power is the sum of M_i g_i.
"""

from typing import Any

import warp as wp

from ..native import inverse_root


@wp.func
def coefficient(speed: Any, law: Any):
    """mu(v) [-] at a sliding speed v >= 0.

    Args:
        speed: v [m/s].
        law: what rubs (`structs.Friction`).
    """
    mu = law.mu_dynamic
    if law.mu_static != law.mu_dynamic:
        part = speed / law.stribeck_speed
        mu += (law.mu_static - law.mu_dynamic) * wp.exp(-part * part)
    return mu


@wp.func
def friction(mu: Any, normal: Any, speed: Any, stop: Any):
    """Size [N] of the force against a sliding speed, at most mu N.

    Args:
        mu: of that speed (`coefficient`) [-].
        normal: N >= 0 [N].
        speed: |v| [m/s].
        stop: beta m_e / h [N s/m].
    """
    return wp.min(mu * normal, stop * speed)


@wp.func
def turning(d: Any, w: Any):
    """n / L [1/m] and rate of turning dphi [rad/s] of one link.

    Args:
        d: vector from roller i to roller i + 1 [m].
        w: velocity of roller i + 1 relative to roller i [m/s].
    """
    inverse = inverse_root(wp.dot(d, d))
    unit = d * inverse
    lever = type(d)(-unit[1] * inverse, unit[0] * inverse)
    return lever, wp.dot(lever, w)


@wp.func
def rubbing_moment(mu: Any, tension_before: Any, turn_before: Any, tension_after: Any, turn_after: Any, joint: Any):
    """Moment M_i [N m] of a joint on the link after it, of a given coefficient.

    Args:
        mu: [-].
        tension_before, tension_after: of the links before and after the joint [N].
        turn_before, turn_after: rates at which they turn [rad/s].
        joint: of the chain (`structs.Joint`).
    """
    rate = turn_after - turn_before
    normal = wp.max(wp.abs(tension_before), wp.abs(tension_after))
    size = wp.min(mu * joint.arm * normal, joint.stop * joint.pin_radius * wp.abs(rate))
    return wp.where(rate > type(rate)(0.0), -size, size)


@wp.func
def joint_moment(tension_before: Any, turn_before: Any, tension_after: Any, turn_after: Any, joint: Any):
    """Moment M_i [N m] as from `rubbing_moment`, of the coefficient at which the pin slides."""
    mu = coefficient(wp.abs(turn_after - turn_before) * joint.pin_radius, joint.law)
    return rubbing_moment(mu, tension_before, turn_before, tension_after, turn_after, joint)


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
