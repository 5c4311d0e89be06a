"""One roller's contact with a sprocket or guide: normal force, friction, energy, powers and the contact's memory.

A contact keeps the approach speed v0 of its first instant until it opens. An open one keeps `UNTOUCHED`; between teeth
`SEPARATED` once the roller has left them in its pass; in a guide `MISSED` if the roller did not come in through the
face, without force until it has left. The relative velocity is v = v_s + omega x r - v_i (eq. (10)-(14)); forces act at
the roller's center and oppositely at the same point of the partner's body (eq. (16)).

Leapfrog takes the penetration's mean over the step, with w = |v| h / 2

    pen' = pen  where pen >= w,   (pen + w)^2 / (4 w)  where -w < pen < w,   else 0,                          (a)

and a contact begins at v0 = v - a min(pen, w) / v, a the closing acceleration.
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
    """Contact force (vector) [N] of a size [N] along a unit vector."""
    return size * direction


@wp.func
def normal_force_vector(
    penetration: Any, normal: Any, relative: Any, acceleration: Any, impact_speed: Any, speed_before: Any, law: Any
):
    """Normal force of a contact on the roller (vector) [N], and `normal_force`'s results, eq. (15)-(19).

    `normal` points to the roller; `relative` is the partner's velocity less the roller's [m/s].
    """
    speed = products(relative[0], normal[0], relative[1], normal[1])
    growth = products(acceleration[0], normal[0], acceleration[1], normal[1])
    mean, elastic, size, first, damper_speed = normal_force(penetration, speed, growth, impact_speed, speed_before, law)
    return force_vector(normal, size), mean, elastic, size, first, damper_speed


@wp.func
def normal_force(penetration: Any, speed: Any, growth: Any, impact_speed: Any, speed_before: Any, law: Any):
    """Normal force of a contact: mean penetration [m], elastic part [N], size [N], v0 [m/s], damper speed [m/s].

    An open contact has mean penetration 0. `speed` is that at which penetration grows [m/s], `growth` its rate by all
    but this contact, `impact_speed` v0, not positive if open before, `speed_before` the last damper speed.
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
    """Normal force [N] and damper speed [m/s] of a contact that stays closed or open."""
    zero = type(speed)(0.0)
    elastic = elastic_force(larger(penetration, zero), law.stiffness, law.exponent)
    size, damper_speed = contact_force(elastic, speed, growth, impact_speed, speed_before, law)
    closed = penetration > zero
    return wp.where(closed, size, zero), wp.where(closed, damper_speed, zero)


@wp.func
def is_changing_contact(penetration: Any, speed: Any, growth: Any, impact_speed: Any, law: Any):
    """1 where a contact opens, closes or begins within the step, else 0."""
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
    """Memory of an open contact with teeth: `UNTOUCHED` or `SEPARATED`."""
    return wp.where(impact_speed == type(impact_speed)(UNTOUCHED), impact_speed, type(impact_speed)(SEPARATED))


@wp.func
def has_missed_face(penetration: Any, impact_speed: Any, guide: Any):
    """Whether a roller in a guide did not come in through its face, and so has no contact force."""
    first_seen = impact_speed == type(penetration)(UNTOUCHED)
    return impact_speed < type(penetration)(UNTOUCHED) or (first_seen and penetration > guide.deepest_entry)


@wp.func
def friction_force(size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any):
    """Friction of a contact on the roller (vector) [N], and the force [N] that its bristle then holds.

    `size` is the normal force [N], `relative` the partner's velocity less the roller's [m/s], `bristle` the force held
    before [N], `stretch_part` as in `friction.bristle_friction`.
    """
    mu = sliding_coefficient(normal, relative, friction)
    drag, holds = friction_force_of_coefficient(mu, size, normal, relative, bristle, friction, stretch_part)
    return drag, holds


@wp.func
def even_friction_force(size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any):
    """Friction on a roller (vector) [N] of one coefficient at all speeds, and bristle's force [N]."""
    drag, holds = friction_force_of_coefficient(
        friction.mu_dynamic, size, normal, relative, bristle, friction, stretch_part
    )
    return drag, holds


@wp.func
def sliding_coefficient(normal: Any, relative: Any, friction: Any):
    """Coefficient of friction mu [-] at a contact's sliding speed."""
    return friction_coefficient(wp.abs(sliding_speed(relative[0], relative[1], normal[0], normal[1])), friction)


@wp.func
def sliding_speed(relative_x: Any, relative_y: Any, normal_x: Any, normal_y: Any):
    """Sliding speed [m/s] of a contact, along its normal turned +90 degrees."""
    return products(relative_x, -normal_y, relative_y, normal_x)


@wp.func
def friction_force_of_coefficient(
    mu: Any, size: Any, normal: Any, relative: Any, bristle: Any, friction: Any, stretch_part: Any
):
    """Friction on a roller (vector) [N] for a given `mu` [-], and bristle's force [N]."""
    along = type(normal)(-normal[1], normal[0])
    speed = sliding_speed(relative[0], relative[1], normal[0], normal[1])
    drag, holds = bristle_friction(mu * size, speed, bristle, friction.spring, friction.damper, stretch_part)
    return force_vector(along, drag), holds


@wp.func
def dissipated_power(force: Any, relative: Any, acceleration: Any, lag: Any):
    """Power [W] of a contact's damper or friction, at the step's mean speeds.

    `relative` [m/s] is of `lag` [s] before the forces' instant.
    """
    # with the speed before the step alone, the energy balance would drift
    return power_of_force(force[0], force[1], relative[0] + lag * acceleration[0], relative[1] + lag * acceleration[1])


@wp.func
def power_of_force(force_x: Any, force_y: Any, speed_x: Any, speed_y: Any):
    """Power [W] of a contact force [N] at a velocity [m/s]."""
    return force_x * speed_x + force_y * speed_y


@wp.func
def reaction_moment(arm: Any, force: Any):
    """Moment [N m] on the partner's body of a contact force [N] on the roller."""
    return products(arm[1], force[0], -arm[0], force[1])


@wp.func
def surface_velocity(body: Any, arm: Any):
    """Velocity [m/s] of a body's contact point, `arm` [m] from its center."""
    v = leading_value(body.velocity)
    omega = leading_value(body.speed)
    return type(arm)(v[0] - omega * arm[1], v[1] + omega * arm[0])


@wp.func
def relative_acceleration(straight: Any, angular: Any, arm: Any, acceleration: Any):
    """Acceleration [m/s^2] of a contact's relative velocity, its centripetal part aside."""
    x = multiply_add(-angular, arm[1], straight[0])
    return type(arm)(x - acceleration[0], multiply_add(angular, arm[0], straight[1]) - acceleration[1])


@wp.func
def rotated_components(x: Any, y: Any, cosine: Any, sine: Any):
    """Components (x, y), as of a contact normal, turned by the angle of (cosine, sine)."""
    return products(x, cosine, -y, sine), products(x, sine, y, cosine)


@wp.func
def rotated_vector(direction: Any, cosine: Any, sine: Any):
    """Vector, such as a contact normal, turned by the angle of (cosine, sine)."""
    x, y = rotated_components(direction[0], direction[1], cosine, sine)
    return type(direction)(x, y)
