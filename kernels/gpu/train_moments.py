"""Moments that turn the bodies of trains on a block, from those that each has shared."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..bodies.train_moments import train_cam, train_moment
from ..integrate import leapfrog_lag
from ..number import exact_multiple, leading_value
from ..physics.motion import prescribed_acceleration
from ..physics.valve import constant_inertia_moment
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .prescribed_motion import prescribed_motion_functions


@dataclass(frozen=True)
class TrainMomentFunctions:
    """Train moment functions of a block (`physics.train`)."""

    moment_on_body: wp.Function
    speed_and_acceleration_now: wp.Function


@cache
def train_moment_functions(kind: BlockKind) -> TrainMomentFunctions:
    """Train moment functions of block kernels."""
    Real, rotors, kinds = kind.Real, kind.parts.rotors, kind.types
    Ensemble, Shared, Now = kinds.Ensemble, kinds.Shared, kinds.Now
    prescribed_motion = prescribed_motion_functions(kind)

    @wp.func
    def moment_on_body(shared: Shared, mine: ThreadParts, now: Now, b: int):
        """Moment [N m] that turns body b of a block's train as if it turned alone, without valves' inertia."""
        moment = train_moment(shared.motions, shared.train_moments, 0, rotors, b)
        if wp.static(kind.parts.valves):
            kick, cam = Real(0.0), train_cam(shared.motions, shared.cams, 0, rotors, b)
            if wp.static(not kind.has_stages):
                kick = Real(2.0) * leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
            moment = constant_inertia_moment(moment, leading_value(shared.poses[b].speed), kick, cam, shared.motions[b])
        return moment

    @wp.func
    def speed_and_acceleration_now(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, b: int):
        """Angular velocity [rad/s] and acceleration [rad/s^2] of a block's train's body b at the step's instant."""
        pose, motion = shared.poses[b], shared.motions[b]
        speed, angular = leading_value(pose.speed), moment_on_body(shared, mine, now, b) * motion.inverse_inertia
        if wp.static(not kind.has_stages):
            lag = leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
            speed = wp.where(motion.prescribed == 1, pose.exact_speed, speed + lag * angular)
        if motion.prescribed == 1:
            angular = prescribed_acceleration(
                exact_multiple(now.step, prescribed_motion.exact_time_step(mine)), motion, ensemble
            )
        return speed, angular

    return TrainMomentFunctions(
        moment_on_body=moment_on_body,
        speed_and_acceleration_now=speed_and_acceleration_now,
    )
