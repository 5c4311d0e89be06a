"""Moments that turn the bodies of trains on the CPU (`physics.train`, `physics.valve`)."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.valve import add_geared_cam, constant_inertia_moment
from ..structs import Cam, Drive, types


@dataclass(frozen=True)
class TrainMomentFunctions:
    """CPU train moment functions."""

    train_cam: wp.Function
    leapfrog_interval: wp.Function
    moment_without_valves: wp.Function
    train_moment: wp.Function


@cache
def train_moment_functions(Real: type) -> TrainMomentFunctions:
    """CPU train moment functions."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def train_cam(ensemble: Ensemble, state: State, begin: int, count: int, b: int):
        """Inertia and moment, on body `b`, of its train's valves among `count` bodies from `begin`."""
        cam, mine = Cam(), ensemble.motions[b]
        for other in range(begin, begin + count):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                cam = add_geared_cam(cam, state.cams[other], motion.ratio / mine.ratio)
        return cam

    @wp.func
    def leapfrog_interval(drive: Drive, time: wp.float64):
        """Leapfrog's step [s] to the speeds of `time` [s]; 0 where speeds are the instant's."""
        return wp.where(drive.integrator == 0 and time > wp.float64(0.0), drive.step, wp.float64(0.0))

    @wp.func
    def moment_without_valves(
        ensemble: Ensemble, state: State, drive: Drive, b: int, moment: wp.float64, time: wp.float64
    ):
        """Moment [N m] that turns body `b` of all on the CPU, without valves' inertia, from that of all but valves."""
        cam = train_cam(ensemble, state, drive.first_body, drive.sprockets + drive.shafts, b)
        return constant_inertia_moment(
            moment, state.bodies[b].speed, leapfrog_interval(drive, time), cam, ensemble.motions[b]
        )

    @wp.func
    def train_moment(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """Moment [N m] that turns body `b` of all, on the CPU, as if alone (`physics.train`, (a))."""
        total = wp.float64(0.0)
        mine = ensemble.motions[b]
        for other in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                total = total + motion.ratio * state.train_moments[other]
        return total / mine.ratio

    return TrainMomentFunctions(
        train_cam=train_cam,
        leapfrog_interval=leapfrog_interval,
        moment_without_valves=moment_without_valves,
        train_moment=train_moment,
    )
