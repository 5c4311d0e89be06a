"""Friction in the joints of a block's chains: couples on links, and their work."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.friction import (
    couple_force,
    joint_friction_coefficient,
    joint_friction_moment,
    link_turning,
)
from .block_kinds import BY_SPEED, BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .links import link_functions
from .rollers import roller_functions, roller_rows
from .shared_memory import shared_rows, tally_places
from .sync import sync_functions


@wp.func_native("union { double one; float two[2]; } of; of.two[0] = x; of.two[1] = y; return of.one;")
def float64_of_two(x: wp.float32, y: wp.float32) -> wp.float64:
    """Float64 that holds two float32, for joints' couples on blocks."""


@wp.func_native("union { double one; float two[2]; } of; of.one = value; return {of.two[0], of.two[1]};")
def two_of_float64(value: wp.float64) -> wp.vec2f:
    """Two float32 from a block's float64 that `float64_of_two` made."""


@dataclass(frozen=True)
class JointFunctions:
    """Joint functions of a block: link forces with joint friction, and its work."""

    moment_between_links: wp.Function
    turning_of_link: wp.Function
    find_link_forces: wp.Function
    add_friction_work: wp.Function


@cache
def joint_functions(kind: BlockKind) -> JointFunctions:
    """Joint functions of block kernels."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    slots = kind.shape.slots
    kinds, Now = kind.types, kind.types.Now
    State, Shared, Chain = kinds.State, kinds.Shared, kinds.Chain
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    rollers, row = roller_functions(kind), roller_rows(kind)
    access = row_access(Real)
    chains = chain_functions(kind)
    sync = sync_functions(kind)
    links = link_functions(kind)
    TENSION, TURN = row.force_x, row.force_y
    FIRST, SECOND = (wp.constant((shared_rows(Real) + k) * slots) for k in range(2))
    FRICTION = wp.constant(tally_places(kind)[1])

    @wp.func
    def moment_between_links(before: vec2, after: vec2, held: Real, chain: Chain, stretched: Real):
        """Moment [N m] of a block's joint between two links, and of its bristle, from `held` [N m].

        `before` and `after` are each link's tension [N] and rate of turning [rad/s].
        """
        mu = chain.joint.mu_dynamic
        if wp.static(kind.friction.joints == BY_SPEED):
            mu = joint_friction_coefficient(before[1], after[1], chain)
        return joint_friction_moment(mu, before[0], before[1], after[0], after[1], held, chain, stretched)

    @wp.func
    def turning_of_link(shared: Shared, j: int, n: int, d: vec2, w: vec2):
        """n / L [1/m] and rate of turning [rad/s] of a block's link j for joint friction; 0 of an absent one."""
        lever, turn = link_turning(d, w)
        if wp.static(kind.links == "varied"):
            first, count = chains.chain_span(shared, j, n)
            exists = j - first + 1 != chains.chain_at(shared, j).absent
            return wp.where(exists, lever, vec2()), wp.where(exists, turn, Real(0.0))
        else:
            return lever, turn

    @wp.func
    def tension_and_turn_rate(rows: wp.array[Real], j: int):
        """Tension [N] and rate of turning [rad/s] of link j, from the block's rows."""
        return vec2(access.load(rows, TENSION + j), access.load(rows, TURN + j))

    @wp.func
    def held_moment(state: State, mine: ThreadParts, j: int):
        """Moment [N m] that the bristle of a block's joint j holds in the state."""
        return access.load(state.joint_hold, mine.first_roller + wp.min(j, mine.rollers - 1))

    @wp.func
    def joint_moment(shared: Shared, mine: ThreadParts, now: Now, j: int, held: Real):
        """Moment [N m] of joint j, and of its bristle, from `held` and the block's rows."""
        n, rows, stretched = mine.rollers, shared.rows, rollers.stretch_part(now)
        return moment_between_links(
            tension_and_turn_rate(rows, chains.previous_roller(shared, j, n)),
            tension_and_turn_rate(rows, j),
            held,
            chains.chain_at(shared, j),
            stretched,
        )

    @wp.func
    def keep_held_moment(state: State, mine: ThreadParts, now: Now, j: int, holds: Real):
        """Stores the moment [N m] that the bristle of a block's joint j holds."""
        if j < mine.rollers and now.stage == 0:
            access.store(state.joint_hold, mine.first_roller + j, holds)

    @wp.func
    def share_joint_moments(state: State, shared: Shared, mine: ThreadParts, now: Now, held: of_each):
        """Shares the moments of the thread's joints, in place of rates of turning."""
        moment = of_each()
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            moment_k, holds = joint_moment(shared, mine, now, j, held[k])
            keep_held_moment(state, mine, now, j, holds)
            moment[k] = moment_k
        sync.barrier()
        for k in range(rollers_per_thread):
            access.store(shared.rows, TURN + k * threads + mine.thread, moment[k])
        sync.barrier()

    @wp.func
    def link_couple(rows: wp.array[Real], j: int, next: int, lever: vec2):
        """Force [N] of the couple of link j's joints, from shared moments."""
        return couple_force(access.load(rows, TURN + j), access.load(rows, TURN + next), lever)

    @wp.func
    def store_couple(rows: wp.array[Real], j: int, x: Real, y: Real):
        """Stores the force [N] of the couple of a block's link j's joints, as float32."""
        if wp.static(kind.is_paired):
            access.store(rows, FIRST + j, x)
            access.store(rows, SECOND + j, y)
        else:
            access.store(rows, FIRST + j, float64_of_two(wp.float32(x), wp.float32(y)))

    @wp.func
    def load_couple(rows: wp.array[Real], j: int):
        """Force [N] of the couple of a block's link j's joints, from `store_couple`."""
        if wp.static(kind.is_paired):
            return wp.vec2f(access.load(rows, FIRST + j), access.load(rows, SECOND + j))
        else:
            return two_of_float64(access.load(rows, FIRST + j))

    @wp.func
    def find_link_forces(state: State, shared: Shared, mine: ThreadParts, now: Now, lengths: wp.array[Real]):
        """Sets the force on each of the thread's rollers of both its links and their joints; all threads together.

        Returns tension [N] and rate of elongation [m/s] of the thread's links.
        """
        n, i, rows = mine.rollers, mine.thread, shared.rows
        hold = of_each()
        tension = of_each()
        rate = of_each()
        lever_x = of_each()
        lever_y = of_each()
        pull_x = of_each()
        pull_y = of_each()
        for k in range(rollers_per_thread):
            j = k * threads + i
            # each before any is stored, as the compiler does not load across a store
            hold[k] = held_moment(state, mine, j)
            d, w = links.link_vector_and_velocity(shared, j, n)
            tension_k, rate_k, force = links.link_load_from_vector(
                shared, j, n, d, w, links.link_length(shared, lengths, j)
            )
            lever, turn = turning_of_link(shared, j, n, d, w)
            access.store(rows, TENSION + j, tension_k)
            access.store(rows, TURN + j, turn)
            tension[k] = tension_k
            rate[k] = rate_k
            lever_x[k] = lever[0]
            lever_y[k] = lever[1]
            pull_x[k] = force[0]
            pull_y[k] = force[1]
        sync.barrier()
        share_joint_moments(state, shared, mine, now, hold)
        for k in range(rollers_per_thread):
            j = k * threads + i
            couple = link_couple(rows, j, chains.next_roller(shared, j, n), vec2(lever_x[k], lever_y[k]))
            lever_x[k] = couple[0]
            lever_y[k] = couple[1]
            pull_x[k] = pull_x[k] + couple[0]
            pull_y[k] = pull_y[k] + couple[1]
        sync.barrier()
        for k in range(rollers_per_thread):
            rollers.set_force(shared, k * threads + i, vec2(pull_x[k], pull_y[k]))
        sync.barrier()
        for k in range(rollers_per_thread):
            j = k * threads + i
            if wp.static(kind.measuring):
                store_couple(rows, j, lever_x[k], lever_y[k])
            force = rollers.force(shared, chains.previous_roller(shared, j, n))
            pull_x[k] = pull_x[k] - force[0]
            pull_y[k] = pull_y[k] - force[1]
        sync.barrier()
        for k in range(rollers_per_thread):
            rollers.set_force(shared, k * threads + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    @wp.func
    def count_work(shared: Shared, at: int, work: Real):
        """Adds the work [J] that joint friction takes from a block's roller `at`."""
        access.store(shared.link_sums, FRICTION + at, access.load(shared.link_sums, FRICTION + at) - work)

    @wp.func
    def add_friction_work(shared: Shared, mine: ThreadParts, now: Now):
        """Adds the work of joint friction on the thread's rollers in this step, at their mean velocity."""
        rows = shared.rows
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            couple = load_couple(rows, j)
            couple_before = load_couple(rows, chains.previous_roller(shared, j, mine.rollers))
            v = rollers.velocity(rows, j)
            if wp.static(not kind.has_stages):
                v = v + Real(0.5) * rollers.time_step(mine) * rollers.acceleration(shared, j)
            of_roller = Real(couple[0] - couple_before[0]) * v[0] + Real(couple[1] - couple_before[1]) * v[1]
            if j < mine.rollers:
                count_work(shared, j, now.weight * of_roller)

    return JointFunctions(
        moment_between_links=moment_between_links,
        turning_of_link=turning_of_link,
        find_link_forces=find_link_forces,
        add_friction_work=add_friction_work,
    )
