r"""Contact force laws: the force of a penalty contact from its penetration and approach speed.

Lankarani and Nikravesh (Pedersen et al. 2004, eq. (15), (18), (19)):

    F = K pen^n [1 + (3 (1 - e^2) / 4) v / v0],    F >= 0,

v0 the approach speed at the contact's first instant, not below a floor. The elastic part K pen^n is the derivative of
the contact's energy K pen^(n+1) / (n + 1); the rest of the force dissipates. To add a law: write its function, give it
the next number, and name it in `contact_force` and in the package's table of laws.
"""

from typing import Any

import warp as wp

from .root import reciprocal

LANKARANI_NIKRAVESH = wp.constant(0)


@wp.func
def elastic_force(penetration: Any, stiffness: Any, exponent: Any):
    """K pen^n [N], eq. (15) without damping; `penetration` > 0 [m]."""
    if exponent == type(exponent)(1.0):
        return stiffness * penetration
    return stiffness * wp.exp(exponent * wp.log(penetration))


@wp.func
def lankarani_nikravesh(elastic: Any, speed: Any, impact_speed: Any, hysteresis: Any):
    """Force [N] after eq. (15), (18), (19); `hysteresis` is 3 (1 - e^2) / 4, `impact_speed` is v0 [m/s]."""
    return elastic * (type(elastic)(1.0) + hysteresis * speed * reciprocal(impact_speed))


@wp.func
def contact_force(elastic: Any, speed: Any, impact_speed: Any, law: Any):
    """Force [N] of the contact law that `law` names, never adhesive.

    Args:
        elastic: K pen^n [N].
        speed: approach speed v [m/s], positive while the penetration grows.
        impact_speed: v0 [m/s].
        law: the contact's parameters (`structs.ContactLaw`).
    """
    force = lankarani_nikravesh(elastic, speed, impact_speed, law.hysteresis)
    return wp.max(force, type(elastic)(0.0))
