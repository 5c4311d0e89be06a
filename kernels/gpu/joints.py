"""Friction of the joints on blocks of threads.

Each link's tension and rate of turning lie in two rows until its neighbors have worked out their joints' moments. On a
block of one warp, whose barriers cost little, these are the rows of forces, and each moment is worked out once; on
several warps two more, and twice. Where metrics are taken the couples' forces are kept for the friction work, as
float32: that rounds off 3e-8 of each, at random, and leaves room for more blocks.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.joint import couple_force, joint_friction_power, joint_moment, rubbing_moment, turning
from ..rows import accessors
from ..structs import types
from .kind import WARP, BlockKind, Mine, now_struct
from .link_forces import link_forces
from .roller_rows import roller_rows
from .shared_memory import seen_rows, shared_rows
from .sync import sync


@wp.func_native("union { double one; float two[2]; } of; of.two[0] = x; of.two[1] = y; return of.one;")
def as_one(x: wp.float32, y: wp.float32) -> wp.float64:
    """Two float32 in the place of a float64."""
    ...


@wp.func_native("union { double one; float two[2]; } of; of.one = value; return {of.two[0], of.two[1]};")
def as_two(value: wp.float64) -> wp.vec2f:
    """What `as_one` has put together."""
    ...


@dataclass(frozen=True)
class JointFunctions:
    """What is done about joints, as functions of kernels."""

    pull: wp.Function
    add_friction: wp.Function
    joint_power: wp.Function


@cache
def block_joints(kind: BlockKind) -> JointFunctions:
    """The link forces of chains whose joints rub, and the work of their friction."""
    Real, threads, rollers_per_thread, slots = kind.Real, kind.threads, kind.rollers_per_thread, kind.slots
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, links = roller_rows(kind), link_forces(kind)
    barrier, link_of, across, before = sync(kind).barrier, links.link_of, links.across, links.before
    link_between, length_of = links.link_between, links.length_of
    force_on, set_force, acceleration, velocity = row.force_on, row.set_force, row.acceleration, row.velocity
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    alone = threads == WARP
    FIRST, SECOND = (wp.constant((shared_rows(Real) + k) * slots) for k in range(2))
    TENSION, TURN = (row.FORCE_X, row.FORCE_Y) if alone else (FIRST, SECOND)
    FRICTION = wp.constant(seen_rows(kind)[1])

    @wp.func
    def moment_between(before: vec2, after: vec2, joint: kinds.Joint):
        """Moment [N m] of the joint between two links, given tension [N] and rate of turning [rad/s] of each."""
        if wp.static(kind.stribeck):
            return joint_moment(before[0], before[1], after[0], after[1], joint)
        else:
            return rubbing_moment(joint.law.mu_dynamic, before[0], before[1], after[0], after[1], joint)

    @wp.func
    def bent(rows: wp.array[Real], j: int):
        """Tension [N] of link j and the rate at which it turns [rad/s], from their rows."""
        return vec2(load_row(rows, TENSION + j), load_row(rows, TURN + j))

    @wp.func
    def share_moments(rows: wp.array[Real], n: int, i: int, joint: kinds.Joint):
        """Puts the moment of each joint of the thread in place of the rate at which the link after it turns."""
        moment = of_each()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            moment[k] = moment_between(bent(rows, before(j, n)), bent(rows, j), joint)
        barrier()
        for k in range(wp.static(rollers_per_thread)):
            store_row(rows, TURN + k * wp.static(threads) + i, moment[k])
        barrier()

    @wp.func
    def couple_on(rows: wp.array[Real], n: int, j: int, lever: vec2, joint: kinds.Joint):
        """Force [N] of the couple of link j's joints."""
        next = wp.where(j + 1 < n, j + 1, 0)
        if wp.static(alone):
            return couple_force(load_row(rows, TURN + j), load_row(rows, TURN + next), lever)
        else:
            after = bent(rows, j)
            moment = moment_between(bent(rows, before(j, n)), after, joint)
            return couple_force(moment, moment_between(after, bent(rows, next), joint), lever)

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
    def pull(shared: kinds.Shared, lengths: wp.array[Real], n: int, i: int):
        """As `link_forces.pull`, with the forces of the links' joints."""
        rows = shared.rows
        tension = of_each()
        rate = of_each()
        lever_x = of_each()
        lever_y = of_each()
        pull_x = of_each()
        pull_y = of_each()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            d, w = across(shared, j, n)
            tension_k, rate_k, force = link_between(shared, j, d, w, length_of(shared, lengths, j))
            lever, turn = turning(d, w)
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
            share_moments(rows, n, i, shared.joint[0])
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + i
            couple = couple_on(rows, n, j, vec2(lever_x[k], lever_y[k]), shared.joint[0])
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
            force = force_on(shared, before(j, n))
            pull_x[k] = pull_x[k] - force[0]
            pull_y[k] = pull_y[k] - force[1]
        barrier()
        for k in range(wp.static(rollers_per_thread)):
            set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    @wp.func
    def add_friction(shared: kinds.Shared, mine: Mine, now: Now):
        """Adds what friction takes from the thread's rollers in this step, at the mean of its two velocities."""
        rows = shared.rows
        power = Real(0.0)
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            couple = load_couple(rows, j)
            couple_before = load_couple(rows, before(j, mine.rollers))
            v = velocity(rows, j)
            if wp.static(not kind.rk4):
                v = v + Real(0.5) * row.step_of(mine) * acceleration(shared, j)
            of_roller = Real(couple[0] - couple_before[0]) * v[0] + Real(couple[1] - couple_before[1]) * v[1]
            power = power + wp.where(j < mine.rollers, of_roller, Real(0.0))
        at = FRICTION + mine.thread
        store_row(shared.seen, at, load_row(shared.seen, at) - now.weight * power)

    @wp.func
    def pulled(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, j: int, lag: Real):
        """Tension of link j [N] and the rate at which it turns [rad/s], which comes a second time from `lag` later."""
        n = mine.rollers
        tension, rate, force = link_of(shared, j, n, load_row(ensemble.lengths, mine.first + j))
        d, w = across(shared, j, n)
        next = wp.where(j + 1 < n, j + 1, 0)
        lever, turn = turning(d, w)
        later = turn + lag * wp.dot(lever, acceleration(shared, next) - acceleration(shared, j))
        return tension, turn, later

    @wp.func
    def joint_power(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, j: int, lag: Real):
        """Power that joint j dissipates [W], worked out anew from the links beside it, at rates from `lag` later."""
        tension_before, turn_before, later_before = pulled(ensemble, shared, mine, before(j, mine.rollers), lag)
        tension, turn, later = pulled(ensemble, shared, mine, j, lag)
        moment = moment_between(vec2(tension_before, turn_before), vec2(tension, turn), shared.joint[0])
        return joint_friction_power(moment, later_before, later)

    return JointFunctions(pull=pull, add_friction=add_friction, joint_power=joint_power)
