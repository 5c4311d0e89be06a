"""The contacts of a block's rollers with teeth: where they are in the gaps, the seats that they keep, their forces."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import load_constant, products, row_access
from ..number import difference, leading
from ..physics.contact import force_vector, memory_after_teeth, normal_force, reaction_moment, rotated_vector
from ..physics.tooth import (
    gap_coordinates,
    nearest_seat,
    relative_tooth_velocity,
    straight_flank_gap,
    tooth_contact,
    tracked_seat_from,
)
from ..structs import Tallies
from .contacts import contact_sums, wrench_parts
from .kind import BlockKind, Mine
from .near import near_mask
from .rings import block_rings
from .rollers import roller_rows
from .sync import lowest_bit


@cache
def tooth_gaps(kind: BlockKind) -> SimpleNamespace:
    """The functions that find the rollers of one variant on a block in the tooth gaps of its sprockets."""
    Real, moving, kinds, bits = kind.Real, kind.moving, kind.types, near_mask(kind)
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    Bits, of_teeth, Touch = bits.Bits, bits.of_teeth, contact_sums(kind).Touch
    row, placed, remembering = roller_rows(kind), contact_sums(kind).placed, contact_sums(kind).remembering
    point, velocity = row.point, row.velocity
    load_row, memory_of = row_access(Real).load, block_rings(kind).memory_of
    load_whole, store_whole = row_access(wp.int32).load, row_access(wp.int32).store

    @wp.func
    def seat_at(ensemble: Ensemble, number: int):
        """Direction of a seat at angle zero, by its number among all."""
        return load_constant(ensemble.seats, number)

    @wp.func
    def looked_up(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, touch: Touch, j: int, s: int):
        """`touch` with what roller j keeps of sprocket s."""
        at = memory_of(shared, mine, j, s)
        touch.partner = s
        touch.seat = load_whole(state.seat, at)
        touch = remembering(state, touch, at)
        touch.direction = seat_at(ensemble, shared.teeth[s].first_seat + wp.max(touch.seat, 0))
        return touch

    @wp.func
    def touch_of(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, near: Bits):
        """The partners that the thread's rollers may touch."""
        touch = Touch()
        touch.near = near
        if wp.static(kind.gripping):  # without a branch, so that nothing waits for it
            by_teeth = of_teeth(near)[0]
            s = lowest_bit(wp.where(by_teeth != 0, by_teeth, 1))
            touch = looked_up(ensemble, state, shared, mine, touch, mine.thread, s)
        return touch

    @wp.func
    def velocity_from(shared: Shared, j: int, s: int):
        """Velocity of roller j relative to the center of sprocket s [m/s]."""
        v = velocity(shared.rows, j)
        if wp.static(moving):
            v = v - leading(shared.poses[s].velocity)
        return v

    @wp.func
    def in_gap_of(ensemble: Ensemble, state: State, shared: Shared, at: int, j: int, touch: Touch):
        """`touch` of roller j with where it is in the teeth of the sprocket; its arm [m]. Its seat is kept at `at`."""
        s = touch.partner
        teeth = shared.teeth[s]
        body = shared.poses[s]
        p = difference(point(shared.rows, j), body.center)
        arm = leading(p)
        number = int(touch.seat)
        direction = touch.direction
        if number < 0:
            number = nearest_seat(arm, leading(body.cosine), leading(body.sine), teeth.teeth)
            direction = seat_at(ensemble, teeth.first_seat + number)
        v = velocity_from(shared, j, s)
        found, e, xi, lateral = tracked_seat_from(p, number, direction, body, teeth, ensemble.seats)
        if found != touch.seat:
            store_whole(state.seat, at, found)
        penetration, normal, relative = tooth_contact(arm, v, leading(body.speed), e, xi, lateral, teeth)
        return placed(touch, penetration, normal, relative), arm

    @wp.func
    def in_straight_flank_gap(shared: Shared, teeth: kinds.Sprocket, j: int, touch: Touch):
        """As `in_gap_of`, and whether `straight_flank_gap` applies to the roller (1, else 0)."""
        body = shared.poses[touch.partner]
        p = difference(point(shared.rows, j), body.center)
        e, radial, xi, lateral = gap_coordinates(p, touch.direction, body, teeth)
        arm = leading(p)
        off = wp.abs(lateral) > teeth.half_pitch_tangent * radial
        penetration, along, across, applies = straight_flank_gap(xi, lateral, teeth)
        relative = relative_tooth_velocity(leading(body.speed), arm, velocity_from(shared, j, touch.partner))
        return placed(touch, penetration, rotated_vector(e, along, across), relative), arm, wp.where(off, 0, applies)

    return SimpleNamespace(**locals())


@cache
def tooth_contacts(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate a roller's contact with a sprocket of one variant on a block."""
    Real, moving, sliding = kind.Real, kind.moving, kind.friction.contacts
    kinds, Now = kind.types, kind.types.Now
    State, Shared = kinds.State, kinds.Shared
    vec2 = kinds.vec2
    row, wrenches, sums, gaps = roller_rows(kind), wrench_parts(kind), contact_sums(kind), tooth_gaps(kind)
    add_moment, add_push, add_wrench = wrenches.add_moment, wrenches.add_push, wrenches.add_wrench
    pass_on, remember = wrenches.pass_on, sums.remember
    drag_of, press, powers, keep, taking = sums.drag_of, sums.press, sums.powers, sums.keep, sums.taking
    gaining, as_known, store_row = sums.gaining, sums.as_known, row_access(Real).store
    measure_powers, measure_force = sums.measure_powers, sums.measure_force
    Touch, in_gap_of, in_straight_flank_gap = sums.Touch, gaps.in_gap_of, gaps.in_straight_flank_gap
    force_on, set_force = row.force_on, row.set_force
    memory_of, chain_at = block_rings(kind).memory_of, block_rings(kind).chain_at

    @wp.func
    def is_summed(now: Now, s: int):
        """Whether the moment on sprocket s is wanted: with metrics all are."""
        if wp.static(kind.measuring):
            return True
        else:
            return (now.summed >> s) & 1 != 0

    @wp.func
    def at_sprocket(
        ensemble: kinds.Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: Mine,
        now: Now,
        j: int,
        touch: Touch,
    ):
        """Adds the force of the teeth of a sprocket to roller j's, and its reaction to the sprocket if it is summed."""
        s = touch.partner
        at = memory_of(shared, mine, j, s)
        closer, arm = in_gap_of(ensemble, state, shared, at, j, touch)
        closed = bool(False)
        if closer.penetration > -shared.teeth[s].law.ahead:
            closer.gaining = gaining(shared, shared.poses[s], arm, j)
            closed, force = press(state, tallies, shared, mine, now, j, closer, shared.teeth[s].law)
            if closed:
                if is_summed(now, s):
                    add_wrench(shared, mine, s, j, reaction_moment(arm, force), force, now.measured)
                pass_on(shared, mine, now, s, j, force)
        if not closed:
            keep(state, now, at, touch.before, memory_after_teeth(touch.before))

    @wp.func
    def on_straight_flank(state: State, tallies: Tallies, shared: Shared, mine: Mine, now: Now, j: int, touch: Touch):
        """As `at_sprocket` if the seat is kept, the law linear and hysteretic, and the flank straight; 1 then, else 0
        and nothing is added.

        With few branches: at each a warp's threads part.
        """
        s, before = touch.partner, touch.before
        at = memory_of(shared, mine, j, s)
        teeth = shared.teeth[s]
        closer, arm, applies = in_straight_flank_gap(shared, teeth, j, touch)
        penetration, normal, relative = closer.penetration, closer.normal, closer.relative
        speed = products(relative[0], normal[0], relative[1], normal[1])
        more = gaining(shared, shared.poses[s], arm, j)
        growth = products(more[0], normal[0], more[1], normal[1])
        law = as_known(teeth.law)
        mean, elastic, size, first, damper_speed = normal_force(
            penetration, speed, growth, before, touch.damper_speed, law
        )
        pushes = force_vector(normal, size)
        force = pushes
        closed = mean > Real(0.0)
        applies = wp.where(touch.seat < 0, 0, applies)
        drag = vec2()
        if wp.static(sliding):
            drag, holds = drag_of(now, size, normal, relative, touch, shared.friction[s])
            force = force + drag
            if applies != 0 and closed and now.stage == 0:
                store_row(state.contact_hold, at, holds)
        if applies != 0:
            add_moment(
                shared, mine, s, j, wp.where(closed and is_summed(now, s), reaction_moment(arm, force), Real(0.0))
            )
            if wp.static(moving):
                if closed:
                    add_push(shared, mine, s, j, force)
                    pass_on(shared, mine, now, s, j, force)
            set_force(shared, j, force_on(shared, j) + wp.where(closed, force, vec2()))
            keep(state, now, at, before, wp.where(closed, first, memory_after_teeth(before)))
            if closed:
                remember(state, now, at, teeth.law.answer, damper_speed)
            if wp.static(kind.measuring) and now.measured != 0:
                after = more - chain_at(shared, j).inverse_mass * force
                taken, rubbed = powers(mine, taking(pushes, size - elastic, normal), drag, relative, after)
                if closed:
                    measure_powers(tallies, now, at, taken, rubbed)
                    measure_force(tallies, now, at, before, size, True)
                    if wp.static(not moving):
                        add_push(shared, mine, s, j, force)
        return applies

    return SimpleNamespace(**locals())
