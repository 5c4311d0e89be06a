"""Contacts of a group of rollers with one partner, in the rows of a scratch, and what contacts remember.

Teeth, guide-bars and profiles put how rollers touch them into rows (`store_contact`); all that follows is the same for
all. What tracks a seat or a piece goes from roller to roller; the rest are plain loops over rows, from the first roller
of the group that is near to the last, which vectorize (see `rollers`). A roller in between that is not near has the
penetration of one that does not touch.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..structs import Drive, types
from .neighbor_list import Group, is_near
from .rollers import ROWS, rows


@dataclass(frozen=True)
class ContactRowFunctions:
    """Functions that keep contacts with the partner at hand in the rows of a scratch."""

    recall_impact_speed: wp.Function
    keep_impact_speeds: wp.Function
    store_arm: wp.Function
    store_contact: wp.Function
    damper_row: wp.Function
    fetch_dampers: wp.Function
    put_back_dampers: wp.Function
    is_beginning: wp.Function
    add_force_sizes: wp.Function


@cache
def contact_row_functions(Real: type, capacity: int) -> ContactRowFunctions:
    """The functions that keep contacts in rows, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, State = kinds.Memory, kinds.State
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def recall_impact_speed(w: wp.array[Real], i: int, group: Group, memory: Memory):
        """Stores and returns the v0 that roller i's contact has kept until now [m/s]."""
        before = Real(0.0)
        if is_near(group, i):
            before = access.load(memory.impact_speed, memory.first + i)
        access.store(w, row.v0_before + i, before)
        return before

    @wp.func
    def keep_impact_speeds(w: wp.array[Real], group: Group, memory: Memory):
        """Keeps the contacts' v0 in their memory."""
        i = group.low
        while i < group.high:
            if is_near(group, i):
                access.store(memory.impact_speed, memory.first + i, access.load(w, row.v0_kept + i))
            i = i + 1

    @wp.func
    def store_arm(w: wp.array[Real], i: int, x: Real, y: Real):
        """Stores where roller i is from the center of the partner's body [m]."""
        access.store(w, row.arm_x + i, x)
        access.store(w, row.arm_y + i, y)

    @wp.func
    def store_contact(
        w: wp.array[Real], i: int, penetration: Real, normal_x: Real, normal_y: Real, relative_x: Real, relative_y: Real
    ):
        """Stores roller i's penetration, `AWAY` where it is not near, normal and relative velocity, in numbers."""
        access.store(w, row.penetration + i, penetration)
        access.store(w, row.normal_x + i, normal_x)
        access.store(w, row.normal_y + i, normal_y)
        access.store(w, row.relative_x + i, relative_x)
        access.store(w, row.relative_y + i, relative_y)

    @wp.func
    def damper_row(p: int):
        """First index of the row of speeds at which dampers of contacts with partner p acted in the step before."""
        return wp.static(len(ROWS) * capacity) + p * wp.static(capacity)

    @wp.func
    def fetch_dampers(state: State, drive: Drive, w: wp.array[Real]):
        """Brings the rows of dampers' speeds from the state, as a launch begins."""
        for p in range(drive.sprockets + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                access.store(w, first + i, access.load(state.damper_speed, at + i))

    @wp.func
    def put_back_dampers(state: State, drive: Drive, w: wp.array[Real]):
        """Brings the rows of dampers' speeds back into the state, as a launch ends."""
        for p in range(drive.sprockets + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                access.store(state.damper_speed, at + i, access.load(w, first + i))

    @wp.func
    def is_beginning(w: wp.array[Real], i: int):
        """1 where roller i's contact begins."""
        return wp.where(
            access.load(w, row.penetration + i) > Real(0.0) and access.load(w, row.v0_before + i) <= Real(0.0), 1, 0
        )

    @wp.func
    def add_force_sizes(w: wp.array[Real], group: Group, sizes: int):
        """Adds the normal forces' magnitudes to row `sizes`, for frames."""
        i = group.low
        while i < group.high:
            access.store(w, sizes + i, access.load(w, sizes + i) + access.load(w, row.force_size + i))
            i = i + 1

    return ContactRowFunctions(
        recall_impact_speed=recall_impact_speed,
        keep_impact_speeds=keep_impact_speeds,
        store_arm=store_arm,
        store_contact=store_contact,
        damper_row=damper_row,
        fetch_dampers=fetch_dampers,
        put_back_dampers=put_back_dampers,
        is_beginning=is_beginning,
        add_force_sizes=add_force_sizes,
    )
