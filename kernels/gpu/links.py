"""The links of one variant on a block: their tensions, and their forces on the rollers at both ends."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import row_access
from ..physics.friction import (
    couple_force,
    joint_friction_coefficient,
    joint_friction_moment,
    joint_friction_power,
    link_turning,
)
from ..physics.link import link_force, uneven_link_force
from .kind import BY_SPEED, WARP, BlockKind, Mine
from .rings import block_rings
from .rollers import roller_rows
from .shared_memory import seen_rows, shared_rows
from .sync import sync


@cache
def link_forces(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the links of one variant on a block."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds = kind.types
    Shared = kinds.Shared
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, barrier, load_row = roller_rows(kind), sync(kind).barrier, row_access(Real).load
    rings = block_rings(kind)
    span_of, chain_at, next_to, last_to = rings.span_of, rings.chain_at, rings.next_to, rings.last_to
    X, Y, VX, VY, X_LOW, Y_LOW = row.X, row.Y, row.VX, row.VY, row.X_LOW, row.Y_LOW
    force_on, set_force = row.force_on, row.set_force

    @wp.func
    def across(shared: Shared, j: int, n: int):
        """From roller j to the next: vector [m], exact at float32 too, and relative velocity [m/s]."""
        rows = shared.rows
        next = next_to(shared, j, n)
        d = vec2(load_row(rows, X + next) - load_row(rows, X + j), load_row(rows, Y + next) - load_row(rows, Y + j))
        if wp.static(compensated):
            d = d + vec2(
                load_row(rows, X_LOW + next) - load_row(rows, X_LOW + j),
                load_row(rows, Y_LOW + next) - load_row(rows, Y_LOW + j),
            )
        v = vec2(load_row(rows, VX + next) - load_row(rows, VX + j), load_row(rows, VY + next) - load_row(rows, VY + j))
        return d, v

    @wp.func
    def link_between(shared: Shared, j: int, n: int, d: vec2, v: vec2, length: Real):
        """Tension [N], rate of elongation [m/s] and force on roller j [N] of the link after it, eq. (2), (3).

        `d` and `v` are from `across`.
        """
        if wp.static(kind.links == "varied"):
            first, count = span_of(shared, j, n)
            tension, rate, u = uneven_link_force(d, v, length, j - first, chain_at(shared, j))
            return tension, rate, tension * u
        else:
            chain = chain_at(shared, j)
            tension, rate, u = link_force(d, v, length, chain)
            return tension, rate, tension * u

    @wp.func
    def length_of(shared: Shared, lengths: wp.array[Real], j: int):
        """Unloaded length of link j [m], the first of `lengths` being that of link 0."""
        if wp.static(kind.links == "alike"):
            return chain_at(shared, j).length
        else:
            return load_row(lengths, j)

    @wp.func
    def link_of(shared: Shared, j: int, n: int, length: Real):
        """The same, of where the rollers are."""
        d, v = across(shared, j, n)
        return link_between(shared, j, n, d, v, length)

    @wp.func
    def pull(state: kinds.State, shared: Shared, mine: Mine, now: kinds.Now, lengths: wp.array[Real]):
        """Makes the forces of both its links stand as each roller's; all threads together.

        Returns tension [N] and rate of elongation [m/s] of the thread's links. They are worked out one after the other
        without a branch, so that one's latency hides behind the others' work. A thread with one roller works out the
        link before it too, and waits for no other.
        """
        n, i = mine.rollers, mine.thread
        tension = of_each()
        rate = of_each()
        if wp.static(rollers_per_thread == 1):
            if i < n:
                tension_i, rate_i, force = link_of(shared, i, n, length_of(shared, lengths, i))
                h = last_to(shared, i, n)
                tension_h, rate_h, force_h = link_of(shared, h, n, length_of(shared, lengths, h))
                set_force(shared, i, force - force_h)
                tension[0] = tension_i
                rate[0] = rate_i
        else:
            pull_x = of_each()
            pull_y = of_each()
            for k in range(wp.static(rollers_per_thread)):
                j = k * wp.static(threads) + i
                tension_k, rate_k, force = link_of(shared, j, n, length_of(shared, lengths, j))
                set_force(shared, j, force)
                tension[k] = tension_k
                rate[k] = rate_k
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            barrier()
            for k in range(wp.static(rollers_per_thread)):
                force = force_on(shared, last_to(shared, k * wp.static(threads) + i, n))
                pull_x[k] = pull_x[k] - force[0]
                pull_y[k] = pull_y[k] - force[1]
            barrier()
            for k in range(wp.static(rollers_per_thread)):
                set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    return SimpleNamespace(**locals())


@wp.func_native("union { double one; float two[2]; } of; of.two[0] = x; of.two[1] = y; return of.one;")
def as_one(x: wp.float32, y: wp.float32) -> wp.float64:
    """Two float32 in the place of a float64."""


@wp.func_native("union { double one; float two[2]; } of; of.one = value; return {of.two[0], of.two[1]};")
def as_two(value: wp.float64) -> wp.vec2f:
    """The two float32 that `as_one` has put together."""


@cache
def block_joints(kind: BlockKind) -> SimpleNamespace:
    """The link forces of chains whose joints rub, and the work of their friction."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    slots = kind.shape.slots
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Chain = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Chain
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, links, rings = roller_rows(kind), link_forces(kind), block_rings(kind)
    chain_at, next_to, last_to = rings.chain_at, rings.next_to, rings.last_to
    barrier, link_of, across = sync(kind).barrier, links.link_of, links.across
    link_between, length_of = links.link_between, links.length_of
    force_on, set_force, acceleration, velocity = row.force_on, row.set_force, row.acceleration, row.velocity
    load_row, store_row = row_access(Real).load, row_access(Real).store
    alone = threads == WARP
    FIRST, SECOND = (wp.constant((shared_rows(Real) + k) * slots) for k in range(2))
    TENSION, TURN = (row.FORCE_X, row.FORCE_Y) if alone else (FIRST, SECOND)
    FRICTION = wp.constant(seen_rows(kind)[1])

    @wp.func
    def moment_between(before: vec2, after: vec2, held: Real, chain: Chain, stretched: Real):
        """Moment [N m] of the joint between two links, given tension [N] and rate of turning [rad/s] of each, and what
        its bristle holds after it has held `held` [N m].
        """
        mu = chain.joint.mu_dynamic
        if wp.static(kind.friction.joints == BY_SPEED):
            mu = joint_friction_coefficient(before[1], after[1], chain)
        return joint_friction_moment(mu, before[0], before[1], after[0], after[1], held, chain, stretched)

    @wp.func
    def bent(rows: wp.array[Real], j: int):
        """Tension [N] of link j and the rate at which it turns [rad/s], from their rows."""
        return vec2(load_row(rows, TENSION + j), load_row(rows, TURN + j))

    @wp.func
    def hold_of(state: State, mine: Mine, j: int):
        """Moment [N m] that the bristle of joint j has held until now."""
        return load_row(state.joint_hold, mine.first + wp.min(j, mine.rollers - 1))

    @wp.func
    def moment_at(shared: Shared, mine: Mine, now: Now, j: int, held: Real):
        """Moment [N m] of joint j, whose bristle has held `held` [N m], and what it holds, from the rows."""
        n, rows, stretched = mine.rollers, shared.rows, row.stretched(now)
        return moment_between(bent(rows, last_to(shared, j, n)), bent(rows, j), held, chain_at(shared, j), stretched)

    @wp.func
    def keep_hold(state: State, mine: Mine, now: Now, j: int, holds: Real):
        """Sets what the bristle of joint j holds from now on."""
        if j < mine.rollers and now.stage == 0:
            store_row(state.joint_hold, mine.first + j, holds)

    @wp.func
    def share_moments(state: State, shared: Shared, mine: Mine, now: Now, held: of_each):
        """Puts the moment of each joint of the thread in place of the rate at which the link after it turns."""
        moment = of_each()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            moment_k, holds = moment_at(shared, mine, now, j, held[k])
            keep_hold(state, mine, now, j, holds)
            moment[k] = moment_k
        barrier()
        for k in range(wp.static(rollers_per_thread)):
            store_row(shared.rows, TURN + k * wp.static(threads) + mine.thread, moment[k])
        barrier()

    @wp.func
    def couple_on(state: State, shared: Shared, mine: Mine, now: Now, j: int, lever: vec2):
        """Force [N] of the couple of link j's joints, and what the bristle of joint j holds if it is not shared yet."""
        next, rows = next_to(shared, j, mine.rollers), shared.rows
        if wp.static(alone):
            return couple_force(load_row(rows, TURN + j), load_row(rows, TURN + next), lever), Real(0.0)
        else:
            moment, holds = moment_at(shared, mine, now, j, hold_of(state, mine, j))
            next_moment, of_next = moment_at(shared, mine, now, next, hold_of(state, mine, next))
            return couple_force(moment, next_moment, lever), holds

    @wp.func
    def store_couple(rows: wp.array[Real], j: int, x: Real, y: Real):
        """Keeps the force [N] of the couple of link j's joints, as float32."""
        if wp.static(Real == wp.float64):
            store_row(rows, FIRST + j, as_one(wp.float32(x), wp.float32(y)))
        else:
            store_row(rows, FIRST + j, x)
            store_row(rows, SECOND + j, y)

    @wp.func
    def load_couple(rows: wp.array[Real], j: int):
        """The force that `store_couple` has kept."""
        if wp.static(Real == wp.float64):
            return as_two(load_row(rows, FIRST + j))
        else:
            return wp.vec2f(load_row(rows, FIRST + j), load_row(rows, SECOND + j))

    @wp.func
    def pull(state: State, shared: Shared, mine: Mine, now: Now, lengths: wp.array[Real]):
        """As `link_forces.pull`, with the forces of the links' joints."""
        n, i, rows = mine.rollers, mine.thread, shared.rows
        hold = of_each()
        tension = of_each()
        rate = of_each()
        lever_x = of_each()
        lever_y = of_each()
        pull_x = of_each()
        pull_y = of_each()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            if wp.static(alone):  # each before any is stored, as the compiler does not load across a store
                hold[k] = hold_of(state, mine, j)
            d, w = across(shared, j, n)
            tension_k, rate_k, force = link_between(shared, j, n, d, w, length_of(shared, lengths, j))
            lever, turn = link_turning(d, w)
            store_row(rows, TENSION + j, tension_k)
            store_row(rows, TURN + j, turn)
            tension[k] = tension_k
            rate[k] = rate_k
            lever_x[k] = lever[0]
            lever_y[k] = lever[1]
            pull_x[k] = force[0]
            pull_y[k] = force[1]
        barrier()
        if wp.static(alone):
            share_moments(state, shared, mine, now, hold)
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            couple, holds = couple_on(state, shared, mine, now, j, vec2(lever_x[k], lever_y[k]))
            hold[k] = holds
            lever_x[k] = couple[0]
            lever_y[k] = couple[1]
            pull_x[k] = pull_x[k] + couple[0]
            pull_y[k] = pull_y[k] + couple[1]
        if wp.static(alone):
            barrier()
        for k in range(wp.static(rollers_per_thread)):
            set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        barrier()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            if wp.static(kind.measuring):
                store_couple(rows, j, lever_x[k], lever_y[k])
            if wp.static(not alone):  # neighbors have read it
                keep_hold(state, mine, now, j, hold[k])
            force = force_on(shared, last_to(shared, j, n))
            pull_x[k] = pull_x[k] - force[0]
            pull_y[k] = pull_y[k] - force[1]
        barrier()
        for k in range(wp.static(rollers_per_thread)):
            set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    @wp.func
    def take(shared: Shared, at: int, work: Real):
        """Counts what friction takes [J] at `at`."""
        store_row(shared.seen, FRICTION + at, load_row(shared.seen, FRICTION + at) - work)

    @wp.func
    def add_friction(shared: Shared, mine: Mine, now: Now):
        """Adds what friction takes from the thread's rollers in this step, at the mean of its two velocities."""
        rows = shared.rows
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            couple = load_couple(rows, j)
            couple_before = load_couple(rows, last_to(shared, j, mine.rollers))
            v = velocity(rows, j)
            if wp.static(not kind.staged):
                v = v + Real(0.5) * row.step_of(mine) * acceleration(shared, j)
            of_roller = Real(couple[0] - couple_before[0]) * v[0] + Real(couple[1] - couple_before[1]) * v[1]
            if j < mine.rollers:
                take(shared, j, now.weight * of_roller)

    @wp.func
    def pulled(ensemble: Ensemble, shared: Shared, mine: Mine, j: int, lag: Real):
        """Tension of link j [N] and the rate at which it turns [rad/s], which comes a second time from `lag` later."""
        n = mine.rollers
        tension, rate, force = link_of(shared, j, n, load_row(ensemble.lengths, mine.first + j))
        d, w = across(shared, j, n)
        next = next_to(shared, j, n)
        lever, turn = link_turning(d, w)
        later = turn + lag * wp.dot(lever, acceleration(shared, next) - acceleration(shared, j))
        return tension, turn, later

    @wp.func
    def joint_power(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, j: int, lag: Real):
        """Power that joint j dissipates [W], worked out anew from the links beside it, at rates from `lag` later."""
        last = last_to(shared, j, mine.rollers)
        tension_before, turn_before, later_before = pulled(ensemble, shared, mine, last, lag)
        tension, turn, later = pulled(ensemble, shared, mine, j, lag)
        held = load_row(state.joint_hold, mine.first + j)
        first, second = vec2(tension_before, turn_before), vec2(tension, turn)
        moment, holds = moment_between(first, second, held, chain_at(shared, j), Real(0.0))
        return joint_friction_power(moment, later_before, later)

    return SimpleNamespace(**locals())
