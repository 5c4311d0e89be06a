"""Which sprockets and guide-bars the rollers of a block's threads are near, from step to step."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..structs import types
from .block_kind import WARP, BlockKind, Mine, now_struct
from .block_near import block_near
from .exchange import lowest_bit


@dataclass(frozen=True)
class PartnerFunctions:
    """What is done about partners, as functions of kernels."""

    held_by: wp.Function
    meet: wp.Function


@cache
def block_partners(kind: BlockKind) -> PartnerFunctions:
    """The functions that keep up who is near what; partners are bits, sprockets before guide-bars."""
    Real, threads, per, rk4 = kind.Real, kind.threads, kind.per, kind.rk4
    kinds, Now = types(Real), now_struct(Real)
    whole_numbers = wp.types.vector(per, wp.int32)
    # on one warp threads have enough in registers: who was near what is read where it is shared
    shares = kind.measuring or threads == WARP
    near, SPROCKETS = block_near(kind).near, block_near(kind).SPROCKETS

    @wp.func
    def leave(state: kinds.State, memory: int, n: int, left: int):
        """A roller is no longer near the partners `left`, as bits; its memory with the first begins at `memory`."""
        while left != 0:
            at = memory + lowest_bit(left) * n
            left = left & (left - 1)
            state.seat[at] = -1
            state.impact_speed[at] = Real(0.0)

    @wp.func
    def held_by(shared: kinds.Shared, i: int):
        """The partners of each of thread i's rollers."""
        held = whole_numbers()
        for k in range(wp.static(per)):
            held[k] = shared.held[k * wp.static(threads) + i]
        return held

    @wp.func
    def partners_of(shared: kinds.Shared, j: int, n: int, held: int, stage: int):
        """The partners that roller j may touch; guide-bars are let go of at a step's start only."""
        partners = near(shared, j, n)
        if wp.static(rk4):
            if stage != 0:
                partners = partners | (held & ~SPROCKETS)
        return partners

    @wp.func
    def meet(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, held: whole_numbers):
        """Brings up to date what the thread's rollers are near.

        Returns the partners of each, and the thread's rollers near sprockets and near guide-bars, bits of their slots;
        where a thread has one roller, its sprockets and its guide-bars, bits of partners.
        """
        n = mine.rollers
        next_held = whole_numbers()
        by_teeth = int(0)
        by_bar = int(0)
        changed = int(0)
        for k in range(wp.static(per)):
            j = k * wp.static(threads) + mine.thread
            before = held[k]
            if wp.static(shares):
                before = shared.held[j]
            partners = partners_of(shared, j, n, before, now.stage)
            if wp.static(per == 1):
                by_teeth = partners & SPROCKETS
                by_bar = partners & ~SPROCKETS
            else:
                by_teeth = by_teeth | wp.where(partners & SPROCKETS != 0, (1 << k), 0)
                by_bar = by_bar | wp.where(partners & ~SPROCKETS != 0, (1 << k), 0)
            changed = changed | (partners ^ before)
            if wp.static(not shares):
                next_held[k] = partners
        if changed != 0:
            j = int(mine.thread)
            while j < n:
                partners = partners_of(shared, j, n, shared.held[j], now.stage)
                leave(state, mine.memory + j, n, shared.held[j] & ~partners)
                shared.held[j] = partners
                j = j + wp.static(threads)
            if wp.static(not shares):
                for k in range(wp.static(per)):
                    held[k] = next_held[k]
        return held, by_teeth, by_bar

    return PartnerFunctions(held_by=held_by, meet=meet)
