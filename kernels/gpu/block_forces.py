"""The block kernels' contacts: the answers of teeth and guide-bars to the rollers that touch them.

A contact's memory (seat, v0) and its sums stay where the state and the tallies have them, which the cache holds.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..physics.contact import (
    MISSED,
    UNTOUCHED,
    after_teeth,
    dissipated,
    in_gap,
    in_teeth,
    load_direction,
    misses,
    on_guide,
    reaction,
    respond,
    rub,
    rub_evenly,
    seat_from,
    sized,
    surface_velocity,
    turned,
)
from ..physics.face import on_face, tracked_face
from ..physics.impact import is_usual, usual_force
from ..physics.profile import in_frame, on_profile, tracked_piece
from ..physics.seat import gap_from, in_teeth_gap, load_split, on_line
from ..physics.seat import in_gap as split_gap
from ..physics.tooth import nearest_seat, usual_gap
from ..root import products
from ..rows import accessors
from ..structs import types
from ..sum_structs import Tallies
from .block_bits import block_bits
from .block_events import EXTRA, START
from .block_kind import BlockKind, Mine, now_struct
from .block_near import block_near
from .block_rows import block_rows
from .block_wheels import gears, load_line, load_wheel, seen_wheel, velocity_of
from .block_wrench import block_wrench
from .exchange import add_to, count_at, lowest_bit, raise_to, widened


@dataclass(frozen=True)
class ForceFunctions:
    """What is done about contacts, as functions of kernels."""

    Touch: type
    touch_of: wp.Function
    contacts: wp.Function
    plain_contacts: wp.Function
    usual_laws: wp.Function


@cache
def block_forces(kind: BlockKind) -> ForceFunctions:
    """The functions that evaluate the contacts of one variant on a block."""
    Real, threads, per, sprockets, guides = kind.Real, kind.threads, kind.per, kind.sprockets, kind.guides
    moving, sliding, rk4, bodies, profiles = kind.moving, kind.sliding, kind.rk4, kind.bodies, kind.profiles
    kinds, Now = types(Real), now_struct(Real)
    gripping, quick = kind.gripping, kind.quick
    Direction = wp.vec4f if kind.paired else wp.vec2d
    vec2 = kinds.vec2
    row, near, wrenches, bits = block_rows(kind), block_near(kind), block_wrench(kind), block_bits(kind)
    Bits, of_teeth, of_bars, any_of, first, rest = (
        bits.Bits,
        bits.of_teeth,
        bits.of_bars,
        bits.any_of,
        bits.first,
        bits.rest,
    )
    add_moment, add_push, add_wrench = wrenches.add_moment, wrenches.add_push, wrenches.add_wrench
    bar_of, away_from, in_carrier = near.bar_of, near.away_from, near.in_carrier
    place, velocity, force_on, set_force = row.place, row.velocity, row.force_on, row.set_force
    acceleration_under = row.acceleration_under
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_whole, store_whole = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    load_gear = gears(kind).load_gear

    @wp.func
    def drag_of(size: Real, normal: vec2, relative: vec2, what: kinds.Sliding):
        """Friction on a roller [N], as `rub`."""
        if wp.static(kind.stribeck):
            return rub(size, normal, relative, what)
        else:
            return rub_evenly(size, normal, relative, what)

    @wp.func
    def as_known(law: Any):
        """A contact law with what is known of it when the kernel is made."""
        if wp.static(kind.usual):
            law.form = 0
            law.exponent = Real(1.0)
        return law

    @wp.func
    def lag(mine: Mine):
        """How far velocities are behind the forces [s]."""
        if wp.static(rk4):
            return Real(0.0)
        else:
            return Real(0.5) * row.step_of(mine)

    @wp.func
    def powers(shared: kinds.Shared, mine: Mine, force: vec2, damper: vec2, drag: vec2, relative: vec2):
        """Powers [W] that damper and friction take in a closed contact of a roller on which all `force` [N] acts."""
        a = acceleration_under(shared, force)
        return dissipated(damper, relative, a, lag(mine)), dissipated(drag, relative, a, lag(mine))

    @wp.func
    def in_full(value: Real):
        """A value as the sums of contacts have it."""
        if wp.static(kind.paired):
            return widened(value)
        else:
            return value

    @wp.func
    def measure_powers(tallies: Tallies, now: Now, at: int, damped: Real, rubbed: Real):
        """Adds the powers [W] of a closed contact's damping and friction to its sums."""
        add_to(tallies.dissipated, at, in_full(now.weight * damped))
        if wp.static(sliding):
            add_to(tallies.friction, at, in_full(now.weight * rubbed))

    @wp.func
    def measure_force(tallies: Tallies, now: Now, at: int, before: Real, size: Real, passing: bool):
        """Adds a closed contact's force [N] to its sums where that is watched, and counts it at its first instant.

        Rollers pass sprockets, where first touches count.
        """
        if now.watched != 0:
            add_to(tallies.impulse, at, in_full(now.watch_weight * size))
            raise_to(tallies.force_max, at, in_full(size))
        if before <= Real(0.0):
            count_at(tallies.impacts, at)
            if passing and before == Real(UNTOUCHED):
                count_at(tallies.contacts, at)

    @wp.func
    def put(state: kinds.State, now: Now, at: int, before: Real, kept: Real):
        """What a contact keeps: v0 while it is closed. At a step's start only (rk4 has three more stages)."""
        if before != kept and now.stage == 0:
            store_row(state.impact_speed, at, kept)

    @wp.func
    def is_summed(now: Now, s: int):
        """Whether the moment on sprocket s is wanted: with metrics all are."""
        if wp.static(kind.measuring):
            return True
        else:
            return (now.summed >> s) & 1 != 0

    @wp.func
    def teeth_of(shared: kinds.Shared, s: int):
        """Teeth of sprocket s."""
        if wp.static(kind.paired):
            return load_gear(shared.gears, s)
        else:
            return shared.teeth[s]

    @wp.struct
    class Grip:
        """A sprocket that a roller is near, and what it keeps of that."""

        sprocket: wp.int32
        seat: wp.int32  # negative where it has none yet
        before: Real  # v0 [m/s], or whether it touched
        direction: Direction  # of the seat at angle zero

    @wp.struct
    class Touch:
        """What a thread's rollers are near, as from `meet`, and what they keep of it where that is looked up ahead."""

        near: Bits
        grip: Grip  # of the roller's first sprocket

    @wp.func
    def seat_at(ensemble: kinds.Ensemble, number: int):
        """Direction of a seat at angle zero, by its number among all."""
        if wp.static(kind.paired):
            return load_split(ensemble.split_seats, number)
        else:
            return load_direction(ensemble.seats, number)

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
    def touch_of(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, near: Bits):
        """What the thread's rollers may touch."""
        touch = Touch()
        touch.near = near
        if wp.static(gripping):  # without a branch, so that nothing waits for it
            by_teeth = of_teeth(near)[0]
            s = lowest_bit(wp.where(by_teeth != 0, by_teeth, 1))
            touch.grip = grip_of(ensemble, state, shared, mine, mine.thread, s)
        return touch

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
        v = velocity(shared.rows, j)
        if wp.static(kind.paired):
            wheel = seen_wheel(shared.wheels, s)
            near_it = away_from(shared.rows, j, wheel.center, wheel.center_low)
            if number < 0:
                number = nearest_seat(near_it.high, wheel.cosine.high, wheel.sine.high, teeth.teeth)
                if wp.static(gripping):
                    direction = seat_at(ensemble, teeth.first_seat + number)
            if wp.static(not gripping):
                direction = seat_at(ensemble, teeth.first_seat + number)
            gap = gap_from(near_it, number, direction, wheel, teeth, ensemble.split_seats)
            if gap.number != kept:
                store_whole(state.seat, at, gap.number)
            if wp.static(moving):
                v = v - velocity_of(shared.wheels, s)
            penetration, normal, relative = in_teeth_gap(near_it.high, v, wheel.speed.high, gap, teeth)
            return penetration, normal, relative, near_it.high
        else:
            pose = shared.poses[s]
            p = place(shared.rows, j, pose.center)
            if number < 0:
                number = nearest_seat(p, pose.cosine, pose.sine, teeth.teeth)
                if wp.static(gripping):
                    direction = seat_at(ensemble, teeth.first_seat + number)
            if wp.static(not gripping):
                direction = seat_at(ensemble, teeth.first_seat + number)
            seat = seat_from(p, number, direction, pose.cosine, pose.sine, teeth, ensemble.seats)
            if seat.number != kept:
                store_whole(state.seat, at, seat.number)
            if wp.static(moving):
                v = vec2(v[0] - Real(pose.velocity[0]), v[1] - Real(pose.velocity[1]))
            penetration, normal, relative = in_teeth(p, v, Real(pose.speed), seat, teeth)
            return penetration, normal, relative, vec2(Real(p[0]), Real(p[1]))

    @wp.func
    def at_sprocket(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        grip: Grip,
    ):
        """Adds the force of the teeth of a sprocket to roller j's, and its reaction to the sprocket if it is summed."""
        s = grip.sprocket
        at = mine.memory + j + s * mine.rollers
        before = Real(grip.before)
        if wp.static(not gripping):
            before = load_row(state.impact_speed, at)
        penetration, normal, relative, arm = in_gap_of(ensemble, state, shared, at, j, s, grip)
        if penetration > Real(0.0):
            law = as_known(teeth_of(shared, s).law)
            force, size, first, damper, energy = respond(penetration, normal, relative, before, law)
            if now.flags & EXTRA != 0:  # at once, so that the energy is worked out only here
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = drag_of(size, normal, relative, shared.sliding[s])
                force = force + drag
            whole = force_on(shared, j) + force
            set_force(shared, j, whole)
            put(state, now, at, before, first)
            if now.measured != 0:
                damped, rubbed = powers(shared, mine, whole, damper * normal, drag, relative)
                measure_powers(tallies, now, at, damped, rubbed)
                measure_force(tallies, now, at, before, size, True)
            if is_summed(now, s):
                add_wrench(shared, mine, s, j, reaction(arm, force), force, now.watched)
        else:
            put(state, now, at, before, after_teeth(before))

    @wp.func
    def usual_laws(shared: kinds.Shared):
        """The sprockets whose contacts are linear and hysteretic, as bits, unless all contacts are."""
        mask = int(0)
        if wp.static(not kind.usual):
            for s in range(wp.static(sprockets)):
                if is_usual(shared.teeth[s].law):
                    mask = mask | (1 << s)
        return mask

    @wp.func
    def is_quick(now: Now, s: int):
        """Whether the law of sprocket s is the usual one; so that no thread asks where all are."""
        if wp.static(kind.usual):
            return True
        else:
            return (now.usual >> s) & 1 != 0

    @wp.func
    def in_usual_gap(shared: kinds.Shared, teeth: kinds.Sprocket, j: int, s: int, direction: Direction):
        """As `in_gap_of`, and whether the roller is in the gap of its seat as `usual_gap` has it (1, else 0)."""
        v = velocity(shared.rows, j)
        if wp.static(kind.paired):
            wheel = seen_wheel(shared.wheels, s)
            near_it = away_from(shared.rows, j, wheel.center, wheel.center_low)
            gap = split_gap(near_it, wheel, direction)
            xi = gap.xi
            lateral = gap.lateral
            e = gap.outward
            arm = near_it.high
            speed = wheel.speed.high
            if wp.static(moving):
                v = v - velocity_of(shared.wheels, s)
            off = wp.abs(lateral) > teeth.half_pitch_tangent * (teeth.pitch_radius + xi)
        else:
            pose = shared.poses[s]
            p = place(shared.rows, j, pose.center)
            e, radial, lateral = in_gap(p, direction, pose.cosine, pose.sine)
            xi = radial - teeth.exact_radius
            arm = p
            speed = pose.speed
            if wp.static(moving):
                v = v - pose.velocity
            off = wp.abs(lateral) > teeth.half_pitch_tangent * radial
        penetration, along, across, usual = usual_gap(xi, lateral, teeth)
        surface = vec2(-speed * arm[1], speed * arm[0])
        return penetration, turned(e, along, across), surface - v, arm, wp.where(off, 0, usual)

    @wp.struct
    class Answer:
        """What a roller in its tooth gap is answered."""

        usual: wp.int32  # 1 where all is as usual, else nothing holds
        closed: wp.int32  # whether they touch
        at: wp.int32  # where its memory is
        before: Real  # v0, as it was kept [m/s]
        first: Real  # v0 [m/s]
        moment: Real  # on the sprocket [N m]
        force: vec2  # on the roller [N]
        size: Real  # of it without friction [N], for metrics as what follows
        damper: vec2  # its part that dissipates [N]
        drag: vec2  # friction [N]
        relative: vec2  # velocity of the sprocket less the roller's [m/s]

    @wp.func
    def answer_of(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, grip: Grip):
        """What a sprocket answers roller j if all is as usual, without a branch."""
        s = grip.sprocket
        answer = Answer()
        answer.at = mine.memory + j + s * mine.rollers
        seat = int(grip.seat)
        answer.before = grip.before
        direction = grip.direction
        teeth = teeth_of(shared, s)
        if wp.static(not gripping):
            seat = load_whole(state.seat, answer.at)
            answer.before = load_row(state.impact_speed, answer.at)
            direction = seat_at(ensemble, teeth.first_seat + wp.max(seat, 0))
        penetration, normal, relative, arm, usual = in_usual_gap(shared, teeth, j, s, direction)
        speed = products(relative[0], normal[0], relative[1], normal[1])
        size, first = usual_force(penetration, speed, answer.before, teeth.law)
        answer.first = first
        answer.force = sized(normal, size)
        if wp.static(sliding):
            drag = drag_of(size, normal, relative, shared.sliding[s])
            answer.force = answer.force + drag
            answer.drag = drag
        if wp.static(kind.measuring):
            answer.size = size
            answer.damper = (size - teeth.law.stiffness * penetration) * normal
            answer.relative = relative
        answer.moment = reaction(arm, answer.force)
        answer.closed = int(penetration > Real(0.0))
        answer.usual = wp.where(seat < 0, 0, usual)
        return answer

    @wp.func
    def add_answer(state: kinds.State, shared: kinds.Shared, now: Now, j: int, answer: Answer):
        """Adds a contact's force, if it is closed, to roller j's, which is returned [N]; keeps what it is to keep."""
        zero = Real(0.0)
        force = force_on(shared, j) + wp.where(answer.closed != 0, answer.force, vec2(zero, zero))
        set_force(shared, j, force)
        kept = wp.where(answer.closed != 0, answer.first, after_teeth(answer.before))
        put(state, now, answer.at, answer.before, kept)
        return force

    @wp.func
    def answered(
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        s: int,
        answer: Answer,
    ):
        """Does what sprocket s answers roller j, with few branches: at each a warp's threads part."""
        wanted = answer.closed != 0 and is_summed(now, s)
        add_moment(shared, mine, s, j, wp.where(wanted, answer.moment, Real(0.0)))
        if wp.static(moving):
            if answer.closed != 0:
                add_push(shared, mine, s, j, answer.force)
        force = add_answer(state, shared, now, j, answer)
        if wp.static(kind.measuring) and now.measured != 0:
            damped, rubbed = powers(shared, mine, force, answer.damper, answer.drag, answer.relative)
            if answer.closed != 0:
                measure_powers(tallies, now, answer.at, damped, rubbed)
            if answer.closed != 0 and (now.watched != 0 or answer.before <= Real(0.0)):
                measure_force(tallies, now, answer.at, answer.before, answer.size, True)
                if wp.static(not moving) and now.watched != 0:
                    add_push(shared, mine, s, j, answer.force)

    @wp.func
    def at_face(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, at: int, kept: int, j: int, bar: kinds.Guide
    ):
        """As `at_profile`, in pairs of float32; the piece `kept` is kept at `at`."""
        arm, q = in_carrier(shared, j, bar.body)
        number = tracked_face(q, kept, bar, ensemble.split_pieces)
        if number != kept:
            store_whole(state.seat, at, number)
        penetration, facing = on_face(q, number, bar, ensemble.split_pieces)
        relative = -velocity(shared.rows, j)
        if bar.body < wp.static(bodies):
            body = load_wheel(shared.wheels, bar.body)
            facing = turned(facing, body.cosine.high, body.sine.high)
            way = vec2(-body.speed.high * arm.high[1], body.speed.high * arm.high[0])
            relative = relative + way + velocity_of(shared.wheels, bar.body)
        return penetration, facing, relative

    @wp.func
    def at_profile(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, g: int, bar: kinds.Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on the profile of guide g."""
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        kept = load_whole(state.seat, at)
        if wp.static(kind.paired):
            return at_face(ensemble, state, shared, at, kept, j, bar)
        pose = shared.poses[bar.body]
        arm = place(shared.rows, j, pose.center)
        q = in_frame(arm, pose)
        number = tracked_piece(q, kept, bar, ensemble.pieces)
        if number != kept:
            store_whole(state.seat, at, number)
        penetration, facing = on_profile(q, number, bar, ensemble.pieces)
        facing = turned(facing, pose.cosine, pose.sine)
        surface = surface_velocity(pose, arm)
        relative = vec2(Real(surface[0]), Real(surface[1])) - velocity(shared.rows, j)
        return penetration, vec2(Real(facing[0]), Real(facing[1])), relative

    @wp.func
    def on_straight(shared: kinds.Shared, j: int, g: int, bar: kinds.Guide):
        """The same on guide g, a straight bar on the ground."""
        v = velocity(shared.rows, j)
        if wp.static(kind.paired):
            line = load_line(shared.lines, g)
            return on_line(away_from(shared.rows, j, line.start, line.start_low), v, line, bar)
        else:
            p = place(shared.rows, j, bar.start)
            return on_guide(p, v, vec2(Real(0.0), Real(0.0)), bar)

    @wp.func
    def on_bar(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, g: int, bar: kinds.Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on guide g."""
        if wp.static(profiles):
            penetration = Real(0.0)
            normal = vec2()
            relative = vec2()
            if bar.pieces != 0:
                penetration, normal, relative = at_profile(ensemble, state, shared, mine, j, g, bar)
            else:
                penetration, normal, relative = on_straight(shared, j, g, bar)
            return penetration, normal, relative
        else:
            return on_straight(shared, j, g, bar)

    @wp.func
    def arm_on(shared: kinds.Shared, j: int, b: int):
        """Roller j from the center of body b [m]."""
        if wp.static(kind.paired):
            body = load_wheel(shared.wheels, b)
            return away_from(shared.rows, j, body.center, body.center_low).high
        else:
            arm = place(shared.rows, j, shared.poses[b].center)
            return vec2(Real(arm[0]), Real(arm[1]))

    @wp.func
    def at_guide(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        g: int,
    ):
        """Adds the force of guide g to roller j's, and its reaction to the body that carries it."""
        bar = bar_of(shared, g)
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        before = load_row(state.impact_speed, at)
        penetration, normal, relative = on_bar(ensemble, state, shared, mine, j, g, bar)
        if penetration > Real(0.0) and misses(penetration, before, bar):
            if now.measured != 0 and (before == Real(UNTOUCHED) or now.flags & START != 0):
                count_at(tallies.missed, at)
            put(state, now, at, before, Real(MISSED))
        elif penetration > Real(0.0):
            force, size, first, damper, energy = respond(penetration, normal, relative, before, as_known(bar.law))
            if now.flags & EXTRA != 0:
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].guide_force = state.extra[extra].guide_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = drag_of(size, normal, relative, shared.sliding[wp.static(sprockets) + g])
                force = force + drag
            whole = force_on(shared, j) + force
            set_force(shared, j, whole)
            if wp.static(profiles):
                if bar.body < wp.static(bodies):
                    moment = reaction(arm_on(shared, j, bar.body), force)
                    add_wrench(shared, mine, bar.body, j, moment, force, now.watched)
            put(state, now, at, before, first)
            if now.measured != 0:
                damped, rubbed = powers(shared, mine, whole, damper * normal, drag, relative)
                measure_powers(tallies, now, at, damped, rubbed)
                measure_force(tallies, now, at, before, size, False)
        else:
            put(state, now, at, before, Real(UNTOUCHED))

    @wp.func
    def at_bars(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        near: Bits,
    ):
        """Adds the forces of the guides that they are near to those of the thread's rollers."""
        by_bar = of_bars(near)
        while any_of(by_bar):
            j, p = first(by_bar, mine.thread)
            by_bar = rest(by_bar)
            at_guide(ensemble, state, tallies, shared, mine, now, j, p - wp.static(sprockets))

    @wp.func
    def contacts(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: Touch,
    ):
        """Adds the contacts' forces to those of the thread's rollers.

        Each thread goes on to its next roller in teeth at once, so that few wait.
        """
        by_teeth = of_teeth(touch.near)
        grip = touch.grip
        while any_of(by_teeth):
            j, s = first(by_teeth, mine.thread)
            by_teeth = rest(by_teeth)
            if wp.static(gripping):
                s = grip.sprocket
            else:
                grip = grip_of(ensemble, state, shared, mine, j, s)
            one = Answer()
            if wp.static(quick):
                if is_quick(now, s):
                    one = answer_of(ensemble, state, shared, mine, j, grip)
                    one.usual = wp.where(now.flags == 0, one.usual, 0)
            if one.usual != 0:
                answered(state, tallies, shared, mine, now, j, s, one)
            else:
                at_sprocket(ensemble, state, tallies, shared, mine, now, j, grip)
            if wp.static(gripping):
                if any_of(by_teeth):
                    grip = grip_of(ensemble, state, shared, mine, j, lowest_bit(by_teeth[0]))
        if wp.static(guides > 0):
            at_bars(ensemble, state, tallies, shared, mine, now, touch.near)

    @wp.func
    def contacts_by_two(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: Touch,
    ):
        """As `contacts`, two of a thread's rollers in teeth at once, so that their latencies hide behind each other."""
        by_teeth = of_teeth(touch.near)
        while any_of(by_teeth):
            j, s = first(by_teeth, mine.thread)
            by_teeth = rest(by_teeth)
            two = int(0)
            other_j = int(j)
            other_s = int(s)
            if any_of(by_teeth):
                two = int(1)
                other_j, other_s = first(by_teeth, mine.thread)
                by_teeth = rest(by_teeth)
            one = answer_of(ensemble, state, shared, mine, j, grip_of(ensemble, state, shared, mine, j, s))
            grip = grip_of(ensemble, state, shared, mine, other_j, other_s)
            other = answer_of(ensemble, state, shared, mine, other_j, grip)
            one.usual = wp.where(is_quick(now, s), one.usual, 0)
            other.usual = wp.where(is_quick(now, other_s), other.usual, 0)
            if one.usual & other.usual != 0:
                answered(state, tallies, shared, mine, now, j, s, one)
                if two != 0:
                    answered(state, tallies, shared, mine, now, other_j, other_s, other)
            else:
                q = int(0)
                while q <= two:  # a loop, which stands once in the code
                    if one.usual != 0:
                        answered(state, tallies, shared, mine, now, j, s, one)
                    else:
                        at_sprocket(
                            ensemble, state, tallies, shared, mine, now, j, grip_of(ensemble, state, shared, mine, j, s)
                        )
                    one = other
                    j = other_j
                    s = other_s
                    q = q + 1
        if wp.static(guides > 0):
            at_bars(ensemble, state, tallies, shared, mine, now, touch.near)

    return ForceFunctions(
        Touch=Touch,
        touch_of=touch_of,
        contacts=contacts,
        plain_contacts=contacts_by_two if kind.roomy and per > 1 else contacts,
        usual_laws=usual_laws,
    )
