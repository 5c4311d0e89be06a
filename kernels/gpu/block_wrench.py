"""What a block's rollers do to bodies: each has its part of a body's moment and force, which a few threads add up."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..rows import accessors
from ..structs import Wrench, types
from .block_kind import BlockKind, Mine
from .block_room import parts_of_a_body
from .block_rows import block_rows
from .exchange import group, lanes, unforeseen


@dataclass(frozen=True)
class WrenchFunctions:
    """What acts on bodies, as functions of kernels."""

    add_wrench: wp.Function
    body_of: wp.Function
    acting_on: wp.Function
    wrench_of: wp.Function


@cache
def block_wrench(kind: BlockKind) -> WrenchFunctions:
    """The functions that add up what the rollers of one variant on a block do to its bodies."""
    Real, threads, bodies, moving = kind.Real, kind.threads, kind.bodies, kind.moving
    kinds = types(Real)
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    group_sum = block_rows(kind).sharing.group_sum
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    width = parts_of_a_body(kind)
    of_rollers = width != threads

    @wp.func
    def pushed(watched: int):
        """Whether the force on sprockets is wanted beside the moment."""
        if wp.static(moving):
            return True
        elif wp.static(kind.pushes):
            return watched != 0
        else:
            return False

    @wp.func
    def add_wrench(shared: kinds.Shared, mine: Mine, s: int, j: int, moment: Real, force: vec2, watched: int):
        """Adds the moment [N m] and the opposite of roller j's force [N] to its parts, or its thread's, of body s."""
        at = s * wp.static(width) + j
        if wp.static(not of_rollers):
            at = s * wp.static(width) + mine.thread
        store_row(shared.parts, at, load_row(shared.parts, at) + moment)
        if pushed(watched):
            x = at + wp.static(bodies * width)
            store_row(shared.parts, x, load_row(shared.parts, x) - force[0])
            y = at + wp.static(2 * bodies * width)
            store_row(shared.parts, y, load_row(shared.parts, y) - force[1])

    @wp.func
    def part(shared: kinds.Shared, row: int, i: int):
        """This thread's share of the sum of all parts in `row`, which start anew at zero."""
        value = Real(0.0)
        k = row * wp.static(width) + i % group()
        for q in range(lanes() // group()):
            of_lane = Real(0.0)
            for w in range(wp.static(width) // lanes()):
                at = k + w * lanes() + q * group()
                of_lane = of_lane + load_row(shared.parts, at)
                store_row(shared.parts, at, Real(0.0))
            value = value + of_lane
        return value

    @wp.func
    def crew():
        """Warps that move bodies: all, the last of which have the fewest rollers, or only the last, which has none."""
        if wp.static(kind.crewed and bodies <= 4):
            if lanes() > 1:
                return int(1)
        return wp.static(threads) // lanes()

    @wp.func
    def first_of(i: int):
        """The first body of thread i's warp, one that there is not where it has none."""
        place = wp.static(threads) // lanes() - 1 - i // lanes()
        return wp.where(place < crew(), place, wp.static(bodies))

    @wp.func
    def body_of(i: int):
        """The body that thread i moves, negative for most: each group of threads has one, if they are few."""
        s = first_of(i) + crew() * (i % lanes() // group() + lanes() // group() * (i % group()))
        return wp.where(s < wp.static(bodies), s, -1)

    @wp.func
    def last_row(watched: int):
        """The last of the rows of parts that are wanted: of moments, of forces in x and in y."""
        if wp.static(moving):
            return 2
        elif wp.static(kind.pushes):
            return wp.where(watched != 0, unforeseen(2), 0)
        else:
            return 0

    @wp.func
    def acting_on(shared: kinds.Shared, i: int, watched: int):
        """The chain's moment [N m] on the body that thread i moves and, if that is wanted, its force (x, y) [N].

        All threads together, between the barrier after the contacts and the next one. Forces are added up beside the
        moments, so that one's latencies hide behind the others' work.
        """
        acting = of_three()
        groups = lanes() // group()
        turn = int(0)
        first = first_of(i)
        while first < wp.static(bodies):
            s = first + crew() * (i % lanes() // group())
            value = of_three()
            k = last_row(watched)
            while k >= 0:
                of = Real(0.0)
                if s < wp.static(bodies):
                    of = part(shared, wp.static(bodies) * k + s, i)
                value = of_three(group_sum(of), value[0], value[1])
                k = k - 1
            if i % group() == turn:
                acting = value
            turn = turn + 1
            first = first + crew() * groups
        return acting

    @wp.func
    def wrench_of(acting: of_three):
        """What `acting_on` returns, in float64; the force where bodies move."""
        wrench = Wrench()
        wrench.moment = wp.float64(acting[0])
        if wp.static(moving):
            wrench.force = wp.vec2d(wp.float64(acting[1]), wp.float64(acting[2]))
        return wrench

    return WrenchFunctions(add_wrench=add_wrench, body_of=body_of, acting_on=acting_on, wrench_of=wrench_of)
