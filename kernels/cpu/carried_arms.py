"""Arms that arms carry, on the CPU: moments and coupled accelerations (`physics.hub`, (b))."""

from typing import Any

import warp as wp

from ..bodies.carried_arms import coupled_acceleration, joint_terms
from ..physics.body import arm_mass_moment, heading_of, pose_of, wrench_with_force
from ..physics.guide import world_vector
from ..physics.hub import carried_arm_acceleration, carried_arm_energy, pivot_force
from ..structs import Arm, BodyState, Drive, Now, Wrench
from . import body_states


@wp.func
def carrier_body(drive: Drive, on: int):
    """Body, among all, that is arm `on` of the drive, counted from 1; -1 for 0."""
    return wp.where(on > 0, drive.first_body + drive.bodies - drive.arms + on - 1, -1)


@wp.func
def carried_energy(body: BodyState, carrier: BodyState, arm: Arm):
    """Kinetic energy [J] of a carried arm by its pivot's motion."""
    lever = world_vector(arm.lever, pose_of(carrier))
    return carried_arm_energy(body.speed, arm_mass_moment(heading_of(body), arm), lever, carrier)


@wp.func
def wrench_with_pivot_forces(
    ensemble: Any, state: Any, drive: Drive, a: int, wrench: Wrench, rates: wp.vec3d, now: Now
):
    """Wrench on arm `a` of a drive with carried arms' pivot forces, and its accelerations."""
    for k in range(drive.arms):
        arm = ensemble.arms[drive.first_arm + k]
        if arm.on == a + 1:
            b = drive.first_body + drive.bodies - drive.arms + k
            body = body_states.body_now(ensemble, state, b, now.time, now.lag)
            force = pivot_force(body.speed, state.rates[b][2], arm_mass_moment(heading_of(body), arm))
            wrench = wrench_with_force(wrench, force, wp.float64(0.0))
            rates[2] = state.rates[carrier_body(drive, arm.on)][2]
    return wrench, rates


@wp.func
def couple_accelerations(ensemble: Any, state: Any, drive: Drive, a: int, lag: wp.float64):
    """Sets the coupled accelerations, (b), of arm `a` of a drive and of arms on it."""
    arms, motions, poses = ensemble.arms, ensemble.motions, state.poses
    first = drive.first_body + drive.bodies - drive.arms
    rates = state.rates[first + a]
    rates[2] = coupled_acceleration(drive, arms, motions, poses, state.rates, first, a, lag)
    for k in range(drive.arms):
        if arms[drive.first_arm + k].on == a + 1:
            terms, inverse = joint_terms(drive, arms, motions, poses, state.rates, first, k, lag)
            turning = state.rates[first + k]
            turning[2] = carried_arm_acceleration(rates[2], terms, inverse)
            state.rates[first + k] = turning
            state.rates[first + a] = rates
