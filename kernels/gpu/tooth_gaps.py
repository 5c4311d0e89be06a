"""Where a block's rollers are in the tooth gaps of sprockets, and the seats that they keep."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..number import difference, leading
from ..physics.contact import center_of, turned
from ..physics.tooth import in_gap, in_teeth, nearest_seat, seat_from, straight_flank_gap
from ..rows import accessors, load_constant
from ..structs import types
from .geometry import contact_geometry
from .kind import BlockKind, Mine
from .roller_rows import roller_rows


@cache
def tooth_gaps(kind: BlockKind) -> SimpleNamespace:
    """The functions that find the rollers of one variant on a block in the tooth gaps of its sprockets."""
    Real, moving, gripping = kind.Real, kind.moving, kind.gripping
    kinds = types(Real)
    Direction = wp.vec4f if kind.paired else wp.vec2d
    vec2 = kinds.vec2
    row, geometry = roller_rows(kind), contact_geometry(kind)
    point, velocity = row.point, row.velocity
    teeth_of, sprocket_at, center_velocity = geometry.teeth_of, geometry.sprocket_at, geometry.center_velocity
    load_row = accessors(Real).load_row
    load_whole, store_whole = accessors(wp.int32).load_row, accessors(wp.int32).store_row

    @wp.struct
    class Grip:
        """A sprocket that a roller is near, and what it keeps of that."""

        sprocket: wp.int32
        seat: wp.int32  # negative where it has none yet
        before: Real  # v0 [m/s], or whether it touched
        direction: Direction  # of the seat at angle zero

    @wp.func
    def seat_at(ensemble: kinds.Ensemble, number: int):
        """Direction of a seat at angle zero, by its number among all."""
        if wp.static(kind.paired):
            return load_constant(ensemble.split_seats, number)
        else:
            return load_constant(ensemble.seats, number)

    @wp.func
    def grip_of(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, s: int):
        """Sprocket s as roller j is near it."""
        grip = Grip()
        grip.sprocket = s
        if wp.static(gripping):
            at = mine.memory + j + s * mine.rollers
            grip.seat = load_whole(state.seat, at)
            grip.before = load_row(state.impact_speed, at)
            grip.direction = seat_at(ensemble, shared.teeth[s].first_seat + wp.max(grip.seat, 0))
        return grip

    @wp.func
    def velocity_from(shared: kinds.Shared, j: int, s: int):
        """Velocity of roller j relative to the center of sprocket s [m/s]."""
        v = velocity(shared.rows, j)
        if wp.static(moving):
            v = v - center_velocity(shared, s)
        return v

    @wp.func
    def in_gap_of(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, at: int, j: int, s: int, grip: Grip
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j in the teeth of sprocket s; its arm [m].

        Its seat is kept at `at`.
        """
        teeth = teeth_of(shared, s)
        kept = int(grip.seat)
        if wp.static(not gripping):
            kept = load_whole(state.seat, at)
        number = int(kept)
        direction = grip.direction
        body = sprocket_at(shared, s)
        p = difference(point(shared.rows, j), center_of(body))
        arm = leading(p)
        if number < 0:
            number = nearest_seat(arm, leading(body.cosine), leading(body.sine), teeth.teeth)
            if wp.static(gripping):
                direction = seat_at(ensemble, teeth.first_seat + number)
        if wp.static(not gripping):
            direction = seat_at(ensemble, teeth.first_seat + number)
        v = velocity_from(shared, j, s)
        if wp.static(kind.paired):
            seats = ensemble.split_seats
        else:
            seats = ensemble.seats
        found, e, xi, lateral = seat_from(p, number, direction, body, teeth, seats)
        if found != kept:
            store_whole(state.seat, at, found)
        penetration, normal, relative = in_teeth(arm, v, leading(body.speed), e, xi, lateral, teeth)
        return penetration, normal, relative, arm

    @wp.func
    def in_straight_flank_gap(shared: kinds.Shared, teeth: kinds.Sprocket, j: int, s: int, direction: Direction):
        """As `in_gap_of`, and whether `straight_flank_gap` applies to the roller (1, else 0)."""
        body = sprocket_at(shared, s)
        p = difference(point(shared.rows, j), center_of(body))
        e, radial, xi, lateral = in_gap(p, direction, body, teeth)
        arm = leading(p)
        speed = leading(body.speed)
        off = wp.abs(lateral) > teeth.half_pitch_tangent * radial
        penetration, along, across, applies = straight_flank_gap(xi, lateral, teeth)
        surface = vec2(-speed * arm[1], speed * arm[0])
        relative = surface - velocity_from(shared, j, s)
        return penetration, turned(e, along, across), relative, arm, wp.where(off, 0, applies)

    return namespace(Grip, seat_at, grip_of, in_gap_of, in_straight_flank_gap)
