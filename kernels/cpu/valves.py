"""Valves of one variant on the CPU: effect on bodies that have cams."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.valve import add_cam, add_cam_load, cam_lift, zero_valve_load
from ..structs import Cam, Drive, types
from .body_states import body_state_functions


@dataclass(frozen=True)
class ValveFunctions:
    """CPU valve functions (`physics.valve`)."""

    find_valve_loads: wp.Function
    valve_load_now: wp.Function


@cache
def valve_functions(Real: type) -> ValveFunctions:
    """CPU valve functions."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    body_states = body_state_functions(Real)

    @wp.func
    def find_valve_loads(ensemble: Ensemble, state: State, drive: Drive):
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
    def valve_load_now(ensemble: Ensemble, state: State, drive: Drive, v: int, time: wp.float64, lag: wp.float64):
        """Torque [N m] of valve group `v` of all against rotation, and least follower force [N], on the CPU."""
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

    return ValveFunctions(find_valve_loads=find_valve_loads, valve_load_now=valve_load_now)
