"""The classical Runge-Kutta scheme for rollers on blocks of threads: what the four stages of a step keep of each."""

from functools import cache

import warp as wp

from ..integrate import rk4_reach, rk4_weight
from ..rows import accessors
from ..structs import types
from .kind import BlockKind, Mine, now_struct
from .roller_rows import roller_rows

STAGE_ROWS = 10
"""What stages keep of each roller in global memory: x, y, vx, vy and low parts of x, y at the step's start, sums."""


@cache
def block_rk4(kind: BlockKind) -> wp.Function:
    """The function that takes a roller from stage to stage."""
    Real = kind.Real
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    row = roller_rows(kind)
    X, Y, X_LOW, Y_LOW = row.X, row.Y, row.X_LOW, row.Y_LOW
    acceleration, velocity, set_velocity, move = row.acceleration, row.velocity, row.set_velocity, row.move
    step_of = row.step_of
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    compensated = Real == wp.float32

    @wp.func
    def stage_roller(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, j: int):
        """Roller j, evaluated, to where the next stage evaluates it; the fourth ends the step."""
        weight = rk4_weight(now.stage, step_of(mine))
        reach = rk4_reach(now.stage, step_of(mine))
        n = mine.rollers
        rows = shared.rows
        kept = state.stages
        at = wp.static(STAGE_ROWS) * mine.first + j
        v = velocity(rows, j)
        a = acceleration(shared, j)
        if now.stage == 0:
            store_row(kept, at, load_row(rows, X + j))
            store_row(kept, at + n, load_row(rows, Y + j))
            store_row(kept, at + 2 * n, v[0])
            store_row(kept, at + 3 * n, v[1])
            if wp.static(compensated):
                store_row(kept, at + 4 * n, load_row(rows, X_LOW + j))
                store_row(kept, at + 5 * n, load_row(rows, Y_LOW + j))
            for k in range(6, 10):
                store_row(kept, at + k * n, Real(0.0))
        store_row(kept, at + 6 * n, load_row(kept, at + 6 * n) + weight * v[0])
        store_row(kept, at + 7 * n, load_row(kept, at + 7 * n) + weight * v[1])
        store_row(kept, at + 8 * n, load_row(kept, at + 8 * n) + weight * a[0])
        store_row(kept, at + 9 * n, load_row(kept, at + 9 * n) + weight * a[1])
        store_row(rows, X + j, load_row(kept, at))
        store_row(rows, Y + j, load_row(kept, at + n))
        if wp.static(compensated):
            store_row(rows, X_LOW + j, load_row(kept, at + 4 * n))
            store_row(rows, Y_LOW + j, load_row(kept, at + 5 * n))
        start = vec2(load_row(kept, at + 2 * n), load_row(kept, at + 3 * n))
        if now.stage == 3:
            set_velocity(shared, j, start + vec2(load_row(kept, at + 8 * n), load_row(kept, at + 9 * n)))
            move(shared, j, load_row(kept, at + 6 * n), load_row(kept, at + 7 * n))
        else:
            set_velocity(shared, j, start + reach * a)
            move(shared, j, reach * v[0], reach * v[1])

    return stage_roller
