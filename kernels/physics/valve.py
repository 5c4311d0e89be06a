"""Valve trains: cams on a body that lift followers of mass m against springs F_0 + k l.

Each valve has the lift l(phi), phi its body's forward angle less the valve's phase. With J_e = J + sum m l'^2, w the
body's speed and M all other moments,

    d/dt (J_e w) = J_e' w^2 / 2 - sum (F_0 + k l) l' + M.                                                 (a)

Cam and follower press on each other with

    N = F_0 + k l + m (l'' w^2 + l' w'),    sum N l' the torque against forward rotation;                  (b)

below 0 the follower would lift off. Over a leapfrog step

    J_e (w_+ - w_-) = h (M - sum (F_0 + k l) l') - h (J_e' / 2) w_- w_+.                                  (c)
"""

from typing import Any

import warp as wp

from ..native import quotient
from ..number import add, leading_value, mul, number_of, rounded_value, sub  # noqa: F401
from .motion import table_derivatives


@wp.func
def cam_angle(angle: Any, phase: Any, valve: Any, motion: Any):
    """Forward angle [rad] of a body's cam, less its valve's phase."""
    return valve.sign * (angle - motion.start_angle) - valve.turned - phase


@wp.func
def cam_lift(angle: Any, k: int, valve: Any, motion: Any, tables: Any):
    """Lift [m] of the `k`-th cam of a valve group, two derivatives by angle, rounded."""
    turned = cam_angle(angle, tables[valve.first_phase + k], valve, motion)
    lift, slope, bend = table_derivatives(turned, valve.lift, tables)
    return wp.vector(valve.height * leading_value(lift), valve.height * slope, valve.height * bend)


@wp.func
def add_cam(cam: Any, at: Any, valve: Any):
    """Inertia and moment of a body's valves with one more cam's, whose lift is `at`."""
    half = type(valve.mass)(0.5)
    lift, slope, bend = at[0], at[1], at[2]
    cam.inertia = cam.inertia + valve.count * valve.mass * slope * slope
    cam.growth = cam.growth + valve.sign * valve.count * valve.mass * slope * bend
    cam.moment = cam.moment - valve.sign * valve.count * (valve.preload + valve.stiffness * lift) * slope
    cam.energy = cam.energy + valve.count * (valve.preload + half * valve.stiffness * lift) * lift
    return cam


@wp.func
def add_geared_cam(total: Any, cam: Any, ratio: Any):
    """Inertia and moment of valves with those on another body, turning `ratio` times as fast."""
    total.inertia = total.inertia + ratio * ratio * cam.inertia
    total.growth = total.growth + ratio * ratio * ratio * cam.growth
    total.moment = total.moment + ratio * cam.moment
    return total


@wp.func
def valve_inertia_share(speed: Any, kick: Any, cam: Any, motion: Any):
    """Inertia of a train's valves over a step, (c), relative to the train's [-]."""
    return motion.inverse_inertia * (cam.inertia + kick * cam.growth * speed)


@wp.func
def constant_inertia_moment(moment: Any, speed: Any, kick: Any, cam: Any, motion: Any):
    """Moment [N m] that turns a body without its valves' inertia as `moment` with them, (c).

    `kick`: leapfrog's step [s], else 0.
    """
    if motion.prescribed == 1:
        return moment
    share = valve_inertia_share(speed, kick, cam, motion)
    return quotient(moment + cam.moment - cam.growth * speed * speed, type(share)(1.0) + share)


@wp.func
def cam_energy(speed: Any, cam: Any, motion: Any):
    """Energy [J] of a body's valves, 0 with prescribed motion."""
    energy = cam.energy + type(speed)(0.5) * cam.inertia * speed * speed
    return wp.where(motion.prescribed == 1, type(speed)(0.0), energy)


@wp.func
def zero_valve_load(valve: Any):
    """Load of a valve group without cams: torque 0 [N m], force infinite [N]."""
    return wp.vector(type(valve.mass)(0.0), type(valve.mass)(wp.inf))


@wp.func
def add_cam_load(load: Any, at: Any, speed: Any, angular: Any, valve: Any):
    """Torque [N m] of a valve group and least follower force [N], (b), with one more cam of lift `at`."""
    lift, slope, bend = at[0], at[1], at[2]
    force = valve.preload + valve.stiffness * lift
    force = force + valve.mass * (bend * speed * speed + valve.sign * slope * angular)
    return wp.vector(load[0] + valve.count * force * slope, wp.min(load[1], force))
