"""Hubs on the CPU: sprockets and arms that arms carry, and sprockets' bearings."""

from typing import Any

import warp as wp

from ..physics.body import pose_of, wrench_with_force
from ..physics.hub import bearing_moment, carried_body, moment_about_pivot
from ..structs import GROUND, Drive
from . import body_states
from .carried_arms import carrier_body


@wp.func
def add_hub_reactions(ensemble: Any, state: Any, drive: Drive, stage: int, stretch_part: wp.float64):
    """Adds carried bodies' forces to arms' wrenches, and bearings' moments to arms' and sprockets'."""
    for s in range(drive.sprockets):
        hub = ensemble.hubs[drive.first_sprocket + s]
        b = drive.first_body + s
        arm = drive.first_body + hub.arm
        turning = state.poses[b].speed
        force = state.wrenches[b].force
        if hub.arm != GROUND:
            lever = state.poses[b].center - state.poses[arm].center
            state.wrenches[arm] = wrench_with_force(state.wrenches[arm], force, moment_about_pivot(lever, force))
            turning = turning - state.poses[arm].speed
        if hub.bearing > wp.float64(0.0):
            held = state.hub_hold[drive.first_sprocket + s]
            moment, holds = bearing_moment(force, turning, held, hub, stretch_part)
            state.wrenches[b].bearing = moment
            if hub.arm != GROUND:
                state.wrenches[arm].bearing = state.wrenches[arm].bearing - moment
            if stage == 0:
                state.hub_hold[drive.first_sprocket + s] = holds
    if drive.jointed != 0:
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            on = carrier_body(drive, ensemble.arms[drive.first_arm + a].on)
            if on >= 0:
                force = state.wrenches[b].force
                moment = moment_about_pivot(state.poses[b].center - state.poses[on].center, force)
                state.wrenches[on] = wrench_with_force(state.wrenches[on], force, moment)


@wp.func
def place_carried_bodies(ensemble: Any, state: Any, drive: Drive):
    """Moves carried arms and sprockets with their carriers."""
    if drive.jointed != 0:
        for a in range(drive.arms):
            joint = ensemble.arms[drive.first_arm + a]
            on = carrier_body(drive, joint.on)
            if on >= 0:
                mine = drive.first_body + drive.bodies - drive.arms + a
                state.bodies[mine] = carried_body(state.bodies[mine], pose_of(state.bodies[on]), joint)
    for s in range(drive.sprockets):
        hub = ensemble.hubs[drive.first_sprocket + s]
        if hub.arm != GROUND:
            b = drive.first_body + s
            arm = pose_of(state.bodies[drive.first_body + hub.arm])
            state.bodies[b] = carried_body(state.bodies[b], arm, hub)


@wp.func
def bearing_power(ensemble: Any, state: Any, drive: Drive, s: int, time: wp.float64, lag: wp.float64):
    """Power [W] that the bearing of sprocket s dissipates at `time` [s]."""
    hub = ensemble.hubs[drive.first_sprocket + s]
    turning = body_states.body_now(ensemble, state, drive.first_body + s, time, lag).speed
    if hub.arm != GROUND:
        turning = turning - body_states.body_now(ensemble, state, drive.first_body + hub.arm, time, lag).speed
    return -state.wrenches[drive.first_body + s].bearing * turning
