"""Rows of the CPU's scratch for a group of rollers' contacts with one partner, and contacts' memory.

Rows span the group's first to last near roller; others between have the penetration `AWAY`.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.back import back_count
from ..structs import Drive, types
from .neighbor_list import Group, is_near
from .rollers import ROWS, rows


@dataclass(frozen=True)
class ContactRowFunctions:
    """CPU contact row functions."""

    recall_impact_speed: wp.Function
    keep_impact_speeds: wp.Function
    store_arm: wp.Function
    store_contact: wp.Function
    store_place: wp.Function
    damper_row: wp.Function
    link_contacts: wp.Function
    push_row: wp.Function
    speed_row: wp.Function
    fetch_dampers: wp.Function
    put_back_dampers: wp.Function
    is_beginning: wp.Function
    add_force_sizes: wp.Function


@cache
def contact_row_functions(Real: type, capacity: int) -> ContactRowFunctions:
    """CPU contact row functions."""
    kinds = types(Real)
    Memory, State, vec2 = kinds.Memory, kinds.State, kinds.vec2
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def recall_impact_speed(w: wp.array[Real], i: int, group: Group, memory: Memory):
        """Stores and returns the v0 [m/s] that roller i's contact remembers."""
        before = Real(0.0)
        if is_near(group, i):
            before = access.load(memory.impact_speed, memory.first + i)
        access.store(w, row.v0_before + i, before)
        return before

    @wp.func
    def keep_impact_speeds(w: wp.array[Real], group: Group, memory: Memory):
        """Copies contacts' v0 from their row to memory."""
        i = group.low
        while i < group.high:
            if is_near(group, i):
                access.store(memory.impact_speed, memory.first + i, access.load(w, row.v0_kept + i))
            i = i + 1

    @wp.func
    def store_arm(w: wp.array[Real], i: int, x: Real, y: Real):
        """Stores roller i's vector from the partner's body's center [m]."""
        access.store(w, row.arm_x + i, x)
        access.store(w, row.arm_y + i, y)

    @wp.func
    def store_contact(
        w: wp.array[Real], i: int, penetration: Real, normal_x: Real, normal_y: Real, relative_x: Real, relative_y: Real
    ):
        """Stores roller i's penetration, `AWAY` if not near, normal and relative velocity."""
        # numbers, not vectors, which would keep loops from vectorizing
        access.store(w, row.penetration + i, penetration)
        access.store(w, row.normal_x + i, normal_x)
        access.store(w, row.normal_y + i, normal_y)
        access.store(w, row.relative_x + i, relative_x)
        access.store(w, row.relative_y + i, relative_y)

    @wp.func
    def store_place(w: wp.array[Real], i: int, penetration: Real, normal: vec2, place: vec2, mobility: Real):
        """Stores penetration, normal, place and mobility of contact `i` of a link."""
        access.store(w, row.penetration + i, penetration)
        access.store(w, row.normal_x + i, normal[0])
        access.store(w, row.normal_y + i, normal[1])
        access.store(w, row.place_x + i, place[0])
        access.store(w, row.place_y + i, place[1])
        access.store(w, row.point_mobility + i, mobility)

    @wp.func
    def damper_row(p: int):
        """First index of the row of damper speeds of pins' contacts `p`: sprockets', then guides'."""
        return wp.static(len(ROWS) * capacity) + p * wp.static(capacity)

    @wp.func
    def link_contacts(drive: Drive):
        """Contacts of a silent chain's link: its first pin's flank ends with sprockets, then its back with guides."""
        return drive.sprockets * drive.points + back_count(drive.points, drive.guides)

    @wp.func
    def speed_row(drive: Drive, c: int):
        """First index of the row of v0 of a silent chain's contacts `c` of links."""
        return damper_row(drive.sprockets * drive.points + drive.guides + c)

    @wp.func
    def push_row(drive: Drive, c: int):
        """First index of the row of what a silent chain's contacts `c` of links exerted in the step before."""
        return speed_row(drive, link_contacts(drive) + c)

    @wp.func
    def fetch_dampers(state: State, drive: Drive, w: wp.array[Real]):
        """Copies contacts' damper speeds from the state to their rows."""
        for p in range(drive.sprockets * drive.points + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                access.store(w, first + i, access.load(state.damper_speed, at + i))

    @wp.func
    def put_back_dampers(state: State, drive: Drive, w: wp.array[Real]):
        """Copies contacts' damper speeds from their rows to the state."""
        for p in range(drive.sprockets * drive.points + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                access.store(state.damper_speed, at + i, access.load(w, first + i))

    @wp.func
    def is_beginning(w: wp.array[Real], i: int):
        """1 where roller i's contact begins by its rows, else 0."""
        return wp.where(
            access.load(w, row.penetration + i) > Real(0.0) and access.load(w, row.v0_before + i) <= Real(0.0), 1, 0
        )

    @wp.func
    def add_force_sizes(w: wp.array[Real], group: Group, sizes: int):
        """Adds sizes of contacts' normal forces to row `sizes`, for frames."""
        i = group.low
        while i < group.high:
            access.store(w, sizes + i, access.load(w, sizes + i) + access.load(w, row.force_size + i))
            i = i + 1

    return ContactRowFunctions(
        recall_impact_speed=recall_impact_speed,
        keep_impact_speeds=keep_impact_speeds,
        store_arm=store_arm,
        store_contact=store_contact,
        store_place=store_place,
        damper_row=damper_row,
        link_contacts=link_contacts,
        push_row=push_row,
        speed_row=speed_row,
        fetch_dampers=fetch_dampers,
        put_back_dampers=put_back_dampers,
        is_beginning=is_beginning,
        add_force_sizes=add_force_sizes,
    )
