"""Rigid bodies that carry teeth and guides: poses, accelerations, integration in time, energies.

Center (x, y) and angle are each free, held or prescribed. Bodies that only turn have `Mount.active` = 0; others follow
`mount`. Coordinates and rates are numbers (`number`), all else is rounded.
"""

from typing import Any

import warp as wp

from ..native import multiply_add, products, quotient, reciprocal
from ..number import (  # noqa: F401
    Pair,
    add,
    difference,
    leading_value,
    mul,
    normalized_pair,
    number_of,
    rounded_value,
    sine_cosine,
    sub,
    trimmed_value,
)
from ..structs import BodyState, Pose, types
from .motion import prescribed_acceleration, prescribed_rotation
from .mount import PRESCRIBED, holding_force, mount_accelerations, mount_energy, prescribed_center, prescribing_power
from .tooth import grid_product

BLOCKS = types(wp.float32, blocks=True)


@wp.func
def heading_of(body: BodyState):
    """Unit vector (cos theta, sin theta) of a body's angle, float64."""
    sine, cosine = sine_cosine(body.angle)
    return wp.vec2d(cosine, sine)


@wp.func
def pose_heading(pose: Any):
    """Unit vector (cos theta, sin theta) of a body's pose, rounded."""
    return wp.vector(leading_value(pose.cosine), leading_value(pose.sine))


@wp.func
def pose_with_heading(pose: Pose, cosine: wp.float64, sine: wp.float64):
    """A body's float64 pose with its heading along (cosine, sine)."""
    pose.cosine = cosine
    pose.sine = sine
    return pose


@wp.func
def pose_with_heading(pose: BLOCKS.Pose, cosine: Pair, sine: Pair):
    """A body's pose in pairs with heading and R cos theta, R sin theta (`tooth`) along (cosine, sine)."""
    pose.cosine = cosine
    pose.sine = sine
    pose.reach_cosine = grid_product(cosine, pose.radius, pose.grid)
    pose.reach_sine = grid_product(sine, pose.radius, pose.grid)
    return pose


@wp.func
def turned_pose(pose: Pose, turn: wp.float64):
    """A body's float64 pose turned by a small angle [rad]; heading within 1e-14 up to 0.01 rad."""
    square = turn * turn
    one = wp.float64(1.0)
    fourth = multiply_add(-square, wp.static(wp.float64(1.0 / 24.0)), wp.float64(0.5))
    less = multiply_add(-square, fourth, one)
    fifth = multiply_add(-square, wp.static(wp.float64(1.0 / 120.0)), wp.static(wp.float64(1.0 / 6.0)))
    sine = turn * multiply_add(-square, fifth, one)
    x = products(pose.cosine, less, -pose.sine, sine)
    y = products(pose.cosine, sine, pose.sine, less)
    scale = multiply_add(wp.float64(-0.5), products(x, x, y, y), wp.float64(1.5))
    return pose_with_heading(pose, x * scale, y * scale)


@wp.func
def turned_pose(pose: BLOCKS.Pose, turn: wp.float32):
    """A body's pose in pairs turned by a small angle [rad]."""
    square = turn * turn
    less = -0.5 * square * (1.0 - square * wp.static(1.0 / 12.0))
    sine = turn * (1.0 - square * wp.static(1.0 / 6.0) * (1.0 - square * wp.static(1.0 / 20.0)))
    c = pose.cosine
    s = pose.sine
    x = normalized_pair(c.high, c.low + products(less, c.high, -sine, s.high))
    return pose_with_heading(pose, x, normalized_pair(s.high, s.low + products(less, s.high, sine, c.high)))


@wp.func
def aligned_pose(pose: Any):
    """A body's pose with heading along its angle, numbers trimmed to float64."""
    pose.angle = trimmed_value(pose.angle)
    pose.speed = trimmed_value(pose.speed)
    pose.center = trimmed_value(pose.center)
    pose.velocity = trimmed_value(pose.velocity)
    sine, cosine = sine_cosine(pose.angle)
    return pose_with_heading(pose, cosine, sine)


@wp.func
def pose_with_coordinates(pose: Any, body: Any):
    """A body's pose with coordinates and rates of state `body`."""
    pose.angle = body.angle
    pose.speed = body.speed
    pose.center = body.center
    pose.velocity = body.velocity
    pose.straight = body.straight
    pose.angular = body.angular
    return pose


@wp.func
def pose_of(body: BodyState):
    """Float64 pose of a body's state, as contacts see it."""
    return aligned_pose(pose_with_coordinates(Pose(), body))


@wp.func
def plain_body(body: BodyState):
    """A body's float64 state, unchanged."""
    return body


@wp.func
def plain_body(body: Pose):
    """A body's float64 pose, unchanged."""
    return body


@wp.func
def plain_body(body: Any):
    """A body's state or pose in pairs as float32, with `rest` of its speed."""
    plain = BLOCKS.Instant()
    plain.angle = rounded_value(body.angle)
    plain.speed = leading_value(body.speed)
    plain.rest = body.speed.low
    plain.center = leading_value(body.center)
    plain.velocity = leading_value(body.velocity)
    return plain


@wp.func
def add_speed(body: BodyState, change: wp.float64):
    """A body's float64 state, angular velocity raised by `change` [rad/s]."""
    body.speed = body.speed + change
    return body


@wp.func
def add_speed(body: BLOCKS.Instant, change: wp.float32):
    """A body's float32 state, angular velocity raised by `change` [rad/s]."""
    speed = body.speed + change
    body.rest = ((body.speed - speed) + change) + body.rest
    body.speed = speed
    return body


@wp.func
def speed_as_float64(body: BodyState):
    """Angular velocity [rad/s] of a body's float64 state."""
    return body.speed


@wp.func
def speed_as_float64(body: BLOCKS.Instant):
    """Angular velocity [rad/s] of a body's float32 state and `rest`, as float64."""
    return wp.float64(body.speed) + wp.float64(body.rest)


@wp.func
def body_accelerations(
    time: Any, off: Any, body: Any, heading: Any, wrench: Any, motion: Any, mount: Any, ensemble: Any
):
    """Accelerations of a body's center (x, y) [m/s^2] and angle [rad/s^2], eq. (4).

    `time` [s] is that of `body.speed`, `off` the center from its home [m], `heading` (cos theta, sin theta); `wrench`
    holds all forces and a free angle's load.
    """
    zero = type(wrench.load)(0.0)
    rates = wp.vector(zero, zero, zero)
    if mount.active == 0:
        rates[2] = (wrench.moment + wrench.load) * motion.inverse_inertia  # zero where the angle is led
    else:
        turning = wp.vector(zero, zero, wrench.load)
        if motion.prescribed == 1:
            angle, speed = prescribed_rotation(time, motion, ensemble)
            body.speed = speed
            turning = wp.vector(type(zero)(1.0), prescribed_acceleration(time, motion, ensemble), zero)
        driven = type(heading)(zero, zero)
        if mount.moves == PRESCRIBED:
            place, velocity, driven = prescribed_center(time, mount, ensemble)
        rates = mount_accelerations(driven, off, body, heading, wrench, turning, mount)
    return rates


@wp.func
def leapfrog_body(kick: Any, h: Any, body: Any, rates: Any, ahead: Any, motion: Any, mount: Any):
    """A body's state one leapfrog step `h` [s] later with its accelerations, a prescribed center aside.

    `kick` is the speed's step [s], `ahead` a prescribed final angle.
    """
    led = motion.prescribed == 1
    speed = wp.where(led, (ahead - body.angle) * reciprocal(h), body.speed + kick * rates[2])
    body.angular = rates[2]
    if led:
        body.angular = rounded_value(difference(speed, body.speed)) * reciprocal(kick)
    body.angle = wp.where(led, ahead, body.angle + h * speed)
    body.speed = speed
    body.straight = wp.vector(rates[0], rates[1])
    if mount.active != 0 and mount.moves != PRESCRIBED:
        body.velocity = body.velocity + kick * body.straight
        body.center = body.center + h * body.velocity
    return body


@wp.func
def move_prescribed_center(after: Any, kick: Any, h: Any, body: Any, mount: Any, ensemble: Any):
    """A body's state with its prescribed center as at `after` [s], at its mean velocity over `h` [s]."""
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(after, mount, ensemble)
        mean = (center - body.center) * reciprocal(h)
        body.straight = rounded_value(difference(mean, body.velocity)) * reciprocal(kick)
        body.velocity = mean
        body.center = center
    return body


@wp.func
def stage_body(at: Any, body: Any, base: Any, slopes: Any, rates: Any, motion: Any, mount: Any, ensemble: Any):
    """A body's states at the next Runge-Kutta stage and step's start, and weighted slopes."""
    straight = wp.vector(rates[0], rates[1])
    turning = body.speed
    moving = body.velocity
    if at.number == 0:
        base = body
        slopes = type(slopes)()
    slopes.angle = slopes.angle + at.weight * turning
    slopes.speed = slopes.speed + at.weight * rates[2]
    slopes.center = slopes.center + at.weight * moving
    slopes.velocity = slopes.velocity + at.weight * straight
    if at.last == 1:
        body.angle = base.angle + slopes.angle
        body.speed = base.speed + slopes.speed
        body.center = base.center + slopes.center
        body.velocity = base.velocity + slopes.velocity
    else:
        body.angle = base.angle + at.reach * turning
        body.speed = base.speed + at.reach * rates[2]
        body.center = base.center + at.reach * moving
        body.velocity = base.velocity + at.reach * straight
    if motion.prescribed == 1:
        angle, speed = prescribed_rotation(at.after, motion, ensemble)
        body.angle = angle
        body.speed = number_of(speed)
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(at.after, mount, ensemble)
        body.center = center
        body.velocity = number_of(velocity)
    return body, base, slopes


@wp.func
def body_at_time(time: Any, lag: Any, body: Any, rates: Any, driven: Any, motion: Any, mount: Any, ensemble: Any):
    """A body's plain state with rates of `time` [s], `lag` [s] after its own."""
    seen = plain_body(body)
    if motion.prescribed == 1:
        seen.speed = driven
    else:
        seen = add_speed(seen, lag * rates[2])
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(time, mount, ensemble)
        seen.velocity = velocity
    else:
        seen.velocity = seen.velocity + lag * wp.vector(rates[0], rates[1])
    return seen


@wp.func
def wrench_with_force(wrench: Any, force: Any, moment: Any):
    """Wrench on a body with one more force [N] and moment [N m]."""
    wrench.force = wrench.force + force
    wrench.moment = wrench.moment + moment
    return wrench


@wp.func
def body_energy(off: Any, body: Any, heading: Any, motion: Any, mount: Any):
    """Kinetic and potential energy [J] of a body, 0 where prescribed."""
    energy = wp.float64(0.0)
    if mount.active != 0:
        energy = wp.float64(mount_energy(off, body, heading, mount))
    elif motion.prescribed == 0:
        speed = speed_as_float64(body)
        energy = wp.float64(0.5) * speed * speed / wp.float64(motion.inverse_inertia)
    return energy


@wp.func
def holding_force_and_power(off: Any, body: Any, heading: Any, wrench: Any, rates: Any, motion: Any, mount: Any):
    """Force [N] that holds a mounted center, and power [W] of its prescribed motion."""
    held = holding_force(off, body, heading, wrench, rates, mount)
    return held, prescribing_power(body, heading, held, rates, motion.prescribed, mount)


@wp.func
def late_contact_power(wrench: Any, now: Any, pose: Any, lag: Any, carried: bool):
    """Power [W] that contacts on a body miss by taking its acceleration of the step before.

    `now` is its state at the forces' instant, `pose` `lag` [s] earlier; `carried` leaves out the center's power.
    """
    power = wrench.moment * (now.speed - leading_value(pose.speed) - lag * pose.angular)
    if not carried:
        power += wp.dot(wrench.force, now.velocity - leading_value(pose.velocity) - lag * pose.straight)
    return power


@wp.func
def is_in_box(low: Any, high: Any, p: Any):
    """Whether a body's or roller's point `p` [m] is finite and within the drive's box."""
    return p[0] > low[0] and p[0] < high[0] and p[1] > low[1] and p[1] < high[1]


@wp.func
def has_finite_rotation(angle: Any, speed: Any):
    """Whether a body's angle and angular velocity are finite."""
    return wp.isfinite(rounded_value(angle)) and wp.isfinite(rounded_value(speed))


@wp.func
def stop_moment(angle: Any, speed: Any, arm: Any):
    """Moment [N m] of an arm's stop, and its elastic part [N m]."""
    zero = type(angle)(0.0)
    elastic = zero
    moment = zero
    if angle < arm.low:
        elastic = arm.stop_stiffness * (arm.low - angle)
        moment = wp.max(elastic - arm.stop_damping * speed, zero)
    elif angle > arm.high:
        elastic = arm.stop_stiffness * (arm.high - angle)
        moment = wp.min(elastic - arm.stop_damping * speed, zero)
    return moment, elastic


@wp.func
def coil_length(angle: Any, arm: Any):
    """Length [m] of an arm's coil spring, and derivative by angle."""
    sine, cosine = sine_cosine(angle)
    x = arm.coil_point[0] * cosine - arm.coil_point[1] * sine
    y = arm.coil_point[0] * sine + arm.coil_point[1] * cosine
    along = wp.vector(x - arm.coil_anchor[0], y - arm.coil_anchor[1])
    length = wp.length(along)
    return length, quotient(x * along[1] - y * along[0], length)


@wp.func
def coil_moment(turned: Any, arm: Any):
    """Moment [N m] of coil spring and damper on an arm."""
    length, lever = coil_length(turned.angle, arm)
    return -lever * (arm.coil_stiffness * (length - arm.coil_free_length) + arm.coil_damping * lever * turned.speed)


@wp.func
def arm_own_moment(body: Any, heading: Any, arm: Any):
    """Moment [N m] of weight, springs, dampers and stops on an arm."""
    x = arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1]
    y = arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0]
    stop, elastic = stop_moment(body.angle, body.speed, arm)
    weight = x * arm.gravity[1] - y * arm.gravity[0]
    moment = weight + stop - arm.stiffness * (body.angle - arm.free_angle) - arm.damping * body.speed
    if arm.coil_stiffness > type(moment)(0.0):
        moment = moment + coil_moment(body, arm)
    return moment


@wp.func
def arm_spring_moment(turned: Any, arm: Any):
    """Moment [N m] of an arm's springs, dampers and stops; `turned` is relative to its carrier."""
    stop, elastic = stop_moment(turned.angle, turned.speed, arm)
    moment = stop - arm.stiffness * (turned.angle - arm.free_angle) - arm.damping * turned.speed
    if arm.coil_stiffness > type(moment)(0.0):
        moment = moment + coil_moment(turned, arm)
    return moment


@wp.func
def arm_mass_moment(heading: Any, arm: Any):
    """Mass moment [kg m] of an arm about its pivot at its heading."""
    return type(heading)(
        arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1],
        arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0],
    )


@wp.func
def relax_arm(body: Any, angular: wp.float64, kick: wp.float64, h: wp.float64):
    """State of an arm after a relaxation step: omega += kick alpha, theta += h omega."""
    body.speed = wp.where(kick < h, wp.float64(0.0), body.speed) + kick * angular
    body.angle = body.angle + h * body.speed
    return body


@wp.func
def arm_energy(kinetic: wp.float64, body: Any, heading: Any, arm: Any):
    """Energy [J] of an arm: `kinetic`, and that of its springs, stops and weight."""
    half = type(body.speed)(0.5)
    turned = body.angle - arm.free_angle
    energy = kinetic + wp.float64(half * arm.stiffness * turned * turned)
    beyond = wp.max(arm.low - body.angle, type(half)(0.0)) + wp.max(body.angle - arm.high, type(half)(0.0))
    energy += wp.float64(half * arm.stop_stiffness * beyond * beyond)
    if arm.coil_stiffness > type(half)(0.0):
        length, lever = coil_length(body.angle, arm)
        longer = length - arm.coil_free_length
        energy += wp.float64(half * arm.coil_stiffness * longer * longer)
    x = arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1] + arm.mass * (body.center[0] - arm.pivot[0])
    y = arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0] + arm.mass * (body.center[1] - arm.pivot[1])
    return energy - wp.float64(x * arm.gravity[0]) - wp.float64(y * arm.gravity[1])


@wp.func
def pivot_power(power: Any, body: Any, arm: Any):
    """Power [W] of what moves an arm's pivot: `power` and lifting its weight."""
    return power - arm.mass * wp.dot(arm.gravity, body.velocity)


@wp.func
def arm_dissipation(body: Any, arm: Any):
    """Power [W] that an arm's dampers and stops dissipate."""
    stop, elastic = stop_moment(body.angle, body.speed, arm)
    power = arm.damping * body.speed * body.speed - (stop - elastic) * body.speed
    if arm.coil_stiffness > type(power)(0.0):
        length, lever = coil_length(body.angle, arm)
        power = power + arm.coil_damping * lever * lever * body.speed * body.speed
    return power
