"""The rows of one variant's rollers that a block's threads share: read, moved, taken in and put back."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..number import pair_vector
from ..physics.roller import roller_acceleration, two_sum
from ..rows import STATE_ROWS, accessors
from ..structs import types
from .kind import BlockKind, Mine
from .shared_memory import room


@cache
def roller_rows(kind: BlockKind) -> SimpleNamespace:
    """The rows of a block and what is done on them."""
    Real, threads, slots = kind.Real, kind.threads, kind.slots
    kinds = types(Real)
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    parts = room(kind).parts
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
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
    def velocity(rows: wp.array[Real], j: int):
        """Velocity of roller j [m/s]."""
        return vec2(load_row(rows, VX + j), load_row(rows, VY + j))

    @wp.func
    def force_on(shared: kinds.Shared, j: int):
        """The force on roller j [N], as far as it is added up."""
        return vec2(load_row(shared.rows, FORCE_X + j), load_row(shared.rows, FORCE_Y + j))

    @wp.func
    def set_force(shared: kinds.Shared, j: int, force: vec2):
        """Roller j's force [N]: of the link after it, then of both its links, then of its contacts too."""
        store_row(shared.rows, FORCE_X + j, force[0])
        store_row(shared.rows, FORCE_Y + j, force[1])

    @wp.func
    def acceleration_under(shared: kinds.Shared, force: vec2):
        """Acceleration of a roller under a force [m/s^2], and gravity."""
        chain = shared.chain[0]
        return roller_acceleration(force, chain.inverse_mass, chain.gravity)

    @wp.func
    def acceleration(shared: kinds.Shared, j: int):
        """Acceleration of roller j [m/s^2], from its force and gravity."""
        return acceleration_under(shared, force_on(shared, j))

    @wp.func
    def set_velocity(shared: kinds.Shared, j: int, v: vec2):
        """Roller j's velocity."""
        store_row(shared.rows, VX + j, v[0])
        store_row(shared.rows, VY + j, v[1])

    @wp.func
    def move(shared: kinds.Shared, j: int, dx: Real, dy: Real):
        """Roller j by (dx, dy) [m]; what float32 rounds off goes to the low parts."""
        rows = shared.rows
        x = load_row(rows, X + j)
        y = load_row(rows, Y + j)
        if wp.static(compensated):
            new_x, low_x = two_sum(x, load_row(rows, X_LOW + j), dx)
            new_y, low_y = two_sum(y, load_row(rows, Y_LOW + j), dy)
            store_row(rows, X + j, new_x)
            store_row(rows, Y + j, new_y)
            store_row(rows, X_LOW + j, low_x)
            store_row(rows, Y_LOW + j, low_y)
        else:
            store_row(rows, X + j, x + dx)
            store_row(rows, Y + j, y + dy)

    @wp.func
    def fetch(state: kinds.State, shared: kinds.Shared, mine: Mine):
        """The thread's rollers into the shared rows; its parts begin at zero."""
        n = mine.rollers
        j = int(mine.thread)
        while j < wp.static(slots):
            row = STATE_ROWS * mine.first + wp.min(j, n - 1)
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
    def put_back(state: kinds.State, shared: kinds.Shared, mine: Mine):
        """The thread's rollers back into the state."""
        n = mine.rollers
        j = int(mine.thread)
        while j < n:
            row = STATE_ROWS * mine.first + j
            state.rollers[row] = load_row(shared.rows, X + j)
            state.rollers[row + n] = load_row(shared.rows, Y + j)
            state.rollers[row + 2 * n] = load_row(shared.rows, VX + j)
            state.rollers[row + 3 * n] = load_row(shared.rows, VY + j)
            if wp.static(compensated):
                state.rollers[row + 4 * n] = load_row(shared.rows, X_LOW + j)
                state.rollers[row + 5 * n] = load_row(shared.rows, Y_LOW + j)
            j = j + wp.static(threads)

    return namespace(
        step_of,
        position,
        point,
        velocity,
        force_on,
        set_force,
        acceleration_under,
        acceleration,
        set_velocity,
        move,
        fetch,
        put_back,
        X=X,
        Y=Y,
        VX=VX,
        VY=VY,
        FORCE_X=FORCE_X,
        FORCE_Y=FORCE_Y,
        X_LOW=X_LOW,
        Y_LOW=Y_LOW,
    )
