r"""Contact force laws: the force of a penalty contact from its penetration and approach speed.

    hysteretic     F = K pen^n (1 + d min(v / v0, 1))     (Pedersen et al. 2004, eq. (15), (18), (19))
    Kelvin-Voigt   F = K pen^n + c v

never adhesive (F >= 0); v0 is the approach speed at the contact's first instant, not below a floor. A free impact only
slows down and never passes v / v0 = 1; a roller that stays in its seat and is pressed in faster than it came would
without the bound be damped by the speed of its entry. The elastic part E = K pen^n is the derivative of the contact's
energy K pen^(n+1) / (n + 1); the rest of the force dissipates. What d or c is in terms of a restitution stands in the
package's table of laws (`warpchain.drive.laws`), where Lankarani-Nikravesh, Flores and Hunt-Crossley differ in d only.

**Centered in time.** Leapfrog's speeds are half a step behind the forces. With c = E d / v0, or Kelvin-Voigt's, m the
roller's mass and a the closing acceleration along the normal by all but this contact, the approach speed at the
forces' instant is that which solves v' = v + (h / 2) (a - F / m),

    v' = (v + (h / 2) (a - E / m)) / (1 + h c / (2 m)),    F = max(0, E + c min(v', v0)).

The partner's body has in a its acceleration of the step before, alpha_0. A light body would answer all its contacts'
dampers at once and gain energy, so each remembers the speed u_0 at which its damper acted then. With D = h c / (2 m)
and G twice the body's answer if all its n seated rollers changed alike, 2 n m R^2 / J of a body of inertia J that turns
(with the ratios of its train), n m d^2 / I of the arm and n m / M of the slider that carry it,

    u (1 + D (1 + G)) = v + (h / 2) (a - E / m) + D G u_0,    F = max(0, E + c min(u, v0)).                   (a)

At rest and in blows, where D is small, that is the same. It is of second order in h, and turns no speed around however
strong the damper and however light the body: a seated roller under a load N has d N / v0, whatever its speed. The
damper lags behind by a step at most. To remember its force c u in place of u gains energy in blows: c grows with the
penetration and falls with it, and what it was would outlast what it is.

A scheme with stages has the speed of the forces' instant; its damper is bounded where its
step could not follow, by an error of fourth order:

    c / (1 + (c h / (2 m))^4)^(1/4).

To add a law: write its function with the arguments of `hysteretic_damper`, put it at the end of `FORCES`, and name it
in the package's table.
"""

from typing import Any

import warp as wp

from ..native import larger, multiply_add, quotient, smaller

UNBOUNDED = 1.0e30


@wp.func
def elastic_force(penetration: Any, stiffness: Any, exponent: Any):
    """K pen^n [N], eq. (15) without damping; `penetration` > 0 [m]."""
    if exponent == type(exponent)(1.0):
        return stiffness * penetration
    return stiffness * wp.exp(exponent * wp.log(penetration))


@wp.func
def hysteretic_damper(elastic: Any, impact_speed: Any, damping: Any):
    """Damper c [N s/m] after eq. (15), (18), (19), and the speeds [m/s] below and above which it grows no more.

    Args:
        elastic: K pen^n [N].
        impact_speed: v0 [m/s].
        damping: hysteresis factor d [-].
    """
    return quotient(elastic * damping, impact_speed), type(elastic)(-UNBOUNDED), impact_speed


@wp.func
def kelvin_voigt_damper(elastic: Any, impact_speed: Any, damping: Any):
    """Damper c [N s/m] beside the spring, which is `damping` itself, and speeds [m/s] that do not bound it."""
    return damping, type(elastic)(-UNBOUNDED), type(elastic)(UNBOUNDED)


FORCES = (hysteretic_damper, kelvin_voigt_damper)
"""The laws' functions; a law's number (`structs.ContactLaw.form`) is its place here."""


@wp.func
def law_damper(elastic: Any, impact_speed: Any, law: Any):
    """Damper c [N s/m] of the contact law that `law` names, and the speeds [m/s] that bound it.

    Arguments as of `contact_force`.
    """
    damper, slowest, fastest = hysteretic_damper(elastic, impact_speed, law.damping)
    for form in range(1, wp.static(len(FORCES))):
        if law.form == form:
            damper, slowest, fastest = wp.static(FORCES[form])(elastic, impact_speed, law.damping)
    if law.most_damping > type(elastic)(0.0):
        part = damper / law.most_damping
        damper = damper / wp.sqrt(wp.sqrt(type(elastic)(1.0) + part * part * part * part))
    return damper, slowest, fastest


@wp.func
def contact_force(elastic: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """Force [N] of a contact law, never adhesive.

    Args:
        elastic: K pen^n [N].
        speed: approach speed v [m/s], positive while the penetration grows.
        growth: a, of that speed by all but this contact [m/s^2].
        impact_speed: v0 [m/s].
        speed_before: u_0, the speed at which the damper acted in the step before [m/s].
        law: the contact's parameters (`structs.ContactLaw`).

    Returns:
        The force [N], and the speed u at which the damper acts [m/s].
    """
    damper, slowest, fastest = law_damper(elastic, impact_speed, law)
    one = type(elastic)(1.0)
    led = multiply_add(-law.yielding, elastic, multiply_add(law.lag, growth, speed))
    give = law.yielding * damper
    now = quotient(multiply_add(give * law.answer, speed_before, led), multiply_add(give, one + law.answer, one))
    now = smaller(larger(now, slowest), fastest)
    return larger(multiply_add(damper, now, elastic), type(elastic)(0.0)), now
