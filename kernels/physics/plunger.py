r"""How far a tensioner is out at float32 without float64: `tensioner`'s place and force by a body in pairs.

The touched point p turns with its body, so that the extension and its change with the angle are

    x = (c - r_0) . d + (p . d) cos theta + (p' . d) sin theta,    dx/dtheta = (p' . d) cos theta - (p . d) sin theta,

p' being p turned by +90 degrees. The second is the lever, too, at which the force along d turns the body.
"""

import warp as wp

from ..pairs import minus, pair, plus, times
from ..structs import Plunger, PlungerPush, PlungerState, Stroke, Wheel
from .tensioner import tensioner_force


@wp.func
def lever_of(wheel: Wheel, stroke: Stroke):
    """dx/dtheta [m]."""
    return wheel.cosine.high * stroke.across.high - wheel.sine.high * stroke.along.high


@wp.func
def reached(wheel: Wheel, stroke: Stroke):
    """x [m]."""
    x = times(pair(wheel.center[0], wheel.center_low[0]), stroke.direction_x)
    y = times(pair(wheel.center[1], wheel.center_low[1]), stroke.direction_y)
    turned = plus(times(wheel.cosine, stroke.along), times(wheel.sine, stroke.across))
    return plus(plus(plus(x, y), minus(stroke.home)), turned)


@wp.func
def stroke_rate(lever: wp.float32, speed: wp.float32, velocity: wp.vec2f, plunger: Plunger):
    """x' [m/s] of a body that turns at `speed` [rad/s] and whose center moves at `velocity` [m/s]."""
    return wp.dot(velocity, plunger.direction) + speed * lever


@wp.func
def plunger_push(wheel: Wheel, state: PlungerState, stroke: Stroke, plunger: Plunger):
    """What a tensioner does: its push, and the moment [N m] and force (x, y) [N] on its body."""
    lever = lever_of(wheel, stroke)
    push = PlungerPush()
    push.extension = reached(wheel, stroke)
    rate = stroke_rate(lever, wheel.speed.high, wheel.velocity, plunger)
    force, pressure = tensioner_force(push.extension, rate, state, plunger)
    push.force = force
    push.pressure = pressure
    return push, force * wp.vec3f(lever, plunger.direction[0], plunger.direction[1])
