"""Contacts of a silent chain's toes with the teeth of one wheel, for the pins that have seats there (`physics.toe`).

A pin has four contacts, with the flank ends of its two links.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.contact import AWAY, memory_after_teeth, rotated_vector
from ..physics.toe import ENDS, point_mobility, rotated_to_gap, seated_toe_contact, toe_contact
from ..structs import Drive, Pose, types
from .contact_rows import contact_row_functions
from .link_motions import link_motion_functions
from .link_runs import LinkRun, link_run_functions
from .neighbor_list import GROUP, Group, lowest_bit, without_lowest_bit
from .rollers import rows


@dataclass(frozen=True)
class ToeFunctions:
    """CPU functions of toes' contacts with one wheel."""

    seated_run: wp.Function
    find_contacts: wp.Function


@cache
def toe_functions(Real: type, capacity: int) -> ToeFunctions:
    """CPU functions of contacts with wheel teeth, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, Plate, Sprocket, vec2 = kinds.Memory, kinds.Plate, kinds.Sprocket, kinds.vec2
    row = rows(capacity)
    links = link_motion_functions(Real, capacity)
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
    def direction_at_seat(link: links.Link, sign: Real, outward: vec2):
        """Unit vector from a pin into its link, along and across the seat's direction."""
        radial, lateral = rotated_to_gap(sign * link.ux, sign * link.uy, outward[0], outward[1])
        return vec2(radial, lateral)

    @wp.func
    def mend_toes(w: wp.array[Real], run: LinkRun, plate: Plate, sprocket: Sprocket, body: Pose, memory: Memory):
        """Stores the contacts of the few arcs that are not on the flank that they face."""
        contacts = access.shifted_rows(w, run.rows)
        pins = access.find_unlike(w, row.exception + run.low, run.count, Real(0.0))
        while pins != wp.uint64(0):
            i = run.low + lowest_bit(pins)
            xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
            outward = vec2(access.load(w, row.outward_x + i), access.load(w, row.outward_y + i))
            ends = int(access.load(w, row.exception + i))
            end = int(0)
            while end < ENDS:
                if (ends >> end) & 1 != 0:
                    after = end < 2
                    sign = wp.where(after, Real(1.0), Real(-1.0))
                    link = links.link_at(w, i + wp.where(after, 1, 0))
                    u = direction_at_seat(link, sign, outward)
                    depth, n, z = toe_contact(xi, lateral, u, link.length, end % 2, after, plate, sprocket)
                    arm = links.arm_of_middle(w, i, link, sign, body)
                    c = i - run.low + end * GROUP
                    z = store_toe(contacts, c, outward, depth, n, z, link.length)
                    links.store_motion(contacts, c, arm, z, link, body, memory)
                end = end + 1
            pins = without_lowest_bit(pins)

    @wp.func
    def seated_run(w: wp.array[Real], drive: Drive, group: Group, number: int):
        """Pins of a group from the first to the last with a seat in wheel `number`."""
        count = group.high - group.first
        others = access.find_unlike(w, row.direction_owner + group.first, count, Real(number))
        seated = ~others & (~wp.uint64(0) >> wp.uint64(64 - wp.max(count, 1)))
        return link_runs.link_run(drive, group.first, wp.where(count > 0, seated, wp.uint64(0)))

    @wp.func
    def find_contacts(
        w: wp.array[Real], run: LinkRun, plate: Plate, sprocket: Sprocket, body: Pose, number: int, memory: Memory
    ):
        """Stores contacts of all flank ends with wheel `number` at a run's pins; gap coordinates are in their rows."""
        contacts = access.shifted_rows(w, run.rows - run.low)
        last, high = run.low + run.count, run.low + access.whole_vectors(run.count)
        link_runs.recall_contacts(w, run, int(ENDS), memory)
        odd = int(0)
        i = run.low
        while i < high:
            ends = int(0)
            xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
            outward = vec2(access.load(w, row.outward_x + i), access.load(w, row.outward_y + i))
            seated = access.load(w, row.direction_owner + i) == Real(number) and i < last
            for side in range(2):
                sign = Real(1 - 2 * side)
                link = links.link_at(w, i + 1 - side)
                u = direction_at_seat(link, sign, outward)
                arm = links.arm_of_middle(w, i, link, sign, body)
                for part in range(2):
                    k = 2 * side + part
                    c = i + k * GROUP
                    depth, n, z, on_flank = seated_toe_contact(
                        xi, lateral, u, link.length, part, side == 0, plate, sprocket
                    )
                    ends = ends | (wp.where(seated, 1 - on_flank, 0) << k)
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

    return ToeFunctions(seated_run=seated_run, find_contacts=find_contacts)
