"""Shared rows of a block's rollers: read, moved, fetched and put back."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import stage_count, stage_reach, stage_weight, stretched_part
from ..native import STATE_ROWS, multiply_add, row_access, sum_with_multiple
from ..number import pair_vector
from ..physics.link import compensated_sum, roller_acceleration
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .shared_memory import block_memory, mass_rows, roller_rows


@dataclass(frozen=True)
class RollerFunctions:
    """Roller functions of a block."""

    position: wp.Function
    exact_position: wp.Function
    time_step: wp.Function
    stretch_part: wp.Function
    velocity: wp.Function
    force: wp.Function
    set_force: wp.Function
    acceleration: wp.Function
    set_velocity: wp.Function
    move: wp.Function
    fetch: wp.Function
    put_back: wp.Function


@cache
def roller_functions(kind: BlockKind) -> RollerFunctions:
    """Roller functions of block kernels."""
    Real, threads, slots, integrator = kind.Real, kind.shape.threads, kind.shape.slots, kind.integrator
    kinds = kind.types
    State, Shared = kinds.State, kinds.Shared
    vec2 = kinds.vec2
    parts = block_memory(kind).wrench_parts
    access = row_access(Real)
    chains = chain_functions(kind)
    row = roller_rows(kind)

    @wp.func
    def position(rows: wp.array[Real], j: int):
        """Position [m] of roller j from a block's rows."""
        return vec2(access.load(rows, row.x + j), access.load(rows, row.y + j))

    @wp.func
    def exact_position(rows: wp.array[Real], j: int):
        """Position [m] of roller j from a block's rows, a vector of pairs at float32."""
        high = position(rows, j)
        if wp.static(kind.is_paired):
            return pair_vector(high, vec2(access.load(rows, row.x_low + j), access.load(rows, row.y_low + j)))
        else:
            return high

    @wp.func
    def time_step(mine: ThreadParts):
        """Time step [s] at the block kernel's precision."""
        if wp.static(kind.is_paired):
            return mine.step_pair.high
        else:
            return mine.step

    @wp.func
    def stretch_part(now: kinds.Now):
        """Part of a block's step that stretches friction's bristles at this stage (`integrate.stretched_part`)."""
        if wp.static(kind.has_stages):
            return stretched_part(integrator, now.stage, Real(1.0))
        else:
            return Real(1.0)

    @wp.func
    def velocity(rows: wp.array[Real], j: int):
        """Velocity [m/s] of roller j from a block's rows."""
        return vec2(access.load(rows, row.vx + j), access.load(rows, row.vy + j))

    @wp.func
    def force(shared: Shared, j: int):
        """Force [N] on roller j, as far as added up in a block's rows."""
        return vec2(access.load(shared.rows, row.force_x + j), access.load(shared.rows, row.force_y + j))

    @wp.func
    def set_force(shared: Shared, j: int, force: vec2):
        """Sets the force [N] on roller j in a block's rows."""
        access.store(shared.rows, row.force_x + j, force[0])
        access.store(shared.rows, row.force_y + j, force[1])

    @wp.func
    def acceleration(shared: Shared, j: int):
        """Acceleration [m/s^2] of roller j by its force in a block's rows and gravity."""
        chain = chains.chain_at(shared, j)
        return roller_acceleration(force(shared, j), chain.inverse_mass, chain.gravity)

    @wp.func
    def set_velocity(shared: Shared, j: int, v: vec2):
        """Sets the velocity [m/s] of roller j in a block's rows."""
        access.store(shared.rows, row.vx + j, v[0])
        access.store(shared.rows, row.vy + j, v[1])

    @wp.func
    def move(shared: Shared, j: int, h: Real, v: vec2):
        """Moves roller j in a block's rows over a time `h` [s] at `v` [m/s], float32's rounding kept in low parts."""
        rows = shared.rows
        x = access.load(rows, row.x + j)
        y = access.load(rows, row.y + j)
        if wp.static(kind.is_paired):
            new_x, low_x = compensated_sum(x, access.load(rows, row.x_low + j), h * v[0])
            new_y, low_y = compensated_sum(y, access.load(rows, row.y_low + j), h * v[1])
            access.store(rows, row.x + j, new_x)
            access.store(rows, row.y + j, new_y)
            access.store(rows, row.x_low + j, low_x)
            access.store(rows, row.y_low + j, low_y)
        else:
            access.store(rows, row.x + j, multiply_add(h, v[0], x))
            access.store(rows, row.y + j, multiply_add(h, v[1], y))

    @wp.func
    def fetch(state: State, shared: Shared, mine: ThreadParts):
        """Fetches the thread's rollers from the state into the block's rows, and clears its wrench parts."""
        j = int(mine.thread)
        while j < slots:
            first, n = chains.chain_span(shared, j, mine.rollers)
            at = STATE_ROWS * (mine.first_roller + first) + wp.min(j - first, n - 1)
            access.store(shared.rows, row.x + j, state.rollers[at])
            access.store(shared.rows, row.y + j, state.rollers[at + n])
            access.store(shared.rows, row.vx + j, state.rollers[at + 2 * n])
            access.store(shared.rows, row.vy + j, state.rollers[at + 3 * n])
            if wp.static(mass_rows(kind)):
                own = state.relative_mass[mine.first_roller + first + wp.min(j - first, n - 1)]
                chains.set_own_mass(shared, j, own)
            if wp.static(kind.is_paired):
                access.store(shared.rows, row.x_low + j, state.rollers[at + 4 * n])
                access.store(shared.rows, row.y_low + j, state.rollers[at + 5 * n])
            set_force(shared, j, vec2())
            j = j + threads
        at = int(mine.thread)
        while at < parts:
            shared.wrench_parts[at] = Real(0.0)
            at = at + threads

    @wp.func
    def put_back(state: State, shared: Shared, mine: ThreadParts):
        """Puts the thread's rollers back into the state."""
        j = int(mine.thread)
        while j < mine.rollers:
            first, n = chains.chain_span(shared, j, mine.rollers)
            at = STATE_ROWS * (mine.first_roller + first) + j - first
            state.rollers[at] = access.load(shared.rows, row.x + j)
            state.rollers[at + n] = access.load(shared.rows, row.y + j)
            state.rollers[at + 2 * n] = access.load(shared.rows, row.vx + j)
            state.rollers[at + 3 * n] = access.load(shared.rows, row.vy + j)
            if wp.static(kind.is_paired):
                state.rollers[at + 4 * n] = access.load(shared.rows, row.x_low + j)
                state.rollers[at + 5 * n] = access.load(shared.rows, row.y_low + j)
            j = j + threads

    return RollerFunctions(
        position=position,
        exact_position=exact_position,
        time_step=time_step,
        stretch_part=stretch_part,
        velocity=velocity,
        force=force,
        set_force=set_force,
        acceleration=acceleration,
        set_velocity=set_velocity,
        move=move,
        fetch=fetch,
        put_back=put_back,
    )


STAGE_ROWS = 10
"""Values of a block's roller kept between stages: x, y, vx, vy and low parts of x, y at the step's start, sums."""


@cache
def roller_stage_function(kind: BlockKind) -> wp.Function:
    """Function of block kernels that moves a roller from stage to stage."""
    Real, integrator = kind.Real, kind.integrator
    kinds, Now = kind.types, kind.types.Now
    vec2 = kinds.vec2
    rollers = roller_functions(kind)
    access = row_access(Real)
    slots, kept_rows = kind.shape.slots, 6 if Real == wp.float32 else 4

    @wp.func
    def stage_roller(state: kinds.State, shared: kinds.Shared, mine: ThreadParts, now: Now, j: int):
        """Moves roller j of a block to its next stage; the last stage ends the step."""
        weight = stage_weight(integrator, now.stage, rollers.time_step(mine))
        reach = stage_reach(integrator, now.stage, rollers.time_step(mine))
        n = mine.rollers
        rows = shared.rows
        kept = state.stages
        at = STAGE_ROWS * mine.first_roller + j
        v = rollers.velocity(rows, j)
        a = rollers.acceleration(shared, j)
        if now.stage == 0:
            for k in range(kept_rows):
                access.store(kept, at + k * n, access.load(rows, slots * (k + 2 * (k // 4)) + j))
            for k in range(6, 10):
                access.store(kept, at + k * n, Real(0.0))
        access.store(kept, at + 6 * n, access.load(kept, at + 6 * n) + weight * v[0])
        access.store(kept, at + 7 * n, access.load(kept, at + 7 * n) + weight * v[1])
        access.store(kept, at + 8 * n, access.load(kept, at + 8 * n) + weight * a[0])
        access.store(kept, at + 9 * n, access.load(kept, at + 9 * n) + weight * a[1])
        for k in range(kept_rows):
            access.store(rows, slots * (k + 2 * (k // 4)) + j, access.load(kept, at + k * n))
        start = rollers.velocity(rows, j)
        if now.stage == stage_count(integrator) - 1:
            rollers.set_velocity(shared, j, start + vec2(access.load(kept, at + 8 * n), access.load(kept, at + 9 * n)))
            rollers.move(shared, j, Real(1.0), vec2(access.load(kept, at + 6 * n), access.load(kept, at + 7 * n)))
        else:
            rollers.set_velocity(shared, j, sum_with_multiple(start, reach, a))
            rollers.move(shared, j, reach, v)

    return stage_roller
