r"""How a sprocket turns about a fixed center at float32 without float64: `motion` and `body` in pairs.

Angles, speeds and headings are pairs, whose increments are float32: with `high` + `low` they have 48 bits. Forces,
moments and accelerations are float32. Between two looks at its angle a heading is turned by the small angle of a step,

    sin d = d (1 - d^2/6 (1 - d^2/20)),   cos d - 1 = -d^2/2 (1 - d^2/12),                                    (a)

whose next terms are below 1e-14 for steps of a hundredth of a radian.
"""

import math

import warp as wp

from ..fast_math import reciprocal
from ..number import (
    HALF_PI,
    Pair,
    apart,
    exact_product,
    minus,
    pair,
    pair_of,
    plus,
    rounded,
    settled,
    sine_cosine,
    times,
    trimmed,
    whole,
)
from ..structs import BodyState, Led, Motion, Pose, Spin, Wheel, WheelStages
from .motion import ramp, resisted
from .stages import staged
from .tooth import grid_of, reach_of


@wp.func
def spin_of(motion: Motion):
    """A body's motion and load for blocks at float32."""
    spin = Spin()
    spin.prescribed = motion.prescribed
    spin.tabulated = wp.where(motion.drive_table.cells + motion.load_table.cells > 0, 1, 0)
    spin.drive_harmonics = motion.drive_harmonics
    spin.load_harmonics = motion.load_harmonics
    spin.sign = wp.float32(motion.sign)
    spin.inverse_inertia = wp.float32(motion.inverse_inertia)
    spin.speed = pair_of(motion.speed)
    spin.ramp_time = pair_of(motion.ramp_time)
    if motion.ramp_time > wp.float64(0.0):
        spin.ramp_rate = pair_of(wp.float64(1.0) / motion.ramp_time)
    spin.start_angle = pair_of(motion.start_angle)
    spin.load = wp.vec3f(wp.float32(motion.load[0]), wp.float32(motion.load[1]), wp.float32(motion.load[2]))
    spin.load_ramp_time = wp.float32(motion.load_ramp_time)
    return spin


@wp.func
def ramped_course(time: Pair, spin: Spin):
    """phi [rad] and phi' [rad/s] of a prescribed motion without a table, as `motion.ramped`."""
    phi = plus(time, minus(times(spin.ramp_time, 0.5)))
    if time.high < spin.ramp_time.high:
        u = times(time, spin.ramp_rate)
        cube = times(times(u, u), u)
        phi = times(spin.ramp_time, times(cube, plus(times(u, -0.5), 1.0)))
    return times(spin.speed, phi), rounded(spin.speed) * ramp(rounded(time), spin.ramp_time.high)


@wp.func
def led_along(course: Pair, rate: wp.float32, spin: Spin, harmonics: wp.array[wp.vec4f]):
    """Where a prescribed motion leads, as `motion.prescribed_at`, from phi [rad] and phi' [rad/s]."""
    led = Led()
    angle = course
    factor = float(1.0)
    rows = spin.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        row = harmonics[j]
        sine, cosine = sine_cosine(plus(times(course, row[0]), row[2]))
        angle = plus(angle, times(plus(sine, -row[3]), row[1] / row[0]))
        factor = factor + row[1] * cosine.high
    led.angle = plus(spin.start_angle, times(angle, spin.sign))
    led.speed = spin.sign * rate * factor
    return led


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __cosf(angle);
#else
    return wp::cos(angle);
#endif
""")
def quick_cosine(angle: wp.float32) -> wp.float32:
    """cos(angle) to 5e-7, for angles of at most half a turn."""
    ...


@wp.func
def cosine_of(angle: Pair):
    """cos(angle) to 5e-7, whole turns taken off before it is rounded."""
    turns = wp.rint(angle.high * wp.static(0.5 / math.pi))
    turn = pair(wp.static(4.0 * HALF_PI[0]), wp.static(4.0 * HALF_PI[1]))
    return quick_cosine(rounded(plus(angle, minus(times(turn, turns)))))


@wp.func
def led_acceleration(course: Pair, rate: wp.float32, growth: wp.float32, spin: Spin, harmonics: wp.array[wp.vec4f]):
    """Angular acceleration [rad/s^2], as `motion.prescribed_acceleration`, from phi, phi' and phi''."""
    factor = float(1.0)
    slope = float(0.0)
    rows = spin.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        row = harmonics[j]
        sine, cosine = sine_cosine(plus(times(course, row[0]), row[2]))
        factor = factor + row[1] * cosine.high
        slope = slope - row[0] * row[1] * sine.high
    return spin.sign * (growth * factor + rate * rate * slope)


@wp.func
def forward_of(wheel: Wheel, spin: Spin):
    """The forward angle [rad] of a wheel."""
    return times(plus(wheel.angle, minus(spin.start_angle)), spin.sign)


@wp.func
def spin_load(time: wp.float32, torque: wp.float32, wheel: Wheel, spin: Spin, harmonics: wp.array[wp.vec4f]):
    """Load moment [N m], as `motion.load_moment`; `torque` against forward motion is constant or from a table [N m]."""
    rows = spin.load_harmonics
    if rows.count > 0:
        forward = forward_of(wheel, spin)
        for j in range(rows.first, rows.first + rows.count):
            row = harmonics[j]
            torque = torque + row[1] * cosine_of(plus(times(forward, row[0]), row[2]))
    moment = resisted(torque, wheel.speed.high, spin.sign, spin.load) * ramp(time, spin.load_ramp_time)
    return wp.where(spin.prescribed == 1, 0.0, moment)


@wp.func
def wheel_of(pose: Pose, radius: wp.float64):
    """A sprocket of pitch radius R [m] for blocks at float32."""
    wheel = Wheel()
    wheel.radius = pair_of(radius)
    wheel.grid = grid_of(wheel.radius.high)
    wheel.angle = pair_of(pose.angle)
    wheel.speed = pair_of(pose.speed)
    wheel.exact_speed = wp.float32(pose.exact_speed)
    wheel.load = wp.float32(pose.load)
    x = pair_of(pose.center[0])
    y = pair_of(pose.center[1])
    wheel.center = wp.vec2f(x.high, y.high)
    wheel.center_low = wp.vec2f(x.low, y.low)
    wheel.velocity = wp.vec2f(wp.float32(pose.velocity[0]), wp.float32(pose.velocity[1]))
    return face(wheel, pair_of(pose.cosine), pair_of(pose.sine))


@wp.func
def wheel_at(body: BodyState, radius: wp.float64):
    """A sprocket of pitch radius R [m] where a body is, without float64's series."""
    pose = Pose()
    pose.cosine = wp.float64(1.0)
    pose.angle = body.angle
    pose.speed = body.speed
    pose.center = body.center
    pose.velocity = body.velocity
    return faced(wheel_of(pose, radius))


@wp.func
def with_spin(body: BodyState, wheel: Wheel):
    """A body, whose center is fixed, with the angle and angular velocity of its wheel."""
    body.angle = whole(trimmed(wheel.angle))
    body.speed = whole(trimmed(wheel.speed))
    return body


@wp.func
def face(wheel: Wheel, cosine: Pair, sine: Pair):
    """A wheel that heads where cosine and sine say."""
    wheel.cosine = cosine
    wheel.sine = sine
    wheel.reach_cosine = reach_of(cosine, wheel.radius, wheel.grid)
    wheel.reach_sine = reach_of(sine, wheel.radius, wheel.grid)
    return wheel


@wp.func
def faced(wheel: Wheel):
    """A wheel that heads where its angle says; angle and speed then are what float64 can hold."""
    wheel.angle = trimmed(wheel.angle)
    wheel.speed = trimmed(wheel.speed)
    sine, cosine = sine_cosine(wheel.angle)
    return face(wheel, cosine, sine)


@wp.func
def swung(wheel: Wheel, turn: wp.float32):
    """A wheel whose heading is turned by a small angle [rad], (a)."""
    square = turn * turn
    less = -0.5 * square * (1.0 - square * wp.static(1.0 / 12.0))
    sine = turn * (1.0 - square * wp.static(1.0 / 6.0) * (1.0 - square * wp.static(1.0 / 20.0)))
    c = wheel.cosine
    s = wheel.sine
    return face(
        wheel,
        settled(c.high, c.low + (less * c.high - sine * s.high)),
        settled(s.high, s.low + (less * s.high + sine * c.high)),
    )


@wp.func
def spun(wheel: Wheel, change: wp.float32, h: wp.float32, ahead: Led, spin: Spin):
    """A wheel a leapfrog step on, as `body.leapfrog_body` takes a body's angle.

    Args:
        wheel: before it.
        change: of its speed in this step [rad/s].
        h: the step [s].
        ahead: where it is led, if its angle is prescribed.
        spin: how it is turned.
    """
    turn = float(0.0)
    if spin.prescribed == 1:
        turn = apart(ahead.angle, wheel.angle)
        wheel.speed = pair_of(turn * reciprocal(h))
        wheel.angle = ahead.angle
        wheel.exact_speed = ahead.speed
    else:
        wheel.speed = settled(wheel.speed.high, wheel.speed.low + change)
        way = exact_product(h, wheel.speed.high)
        turn = way.high + (way.low + h * wheel.speed.low)
        wheel.angle = plus(wheel.angle, way)
    return swung(wheel, turn)


@wp.func
def spin_staged(
    number: int, weight: wp.float32, reach: wp.float32, wheel: Wheel, stages: WheelStages, angular: wp.float32
):
    """Angle and angular velocity where the next stage of rk4 has them, as `stages.staged`; the heading is as before.

    `angular` is the angular acceleration [rad/s^2].
    """
    turning = wheel.speed
    angle, of_angle = staged(number, weight, reach, wheel.angle, turning, stages.angle)
    speed, of_speed = staged(number, weight, reach, turning, pair_of(angular), stages.speed)
    wheel.angle = angle
    wheel.speed = speed
    stages.angle = of_angle
    stages.speed = of_speed
    return wheel, stages
