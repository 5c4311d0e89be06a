"""The CPU kernel's passes over a group of rollers for one sprocket: who is near, in which seat, how deep."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import UNTOUCHED, after_teeth, in_gap, load_direction, tracked_seat, turned
from ..physics.tooth import beyond_tip, endless_gap, nearest_seat, on_tip, seat_step
from ..rows import accessors, whole
from ..structs import Pose, types
from .contacts import Group, bit_of, contacts, is_near, lowest_bit, next_bits
from .rollers import passes, rows


@dataclass(frozen=True)
class TeethPasses:
    """The passes for one sprocket, in the order in which they are made."""

    find_engaged: wp.Function
    seat_rollers: wp.Function
    touch_teeth: wp.Function
    first_touches: wp.Function


@cache
def teeth_passes(Real: type, capacity: int) -> TeethPasses:
    """The passes for one sprocket, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2, place, touch = kinds.vec2, passes(Real, capacity).place, contacts(Real, capacity).touch
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_double, store_double = accessors(Real).load_double, accessors(Real).store_double
    load_seat, store_seat = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    at = rows(capacity)
    X, Y, VX, VY, NEAR, DIRECTION_X, DIRECTION_Y = at.x, at.y, at.vx, at.vy, at.near, at.direction_x, at.direction_y
    RADIAL, LATERAL, OUTWARD_X, OUTWARD_Y = at.radial, at.lateral, at.outward_x, at.outward_y
    BEFORE, OPEN, PENETRATION, NORMAL_X, NORMAL_Y = at.before, at.open, at.penetration, at.normal_x, at.normal_y

    @wp.func
    def find_engaged(w: wp.array[Real], n: int, sprocket: kinds.Sprocket, body: Pose):
        """Which rollers are between the teeth."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        i = int(0)
        while i < whole(n):
            x = load_row(w, X + i) - center_x
            y = load_row(w, Y + i) - center_y
            square = x * x + y * y
            near = Real(0.0)
            if square > sprocket.near_square and square < sprocket.far_square:
                near = Real(1.0)
            store_row(w, NEAR + i, near)
            i = i + 1

    @wp.func
    def find_seats(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, body: Pose, memory: kinds.Memory):
        """The seats of rollers that have none yet, by angle."""
        bits = group.fresh
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            number = nearest_seat(place(w, i) - body.center, body.cosine, body.sine, sprocket.teeth)
            store_seat(memory.seat, memory.first + i, number)
            bits = next_bits(bits)

    @wp.func
    def find_directions(
        w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, seats: wp.array[wp.vec2d], memory: kinds.Memory
    ):
        """To where the rollers' seats point at angle zero."""
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            direction = load_direction(seats, sprocket.first_seat + load_seat(memory.seat, memory.first + i))
            store_double(w, DIRECTION_X, i, direction[0])
            store_double(w, DIRECTION_Y, i, direction[1])
            bits = next_bits(bits)

    @wp.func
    def store_gap(w: wp.array[Real], i: int, outward: wp.vec2d, radial: wp.float64, lateral: wp.float64):
        """Where roller i is in its gap."""
        store_row(w, RADIAL + i, Real(radial))
        store_row(w, LATERAL + i, Real(lateral))
        store_row(w, OUTWARD_X + i, Real(outward[0]))
        store_row(w, OUTWARD_Y + i, Real(outward[1]))

    @wp.func
    def gaps(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, body: Pose):
        """Where rollers are in the gaps of the seats that they have kept; who has come nearer to another, as bits."""
        tangent = wp.float64(sprocket.half_pitch_tangent)
        moved = wp.uint64(0)
        i = group.low
        while i < group.high:
            direction = wp.vec2d(load_double(w, DIRECTION_X, i), load_double(w, DIRECTION_Y, i))
            p = place(w, i) - body.center
            outward, radial, lateral = in_gap(p, direction, body.cosine, body.sine)
            store_gap(w, i, outward, radial - sprocket.exact_radius, lateral)
            if seat_step(radial, lateral, tangent) != 0:
                moved = moved | bit_of(i - group.first)
            i = i + 1
        return moved & group.near

    @wp.func
    def seat_rollers(
        w: wp.array[Real],
        group: Group,
        sprocket: kinds.Sprocket,
        body: Pose,
        seats: wp.array[wp.vec2d],
        memory: kinds.Memory,
    ):
        """The seat of every roller near, and where it is in the seat's gap, as from `contact.tracked_seat`."""
        find_seats(w, group, sprocket, body, memory)
        find_directions(w, group, sprocket, seats, memory)
        moved = gaps(w, group, sprocket, body)
        while moved != wp.uint64(0):
            i = group.first + lowest_bit(moved)
            kept = load_seat(memory.seat, memory.first + i)
            seat = tracked_seat(place(w, i) - body.center, kept, body.cosine, body.sine, sprocket, seats)
            store_seat(memory.seat, memory.first + i, seat.number)
            store_gap(w, i, seat.outward, seat.radial - sprocket.exact_radius, seat.lateral)
            moved = next_bits(moved)

    @wp.func
    def touch_flanks(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, body: Pose):
        """How the rollers stand in their gaps, eq. (5)-(14), as `contact.in_teeth` but for tips; 1 if any is at one."""
        center_x = Real(body.center[0])
        center_y = Real(body.center[1])
        center_vx = Real(body.velocity[0])
        center_vy = Real(body.velocity[1])
        omega = Real(body.speed)
        tipped = int(0)
        i = group.low
        while i < group.high:
            arm = vec2(load_row(w, X + i) - center_x, load_row(w, Y + i) - center_y)
            p = place(w, i) - body.center
            v = vec2(load_row(w, VX + i) - center_vx, load_row(w, VY + i) - center_vy)
            xi = load_row(w, RADIAL + i)
            lateral = load_row(w, LATERAL + i)
            penetration, along, across = endless_gap(xi, lateral, sprocket)
            depth = wp.where(is_near(group, i), penetration, Real(0.0))
            tipped = tipped | wp.where(beyond_tip(depth, xi, lateral, sprocket), 1, 0)
            normal = turned(vec2(load_row(w, OUTWARD_X + i), load_row(w, OUTWARD_Y + i)), along, across)
            surface = vec2(-omega * Real(p[1]), omega * Real(p[0]))
            touch(w, i, arm, depth, normal, surface - v)
            store_row(w, OPEN + i, after_teeth(load_row(w, BEFORE + i)))
            i = i + 1
        return tipped

    @wp.func
    def touch_tips(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket):
        """Mends the depths and normals of rollers at tips, which are few."""
        i = group.low
        while i < group.high:
            xi = load_row(w, RADIAL + i)
            lateral = load_row(w, LATERAL + i)
            if beyond_tip(load_row(w, PENETRATION + i), xi, lateral, sprocket):
                penetration, along, across = on_tip(xi, lateral, sprocket)
                normal = turned(vec2(load_row(w, OUTWARD_X + i), load_row(w, OUTWARD_Y + i)), along, across)
                store_row(w, PENETRATION + i, penetration)
                store_row(w, NORMAL_X + i, normal[0])
                store_row(w, NORMAL_Y + i, normal[1])
            i = i + 1

    @wp.func
    def touch_teeth(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, body: Pose):
        """How the rollers stand in their gaps, of straight flanks in a loop of its own."""
        tipped = int(0)
        if sprocket.flank_curvature > Real(0.0):
            tipped = touch_flanks(w, group, sprocket, body)
        else:
            sprocket.flank_curvature = Real(0.0)  # so that the compiler knows
            tipped = touch_flanks(w, group, sprocket, body)
        if tipped != 0:
            touch_tips(w, group, sprocket)

    @wp.func
    def first_touches(w: wp.array[Real], group: Group):
        """How many rollers touch for the first time in their pass."""
        count = int(0)
        i = group.low
        while i < group.high:
            if load_row(w, PENETRATION + i) > Real(0.0) and load_row(w, BEFORE + i) == Real(UNTOUCHED):
                count = count + 1
            i = i + 1
        return count

    return TeethPasses(find_engaged, seat_rollers, touch_teeth, first_touches)
