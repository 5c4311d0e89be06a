"""The sprockets and guides that the rollers of a block's threads may touch, from step to step."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..fast_math import inside
from ..namespace import namespace
from ..physics.guide import near_bar
from ..physics.profile import near_profile
from ..rows import accessors
from ..structs import types
from .geometry import contact_geometry
from .kind import BlockKind, Mine, now_struct
from .near_mask import near_mask
from .roller_rows import roller_rows
from .wheels import box_of, load_line


@cache
def near_partners(kind: BlockKind) -> SimpleNamespace:
    """The functions that keep up which partners are near; `SPROCKETS` are the bits of all sprockets."""
    Real, threads, rollers_per_thread = kind.Real, kind.threads, kind.rollers_per_thread
    sprockets, guides, profiles, partners = kind.sprockets, kind.guides, kind.profiles, kind.sprockets + kind.guides
    kinds, Now = types(Real), now_struct(Real)
    row, geometry, load_row = roller_rows(kind), contact_geometry(kind), accessors(Real).load_row
    X, Y, point, bar_of, in_carrier = row.X, row.Y, row.point, geometry.bar_of, geometry.in_carrier
    bits = near_mask(kind)
    Bits, with_slot, differ, first, rest = bits.Bits, bits.with_slot, bits.differ, bits.first, bits.rest
    any_of, of_bars, both, without = bits.any_of, bits.of_bars, bits.both, bits.without
    SPROCKETS = wp.constant((1 << sprockets) - 1)

    @wp.func
    def by_profile(bar: kinds.Guide):
        """Whether a guide has a profile."""
        if wp.static(profiles):
            return bar.pieces != 0
        else:
            return False

    @wp.func
    def in_box_of(shared: kinds.Shared, j: int, g: int, bar: kinds.Guide):
        """1 where roller j is in the box about the chord of guide g, a profile."""
        arm, q = in_carrier(shared, j, bar.body)
        if wp.static(kind.paired):
            return near_profile(q, load_line(shared.lines, g), box_of(shared.lines, g))
        else:
            return near_profile(q, bar)

    @wp.func
    def on_bar(shared: kinds.Shared, j: int, g: int, bar: kinds.Guide):
        """1 where roller j may touch guide g, a straight bar."""
        p = point(shared.rows, j)
        if wp.static(kind.paired):
            return near_bar(p, load_line(shared.lines, g), bar)
        else:
            return near_bar(p, bar)

    @wp.func
    def near(shared: kinds.Shared, j: int, n: int):
        """The partners that roller j may touch, as bits: sprockets whose band it is in, guides it is on."""
        x = load_row(shared.rows, X + j)
        y = load_row(shared.rows, Y + j)
        mask = int(0)
        for s in range(wp.static(sprockets)):
            band = shared.bands[s]
            from_x = x - band.center[0]
            from_y = y - band.center[1]
            square = from_x * from_x + from_y * from_y
            mask = mask | (inside(square, band.near_square, band.far_square) << s)
        for g in range(wp.static(guides)):
            bar = bar_of(shared, g)
            if by_profile(bar):
                mask = mask | (in_box_of(shared, j, g, bar) << (wp.static(sprockets) + g))
            else:
                mask = mask | (on_bar(shared, j, g, bar) << (wp.static(sprockets) + g))
        return wp.where(j < n, mask, 0)

    @wp.func
    def remembered(state: kinds.State, mine: Mine):
        """The partners that the thread's rollers are near, as the state remembers it."""
        held = Bits()
        for k in range(wp.static(rollers_per_thread)):
            j = k * wp.static(threads) + mine.thread
            if j < mine.rollers:
                found = int(0)
                for p in range(wp.static(partners)):
                    at = mine.memory + j + p * mine.rollers
                    if state.seat[at] >= 0 or state.impact_speed[at] != Real(0.0):
                        found = found | (1 << p)
                held = with_slot(held, k, found)
        return held

    @wp.func
    def leave(state: kinds.State, mine: Mine, left: Bits):
        """The thread's rollers are no longer near the partners `left`."""
        while any_of(left):
            j, p = first(left, mine.thread)
            left = rest(left)
            at = mine.memory + j + p * mine.rollers
            state.seat[at] = -1
            state.impact_speed[at] = Real(0.0)

    @wp.func
    def update_near(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, held: Bits):
        """The partners that the thread's rollers are near now; `held` are those at the step before.

        Guide-bars are let go of at a step's start only.
        """
        found = Bits()
        for k in range(wp.static(rollers_per_thread)):
            found = with_slot(found, k, near(shared, k * wp.static(threads) + mine.thread, mine.rollers))
        if wp.static(kind.rk4):
            if now.stage != 0:
                found = both(found, of_bars(held))
        if differ(found, held):
            leave(state, mine, without(held, found))
        return found

    return namespace(remembered, update_near, SPROCKETS=SPROCKETS)
