"""The CPU kernel's passes over a group of rollers for one sprocket: who is near, in which seat, how deep."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import UNTOUCHED, after_teeth, tracked_seat, turned
from ..physics.tooth import beyond_tip, endless_gap, on_tip
from ..rows import accessors
from ..structs import Pose, types
from .contacts import Group, bit_of, contacts, is_near, lowest_bit, next_bits
from .rollers import passes, rows


@dataclass(frozen=True)
class TeethPasses:
    """The passes for one sprocket, in the order in which they are made."""

    engaged: wp.Function
    seat_rollers: wp.Function
    touch_teeth: wp.Function
    first_touches: wp.Function


@cache
def teeth_passes(Real: type, capacity: int) -> TeethPasses:
    """The passes for one sprocket, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2, place, touch = kinds.vec2, passes(Real, capacity).place, contacts(Real, capacity).touch
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_seat, store_seat = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    at = rows(capacity)
    X, Y, VX, VY = at.x, at.y, at.vx, at.vy
    RADIAL, LATERAL, OUTWARD_X, OUTWARD_Y = at.radial, at.lateral, at.outward_x, at.outward_y
    BEFORE, OPEN, PENETRATION, NORMAL_X, NORMAL_Y = at.before, at.open, at.penetration, at.normal_x, at.normal_y

    @wp.func
    def center_of(body: Pose):
        """The sprocket's center [m]."""
        return vec2(Real(body.center[0]), Real(body.center[1]))

    @wp.func
    def engaged(w: wp.array[Real], first: int, count: int, sprocket: kinds.Sprocket, body: Pose):
        """Which of `count` rollers from `first` on are between the teeth, as bits."""
        center = center_of(body)
        near = wp.uint64(0)
        k = int(0)
        while k < count:
            r = vec2(load_row(w, X + first + k), load_row(w, Y + first + k)) - center
            square = wp.dot(r, r)
            if square > sprocket.near_square and square < sprocket.far_square:
                near = near | bit_of(k)
            k = k + 1
        return near

    @wp.func
    def seat_rollers(
        w: wp.array[Real],
        group: Group,
        sprocket: kinds.Sprocket,
        body: Pose,
        seats: wp.array[wp.vec2d],
        memory: kinds.Memory,
    ):
        """The seat of every roller near, and where it is in the seat's gap."""
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            kept = load_seat(memory.seat, memory.first + i)
            seat = tracked_seat(place(w, i) - body.center, kept, body.cosine, body.sine, sprocket, seats)
            store_seat(memory.seat, memory.first + i, seat.number)
            store_row(w, RADIAL + i, Real(seat.radial - sprocket.exact_radius))
            store_row(w, LATERAL + i, Real(seat.lateral))
            store_row(w, OUTWARD_X + i, Real(seat.outward[0]))
            store_row(w, OUTWARD_Y + i, Real(seat.outward[1]))
            bits = next_bits(bits)

    @wp.func
    def touch_flanks(w: wp.array[Real], group: Group, sprocket: kinds.Sprocket, body: Pose):
        """How the rollers stand in their gaps, eq. (5)-(14), as `contact.in_teeth` but for tips; 1 if any is at one."""
        center = center_of(body)
        center_velocity = vec2(Real(body.velocity[0]), Real(body.velocity[1]))
        omega = Real(body.speed)
        tipped = int(0)
        i = group.low
        while i < group.high:
            arm = vec2(load_row(w, X + i), load_row(w, Y + i)) - center
            p = place(w, i) - body.center
            v = vec2(load_row(w, VX + i), load_row(w, VY + i)) - center_velocity
            xi = load_row(w, RADIAL + i)
            lateral = load_row(w, LATERAL + i)
            gap = endless_gap(xi, lateral, sprocket)
            depth = wp.where(is_near(group, i), gap[0], Real(0.0))
            tipped = tipped | wp.where(beyond_tip(depth, xi, lateral, sprocket), 1, 0)
            normal = turned(vec2(load_row(w, OUTWARD_X + i), load_row(w, OUTWARD_Y + i)), gap[1], gap[2])
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
                gap = on_tip(xi, lateral, sprocket)
                normal = turned(vec2(load_row(w, OUTWARD_X + i), load_row(w, OUTWARD_Y + i)), gap[1], gap[2])
                store_row(w, PENETRATION + i, gap[0])
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

    return TeethPasses(engaged=engaged, seat_rollers=seat_rollers, touch_teeth=touch_teeth, first_touches=first_touches)
