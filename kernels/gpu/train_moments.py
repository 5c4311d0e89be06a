"""Moments that turn the bodies of trains on a block, from those that each has shared."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import leapfrog_lag
from ..native import quotient
from ..number import exact_multiple, leading_value
from ..physics.motion import prescribed_acceleration
from ..physics.valve import add_geared_cam, constant_inertia_moment
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .prescribed_motion import prescribed_motion_functions


@dataclass(frozen=True)
class TrainMomentFunctions:
    """Train moment functions of a block (`physics.train`)."""

    train_moment: wp.Function
    speed_and_acceleration_now: wp.Function


@cache
def train_moment_functions(kind: BlockKind) -> TrainMomentFunctions:
    """Train moment functions of block kernels."""
    Real, rotors, kinds = kind.Real, kind.parts.rotors, kind.types
    Ensemble, Shared, Now = kinds.Ensemble, kinds.Shared, kinds.Now
    prescribed_motion = prescribed_motion_functions(kind)

    @wp.func
    def moment_without_valves(shared: Shared, mine: ThreadParts, now: Now, b: int, moment: Real):
        """Moment [N m] that turns a block's body b, without valves' inertia, from that of all but valves."""
        cam, kick, own = kinds.Cam(), Real(0.0), shared.motions[b]
        for other in range(rotors):
            motion = shared.motions[other]
            if motion.train == own.train:
                cam = add_geared_cam(cam, shared.cams[other], quotient(motion.ratio, own.ratio))
        if wp.static(not kind.has_stages):
            kick = Real(2.0) * leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
        return constant_inertia_moment(moment, leading_value(shared.poses[b].speed), kick, cam, own)

    @wp.func
    def train_moment(shared: Shared, mine: ThreadParts, now: Now, b: int):
        """Moment [N m] that turns body b of a block's train as if it turned alone (`physics.train`)."""
        own, total = shared.motions[b], Real(0.0)
        for other in range(rotors):
            motion = shared.motions[other]
            if motion.train == own.train:
                total = total + motion.ratio * shared.train_moments[other]
        moment = quotient(total, own.ratio)
        if wp.static(kind.parts.valves):
            moment = moment_without_valves(shared, mine, now, b, moment)
        return moment

    @wp.func
    def speed_and_acceleration_now(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, b: int):
        """Angular velocity [rad/s] and acceleration [rad/s^2] of a block's train's body b at the step's instant."""
        pose, motion = shared.poses[b], shared.motions[b]
        speed, angular = leading_value(pose.speed), train_moment(shared, mine, now, b) * motion.inverse_inertia
        if wp.static(not kind.has_stages):
            lag = leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
            speed = wp.where(motion.prescribed == 1, pose.exact_speed, speed + lag * angular)
        if motion.prescribed == 1:
            angular = prescribed_acceleration(
                exact_multiple(now.step, prescribed_motion.exact_time_step(mine)), motion, ensemble
            )
        return speed, angular

    return TrainMomentFunctions(
        train_moment=train_moment,
        speed_and_acceleration_now=speed_and_acceleration_now,
    )
