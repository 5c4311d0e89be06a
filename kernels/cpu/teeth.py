"""The CPU kernel's pass over the rollers of one variant for one sprocket."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import UNTOUCHED, after_teeth, tracked_seat, turned
from ..physics.tooth import beyond_tip, endless_gap, on_tip
from ..rows import accessors
from ..structs import Pose, types
from ..sum_structs import Totals
from .contacts import GROUP, Group, bit_of, contacts, group_of, is_near, lowest_bit, next_bits
from .rollers import passes, rows


@dataclass(frozen=True)
class TeethPasses:
    """The pass over the rollers of one variant for one sprocket."""

    sprocket_pass: wp.Function


@cache
def teeth_passes(Real: type, capacity: int) -> TeethPasses:
    """The pass for one sprocket over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2, place, contact = kinds.vec2, passes(Real, capacity).place, contacts(Real, capacity)
    kept_from, touch, answer = contact.kept_from, contact.touch, contact.answer
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_seat, store_seat = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    at = rows(capacity)
    X, Y, VX, VY, SPROCKET_FORCE = at.x, at.y, at.vx, at.vy, at.sprocket_force
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
    def leave(first: int, count: int, near: wp.uint64, memory: kinds.Memory):
        """Forgets the seats of rollers that are no longer near."""
        seated = wp.uint64(0)
        k = int(0)
        while k < count:
            if load_seat(memory.seat, memory.first + first + k) >= 0:
                seated = seated | bit_of(k)
            k = k + 1
        left = seated & ~near
        while left != wp.uint64(0):
            i = memory.first + first + lowest_bit(left)
            store_seat(memory.seat, i, -1)
            store_row(memory.impact_speed, i, Real(0.0))
            left = next_bits(left)

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

    @wp.func
    def sprocket_pass(
        w: wp.array[Real],
        n: int,
        sprocket: kinds.Sprocket,
        body: Pose,
        seats: wp.array[wp.vec2d],
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
    ):
        """Contacts of all rollers with one sprocket, eq. (5)-(17); returns their `Totals`."""
        totals = Totals()
        first = int(0)
        while first < n:
            count = wp.min(n - first, GROUP)
            near = engaged(w, first, count, sprocket, body)
            leave(first, count, near, memory)
            if near != wp.uint64(0):
                group = group_of(first, near)
                kept_from(w, group, memory)
                seat_rollers(w, group, sprocket, body, seats, memory)
                touch_teeth(w, group, sprocket, body)
                totals = answer(w, group, SPROCKET_FORCE, sprocket.law, sliding, memory, chain, totals)
                if memory.measured != 0:
                    totals.contacts += first_touches(w, group)
            first = first + GROUP
        return totals

    return TeethPasses(sprocket_pass=sprocket_pass)
