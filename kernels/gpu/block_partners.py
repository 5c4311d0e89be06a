"""Which sprockets and guide-bars the rollers of a block's threads are near, from step to step."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..structs import types
from .block_bits import block_bits
from .block_kind import BlockKind, Mine, now_struct
from .block_near import block_near


@dataclass(frozen=True)
class PartnerFunctions:
    """What is done about partners, as functions of kernels."""

    remembered: wp.Function
    meet: wp.Function


@cache
def block_partners(kind: BlockKind) -> PartnerFunctions:
    """The functions that keep up who is near what."""
    Real, threads, per, rk4 = kind.Real, kind.threads, kind.per, kind.rk4
    kinds, Now = types(Real), now_struct(Real)
    near, partners = block_near(kind).near, kind.sprockets + kind.guides
    bits = block_bits(kind)
    Bits, with_slot, differ, first, rest = bits.Bits, bits.with_slot, bits.differ, bits.first, bits.rest
    any_of, of_bars, both, without = bits.any_of, bits.of_bars, bits.both, bits.without

    @wp.func
    def remembered(state: kinds.State, mine: Mine):
        """The partners that the thread's rollers are near, as the state remembers it."""
        held = Bits()
        for k in range(wp.static(per)):
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
    def meet(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, held: Bits):
        """The partners that the thread's rollers are near now; `held` are those at the step before.

        Guide-bars are let go of at a step's start only.
        """
        found = Bits()
        for k in range(wp.static(per)):
            found = with_slot(found, k, near(shared, k * wp.static(threads) + mine.thread, mine.rollers))
        if wp.static(rk4):
            if now.stage != 0:
                found = both(found, of_bars(held))
        if differ(found, held):
            leave(state, mine, without(held, found))
        return found

    return PartnerFunctions(remembered=remembered, meet=meet)
