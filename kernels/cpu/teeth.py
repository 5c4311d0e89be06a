"""The CPU kernel's passes over a group of rollers for one sprocket: who is near, in which seat, how deep."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import accessors, load_constant
from ..physics.contact import AWAY, UNTOUCHED, memory_after_teeth, rotated_components
from ..physics.tooth import gap_coordinates, is_beyond_tip, nearest_seat, seat_step, tip_gap, tipless_gap, tracked_seat
from ..structs import Pose, types
from .contacts import contact_rows
from .neighbor_list import Group, bit_of, lowest_bit, next_bits
from .rollers import passes, rows


@cache
def seat_passes(Real: type, capacity: int) -> SimpleNamespace:
    """The passes that find the seats of rollers in one sprocket, for rows of `capacity` values of type `Real`."""
    Memory, Sprocket = types(Real).Memory, types(Real).Sprocket
    compensated = Real == wp.float32
    place, row = passes(Real, capacity).place, rows(capacity)
    load_row, store_row, unlike = accessors(Real).load_row, accessors(Real).store_row, accessors(Real).unlike
    load_seat, store_seat = accessors(wp.int32).load_row, accessors(wp.int32).store_row

    @wp.func
    def find_engaged(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose):
        """Which rollers are between the teeth, of those from `first` on."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        i = first
        while i < end:
            x = load_row(w, row.x + i) - center_x
            y = load_row(w, row.y + i) - center_y
            square = x * x + y * y
            near = Real(0.0)
            if square > sprocket.near_square and square < sprocket.far_square:
                near = Real(1.0)
            store_row(w, row.near + i, near)
            i = i + 1

    @wp.func
    def disengage(w: wp.array[Real], first: int, rollers: wp.uint64):
        """Forgets to where the seats of some rollers from `first` on point."""
        bits = rollers
        while bits != wp.uint64(0):
            store_row(w, row.direction_of + first + lowest_bit(bits), Real(-1.0))
            bits = next_bits(bits)

    @wp.func
    def keep(w: wp.array[Real], first: int, end: int, number: int, memory: Memory):
        """Sets the v0 that contacts with sprocket `number` of the drive keep from now on."""
        i = first
        while i < end:
            if load_row(w, row.direction_of + i) == Real(number):
                store_row(w, row.held + i, load_row(w, row.kept + i))
                store_row(memory.impact_speed, memory.first + i, load_row(w, row.kept + i))
            i = i + 1

    @wp.func
    def find_seats(w: wp.array[Real], group: Group, sprocket: Sprocket, body: Pose, memory: Memory):
        """The seats of rollers that have none yet, by angle."""
        bits = group.fresh
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            number = nearest_seat(place(w, i) - body.center, body.cosine, body.sine, sprocket.teeth)
            store_seat(memory.seat, memory.first + i, number)
            bits = next_bits(bits)

    @wp.func
    def store_half(w: wp.array[Real], high: int, low: int, value: wp.float64):
        """A value at the rows' precision, and at float32 what that rounds off."""
        rounded = Real(value)
        store_row(w, high, rounded)
        if wp.static(compensated):
            store_row(w, low, Real(value - wp.float64(rounded)))

    @wp.func
    def load_half(w: wp.array[Real], high: int, low: int):
        """Such a value."""
        value = wp.float64(load_row(w, high))
        if wp.static(compensated):
            value += wp.float64(load_row(w, low))
        return value

    @wp.func
    def find_directions(
        w: wp.array[Real],
        first: int,
        rollers: wp.uint64,
        number: int,
        sprocket: Sprocket,
        seats: wp.array[wp.vec2d],
        memory: Memory,
    ):
        """To where the seats of some rollers from `first` on point at angle zero; sprocket `number` has them."""
        bits = rollers
        while bits != wp.uint64(0):
            i = first + lowest_bit(bits)
            direction = load_constant(seats, sprocket.first_seat + load_seat(memory.seat, memory.first + i))
            store_half(w, row.direction_x + i, row.direction_x_low + i, direction[0])
            store_half(w, row.direction_y + i, row.direction_y_low + i, direction[1])
            store_row(w, row.direction_of + i, Real(number))
            store_row(w, row.held + i, load_row(memory.impact_speed, memory.first + i))
            bits = next_bits(bits)

    @wp.func
    def place_in_gaps(w: wp.array[Real], first: int, end: int, n: int, sprocket: Sprocket, body: Pose, number: int):
        """Where the rollers are in the gaps of the seats that they have kept on sprocket `number` of the drive.

        Returns who of them has come nearer to another seat, as bits, and 1 if others are near than those who have one.
        """
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        tangent = wp.float64(sprocket.half_pitch_tangent)
        moved = wp.uint64(0)
        others = int(0)
        i = first
        while i < end:
            x = load_row(w, row.x + i) - center_x
            y = load_row(w, row.y + i) - center_y
            square = x * x + y * y
            near = i < n and square > sprocket.near_square and square < sprocket.far_square
            seated = load_row(w, row.direction_of + i) == Real(number)
            others = others | wp.where(near == seated, 0, 1)
            p = place(w, i) - body.center
            direction_x = load_half(w, row.direction_x + i, row.direction_x_low + i)
            direction_y = load_half(w, row.direction_y + i, row.direction_y_low + i)
            outward, radial, xi, lateral = gap_coordinates(p, wp.vec2d(direction_x, direction_y), body, sprocket)
            moved = moved | wp.where(near and seat_step(radial, lateral, tangent) != 0, bit_of(i - first), wp.uint64(0))
            store_row(w, row.radial + i, Real(xi))
            store_row(w, row.lateral + i, Real(lateral))
            store_row(w, row.outward_x + i, Real(outward[0]))
            store_row(w, row.outward_y + i, Real(outward[1]))
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
        """Brings rollers that have come nearer to another seat there, as `tooth.tracked_seat` does."""
        bits = moved
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            kept = load_seat(memory.seat, memory.first + i)
            number, e, xi, lateral = tracked_seat(place(w, i) - body.center, kept, body, sprocket, seats)
            store_seat(memory.seat, memory.first + i, number)
            bits = next_bits(bits)

    @wp.func(inline=False)
    def seat_rollers(
        w: wp.array[Real],
        group: Group,
        n: int,
        sprocket: Sprocket,
        body: Pose,
        number: int,
        seats: wp.array[wp.vec2d],
        memory: Memory,
    ):
        """The seats of the rollers of a group that are near, and where they are in their gaps."""
        find_seats(w, group, sprocket, body, memory)
        other = unlike(w, row.direction_of + group.first, group.high - group.first, Real(number))
        find_directions(w, group.first, group.near & (other | group.fresh), number, sprocket, seats, memory)
        moved, others = place_in_gaps(w, group.low, group.high, n, sprocket, body, number)
        if moved != wp.uint64(0):
            moved = moved << wp.uint64(group.low - group.first)
            change_seats(w, group, moved, sprocket, body, seats, memory)
            find_directions(w, group.first, moved, number, sprocket, seats, memory)
            place_in_gaps(w, group.low, group.high, n, sprocket, body, number)

    return SimpleNamespace(**locals())


@cache
def teeth_passes(Real: type, capacity: int) -> SimpleNamespace:
    """The passes over rollers that have seats in one sprocket, for rows of `capacity` values of type `Real`."""
    Sprocket, row = types(Real).Sprocket, rows(capacity)
    place, contact = passes(Real, capacity).place, contact_rows(Real, capacity)
    place_arm, touch = contact.place_arm, contact.touch
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row

    @wp.func
    def stand(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """Stores the rollers' contacts in their gaps, as `tooth.tooth_contact` but for tips; 1 if any is at a tip."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        center_vx = Real(body.velocity[0])
        center_vy = Real(body.velocity[1])
        omega = Real(body.speed)
        tipped = int(0)
        i = first
        while i < end:
            xi = load_row(w, row.radial + i)
            lateral = load_row(w, row.lateral + i)
            penetration, along, across = tipless_gap(xi, lateral, sprocket)
            seated = load_row(w, row.direction_of + i) == Real(number)
            depth = wp.where(seated, penetration, Real(AWAY))
            tipped = tipped | wp.where(is_beyond_tip(depth, xi, lateral, sprocket), 1, 0)
            p = place(w, i) - body.center
            relative_x = -omega * Real(p[1]) - (load_row(w, row.vx + i) - center_vx)
            relative_y = omega * Real(p[0]) - (load_row(w, row.vy + i) - center_vy)
            normal_x, normal_y = rotated_components(
                load_row(w, row.outward_x + i), load_row(w, row.outward_y + i), along, across
            )
            before = wp.where(seated, load_row(w, row.held + i), Real(0.0))
            place_arm(w, i, load_row(w, row.x + i) - center_x, load_row(w, row.y + i) - center_y)
            touch(w, i, depth, normal_x, normal_y, relative_x, relative_y)
            store_row(w, row.before + i, before)
            store_row(w, row.open + i, memory_after_teeth(before))
            i = i + 1
        return tipped

    @wp.func
    def stand_in_gaps(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """As `stand`, of straight flanks in a loop of its own."""
        if sprocket.flank_curvature > Real(0.0):
            tipped = stand(w, first, end, sprocket, body, number)
            return tipped
        sprocket.flank_curvature = Real(0.0)  # so that the compiler knows
        tipped = stand(w, first, end, sprocket, body, number)
        return tipped

    @wp.func
    def touch_tips(w: wp.array[Real], first: int, end: int, sprocket: Sprocket):
        """Mends the depths and normals of rollers at tips, which are few."""
        i = first
        while i < end:
            xi = load_row(w, row.radial + i)
            lateral = load_row(w, row.lateral + i)
            if is_beyond_tip(load_row(w, row.penetration + i), xi, lateral, sprocket):
                penetration, along, across = tip_gap(xi, lateral, sprocket)
                normal_x, normal_y = rotated_components(
                    load_row(w, row.outward_x + i), load_row(w, row.outward_y + i), along, across
                )
                store_row(w, row.penetration + i, penetration)
                store_row(w, row.normal_x + i, normal_x)
                store_row(w, row.normal_y + i, normal_y)
            i = i + 1

    @wp.func
    def touch_teeth(w: wp.array[Real], first: int, end: int, sprocket: Sprocket, body: Pose, number: int):
        """Stores the contacts of the rollers that have seats."""
        tipped = stand_in_gaps(w, first, end, sprocket, body, number)
        if tipped != 0:
            touch_tips(w, first, end, sprocket)

    @wp.func
    def first_touches(w: wp.array[Real], group: Group):
        """The number of rollers that touch for the first time in their pass."""
        count = int(0)
        i = group.low
        while i < group.high:
            if load_row(w, row.penetration + i) > Real(0.0) and load_row(w, row.before + i) == Real(UNTOUCHED):
                count = count + 1
            i = i + 1
        return count

    return SimpleNamespace(**locals())
