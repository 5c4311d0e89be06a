"""Friction of the joints on blocks of threads: it takes one barrier more, and two more rows of rollers.

Those rows hold each link's tension and rate of turning until its neighbors have worked out their joints' moments; where
metrics are taken then the force of its joints' couple, for the step's friction work.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.joint import couple_force, joint_friction_power, joint_moment, turning
from ..rows import accessors
from ..structs import types
from .block_kind import BlockKind, Mine, now_struct
from .block_rows import block_rows
from .exchange import seen_rows, shared_rows

REGISTERED = 4
"""Rollers of a thread whose link forces wait in registers; of more they wait in their rows, which spills less."""


@dataclass(frozen=True)
class JointFunctions:
    """What is done about joints, as functions of kernels."""

    pull: wp.Function
    add_friction: wp.Function
    joint_power: wp.Function


@cache
def block_joints(kind: BlockKind) -> JointFunctions:
    """The link forces of chains whose joints rub, and the work of their friction."""
    Real, threads, per, slots = kind.Real, kind.threads, kind.per, kind.slots
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    of_each = wp.types.vector(per, Real)
    crowded = per > REGISTERED
    row = block_rows(kind)
    barrier, link_of, across, before = row.sharing.barrier, row.link_of, row.across, row.before
    force_on, set_force, acceleration, velocity = row.force_on, row.set_force, row.acceleration, row.velocity
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    FIRST, SECOND = (wp.constant((shared_rows(Real) + k) * slots) for k in range(2))
    FRICTION = wp.constant(seen_rows(kind)[1])

    @wp.func
    def moment_between(rows: wp.array[Real], i: int, j: int, joint: kinds.Joint):
        """Moment of the joint between link i and the next, j, from the rows of tensions and rates of turning."""
        return joint_moment(
            load_row(rows, FIRST + i),
            load_row(rows, SECOND + i),
            load_row(rows, FIRST + j),
            load_row(rows, SECOND + j),
            joint,
        )

    @wp.func
    def pull(shared: kinds.Shared, lengths: wp.array[Real], n: int, i: int):
        """As `block_rows.pull`, with the forces of the links' joints."""
        rows = shared.rows
        tension = of_each()
        rate = of_each()
        bend_x = of_each()
        bend_y = of_each()
        pull_x = of_each()
        pull_y = of_each()
        for k in range(wp.static(per)):
            j = k * wp.static(threads) + i
            tension_k, rate_k, force = link_of(shared, j, n, load_row(lengths, j))
            if wp.static(crowded):
                set_force(shared, j, force)
            else:
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            d, w = across(shared, j, n)
            lever, turn = turning(d, w)
            store_row(rows, FIRST + j, tension_k)
            store_row(rows, SECOND + j, turn)
            tension[k] = tension_k
            rate[k] = rate_k
            bend_x[k] = lever[0]
            bend_y[k] = lever[1]
        barrier()
        joint = shared.joint[0]
        for k in range(wp.static(per)):
            j = k * wp.static(threads) + i
            moment = moment_between(rows, before(j, n), j, joint)
            next_moment = moment_between(rows, j, wp.where(j + 1 < n, j + 1, 0), joint)
            force = couple_force(moment, next_moment, vec2(bend_x[k], bend_y[k]))
            bend_x[k] = force[0]
            bend_y[k] = force[1]
            if wp.static(crowded):
                force = force + force_on(shared, j)
            else:
                force = force + vec2(pull_x[k], pull_y[k])
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            set_force(shared, j, force)
        barrier()
        for k in range(wp.static(per)):
            j = k * wp.static(threads) + i
            if wp.static(kind.measuring):
                store_row(rows, FIRST + j, bend_x[k])
                store_row(rows, SECOND + j, bend_y[k])
            if wp.static(crowded):
                own = force_on(shared, j)
                pull_x[k] = own[0]
                pull_y[k] = own[1]
            force = force_on(shared, before(j, n))
            pull_x[k] = pull_x[k] - force[0]
            pull_y[k] = pull_y[k] - force[1]
        barrier()
        for k in range(wp.static(per)):
            set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    @wp.func
    def add_friction(shared: kinds.Shared, mine: Mine, now: Now):
        """Adds what friction takes from the thread's rollers in this step, at the mean of its two velocities."""
        rows = shared.rows
        for k in range(wp.static(per)):
            j = k * wp.static(threads) + mine.thread
            i = before(j, mine.rollers)
            force = vec2(
                load_row(rows, FIRST + j) - load_row(rows, FIRST + i),
                load_row(rows, SECOND + j) - load_row(rows, SECOND + i),
            )
            v = velocity(rows, j)
            if wp.static(not kind.rk4):
                v = v + Real(0.5) * row.step_of(mine) * acceleration(shared, j)
            at = FRICTION + j
            store_row(shared.seen, at, load_row(shared.seen, at) - now.weight * wp.dot(force, v))

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
        moment = joint_moment(tension_before, turn_before, tension, turn, shared.joint[0])
        return joint_friction_power(moment, later_before, later)

    return JointFunctions(pull=pull, add_friction=add_friction, joint_power=joint_power)
