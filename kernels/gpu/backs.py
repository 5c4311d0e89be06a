"""The contacts of the backs of a block's silent chains with guides (`physics.back`)."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import aligned_rows, row_access
from ..number import add, difference, leading_value  # noqa: F401
from ..physics.back import back_contact, back_guide, crown_bar_contact, crown_piece_contact, wheelward_normal
from ..physics.contact import AWAY, MISSED, UNTOUCHED, has_missed_face, rotated_vector
from ..physics.guide import coarse_frame_vector, tracked_piece
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .geometry import geometry_functions
from .link_contacts import link_contact_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions
from .shared_memory import force_rows
from .toe_links import toe_link_functions
from .toe_rows import toe_row_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class BackFunctions:
    """Contacts of one variant's backs with guides."""

    add_back_forces: wp.Function


@cache
def back_functions(kind: BlockKind) -> BackFunctions:
    """The functions that evaluate contacts of backs with the guides of one variant on a block."""
    Real, sprockets, body_count = kind.Real, kind.parts.sprockets, kind.parts.bodies
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Guide = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Guide
    vec2 = kinds.vec2
    row = force_rows(kind)
    access, whole_access = row_access(Real), row_access(wp.int32)
    rows_of_pieces = aligned_rows(kinds.Piece)
    chains, geometry, rollers = chain_functions(kind), geometry_functions(kind), roller_functions(kind)
    partner_bits, wrench_parts = partner_bit_functions(kind), wrench_part_functions(kind)
    link_contacts = link_contact_functions(kind)
    toe_links, toe_rows = toe_link_functions(kind), toe_row_functions(kind)

    @wp.func
    def crown_contact(ensemble: Ensemble, state: State, shared: Shared, at: int, top: Any, across: vec2, bar: Guide):
        """Penetration [m] and normal of a crown with its top at `top` [m]; its piece of a profile is kept at `at`."""
        if wp.static(kind.profiles):
            if bar.pieces != 0:
                body, pieces = shared.poses[bar.body], rows_of_pieces(ensemble.pieces)
                arm, q = geometry.arm_and_carrier_coordinates(shared, top, bar.body)
                w = coarse_frame_vector(across, body)
                center = q + bar.back_radius * w
                kept = whole_access.load(state.seat, at)
                number = tracked_piece(center, kept, bar, pieces)
                if number != kept:
                    whole_access.store(state.seat, at, number)
                penetration, normal = crown_piece_contact(q, center, w, number, bar, pieces)
                return penetration, rotated_vector(normal, leading_value(body.cosine), leading_value(body.sine))
        return crown_bar_contact(difference(top, bar.start), across, bar)

    @wp.func
    def add_back_force(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, g: int
    ):
        """Adds the force of guide g on the back after pin j to rows, and its reaction to the body that carries it."""
        bar = back_guide(geometry.guide_now(shared, g))
        other, pin = chains.next_roller(shared, j, mine.rollers), rollers.exact_position(shared.rows, j)
        center = toe_links.partner_pose(shared, sprockets + g).center
        end = link_contacts.LinkContact()
        end.number = j
        end.partner = sprockets + g
        end.memory = chains.contact_memory(shared, mine, j, end.partner)
        end.link = toe_links.link_of_pin(shared, j, other, leading_value(difference(pin, center)))
        end.before = access.load(state.impact_speed, end.memory)
        end.pushed = access.load(state.push, chains.push_memory(shared, mine, j, end.memory))
        end.damper_speed = access.load(state.damper_speed, end.memory)
        u, length = end.link.u, end.link.length
        across = wheelward_normal(u, shared.plates[chains.chain_number(shared, j)].side)
        top = pin + (Real(0.5) * length * u - bar.roller_radius * across)
        penetration, normal = crown_contact(ensemble, state, shared, end.memory, top, across, bar)
        depth, z = back_contact(penetration, normal, u, across, length, bar)
        end.open_speed = Real(UNTOUCHED)
        if depth > -bar.law.ahead:
            if has_missed_face(depth, end.before, bar):
                end.open_speed = Real(MISSED)
                depth = Real(AWAY)
            else:
                a = toe_links.pin_acceleration(state, shared, mine, j)
                end.link = toe_links.with_motion(state, shared, mine, j, other, a, end.link)
        end.depth = depth
        end.normal = normal
        end.place = z
        sum = link_contacts.find_reaction(state, tallies, shared, mine, now, end)
        link_contacts.add_samples(state, mine, now, j, end.partner, sum)
        toe_rows.add_pair(shared.rows, row.back_x, row.back_y, j, sum.near)
        toe_rows.add_pair(shared.rows, row.ahead_x, row.ahead_y, j, sum.far)
        if wp.static(kind.profiles):
            if bar.body < body_count:
                wrench_parts.add_wrench(shared, mine, bar.body, j, sum.moment, sum.whole, now.measures)

    @wp.func
    def add_back_forces(
        ensemble: Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """Adds the forces of guides on the backs after the thread's pins, which are near them, to rows."""
        by_bar = partner_bits.of_guides(near)
        while partner_bits.has_any(by_bar):
            j, p = partner_bits.first_pair(by_bar, mine.thread)
            by_bar = partner_bits.without_first_pair(by_bar)
            if shared.guides[p - sprockets].back_radius > Real(0.0):
                add_back_force(ensemble, state, tallies, shared, mine, now, j, p - sprockets)

    return BackFunctions(add_back_forces=add_back_forces)
