"""Arms that hang on arms: what acts between them, and how each accelerates the other (`physics.hub`, (b))."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.body import arm_mass_moment, arm_spring_moment, heading_of, pose_of
from ..physics.guide import world_vector
from ..physics.hub import carried_arm_acceleration, carried_arm_terms, eliminate_carried_arm, relative_body
from ..physics.hub import carried_arm_energy as energy_of
from ..structs import Arm, BodyState, Drive, types


@wp.func
def carrier_of(drive: Drive, on: int):
    """The body of all that arm `on` of the drive is, counted from 1; negative for 0."""
    return wp.where(on > 0, drive.first_body + drive.bodies - drive.arms + on - 1, -1)


@wp.func
def joint_energy(body: BodyState, carrier: BodyState, arm: Arm):
    """Kinetic energy [J] that an arm has as its pivot goes along with the arm that carries it."""
    lever = world_vector(arm.lever, pose_of(carrier))
    return energy_of(body.speed, arm_mass_moment(heading_of(body), arm), lever, carrier)


@cache
def jointed(Real: type) -> SimpleNamespace:
    """The functions of arms on arms of one variant."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def turned(ensemble: Ensemble, state: State, drive: Drive, a: int, body: BodyState):
        """Arm `a` of the drive, at `body`, as its spring sees it turn."""
        on = carrier_of(drive, ensemble.arms[drive.first_arm + a].on)
        if on >= 0:
            body = relative_body(body, state.bodies[on])
        return body

    @wp.func
    def joints_on(ensemble: Ensemble, state: State, drive: Drive, a: int):
        """Moment [N m] on arm `a` of the drive of the springs, dampers and stops of arms on it."""
        moment = wp.float64(0.0)
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == a + 1:
                body = state.bodies[drive.first_body + drive.bodies - drive.arms + k]
                moment = moment - arm_spring_moment(turned(ensemble, state, drive, k, body), arm)
        return moment

    @wp.func
    def of_joint(ensemble: Ensemble, state: State, drive: Drive, k: int, lag: wp.float64):
        """The terms of arm `k` in (b), and 1 / I_2."""
        arm = ensemble.arms[drive.first_arm + k]
        b, on = drive.first_body + drive.bodies - drive.arms + k, carrier_of(drive, arm.on)
        own, carrier = state.bodies[b], state.bodies[on]
        lever, s = world_vector(arm.lever, pose_of(carrier)), arm_mass_moment(heading_of(own), arm)
        w1, w2 = carrier.speed + lag * carrier.angular, own.speed + lag * own.angular
        led = wp.vec2d(state.rates[on][0], state.rates[on][1])
        inverse = wp.float64(ensemble.motions[b].inverse_inertia)
        return carried_arm_terms(lever, s, w1, w2, led, state.rates[b][2] / inverse), inverse

    @wp.func
    def couple(ensemble: Ensemble, state: State, drive: Drive, a: int, lag: wp.float64):
        """Accelerations of arm `a` of the drive, if it carries arms, and of these: (b), from those without it."""
        first = drive.first_body + drive.bodies - drive.arms
        rates = state.rates[first + a]
        inertia = wp.float64(1.0) / ensemble.motions[first + a].inverse_inertia
        moment = inertia * rates[2]
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == a + 1:
                terms, inverse = of_joint(ensemble, state, drive, k, lag)
                moment, inertia = eliminate_carried_arm(moment, inertia, terms, inverse)
        rates[2] = moment / inertia
        for m in range(drive.arms):
            if ensemble.arms[drive.first_arm + m].on == a + 1:
                of, over = of_joint(ensemble, state, drive, m, lag)
                turning = state.rates[first + m]
                turning[2] = carried_arm_acceleration(rates[2], of, over)
                state.rates[first + m] = turning
                state.rates[first + a] = rates

    return SimpleNamespace(**locals())
