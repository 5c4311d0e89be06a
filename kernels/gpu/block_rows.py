"""How the rollers of one variant lie in the rows that a block's threads share: read, moved, taken in and put back."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.link import link_chain, link_force, played_force
from ..physics.roller import roller_acceleration, two_sum
from ..rows import STATE_ROWS, accessors
from ..structs import types
from .block_kind import BlockKind, Mine
from .block_room import room
from .exchange import Exchange, exchange


def _less(subtract: str) -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    return {subtract}(value, other);
#else
    return value - other;
#endif
"""


@dataclass(frozen=True)
class RowFunctions:
    """What is done on a block's rows, as functions of kernels, and where x, y and their low parts begin."""

    sharing: Exchange
    X: int
    Y: int
    FORCE_X: int
    FORCE_Y: int
    X_LOW: int
    Y_LOW: int
    step_of: wp.Function
    position: wp.Function
    place: wp.Function
    velocity: wp.Function
    across: wp.Function
    link_between: wp.Function
    link_of: wp.Function
    length_of: wp.Function
    before: wp.Function
    pull: wp.Function
    force_on: wp.Function
    set_force: wp.Function
    acceleration_under: wp.Function
    acceleration: wp.Function
    set_velocity: wp.Function
    move: wp.Function
    fetch: wp.Function
    put_back: wp.Function


@cache
def block_rows(kind: BlockKind) -> RowFunctions:
    """The rows of a block and what is done on them."""
    Real, threads, per, slots = kind.Real, kind.threads, kind.per, kind.slots
    kinds = types(Real)
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    parts = room(kind).parts
    of_each = wp.types.vector(per, Real)
    sharing = exchange(kind)
    barrier = sharing.barrier
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    X, Y, VX, VY, FORCE_X, FORCE_Y, X_LOW, Y_LOW = (wp.constant(k * slots) for k in range(8))

    @wp.func
    def position(rows: wp.array[Real], j: int):
        """Position of roller j [m]."""
        return vec2(load_row(rows, X + j), load_row(rows, Y + j))

    @wp.func
    def place(rows: wp.array[Real], j: int, center: wp.vec2d):
        """Position of roller j in float64 from `center` [m]."""
        if wp.static(compensated):
            return wp.vec2d(
                wp.float64(load_row(rows, X + j)) - center[0] + wp.float64(load_row(rows, X_LOW + j)),
                wp.float64(load_row(rows, Y + j)) - center[1] + wp.float64(load_row(rows, Y_LOW + j)),
            )
        else:
            return wp.vec2d(
                wp.float64(load_row(rows, X + j)) - center[0], wp.float64(load_row(rows, Y + j)) - center[1]
            )

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
    def across(shared: kinds.Shared, j: int, n: int):
        """From roller j to the next: vector [m], exact at float32 too, and relative velocity [m/s]."""
        rows = shared.rows
        next = wp.where(j + 1 < n, j + 1, 0)
        d = vec2(load_row(rows, X + next) - load_row(rows, X + j), load_row(rows, Y + next) - load_row(rows, Y + j))
        if wp.static(compensated):
            d = d + vec2(
                load_row(rows, X_LOW + next) - load_row(rows, X_LOW + j),
                load_row(rows, Y_LOW + next) - load_row(rows, Y_LOW + j),
            )
        v = vec2(load_row(rows, VX + next) - load_row(rows, VX + j), load_row(rows, VY + next) - load_row(rows, VY + j))
        return d, v

    @wp.func
    def link_between(shared: kinds.Shared, j: int, d: vec2, v: vec2, length: Real):
        """Tension [N], rate of elongation [m/s] and force on roller j [N] of the link after it, eq. (2), (3).

        `d` and `v` are from `across`.
        """
        chain = shared.chain[0]
        if wp.static(kind.uneven):
            links = shared.links[0]
            tension, rate, u = played_force(d, v, length, links.play, link_chain(j, chain, links))
            return tension, rate, tension * u
        else:
            tension, rate, u = link_force(d, v, length, chain.stiffness, chain.damping)
            return tension, rate, tension * u

    @wp.func
    def length_of(shared: kinds.Shared, lengths: wp.array[Real], j: int):
        """Unloaded length of link j [m], the first of `lengths` being that of link 0."""
        if wp.static(kind.regular):
            return shared.chain[0].length
        else:
            return load_row(lengths, j)

    @wp.func
    def link_of(shared: kinds.Shared, j: int, n: int, length: Real):
        """The same, of where the rollers are."""
        d, v = across(shared, j, n)
        return link_between(shared, j, d, v, length)

    @wp.func
    def before(j: int, n: int):
        """The roller before roller j."""
        return wp.where(j > 0, j - 1, n - 1)

    @wp.func_native(_less("__fsub_rn" if compensated else "__dsub_rn"))
    def less(value: Real, other: Real) -> Real:
        """`value` - `other`, both rounded before: not taken together with the product that one of them may be."""
        ...

    @wp.func
    def force_on(shared: kinds.Shared, j: int):
        """What stands as roller j's force [N]."""
        return vec2(load_row(shared.rows, FORCE_X + j), load_row(shared.rows, FORCE_Y + j))

    @wp.func
    def set_force(shared: kinds.Shared, j: int, force: vec2):
        """Roller j's force [N]: of the link after it, then of both its links, then of its contacts too."""
        store_row(shared.rows, FORCE_X + j, force[0])
        store_row(shared.rows, FORCE_Y + j, force[1])

    @wp.func
    def pull(shared: kinds.Shared, lengths: wp.array[Real], n: int, i: int):
        """Makes the forces of both its links stand as each roller's; all threads together.

        Returns tension [N] and rate of elongation [m/s] of the thread's links. They are worked out one after the other
        without a branch, so that one's latency hides behind the others' work. A thread with one roller works out the
        link before it too, and waits for no other.
        """
        tension = of_each()
        rate = of_each()
        if wp.static(per == 1):
            if i < n:
                tension_i, rate_i, force = link_of(shared, i, n, length_of(shared, lengths, i))
                h = before(i, n)
                tension_h, rate_h, force_h = link_of(shared, h, n, length_of(shared, lengths, h))
                set_force(shared, i, vec2(less(force[0], force_h[0]), less(force[1], force_h[1])))
                tension[0] = tension_i
                rate[0] = rate_i
        else:
            pull_x = of_each()
            pull_y = of_each()
            for k in range(wp.static(per)):
                j = k * wp.static(threads) + i
                tension_k, rate_k, force = link_of(shared, j, n, length_of(shared, lengths, j))
                set_force(shared, j, force)
                tension[k] = tension_k
                rate[k] = rate_k
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            barrier()
            for k in range(wp.static(per)):
                force = force_on(shared, before(k * wp.static(threads) + i, n))
                pull_x[k] = less(pull_x[k], force[0])
                pull_y[k] = less(pull_y[k], force[1])
            barrier()
            for k in range(wp.static(per)):
                set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

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

    return RowFunctions(
        sharing=sharing,
        X=X,
        Y=Y,
        FORCE_X=FORCE_X,
        FORCE_Y=FORCE_Y,
        X_LOW=X_LOW,
        Y_LOW=Y_LOW,
        step_of=step_of,
        position=position,
        place=place,
        velocity=velocity,
        across=across,
        link_between=link_between,
        link_of=link_of,
        length_of=length_of,
        before=before,
        pull=pull,
        force_on=force_on,
        set_force=set_force,
        acceleration_under=acceleration_under,
        acceleration=acceleration,
        set_velocity=set_velocity,
        move=move,
        fetch=fetch,
        put_back=put_back,
    )
