r"""One roller against one sprocket or guide-bar: gap, relative velocity, response, and the memory that a contact keeps.

A contact keeps the approach speed v0 of its first instant until it opens. What stands there of an open one is not
positive: `UNTOUCHED`, or between a sprocket's teeth `TOUCHED` once the roller has touched them in its pass, or in a
guide-bar `MISSED` if the roller did not come in through the face: it then feels no force until it has left. A roller
keeps its seat while it is engaged, so that no angle is computed in the time loop. The relative velocity is that of the
partner's material point against the roller, v = v_s + omega x r - v_i (eq. (10)-(14)); the force acts on the roller,
its opposite on the partner's body at the same point, which conserves angular momentum (eq. (16) with the full cross
product).

    in_teeth, on_guide  where a roller is in a tooth gap or on a bar: penetration, normal, relative velocity
    misses      whether it is in a bar without having come through its face
    respond     what the contact answers: force vector, v0, what of it damps, energy
    rub         the friction on the roller
    dissipated  what damping and friction take
    reaction    the moment of the answer on the partner's body

Friction acts at the roller's center like the contact force, against what the partner's material point there slides
along the contact: so the reaction's moment and the power are exact, and no roller needs an angle.
"""

from typing import Any

import warp as wp

from ..root import product, products, quotient
from ..rows import accessors
from ..structs import Pose
from .friction import bounded, friction
from .guide import guide_gap
from .impact import contact_force, elastic_force
from .tooth import nearest_seat, seat_step, tooth_gap, wrapped_seat

load_direction = accessors(wp.vec2d).load_row

UNTOUCHED = wp.constant(0.0)
TOUCHED = wp.constant(-1.0)
MISSED = wp.constant(-1.0)


@wp.func
def sized(direction: Any, size: Any):
    """A vector [N] of a size and a direction."""
    return type(direction)(product(size, direction[0]), product(size, direction[1]))


@wp.func
def respond(penetration: Any, normal: Any, relative: Any, impact_speed: Any, law: Any):
    """What a closed contact answers, eq. (15)-(19); where `penetration` is not positive there is none to ask.

    Args:
        penetration: pen > 0 [m].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s], positive along the normal while the
            penetration grows.
        impact_speed: v0 of this contact, not positive if it was open until now [m/s].
        law: the contact's parameters (`structs.ContactLaw`).

    Returns:
        Force on the roller (vector) and its magnitude [N], v0 [m/s], what of the magnitude damps [N], elastic energy
        [J].
    """
    speed = products(relative[0], normal[0], relative[1], normal[1])
    size, first, damper, energy = pressed(penetration, speed, impact_speed, law)
    return sized(normal, size), size, first, damper, energy


@wp.func
def pressed(penetration: Any, speed: Any, impact_speed: Any, law: Any):
    """As `respond`, from the approach speed [m/s] along the normal, without the force's direction."""
    first = impact_speed
    if first <= type(penetration)(0.0):
        first = wp.max(speed, law.speed_floor)
    elastic = elastic_force(penetration, law.stiffness, law.exponent)
    size = contact_force(elastic, speed, first, law)
    return size, first, size - elastic, stored(penetration, elastic, law)


@wp.func
def stored(penetration: Any, elastic: Any, law: Any):
    """Energy [J] of a closed contact: `elastic` [N] is the force without damping."""
    return quotient(elastic * penetration, law.exponent + type(penetration)(1.0))


@wp.func
def after_teeth(impact_speed: Any):
    """What an open contact with teeth keeps, from what it kept before."""
    return wp.where(impact_speed == type(impact_speed)(UNTOUCHED), impact_speed, type(impact_speed)(TOUCHED))


@wp.func
def misses(penetration: Any, impact_speed: Any, bar: Any):
    """Whether a roller, `penetration` > 0 deep in a guide-bar, feels nothing of it: it did not come through the face.

    It is first seen too deep, since it came from behind, through a thin bar, or began the run in there; and it has not
    left since (`impact_speed`).
    """
    first_seen = impact_speed == type(penetration)(UNTOUCHED)
    return impact_speed < type(penetration)(UNTOUCHED) or (first_seen and penetration > bar.deepest_entry)


@wp.func
def rub(size: Any, normal: Any, relative: Any, sliding: Any):
    """Friction on the roller (vector) [N] in a contact that presses with `size` >= 0.

    Args:
        size: the contact force's magnitude [N].
        normal: unit vector towards the roller.
        relative: velocity of the partner's material point less the roller's [m/s].
        sliding: what rubs (`structs.Sliding`).
    """
    along = type(normal)(-normal[1], normal[0])
    speed = products(relative[0], along[0], relative[1], along[1])
    drag = friction(size, wp.abs(speed), sliding.stop, sliding.law)
    return sized(along, wp.where(speed < type(size)(0.0), -drag, drag))


@wp.func
def rub_evenly(size: Any, normal: Any, relative: Any, sliding: Any):
    """As `rub`, of one coefficient at all speeds."""
    along = type(normal)(-normal[1], normal[0])
    speed = products(relative[0], along[0], relative[1], along[1])
    drag = bounded(sliding.law.mu_dynamic, size, wp.abs(speed), sliding.stop)
    return sized(along, wp.where(speed < type(size)(0.0), -drag, drag))


@wp.func
def dissipated(force: Any, relative: Any, acceleration: Any, lag: Any):
    """Power [W] that dampers or friction take, at the mean of the speeds before and after the step.

    With the speed before it alone, the energy balance would drift with the step.

    Args:
        force: of the damper or of friction on the roller [N].
        relative: velocity of the partner's material point less the roller's, `lag` before the forces' instant [m/s].
        acceleration: of the roller, with all that acts on it [m/s^2].
        lag: half a step with leapfrog, 0 with rk4 [s].
    """
    return power_taken(force[0], force[1], relative[0] - lag * acceleration[0], relative[1] - lag * acceleration[1])


@wp.func
def power_taken(force_x: Any, force_y: Any, speed_x: Any, speed_y: Any):
    """Power [W] of a force [N] at a velocity [m/s], both by their components."""
    return force_x * speed_x + force_y * speed_y


@wp.func
def reaction(arm: Any, force: Any):
    """Moment [N m] about the center of the partner's body of a force on the roller, which is `arm` away from it."""
    return arm[1] * force[0] - arm[0] * force[1]


@wp.func
def surface_velocity(body: Pose, arm: wp.vec2d):
    """Velocity of a body's material point [m/s], `arm` from its center."""
    return wp.vec2d(body.velocity[0] - body.speed * arm[1], body.velocity[1] + body.speed * arm[0])


@wp.func
def turned_by(x: Any, y: Any, cosine: Any, sine: Any):
    """As `turned`, of a direction's components."""
    return products(x, cosine, -y, sine), products(x, sine, y, cosine)


@wp.func
def turned(direction: Any, cosine: Any, sine: Any):
    """`direction` turned by the angle whose cosine and sine are given."""
    x, y = turned_by(direction[0], direction[1], cosine, sine)
    return type(direction)(x, y)


@wp.struct
class Seat:
    """Which seat of a sprocket a roller is nearest to, and where it is in that seat's gap."""

    number: wp.int32
    outward: wp.vec2d  # direction from the sprocket's center
    radial: wp.float64  # along it, from the center [m]
    lateral: wp.float64  # across it [m]


@wp.func
def in_gap(p: wp.vec2d, direction: wp.vec2d, cosine: wp.float64, sine: wp.float64):
    """Outward direction of a seat that points to `direction` at angle zero, and p's components along and across it."""
    e = turned(direction, cosine, sine)
    return e, wp.dot(p, e), p[1] * e[0] - p[0] * e[1]


@wp.func
def tracked_seat(
    p: wp.vec2d, kept: int, cosine: wp.float64, sine: wp.float64, sprocket: Any, seats: wp.array[wp.vec2d]
):
    """The seat of a roller at `p` from the center of a sprocket turned by (cosine, sine).

    The seat `kept` from the step before, or a neighbor of it; by angle where there was none (negative).
    """
    number = kept
    if number < 0:
        number = nearest_seat(p, cosine, sine, sprocket.teeth)
    return seat_from(p, number, load_direction(seats, sprocket.first_seat + number), cosine, sine, sprocket, seats)


@wp.func
def seat_from(
    p: wp.vec2d,
    number: int,
    direction: wp.vec2d,
    cosine: wp.float64,
    sine: wp.float64,
    sprocket: Any,
    seats: wp.array[wp.vec2d],
):
    """As `tracked_seat`, from seat `number`, which points to `direction` at angle zero."""
    e, radial, lateral = in_gap(p, direction, cosine, sine)
    seat = Seat()
    seat.outward = e
    seat.radial = radial
    seat.lateral = lateral
    step = seat_step(radial, lateral, wp.float64(sprocket.half_pitch_tangent))
    tries = int(2)  # a loop, which the GPU's compiler leaves where it is: most rollers have no use for it
    while step != 0 and tries > 0:
        number = wrapped_seat(number + step, sprocket.teeth)
        new_e, new_radial, new_lateral = in_gap(p, load_direction(seats, sprocket.first_seat + number), cosine, sine)
        seat.outward = new_e
        seat.radial = new_radial
        seat.lateral = new_lateral
        step = seat_step(new_radial, new_lateral, wp.float64(sprocket.half_pitch_tangent))
        tries = tries - 1
    seat.number = number
    return seat


@wp.func
def in_teeth(p: wp.vec2d, v: Any, omega: Any, seat: Seat, sprocket: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller in its tooth gap, eq. (5)-(14).

    The roller's place in the gap is taken in float64 at every precision: it is the small difference of large lengths.

    Args:
        p: roller from the sprocket's center [m].
        v: roller's velocity relative to the center's [m/s].
        omega: sprocket's angular velocity [rad/s].
        seat: the roller's seat at p.
        sprocket: its teeth (`structs.Sprocket`).
    """
    xi = type(omega)(seat.radial - sprocket.exact_radius)
    penetration, normal_radial, normal_lateral = tooth_gap(xi, type(omega)(seat.lateral), sprocket)
    e = type(v)(type(omega)(seat.outward[0]), type(omega)(seat.outward[1]))
    surface = type(v)(-omega * type(omega)(p[1]), omega * type(omega)(p[0]))
    return penetration, turned(e, normal_radial, normal_lateral), surface - v


@wp.func
def carried(bar: Any, body: Pose):
    """A guide-bar, given in the frame of the body that carries it, where the body is now."""
    start = turned(bar.start, body.cosine, body.sine)
    bar.start = body.center + start
    bar.direction = turned(bar.direction, body.cosine, body.sine)
    return bar


@wp.func
def on_guide(p: wp.vec2d, v: Any, surface: Any, bar: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar, eq. (21)-(23).

    Args:
        p: roller from the bar's start [m], in float64 as in `in_teeth`.
        v: roller's velocity [m/s].
        surface: velocity of the body that carries the bar, where the roller is [m/s]; zero on the ground.
        bar: the guide-bar (`structs.Guide`).
    """
    t = bar.direction
    length = bar.length
    along = type(length)(wp.dot(p, t))
    across = type(length)(p[1] * t[0] - p[0] * t[1])
    penetration, normal_along, normal_across = guide_gap(along, across, bar)
    face = type(v)(type(length)(t[0]), type(length)(t[1]))
    return penetration, turned(face, normal_along, normal_across), surface - v
