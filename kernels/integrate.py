r"""The two integrators' numbers, for whatever is moved: rollers and bodies, on the CPU and on the GPU.

Leapfrog: v(n + 1/2) = v(n - 1/2) + h a(n), x(n + 1) = x(n) + h v(n + 1/2), the first kick being half a step; damping
reads v(n - 1/2). What is observed at step n takes v(n) = v(n - 1/2) + h a(n) / 2.

rk4 is the classical scheme of four stages k: slopes at the step's start, twice at its middle, at its end; their sum is
weighted 1/6, 1/3, 1/3, 1/6. Contacts keep their memory from step starts (stage 0) only.
"""

from typing import Any

import warp as wp


@wp.func
def leapfrog_kick(step: int, h: Any):
    """Time over which the velocities of `step` are accelerated [s]."""
    return wp.where(step == 0, type(h)(0.5) * h, h)


@wp.func
def leapfrog_lag(step: int, h: Any):
    """How far behind the positions the velocities of `step` are [s]."""
    return wp.where(step == 0, type(h)(0.0), type(h)(0.5) * h)


@wp.func
def rk4_weight(stage: int, h: Any):
    """Weight of a stage in the sum of slopes [s]."""
    return wp.where(stage == 1 or stage == 2, h / type(h)(3.0), h / type(h)(6.0))


@wp.func
def rk4_reach(stage: int, h: Any):
    """How far from the step's start the next stage is [s]."""
    return wp.where(stage < 2, type(h)(0.5) * h, h)


@wp.func
def rk4_instant(stage: int, h: Any):
    """How far from the step's start a stage is [s]."""
    return wp.where(stage == 0, type(h)(0.0), wp.where(stage == 3, h, type(h)(0.5) * h))


@wp.struct
class Rk4Stage:
    """One of rk4's stages."""

    number: wp.int32  # 0 to 3; the fourth ends the step
    weight: wp.float64  # [s]
    reach: wp.float64  # [s]
    time: wp.float64  # its instant [s]
    after: wp.float64  # the next one's [s]


@wp.func
def rk4_stage(number: int, step_time: wp.float64, h: wp.float64):
    """Stage `number` of the step that begins at `step_time`."""
    stage = Rk4Stage()
    stage.number = number
    stage.weight = rk4_weight(number, h)
    stage.reach = rk4_reach(number, h)
    stage.time = step_time + rk4_instant(number, h)
    stage.after = step_time + stage.reach
    return stage
