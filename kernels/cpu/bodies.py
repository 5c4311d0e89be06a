"""Bodies of one variant on the CPU: accelerations, and motion by each integrator."""

from typing import Any

import warp as wp

from ..bodies.train_moments import train_cam, train_moment
from ..integrate import Stage
from ..physics.body import (
    body_accelerations,
    leapfrog_body,
    move_prescribed_center,
    pose_heading,
    stage_body,
)
from ..physics.motion import prescribed_rotation
from ..physics.mount import displacement_from_home
from ..physics.valve import constant_inertia_moment
from ..structs import Drive
from . import carried_arms, hubs, loads, tensioners, trains
from .body_states import leapfrog_interval


@wp.func
def accelerations_of(ensemble: Any, state: Any, drive: Drive, b: int, time: wp.float64):
    """Accelerations of body `b`'s center (x, y) [m/s^2] and angle [rad/s^2]; sets its load in `state.wrenches`."""
    body = state.bodies[b]
    wrench = loads.body_wrench(ensemble, state, drive, b)
    motion = ensemble.motions[b]
    mount = ensemble.mounts[b]
    wrench.load = loads.body_load(ensemble, state, drive, body, b, time)
    state.wrenches[b].load = wrench.load
    wrench.load = wrench.load + wrench.bearing
    if drive.tied != 0 and motion.train >= 0 and motion.shaft_offset == 0:
        rotors = drive.sprockets + drive.shafts
        wrench.moment = train_moment(ensemble.motions, state.train_moments, drive.first_body, rotors, b)
        wrench.load = wp.float64(0.0)
        if drive.valves > 0:
            cam = train_cam(ensemble.motions, state.cams, drive.first_body, rotors, b)
            kick = leapfrog_interval(drive, time)
            wrench.moment = constant_inertia_moment(wrench.moment, body.speed, kick, cam, motion)
    off = displacement_from_home(body.center, mount)
    return body_accelerations(time, off, body, pose_heading(state.poses[b]), wrench, motion, mount, ensemble)


@wp.func
def find_accelerations(ensemble: Any, state: Any, drive: Drive, stage: int, time: wp.float64):
    """Sets `state.rates`, all bodies' accelerations, at a stage and `time` [s]."""
    if drive.tied != 0:
        trains.find_train_moments(ensemble, state, drive, stage, time)
    for b in range(drive.first_body, drive.first_body + drive.bodies):
        state.rates[b] = accelerations_of(ensemble, state, drive, b, time)
    if drive.jointed != 0:
        lag = wp.float64(0.5) * leapfrog_interval(drive, time)
        for a in range(drive.arms):
            carried_arms.couple_accelerations(ensemble, state, drive, a, lag)


@wp.func
def take_leapfrog_step(ensemble: Any, state: Any, drive: Drive, time: wp.float64, kick: wp.float64):
    """Moves all bodies and tensioners by a leapfrog step from `time` [s]."""
    tensioners.find_supplies(ensemble, state, drive, time)
    for b in range(drive.first_body, drive.first_body + drive.bodies):
        motion, mount, rates, body = ensemble.motions[b], ensemble.mounts[b], state.rates[b], state.bodies[b]
        ahead = wp.float64(0.0)
        if motion.prescribed == 1:
            ahead, speed = prescribed_rotation(time + drive.step, motion, ensemble)
        moved = leapfrog_body(kick, drive.step, body, rates, ahead, motion, mount)
        state.bodies[b] = move_prescribed_center(time + drive.step, kick, drive.step, moved, mount, ensemble)
    if drive.hubs != 0:
        hubs.place_carried_bodies(ensemble, state, drive)
    tensioners.advance_tensioners(ensemble, state, drive)


@wp.func
def take_stage(ensemble: Any, state: Any, drive: Drive, at: Stage):
    """Moves all bodies by a Runge-Kutta stage, tensioners at the step's end."""
    if at.number == 0:
        tensioners.find_supplies(ensemble, state, drive, at.time)
    for b in range(drive.first_body, drive.first_body + drive.bodies):
        body, base, slopes = stage_body(
            at,
            state.bodies[b],
            state.body_stages[2 * b],
            state.body_stages[2 * b + 1],
            state.rates[b],
            ensemble.motions[b],
            ensemble.mounts[b],
            ensemble,
        )
        state.bodies[b] = body
        state.body_stages[2 * b] = base
        state.body_stages[2 * b + 1] = slopes
    if drive.hubs != 0:
        hubs.place_carried_bodies(ensemble, state, drive)
    if at.last == 1:
        tensioners.advance_tensioners(ensemble, state, drive)
