"""The block kernels' contacts: forces of teeth and guide-bars on the rollers that touch them.

A contact's memory (seat, v0) and its sums stay where the state and the tallies have them, which the cache holds.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..structs import types
from ..sum_structs import Tallies
from .guide_contacts import guide_contacts
from .kind import BlockKind, Mine, now_struct
from .near_mask import near_mask
from .sync import lowest_bit
from .tooth_contacts import tooth_contacts
from .tooth_gaps import tooth_gaps


@cache
def contact_forces(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the contacts of one variant on a block."""
    Real, guides, gripping, quick = kind.Real, kind.guides, kind.gripping, kind.quick
    kinds, Now = types(Real), now_struct(Real)
    bits, gaps, teeth, at_bars = near_mask(kind), tooth_gaps(kind), tooth_contacts(kind), guide_contacts(kind).at_bars
    Bits, of_teeth, any_of, first, rest = bits.Bits, bits.of_teeth, bits.any_of, bits.first, bits.rest
    Grip, grip_of, Answer, answer_of = gaps.Grip, gaps.grip_of, teeth.Answer, teeth.answer_of
    at_sprocket, answered, is_quick = teeth.at_sprocket, teeth.answered, teeth.is_quick

    @wp.struct
    class Touch:
        """The partners that a thread's rollers are near (`update_near`), and what is looked up ahead of them."""

        near: Bits
        grip: Grip  # of the roller's first sprocket

    @wp.func
    def touch_of(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, near: Bits):
        """What the thread's rollers may touch."""
        touch = Touch()
        touch.near = near
        if wp.static(gripping):  # without a branch, so that nothing waits for it
            by_teeth = of_teeth(near)[0]
            s = lowest_bit(wp.where(by_teeth != 0, by_teeth, 1))
            touch.grip = grip_of(ensemble, state, shared, mine, mine.thread, s)
        return touch

    @wp.func
    def contacts(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: Touch,
    ):
        """Adds the contacts' forces to those of the thread's rollers.

        Each thread goes on to its next roller in teeth at once, so that few wait.
        """
        by_teeth = of_teeth(touch.near)
        grip = touch.grip
        while any_of(by_teeth):
            j, s = first(by_teeth, mine.thread)
            by_teeth = rest(by_teeth)
            if wp.static(gripping):
                s = grip.sprocket
            else:
                grip = grip_of(ensemble, state, shared, mine, j, s)
            one = Answer()
            if wp.static(quick):
                if is_quick(now, s):
                    one = answer_of(ensemble, state, shared, mine, j, grip)
                    one.applies = wp.where(now.flags == 0, one.applies, 0)
            if one.applies != 0:
                answered(state, tallies, shared, mine, now, j, s, one)
            else:
                at_sprocket(ensemble, state, tallies, shared, mine, now, j, grip)
            if wp.static(gripping):
                if any_of(by_teeth):
                    grip = grip_of(ensemble, state, shared, mine, j, lowest_bit(by_teeth[0]))
        if wp.static(guides > 0):
            at_bars(ensemble, state, tallies, shared, mine, now, touch.near)

    @wp.func
    def contacts_by_two(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: Touch,
    ):
        """As `contacts`, two of a thread's rollers in teeth at once, so that their latencies hide behind each other."""
        by_teeth = of_teeth(touch.near)
        while any_of(by_teeth):
            j, s = first(by_teeth, mine.thread)
            by_teeth = rest(by_teeth)
            two = int(0)
            other_j = int(j)
            other_s = int(s)
            if any_of(by_teeth):
                two = int(1)
                other_j, other_s = first(by_teeth, mine.thread)
                by_teeth = rest(by_teeth)
            one = answer_of(ensemble, state, shared, mine, j, grip_of(ensemble, state, shared, mine, j, s))
            grip = grip_of(ensemble, state, shared, mine, other_j, other_s)
            other = answer_of(ensemble, state, shared, mine, other_j, grip)
            one.applies = wp.where(is_quick(now, s), one.applies, 0)
            other.applies = wp.where(is_quick(now, other_s), other.applies, 0)
            if one.applies & other.applies != 0:
                answered(state, tallies, shared, mine, now, j, s, one)
                if two != 0:
                    answered(state, tallies, shared, mine, now, other_j, other_s, other)
            else:
                q = int(0)
                while q <= two:  # a loop, which stands once in the code
                    if one.applies != 0:
                        answered(state, tallies, shared, mine, now, j, s, one)
                    else:
                        at_sprocket(
                            ensemble, state, tallies, shared, mine, now, j, grip_of(ensemble, state, shared, mine, j, s)
                        )
                    one = other
                    j = other_j
                    s = other_s
                    q = q + 1
        if wp.static(guides > 0):
            at_bars(ensemble, state, tallies, shared, mine, now, touch.near)

    plain_contacts = contacts_by_two if kind.low_occupancy and kind.rollers_per_thread > 1 else contacts
    return namespace(Touch, touch_of, contacts, teeth.linear_hysteretic_laws, plain_contacts=plain_contacts)
