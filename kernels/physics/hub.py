r"""How a sprocket's center moves at float32 without float64: `mount` in pairs.

Center and velocity are pairs, whose increments are float32; forces and accelerations are float32, by the functions of
`mount`.
"""

from typing import Any

import warp as wp

from ..fast_math import reciprocal
from ..number import (
    Pair,
    apart,
    exact_product,
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
from ..structs import BodyState, Hub, Mount, SpinWrench, Wheel, WheelStages
from .mount import PRESCRIBED, accelerations, holding_force, prescribing_power
from .stages import staged


@wp.func
def narrow(v: wp.vec2d):
    """A vector in float32."""
    return wp.vec2f(wp.float32(v[0]), wp.float32(v[1]))


@wp.func
def narrow_matrix(m: wp.mat22d):
    """A matrix in float32."""
    return wp.mat22f(wp.float32(m[0, 0]), wp.float32(m[0, 1]), wp.float32(m[1, 0]), wp.float32(m[1, 1]))


@wp.func
def low_part(v: wp.vec2d):
    """What float32 rounds off a vector."""
    x = pair_of(v[0])
    y = pair_of(v[1])
    return wp.vec2f(x.low, y.low)


@wp.func
def hub_of(mount: Mount, body: BodyState):
    """How a sprocket's center is held and moves, for blocks at float32."""
    hub = Hub()
    hub.active = mount.active
    hub.moves = mount.moves
    hub.home = narrow(mount.home)
    hub.home_low = low_part(mount.home)
    hub.direction = narrow(mount.direction)
    hub.offset = pair_of(mount.offset)
    hub.amplitude = pair_of(mount.amplitude)
    hub.frequency = pair_of(mount.frequency)
    hub.phase = pair_of(mount.phase)
    hub.mass = wp.float32(mount.mass)
    hub.inverse_mass = narrow_matrix(mount.inverse_mass)
    hub.stiffness = narrow_matrix(mount.stiffness)
    hub.damping = narrow_matrix(mount.damping)
    hub.preload = narrow(mount.preload)
    hub.gravity = narrow(mount.gravity)
    hub.wheel = narrow(mount.wheel)
    hub.inertia = wp.float32(mount.inertia)
    hub.velocity_low = low_part(body.velocity)
    return hub


@wp.func
def narrow_wrench(acting: wp.vec3f):
    """A moment [N m] and a force (x, y) [N] as a wrench."""
    wrench = SpinWrench()
    wrench.moment = acting[0]
    wrench.force = wp.vec2f(acting[1], acting[2])
    return wrench


@wp.func
def prescribed_phase(time: Pair, hub: Hub):
    """Sine and cosine of where a prescribed center is in its motion."""
    return sine_cosine(plus(times(hub.frequency, time), hub.phase))


@wp.func
def coordinate(wheel: Wheel, k: int):
    """One coordinate of the center [m]."""
    return pair(wheel.center[k], wheel.center_low[k])


@wp.func
def speed_along(wheel: Wheel, hub: Hub, k: int):
    """One component of the center's velocity [m/s]."""
    return pair(wheel.velocity[k], hub.velocity_low[k])


@wp.func
def off_home(wheel: Wheel, hub: Hub):
    """The center from where it is at home [m]."""
    return (wheel.center - hub.home) + (wheel.center_low - hub.home_low)


@wp.func
def hub_rates(time: Pair, wheel: Wheel, body: Any, hub: Hub, wrench: SpinWrench, turning: wp.vec3f):
    """Accelerations of a sprocket's center [m/s^2] and angle [rad/s^2], as `mount.accelerations`, which has `turning`.

    Args:
        time: for a prescribed center [s].
        wheel: where the sprocket is.
        body: its rates (`structs.SpinRates`, or what has these too).
        hub: how its center is held.
        wrench: of the chain on it.
        turning: what its angle is led by.
    """
    driven = wp.vec2f()
    if hub.moves == PRESCRIBED:
        sine, cosine = prescribed_phase(time, hub)
        driven = (-hub.amplitude.high * hub.frequency.high * hub.frequency.high * sine.high) * hub.direction
    heading = wp.vec2f(wheel.cosine.high, wheel.sine.high)
    return accelerations(driven, off_home(wheel, hub), body, heading, wrench, turning, hub)


@wp.func
def hub_held(time: Pair, wheel: Wheel, body: Any, hub: Hub, wrench: SpinWrench, turning: wp.vec3f):
    """Force [N] of what holds the center, and power [W] of what prescribes it and the angle, as `body.held_by`."""
    rates = hub_rates(time, wheel, body, hub, wrench, turning)
    heading = wp.vec2f(wheel.cosine.high, wheel.sine.high)
    held = holding_force(off_home(wheel, hub), body, heading, wrench, rates, hub)
    return held, prescribing_power(body, heading, held, rates, int(turning[0]), hub)


@wp.func
def shifted(way: Pair, kick: wp.float32, change: wp.float32):
    """A velocity after it has been accelerated."""
    return settled(way.high, way.low + kick * change)


@wp.func
def drifted(place: Pair, h: wp.float32, speed: Pair):
    """A coordinate a step on."""
    way = exact_product(h, speed.high)
    return plus(place, pair(way.high, way.low + h * speed.low))


@wp.func
def placed(x: Pair, y: Pair, u: Pair, v: Pair, wheel: Wheel, hub: Hub):
    """A sprocket whose center is at (x, y) [m] and moves at (u, v) [m/s]: the wheel and its hub."""
    wheel.center = wp.vec2f(x.high, y.high)
    wheel.center_low = wp.vec2f(x.low, y.low)
    wheel.velocity = wp.vec2f(u.high, v.high)
    hub.velocity_low = wp.vec2f(u.low, v.low)
    return wheel, hub


@wp.func
def prescribed_hub(time: Pair, hub: Hub):
    """Place (x, y) [m] and velocity [m/s] of a prescribed center."""
    sine, cosine = prescribed_phase(time, hub)
    along = plus(hub.offset, times(hub.amplitude, sine))
    x = plus(times(along, hub.direction[0]), pair(hub.home[0], hub.home_low[0]))
    y = plus(times(along, hub.direction[1]), pair(hub.home[1], hub.home_low[1]))
    return x, y, (hub.amplitude.high * hub.frequency.high * rounded(cosine)) * hub.direction


@wp.func
def hub_moved(time: Pair, kick: wp.float32, h: wp.float32, wheel: Wheel, hub: Hub, rates: wp.vec3f):
    """A sprocket's center a leapfrog step on to `time`, as `body.leapfrog_body`: the wheel and its hub."""
    x = coordinate(wheel, 0)
    y = coordinate(wheel, 1)
    u = speed_along(wheel, hub, 0)
    v = speed_along(wheel, hub, 1)
    if hub.moves == PRESCRIBED:
        to_x, to_y, moving = prescribed_hub(time, hub)
        u = pair_of(apart(to_x, x) * reciprocal(h))
        v = pair_of(apart(to_y, y) * reciprocal(h))
        x = to_x
        y = to_y
    else:
        u = shifted(u, kick, rates[0])
        v = shifted(v, kick, rates[1])
        x = drifted(x, h, u)
        y = drifted(y, h, v)
    return placed(x, y, u, v, wheel, hub)


@wp.func
def hub_staged(
    number: int,
    weight: wp.float32,
    reach: wp.float32,
    time: Pair,
    wheel: Wheel,
    hub: Hub,
    stages: WheelStages,
    rates: wp.vec3f,
):
    """A sprocket's center where the next stage of rk4 has it, at `time`: the wheel, its hub, and as `stages.staged`."""
    u = speed_along(wheel, hub, 0)
    v = speed_along(wheel, hub, 1)
    x, of_x = staged(number, weight, reach, coordinate(wheel, 0), u, stages.x)
    y, of_y = staged(number, weight, reach, coordinate(wheel, 1), v, stages.y)
    u, of_u = staged(number, weight, reach, u, pair_of(rates[0]), stages.across)
    v, of_v = staged(number, weight, reach, v, pair_of(rates[1]), stages.up)
    stages.x = of_x
    stages.y = of_y
    stages.across = of_u
    stages.up = of_v
    if hub.moves == PRESCRIBED:
        x, y, velocity = prescribed_hub(time, hub)
        u = pair_of(velocity[0])
        v = pair_of(velocity[1])
    wheel, hub = placed(x, y, u, v, wheel, hub)
    return wheel, hub, stages


@wp.func
def hub_trimmed(wheel: Wheel, hub: Hub):
    """A center and its velocity as float64 can hold them."""
    x = trimmed(coordinate(wheel, 0))
    y = trimmed(coordinate(wheel, 1))
    u = trimmed(speed_along(wheel, hub, 0))
    v = trimmed(speed_along(wheel, hub, 1))
    wheel.center_low = wp.vec2f(x.low, y.low)
    hub.velocity_low = wp.vec2f(u.low, v.low)
    return wheel, hub


@wp.func
def with_hub(body: BodyState, wheel: Wheel, hub: Hub):
    """A body with the center of its wheel, and its velocity."""
    wheel, hub = hub_trimmed(wheel, hub)
    body.center = wp.vec2d(whole(coordinate(wheel, 0)), whole(coordinate(wheel, 1)))
    body.velocity = wp.vec2d(whole(speed_along(wheel, hub, 0)), whole(speed_along(wheel, hub, 1)))
    return body


@wp.func
def hub_velocity(time: Pair, lag: wp.float32, wheel: Wheel, hub: Hub, rates: wp.vec3f):
    """Velocity of a center [m/s] `lag` after that of its rates, as `body.body_at`."""
    velocity = wheel.velocity + lag * wp.vec2f(rates[0], rates[1])
    if hub.moves == PRESCRIBED:
        x, y, velocity = prescribed_hub(time, hub)
    return velocity
