r"""The forces of one roller's contact with a sprocket or guide, its energy and powers, and what the contact remembers.

A contact keeps the approach speed v0 of its first instant until it opens. What an open one keeps is not positive:
`UNTOUCHED`; between a sprocket's teeth `SEPARATED` once the roller has left them in its pass; in a guide `MISSED` if
the roller did not come in through the face: it then feels no force until it has left. A roller keeps its seat while it
is engaged, so that no angle is computed in the time loop. The relative velocity is that of the partner's material point
against the roller, v = v_s + omega x r - v_i (eq. (10)-(14)); the force acts on the roller, its opposite on the
partner's body at the same point, which conserves angular momentum (eq. (16) with the full cross product). Penetration
and normal are those of `tooth.tooth_contact`, `guide.bar_contact` or `guide.profile_contact`.

**Mean over a step.** Leapfrog's kick is the force's impulse over a step, and max(0, pen) has a kink: where in a step a
roller meets its partner would decide how deep it stands as the first force acts. So forces go by the mean of
max(0, pen + v tau) over the step, tau from -h/2 to h/2, v the approach speed by all but the contact and w = |v| h / 2,

    pen' = pen  where pen >= w,   (pen + w)^2 / (4 w)  where -w < pen < w,   else 0,                          (a)

and a contact begins up to half a step before it is reached, at v0 = v - a pen / v, a the closing acceleration: the
speed where pen is 0, or v - a h / 2 where pen is more than w. A scheme with stages has w = 0.

A contact takes the power of its whole force, which includes the energy that is lost in (a), less the change of its
elastic energy.

Friction acts at the roller's center like the contact force, against what the partner's material point there slides
along the contact: so the reaction's moment and the power are exact, and no roller needs an angle.
"""

from typing import Any

import warp as wp

from ..native import larger, multiply_add, products, quotient, reciprocal, smaller
from ..number import leading_value
from .friction import bristle_friction, friction_coefficient
from .impact import contact_force, elastic_force

AWAY = wp.constant(-1.0)
"""Penetration [m] of a roller that no partner is near."""
UNTOUCHED = wp.constant(0.0)
SEPARATED = wp.constant(-1.0)
MISSED = wp.constant(-1.0)


@wp.func
def force_vector(direction: Any, size: Any):
    """A force [N] of a size [N] along a unit vector."""
    return size * direction


@wp.func
def normal_force_vector(
    penetration: Any, normal: Any, relative: Any, acceleration: Any, impact_speed: Any, speed_before: Any, law: Any
):
    """The normal force of a contact as a vector, eq. (15)-(19).

    Args:
        penetration: pen, negative where they do not touch yet [m].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s], positive along the normal while the
            penetration grows.
        acceleration: of that velocity, by all but this contact [m/s^2].
        impact_speed, speed_before, law: as in `normal_force`.

    Returns:
        Force on the roller (vector) [N], and what `normal_force` returns.
    """
    speed = products(relative[0], normal[0], relative[1], normal[1])
    growth = products(acceleration[0], normal[0], acceleration[1], normal[1])
    mean, elastic, size, first, damper_speed = normal_force(penetration, speed, growth, impact_speed, speed_before, law)
    return force_vector(normal, size), mean, elastic, size, first, damper_speed


@wp.func
def normal_force(penetration: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """The normal force of a contact: its impulse over a leapfrog step, over the step (a).

    Args:
        penetration: pen at the step's instant, negative where they do not touch [m].
        speed: at which it grows [m/s], half a step before with leapfrog.
        growth: acceleration of that speed, by all but this contact [m/s^2].
        impact_speed: v0 of this contact, not positive if it was open until now [m/s].
        speed_before: the speed at which its damper acted in the step before [m/s].
        law: the contact's parameters (`structs.ContactLaw`).

    Returns:
        Mean penetration over the step [m], 0 where the contact is open, and nothing else then counts; the elastic part
        of the force and the force [N]; v0 and the speed at which the damper acts [m/s].
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
    """The normal force of a contact that neither opens nor closes within the step; cheaper than `normal_force`.

    Arguments as of `normal_force`.

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
    """1 where a contact opens or closes within the step, or begins, else 0; arguments as of `normal_force`."""
    zero = type(speed)(0.0)
    ahead = smaller(wp.abs(multiply_add(law.lag, growth, speed)) * law.lag, law.ahead)
    begins = wp.where(impact_speed <= zero, penetration, zero)
    return wp.where(wp.abs(penetration) < ahead, 1, wp.where(begins > zero, 1, 0))


@wp.func
def contact_energy(penetration: Any, elastic: Any, law: Any):
    """Elastic energy [J] of a contact whose force without damping is `elastic` [N]."""
    return quotient(elastic * penetration, law.exponent + type(penetration)(1.0))


@wp.func
def memory_after_teeth(impact_speed: Any):
    """The memory of an open contact with teeth, from its memory until now."""
    return wp.where(impact_speed == type(impact_speed)(UNTOUCHED), impact_speed, type(impact_speed)(SEPARATED))


@wp.func
def has_missed_face(penetration: Any, impact_speed: Any, guide: Any):
    """Whether a roller, `penetration` > 0 deep in a guide, did not come through its face, and so feels nothing of it.

    It is first seen too deep, since it came from behind, through a thin bar, or began the run in there; and it has not
    left since (`impact_speed`).
    """
    first_seen = impact_speed == type(penetration)(UNTOUCHED)
    return impact_speed < type(penetration)(UNTOUCHED) or (first_seen and penetration > guide.deepest_entry)


@wp.func
def friction_force(size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any):
    """Friction on the roller (vector) [N], and the force that the contact's bristle then holds [N].

    Args:
        size: of the normal force, >= 0 [N].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s].
        bristle: force that the bristle has held until now [N], 0 if the contact was open.
        friction: of the contact (`structs.Friction`).
        stretch_part: as in `friction.bristle_friction`.
    """
    mu = sliding_coefficient(normal, relative, friction)
    drag, holds = friction_force_of_coefficient(mu, size, normal, relative, bristle, friction, stretch_part)
    return drag, holds


@wp.func
def even_friction_force(size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any):
    """Friction on the roller (vector) [N] of one coefficient at all speeds; arguments as of `friction_force`."""
    drag, holds = friction_force_of_coefficient(
        friction.mu_dynamic, size, normal, relative, bristle, friction, stretch_part
    )
    return drag, holds


@wp.func
def sliding_coefficient(normal: Any, relative: Any, friction: Any):
    """mu [-] at the speed at which a contact slides; arguments as of `friction_force`."""
    return friction_coefficient(wp.abs(sliding_speed(relative[0], relative[1], normal[0], normal[1])), friction)


@wp.func
def sliding_speed(relative_x: Any, relative_y: Any, normal_x: Any, normal_y: Any):
    """Speed at which a contact slides [m/s], along its normal turned by +90 degrees.

    Arguments are the components of `relative` and `normal` of `friction_force`.
    """
    return products(relative_x, -normal_y, relative_y, normal_x)


@wp.func
def friction_force_of_coefficient(
    mu: Any, size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any
):
    """Friction on the roller (vector) [N] of a given coefficient; other arguments as of `friction_force`."""
    along = type(normal)(-normal[1], normal[0])
    speed = sliding_speed(relative[0], relative[1], normal[0], normal[1])
    drag, holds = bristle_friction(mu * size, speed, bristle, friction.spring, friction.damper, stretch_part)
    return force_vector(along, drag), holds


@wp.func
def dissipated_power(force: Any, relative: Any, acceleration: Any, lag: Any):
    """Power [W] that dampers or friction take, at the mean of the speeds before and after the step.

    With the speed before it alone, the energy balance would drift with the step.

    Args:
        force: of the damper or of friction on the roller [N].
        relative: velocity of the partner's material point less the roller's, `lag` before the forces' instant [m/s].
        acceleration: of that velocity, with all that acts (`relative_acceleration`) [m/s^2].
        lag: half a step with leapfrog, else 0 [s].
    """
    return power_of_force(force[0], force[1], relative[0] + lag * acceleration[0], relative[1] + lag * acceleration[1])


@wp.func
def power_of_force(force_x: Any, force_y: Any, speed_x: Any, speed_y: Any):
    """Power [W] of a force [N] at a velocity [m/s], both in components."""
    return force_x * speed_x + force_y * speed_y


@wp.func
def reaction_moment(arm: Any, force: Any):
    """Moment [N m] about the center of the partner's body of a force [N] on a roller `arm` [m] from that center."""
    return products(arm[1], force[0], -arm[0], force[1])


@wp.func
def surface_velocity(body: Any, arm: Any):
    """Velocity of a body's material point [m/s], `arm` from its center."""
    v = leading_value(body.velocity)
    omega = leading_value(body.speed)
    return type(arm)(v[0] - omega * arm[1], v[1] + omega * arm[0])


@wp.func
def relative_acceleration(straight: Any, angular: Any, arm: Any, acceleration: Any):
    """Acceleration [m/s^2] of the velocity of a body's material point less a roller's.

    The body's accelerations are those of the step before, the roller's is all that is known. The arm is the one of the
    forces' instant, so nothing centripetal is in it.

    Args:
        straight: of the body's center [m/s^2].
        angular: of its angle [rad/s^2].
        arm: the point from the center [m].
        acceleration: the roller's [m/s^2].
    """
    x = multiply_add(-angular, arm[1], straight[0])
    return type(arm)(x - acceleration[0], multiply_add(angular, arm[0], straight[1]) - acceleration[1])


@wp.func
def rotated_components(x: Any, y: Any, cosine: Any, sine: Any):
    """The components (x, y) turned by the angle whose cosine and sine are given."""
    return products(x, cosine, -y, sine), products(x, sine, y, cosine)


@wp.func
def rotated_vector(direction: Any, cosine: Any, sine: Any):
    """A vector turned by the angle whose cosine and sine are given."""
    x, y = rotated_components(direction[0], direction[1], cosine, sine)
    return type(direction)(x, y)
