"""Seats of rollers in one sprocket on the CPU, and rollers' gap coordinates."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import load_constant, row_access
from ..physics.tooth import gap_coordinates, nearest_seat, seat_step, tracked_seat
from ..structs import Pose, types
from .neighbor_list import Group, lowest_bit, single_bit, without_lowest_bit
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class SeatFunctions:
    """CPU seat functions."""

    mark_engaged: wp.Function
    forget_directions: wp.Function
    keep_impact_speeds: wp.Function
    find_gap_coordinates: wp.Function
    update_seats: wp.Function


@cache
def seat_functions(Real: type, capacity: int) -> SeatFunctions:
    """CPU seat functions."""
    Memory, Sprocket = types(Real).Memory, types(Real).Sprocket
    compensated = Real == wp.float32
    rollers = roller_functions(Real, capacity)
    row = rows(capacity)
    access = row_access(Real)
    seat_access = row_access(wp.int32)

    @wp.func
    def mark_engaged(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose):
        """Marks rollers `first` to before `end` that are between a sprocket's teeth."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        i = first
        while i < end:
            x = access.load(w, row.x + i) - center_x
            y = access.load(w, row.y + i) - center_y
            square = x * x + y * y
            near = Real(0.0)
            if square > sprocket.near_square and square < sprocket.far_square:
                near = wp.where(sprocket.pin == 0 or sprocket.pin == i + 1, Real(1.0), Real(0.0))
            access.store(w, row.near + i, near)
            i = i + 1

    @wp.func
    def forget_directions(w: wp.array[Real], first: int, which: wp.uint64):
        """Clears the seats' directions of rollers, bits `which` from `first` on."""
        bits = which
        while bits != wp.uint64(0):
            access.store(w, row.direction_owner + first + lowest_bit(bits), Real(-1.0))
            bits = without_lowest_bit(bits)

    @wp.func
    def keep_impact_speeds(w: wp.array[Real], first: int, end: int, number: int, memory: Memory):
        """Copies v0 of contacts with sprocket `number` from rows to memory."""
        i = first
        while i < end:
            if access.load(w, row.direction_owner + i) == Real(number):
                access.store(w, row.v0_of_seat + i, access.load(w, row.v0_kept + i))
                access.store(memory.impact_speed, memory.first + i, access.load(w, row.v0_kept + i))
            i = i + 1

    @wp.func
    def find_seats(w: wp.array[Real], group: Group, sprocket: Sprocket, body: Pose, memory: Memory):
        """Stores the seats of rollers that have none yet, by angle."""
        bits = group.fresh
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            number = nearest_seat(rollers.exact_position(w, i) - body.center, body.cosine, body.sine, sprocket.teeth)
            seat_access.store(memory.seat, memory.first + i, number)
            bits = without_lowest_bit(bits)

    @wp.func
    def store_compensated(w: wp.array[Real], high: int, low: int, value: wp.float64):
        """Stores a float64 in a row for seats; at float32 its rounding in row `low`."""
        rounded = Real(value)
        access.store(w, high, rounded)
        if wp.static(compensated):
            access.store(w, low, Real(value - wp.float64(rounded)))

    @wp.func
    def load_compensated(w: wp.array[Real], high: int, low: int):
        """Float64 that `store_compensated` has stored in rows for seats."""
        value = wp.float64(access.load(w, high))
        if wp.static(compensated):
            value += wp.float64(access.load(w, low))
        return value

    @wp.func
    def find_directions(
        w: wp.array[Real],
        first: int,
        which: wp.uint64,
        number: int,
        sprocket: Sprocket,
        seats: wp.array[wp.vec2d],
        memory: Memory,
    ):
        """Stores seats' directions at angle zero of rollers, bits `which` from `first` on."""
        bits = which
        while bits != wp.uint64(0):
            i = first + lowest_bit(bits)
            direction = load_constant(seats, sprocket.first_seat + seat_access.load(memory.seat, memory.first + i))
            store_compensated(w, row.direction_x + i, row.direction_x_low + i, direction[0])
            store_compensated(w, row.direction_y + i, row.direction_y_low + i, direction[1])
            access.store(w, row.direction_owner + i, Real(number))
            access.store(w, row.v0_of_seat + i, access.load(memory.impact_speed, memory.first + i))
            bits = without_lowest_bit(bits)

    @wp.func
    def find_gap_coordinates(
        w: wp.array[Real], first: int, end: int, n: int, sprocket: Sprocket, body: Pose, number: int
    ):
        """Stores gap coordinates of rollers by their kept seats on sprocket `number`.

        Returns those nearer to another seat, as bits, and 1 if others are near than have a seat.
        """
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        tangent = wp.float64(sprocket.half_pitch_tangent)
        moved = wp.uint64(0)
        others = int(0)
        i = first
        while i < end:
            x = access.load(w, row.x + i) - center_x
            y = access.load(w, row.y + i) - center_y
            square = x * x + y * y
            near = i < n and square > sprocket.near_square and square < sprocket.far_square
            seated = access.load(w, row.direction_owner + i) == Real(number)
            others = others | wp.where(near == seated, 0, 1)
            p = rollers.exact_position(w, i) - body.center
            direction_x = load_compensated(w, row.direction_x + i, row.direction_x_low + i)
            direction_y = load_compensated(w, row.direction_y + i, row.direction_y_low + i)
            outward, radial, xi, lateral = gap_coordinates(p, wp.vec2d(direction_x, direction_y), body, sprocket)
            moved = moved | wp.where(
                near and seat_step(radial, lateral, tangent) != 0, single_bit(i - first), wp.uint64(0)
            )
            access.store(w, row.radial + i, Real(xi))
            access.store(w, row.lateral + i, Real(lateral))
            access.store(w, row.outward_x + i, Real(outward[0]))
            access.store(w, row.outward_y + i, Real(outward[1]))
            i = i + 1
        return moved, others

    @wp.func
    def change_seats(
        w: wp.array[Real],
        group: Group,
        moved: wp.uint64,
        sprocket: Sprocket,
        body: Pose,
        seats: wp.array[wp.vec2d],
        memory: Memory,
    ):
        """Changes seats of rollers, bits `moved`, nearer to another one."""
        bits = moved
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            kept = seat_access.load(memory.seat, memory.first + i)
            number, e, xi, lateral = tracked_seat(
                rollers.exact_position(w, i) - body.center, kept, body, sprocket, seats
            )
            seat_access.store(memory.seat, memory.first + i, number)
            bits = without_lowest_bit(bits)

    @wp.func(inline=False)
    def update_seats(
        w: wp.array[Real],
        group: Group,
        n: int,
        sprocket: Sprocket,
        body: Pose,
        number: int,
        seats: wp.array[wp.vec2d],
        memory: Memory,
    ):
        """Stores seats and gap coordinates of a group in one sprocket."""
        find_seats(w, group, sprocket, body, memory)
        other = access.find_unlike(w, row.direction_owner + group.first, group.high - group.first, Real(number))
        find_directions(w, group.first, group.near & (other | group.fresh), number, sprocket, seats, memory)
        moved, others = find_gap_coordinates(w, group.low, group.high, n, sprocket, body, number)
        if moved != wp.uint64(0):
            moved = moved << wp.uint64(group.low - group.first)
            change_seats(w, group, moved, sprocket, body, seats, memory)
            find_directions(w, group.first, moved, number, sprocket, seats, memory)
            find_gap_coordinates(w, group.low, group.high, n, sprocket, body, number)

    return SeatFunctions(
        mark_engaged=mark_engaged,
        forget_directions=forget_directions,
        keep_impact_speeds=keep_impact_speeds,
        find_gap_coordinates=find_gap_coordinates,
        update_seats=update_seats,
    )
