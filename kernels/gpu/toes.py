"""The contacts of a block's silent chains with wheel teeth: four at a pin, with the flank ends of its two links.

Four threads of a warp share a pin's. Forces go to rows of their own first, on the pin itself and on those beside it.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import load_constant, row_access
from ..number import difference, leading_value
from ..physics.contact import (
    memory_after_teeth,
    rotated_vector,
)
from ..physics.toe import ENDS, rotated_to_gap, seated_toe_contact, toe_contact
from ..physics.tooth import nearest_seat, tracked_seat_from
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import BITS, ThreadParts
from .chains import chain_functions
from .events import EXTRA
from .link_contacts import link_contact_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions
from .shared_memory import force_rows
from .sync import bits_below, end_turn, lanes_with_flag, sum_with_lane, warp_lanes
from .toe_links import toe_link_functions
from .toe_rows import toe_row_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class ToeFunctions:
    """Contacts of one variant's silent chains with wheel teeth."""

    add_toe_forces: wp.Function


@cache
def toe_functions(kind: BlockKind) -> ToeFunctions:
    """The functions that evaluate contacts of toes with the wheels of one variant on a block."""
    Real, kinds, Now, sprockets = kind.Real, kind.types, kind.types.Now, kind.parts.sprockets
    rollers_per_thread = kind.shape.rollers_per_thread
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    row = force_rows(kind)
    partner_bits = partner_bit_functions(kind)
    chains = chain_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    access, whole_access = row_access(Real), row_access(wp.int32)
    rollers = roller_functions(kind)
    toe_links, toe_rows, link_contacts = toe_link_functions(kind), toe_row_functions(kind), link_contact_functions(kind)

    @wp.struct
    class Pin:
        """A pin in a tooth gap."""

        number: wp.int32
        sprocket: wp.int32
        memory: wp.int32  # place of its contacts' memory
        outward: vec2  # direction of the gap's seat
        xi: Real  # from the seat along that [m]
        lateral: Real  # and across
        arm: vec2  # from the wheel's center [m]
        acceleration: vec2  # by links, and by contacts as in the step before [m/s^2]

    @wp.func
    def force_on_flank_end(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, pin: Pin, number: int
    ):
        """Force of teeth on flank end `number` (`physics.toe.ENDS`) at a pin, which keeps it."""
        j, s, e, after = pin.number, pin.sprocket, pin.outward, number < 2
        end = link_contacts.LinkContact()
        end.number = j
        end.partner = s
        other = wp.where(
            after, chains.next_roller(shared, j, mine.rollers), chains.previous_roller(shared, j, mine.rollers)
        )
        end.link = toe_links.link_of_pin(shared, j, other, pin.arm)
        radial, lateral = rotated_to_gap(end.link.u[0], end.link.u[1], e[0], e[1])
        u = vec2(radial, lateral)
        plate, teeth = shared.plates[chains.chain_number(shared, j)], shared.teeth[s]
        end.memory = pin.memory + number * chains.chain_length(shared, mine, j)
        end.before = access.load(state.impact_speed, end.memory)
        end.open_speed = memory_after_teeth(end.before)
        end.pushed = access.load(state.push, chains.push_memory(shared, mine, j, end.memory))
        end.damper_speed = access.load(state.damper_speed, end.memory)
        k, length = number % 2, end.link.length
        depth, n, z, done = seated_toe_contact(pin.xi, pin.lateral, u, length, k, after, plate, teeth)
        if done == 0:
            depth, n, z = toe_contact(pin.xi, pin.lateral, u, length, k, after, plate, teeth)
        if depth > -teeth.law.ahead:
            end.link = toe_links.with_motion(state, shared, mine, j, other, pin.acceleration, end.link)
        end.depth = depth
        end.normal = rotated_vector(e, n[0], n[1])
        end.place = rotated_vector(e, z[0], z[1])
        return link_contacts.find_reaction(state, tallies, shared, mine, now, end)

    @wp.func
    def sum_of_four(value: Real):
        """Sum of `value` over the threads that share a pin."""
        return sum_with_lane(sum_with_lane(value, 1), 2)

    @wp.func
    def reaction_of_threads(sum: link_contacts.Reaction, now: Now):
        """Sum over the threads that share a pin, but for the forces on other pins."""
        sum.near = vec2(sum_of_four(sum.near[0]), sum_of_four(sum.near[1]))
        sum.whole = vec2(sum_of_four(sum.whole[0]), sum_of_four(sum.whole[1]))
        sum.moment = sum_of_four(sum.moment)
        if now.flags & EXTRA != 0:
            sum.size = sum_of_four(sum.size)
            sum.energy = sum_of_four(sum.energy)
        return sum

    @wp.func
    def add_reaction(state: State, shared: Shared, mine: ThreadParts, now: Now, pin: Pin, sum: link_contacts.Reaction):
        """Adds the forces on a pin's links, but for those on other pins, to rows and wheel."""
        j, s = pin.number, pin.sprocket
        toe_rows.add_pair(shared.rows, row.near_x, row.near_y, j, sum.near)
        wrench_parts.add_wrench(shared, mine, s, j, sum.moment, sum.whole, now.measures)
        wrench_parts.add_wrench_on_carrier(shared, mine, now, s, j, sum.whole)
        link_contacts.add_samples(state, mine, now, j, s, sum)

    @wp.func
    def pin_in_gap(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, j: int, s: int):
        """Pin j in its gap of sprocket s, whose number the state keeps."""
        teeth, body = shared.teeth[s], shared.poses[s]
        p = difference(rollers.exact_position(shared.rows, j), body.center)
        pin = Pin()
        pin.number = j
        pin.sprocket = s
        pin.memory = chains.contact_memory(shared, mine, j, s)
        pin.arm = leading_value(p)
        kept = whole_access.load(state.seat, pin.memory)
        number = kept
        if number < 0:
            number = nearest_seat(pin.arm, leading_value(body.cosine), leading_value(body.sine), teeth.teeth)
        found, e, xi, lateral = tracked_seat_from(
            p, number, load_constant(ensemble.seats, teeth.first_seat + number), body, teeth, ensemble.seats
        )
        if found != kept:
            whole_access.store(state.seat, pin.memory, found)
        pin.outward = e
        pin.xi = xi
        pin.lateral = lateral
        pin.acceleration = toe_links.pin_acceleration(state, shared, mine, j)
        return pin

    @wp.func
    def add_forces_on_pin(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, pair: int
    ):
        """Adds the forces on one pair of pin and sprocket, -1 for none; four threads of the warp share it."""
        sharing = wp.min(warp_lanes(), ENDS)
        own = mine.thread % sharing
        pin, whole = Pin(), link_contacts.Reaction()
        if pair >= 0:
            pin = pin_in_gap(ensemble, state, shared, mine, pair // BITS, pair % BITS)
        number = own
        while number < ENDS:
            sum = link_contacts.Reaction()
            if pair >= 0:
                sum = force_on_flank_end(state, tallies, shared, mine, now, pin, number)
            far = vec2(sum_with_lane(sum.far[0], 1), sum_with_lane(sum.far[1], 1))
            if pair >= 0 and (number % 2 == 0 or sharing == 1):
                if number < 2:
                    toe_rows.add_pair(shared.rows, row.next_x, row.next_y, pin.number, far)
                else:
                    toe_rows.add_pair(shared.rows, row.last_x, row.last_y, pin.number, far)
            whole = link_contacts.sum_of_reactions(whole, sum)
            number = number + sharing
        whole = reaction_of_threads(whole, now)
        if pair >= 0 and own == 0:
            add_reaction(state, shared, mine, now, pin, whole)

    @wp.func
    def add_toe_forces(
        ensemble: Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """Adds the forces of teeth on the links of silent chains to rows, and their reactions to sprockets.

        All threads together: those of a warp share its pins' contacts, which they list first.
        """
        lanes = warp_lanes()
        lane, left = mine.thread % lanes, partner_bits.of_sprockets(near)
        first = row.pairs + (mine.thread - lane) * wp.static(rollers_per_thread)
        while lanes_with_flag(wp.where(partner_bits.has_any(left), 1, 0)) != 0:
            count, last = int(0), int(-1)
            for _k in range(rollers_per_thread):
                j, s, is_silent = int(0), int(0), int(0)
                if partner_bits.has_any(left):
                    j, s = partner_bits.first_pair(left, mine.thread)
                    if j != last:  # a pin's with another wheel wait, as both would add to the same rows
                        left = partner_bits.without_first_pair(left)
                        is_silent = wp.where(toe_rows.is_silent(shared, j), 1, 0)
                        last = j
                owners = lanes_with_flag(is_silent)
                if is_silent != 0:
                    access.store(shared.rows, first + count + bits_below(owners, lane), Real(BITS * j + s))
                count = count + bits_below(owners, lanes)
            end_turn()
            at = lane // ENDS
            while at - lane // ENDS < count:
                pair = int(-1)
                if at < count:
                    pair = int(access.load(shared.rows, first + at))
                add_forces_on_pin(ensemble, state, tallies, shared, mine, now, pair)
                at = at + (lanes + 3) // ENDS
            end_turn()

    return ToeFunctions(add_toe_forces=add_toe_forces)
