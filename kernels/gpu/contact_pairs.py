"""The block kernels' contacts: forces of teeth and guide-bars on the rollers that touch them.

A contact's memory (seat, v0) and its sums stay where the state and the tallies have them, which the cache holds.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..structs import Tallies
from .guides import guide_contacts
from .kind import BlockKind, Mine
from .near import near_mask
from .sync import lowest_bit
from .teeth import tooth_contacts, tooth_gaps


@cache
def contact_forces(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the contacts of one variant on a block."""
    guides, gripping = kind.parts.guides, kind.gripping
    # most contacts of the usual law are worked out without branches, in kernels of one length of chain all or none, so
    # that metrics leave a variant its bits: of more links not all kernels gave the same bits (docs/performance.md)
    branchless = kind.linear_hysteretic and kind.shape.room <= 192
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    bits, gaps, teeth, at_bars = near_mask(kind), tooth_gaps(kind), tooth_contacts(kind), guide_contacts(kind).at_bars
    of_teeth, any_of, first, rest = bits.of_teeth, bits.any_of, bits.first, bits.rest
    Touch, looked_up = teeth.Touch, gaps.looked_up
    at_sprocket, on_straight_flank = teeth.at_sprocket, teeth.on_straight_flank

    @wp.func
    def contacts(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: Mine, now: Now, touch: Touch
    ):
        """Adds the contacts' forces to those of the thread's rollers.

        Each thread goes on to its next roller in teeth at once, so that few wait.
        """
        by_teeth = of_teeth(touch.near)
        while any_of(by_teeth):
            j, s = first(by_teeth, mine.thread)
            by_teeth = rest(by_teeth)
            if wp.static(not gripping):
                touch = looked_up(ensemble, state, shared, mine, touch, j, s)
            done = int(0)
            if wp.static(branchless):
                if now.flags == 0:
                    done = on_straight_flank(state, tallies, shared, mine, now, j, touch)
            if done == 0:
                at_sprocket(ensemble, state, tallies, shared, mine, now, j, touch)
            if wp.static(gripping):
                if any_of(by_teeth):
                    touch = looked_up(ensemble, state, shared, mine, touch, j, lowest_bit(by_teeth[0]))
        if wp.static(guides > 0):
            at_bars(ensemble, state, tallies, shared, mine, now, touch.near)

    touch_of = gaps.touch_of
    return SimpleNamespace(**locals())
