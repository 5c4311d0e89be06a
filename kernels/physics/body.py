"""Bodies, which carry teeth and guides: how the chain's wrench moves them, and their energies.

A body has three coordinates, its center (x, y) and its angle; each is free, held, or prescribed. A sprocket whose
center is fixed and that has no balance wheel, or an arm about a fixed pivot, only turns (`Mount.active` = 0); the
others follow `mount`. A prescribed coordinate takes its mean speed over a leapfrog step, which brings it exactly from
position to position.

A new kind of body adds its own moment to the load on its angle.

Coordinates and rates are numbers (`number`); forces, moments and accelerations are rounded. Between two evaluations of
its angle a heading may be turned by the small angle of a step, by the series of sine and cosine to the fifth order,
whose next terms are below 1e-14 for steps of a hundredth of a radian.
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
    """(cos theta, sin theta) of a body's angle."""
    sine, cosine = sine_cosine(body.angle)
    return wp.vec2d(cosine, sine)


@wp.func
def pose_with_heading(pose: Pose, cosine: wp.float64, sine: wp.float64):
    """A float64 pose that heads along (cosine, sine)."""
    pose.cosine = cosine
    pose.sine = sine
    return pose


@wp.func
def pose_with_heading(pose: BLOCKS.Pose, cosine: Pair, sine: Pair):
    """A pose in pairs that heads along (cosine, sine), with R cos theta and R sin theta on their grid (`tooth`)."""
    pose.cosine = cosine
    pose.sine = sine
    pose.reach_cosine = grid_product(cosine, pose.radius, pose.grid)
    pose.reach_sine = grid_product(sine, pose.radius, pose.grid)
    return pose


@wp.func
def turned_pose(pose: Pose, turn: wp.float64):
    """A float64 pose turned by a small angle [rad], its heading back at length one."""
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
    """A pose in pairs turned by a small angle [rad], by what is added to cosine and sine."""
    square = turn * turn
    less = -0.5 * square * (1.0 - square * wp.static(1.0 / 12.0))
    sine = turn * (1.0 - square * wp.static(1.0 / 6.0) * (1.0 - square * wp.static(1.0 / 20.0)))
    c = pose.cosine
    s = pose.sine
    x = normalized_pair(c.high, c.low + products(less, c.high, -sine, s.high))
    return pose_with_heading(pose, x, normalized_pair(s.high, s.low + products(less, s.high, sine, c.high)))


@wp.func
def aligned_pose(pose: Any):
    """A pose that heads along its angle, its coordinates and rates trimmed to what float64 can hold."""
    pose.angle = trimmed_value(pose.angle)
    pose.speed = trimmed_value(pose.speed)
    pose.center = trimmed_value(pose.center)
    pose.velocity = trimmed_value(pose.velocity)
    sine, cosine = sine_cosine(pose.angle)
    return pose_with_heading(pose, cosine, sine)


@wp.func
def pose_with_coordinates(pose: Any, body: Any):
    """A pose with a body's coordinates, rates and accelerations; its heading stays."""
    pose.angle = body.angle
    pose.speed = body.speed
    pose.center = body.center
    pose.velocity = body.velocity
    pose.straight = body.straight
    pose.angular = body.angular
    return pose


@wp.func
def pose_of(body: BodyState):
    """The pose of a body, as contacts see it."""
    return aligned_pose(pose_with_coordinates(Pose(), body))


@wp.func
def plain_body(body: BodyState):
    """A body's float64 state, unchanged: it is in plain numbers."""
    return body


@wp.func
def plain_body(body: BLOCKS.BodyState):
    """A body's state in pairs as plain float32 numbers, with the low part of its speed in `rest`."""
    plain = BLOCKS.Instant()
    plain.angle = rounded_value(body.angle)
    plain.speed = leading_value(body.speed)
    plain.rest = body.speed.low
    plain.center = leading_value(body.center)
    plain.velocity = leading_value(body.velocity)
    return plain


@wp.func
def add_speed(body: BodyState, change: wp.float64):
    """A float64 body that turns faster by `change` [rad/s]."""
    body.speed = body.speed + change
    return body


@wp.func
def add_speed(body: BLOCKS.Instant, change: wp.float32):
    """A body in plain float32 that turns faster by `change` [rad/s]; what that rounds off goes to `rest`."""
    speed = body.speed + change
    body.rest = ((body.speed - speed) + change) + body.rest
    body.speed = speed
    return body


@wp.func
def speed_as_float64(body: BodyState):
    """Angular velocity of a float64 body [rad/s]."""
    return body.speed


@wp.func
def speed_as_float64(body: BLOCKS.Instant):
    """Angular velocity of a body in plain float32 [rad/s], as float64: its energy is too large for float32."""
    return wp.float64(body.speed) + wp.float64(body.rest)


@wp.func
def body_accelerations(
    time: Any, off: Any, body: Any, heading: Any, wrench: Any, motion: Any, mount: Any, ensemble: Any
):
    """Accelerations of a body's center (x, y) [m/s^2] and angle [rad/s^2], eq. (4); 0 of a prescribed fixed angle.

    Args:
        time: for what is prescribed [s].
        off: the body's center from its home [m] (`mount.displacement_from_home`).
        body: its coordinates and rates in plain numbers; its speed must be that of `time`.
        heading: cosine and sine of its angle.
        wrench: of chain and tensioners on it, and its load, if its angle is free.
        motion, mount, ensemble: how it turns and is held.
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
    """A body one leapfrog step `h` [s] later, except for a prescribed center.

    Args:
        kick: time over which its rates are accelerated (`integrate.leapfrog_kick`) [s].
        h: the step [s].
        body: in numbers.
        rates: accelerations of center [m/s^2] and angle [rad/s^2].
        ahead: its angle after the step, if that is prescribed [rad].
        motion, mount: how it turns and is held.
    """
    led = motion.prescribed == 1
    speed = wp.where(led, (ahead - body.angle) * reciprocal(h), body.speed + kick * rates[2])
    body.angle = wp.where(led, ahead, body.angle + h * speed)
    body.speed = speed
    if mount.active != 0 and mount.moves != PRESCRIBED:
        body.velocity = body.velocity + kick * wp.vector(rates[0], rates[1])
        body.center = body.center + h * body.velocity
    return body


@wp.func
def move_prescribed_center(after: Any, h: Any, body: Any, mount: Any, ensemble: Any):
    """A body with its center, if prescribed, where it is at `after` [s], moving at its mean velocity over the step `h`
    [s].
    """
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(after, mount, ensemble)
        body.velocity = (center - body.center) * reciprocal(h)
        body.center = center
    return body


@wp.func
def body_with_accelerations(before: Any, after: Any, rates: Any, kick: Any, motion: Any, mount: Any):
    """A body after a leapfrog step with the accelerations of that step, which contacts of the next one use.

    Args:
        before, after: the body at this step and the next.
        rates: its accelerations in this step.
        kick: time over which its rates were accelerated [s].
        motion, mount: prescribed coordinates take the change of their speeds.
    """
    after.angular = rates[2]
    if motion.prescribed == 1:
        after.angular = rounded_value(difference(after.speed, before.speed)) * reciprocal(kick)
    after.straight = wp.vector(rates[0], rates[1])
    if mount.moves == PRESCRIBED:
        after.straight = rounded_value(difference(after.velocity, before.velocity)) * reciprocal(kick)
    return after


@wp.func
def stage_body(at: Any, body: Any, base: Any, slopes: Any, rates: Any, motion: Any, mount: Any, ensemble: Any):
    """A body where the next Runge-Kutta stage evaluates it; after the last stage, at the step's end.

    Returned with the body at the step's start and the sum of its weighted slopes so far.
    """
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
    """A body in plain numbers with its rates at `time` [s], `lag` after their own instant.

    `driven` is the speed of a prescribed angle [rad/s].
    """
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
    """The wrench on a body with one more force [N] and its moment about the body's center [N m]."""
    wrench.force = wrench.force + force
    wrench.moment = wrench.moment + moment
    return wrench


@wp.func
def body_energy(off: Any, body: Any, heading: Any, motion: Any, mount: Any):
    """Kinetic and potential energy of a body with its rates at one instant [J]; 0 where its motion is prescribed."""
    energy = wp.float64(0.0)
    if mount.active != 0:
        energy = wp.float64(mount_energy(off, body, heading, mount))
    elif motion.prescribed == 0:
        speed = speed_as_float64(body)
        energy = wp.float64(0.5) * speed * speed / wp.float64(motion.inverse_inertia)
    return energy


@wp.func
def holding_force_and_power(off: Any, body: Any, heading: Any, wrench: Any, rates: Any, motion: Any, mount: Any):
    """Force [N] that holds a body's center on an active mount, and power [W] of what prescribes center and angle.

    Arguments as of `body_accelerations`, with the body's rates at the instant and the accelerations `rates`.
    """
    held = holding_force(off, body, heading, wrench, rates, mount)
    return held, prescribing_power(body, heading, held, rates, motion.prescribed, mount)


@wp.func
def late_power(wrench: Any, now: Any, pose: Any, lag: Any, carried: bool):
    """Power [W] of contacts on a body that they miss, since they take its rates from its acceleration of the step
    before.

    Args:
        wrench: of contacts [N, N m].
        now: the body in plain numbers, with its rates at the forces' instant.
        pose: as contacts saw it, `lag` before that [s].
        carried: another body carries its center, which then has the center's power.
    """
    power = wrench.moment * (now.speed - leading_value(pose.speed) - lag * pose.angular)
    if not carried:
        power += wp.dot(wrench.force, now.velocity - leading_value(pose.velocity) - lag * pose.straight)
    return power


@wp.func
def is_in_box(low: Any, high: Any, p: Any):
    """Whether point `p` is finite and in a drive's box, which holds rollers and bodies' centers."""
    return p[0] > low[0] and p[0] < high[0] and p[1] > low[1] and p[1] < high[1]


@wp.func
def has_finite_rotation(angle: Any, speed: Any):
    """Whether a body's angle and angular velocity are finite."""
    return wp.isfinite(rounded_value(angle)) and wp.isfinite(rounded_value(speed))


@wp.func
def stop_moment(angle: Any, speed: Any, arm: Any):
    """Moment [N m] of the stop that an arm leans on, and what of it is elastic."""
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
    """Length of an arm's coil spring [m] from its anchor to its point on the arm, and its derivative by the angle."""
    sine, cosine = wp.sin(angle), wp.cos(angle)
    x = arm.coil_point[0] * cosine - arm.coil_point[1] * sine
    y = arm.coil_point[0] * sine + arm.coil_point[1] * cosine
    along = wp.vector(x - arm.coil_anchor[0], y - arm.coil_anchor[1])
    length = wp.length(along)
    return length, quotient(x * along[1] - y * along[0], length)


@wp.func
def coil_moment(turned: Any, arm: Any):
    """Moment [N m] on an arm of its coil spring and that one's damper; `turned` has its angle and speed."""
    length, lever = coil_length(turned.angle, arm)
    return -lever * (arm.coil_stiffness * (length - arm.coil_free_length) + arm.coil_damping * lever * turned.speed)


@wp.func
def arm_own_moment(body: Any, heading: Any, arm: Any):
    """Moment [N m] on an arm of its weight, springs, dampers and stops.

    Args:
        body: its angle and speed.
        heading: cosine and sine of its angle.
        arm: `structs.Arm`.
    """
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
    """Moment [N m] on an arm of its springs, dampers and stops; `turned` has its angle and speed as these see it."""
    stop, elastic = stop_moment(turned.angle, turned.speed, arm)
    moment = stop - arm.stiffness * (turned.angle - arm.free_angle) - arm.damping * turned.speed
    if arm.coil_stiffness > type(moment)(0.0):
        moment = moment + coil_moment(turned, arm)
    return moment


@wp.func
def arm_mass_moment(heading: Any, arm: Any):
    """Mass of an arm times its center of mass from its pivot, at its heading [kg m]."""
    return type(heading)(
        arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1],
        arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0],
    )


@wp.func
def relax_arm(body: Any, angular: wp.float64, kick: wp.float64, h: wp.float64):
    """An arm after a step of relaxation, omega += kick alpha, theta += h omega; from rest where `kick` < `h`."""
    body.speed = wp.where(kick < h, wp.float64(0.0), body.speed) + kick * angular
    body.angle = body.angle + h * body.speed
    return body


@wp.func
def arm_energy(kinetic: wp.float64, body: Any, heading: Any, arm: Any):
    """Energy of an arm [J]: `kinetic`, that of its springs and stops, and that of its weight."""
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
    """Power [W] of what moves an arm's pivot: `power` without weight (`holding_force_and_power`), and what it lifts."""
    return power - arm.mass * wp.dot(arm.gravity, body.velocity)


@wp.func
def arm_dissipation(body: Any, arm: Any):
    """Power [W] that an arm's dampers and stops take."""
    stop, elastic = stop_moment(body.angle, body.speed, arm)
    power = arm.damping * body.speed * body.speed - (stop - elastic) * body.speed
    if arm.coil_stiffness > type(power)(0.0):
        length, lever = coil_length(body.angle, arm)
        power = power + arm.coil_damping * lever * lever * body.speed * body.speed
    return power
