"""Arms that arms carry: the moments between them, and how each accelerates the other (`physics.hub`, (b))."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.body import arm_mass_moment, arm_spring_moment, heading_of, pose_of
from ..physics.guide import world_vector
from ..physics.hub import carried_arm_acceleration, carried_arm_terms, eliminate_carried_arm, relative_body
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

    spring_state: wp.Function
    carried_spring_moment: wp.Function
    couple_accelerations: wp.Function


@cache
def carried_arm_functions(Real: type) -> CarriedArmFunctions:
    """The functions of one variant's arms that carry arms."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def spring_state(ensemble: Ensemble, state: State, drive: Drive, a: int, body: BodyState):
        """Arm `a` of the drive, at `body`, relative to the arm that carries it, if any: as its spring sees it."""
        on = arm_carrier(drive, ensemble.arms[drive.first_arm + a].on)
        if on >= 0:
            body = relative_body(body, state.bodies[on])
        return body

    @wp.func
    def carried_spring_moment(ensemble: Ensemble, state: State, drive: Drive, a: int):
        """Moment [N m] on arm `a` of the drive of springs, dampers and stops of the arms that it carries."""
        moment = wp.float64(0.0)
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == a + 1:
                body = state.bodies[drive.first_body + drive.bodies - drive.arms + k]
                moment = moment - arm_spring_moment(spring_state(ensemble, state, drive, k, body), arm)
        return moment

    @wp.func
    def joint_terms(ensemble: Ensemble, state: State, drive: Drive, k: int, lag: wp.float64):
        """The terms of carried arm `k` in (b), and 1 / I_2."""
        arm = ensemble.arms[drive.first_arm + k]
        b, on = drive.first_body + drive.bodies - drive.arms + k, arm_carrier(drive, arm.on)
        own, carrier = state.bodies[b], state.bodies[on]
        lever, s = world_vector(arm.lever, pose_of(carrier)), arm_mass_moment(heading_of(own), arm)
        w1, w2 = carrier.speed + lag * carrier.angular, own.speed + lag * own.angular
        led = wp.vec2d(state.rates[on][0], state.rates[on][1])
        inverse = wp.float64(ensemble.motions[b].inverse_inertia)
        return carried_arm_terms(lever, s, w1, w2, led, state.rates[b][2] / inverse), inverse

    @wp.func
    def couple_accelerations(ensemble: Ensemble, state: State, drive: Drive, a: int, lag: wp.float64):
        """Sets the accelerations of arm `a` of the drive and of the arms on it, (b), from those without coupling."""
        first = drive.first_body + drive.bodies - drive.arms
        rates = state.rates[first + a]
        inertia = wp.float64(1.0) / ensemble.motions[first + a].inverse_inertia
        moment = inertia * rates[2]
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == a + 1:
                terms, inverse = joint_terms(ensemble, state, drive, k, lag)
                moment, inertia = eliminate_carried_arm(moment, inertia, terms, inverse)
        rates[2] = moment / inertia
        for m in range(drive.arms):
            if ensemble.arms[drive.first_arm + m].on == a + 1:
                of, over = joint_terms(ensemble, state, drive, m, lag)
                turning = state.rates[first + m]
                turning[2] = carried_arm_acceleration(rates[2], of, over)
                state.rates[first + m] = turning
                state.rates[first + a] = rates

    return CarriedArmFunctions(
        spring_state=spring_state,
        carried_spring_moment=carried_spring_moment,
        couple_accelerations=couple_accelerations,
    )
