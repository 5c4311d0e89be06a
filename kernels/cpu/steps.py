"""Steps of one variant on the CPU by each integrator, rollers and bodies."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import Stage
from ..native import row_access
from ..structs import Drive, types
from . import bodies
from .neighbor_list import neighbor_list_functions
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class StepFunctions:
    """CPU step functions."""

    take_leapfrog_step: wp.Function
    take_stage: wp.Function


@cache
def step_functions(Real: type, capacity: int) -> StepFunctions:
    """CPU step functions."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    rollers = roller_functions(Real, capacity)
    access = row_access(Real)
    neighbor_list = neighbor_list_functions(Real, capacity)
    row = rows(capacity)

    @wp.func
    def take_leapfrog_step(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        chain: Chain,
        w: wp.array[Real],
        time: wp.float64,
        kick: wp.float64,
    ):
        """Moves a variant on the CPU by a leapfrog step from evaluated forces; `kick` is h, at first h / 2."""
        bodies.take_leapfrog_step(ensemble, state, drive, time, kick)
        rollers.kick_and_drift(w, drive.rollers, chain, Real(kick), Real(drive.step))
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            if ensemble.mounts[b].active != 0 or ensemble.mounts[b].moves != 0:
                neighbor_list.invalidate_if_fast(w, state.bodies[b].velocity)

    @wp.func
    def stage_rollers(w: wp.array[Real], n: int, chain: Chain, at: Stage):
        """Adds a stage's slopes to sums in CPU rows, and moves rollers along them, at last along the sums."""
        weight = Real(at.weight)
        reach = Real(at.reach)
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            a = rollers.acceleration(w, i, inverse_mass, chain.gravity)
            vx = access.load(w, row.vx + i)
            vy = access.load(w, row.vy + i)
            if at.number == 0:
                for k in range(6):
                    access.store(
                        w, row.x0 + k * wp.static(capacity) + i, access.load(w, row.x + k * wp.static(capacity) + i)
                    )
                for k in range(4):
                    access.store(w, row.sum_x + k * wp.static(capacity) + i, Real(0.0))
            access.store(w, row.sum_x + i, access.load(w, row.sum_x + i) + weight * vx)
            access.store(w, row.sum_y + i, access.load(w, row.sum_y + i) + weight * vy)
            access.store(w, row.sum_vx + i, access.load(w, row.sum_vx + i) + weight * a[0])
            access.store(w, row.sum_vy + i, access.load(w, row.sum_vy + i) + weight * a[1])
            for k in range(6):
                access.store(
                    w, row.x + k * wp.static(capacity) + i, access.load(w, row.x0 + k * wp.static(capacity) + i)
                )
            if at.last == 1:
                rollers.move(w, i, access.load(w, row.sum_x + i), access.load(w, row.sum_y + i))
                access.store(w, row.vx + i, access.load(w, row.vx + i) + access.load(w, row.sum_vx + i))
                access.store(w, row.vy + i, access.load(w, row.vy + i) + access.load(w, row.sum_vy + i))
            else:
                rollers.move(w, i, reach * vx, reach * vy)
                access.store(w, row.vx + i, access.load(w, row.vx + i) + reach * a[0])
                access.store(w, row.vy + i, access.load(w, row.vy + i) + reach * a[1])
            i = i + 1

    @wp.func
    def take_stage(ensemble: Ensemble, state: State, drive: Drive, chain: Chain, w: wp.array[Real], at: Stage):
        """Moves a variant on the CPU by a stage from evaluated forces; the last stage ends the step."""
        bodies.take_stage(ensemble, state, drive, at)
        stage_rollers(w, drive.rollers, chain, at)

    return StepFunctions(take_leapfrog_step=take_leapfrog_step, take_stage=take_stage)
