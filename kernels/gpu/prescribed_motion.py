"""Prescribed angles and speeds of a block's bodies, for some steps ahead, and instants of steps."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..number import exact_multiple, leading_value
from ..physics.motion import prescribed_rotation
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .shared_memory import PLANNED_STEPS
from .sync import warp_lanes


@wp.func
def plan_index(course: int, step: int):
    """Index of a block's body's prescribed angle and speed at `step`, by its `prescribed_index`."""
    return course * PLANNED_STEPS + step % PLANNED_STEPS


@dataclass(frozen=True)
class PrescribedMotionFunctions:
    """Prescribed motion functions of a block."""

    is_prescribed: wp.Function
    prescribed_index: wp.Function
    angle_and_speed: wp.Function
    exact_time_step: wp.Function
    step_time: wp.Function
    rounded_step_time: wp.Function
    plan_steps: wp.Function


@cache
def prescribed_motion_functions(kind: BlockKind) -> PrescribedMotionFunctions:
    """Prescribed motion functions of block kernels."""
    threads, rotors = kind.shape.threads, kind.parts.rotors
    Real, kinds, Now = kind.Real, kind.types, kind.types.Now
    Ensemble, Shared = kinds.Ensemble, kinds.Shared

    @wp.func
    def is_prescribed(shared: Shared, b: int):
        """Whether the angle of a block's body b is prescribed."""
        return shared.motions[b].prescribed == 1

    @wp.func
    def prescribed_index(shared: Shared, b: int):
        """Index of a block's body b among those of prescribed angle; a valid one for any other body."""
        place = int(0)
        for other in range(rotors):
            if other < b and is_prescribed(shared, other):
                place = place + 1
        return wp.min(place, wp.static(kind.parts.prescribed - 1))

    @wp.func
    def angle_and_speed(ensemble: Ensemble, shared: Shared, mine: ThreadParts, b: int, step: int):
        """Prescribed angle [rad] and speed [rad/s] of a block's body b at a step."""
        motion = shared.motions[b]
        if wp.static(not kind.parts.tabulated):
            motion.drive_table.cells = 0  # so that the compiler knows
        return prescribed_rotation(exact_multiple(step, exact_time_step(mine)), motion, ensemble)

    @wp.func
    def exact_time_step(mine: ThreadParts):
        """Time step [s] of a block's thread, a pair at float32."""
        if wp.static(kind.is_paired):
            return mine.step_pair
        else:
            return mine.step

    @wp.func
    def step_time(mine: ThreadParts, now: Now):
        """Time [s] of a block's step, exact."""
        return exact_multiple(now.step, exact_time_step(mine))

    @wp.func
    def rounded_step_time(mine: ThreadParts, now: Now):
        """Time [s] of a block's step, rounded."""
        return Real(now.step) * leading_value(exact_time_step(mine))

    @wp.func
    def plan_steps(ensemble: Ensemble, shared: Shared, mine: ThreadParts, step: int):
        """Shares prescribed angles and speeds of the next `PLANNED_STEPS` steps, a step a thread."""
        i = mine.thread
        b = i // warp_lanes()
        while b < rotors:
            if is_prescribed(shared, b):
                ahead = 1 + i % warp_lanes()
                while ahead <= PLANNED_STEPS:
                    at = plan_index(prescribed_index(shared, b), step + ahead)
                    angle, speed = angle_and_speed(ensemble, shared, mine, b, step + ahead)
                    shared.prescribed_angles[at] = angle
                    shared.prescribed_speeds[at] = speed
                    ahead = ahead + warp_lanes()
            b = b + threads // warp_lanes()

    return PrescribedMotionFunctions(
        is_prescribed=is_prescribed,
        prescribed_index=prescribed_index,
        angle_and_speed=angle_and_speed,
        exact_time_step=exact_time_step,
        step_time=step_time,
        rounded_step_time=rounded_step_time,
        plan_steps=plan_steps,
    )
