"""Contacts of rollers with the teeth of one sprocket on the CPU, from their seats."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.contact import AWAY, UNTOUCHED, memory_after_teeth, rotated_components
from ..physics.tooth import is_beyond_tip, tip_gap, tipless_gap
from ..structs import Pose, types
from .contact_rows import contact_row_functions
from .neighbor_list import Group
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class ToothFunctions:
    """CPU tooth contact functions."""

    find_contacts: wp.Function
    count_first_contacts: wp.Function


@cache
def tooth_functions(Real: type, capacity: int) -> ToothFunctions:
    """CPU tooth contact functions."""
    Sprocket = types(Real).Sprocket
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def store_gap_contacts(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """Stores contacts in tooth gaps without tips; returns 1 if any is at a tip."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        center_vx = Real(body.velocity[0])
        center_vy = Real(body.velocity[1])
        omega = Real(body.speed)
        tipped = int(0)
        i = first
        while i < end:
            xi = access.load(w, row.radial + i)
            lateral = access.load(w, row.lateral + i)
            penetration, along, across = tipless_gap(xi, lateral, sprocket)
            seated = access.load(w, row.direction_owner + i) == Real(number)
            depth = wp.where(seated, penetration, Real(AWAY))
            tipped = tipped | wp.where(is_beyond_tip(depth, xi, lateral, sprocket), 1, 0)
            p = rollers.exact_position(w, i) - body.center
            relative_x = -omega * Real(p[1]) - (access.load(w, row.vx + i) - center_vx)
            relative_y = omega * Real(p[0]) - (access.load(w, row.vy + i) - center_vy)
            normal_x, normal_y = rotated_components(
                access.load(w, row.outward_x + i), access.load(w, row.outward_y + i), along, across
            )
            before = wp.where(seated, access.load(w, row.v0_of_seat + i), Real(0.0))
            contact_rows.store_arm(w, i, access.load(w, row.x + i) - center_x, access.load(w, row.y + i) - center_y)
            contact_rows.store_contact(w, i, depth, normal_x, normal_y, relative_x, relative_y)
            access.store(w, row.v0_before + i, before)
            access.store(w, row.v0_open + i, memory_after_teeth(before))
            i = i + 1
        return tipped

    @wp.func
    def store_flank_contacts(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """Stores contacts in tooth gaps, without tips, of either flank; returns 1 if any is at a tip."""
        if sprocket.flank_curvature > Real(0.0):
            tipped = store_gap_contacts(w, first, end, sprocket, body, number)
            return tipped
        sprocket.flank_curvature = Real(0.0)  # so that the compiler knows
        tipped = store_gap_contacts(w, first, end, sprocket, body, number)
        return tipped

    @wp.func
    def mend_tip_contacts(w: wp.array[Real], first: int, end: int, sprocket: Sprocket):
        """Stores penetrations and normals of rollers at tooth tips."""
        i = first
        while i < end:
            xi = access.load(w, row.radial + i)
            lateral = access.load(w, row.lateral + i)
            if is_beyond_tip(access.load(w, row.penetration + i), xi, lateral, sprocket):
                penetration, along, across = tip_gap(xi, lateral, sprocket)
                normal_x, normal_y = rotated_components(
                    access.load(w, row.outward_x + i), access.load(w, row.outward_y + i), along, across
                )
                access.store(w, row.penetration + i, penetration)
                access.store(w, row.normal_x + i, normal_x)
                access.store(w, row.normal_y + i, normal_y)
            i = i + 1

    @wp.func
    def find_contacts(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """Stores contacts with teeth of rollers that have seats."""
        tipped = store_flank_contacts(w, first, end, sprocket, body, number)
        if tipped != 0:
            mend_tip_contacts(w, first, end, sprocket)

    @wp.func
    def count_first_contacts(w: wp.array[Real], group: Group):
        """Number of a group's rollers that first touch teeth in their pass."""
        count = int(0)
        i = group.low
        while i < group.high:
            if access.load(w, row.penetration + i) > Real(0.0) and access.load(w, row.v0_before + i) == Real(UNTOUCHED):
                count = count + 1
            i = i + 1
        return count

    return ToothFunctions(find_contacts=find_contacts, count_first_contacts=count_first_contacts)
