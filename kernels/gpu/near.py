"""The sprockets and guides that the rollers of a block's threads may touch, from step to step."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import inside, products
from ..physics.guide import coarse_frame_vector, is_near_bar, is_near_profile
from .geometry import contact_geometry
from .kind import BITS, BlockKind, Mine
from .rings import block_rings
from .rollers import roller_rows
from .sync import lowest_bit


@cache
def near_mask(kind: BlockKind) -> SimpleNamespace:
    """The bits of a thread's rollers."""
    threads, rollers_per_thread, sprockets = kind.shape.threads, kind.shape.rollers_per_thread, kind.parts.sprockets
    partners = sprockets + kind.parts.guides
    slots = BITS // partners
    words = -(-rollers_per_thread // slots)
    Bits = wp.types.vector(words, wp.int32)
    TEETH = sum(((1 << sprockets) - 1) << k * partners for k in range(min(slots, rollers_per_thread)))
    BARS = sum(((1 << partners) - (1 << sprockets)) << k * partners for k in range(min(slots, rollers_per_thread)))

    @wp.func
    def with_slot(bits: Bits, k: int, near: int):
        """`bits` with those of the thread's roller k, which has none yet: the partners that it is near."""
        bits[k // wp.static(slots)] = bits[k // wp.static(slots)] | (
            near << (k % wp.static(slots) * wp.static(partners))
        )
        return bits

    @wp.func
    def any_of(bits: Bits):
        """Whether there are any."""
        found = int(0)
        for q in range(wp.static(words)):
            found = found | bits[q]
        return found != 0

    @wp.func
    def of_teeth(bits: Bits):
        """Those of sprockets."""
        return bits & Bits(wp.static(TEETH))

    @wp.func
    def of_bars(bits: Bits):
        """Those of guide-bars."""
        return bits & Bits(wp.static(BARS))

    @wp.func
    def first_number(bits: Bits):
        """The first number that has bits, where there are any."""
        q = int(wp.static(words - 1))
        for back in range(wp.static(words - 1)):
            if bits[wp.static(words - 2) - back] != 0:
                q = wp.static(words - 2) - back
        return q

    @wp.func
    def first(bits: Bits, i: int):
        """The first roller of thread i that has a bit, and the first of its partners; there are some."""
        if wp.static(rollers_per_thread == 1):
            return i, lowest_bit(bits[0])
        else:
            q = first_number(bits)
            number = int(bits[0])
            for other in range(1, wp.static(words)):
                number = wp.where(q == other, bits[other], number)
            b = lowest_bit(number)
            k = b // wp.static(partners)
            return (q * wp.static(slots) + k) * wp.static(threads) + i, b - k * wp.static(partners)

    @wp.func
    def rest(bits: Bits):
        """`bits` without the first."""
        q = first_number(bits)
        for other in range(wp.static(words)):
            if q == other:
                bits[other] = bits[other] & (bits[other] - 1)
        return bits

    return SimpleNamespace(**locals())


@cache
def near_partners(kind: BlockKind) -> SimpleNamespace:
    """The functions that keep up which partners are near; `SPROCKETS` are the bits of all sprockets."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets, guides, profiles = kind.parts.sprockets, kind.parts.guides, kind.profiles
    partners = kind.parts.sprockets + kind.parts.guides
    kinds, Now = kind.types, kind.types.Now
    State, Shared, Guide = kinds.State, kinds.Shared, kinds.Guide
    row, geometry, of_each = roller_rows(kind), contact_geometry(kind), wp.types.vector(rollers_per_thread, wp.int32)
    point, position, arm_on, guide_at = row.point, row.position, geometry.arm_on, geometry.guide_at
    bits = near_mask(kind)
    Bits, with_slot, any_of, of_bars = bits.Bits, bits.with_slot, bits.any_of, bits.of_bars
    first, rest = bits.first, bits.rest
    memory_of, partners_of = block_rings(kind).memory_of, block_rings(kind).partners_of
    SPROCKETS = wp.constant((1 << sprockets) - 1)

    @wp.func
    def by_profile(bar: Guide):
        """Whether a guide has a profile."""
        if wp.static(profiles):
            return bar.pieces != 0
        else:
            return False

    @wp.func
    def in_box_of(shared: Shared, j: int, bar: Guide):
        """1 where roller j is in the box about the chord of a guide, a profile."""
        q = arm_on(shared, j, bar.body)
        if bar.body < wp.static(kind.parts.bodies):  # the ground has not turned
            q = coarse_frame_vector(q, shared.poses[bar.body])
        return is_near_profile(q, bar)

    @wp.func
    def near(shared: Shared, mine: Mine):
        """The partners that each of the thread's rollers may touch, as bits: sprockets whose band it is in, guides it
        is on. Each partner is read once for all rollers.
        """
        found = of_each()
        s = int(0)  # loops that Warp does not unroll, or many partners would take minutes to compile
        while s < wp.static(sprockets):
            band = shared.bands[s]
            for k in range(wp.static(rollers_per_thread)):
                p = position(shared.rows, k * wp.static(threads) + mine.thread)
                from_x = p[0] - band.center[0]
                from_y = p[1] - band.center[1]
                square = products(from_x, from_x, from_y, from_y)
                found[k] = found[k] | (inside(square, band.near_square, band.far_square) << s)
            s = s + 1
        g = int(0)
        while g < wp.static(guides):
            bar = guide_at(shared, g)
            for k in range(wp.static(rollers_per_thread)):
                j = k * wp.static(threads) + mine.thread
                if by_profile(bar):
                    found[k] = found[k] | (in_box_of(shared, j, bar) << (wp.static(sprockets) + g))
                else:
                    found[k] = found[k] | (is_near_bar(point(shared.rows, j), bar) << (wp.static(sprockets) + g))
            g = g + 1
        return found

    @wp.func
    def remembered(state: State, shared: Shared, mine: Mine):
        """The partners that the thread's rollers are near, as the state remembers it."""
        held = Bits()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            if j < mine.rollers:
                found = int(0)
                p = int(0)
                while p < wp.static(partners):
                    at = memory_of(shared, mine, j, p)
                    if state.seat[at] >= 0 or state.impact_speed[at] != Real(0.0):
                        found = found | (1 << p)
                    p = p + 1
                held = with_slot(held, k, partners_of(shared, j, found))
        return held

    @wp.func
    def leave(state: State, shared: Shared, mine: Mine, left: Bits):
        """The thread's rollers are no longer near the partners `left`."""
        while any_of(left):
            j, p = first(left, mine.thread)
            left = rest(left)
            at = memory_of(shared, mine, j, p)
            state.seat[at] = -1
            state.impact_speed[at] = Real(0.0)

    @wp.func
    def update_near(state: State, shared: Shared, mine: Mine, now: Now, held: Bits):
        """The partners that the thread's rollers are near now; `held` are those at the step before.

        Guide-bars are let go of at a step's start only.
        """
        partners_near = near(shared, mine)
        found = Bits()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            found = with_slot(found, k, wp.where(j < mine.rollers, partners_of(shared, j, partners_near[k]), 0))
        if wp.static(kind.staged):
            if now.stage != 0:
                found = found | of_bars(held)
        if not (found == held):
            leave(state, shared, mine, held & ~found)
        return found

    return SimpleNamespace(**locals())
