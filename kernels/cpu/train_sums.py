"""Sums over the window of one variant's trains and valves on the CPU."""

from typing import Any

import warp as wp

from ..bodies.loads import body_motor_moment
from ..physics.motion import load_moment_at_speed
from ..physics.train import coupling_loss, is_on_gear_side
from ..structs import GROUND, Drive, Now, Sums
from ..sums import add_coupling, add_gear, add_shaft, add_valve
from . import body_states, couplings, valves


@wp.func
def add_shaft_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, h: int, now: Now):
    """Adds a step of shaft h of the drive to the window's sums."""
    b, i = drive.first_body + drive.sprockets + h, drive.first_shaft + h
    body = body_states.body_now(ensemble, state, b, now.time, now.lag)
    before, motion = state.bodies[b], ensemble.motions[b]
    load = load_moment_at_speed(now.time, state.wrenches[b].load, before.speed, body.speed, motion)
    motor = body_motor_moment(now.time, ensemble, drive, drive.sprockets + h, before, motion)
    sums.shaft[i] = add_shaft(sums.shaft[i], body.speed, motor, load, now.weight)


@wp.func
def add_coupling_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, c: int, now: Now):
    """Adds a step of coupling c of all to the window's sums."""
    coupling, engaged = ensemble.couplings[c], state.couplings[c]
    twist, rate, moment = couplings.twist_and_moment_now(ensemble, state, drive, c, now.time, now.lag)
    led = wp.float64(0.0)
    for second in range(2):
        body = wp.where(second == 0, coupling.first, coupling.second)
        b = drive.first_body + wp.max(body, 0)
        if body != GROUND and ensemble.motions[b].prescribed == 1:
            speed = body_states.body_now(ensemble, state, b, now.time, now.lag).speed
            led = led + wp.where(second == 0, -moment, engaged.ratio * moment) * speed
    power = coupling_loss(twist, rate, coupling, engaged)
    lost = wp.where(now.step == drive.window_start, wp.float64(0.0), engaged.lost)
    sums.coupling[c] = add_coupling(sums.coupling[c], twist, moment, power, led, lost, now.weight)


@wp.func
def add_gear_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, g: int, now: Now):
    """Adds a step of gear pair g of all to the window's sums."""
    gear = ensemble.gears[g]
    at = drive.first_body + gear.body
    mine = ensemble.motions[at]
    moment = gear.inertia * body_states.angular_acceleration_now(ensemble, state, at, now.time)
    for b in range(drive.sprockets + drive.shafts):
        if is_on_gear_side(gear, b):
            other = drive.first_body + b
            moment = moment - ensemble.motions[other].ratio / mine.ratio * state.train_moments[other]
    for v in range(drive.first_valve, drive.first_valve + drive.valves):
        valve = ensemble.valves[v]
        if is_on_gear_side(gear, valve.body):
            torque, force = valves.valve_load_now(ensemble, state, drive, v, now.time, now.lag)
            beside = ensemble.motions[drive.first_body + valve.body].ratio / mine.ratio
            moment = moment + beside * valve.sign * torque
    sums.gear[g] = add_gear(sums.gear[g], moment, wp.abs(moment) / gear.lever, now.weight)


@wp.func
def add_valve_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, v: int, now: Now):
    """Adds a step of valve group v of all to the window's sums."""
    torque, force = valves.valve_load_now(ensemble, state, drive, v, now.time, now.lag)
    sums.valve[v] = add_valve(sums.valve[v], torque, force, now.weight)


@wp.func
def add_train_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, now: Now):
    """Adds a step of shafts, couplings, gears and valves to the window's sums."""
    for h in range(drive.shafts):
        add_shaft_step(ensemble, state, sums, drive, h, now)
    for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
        add_coupling_step(ensemble, state, sums, drive, c, now)
    for g in range(drive.first_gear, drive.first_gear + drive.gears):
        add_gear_step(ensemble, state, sums, drive, g, now)
    for v in range(drive.first_valve, drive.first_valve + drive.valves):
        add_valve_step(ensemble, state, sums, drive, v, now)
