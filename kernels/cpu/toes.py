"""Contacts of a silent chain's toes with the teeth of one wheel, for the pins that have seats there (`physics.toe`).

A pin has four contacts, with the flank ends of its two links. Of most pins one link stands off both flanks of the gap:
contacts are worked out from the first to the last pin whose link after it may touch, and likewise of links before.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access, smaller
from ..physics.contact import AWAY, memory_after_teeth, rotated_vector
from ..physics.toe import (
    LINK_ENDS,
    flank_reach,
    is_off_flanks,
    point_mobility,
    rotated_to_gap,
    seated_toe_contact,
    toe_arcs,
    toe_contact,
)
from ..structs import Pose, types
from .contact_rows import contact_row_functions
from .link_motions import link_motion_functions
from .link_runs import ENDS_APART, LinkRun, link_run_functions
from .neighbor_list import Group, lowest_bit, without_lowest_bit
from .partners import partner_functions
from .rollers import rows


@dataclass(frozen=True)
class ToeFunctions:
    """CPU functions of toes' contacts with one wheel."""

    find_near_toes: wp.Function
    find_contacts: wp.Function


@cache
def toe_functions(Real: type, capacity: int) -> ToeFunctions:
    """CPU functions of contacts with wheel teeth, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, Plate, Sprocket, vec2 = kinds.Memory, kinds.Plate, kinds.Sprocket, kinds.vec2
    row = rows(capacity)
    links = link_motion_functions(Real, capacity)
    partners = partner_functions(Real)
    link_runs = link_run_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.func(inline=True)
    def store_toe(contacts: wp.array[Real], c: int, outward: vec2, depth: Real, n: vec2, z: vec2, length: Real):
        """Stores contact `c` of a toe, vectors along and across the seat's direction `outward`; returns its place."""
        x, y = outward[0], outward[1]
        normal, place = rotated_vector(n, x, y), rotated_vector(z, x, y)
        contact_rows.store_place(contacts, c, depth, normal, place, point_mobility(z, n, length))
        return place

    @wp.func
    def direction_at_seat(link: links.Link, sign: Real, outward_x: Real, outward_y: Real):
        """Components of the unit vector from a pin into its link, along and across the seat's direction."""
        # numbers, not vectors, which would keep loops from vectorizing
        return rotated_to_gap(sign * link.ux, sign * link.uy, outward_x, outward_y)

    @wp.func
    def may_touch(
        w: wp.array[Real], i: int, after: bool, plate: Plate, reach: Real, partner: partners.Partner, memory: Memory
    ):
        """Whether pin i's link after it, or before it, may touch a tooth of the pin's gap within half a step."""
        link, sign = links.link_at(w, i + wp.where(after, 1, 0)), wp.where(after, Real(1.0), Real(-1.0))
        x, y = access.load(w, row.outward_x + i), access.load(w, row.outward_y + i)
        radial, across = direction_at_seat(link, sign, x, y)
        xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
        tip, begin, _middle = toe_arcs(xi, lateral, vec2(radial, across), link.length, after, plate)
        arm = links.arm_of_middle(w, i, link, sign, partner.pose)
        way = memory.lag * links.find_approach_bound(link, arm, reach, partner.pose, memory)
        return not is_off_flanks(tip, begin, smaller(way, partner.sprocket.law.ahead), partner.sprocket)

    @wp.func
    def touching_bits(w: wp.array[Real], group: Group, end: int, memory: Memory):
        """Bits of a group's pins of which end `end` of a link, or the next, was on a tooth in the step before."""
        count, first = group.high - group.low, memory.speed_row + end * wp.static(capacity) + group.low
        one = access.find_above(w, first, count, Real(0.0))
        return one | access.find_above(w, first + wp.static(capacity), count, Real(0.0))

    @wp.func
    def find_near_toes(
        w: wp.array[Real], group: Group, plate: Plate, partner: partners.Partner, number: int, memory: Memory
    ):
        """Bits of a group's pins whose link after them may touch wheel `number` or did, and of those whose link before.

        Gap coordinates are in their rows.
        """
        reach = flank_reach(plate)
        count, shift = group.high - group.low, wp.uint64(group.low - group.first)
        high = group.low + access.whole_vectors(count)
        i = group.low
        while i < high:
            seated = access.load(w, row.direction_owner + i) == Real(number)
            after = may_touch(w, i, True, plate, reach, partner, memory)
            before = may_touch(w, i, False, plate, reach, partner, memory)
            access.store(w, row.after_near + i, wp.where(seated and after, Real(1.0), Real(0.0)))
            access.store(w, row.before_near + i, wp.where(seated and before, Real(1.0), Real(0.0)))
            i = i + 1
        after_bits = access.find_above(w, row.after_near + group.low, count, Real(0.0))
        before_bits = access.find_above(w, row.before_near + group.low, count, Real(0.0))
        after_bits = after_bits | touching_bits(w, group, 0, memory)
        before_bits = before_bits | touching_bits(w, group, LINK_ENDS, memory)
        return after_bits << shift, before_bits << shift

    @wp.func
    def mend_toes(w: wp.array[Real], run: LinkRun, plate: Plate, sprocket: Sprocket, body: Pose, memory: Memory):
        """Stores the contacts of the few arcs that are not on the flank that they face."""
        contacts = access.shifted_rows(w, run.rows)
        after = run.end == 0
        sign = wp.where(after, Real(1.0), Real(-1.0))
        pins = access.find_unlike(w, row.exception + run.low, run.count, Real(0.0))
        while pins != wp.uint64(0):
            i = run.low + lowest_bit(pins)
            xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
            outward = vec2(access.load(w, row.outward_x + i), access.load(w, row.outward_y + i))
            link = links.link_at(w, i + wp.where(after, 1, 0))
            radial, across = direction_at_seat(link, sign, outward[0], outward[1])
            u = vec2(radial, across)
            arm = links.arm_of_middle(w, i, link, sign, body)
            ends = int(access.load(w, row.exception + i))
            end = int(0)
            while end < LINK_ENDS:
                if (ends >> end) & 1 != 0:
                    depth, n, z = toe_contact(xi, lateral, u, link.length, end, after, plate, sprocket)
                    c = i - run.low + end * ENDS_APART
                    z = store_toe(contacts, c, outward, depth, n, z, link.length)
                    links.store_motion(contacts, c, arm, z, link, body, memory)
                end = end + 1
            pins = without_lowest_bit(pins)

    @wp.func
    def find_contacts(
        w: wp.array[Real],
        run: LinkRun,
        last: int,
        plate: Plate,
        sprocket: Sprocket,
        body: Pose,
        number: int,
        memory: Memory,
    ):
        """Stores contacts of a run's toes with wheel `number`, gap coordinates in their rows; `last` ends its group."""
        contacts = access.shifted_rows(w, run.rows - run.low)
        link_runs.recall_contacts(w, run, LINK_ENDS, memory)
        after = run.end == 0
        at, sign = wp.where(after, 1, 0), wp.where(after, Real(1.0), Real(-1.0))
        odd, high = int(0), run.low + run.pitch
        i = run.low
        while i < high:
            ends = int(0)
            xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
            outward = vec2(access.load(w, row.outward_x + i), access.load(w, row.outward_y + i))
            seated = access.load(w, row.direction_owner + i) == Real(number) and i < last
            link = links.link_at(w, i + at)
            radial, across = direction_at_seat(link, sign, outward[0], outward[1])
            u = vec2(radial, across)
            arm = links.arm_of_middle(w, i, link, sign, body)
            for end in range(LINK_ENDS):
                c = i + end * ENDS_APART
                depth, n, z, on_flank = seated_toe_contact(xi, lateral, u, link.length, end, after, plate, sprocket)
                ends = ends | (wp.where(seated, 1 - on_flank, 0) << end)
                depth = wp.where(seated, depth, Real(AWAY))
                place = store_toe(contacts, c, outward, depth, n, z, link.length)
                links.store_motion(contacts, c, arm, place, link, body, memory)
                before = wp.where(seated, access.load(contacts, row.v0_before + c), Real(0.0))
                access.store(contacts, row.v0_before + c, before)
                access.store(contacts, row.v0_open + c, memory_after_teeth(before))
            access.store(w, row.exception + i, Real(ends))
            odd = odd | ends
            i = i + 1
        if odd != 0:
            mend_toes(w, run, plate, sprocket, body, memory)

    return ToeFunctions(find_near_toes=find_near_toes, find_contacts=find_contacts)
