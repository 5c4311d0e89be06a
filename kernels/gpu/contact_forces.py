"""All contact forces of a block's rollers: of teeth and guide-bars, and of goods.

A contact's memory (seat, v0) and sums stay in global memory.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..structs import Tallies
from .backs import back_functions
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .contacts import contact_functions
from .guides import guide_functions
from .partner_bits import partner_bit_functions
from .strand_loads import strand_load_functions
from .teeth import tooth_functions
from .toe_rows import toe_row_functions
from .toes import toe_functions
from .tooth_gaps import tooth_gap_functions


@dataclass(frozen=True)
class ContactForceFunctions:
    """Contact force functions of a block."""

    add_contact_forces: wp.Function


@cache
def contact_force_functions(kind: BlockKind) -> ContactForceFunctions:
    """Contact force functions of block kernels."""
    # most contacts of the usual law are worked out without branches, in kernels of one length of chain all or none, so
    # that metrics leave a variant its bits: of more links not all kernels gave the same bits (docs/performance.md)
    branchless = kind.linear_hysteretic and kind.shape.room <= 192 and not kind.silent
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    contacts = contact_functions(kind)
    partner_bits = partner_bit_functions(kind)
    tooth_gaps = tooth_gap_functions(kind)
    teeth = tooth_functions(kind)
    guides = guide_functions(kind)
    strand_loads = strand_load_functions(kind)
    toes, toe_rows, backs = toe_functions(kind), toe_row_functions(kind), back_functions(kind)

    @inlined
    def add_contact_forces(
        ensemble: Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """Adds contact forces, and those of goods that come on, to the forces on the thread's rollers."""
        if wp.static(kind.links == "varied"):
            strand_loads.add_feed_forces(shared, mine)
        if wp.static(kind.silent):
            toe_rows.clear_forces(shared, mine)
            toes.add_toe_forces(ensemble, state, tallies, shared, mine, now, near)
        contact = contacts.Contact()
        by_teeth = partner_bits.of_sprockets(near)
        while partner_bits.has_any(by_teeth):
            j, s = partner_bits.first_pair(by_teeth, mine.thread)
            by_teeth = partner_bits.without_first_pair(by_teeth)
            if wp.static(kind.silent):
                if toe_rows.is_silent(shared, j):
                    continue
            contact = tooth_gaps.with_sprocket(ensemble, state, shared, mine, contact, j, s)
            done = int(0)
            if wp.static(branchless):
                if now.flags == 0:
                    done = teeth.add_straight_flank_force(state, tallies, shared, mine, now, j, contact)
            if done == 0:
                teeth.add_tooth_force(ensemble, state, tallies, shared, mine, now, j, contact)
        if wp.static(kind.silent):
            if wp.static(kind.parts.guides):
                backs.add_back_forces(ensemble, state, tallies, shared, mine, now, near)
            toe_rows.join_forces(state, tallies, shared, mine, now)
        if wp.static(kind.parts.guides):
            guides.add_guide_forces(ensemble, state, tallies, shared, mine, now, near)

    return ContactForceFunctions(add_contact_forces=add_contact_forces)
