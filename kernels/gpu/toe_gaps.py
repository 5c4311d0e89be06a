"""Pins of a block's silent chains in the tooth gaps of wheels, and which of their links may touch teeth there."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import larger, load_constant, row_access, smaller
from ..number import difference, leading_value
from ..physics.contact import surface_velocity
from ..physics.toe import LINK_ENDS, approach_bound, flank_reach, is_off_flanks, rotated_to_gap, toe_arcs
from ..physics.tooth import nearest_seat, tracked_seat_from
from .block_kinds import BlockKind
from .block_structs import BITS, ThreadParts
from .chains import chain_functions
from .contacts import contact_functions
from .rollers import roller_functions
from .sync import value_of_lane
from .toe_links import toe_link_functions


@dataclass(frozen=True)
class ToeGapFunctions:
    """Pins of one variant's silent chains in tooth gaps."""

    Pin: Any
    pin_in_gap: wp.Function
    pin_of_lane: wp.Function
    other_pin: wp.Function
    direction_in_gap: wp.Function
    near_sides: wp.Function


@cache
def toe_gap_functions(kind: BlockKind) -> ToeGapFunctions:
    """The functions that find pins of one variant's silent chains in tooth gaps on a block."""
    Real, kinds = kind.Real, kind.types
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    contacts = contact_functions(kind)
    chains, rollers, toe_links = chain_functions(kind), roller_functions(kind), toe_link_functions(kind)
    access, whole_access = row_access(Real), row_access(wp.int32)

    @wp.struct
    class Pin:
        """A pin in a tooth gap."""

        pair: wp.int32  # `BITS` times its number, and the sprocket's; -1 for none
        memory: wp.int32  # place of its contacts' memory
        outward: vec2  # direction of the gap's seat
        xi: Real  # from the seat along that [m]
        lateral: Real  # and across

    @wp.func
    def pin_in_gap(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, pair: int):
        """Pin of a pair, not -1, in its gap, whose number the state keeps."""
        j, s = pair // BITS, pair % BITS
        teeth, body = shared.teeth[s], shared.poses[s]
        p = difference(rollers.exact_position(shared.rows, j), body.center)
        pin = Pin()
        pin.pair = pair
        pin.memory = chains.contact_memory(shared, mine, j, s)
        kept = whole_access.load(state.seat, pin.memory)
        number = kept
        if number < 0:
            number = nearest_seat(leading_value(p), leading_value(body.cosine), leading_value(body.sine), teeth.teeth)
        found, e, xi, lateral = tracked_seat_from(
            p, number, load_constant(ensemble.seats, teeth.first_seat + number), body, teeth, ensemble.seats
        )
        if found != kept:
            whole_access.store(state.seat, pin.memory, found)
        pin.outward = e
        pin.xi = xi
        pin.lateral = lateral
        return pin

    @wp.func
    def other_pin(shared: Shared, mine: ThreadParts, j: int, after: bool):
        """Pin at the other end of the link after pin j, or before it."""
        next, previous = chains.next_roller(shared, j, mine.rollers), chains.previous_roller(shared, j, mine.rollers)
        return wp.where(after, next, previous)

    @wp.func
    def direction_in_gap(pin: Pin, u: vec2):
        """Components along e, tau of a link's direction."""
        radial, lateral = rotated_to_gap(u[0], u[1], pin.outward[0], pin.outward[1])
        return vec2(radial, lateral)

    @wp.func
    def may_touch(state: State, shared: Shared, mine: ThreadParts, pin: Pin, acceleration: vec2, after: bool):
        """1 where a pin's link after it, or before it, may touch a tooth of its gap or did in the last step, else 0."""
        j, s = pin.pair // BITS, pin.pair % BITS
        body, teeth, plate = shared.poses[s], shared.teeth[s], shared.plates[chains.chain_number(shared, j)]
        arm = leading_value(difference(rollers.exact_position(shared.rows, j), body.center))
        other, n = other_pin(shared, mine, j, after), chains.chain_length(shared, mine, j)
        link = toe_links.link_of_pin(shared, j, other, arm)
        link = toe_links.with_motion(state, shared, mine, j, other, acceleration, link)
        relative = leading_value(surface_velocity(body, link.middle)) - link.velocity
        more = contacts.acceleration_past(body, link.middle, link.acceleration)
        turn, angular = leading_value(body.speed) - link.turn, body.angular - link.angular
        lag = teeth.law.lag
        way = lag * approach_bound(relative, more, turn, angular, flank_reach(plate), lag)
        u = direction_in_gap(pin, link.u)
        tip, begin, _middle = toe_arcs(pin.xi, pin.lateral, u, link.length, after, plate)
        at = pin.memory + wp.where(after, 0, LINK_ENDS * n)
        before = larger(access.load(state.impact_speed, at), access.load(state.impact_speed, at + n))
        is_off = is_off_flanks(tip, begin, smaller(way, teeth.law.ahead), teeth)
        return wp.where(before > Real(0.0) or not is_off, 1, 0)

    @wp.func
    def near_sides(state: State, shared: Shared, mine: ThreadParts, pin: Pin):
        """Bits of a pin's links that may touch, or did: 1 that after it, 2 that before it."""
        acceleration = toe_links.pin_acceleration(state, shared, mine, pin.pair // BITS)
        after = may_touch(state, shared, mine, pin, acceleration, True)
        return after + 2 * may_touch(state, shared, mine, pin, acceleration, False)

    @wp.func
    def pin_of_lane(pin: Pin, lane: int):
        """The pin that another thread of the warp has found; all threads together."""
        found = Pin()
        found.pair = value_of_lane(pin.pair, lane)
        found.outward = vec2(value_of_lane(pin.outward[0], lane), value_of_lane(pin.outward[1], lane))
        found.xi = value_of_lane(pin.xi, lane)
        found.lateral = value_of_lane(pin.lateral, lane)
        found.memory = value_of_lane(pin.memory, lane)
        return found

    return ToeGapFunctions(
        Pin=Pin,
        pin_in_gap=pin_in_gap,
        pin_of_lane=pin_of_lane,
        other_pin=other_pin,
        direction_in_gap=direction_in_gap,
        near_sides=near_sides,
    )
