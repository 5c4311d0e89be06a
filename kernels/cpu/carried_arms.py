"""Arms that arms carry: the moments between them, and how each accelerates the other (`physics.hub`, (b))."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..bodies.carried_arms import coupled_acceleration, joint_terms
from ..physics.body import arm_mass_moment, heading_of, pose_of
from ..physics.guide import world_vector
from ..physics.hub import carried_arm_acceleration
from ..physics.hub import carried_arm_energy as energy_of
from ..structs import Arm, BodyState, Drive, types


@wp.func
def arm_carrier(drive: Drive, on: int):
    """The body of all that is arm `on` of the drive, counted from 1; negative for 0."""
    return wp.where(on > 0, drive.first_body + drive.bodies - drive.arms + on - 1, -1)


@wp.func
def carried_energy(body: BodyState, carrier: BodyState, arm: Arm):
    """Kinetic energy [J] of an arm by its pivot moving along with the arm that carries it."""
    lever = world_vector(arm.lever, pose_of(carrier))
    return energy_of(body.speed, arm_mass_moment(heading_of(body), arm), lever, carrier)


@dataclass(frozen=True)
class CarriedArmFunctions:
    """Moments and accelerations of arms that carry arms (`physics.hub`, (b))."""

    couple_accelerations: wp.Function


@cache
def carried_arm_functions(Real: type) -> CarriedArmFunctions:
    """The functions of one variant's arms that carry arms."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def couple_accelerations(ensemble: Ensemble, state: State, drive: Drive, a: int, lag: wp.float64):
        """Sets the accelerations of arm `a` of the drive and of the arms on it, (b), from those without coupling."""
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

    return CarriedArmFunctions(
        couple_accelerations=couple_accelerations,
    )
