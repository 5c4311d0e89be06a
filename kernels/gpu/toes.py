"""The contacts of a block's silent chains with wheel teeth: four at a pin, with the flank ends of its two links.

Each thread of a warp finds the gap of a pin and which of its links may touch teeth, as of most pins one at most may;
then two threads share the contacts of each such link. Forces go to rows of their own first, on the pin and beside it.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..number import difference, leading_value
from ..physics.contact import memory_after_teeth, rotated_vector
from ..physics.toe import LINK_ENDS, seated_toe_contact, toe_contact
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
from .toe_gaps import toe_gap_functions
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
    access = row_access(Real)
    rollers = roller_functions(kind)
    toe_gaps = toe_gap_functions(kind)
    toe_links, toe_rows, link_contacts = toe_link_functions(kind), toe_row_functions(kind), link_contact_functions(kind)

    @wp.func
    def force_on_flank_end(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, pin: toe_gaps.Pin, number: int
    ):
        """Force of teeth on flank end `number` (`physics.toe.ENDS`) at a pin, which keeps it."""
        j, s, e, after = pin.pair // BITS, pin.pair % BITS, pin.outward, number < LINK_ENDS
        end = link_contacts.LinkContact()
        end.number = j
        end.partner = s
        arm = leading_value(difference(rollers.exact_position(shared.rows, j), shared.poses[s].center))
        other = toe_gaps.other_pin(shared, mine, j, after)
        end.link = toe_links.link_of_pin(shared, j, other, arm)
        u = toe_gaps.direction_in_gap(pin, end.link.u)
        plate, teeth = shared.plates[chains.chain_number(shared, j)], shared.teeth[s]
        end.memory = pin.memory + number * chains.chain_length(shared, mine, j)
        end.before = access.load(state.impact_speed, end.memory)
        end.open_speed = memory_after_teeth(end.before)
        end.pushed = access.load(state.push, chains.push_memory(shared, mine, j, end.memory))
        end.damper_speed = access.load(state.damper_speed, end.memory)
        k, length = number % LINK_ENDS, end.link.length
        depth, n, z, done = seated_toe_contact(pin.xi, pin.lateral, u, length, k, after, plate, teeth)
        if done == 0:
            depth, n, z = toe_contact(pin.xi, pin.lateral, u, length, k, after, plate, teeth)
        if depth > -teeth.law.ahead:
            acceleration = toe_links.pin_acceleration(state, shared, mine, j)
            end.link = toe_links.with_motion(state, shared, mine, j, other, acceleration, end.link)
        end.depth = depth
        end.normal = rotated_vector(e, n[0], n[1])
        end.place = rotated_vector(e, z[0], z[1])
        return link_contacts.find_reaction(state, tallies, shared, mine, now, end)

    @wp.func
    def sum_of_two(value: vec2):
        """Sum of `value` over the threads that share a link."""
        return vec2(sum_with_lane(value[0], 1), sum_with_lane(value[1], 1))

    @wp.func
    def sum_of_threads(sum: link_contacts.Reaction, now: Now):
        """Sum over the threads that share a link."""
        sum.near = sum_of_two(sum.near)
        sum.far = sum_of_two(sum.far)
        sum.whole = sum_of_two(sum.whole)
        sum.moment = sum_with_lane(sum.moment, 1)
        if now.flags & EXTRA != 0:
            sum.size = sum_with_lane(sum.size, 1)
            sum.energy = sum_with_lane(sum.energy, 1)
        return sum

    @wp.func
    def add_reaction(
        state: State,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        pin: toe_gaps.Pin,
        after: bool,
        sum: link_contacts.Reaction,
    ):
        """Adds the forces on a pin's link to rows and wheel."""
        j, s = pin.pair // BITS, pin.pair % BITS
        toe_rows.add_pair(shared.rows, row.near_x, row.near_y, j, sum.near)
        if after:
            toe_rows.add_pair(shared.rows, row.next_x, row.next_y, j, sum.far)
        else:
            toe_rows.add_pair(shared.rows, row.last_x, row.last_y, j, sum.far)
        wrench_parts.add_wrench(shared, mine, s, j, sum.moment, sum.whole, now.measures)
        wrench_parts.add_wrench_on_carrier(shared, mine, now, s, j, sum.whole)
        link_contacts.add_samples(state, mine, now, j, s, sum)

    @wp.func
    def add_forces_on_links(
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        pin: toe_gaps.Pin,
        sides: int,
        list: int,
    ):
        """Adds the forces on those links of the pins that a warp's threads have found that may touch, by `sides`.

        Pins with such a link after them are listed in rows from `list` on, then those with one before them.
        """
        lanes, sharing = warp_lanes(), wp.min(warp_lanes(), LINK_ENDS)
        lane = mine.thread % lanes
        side = int(0)
        while side < 2:
            flag = (sides >> side) & 1
            owners = lanes_with_flag(flag)
            if flag != 0:
                access.store(shared.rows, list + bits_below(owners, lane), Real(lane))
            count = bits_below(owners, lanes)
            end_turn()
            at = lane // sharing
            while at - lane // sharing < count:
                owner = lane
                if at < count:
                    owner = int(access.load(shared.rows, list + at))
                found, sum = toe_gaps.pin_of_lane(pin, owner), link_contacts.Reaction()
                if at < count:
                    end = lane % sharing
                    while end < LINK_ENDS:
                        of_end = force_on_flank_end(state, tallies, shared, mine, now, found, side * LINK_ENDS + end)
                        sum = link_contacts.sum_of_reactions(sum, of_end)
                        end = end + sharing
                sum = sum_of_threads(sum, now)
                if at < count and lane % sharing == 0:
                    add_reaction(state, shared, mine, now, found, side == 0, sum)
                at = at + lanes // sharing
            end_turn()
            side = side + 1

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
            done = int(0)
            while done < count:
                pin, sides = toe_gaps.Pin(), int(0)
                if done + lane < count:
                    pair = int(access.load(shared.rows, first + done + lane))
                    pin = toe_gaps.pin_in_gap(ensemble, state, shared, mine, pair)
                    sides = toe_gaps.near_sides(state, shared, mine, pin)
                end_turn()
                add_forces_on_links(state, tallies, shared, mine, now, pin, sides, first + done)
                done = done + lanes

    return ToeFunctions(add_toe_forces=add_toe_forces)
