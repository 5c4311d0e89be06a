"""Valves of one variant on the CPU: effect on bodies that have cams."""

from typing import Any

import warp as wp

from ..physics.valve import add_cam, add_cam_load, cam_lift, zero_valve_load
from ..structs import Cam, Drive
from . import body_states


@wp.func
def find_valve_loads(ensemble: Any, state: Any, drive: Drive):
    """Sets inertias and moments of the valves on all bodies in `state.cams`."""
    for b in range(drive.first_body, drive.first_body + drive.bodies):
        state.cams[b] = Cam()
    for v in range(drive.first_valve, drive.first_valve + drive.valves):
        valve = ensemble.valves[v]
        b = drive.first_body + valve.body
        for k in range(valve.phases):
            at = cam_lift(state.bodies[b].angle, k, valve, ensemble.motions[b], ensemble.tables)
            state.cams[b] = add_cam(state.cams[b], at, valve)


@wp.func
def valve_load_now(ensemble: Any, state: Any, drive: Drive, v: int, time: wp.float64, lag: wp.float64):
    """Torque [N m] of valve group `v` of all against rotation, and least follower force [N]."""
    valve = ensemble.valves[v]
    b = drive.first_body + valve.body
    body, angular = (
        body_states.body_now(ensemble, state, b, time, lag),
        body_states.angular_acceleration_now(ensemble, state, b, time),
    )
    load = zero_valve_load(valve)
    for k in range(valve.phases):
        at = cam_lift(body.angle, k, valve, ensemble.motions[b], ensemble.tables)
        load = add_cam_load(load, at, body.speed, angular, valve)
    return load[0], load[1]
