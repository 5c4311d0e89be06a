"""What a block's rollers do to bodies: each has its part of a body's moment and force, which a few threads add up."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..rows import accessors
from ..structs import Wrench, types
from .kind import WARP, BlockKind, Mine
from .shared_memory import parts_of_a_body
from .sync import group, lanes, sync


@cache
def wrench_parts(kind: BlockKind) -> SimpleNamespace:
    """The functions that add up what the rollers of one variant on a block do to its bodies."""
    Real, threads, bodies, moving = kind.Real, kind.threads, kind.bodies, kind.moving
    kinds = types(Real)
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    group_sum = sync(kind).group_sum
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
    def place_of(mine: Mine, k: int, s: int, j: int):
        """Where roller j's part of body s, or its thread's, lies in row k: of moments, forces in x, forces in y."""
        first = (wp.static(bodies) * k + s) * wp.static(width)
        if wp.static(of_rollers):
            return first + j
        else:
            return first + mine.thread

    @wp.func
    def add_part(shared: kinds.Shared, at: int, value: Real):
        """Adds `value` to the part at `at`."""
        store_row(shared.parts, at, load_row(shared.parts, at) + value)

    @wp.func
    def add_moment(shared: kinds.Shared, mine: Mine, s: int, j: int, moment: Real):
        """Adds the moment [N m] of roller j's force to body s."""
        add_part(shared, place_of(mine, 0, s, j), moment)

    @wp.func
    def add_push(shared: kinds.Shared, mine: Mine, s: int, j: int, force: vec2):
        """Adds the opposite of roller j's force [N] to body s."""
        add_part(shared, place_of(mine, 1, s, j), -force[0])
        add_part(shared, place_of(mine, 2, s, j), -force[1])

    @wp.func
    def add_wrench(shared: kinds.Shared, mine: Mine, s: int, j: int, moment: Real, force: vec2, watched: int):
        """Adds the moment [N m] and, if that is wanted, the opposite of roller j's force [N] to body s."""
        add_moment(shared, mine, s, j, moment)
        if pushed(watched):
            add_push(shared, mine, s, j, force)

    @wp.func
    def part(shared: kinds.Shared, s: int, k: int, i: int):
        """This thread's share of the sum of all parts of body s, if there is one, in row k; they start anew at zero.

        What is no body reads another's: so no thread waits for one that takes a branch.
        """
        value = Real(0.0)
        first = (wp.static(bodies) * k + wp.min(s, wp.static(bodies - 1))) * wp.static(width) + i % group()
        for q in range(lanes() // group()):
            of_lane = Real(0.0)
            for w in range(wp.static(width) // lanes()):
                of_lane = of_lane + load_row(shared.parts, first + w * lanes() + q * group())
            value = value + of_lane
        if s < wp.static(bodies):
            for w in range(wp.static(width) // group()):
                store_row(shared.parts, first + w * group(), Real(0.0))
        return value

    @wp.func
    def crew():
        """Warps that move bodies: all, the last of which have the fewest rollers, or only the last, which has none."""
        if wp.static(kind.body_warp and bodies <= 4):
            if lanes() > 1:
                return int(1)
        return wp.static(threads) // lanes()

    @wp.func
    def first_of(i: int):
        """The first body of thread i's warp, one that there is not where it has none."""
        if wp.static(threads == WARP):
            if lanes() > 1:
                return int(0)
        place = wp.static(threads) // lanes() - 1 - i // lanes()
        return wp.where(place < crew(), place, wp.static(bodies))

    @wp.func
    def body_of(i: int):
        """The body that thread i moves, negative for most: each group of threads has one, if they are few."""
        s = first_of(i) + crew() * (i % lanes() // group() + lanes() // group() * (i % group()))
        return wp.where(s < wp.static(bodies), s, -1)

    @wp.func
    def sum_of(shared: kinds.Shared, k: int, i: int):
        """Row k of what acts on the body that thread i moves: moment [N m], force in x, in y [N].

        All threads together, between the barrier after the contacts and the next one.
        """
        acting = Real(0.0)
        turn = int(0)
        first = first_of(i)
        while first < wp.static(bodies):
            value = group_sum(part(shared, first + crew() * (i % lanes() // group()), k, i))
            if i % group() == turn:
                acting = value
            turn = turn + 1
            first = first + crew() * (lanes() // group())
        return acting

    @wp.func
    def moment_on(shared: kinds.Shared, i: int):
        """The chain's moment on the body that thread i moves [N m]; all threads together, as `sum_of`."""
        return sum_of(shared, 0, i)

    @wp.func
    def acting_on(shared: kinds.Shared, i: int, moment: Real, watched: int):
        """That moment and, if it is wanted, the chain's force (x, y) [N]; all threads together, as `sum_of`."""
        acting = of_three()
        acting[0] = moment
        if pushed(watched):
            acting[1] = sum_of(shared, 1, i)
            acting[2] = sum_of(shared, 2, i)
        return acting

    @wp.func
    def wrench_of(acting: of_three):
        """What `acting_on` returns, in float64; the force where bodies move."""
        wrench = Wrench()
        wrench.moment = wp.float64(acting[0])
        if wp.static(moving):
            wrench.force = wp.vec2d(wp.float64(acting[1]), wp.float64(acting[2]))
        return wrench

    return namespace(add_moment, add_push, add_wrench, body_of, moment_on, acting_on, wrench_of)
