"""Contact force laws: a penalty contact's force from its penetration and approach speed.

    hysteretic     F = K pen^n (1 + d min(v / v0, 1))     (Pedersen et al. 2004, eq. (15), (18), (19))
    Kelvin-Voigt   F = K pen^n + c v

never adhesive (F >= 0); v0 is the approach speed at the contact's first instant, not below a floor. d or c by a
restitution: `warpchain.drive.laws`.

Leapfrog's speeds are half a step behind the forces. With E = K pen^n, c = E d / v0 or Kelvin-Voigt's, m the roller's
mass, a the closing acceleration by all but this contact and D = h c / (2 m), the damper's speed u is

    u (1 + D (1 + G)) = v + (h / 2) (a - E / m) + D G u_0,    F = max(0, E + c min(u, v0)),                   (a)

u_0 that of the step before and G twice the body's answer if all its n seated rollers changed alike
(`warpchain.engine.contact_mobility`). A scheme with stages bounds c to

    c / (1 + (c h / (2 m))^4)^(1/4).
"""

from typing import Any

import warp as wp

from ..native import larger, multiply_add, quotient, smaller

UNBOUNDED = 1.0e30


@wp.func
def elastic_force(penetration: Any, stiffness: Any, exponent: Any):
    """Elastic force K pen^n [N] of a contact, eq. (15); `penetration` > 0 [m]."""
    if exponent == type(exponent)(1.0):
        return stiffness * penetration
    return stiffness * wp.exp(exponent * wp.log(penetration))


@wp.func
def hysteretic_damper(elastic: Any, impact_speed: Any, damping: Any):
    """Damper c [N s/m] of the hysteretic contact law, eq. (15), (18), (19), and its bounds [m/s].

    `elastic` is K pen^n [N], `impact_speed` v0 [m/s], `damping` d [-].
    """
    return quotient(elastic * damping, impact_speed), type(elastic)(-UNBOUNDED), impact_speed


@wp.func
def kelvin_voigt_damper(elastic: Any, impact_speed: Any, damping: Any):
    """Damper c [N s/m] of the Kelvin-Voigt contact law, and inactive bounds [m/s]."""
    return damping, type(elastic)(-UNBOUNDED), type(elastic)(UNBOUNDED)


FORCES = (hysteretic_damper, kelvin_voigt_damper)
"""Contact laws' functions by a law's number (`structs.ContactLaw.form`)."""


@wp.func
def law_damper(elastic: Any, impact_speed: Any, law: Any):
    """Damper c [N s/m] of the contact law `law`, and speeds [m/s] that bound it."""
    damper, slowest, fastest = hysteretic_damper(elastic, impact_speed, law.damping)
    for form in range(1, wp.static(len(FORCES))):
        if law.form == form:
            damper, slowest, fastest = wp.static(FORCES[form])(elastic, impact_speed, law.damping)
    if law.most_damping > type(elastic)(0.0):
        part = damper / law.most_damping
        damper = damper / wp.sqrt(wp.sqrt(type(elastic)(1.0) + part * part * part * part))
    return damper, slowest, fastest


@wp.func
def law_at_roller(law: Any, relative_mass: Any, mobility: Any):
    """Contact law for a roller of `relative_mass` times the chain's, `mobility` 1 over that."""
    if law.most_damping > type(mobility)(0.0):
        one = type(mobility)(1.0)
        law.most_damping = law.most_damping * ((one + law.answer) / (mobility + law.answer))
    law.yielding = law.yielding * mobility
    law.answer = law.answer * relative_mass
    return law


@wp.func
def contact_force(elastic: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """Normal force [N] of a contact law, never adhesive, and its damper's speed u [m/s], (a).

    `elastic` is K pen^n [N], `speed` v, `growth` a, `impact_speed` v0, `speed_before` u_0 (SI).
    """
    damper, slowest, fastest = law_damper(elastic, impact_speed, law)
    one = type(elastic)(1.0)
    led = multiply_add(-law.yielding, elastic, multiply_add(law.lag, growth, speed))
    give = law.yielding * damper
    now = quotient(multiply_add(give * law.answer, speed_before, led), multiply_add(give, one + law.answer, one))
    now = smaller(larger(now, slowest), fastest)
    return larger(multiply_add(damper, now, elastic), type(elastic)(0.0)), now
