r"""An arm: a rigid body that turns about a fixed pivot, with a torsion spring, a damper and two stops.

    I theta'' = N + M_g - k_t (theta - theta_0) - c_t omega + M_stop,                                     (a)

N the moment of contacts and tensioners about the pivot, M_g = r x g of its weight, r = m (c - p) turned by theta. A
stop pushes only, M_stop = k (theta_low - theta) - c omega >= 0 below the lower one, likewise above the upper one.
"""

from typing import Any

import warp as wp

from ..structs import BodyState


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
def own_moment(body: Any, heading: Any, arm: Any):
    """Moment [N m] on an arm of all but contacts and tensioners: weight, spring, damper, stops, as in (a).

    Args:
        body: its angle and speed.
        heading: cosine and sine of its angle.
        arm: its data.
    """
    x = arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1]
    y = arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0]
    stop, elastic = stop_moment(body.angle, body.speed, arm)
    weight = x * arm.gravity[1] - y * arm.gravity[0]
    return weight + stop - arm.stiffness * (body.angle - arm.free_angle) - arm.damping * body.speed


@wp.func
def relaxed_arm(body: BodyState, angular: wp.float64, kick: wp.float64, h: wp.float64):
    """An arm after a step of relaxation, omega += kick alpha, theta += h omega; from rest where `kick` < `h`."""
    body.speed = wp.where(kick < h, wp.float64(0.0), body.speed) + kick * angular
    body.angle = body.angle + h * body.speed
    return body


@wp.func
def arm_turning(body: Any, heading: Any, moment: Any, arm: Any):
    """Angular acceleration of an arm [rad/s^2], (a).

    `moment` is that of contacts and tensioners about the pivot [N m].
    """
    return (moment + own_moment(body, heading, arm)) * arm.inverse_inertia


@wp.func
def arm_rates(body: BodyState, heading: wp.vec2d, moment: wp.float64, arm: Any):
    """Accelerations of an arm's center (none) and angle, as `body.body_rates` gives a sprocket's."""
    return wp.vec3d(wp.float64(0.0), wp.float64(0.0), arm_turning(body, heading, moment, arm))


@wp.func
def arm_energy(body: Any, heading: Any, arm: Any):
    """Kinetic, elastic and potential energy of an arm [J]."""
    half = type(body.speed)(0.5)
    turned = body.angle - arm.free_angle
    energy = half * body.speed * body.speed / arm.inverse_inertia + half * arm.stiffness * turned * turned
    beyond = wp.max(arm.low - body.angle, type(half)(0.0)) + wp.max(body.angle - arm.high, type(half)(0.0))
    energy += half * arm.stop_stiffness * beyond * beyond
    x = arm.mass_moment[0] * heading[0] - arm.mass_moment[1] * heading[1]
    y = arm.mass_moment[0] * heading[1] + arm.mass_moment[1] * heading[0]
    return energy - x * arm.gravity[0] - y * arm.gravity[1]


@wp.func
def arm_dissipation(body: Any, arm: Any):
    """Power [W] that an arm's damper and stops take."""
    stop, elastic = stop_moment(body.angle, body.speed, arm)
    return arm.damping * body.speed * body.speed - (stop - elastic) * body.speed
