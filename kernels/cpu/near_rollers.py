"""Rollers near a sprocket or guide on the CPU, and the memory of contacts that leave it."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.body import pose_of
from ..structs import GROUND, Drive, types
from .contact_rows import contact_row_functions
from .guides import guide_functions
from .neighbor_list import GROUP, lowest_bit, neighbor_list_functions, without_lowest_bit
from .partners import partner_functions
from .rollers import rows
from .seats import seat_functions


@dataclass(frozen=True)
class NearRollerFunctions:
    """CPU near roller functions."""

    find_poses: wp.Function
    memory_at_chain: wp.Function
    contact_memory: wp.Function
    rebuild_neighbor_list: wp.Function
    near_group: wp.Function
    find_gap_contacts: wp.Function


@cache
def near_roller_functions(Real: type, capacity: int) -> NearRollerFunctions:
    """CPU near roller functions."""
    kinds = types(Real)
    Ensemble, State, Memory = kinds.Ensemble, kinds.State, kinds.Memory
    partners = partner_functions(Real)
    seats = seat_functions(Real, capacity)
    guides = guide_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)
    seat_access = row_access(wp.int32)
    row = rows(capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def find_poses(state: State, drive: Drive):
        """Sets poses of all bodies of a drive on the CPU."""
        # one right after the other: each is a long chain of operations that waits for itself only
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.poses[b] = pose_of(state.bodies[b])

    @wp.func
    def memory_at_chain(memory: Memory, drive: Drive, chain: kinds.Chain):
        """Contact memory at a drive's first partner, for its chain."""
        memory.first = drive.first_contact
        memory.inverse_mass = chain.inverse_mass
        memory.gravity = chain.gravity
        memory.unlike_masses = chain.unlike_masses
        return memory

    @wp.func
    def contact_memory(state: State, drive: Drive):
        """Contact memory at a drive's first partner on the CPU, before `memory_at_chain`."""
        memory = Memory()
        memory.seat = state.seat
        memory.impact_speed = state.impact_speed
        memory.bristle = state.contact_hold
        memory.stretch_part = Real(1.0)
        memory.first = drive.first_contact
        if drive.integrator == 0:
            memory.lag = Real(wp.float64(0.5) * drive.step)
        return memory

    @wp.func
    def mark_near(w: wp.array[Real], first: int, end: int, partner: partners.Partner):
        """Marks rollers `first` to before `end` that are near a partner."""
        if partner.teeth != 0:
            seats.mark_engaged(w, first, end, partner.sprocket, partner.pose)
        elif partner.guide.pieces == 0:
            guides.mark_over_bar(w, first, end, partner.guide)
        else:
            guides.mark_over_profile(w, first, end, partner.guide, partner.pose)

    @wp.func
    def forget_seats(w: wp.array[Real], first: int, count: int, near: wp.uint64, points: int, memory: Memory):
        """Clears seats or pieces, and contacts, of rollers not near; returns those with one, as bits."""
        seated = seat_access.find_unlike(memory.seat, memory.first + first, count, -1)
        left = seated & ~near
        while left != wp.uint64(0):
            i = memory.first + first + lowest_bit(left)
            seat_access.store(memory.seat, i, -1)
            access.store(memory.impact_speed, i, Real(0.0))
            if points > 1:
                for k in range(points):
                    access.store(w, memory.speed_row + k * wp.static(capacity) + i - memory.first, Real(0.0))
            left = without_lowest_bit(left)
        return seated

    @wp.func
    def forget_partner(
        w: wp.array[Real], first: int, count: int, near: wp.uint64, partner: partners.Partner, memory: Memory
    ):
        """Clears contacts with a partner of rollers not near; returns those with a seat or piece, as bits."""
        seated = wp.uint64(0)
        if partner.teeth != 0 or partner.guide.pieces != 0:
            seated = forget_seats(w, first, count, near, partner.points, memory)
            if partner.teeth != 0:
                seats.forget_directions(w, first, seated & ~near)
        elif memory.stage == 0:
            guides.forget_bar(first, count, near, memory)
        return seated

    @wp.func(inline=False)
    def rebuild_neighbor_list(ensemble: kinds.Ensemble, state: State, drive: Drive, w: wp.array[Real]):
        """Rebuilds the neighbor list of all partners, all rollers for a moving guide."""
        n = drive.rollers
        memory = contact_memory(state, drive)
        skin = neighbor_list.skin_width(w)
        find_poses(state, drive)
        for p in range(drive.sprockets + drive.guides):
            partner = partners.partner_at(ensemble, state, drive, p)
            memory.speed_row = contact_rows.speed_row(drive, p * drive.points)
            if partner.teeth != 0 or partner.body == GROUND:
                mark_near(w, 0, access.round_up(n), partners.widened_partner(partner, skin))
            else:
                neighbor_list.mark_all_near(w, n)
            neighbor_list.store_runs(w, n, p)
            first = int(0)
            while first < n:
                count = wp.min(n - first, GROUP)
                forget_partner(
                    w, first, count, access.find_unlike(w, row.near + first, count, Real(0.0)), partner, memory
                )
                first = first + GROUP
            memory.first = memory.first + n * partner.points
        neighbor_list.set_lifetime(w, drive)

    @wp.func
    def near_group(w: wp.array[Real], first: int, end: int, n: int, partner: partners.Partner, memory: Memory):
        """Group of rollers `first` to before `end` near a partner; clears other contacts."""
        mark_near(w, first, end, partner)
        count = wp.min(n, end) - first
        near = access.find_unlike(w, row.near + first, count, Real(0.0))
        had = forget_partner(w, first, count, near, partner, memory)
        if near != wp.uint64(0):
            group = neighbor_list.near_group(first, near, near & ~had)
            return group
        group = neighbor_list.whole_group(first, first)
        return group

    @wp.func(inline=True)
    def find_gap_contacts(
        w: wp.array[Real], ensemble: Ensemble, first: int, end: int, n: int, partner: partners.Partner, memory: Memory
    ):
        """Stores tooth gap coordinates of rollers `first` to before `end`; returns the group that may touch."""
        # in most steps no roller comes, leaves or changes its seat
        moved, others = seats.find_gap_coordinates(w, first, end, n, partner.sprocket, partner.pose, partner.body)
        if others != 0 or moved != wp.uint64(0):
            group = near_group(w, first, end, n, partner, memory)
            if group.high > group.low:
                seats.update_seats(w, group, n, partner.sprocket, partner.pose, partner.body, ensemble.seats, memory)
            return group
        group = neighbor_list.whole_group(first, end)
        return group

    return NearRollerFunctions(
        find_poses=find_poses,
        memory_at_chain=memory_at_chain,
        contact_memory=contact_memory,
        rebuild_neighbor_list=rebuild_neighbor_list,
        near_group=near_group,
        find_gap_contacts=find_gap_contacts,
    )
