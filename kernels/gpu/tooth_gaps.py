"""A block's rollers in the tooth gaps of sprockets, and the seats that they keep."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import load_constant, row_access
from ..number import difference, leading_value
from ..physics.contact import rotated_vector
from ..physics.tooth import (
    gap_coordinates,
    nearest_seat,
    relative_tooth_velocity,
    straight_flank_gap,
    tooth_contact,
    tracked_seat_from,
)
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contacts import contact_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions


@dataclass(frozen=True)
class ToothGapFunctions:
    """Tooth gap functions of a block."""

    with_sprocket: wp.Function
    contact_in_gap: wp.Function
    contact_in_straight_gap: wp.Function


@cache
def tooth_gap_functions(kind: BlockKind) -> ToothGapFunctions:
    """Tooth gap functions of block kernels."""
    contacts = contact_functions(kind)
    chains = chain_functions(kind)
    whole_access = row_access(wp.int32)
    partner_bits = partner_bit_functions(kind)
    rollers = roller_functions(kind)
    kinds = kind.types
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared

    @wp.func
    def seat_direction(ensemble: Ensemble, number: int):
        """Direction of a tooth seat at angle zero, by its number among all of the block's ensemble."""
        return load_constant(ensemble.seats, number)

    @wp.func
    def with_sprocket(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, contact: contacts.Contact, j: int, s: int
    ):
        """Block's contact with what roller j remembers of sprocket s."""
        at = chains.contact_memory(shared, mine, j, s)
        contact.partner = s
        contact.seat = whole_access.load(state.seat, at)
        contact = contacts.with_memory(state, contact, at)
        contact.direction = seat_direction(ensemble, shared.teeth[s].first_seat + wp.max(contact.seat, 0))
        return contact

    @wp.func
    def velocity_from_center(shared: Shared, j: int, s: int):
        """Velocity [m/s] of a block's roller j relative to the center of sprocket s."""
        v = rollers.velocity(shared.rows, j)
        if wp.static(kind.moving):
            v = v - leading_value(shared.poses[s].velocity)
        return v

    @wp.func
    def contact_in_gap(ensemble: Ensemble, state: State, shared: Shared, at: int, j: int, contact: contacts.Contact):
        """Block's contact of roller j with its kinematics in the tooth gap, and its arm [m]; its seat is at `at`."""
        s = contact.partner
        teeth = shared.teeth[s]
        body = shared.poses[s]
        p = difference(rollers.exact_position(shared.rows, j), body.center)
        arm = leading_value(p)
        number = int(contact.seat)
        direction = contact.direction
        if number < 0:
            number = nearest_seat(arm, leading_value(body.cosine), leading_value(body.sine), teeth.teeth)
            direction = seat_direction(ensemble, teeth.first_seat + number)
        v = velocity_from_center(shared, j, s)
        found, e, xi, lateral = tracked_seat_from(p, number, direction, body, teeth, ensemble.seats)
        if found != contact.seat:
            whole_access.store(state.seat, at, found)
        penetration, normal, relative = tooth_contact(arm, v, leading_value(body.speed), e, xi, lateral, teeth)
        return contacts.with_kinematics(contact, penetration, normal, relative), arm

    @wp.func
    def contact_in_straight_gap(shared: Shared, teeth: kinds.Sprocket, j: int, contact: contacts.Contact):
        """Block's contact of roller j in a straight-flanked gap, its arm [m], and 1 where that applies."""
        body = shared.poses[contact.partner]
        p = difference(rollers.exact_position(shared.rows, j), body.center)
        e, radial, xi, lateral = gap_coordinates(p, contact.direction, body, teeth)
        arm = leading_value(p)
        off = wp.abs(lateral) > teeth.half_pitch_tangent * radial
        penetration, along, across, applies = straight_flank_gap(xi, lateral, teeth)
        relative = relative_tooth_velocity(
            leading_value(body.speed), arm, velocity_from_center(shared, j, contact.partner)
        )
        return (
            contacts.with_kinematics(contact, penetration, rotated_vector(e, along, across), relative),
            arm,
            wp.where(off, 0, applies),
        )

    return ToothGapFunctions(
        with_sprocket=with_sprocket,
        contact_in_gap=contact_in_gap,
        contact_in_straight_gap=contact_in_straight_gap,
    )
