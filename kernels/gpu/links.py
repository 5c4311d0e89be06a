"""Links of one variant on a block: tensions, and forces on the rollers at both ends."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.link import link_force, uneven_link_force
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .rollers import roller_functions, roller_rows
from .sync import sync_functions


@dataclass(frozen=True)
class LinkFunctions:
    """Link functions of a block."""

    link_vector_and_velocity: wp.Function
    link_load_from_vector: wp.Function
    link_length: wp.Function
    link_load: wp.Function
    find_link_forces: wp.Function


@cache
def link_functions(kind: BlockKind) -> LinkFunctions:
    """Link functions of block kernels."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds = kind.types
    Shared = kinds.Shared
    vec2 = kinds.vec2
    of_each = wp.types.vector(rollers_per_thread, Real)
    chains = chain_functions(kind)
    access = row_access(Real)
    rollers, row = roller_functions(kind), roller_rows(kind)
    sync = sync_functions(kind)

    @wp.func
    def link_vector_and_velocity(shared: Shared, j: int, n: int):
        """Vector [m] of a block's link j to the next roller, exact at float32 too, and relative velocity [m/s]."""
        rows = shared.rows
        next = chains.next_roller(shared, j, n)
        d = vec2(
            access.load(rows, row.x + next) - access.load(rows, row.x + j),
            access.load(rows, row.y + next) - access.load(rows, row.y + j),
        )
        if wp.static(kind.is_paired):
            d = d + vec2(
                access.load(rows, row.x_low + next) - access.load(rows, row.x_low + j),
                access.load(rows, row.y_low + next) - access.load(rows, row.y_low + j),
            )
        v = vec2(
            access.load(rows, row.vx + next) - access.load(rows, row.vx + j),
            access.load(rows, row.vy + next) - access.load(rows, row.vy + j),
        )
        return d, v

    @wp.func
    def link_load_from_vector(shared: Shared, j: int, n: int, d: vec2, v: vec2, length: Real):
        """Tension [N], rate of elongation [m/s] and force [N] on roller j of a block's link j, eq. (2), (3)."""
        if wp.static(kind.links == "varied"):
            first, count = chains.chain_span(shared, j, n)
            tension, rate, u = uneven_link_force(d, v, length, j - first, chains.chain_at(shared, j))
            return tension, rate, tension * u
        else:
            chain = chains.chain_at(shared, j)
            tension, rate, u = link_force(d, v, length, chain)
            return tension, rate, tension * u

    @wp.func
    def link_length(shared: Shared, lengths: wp.array[Real], j: int):
        """Unloaded length [m] of a block's link j; `lengths` begin with link 0."""
        if wp.static(kind.links == "alike"):
            return chains.chain_at(shared, j).length
        else:
            return access.load(lengths, j)

    @wp.func
    def link_load(shared: Shared, j: int, n: int, length: Real):
        """Tension [N], rate of elongation [m/s] and force [N] on roller j of a block's link j, at its present place."""
        d, v = link_vector_and_velocity(shared, j, n)
        return link_load_from_vector(shared, j, n, d, v, length)

    @wp.func
    def find_link_forces(
        state: kinds.State, shared: Shared, mine: ThreadParts, now: kinds.Now, lengths: wp.array[Real]
    ):
        """Sets the force of both its links on each of the thread's rollers; all threads together.

        Returns tension [N] and rate of elongation [m/s] of the thread's links.
        """
        n, i = mine.rollers, mine.thread
        tension = of_each()
        rate = of_each()
        if wp.static(rollers_per_thread == 1):
            if i < n:
                tension_i, rate_i, force = link_load(shared, i, n, link_length(shared, lengths, i))
                h = chains.previous_roller(shared, i, n)
                tension_h, rate_h, force_h = link_load(shared, h, n, link_length(shared, lengths, h))
                rollers.set_force(shared, i, force - force_h)
                tension[0] = tension_i
                rate[0] = rate_i
        else:
            pull_x = of_each()
            pull_y = of_each()
            for k in range(rollers_per_thread):
                j = k * threads + i
                tension_k, rate_k, force = link_load(shared, j, n, link_length(shared, lengths, j))
                rollers.set_force(shared, j, force)
                tension[k] = tension_k
                rate[k] = rate_k
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            sync.barrier()
            for k in range(rollers_per_thread):
                force = rollers.force(shared, chains.previous_roller(shared, k * threads + i, n))
                pull_x[k] = pull_x[k] - force[0]
                pull_y[k] = pull_y[k] - force[1]
            sync.barrier()
            for k in range(rollers_per_thread):
                rollers.set_force(shared, k * threads + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    return LinkFunctions(
        link_vector_and_velocity=link_vector_and_velocity,
        link_load_from_vector=link_load_from_vector,
        link_length=link_length,
        link_load=link_load,
        find_link_forces=find_link_forces,
    )
