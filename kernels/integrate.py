"""Integrators' kicks, stages and weights, for rollers and bodies.

Leapfrog: v(n + 1/2) = v(n - 1/2) + h a(n), x(n + 1) = x(n) + h v(n + 1/2), the first kick half a step. At step n,
v(n) = v(n - 1/2) + h a(n) / 2 is observed. Explicit Runge-Kutta schemes are rows of `SCHEMES`.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from .number import Pair, add, mul  # noqa: F401
from .precision import at_float32


@dataclass(frozen=True)
class Scheme:
    """Explicit Runge-Kutta scheme: stage k is evaluated a_k h along the slopes of stage k - 1.

    Attributes:
        weights: b_k of stages' slopes, as numerator and denominator.
        reaches: a_k from the second stage on, likewise.
    """

    weights: tuple[tuple[int, int], ...]
    reaches: tuple[tuple[int, int], ...]


SCHEMES = {"rk4": Scheme(weights=((1, 6), (1, 3), (1, 3), (1, 6)), reaches=((1, 2), (1, 2), (1, 1)))}
"""Runge-Kutta schemes by their names in drive files."""

INTEGRATORS = {name: number for number, name in enumerate(("leapfrog", *SCHEMES))}
"""Numbers of the integrators by name, as in `structs.Drive.integrator`."""

MOST_STAGES = max(len(scheme.weights) for scheme in SCHEMES.values())
STAGE_COUNTS = wp.constant(
    wp.types.vector(len(INTEGRATORS), wp.int32)(1, *(len(of.weights) for of in SCHEMES.values()))
)


def _fraction_table(rows: Any, part: int, otherwise: int) -> Any:
    """Table (integrator, stage) of numerators or denominators; `otherwise` for leapfrog."""
    full = [[0] * MOST_STAGES, *([row[part] for row in of] + [otherwise] * (MOST_STAGES - len(of)) for of in rows)]
    return wp.constant(wp.types.matrix((len(full), MOST_STAGES), wp.int32)(full))


WEIGHT, WEIGHT_OVER = (_fraction_table([of.weights for of in SCHEMES.values()], part, 1) for part in (0, 1))
REACH, REACH_OVER = (_fraction_table([of.reaches for of in SCHEMES.values()], part, 1) for part in (0, 1))


@wp.func
def leapfrog_kick(step: int, h: Any):
    """Time [s] over which leapfrog accelerates velocities: half a step at first."""
    return wp.where(step == 0, type(h)(0.5) * h, h)


@wp.func
def leapfrog_lag(step: int, h: Any):
    """Time [s] from leapfrog's velocities to the positions of `step`."""
    return wp.where(step == 0, type(h)(0.0), type(h)(0.5) * h)


@wp.func
def stage_count(integrator: int):
    """Number of an integrator's force evaluations in a step."""
    return STAGE_COUNTS[integrator]


@wp.func
def stage_weight(integrator: int, stage: int, h: Any):
    """Weight b_k h [s] of a Runge-Kutta stage's slopes."""
    return h * type(h)(WEIGHT[integrator, stage]) / type(h)(WEIGHT_OVER[integrator, stage])


@wp.func
def stage_reach(integrator: int, stage: int, h: Any):
    """Time [s] from the step's start to the stage after `stage`."""
    if stage == stage_count(integrator) - 1:
        return h
    return h * type(h)(REACH[integrator, stage]) / type(h)(REACH_OVER[integrator, stage])


@wp.func
def stage_instant(integrator: int, stage: int, h: Any):
    """Time [s] from the step's start to `stage`."""
    if stage == 0:
        return type(h)(0.0)
    return stage_reach(integrator, stage - 1, h)


@wp.func
def stretched_part(integrator: int, stage: int, one: Any):
    """Part of a step that stretches bristles at an integrator's `stage`."""
    if stage == 0:
        return one
    return stage_instant(integrator, stage, one)


@wp.struct
class Stage:
    """One Runge-Kutta stage, or leapfrog's only one."""

    number: wp.int32  # from 0
    last: wp.int32  # 1: it ends the step
    weight: wp.float64  # [s]
    reach: wp.float64  # [s]
    time: wp.float64  # its instant [s]
    after: wp.float64  # the next one's [s]


BlockStage = at_float32(Stage, {}, pairs=("time", "after"))


@wp.func
def stage_at(integrator: int, number: int, step_time: wp.float64, h: wp.float64):
    """Integrator's `Stage` of the step that begins at `step_time` [s], in float64."""
    stage = Stage()
    stage.number = number
    stage.last = wp.where(number == stage_count(integrator) - 1, 1, 0)
    stage.weight = stage_weight(integrator, number, h)
    stage.reach = stage_reach(integrator, number, h)
    stage.time = step_time + stage_instant(integrator, number, h)
    stage.after = step_time + stage.reach
    return stage


@wp.func
def stage_at(integrator: int, number: int, step_time: Pair, h: Pair):
    """Integrator's `Stage` of the step that begins at `step_time` [s], in pairs."""
    stage = BlockStage()
    stage.number = number
    stage.last = wp.where(number == stage_count(integrator) - 1, 1, 0)
    stage.weight = stage_weight(integrator, number, h.high)
    stage.reach = stage_reach(integrator, number, h.high)
    stage.time = step_time + stage_instant(integrator, number, float(1.0)) * h
    stage.after = step_time + stage_reach(integrator, number, float(1.0)) * h
    return stage
