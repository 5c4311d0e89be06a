"""Bodies: what carries teeth and guides and is moved by the chain's wrench on it.

A body has three coordinates, its center (x, y) and its angle; each is free, held, or prescribed. A sprocket whose
center is fixed and that has no balance wheel only turns (`Mount.active` = 0); the others follow `mount`. What is
prescribed takes its mean speed over a leapfrog step, which leads it exactly from place to place.

`body_rates` has the accelerations of all coordinates, `leapfrog_body` and `rk4_body` take a body on by one integrator
each, `body_at` observes it. A new kind of body adds its own forces in `body_rates`.
"""

import warp as wp

from ..fast_math import reciprocal
from ..integrate import Rk4Stage
from ..number import sine_cosine
from ..structs import BodyStages, BodyState, Curves, Drive, Motion, Mount, Pose, Wrench
from .motion import prescribed_acceleration, prescribed_at
from .mount import PRESCRIBED, accelerations, holding_force, mounted_energy, prescribed_center, prescribing_power


@wp.func
def heading_of(body: BodyState):
    """Cosine and sine of a body's angle."""
    sine, cosine = sine_cosine(body.angle)
    return wp.vec2d(cosine, sine)


@wp.func
def pose_of(body: BodyState):
    """A body as contacts see it."""
    heading = heading_of(body)
    pose = Pose()
    pose.cosine = heading[0]
    pose.sine = heading[1]
    pose.angle = body.angle
    pose.speed = body.speed
    pose.center = body.center
    pose.velocity = body.velocity
    return pose


@wp.func
def body_rates(
    time: wp.float64,
    body: BodyState,
    heading: wp.vec2d,
    wrench: Wrench,
    load: wp.float64,
    motion: Motion,
    mount: Mount,
    curves: Curves,
):
    """Accelerations of a body's center (x, y) [m/s^2] and angle [rad/s^2], eq. (4); 0 for a prescribed angle that
    nothing else hangs on.

    Args:
        time: for what is prescribed [s].
        body: its coordinates and rates; its angle and speed must be those of `time`.
        heading: cosine and sine of its angle.
        wrench: of the chain on it.
        load: load moment [N m], if its angle is free.
        motion, mount, curves: how it is turned and held.
    """
    zero = wp.float64(0.0)
    rates = wp.vec3d(zero, zero, zero)
    if mount.active == 0:
        rates[2] = (wrench.moment + load) * motion.inverse_inertia  # whose inverse is zero where the angle is led
    else:
        turning = wp.vec3d(zero, zero, load)
        if motion.prescribed == 1:
            angle, speed = prescribed_at(time, motion, curves)
            body.speed = speed
            turning = wp.vec3d(wp.float64(1.0), prescribed_acceleration(time, motion, curves), zero)
        driven = wp.vec2d()
        if mount.moves == PRESCRIBED:
            place, velocity, driven = prescribed_center(time, mount)
        rates = accelerations(driven, body.center - mount.home, body, heading, wrench, turning, mount)
    return rates


@wp.func
def leapfrog_body(
    time: wp.float64,
    kick: wp.float64,
    h: wp.float64,
    body: BodyState,
    rates: wp.vec3d,
    ahead: wp.float64,
    motion: Motion,
    mount: Mount,
):
    """A body a step `h` after `time`; `kick` as `leapfrog_kick`, `ahead` the angle then where it is prescribed."""
    led = motion.prescribed == 1
    speed = wp.where(led, (ahead - body.angle) * reciprocal(h), body.speed + kick * rates[2])
    body.angle = wp.where(led, ahead, body.angle + h * speed)
    body.speed = speed
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(time + h, mount)
        body.velocity = (center - body.center) * reciprocal(h)
        body.center = center
    elif mount.active != 0:
        body.velocity = body.velocity + kick * wp.vec2d(rates[0], rates[1])
        body.center = body.center + h * body.velocity
    return body


@wp.func
def rk4_body(
    at: Rk4Stage,
    body: BodyState,
    stages: BodyStages,
    rates: wp.vec3d,
    motion: Motion,
    mount: Mount,
    curves: Curves,
):
    """A body where the next of the four stages evaluates it, after the fourth at the step's end, and its `stages`."""
    straight = wp.vec2d(rates[0], rates[1])
    turning = body.speed
    moving = body.velocity
    if at.number == 0:
        stages = BodyStages()
        stages.base = body
    stages.slopes.angle = stages.slopes.angle + at.weight * turning
    stages.slopes.speed = stages.slopes.speed + at.weight * rates[2]
    stages.slopes.center = stages.slopes.center + at.weight * moving
    stages.slopes.velocity = stages.slopes.velocity + at.weight * straight
    if at.number == 3:
        body.angle = stages.base.angle + stages.slopes.angle
        body.speed = stages.base.speed + stages.slopes.speed
        body.center = stages.base.center + stages.slopes.center
        body.velocity = stages.base.velocity + stages.slopes.velocity
    else:
        body.angle = stages.base.angle + at.reach * turning
        body.speed = stages.base.speed + at.reach * rates[2]
        body.center = stages.base.center + at.reach * moving
        body.velocity = stages.base.velocity + at.reach * straight
    if motion.prescribed == 1:
        angle, speed = prescribed_at(at.after, motion, curves)
        body.angle = angle
        body.speed = speed
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(at.after, mount)
        body.center = center
        body.velocity = velocity
    return body, stages


@wp.func
def body_at(
    time: wp.float64,
    lag: wp.float64,
    body: BodyState,
    rates: wp.vec3d,
    driven: wp.float64,
    motion: Motion,
    mount: Mount,
):
    """A body with its rates at `time`, `lag` after their instant; `driven` is the speed of a prescribed angle."""
    body.speed = wp.where(motion.prescribed == 1, driven, body.speed + lag * rates[2])
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(time, mount)
        body.velocity = velocity
    else:
        body.velocity = body.velocity + lag * wp.vec2d(rates[0], rates[1])
    return body


@wp.func
def body_energy(body: BodyState, motion: Motion, mount: Mount):
    """Kinetic and potential energy of a body with its rates at one instant [J]; 0 of one that is led."""
    energy = wp.float64(0.0)
    if mount.active != 0:
        energy = mounted_energy(body, heading_of(body), mount)
    elif motion.prescribed == 0:
        energy = wp.float64(0.5) * body.speed * body.speed / motion.inverse_inertia
    return energy


@wp.func
def held_by(
    time: wp.float64,
    body: BodyState,
    wrench: Wrench,
    load: wp.float64,
    motion: Motion,
    mount: Mount,
    curves: Curves,
):
    """Force [N] of what holds a body's center on an active mount, and power [W] of what prescribes center and angle.

    Arguments as of `body_rates`, with the body's rates at `time`.
    """
    heading = heading_of(body)
    rates = body_rates(time, body, heading, wrench, load, motion, mount, curves)
    held = holding_force(body.center - mount.home, body, heading, wrench, rates, mount)
    return held, prescribing_power(body, heading, held, rates, motion.prescribed, mount)


@wp.func
def in_box(drive: Drive, p: wp.vec2d):
    """Whether `p` is finite and in the box that rollers and bodies' centers of a drive stay in."""
    return p[0] > drive.low[0] and p[0] < drive.high[0] and p[1] > drive.low[1] and p[1] < drive.high[1]


@wp.func
def turns_soundly(angle: wp.float64, speed: wp.float64):
    """Whether a body's angle and angular velocity are finite."""
    return wp.isfinite(angle) and wp.isfinite(speed)
