"""The block kernels' contacts: who is near what, and the forces of teeth and guide-bars.

A contact's memory (seat, v0) and its sums stay where the state and the tallies have them, which the cache holds.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.contact import closed_contact, elastic_energy, gap_approach, guide_approach, in_gap
from ..physics.tooth import nearest_seat, seat_step, wrapped_seat
from ..rows import accessors
from ..structs import types, vec2d
from ..sum_structs import Tallies, Totals
from ..sums import add_contact
from .block_rows import block_rows
from .exchange import group, lanes, lowest_bit


@cache
def block_forces(
    Real: type, threads: int, per: int, sprockets: int, guides: int, moving: bool = False, measuring: bool = False
) -> SimpleNamespace:
    """The functions that evaluate one variant on a block of `threads` threads, thread i with the rollers
    i, i + threads, ..., `per` of them at most.

    `moving` is for drives whose sprockets' centers may move or that have balance wheels.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    slots = threads * per
    row = block_rows(Real, threads, per, sprockets, guides, moving, measuring)
    place, velocity, force_on, set_force = row.place, row.velocity, row.force_on, row.set_force
    X, Y, group_sum = row.X, row.Y, row.talk.group_sum
    load, store = accessors(Real).load, accessors(Real).store
    load_whole, store_whole = accessors(wp.int32).load, accessors(wp.int32).store
    load_direction = accessors(vec2d).load
    load_part, store_part = accessors(wp.float64).load, accessors(wp.float64).store
    SPROCKETS = wp.constant((1 << sprockets) - 1)

    @wp.struct
    class Gap:
        """Where a roller is in its tooth gap."""

        e: vec2d  # outward direction of the seat
        radial: wp.float64  # along it, from the sprocket's center [m]
        lateral: wp.float64  # across it [m]

    @wp.func
    def near(shared: kinds.Shared, j: int, n: int):
        """The partners that roller j may touch, as bits: sprockets whose band it is in, guide-bars it is on."""
        rows = shared.rows
        x = load(rows, X + j)
        y = load(rows, Y + j)
        mask = int(0)
        for s in range(wp.static(sprockets)):
            band = shared.bands[s]
            from_x = x - band.center[0]
            from_y = y - band.center[1]
            square = from_x * from_x + from_y * from_y
            if square > band.near_square and square < band.far_square:
                mask = mask | (1 << s)
        for g in range(wp.static(guides)):
            bar = shared.bars[g]
            p = place(rows, j, bar.start)
            along = Real(wp.dot(p, bar.direction))
            across = Real(p[1] * bar.direction[0] - p[0] * bar.direction[1])
            reach = bar.end_radius + bar.roller_radius
            if across < bar.roller_radius and across > -bar.end_radius:
                if along > -reach and along < bar.length + reach:
                    mask = mask | (1 << (wp.static(sprockets) + g))
        return wp.where(j < n, mask, 0)

    @wp.func
    def leave(state: kinds.State, memory: int, n: int, left: int):
        """A roller is no longer near the partners `left`, as bits; its memory with the first begins at `memory`."""
        while left != 0:
            at = memory + lowest_bit(left) * n
            left = left & (left - 1)
            state.seat[at] = -1
            state.impact_speed[at] = Real(0.0)

    @wp.func
    def pressed(
        state: kinds.State,
        tallies: Tallies,
        memory: int,
        before: Real,
        penetration: Real,
        speed: Real,
        law: kinds.ContactLaw,
        roller: int,
        stage: int,
        measured: int,
        weight: Real,
        extra: int,
    ):
        """Force of a contact [N]; its memory, and if `measured` its sums, brought up to date; `before` is its v0.

        v0 is kept at `stage` 0 only, a step's start (rk4 has three more). Its energy goes to what is kept of `roller`
        if `extra`.
        """
        force = Real(0.0)
        if penetration > Real(0.0):
            size, first, elastic = closed_contact(penetration, speed, before, law)
            if before == Real(0.0) and stage == 0:
                store(state.impact_speed, memory, first)
            if measured != 0:
                begun = wp.where(before == Real(0.0), 1, 0)
                sums = tallies.contact[memory]
                tallies.contact[memory] = add_contact(sums, size, size, (size - elastic) * speed, begun, weight)
            if extra != 0:
                energy = elastic_energy(elastic, penetration, law)
                state.extra[roller].energy = state.extra[roller].energy + energy
            force = size
        else:
            if before != Real(0.0) and stage == 0:
                store(state.impact_speed, memory, Real(0.0))
        return force

    @wp.func
    def in_teeth(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        memory: int,
        roller: int,
        j: int,
        s: int,
        i: int,
        heeded: int,
        stage: int,
        measured: int,
        weight: Real,
        extra: int,
    ):
        """Adds the force of the teeth of sprocket s to roller j's.

        Its moment goes to the thread's part if sprocket s is `heeded` (bits).
        """
        teeth = shared.teeth[s]
        wheel = shared.wheels[s]
        kept = load_whole(state.seat, memory)
        before = load(state.impact_speed, memory)
        p = place(shared.rows, j, wheel.center)
        seat = kept
        if seat < 0:
            seat = nearest_seat(p, wheel.cosine, wheel.sine, teeth.teeth)
        e, radial, lateral = in_gap(
            p, load_direction(ensemble.seats, teeth.first_seat + seat), wheel.cosine, wheel.sine
        )
        gap = Gap()
        gap.e = e
        gap.radial = radial
        gap.lateral = lateral
        step = seat_step(radial, lateral, wp.float64(teeth.half_pitch_tangent))
        if step != 0:
            seat = wrapped_seat(seat + step, teeth.teeth)
            new_e, new_radial, new_lateral = in_gap(
                p, load_direction(ensemble.seats, teeth.first_seat + seat), wheel.cosine, wheel.sine
            )
            gap.e = new_e
            gap.radial = new_radial
            gap.lateral = new_lateral
        if seat != kept:
            store_whole(state.seat, memory, seat)
        v = velocity(shared.rows, j)
        if wp.static(moving):
            v = vec2(v[0] - Real(wheel.velocity[0]), v[1] - Real(wheel.velocity[1]))
        penetration, normal, speed = gap_approach(p, v, Real(wheel.speed), gap.e, gap.radial, gap.lateral, teeth)
        size = pressed(
            state, tallies, memory, before, penetration, speed, teeth.law, roller, stage, measured, weight, extra
        )
        if extra != 0:
            state.extra[roller].sprocket_force = state.extra[roller].sprocket_force + size
        force = size * normal
        if size != Real(0.0):
            set_force(shared, j, force_on(shared, j) + force)
        if size != Real(0.0) and (heeded >> s) & 1 != 0:
            at = s * wp.static(threads) + i
            moment = Real(p[1]) * force[0] - Real(p[0]) * force[1]
            store_part(shared.parts, at, load_part(shared.parts, at) + wp.float64(moment))
            if wp.static(moving):
                x = at + wp.static(sprockets * threads)
                store_part(shared.parts, x, load_part(shared.parts, x) - wp.float64(force[0]))
                y = at + wp.static(2 * sprockets * threads)
                store_part(shared.parts, y, load_part(shared.parts, y) - wp.float64(force[1]))

    @wp.func
    def on_bar(
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        memory: int,
        roller: int,
        j: int,
        g: int,
        stage: int,
        measured: int,
        weight: Real,
        extra: int,
    ):
        """Adds the force of guide-bar g to roller j's."""
        bar = shared.bars[g]
        before = load(state.impact_speed, memory)
        v = velocity(shared.rows, j)
        penetration, normal = guide_approach(place(shared.rows, j, bar.start), v, weight, bar)
        speed = -wp.dot(v, normal)
        size = pressed(
            state, tallies, memory, before, penetration, speed, bar.law, roller, stage, measured, weight, extra
        )
        if extra != 0:
            state.extra[roller].guide_force = state.extra[roller].guide_force + size
        if size != Real(0.0):
            set_force(shared, j, force_on(shared, j) + size * normal)

    @wp.func
    def slot(mask: int):
        """The first of a thread's rollers in `mask`, bits, which is not zero."""
        if wp.static(per == 1):
            return int(0)
        else:
            return lowest_bit(mask)

    @wp.func
    def contacts(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        first: int,
        memory: int,
        n: int,
        i: int,
        by_teeth: int,
        by_bar: int,
        heeded: int,
        stage: int,
        measured: int,
        weight: Real,
        extra: int,
    ):
        """Adds the contacts' forces to those of the thread's rollers in `by_teeth` and `by_bar`, bits of their slots.

        Each thread goes on to its next such roller at once, so that few wait. `first` and `memory` are the variant's
        first roller and contact memory; the rest as in `in_teeth`.
        """
        rest = int(0)
        while by_teeth != 0:
            j = slot(by_teeth) * wp.static(threads) + i
            if rest == 0:
                rest = shared.held[j] & SPROCKETS
            s = lowest_bit(rest)
            rest = rest & (rest - 1)
            if rest == 0:
                by_teeth = by_teeth & (by_teeth - 1)
            at = memory + j + s * n
            in_teeth(ensemble, state, tallies, shared, at, first + j, j, s, i, heeded, stage, measured, weight, extra)
        while by_bar != 0:
            j = slot(by_bar) * wp.static(threads) + i
            if rest == 0:
                rest = shared.held[j] & ~SPROCKETS
            p = lowest_bit(rest)
            rest = rest & (rest - 1)
            if rest == 0:
                by_bar = by_bar & (by_bar - 1)
            g = p - wp.static(sprockets)
            on_bar(state, tallies, shared, memory + j + p * n, first + j, j, g, stage, measured, weight, extra)

    @wp.func
    def part(shared: kinds.Shared, row: int, i: int):
        """This thread's share of the sum of all parts in `row`, which start anew at zero."""
        value = wp.float64(0.0)
        k = row * wp.static(threads) + i % group()
        for q in range(lanes() // group()):
            of_lane = wp.float64(0.0)
            for w in range(wp.static(threads) // lanes()):
                at = k + w * lanes() + q * group()
                of_lane = of_lane + load_part(shared.parts, at)
                store_part(shared.parts, at, wp.float64(0.0))
            value = value + of_lane
        return value

    @wp.func
    def sprocket_of(i: int):
        """The sprocket that thread i moves, negative for most: each group of threads has one, if they are few."""
        warps = wp.static(threads) // lanes()
        s = i // lanes() + warps * (i % lanes() // group() + lanes() // group() * (i % group()))
        return wp.where(s < wp.static(sprockets), s, -1)

    @wp.func
    def contacts_on(shared: kinds.Shared, i: int):
        """The chain's moment [N m] on the sprocket that thread i moves and, if it may move, its force [N].

        All threads together, between the barrier after the contacts and the next one.
        """
        totals = Totals()
        warps = wp.static(threads) // lanes()
        groups = lanes() // group()
        turn = int(0)
        first = i // lanes()  # sprocket of this warp
        while first < wp.static(sprockets):
            s = first + warps * (i % lanes() // group())
            moment = wp.float64(0.0)
            x = wp.float64(0.0)
            y = wp.float64(0.0)
            if s < wp.static(sprockets):
                moment = part(shared, s, i)
                if wp.static(moving):
                    x = part(shared, s + wp.static(sprockets), i)
                    y = part(shared, s + wp.static(2 * sprockets), i)
            moment = group_sum(moment)
            if wp.static(moving):
                x = group_sum(x)
                y = group_sum(y)
            if i % group() == turn:
                totals.moment = moment
                totals.push = vec2d(x, y)
            turn = turn + 1
            first = first + warps * groups
        return totals

    @wp.func
    def share_geometry(ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, s: int, center: vec2d):
        """Teeth and band of sprocket s, whose center is given; with the first one, the chain and the guide-bars."""
        drive = ensemble.drives[variant]
        sprocket = ensemble.sprockets[drive.first_sprocket + s]
        shared.teeth[s] = sprocket
        band = kinds.Band()
        band.center = vec2(Real(center[0]), Real(center[1]))
        band.near_square = sprocket.near_square
        band.far_square = sprocket.far_square
        shared.bands[s] = band
        if s == 0:
            shared.chain[0] = ensemble.chains[variant]
            for g in range(wp.static(guides)):
                shared.bars[g] = ensemble.guides[drive.first_guide + g]

    return SimpleNamespace(
        SPROCKETS=SPROCKETS,
        **{name: value for name, value in locals().items() if isinstance(value, wp.Function)},
    )
