"""The rows of one variant's rollers that a block's threads share: read, moved, taken in and put back."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import stage_reach, stage_weight, stages_of, stretching
from ..native import STATE_ROWS, moved, multiply_add, row_access
from ..number import pair_vector
from ..physics.link import compensated_sum, roller_acceleration
from .kind import BlockKind, Mine
from .rings import block_rings
from .shared_memory import room


@cache
def roller_rows(kind: BlockKind) -> SimpleNamespace:
    """The rows of a block and what is done on them."""
    Real, threads, slots = kind.Real, kind.shape.threads, kind.shape.slots
    kinds = kind.types
    State, Shared = kinds.State, kinds.Shared
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    parts = room(kind).parts
    load_row, store_row = row_access(Real).load, row_access(Real).store
    chain_at, span_of = block_rings(kind).chain_at, block_rings(kind).span_of
    X, Y, VX, VY, FORCE_X, FORCE_Y, X_LOW, Y_LOW = (wp.constant(k * slots) for k in range(8))

    @wp.func
    def position(rows: wp.array[Real], j: int):
        """Position of roller j [m]."""
        return vec2(load_row(rows, X + j), load_row(rows, Y + j))

    @wp.func
    def point(rows: wp.array[Real], j: int):
        """Position of roller j [m], at float32 a vector of pairs."""
        high = position(rows, j)
        if wp.static(compensated):
            return pair_vector(high, vec2(load_row(rows, X_LOW + j), load_row(rows, Y_LOW + j)))
        else:
            return high

    @wp.func
    def step_of(mine: Mine):
        """The time step at the kernel's precision [s]."""
        if wp.static(compensated):
            return mine.step.high
        else:
            return mine.h

    @wp.func
    def stretched(now: kinds.Now):
        """Part of a step over which friction's bristles are stretched now (`integrate.stretching`)."""
        if wp.static(kind.staged):
            return stretching(wp.static(kind.integrator), now.stage, Real(1.0))
        else:
            return Real(1.0)

    @wp.func
    def velocity(rows: wp.array[Real], j: int):
        """Velocity of roller j [m/s]."""
        return vec2(load_row(rows, VX + j), load_row(rows, VY + j))

    @wp.func
    def force_on(shared: Shared, j: int):
        """The force on roller j [N], as far as it is added up."""
        return vec2(load_row(shared.rows, FORCE_X + j), load_row(shared.rows, FORCE_Y + j))

    @wp.func
    def set_force(shared: Shared, j: int, force: vec2):
        """Roller j's force [N]: of the link after it, then of both its links, then of its contacts too."""
        store_row(shared.rows, FORCE_X + j, force[0])
        store_row(shared.rows, FORCE_Y + j, force[1])

    @wp.func
    def acceleration(shared: Shared, j: int):
        """Acceleration of roller j [m/s^2], from its force and gravity."""
        chain = chain_at(shared, j)
        return roller_acceleration(force_on(shared, j), chain.inverse_mass, chain.gravity)

    @wp.func
    def set_velocity(shared: Shared, j: int, v: vec2):
        """Roller j's velocity."""
        store_row(shared.rows, VX + j, v[0])
        store_row(shared.rows, VY + j, v[1])

    @wp.func
    def move(shared: Shared, j: int, h: Real, v: vec2):
        """Roller j over a time `h` [s] at `v` [m/s]; what float32 rounds off goes to the low parts."""
        rows = shared.rows
        x = load_row(rows, X + j)
        y = load_row(rows, Y + j)
        if wp.static(compensated):
            new_x, low_x = compensated_sum(x, load_row(rows, X_LOW + j), h * v[0])
            new_y, low_y = compensated_sum(y, load_row(rows, Y_LOW + j), h * v[1])
            store_row(rows, X + j, new_x)
            store_row(rows, Y + j, new_y)
            store_row(rows, X_LOW + j, low_x)
            store_row(rows, Y_LOW + j, low_y)
        else:
            store_row(rows, X + j, multiply_add(h, v[0], x))
            store_row(rows, Y + j, multiply_add(h, v[1], y))

    @wp.func
    def fetch(state: State, shared: Shared, mine: Mine):
        """The thread's rollers into the shared rows; its parts begin at zero."""
        j = int(mine.thread)
        while j < wp.static(slots):
            first, n = span_of(shared, j, mine.rollers)
            row = STATE_ROWS * (mine.first + first) + wp.min(j - first, n - 1)
            store_row(shared.rows, X + j, state.rollers[row])
            store_row(shared.rows, Y + j, state.rollers[row + n])
            store_row(shared.rows, VX + j, state.rollers[row + 2 * n])
            store_row(shared.rows, VY + j, state.rollers[row + 3 * n])
            if wp.static(compensated):
                store_row(shared.rows, X_LOW + j, state.rollers[row + 4 * n])
                store_row(shared.rows, Y_LOW + j, state.rollers[row + 5 * n])
            set_force(shared, j, vec2())
            j = j + wp.static(threads)
        at = int(mine.thread)
        while at < wp.static(parts):
            shared.parts[at] = Real(0.0)
            at = at + wp.static(threads)

    @wp.func
    def put_back(state: State, shared: Shared, mine: Mine):
        """The thread's rollers back into the state."""
        j = int(mine.thread)
        while j < mine.rollers:
            first, n = span_of(shared, j, mine.rollers)
            row = STATE_ROWS * (mine.first + first) + j - first
            state.rollers[row] = load_row(shared.rows, X + j)
            state.rollers[row + n] = load_row(shared.rows, Y + j)
            state.rollers[row + 2 * n] = load_row(shared.rows, VX + j)
            state.rollers[row + 3 * n] = load_row(shared.rows, VY + j)
            if wp.static(compensated):
                state.rollers[row + 4 * n] = load_row(shared.rows, X_LOW + j)
                state.rollers[row + 5 * n] = load_row(shared.rows, Y_LOW + j)
            j = j + wp.static(threads)

    return SimpleNamespace(**locals())


STAGE_ROWS = 10
"""What stages keep of each roller in global memory: x, y, vx, vy and low parts of x, y at the step's start, sums."""


@cache
def block_stages(kind: BlockKind) -> wp.Function:
    """The function that takes a roller from stage to stage."""
    Real = kind.Real
    kinds, Now = kind.types, kind.types.Now
    vec2 = kinds.vec2
    row = roller_rows(kind)
    acceleration, velocity, set_velocity, move = row.acceleration, row.velocity, row.set_velocity, row.move
    step_of = row.step_of
    load_row, store_row = row_access(Real).load, row_access(Real).store
    slots, kept_rows = kind.shape.slots, 6 if Real == wp.float32 else 4

    @wp.func
    def stage_roller(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, j: int):
        """Roller j, evaluated, to where the next stage evaluates it; the last ends the step."""
        weight = stage_weight(wp.static(kind.integrator), now.stage, step_of(mine))
        reach = stage_reach(wp.static(kind.integrator), now.stage, step_of(mine))
        n = mine.rollers
        rows = shared.rows
        kept = state.stages
        at = wp.static(STAGE_ROWS) * mine.first + j
        v = velocity(rows, j)
        a = acceleration(shared, j)
        if now.stage == 0:
            for k in range(wp.static(kept_rows)):
                store_row(kept, at + k * n, load_row(rows, wp.static(slots) * (k + 2 * (k // 4)) + j))
            for k in range(6, 10):
                store_row(kept, at + k * n, Real(0.0))
        store_row(kept, at + 6 * n, load_row(kept, at + 6 * n) + weight * v[0])
        store_row(kept, at + 7 * n, load_row(kept, at + 7 * n) + weight * v[1])
        store_row(kept, at + 8 * n, load_row(kept, at + 8 * n) + weight * a[0])
        store_row(kept, at + 9 * n, load_row(kept, at + 9 * n) + weight * a[1])
        for k in range(wp.static(kept_rows)):
            store_row(rows, wp.static(slots) * (k + 2 * (k // 4)) + j, load_row(kept, at + k * n))
        start = velocity(rows, j)
        if now.stage == stages_of(wp.static(kind.integrator)) - 1:
            set_velocity(shared, j, start + vec2(load_row(kept, at + 8 * n), load_row(kept, at + 9 * n)))
            move(shared, j, Real(1.0), vec2(load_row(kept, at + 6 * n), load_row(kept, at + 7 * n)))
        else:
            set_velocity(shared, j, moved(start, reach, a))
            move(shared, j, reach, v)

    return stage_roller
