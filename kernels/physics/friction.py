r"""Dry friction of whatever slides, after Coulomb, without a slip-speed parameter.

With N the normal force, v the sliding speed and mu(v) = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2):

    F = min(mu(v) N, stop |v|)   against the sliding,

`stop` being what takes away a given part of the speed in a step of length h (beta m_e / h; beta = 1/2 for contacts).
The second bound never reverses a speed and never chatters: what should rest creeps, the slower the smaller the step.
"""

from typing import Any

import warp as wp


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
def bounded(mu: Any, normal: Any, speed: Any, stop: Any):
    """Size [N] of the force against a sliding speed, at most mu N.

    Args:
        mu: of that speed (`coefficient`) [-].
        normal: N >= 0 [N].
        speed: |v| [m/s].
        stop: beta m_e / h [N s/m].
    """
    return wp.min(mu * normal, stop * speed)


@wp.func
def friction(normal: Any, speed: Any, stop: Any, law: Any):
    """Size [N] of the force against a sliding speed, at most mu(v) N.

    Args:
        normal: N >= 0 [N].
        speed: |v| [m/s].
        stop: beta m_e / h [N s/m].
        law: what rubs (`structs.Friction`).
    """
    return bounded(coefficient(speed, law), normal, speed, stop)
