r"""The response of one roller's contact with a sprocket or guide, and the memory that the contact keeps.

A contact keeps the approach speed v0 of its first instant until it opens. What stands there of an open one is not
positive: `UNTOUCHED`, or between a sprocket's teeth `SEPARATED` once the roller has left them in its pass, or in a
guide-bar `MISSED` if the roller did not come in through the face: it then feels no force until it has left. A roller
keeps its seat while it is engaged, so that no angle is computed in the time loop. The relative velocity is that of the
partner's material point against the roller, v = v_s + omega x r - v_i (eq. (10)-(14)); the force acts on the roller,
its opposite on the partner's body at the same point, which conserves angular momentum (eq. (16) with the full cross
product). Penetration and normal are those of `tooth.in_teeth`, `guide.on_guide` or `guide.on_profile`.

    misses      whether it is in a bar without having come through its face
    respond     the contact's force vector and its elastic part, v0, the speed at which it damps
    stored      its elastic energy
    rub         the friction on the roller
    dissipated  the power of damping and friction
    reaction    the moment of the force on the partner's body

**Mean over a step.** Leapfrog's kick is the force's impulse over a step, and max(0, pen) has a kink: where in a step a
roller meets its partner would decide how deep it stands as the first force acts. So forces go by the mean of
max(0, pen + v tau) over the step, tau from -h/2 to h/2, v the approach speed by all but the contact and w = |v| h / 2,

    pen' = pen  where pen >= w,   (pen + w)^2 / (4 w)  where -w < pen < w,   else 0,                          (a)

and a contact begins up to half a step before it is reached, at v0 = v - a pen / v, a the closing acceleration: the
speed where pen is 0, or v - a h / 2 where pen is more than w. A scheme with stages has w = 0.

What a contact takes is the power of its whole force, which holds the energy that is lost in (a), less the change of
its elastic energy.

Friction acts at the roller's center like the contact force, against what the partner's material point there slides
along the contact: so the reaction's moment and the power are exact, and no roller needs an angle.
"""

from typing import Any

import warp as wp

from ..native import larger, multiply_add, products, quotient, reciprocal, smaller
from ..number import leading
from .friction import coefficient, held_back
from .impact import contact_force, elastic_force

AWAY = wp.constant(-1.0)
"""Penetration [m] of a roller that no partner is near."""
UNTOUCHED = wp.constant(0.0)
SEPARATED = wp.constant(-1.0)
MISSED = wp.constant(-1.0)


@wp.func
def sized(direction: Any, size: Any):
    """A vector [N] of a size and a direction."""
    return size * direction


@wp.func
def respond(penetration: Any, normal: Any, relative: Any, gaining: Any, impact_speed: Any, speed_before: Any, law: Any):
    """The force of a contact, eq. (15)-(19), as `pressed`, from vectors.

    Args:
        penetration: pen, negative where they do not touch yet [m].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s], positive along the normal while the
            penetration grows.
        gaining: acceleration of that velocity, by all but this contact [m/s^2].
        impact_speed, speed_before, law: as in `pressed`.

    Returns:
        Force on the roller (vector), and what `pressed` does.
    """
    speed = products(relative[0], normal[0], relative[1], normal[1])
    growth = products(gaining[0], normal[0], gaining[1], normal[1])
    mean, elastic, size, first, damper_speed = pressed(penetration, speed, growth, impact_speed, speed_before, law)
    return sized(normal, size), mean, elastic, size, first, damper_speed


@wp.func
def pressed(penetration: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """The force of a contact along its normal: its impulse over a leapfrog step, over the step (a).

    Args:
        penetration: pen at the step's instant, negative where they do not touch [m].
        speed: at which it grows [m/s], half a step before with leapfrog.
        growth: acceleration of that speed, by all but this contact [m/s^2].
        impact_speed: v0 of this contact, not positive if it was open until now [m/s].
        speed_before: the speed at which its damper acted in the step before [m/s].
        law: the contact's parameters (`structs.ContactLaw`).

    Returns:
        Mean penetration over the step [m], 0 where the contact is open, and nothing else then counts; the elastic part
        of the force and the force [N], v0 and the speed at which the damper acts [m/s].
    """
    zero = type(speed)(0.0)
    closing = multiply_add(law.lag, growth, speed)
    ahead = smaller(wp.abs(closing) * law.lag, law.ahead)
    inverse = wp.where(ahead > zero, reciprocal(ahead), zero)
    part = larger(penetration + ahead, zero)
    mean = wp.where(penetration >= ahead, larger(penetration, zero), type(speed)(0.25) * part * part * inverse)
    begins = impact_speed <= zero
    met = larger(multiply_add(-growth * smaller(penetration, ahead), law.lag * inverse, closing), law.speed_floor)
    first = wp.where(begins, met, impact_speed)
    elastic = elastic_force(mean, law.stiffness, law.exponent)
    size, damper_speed = contact_force(elastic, speed, growth, first, wp.where(begins, zero, speed_before), law)
    closed = mean > zero
    return mean, elastic, wp.where(closed, size, zero), first, wp.where(closed, damper_speed, zero)


@wp.func
def steady_force(penetration: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """The force of a contact that neither opens nor closes within the step, which `pressed` gives with more work.

    Arguments as of `pressed`.

    Returns:
        The force [N] and the speed at which the damper acts [m/s], both 0 where the contact is open.
    """
    zero = type(speed)(0.0)
    elastic = elastic_force(larger(penetration, zero), law.stiffness, law.exponent)
    size, damper_speed = contact_force(elastic, speed, growth, impact_speed, speed_before, law)
    closed = penetration > zero
    return wp.where(closed, size, zero), wp.where(closed, damper_speed, zero)


@wp.func
def is_changing(penetration: Any, speed: Any, growth: Any, impact_speed: Any, law: Any):
    """1 where a contact opens or closes within the step, or begins (arguments as of `pressed`), else 0."""
    zero = type(speed)(0.0)
    ahead = smaller(wp.abs(multiply_add(law.lag, growth, speed)) * law.lag, law.ahead)
    begins = wp.where(impact_speed <= zero, penetration, zero)
    return wp.where(wp.abs(penetration) < ahead, 1, wp.where(begins > zero, 1, 0))


@wp.func
def stored(penetration: Any, elastic: Any, law: Any):
    """Elastic energy [J] of a contact: `elastic` [N] is the force without damping."""
    return quotient(elastic * penetration, law.exponent + type(penetration)(1.0))


@wp.func
def after_teeth(impact_speed: Any):
    """The memory of an open contact with teeth, from its memory of before."""
    return wp.where(impact_speed == type(impact_speed)(UNTOUCHED), impact_speed, type(impact_speed)(SEPARATED))


@wp.func
def misses(penetration: Any, impact_speed: Any, bar: Any):
    """Whether a roller, `penetration` > 0 deep in a guide-bar, feels nothing of it: it did not come through the face.

    It is first seen too deep, since it came from behind, through a thin bar, or began the run in there; and it has not
    left since (`impact_speed`).
    """
    first_seen = impact_speed == type(penetration)(UNTOUCHED)
    return impact_speed < type(penetration)(UNTOUCHED) or (first_seen and penetration > bar.deepest_entry)


@wp.func
def rub(size: Any, normal: Any, relative: Any, held: Any, friction: Any, stretched: Any):
    """Friction on the roller (vector) [N] in a contact that presses with `size` >= 0, and what the contact then holds.

    Args:
        size: the contact force's magnitude [N].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s].
        held: friction that the contact has held until now [N], 0 if it was open.
        friction: of the contact (`structs.Friction`).
        stretched: as in `friction.held_back`.
    """
    mu = sliding_coefficient(normal, relative, friction)
    drag, holds = rub_at(mu, size, normal, relative, held, friction, stretched)
    return drag, holds


@wp.func
def rub_evenly(size: Any, normal: Any, relative: Any, held: Any, friction: Any, stretched: Any):
    """As `rub`, of one coefficient at all speeds."""
    drag, holds = rub_at(friction.mu_dynamic, size, normal, relative, held, friction, stretched)
    return drag, holds


@wp.func
def sliding_coefficient(normal: Any, relative: Any, friction: Any):
    """mu [-] at the speed at which a contact slides; arguments as of `rub`."""
    return coefficient(wp.abs(sliding_speed(relative[0], relative[1], normal[0], normal[1])), friction)


@wp.func
def sliding_speed(relative_x: Any, relative_y: Any, normal_x: Any, normal_y: Any):
    """Speed at which a contact slides [m/s], along its normal turned by +90 degrees; arguments as of `rub`."""
    return products(relative_x, -normal_y, relative_y, normal_x)


@wp.func
def rub_at(mu: Any, size: Any, normal: Any, relative: Any, held: Any, friction: Any, stretched: Any):
    """As `rub`, of a given coefficient."""
    along = type(normal)(-normal[1], normal[0])
    speed = sliding_speed(relative[0], relative[1], normal[0], normal[1])
    drag, holds = held_back(mu * size, speed, held, friction.spring, friction.damper, stretched)
    return sized(along, drag), holds


@wp.func
def dissipated(force: Any, relative: Any, gaining: Any, lag: Any):
    """Power [W] that dampers or friction take, at the mean of the speeds before and after the step.

    With the speed before it alone, the energy balance would drift with the step.

    Args:
        force: of the damper or of friction on the roller [N].
        relative: velocity of the partner's material point less the roller's, `lag` before the forces' instant [m/s].
        gaining: acceleration of that velocity, with all that acts (`gained`) [m/s^2].
        lag: half a step with leapfrog, else 0 [s].
    """
    return power_taken(force[0], force[1], relative[0] + lag * gaining[0], relative[1] + lag * gaining[1])


@wp.func
def power_taken(force_x: Any, force_y: Any, speed_x: Any, speed_y: Any):
    """Power [W] of a force [N] at a velocity [m/s], both by their components."""
    return force_x * speed_x + force_y * speed_y


@wp.func
def reaction(arm: Any, force: Any):
    """Moment [N m] about the center of the partner's body of a force on the roller, which is `arm` away from it."""
    return products(arm[1], force[0], -arm[0], force[1])


@wp.func
def surface_velocity(body: Any, arm: Any):
    """Velocity of a body's material point [m/s], `arm` from its center."""
    v = leading(body.velocity)
    omega = leading(body.speed)
    return type(arm)(v[0] - omega * arm[1], v[1] + omega * arm[0])


@wp.func
def gained(straight: Any, angular: Any, arm: Any, acceleration: Any):
    """Acceleration [m/s^2] of the velocity of a body's material point less a roller's.

    Of the body those of the step before count, of the roller all that is known. The arm is the one of the forces'
    instant, so nothing centripetal is in it.

    Args:
        straight: of the body's center [m/s^2].
        angular: of its angle [rad/s^2].
        arm: the point from the center [m].
        acceleration: the roller's [m/s^2].
    """
    x = multiply_add(-angular, arm[1], straight[0])
    return type(arm)(x - acceleration[0], multiply_add(angular, arm[0], straight[1]) - acceleration[1])


@wp.func
def turned_by(x: Any, y: Any, cosine: Any, sine: Any):
    """As `turned`, of a direction's components."""
    return products(x, cosine, -y, sine), products(x, sine, y, cosine)


@wp.func
def turned(direction: Any, cosine: Any, sine: Any):
    """`direction` turned by the angle whose cosine and sine are given."""
    x, y = turned_by(direction[0], direction[1], cosine, sine)
    return type(direction)(x, y)
