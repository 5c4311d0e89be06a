"""The links of one variant on a block: their tensions, and their forces on the rollers at both ends."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..physics.link import link_chain, link_force, played_force
from ..rows import accessors
from ..structs import types
from .kind import BlockKind
from .roller_rows import roller_rows
from .sync import sync


def _less(subtract: str) -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    return {subtract}(value, other);
#else
    return value - other;
#endif
"""


@cache
def link_forces(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the links of one variant on a block."""
    Real, threads, rollers_per_thread = kind.Real, kind.threads, kind.rollers_per_thread
    kinds = types(Real)
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, barrier, load_row = roller_rows(kind), sync(kind).barrier, accessors(Real).load_row
    X, Y, VX, VY, X_LOW, Y_LOW = row.X, row.Y, row.VX, row.VY, row.X_LOW, row.Y_LOW
    force_on, set_force = row.force_on, row.set_force

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
        if wp.static(kind.varied_links):
            links = shared.links[0]
            tension, rate, u = played_force(d, v, length, links.play, link_chain(j, chain, links))
            return tension, rate, tension * u
        else:
            tension, rate, u = link_force(d, v, length, chain.stiffness, chain.damping)
            return tension, rate, tension * u

    @wp.func
    def length_of(shared: kinds.Shared, lengths: wp.array[Real], j: int):
        """Unloaded length of link j [m], the first of `lengths` being that of link 0."""
        if wp.static(kind.uniform_links):
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
    def pull(shared: kinds.Shared, lengths: wp.array[Real], n: int, i: int):
        """Makes the forces of both its links stand as each roller's; all threads together.

        Returns tension [N] and rate of elongation [m/s] of the thread's links. They are worked out one after the other
        without a branch, so that one's latency hides behind the others' work. A thread with one roller works out the
        link before it too, and waits for no other.
        """
        tension = of_each()
        rate = of_each()
        if wp.static(rollers_per_thread == 1):
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
                force = force_on(shared, before(k * wp.static(threads) + i, n))
                pull_x[k] = less(pull_x[k], force[0])
                pull_y[k] = less(pull_y[k], force[1])
            barrier()
            for k in range(wp.static(rollers_per_thread)):
                set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
        return tension, rate

    return namespace(across, link_between, length_of, link_of, before, pull)
