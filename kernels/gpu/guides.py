"""The contacts of a block's rollers with guides, straight bars and profiles: forces and their reactions on bodies."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import aligned_rows, row_access
from ..number import difference, leading_value
from ..physics.contact import MISSED, UNTOUCHED, has_missed_face, reaction_moment, rotated_vector, surface_velocity
from ..physics.guide import bar_contact, profile_contact, tracked_piece
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contacts import contact_functions
from .events import START
from .geometry import geometry_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions
from .sync import add_to_element
from .toe_rows import toe_row_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class GuideFunctions:
    """Contacts of one variant's rollers with guides."""

    add_guide_forces: wp.Function


@cache
def guide_functions(kind: BlockKind) -> GuideFunctions:
    """The functions that evaluate the contacts of one variant's rollers on a block with its guides."""
    Real, sprockets, body_count = kind.Real, kind.parts.sprockets, kind.parts.bodies
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Guide = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Guide
    vec2 = kinds.vec2
    chains = chain_functions(kind)
    whole_access = row_access(wp.int32)
    geometry = geometry_functions(kind)
    rollers = roller_functions(kind)
    contacts = contact_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    partner_bits = partner_bit_functions(kind)
    toe_rows = toe_row_functions(kind)
    rows_of_pieces = aligned_rows(kinds.Piece)

    @wp.func
    def profile_kinematics(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, j: int, g: int, bar: Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on the profile of guide g."""
        at = chains.contact_memory(shared, mine, j, sprockets + g)
        kept = whole_access.load(state.seat, at)
        arm, q = geometry.arm_and_carrier_coordinates(shared, rollers.exact_position(shared.rows, j), bar.body)
        pieces = rows_of_pieces(ensemble.pieces)
        number = int(kept)
        if kept < 0:
            number = tracked_piece(q, kept, bar, pieces)
        penetration, facing, beyond = profile_contact(q, number, bar, pieces)
        if beyond != 0 and kept >= 0:
            number = wp.clamp(kept + beyond, 0, bar.pieces - 1)
            penetration, facing, beyond = profile_contact(q, number, bar, pieces)
        if number != kept:
            whole_access.store(state.seat, at, number)
        pose = shared.poses[bar.body]
        relative = surface_velocity(pose, leading_value(arm)) - rollers.velocity(shared.rows, j)
        return penetration, rotated_vector(facing, leading_value(pose.cosine), leading_value(pose.sine)), relative

    @wp.func
    def bar_kinematics(shared: Shared, j: int, bar: Guide):
        """Penetration [m], normal and relative velocity [m/s] of roller j on a straight bar, as it is now."""
        p = difference(rollers.exact_position(shared.rows, j), bar.start)
        surface = vec2(Real(0.0), Real(0.0))
        if wp.static(kind.profiles):
            surface = surface_velocity(shared.poses[bar.body], geometry.arm_from_body(shared, j, bar.body))
        return bar_contact(p, rollers.velocity(shared.rows, j), surface, bar)

    @wp.func
    def guide_kinematics(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, j: int, g: int, bar: Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on guide g."""
        if wp.static(kind.profiles):
            penetration = Real(0.0)
            normal = vec2()
            relative = vec2()
            if bar.pieces != 0:
                penetration, normal, relative = profile_kinematics(ensemble, state, shared, mine, j, g, bar)
            else:
                penetration, normal, relative = bar_kinematics(shared, j, bar)
            return penetration, normal, relative
        else:
            return bar_kinematics(shared, j, bar)

    @wp.func
    def add_guide_force(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, g: int
    ):
        """Adds the force of guide g to roller j's, and its reaction to the body that carries it."""
        bar = geometry.guide_now(shared, g)
        contact = contacts.Contact()
        contact.partner = sprockets + g
        at = chains.contact_memory(shared, mine, j, contact.partner)
        contact = contacts.with_memory(state, contact, at)
        before = contact.impact_speed
        penetration, normal, relative = guide_kinematics(ensemble, state, shared, mine, j, g, bar)
        closed = bool(False)
        kept = Real(UNTOUCHED)
        if penetration > -bar.law.ahead:
            if has_missed_face(penetration, before, bar):
                kept = Real(MISSED)
                if now.measures != 0 and (before == Real(UNTOUCHED) or now.flags & START != 0):
                    add_to_element(tallies.missed, at, 1)
            else:
                contact = contacts.with_kinematics(contact, penetration, normal, relative)
                arm = vec2()
                carrier = kinds.Pose()
                if wp.static(kind.profiles):
                    arm = geometry.arm_from_body(shared, j, bar.body)
                    carrier = shared.poses[bar.body]
                contact.acceleration = contacts.approach_acceleration(shared, carrier, arm, j)
                closed, force = contacts.add_normal_force(state, tallies, shared, mine, now, j, contact, bar.law)
                if wp.static(kind.silent):
                    if closed and toe_rows.is_silent(shared, j):
                        toe_rows.add_late_force(state, tallies, shared, mine, now, j, contact.partner, force)
                if wp.static(kind.profiles):
                    if closed and bar.body < body_count:
                        moment = reaction_moment(arm, force)
                        wrench_parts.add_wrench(shared, mine, bar.body, j, moment, force, now.measures)
        if not closed:
            contacts.keep_impact_speed(state, now, at, before, kept)

    @wp.func
    def add_guide_forces(
        ensemble: Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """Adds the forces of the guides that they are near to those of the thread's rollers."""
        by_bar = partner_bits.of_guides(near)
        while partner_bits.has_any(by_bar):
            j, p = partner_bits.first_pair(by_bar, mine.thread)
            by_bar = partner_bits.without_first_pair(by_bar)
            if wp.static(kind.silent):
                if shared.guides[p - sprockets].back_radius == Real(0.0):
                    add_guide_force(ensemble, state, tallies, shared, mine, now, j, p - sprockets)
            else:
                add_guide_force(ensemble, state, tallies, shared, mine, now, j, p - sprockets)

    return GuideFunctions(add_guide_forces=add_guide_forces)
