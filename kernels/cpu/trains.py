"""Shafts, couplings, motors and valves of one variant: the moments between bodies that turn together."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.train import coupling_moment, coupling_state, coupling_twist
from ..physics.valve import add_cam, add_cam_load, add_geared_cam, cam_lift, constant_inertia_moment, zero_valve_load
from ..structs import GROUND, Cam, Drive, types
from .body_states import body_state_functions
from .loads import load_functions


@dataclass(frozen=True)
class TrainFunctions:
    """Shafts, couplings, motors and valves of one variant (`physics.train`, `physics.valve`)."""

    twist_and_moment: wp.Function
    twist_and_moment_now: wp.Function
    find_train_moments: wp.Function
    train_cam: wp.Function
    leapfrog_interval: wp.Function
    moment_without_valves: wp.Function
    train_moment: wp.Function
    valve_load_now: wp.Function


@cache
def train_functions(Real: type) -> TrainFunctions:
    """The functions of one variant's trains."""
    kinds = types(Real)
    Ensemble, State, Coupling = kinds.Ensemble, kinds.State, kinds.Coupling
    loads = load_functions(Real)
    body_states = body_state_functions(Real)

    @wp.func
    def coupled_bodies(state: State, drive: Drive, coupling: Coupling):
        """The bodies of a coupling; the first is any where it is the ground."""
        first = state.bodies[drive.first_body + wp.max(coupling.first, 0)]
        return first, state.bodies[drive.first_body + coupling.second]

    @wp.func
    def twist_and_moment(ensemble: Ensemble, state: State, drive: Drive, c: int):
        """Twist [rad] of coupling `c` of all, and the moment [N m] on its first body, opposite."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first, second = coupled_bodies(state, drive, coupling)
        twist, rate = coupling_twist(first, second, coupling, engaged)
        return twist, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def twist_and_moment_now(ensemble: Ensemble, state: State, drive: Drive, c: int, time: wp.float64, lag: wp.float64):
        """Twist [rad], rate [rad/s] and moment [N m] of coupling `c` of all with the rates of `time`."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first = body_states.body_now(ensemble, state, drive.first_body + wp.max(coupling.first, 0), time, lag)
        second = body_states.body_now(ensemble, state, drive.first_body + coupling.second, time, lag)
        twist, rate = coupling_twist(first, second, coupling, engaged)
        return twist, rate, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def update_couplings(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64):
        """Takes the states of all couplings to a step's start."""
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling = ensemble.couplings[c]
            first, second = coupled_bodies(state, drive, coupling)
            tables = ensemble.tables
            state.couplings[c] = coupling_state(time, first, second, state.couplings[c], coupling, tables)

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
    def find_train_moments(ensemble: Ensemble, state: State, drive: Drive, stage: int, time: wp.float64):
        """Sets `state.train_moments`, the moments on all bodies but arms with those of motors and couplings."""
        if stage == 0:
            update_couplings(ensemble, state, drive, time)
        for b in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
            wrench = loads.body_wrench(ensemble, state, drive, b)
            moment = wrench.moment + wrench.bearing + loads.body_load(ensemble, state, drive, state.bodies[b], b, time)
            state.train_moments[b] = moment + loads.body_motor_moment(ensemble, state, drive, b, time)
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling = ensemble.couplings[c]
            first, second = drive.first_body + coupling.first, drive.first_body + coupling.second
            twist, moment = twist_and_moment(ensemble, state, drive, c)
            if coupling.first != GROUND:
                state.train_moments[first] = state.train_moments[first] - moment
            state.train_moments[second] = state.train_moments[second] + state.couplings[c].ratio * moment
        if drive.valves > 0:
            find_valve_loads(ensemble, state, drive)

    @wp.func
    def train_cam(ensemble: Ensemble, state: State, begin: int, count: int, b: int):
        """Inertia and moment of the valves on `count` bodies from `begin` as body `b` of their train sees them."""
        cam, mine = Cam(), ensemble.motions[b]
        for other in range(begin, begin + count):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                cam = add_geared_cam(cam, state.cams[other], motion.ratio / mine.ratio)
        return cam

    @wp.func
    def leapfrog_interval(drive: Drive, time: wp.float64):
        """Step of leapfrog to the speeds of `time` [s]; 0 where speeds are those of the instant."""
        return wp.where(drive.integrator == 0 and time > wp.float64(0.0), drive.step, wp.float64(0.0))

    @wp.func
    def moment_without_valves(
        ensemble: Ensemble, state: State, drive: Drive, b: int, moment: wp.float64, time: wp.float64
    ):
        """Moment [N m] that turns body `b` of all, without valves' inertia, from that of all but valves."""
        cam = train_cam(ensemble, state, drive.first_body, drive.sprockets + drive.shafts, b)
        return constant_inertia_moment(
            moment, state.bodies[b].speed, leapfrog_interval(drive, time), cam, ensemble.motions[b]
        )

    @wp.func
    def train_moment(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """Moment [N m] that turns body `b` of all as if it turned alone (`physics.train`, (a))."""
        total = wp.float64(0.0)
        mine = ensemble.motions[b]
        for other in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                total = total + motion.ratio * state.train_moments[other]
        return total / mine.ratio

    @wp.func
    def valve_load_now(ensemble: Ensemble, state: State, drive: Drive, v: int, time: wp.float64, lag: wp.float64):
        """Torque [N m] of group `v` of all valves against rotation, and the least force [N] on a follower."""
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

    return TrainFunctions(
        twist_and_moment=twist_and_moment,
        twist_and_moment_now=twist_and_moment_now,
        find_train_moments=find_train_moments,
        train_cam=train_cam,
        leapfrog_interval=leapfrog_interval,
        moment_without_valves=moment_without_valves,
        train_moment=train_moment,
        valve_load_now=valve_load_now,
    )
