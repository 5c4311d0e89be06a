"""Sums over the window of one variant's bodies on the CPU, and energies at its ends."""

from typing import Any

import warp as wp

from ..physics.body import (
    arm_dissipation,
    arm_energy,
    body_accelerations,
    body_energy,
    heading_of,
    holding_force_and_power,
    late_contact_power,
    pivot_power,
)
from ..physics.hub import relative_body
from ..physics.motion import load_moment_at_speed
from ..physics.mount import CARRIED, displacement_from_home
from ..physics.train import own_body_energy
from ..physics.valve import cam_energy
from ..structs import Drive, Now, Sums
from ..sums import add_arm, add_bearing, add_hub_force, add_mount, add_powers
from . import body_states, carried_arms, hubs, loads
from .body_states import arm_of
from .carried_arms import carried_energy, carrier_body


@wp.func
def body_energy_now(ensemble: Any, state: Any, drive: Drive, b: int, now: Now):
    """Energy [J] of body `b` of all at an evaluated step, with its valves'."""
    body = body_states.body_now(ensemble, state, b, now.time, now.lag)
    heading = heading_of(body)
    mount = ensemble.mounts[b]
    energy = body_energy(displacement_from_home(body.center, mount), body, heading, ensemble.motions[b], mount)
    arm = arm_of(drive, b)
    if arm >= 0:
        of, turned = ensemble.arms[arm], body
        on = carrier_body(drive, of.on)
        if on >= 0:
            carrier = body_states.body_now(ensemble, state, on, now.time, now.lag)
            turned = relative_body(body, carrier)
            energy += carried_energy(body, carrier, of)
        energy = arm_energy(energy, turned, heading, of)
    if arm < 0 and (drive.tied != 0 or drive.chains != 1):
        energy = own_body_energy(energy, body.speed, ensemble.motions[b])
    if drive.valves > 0:
        energy += cam_energy(body.speed, state.cams[b], ensemble.motions[b])
    return energy


@wp.func
def add_sprocket_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, s: int, now: Now):
    """Adds a step of sprocket `s` of a drive and its mount to the window's sums."""
    i = drive.first_sprocket + s
    b = drive.first_body + s
    motion = ensemble.motions[b]
    mount = ensemble.mounts[b]
    body = body_states.body_now(ensemble, state, b, now.time, now.lag)
    wrench = state.wrenches[b]
    load = load_moment_at_speed(now.time, wrench.load, state.bodies[b].speed, body.speed, motion)
    if ensemble.hubs[i].bearing > wp.float64(0.0):
        power = hubs.bearing_power(ensemble, state, drive, s, now.time, now.lag)
        sums.mount[i] = add_bearing(sums.mount[i], power, now.weight)
    if mount.active == 1:
        whole = loads.body_wrench(ensemble, state, drive, b)
        whole.load = load + whole.bearing
        off = displacement_from_home(body.center, mount)
        heading = heading_of(body)
        rates = body_accelerations(now.time, off, body, heading, whole, motion, mount, ensemble)
        held, power = holding_force_and_power(off, body, heading, whole, rates, motion, mount)
        sums.mount[i] = add_mount(sums.mount[i], off, body.velocity, mount, held, power, now.weight)
    late = late_contact_power(wrench, body, state.poses[b], now.lag, mount.moves == CARRIED)
    sums.sprocket[i] = add_powers(sums.sprocket[i], body.speed, wrench.moment, load, late, now.weight)
    sums.sprocket[i] = add_hub_force(sums.sprocket[i], wrench.force, now.weight)


@wp.func
def add_arm_step(ensemble: Any, state: Any, sums: Sums, drive: Drive, a: int, now: Now):
    """Adds a step of arm `a` of a drive to the window's sums."""
    b = drive.first_body + drive.bodies - drive.arms + a
    i = drive.first_arm + a
    body = body_states.body_now(ensemble, state, b, now.time, now.lag)
    turned, on = body, carrier_body(drive, ensemble.arms[i].on)
    if on >= 0:
        turned = relative_body(body, body_states.body_now(ensemble, state, on, now.time, now.lag))
    power = arm_dissipation(turned, ensemble.arms[i])
    led = wp.float64(0.0)
    mount = ensemble.mounts[b]
    if mount.active == 1:
        whole = loads.body_wrench(ensemble, state, drive, b)
        whole.load = loads.body_load(ensemble, state, drive, body, b, now.time) + whole.bearing
        off, motion, heading = displacement_from_home(body.center, mount), ensemble.motions[b], heading_of(body)
        rates = body_accelerations(now.time, off, body, heading, whole, motion, mount, ensemble)
        whole, rates = carried_arms.wrench_with_pivot_forces(ensemble, state, drive, a, whole, rates, now)
        held, led = holding_force_and_power(off, body, heading, whole, rates, motion, mount)
        led = pivot_power(led, body, ensemble.arms[i])
    late = late_contact_power(state.wrenches[b], body, state.poses[b], now.lag, ensemble.mounts[b].moves == CARRIED)
    sums.arm[i] = add_arm(sums.arm[i], body, state.wrenches[b].moment, power, led, late, now.weight)
