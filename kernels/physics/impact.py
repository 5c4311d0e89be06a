r"""Contact force laws: the force of a penalty contact from its penetration and approach speed.

    hysteretic     F = K pen^n (1 + d min(v / v0, 1))     (Pedersen et al. 2004, eq. (15), (18), (19))
    Kelvin-Voigt   F = K pen^n + c v

never adhesive (F >= 0); v0 is the approach speed at the contact's first instant, not below a floor. A free impact only
slows down and never passes v / v0 = 1; a roller that stays in its seat and is pressed in faster than it came would
without the bound be damped by the speed of its entry. The elastic part K pen^n is the derivative of the contact's
energy K pen^(n+1) / (n + 1); the rest of the force dissipates. What d or c is in terms of a restitution stands in the
package's table of laws (`warpchain.drive.laws`), where Lankarani-Nikravesh, Flores and Hunt-Crossley differ in d only.

Under a load N a seated roller's damper is d N / v0, whatever the speed: where it came slowly, that turns its speed
around in each step, and the roller chatters between K pen (1 + d) and no force. So damping takes away no more than the
whole approach speed in a step, m_e v / h. A free impact has d K pen / v0 <= d m_e omega, which is below that for any
step worth taking: restitution stays.

To add a law: write its function with the arguments of `hysteretic`, put it at the end of `FORCES`, and name it in the
package's table.
"""

from typing import Any

import warp as wp

from ..native import larger, reciprocal, smaller


@wp.func
def elastic_force(penetration: Any, stiffness: Any, exponent: Any):
    """K pen^n [N], eq. (15) without damping; `penetration` > 0 [m]."""
    if exponent == type(exponent)(1.0):
        return stiffness * penetration
    return stiffness * wp.exp(exponent * wp.log(penetration))


@wp.func
def hysteretic(elastic: Any, speed: Any, impact_speed: Any, damping: Any):
    """Force [N] after eq. (15), (18), (19); `damping` is the hysteresis factor d [-], `impact_speed` v0 [m/s]."""
    one = type(elastic)(1.0)
    return elastic * (one + damping * wp.min(speed * reciprocal(impact_speed), one))


@wp.func
def kelvin_voigt(elastic: Any, speed: Any, impact_speed: Any, damping: Any):
    """Force [N] of a spring and a damper side by side; `damping` is c [N s/m]."""
    return elastic + damping * speed


FORCES = (hysteretic, kelvin_voigt)
"""The laws' functions; a law's number (`structs.ContactLaw.form`) is its place here."""


@wp.func
def contact_force(elastic: Any, speed: Any, impact_speed: Any, law: Any):
    """Force [N] of the contact law that `law` names, never adhesive.

    Args:
        elastic: K pen^n [N].
        speed: approach speed v [m/s], positive while the penetration grows.
        impact_speed: v0 [m/s].
        law: the contact's parameters (`structs.ContactLaw`).
    """
    force = hysteretic(elastic, speed, impact_speed, law.damping)
    for form in range(1, wp.static(len(FORCES))):
        if law.form == form:
            force = wp.static(FORCES[form])(elastic, speed, impact_speed, law.damping)
    most = law.most_damping * wp.abs(speed)
    return wp.max(wp.clamp(force, elastic - most, elastic + most), type(elastic)(0.0))


@wp.func
def linear_force(penetration: Any, speed: Any, impact_speed: Any, law: Any):
    """Force [N] and v0 [m/s] of a linear hysteretic law (form 0, exponent 1), without branches, as `contact_force`."""
    first = wp.where(impact_speed <= type(speed)(0.0), larger(speed, law.speed_floor), impact_speed)
    elastic = law.stiffness * penetration
    one = type(speed)(1.0)
    most = law.most_damping * wp.abs(speed)
    force = elastic * (one + law.damping * smaller(speed * reciprocal(first), one))
    return larger(smaller(larger(force, elastic - most), elastic + most), type(speed)(0.0)), first
