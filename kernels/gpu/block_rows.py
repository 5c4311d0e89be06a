"""How the rollers of one variant lie in the rows that a block's threads share: read, moved, taken in and put back."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.link import link_force
from ..rows import STATE_ROWS, accessors
from ..structs import types, vec2d
from .exchange import exchange


@cache
def block_rows(
    Real: type, threads: int, per: int, sprockets: int, guides: int, moving: bool = False, measuring: bool = False
) -> SimpleNamespace:
    """The rows of a block of `threads` threads and what is done on them, thread i with the rollers
    i, i + threads, ..., `per` of them at most.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    slots = threads * per
    talk = exchange(Real, threads, slots, sprockets, guides, moving, measuring)
    load, store = accessors(Real).load, accessors(Real).store
    X, Y, VX, VY, FORCE_X, FORCE_Y, X_LOW, Y_LOW = (wp.constant(k * slots) for k in range(8))

    @wp.func
    def place(rows: wp.array(dtype=Real), j: int, center: vec2d):
        """Position of roller j in float64 from `center` [m]."""
        if wp.static(compensated):
            return vec2d(
                wp.float64(load(rows, X + j)) - center[0] + wp.float64(load(rows, X_LOW + j)),
                wp.float64(load(rows, Y + j)) - center[1] + wp.float64(load(rows, Y_LOW + j)),
            )
        else:
            return vec2d(wp.float64(load(rows, X + j)) - center[0], wp.float64(load(rows, Y + j)) - center[1])

    @wp.func
    def velocity(rows: wp.array(dtype=Real), j: int):
        """Velocity of roller j [m/s]."""
        return vec2(load(rows, VX + j), load(rows, VY + j))

    @wp.func
    def link_of(shared: kinds.Shared, j: int, n: int, length: Real):
        """Tension [N], rate of elongation [m/s] and force on roller j [N] of the link after it, eq. (2), (3)."""
        chain = shared.chain[0]
        rows = shared.rows
        next = wp.where(j + 1 < n, j + 1, 0)
        d = vec2(load(rows, X + next) - load(rows, X + j), load(rows, Y + next) - load(rows, Y + j))
        if wp.static(compensated):
            d = d + vec2(
                load(rows, X_LOW + next) - load(rows, X_LOW + j), load(rows, Y_LOW + next) - load(rows, Y_LOW + j)
            )
        v = vec2(load(rows, VX + next) - load(rows, VX + j), load(rows, VY + next) - load(rows, VY + j))
        tension, rate, u = link_force(d, v, length, chain.stiffness, chain.damping)
        return tension, rate, tension * u

    @wp.func
    def before(j: int, n: int):
        """The roller before roller j."""
        return wp.where(j > 0, j - 1, n - 1)

    @wp.func
    def force_on(shared: kinds.Shared, j: int):
        """What stands as roller j's force [N]."""
        return vec2(load(shared.rows, FORCE_X + j), load(shared.rows, FORCE_Y + j))

    @wp.func
    def set_force(shared: kinds.Shared, j: int, force: vec2):
        """Roller j's force [N]: of the link after it, then of both its links, then of its contacts too."""
        store(shared.rows, FORCE_X + j, force[0])
        store(shared.rows, FORCE_Y + j, force[1])

    @wp.func
    def acceleration(shared: kinds.Shared, j: int):
        """Acceleration of roller j [m/s^2], eq. (1), from its force and gravity."""
        chain = shared.chain[0]
        force = force_on(shared, j)
        return vec2(
            chain.inverse_mass * force[0] + chain.gravity[0],
            chain.inverse_mass * force[1] + chain.gravity[1],
        )

    @wp.func
    def set_velocity(shared: kinds.Shared, j: int, v: vec2):
        """Roller j's velocity."""
        store(shared.rows, VX + j, v[0])
        store(shared.rows, VY + j, v[1])

    @wp.func
    def move(shared: kinds.Shared, j: int, dx: Real, dy: Real):
        """Roller j by (dx, dy) [m]; what float32 rounds off goes to the low parts (fast two-sum)."""
        rows = shared.rows
        x = load(rows, X + j)
        y = load(rows, Y + j)
        if wp.static(compensated):
            low_x = load(rows, X_LOW + j) + dx
            low_y = load(rows, Y_LOW + j) + dy
            new_x = x + low_x
            new_y = y + low_y
            store(rows, X + j, new_x)
            store(rows, Y + j, new_y)
            store(rows, X_LOW + j, low_x - (new_x - x))
            store(rows, Y_LOW + j, low_y - (new_y - y))
        else:
            store(rows, X + j, x + dx)
            store(rows, Y + j, y + dy)

    @wp.func
    def fetch(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, variant: int, i: int):
        """The thread's rollers into the shared rows, and which partners they are near; its parts begin at zero."""
        drive = ensemble.drives[variant]
        n = drive.rollers
        j = int(i)
        while j < wp.static(slots):
            row = STATE_ROWS * drive.first_roller + wp.min(j, n - 1)
            store(shared.rows, X + j, state.rollers[row])
            store(shared.rows, Y + j, state.rollers[row + n])
            store(shared.rows, VX + j, state.rollers[row + 2 * n])
            store(shared.rows, VY + j, state.rollers[row + 3 * n])
            if wp.static(compensated):
                store(shared.rows, X_LOW + j, state.rollers[row + 4 * n])
                store(shared.rows, Y_LOW + j, state.rollers[row + 5 * n])
            held = int(0)
            if j < n:
                memory = drive.first_contact + j
                p = int(0)
                while p < wp.static(sprockets + guides):
                    if state.seat[memory + p * n] >= 0 or state.impact_speed[memory + p * n] != Real(0.0):
                        held = held | (1 << p)
                    p = p + 1
            shared.held[j] = held
            j = j + wp.static(threads)
        row = int(0)
        while row < wp.static((3 if moving else 1) * sprockets):
            shared.parts[row * wp.static(threads) + i] = wp.float64(0.0)
            row = row + 1

    @wp.func
    def put_back(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, variant: int, i: int):
        """The thread's rollers back into the state."""
        drive = ensemble.drives[variant]
        n = drive.rollers
        j = int(i)
        while j < n:
            row = STATE_ROWS * drive.first_roller + j
            state.rollers[row] = load(shared.rows, X + j)
            state.rollers[row + n] = load(shared.rows, Y + j)
            state.rollers[row + 2 * n] = load(shared.rows, VX + j)
            state.rollers[row + 3 * n] = load(shared.rows, VY + j)
            if wp.static(compensated):
                state.rollers[row + 4 * n] = load(shared.rows, X_LOW + j)
                state.rollers[row + 5 * n] = load(shared.rows, Y_LOW + j)
            j = j + wp.static(threads)

    return SimpleNamespace(
        talk=talk,
        X=X,
        Y=Y,
        X_LOW=X_LOW,
        Y_LOW=Y_LOW,
        **{name: value for name, value in locals().items() if isinstance(value, wp.Function)},
    )
