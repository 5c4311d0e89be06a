"""The block kernels' contacts: who is near what, and the answers of teeth and guide-bars.

A contact's memory (seat, v0) and its sums stay where the state and the tallies have them, which the cache holds.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import (
    MISSED,
    UNTOUCHED,
    after_teeth,
    dissipated,
    in_teeth,
    misses,
    on_guide,
    reaction,
    respond,
    rub,
    surface_velocity,
    tracked_seat,
    turned,
)
from ..physics.profile import in_frame, near_profile, on_profile, tracked_piece
from ..rows import accessors
from ..structs import GROUND, Drive, Pose, Wrench, types
from ..sum_structs import Tallies
from .block_events import EXTRA, START
from .block_kind import BlockKind, Mine, now_struct
from .block_rows import block_rows
from .exchange import add_to, count_at, group, lanes, lowest_bit, raise_to


@dataclass(frozen=True)
class ForceFunctions:
    """What is done about contacts, as functions of kernels; `SPROCKETS` are those partners' bits."""

    SPROCKETS: int
    near: wp.Function
    leave: wp.Function
    contacts: wp.Function
    body_of: wp.Function
    force_on_hub: wp.Function
    wrench_on: wp.Function
    share_geometry: wp.Function


@cache
def block_forces(kind: BlockKind) -> ForceFunctions:
    """The functions that evaluate the contacts of one variant on a block."""
    Real, threads, per, sprockets, guides = kind.Real, kind.threads, kind.per, kind.sprockets, kind.guides
    moving, sliding, rk4, bodies, profiles = kind.moving, kind.sliding, kind.rk4, kind.bodies, kind.profiles
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    row = block_rows(kind)
    place, velocity, force_on, set_force = row.place, row.velocity, row.force_on, row.set_force
    acceleration = row.acceleration
    X, Y, group_sum = row.X, row.Y, row.sharing.group_sum
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_whole, store_whole = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    load_part, store_part = accessors(wp.float64).load_row, accessors(wp.float64).store_row
    SPROCKETS = wp.constant((1 << sprockets) - 1)

    @wp.func
    def by_profile(bar: kinds.Guide):
        """Whether a guide has a profile."""
        if wp.static(profiles):
            return bar.pieces != 0
        else:
            return False

    @wp.func
    def near(shared: kinds.Shared, j: int, n: int):
        """The partners that roller j may touch, as bits: sprockets whose band it is in, guide-bars it is on."""
        rows = shared.rows
        x = load_row(rows, X + j)
        y = load_row(rows, Y + j)
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
            if by_profile(bar):
                pose = shared.poses[bar.body]
                if near_profile(in_frame(place(rows, j, pose.center), pose), bar):
                    mask = mask | (1 << (wp.static(sprockets) + g))
            else:
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
    def keep(state: kinds.State, now: Now, at: int, before: Real, first: Real):
        """Keeps what a closed contact whose memory is at `at` goes on with.

        v0 is kept at a step's start only (rk4 has three more stages).
        """
        if before <= Real(0.0) and now.stage == 0:
            store_row(state.impact_speed, at, first)

    @wp.func
    def lag(mine: Mine):
        """How far velocities are behind the forces [s]."""
        if wp.static(rk4):
            return Real(0.0)
        else:
            return Real(wp.float64(0.5) * mine.h)

    @wp.func
    def measure(tallies: Tallies, now: Now, at: int, before: Real, size: Real, damped: Real, rubbed: Real):
        """Adds a closed contact to its sums: its force [N], the power of its damping and of its friction [W].

        No other thread adds to them; memory does, as it is told, and this thread does not wait for what stands there.
        """
        add_to(tallies.dissipated, at, wp.float64(now.weight * damped))
        if wp.static(sliding):
            add_to(tallies.friction, at, wp.float64(now.weight * rubbed))
        if now.watched != 0:
            add_to(tallies.impulse, at, wp.float64(now.watch_weight * size))
            raise_to(tallies.force_max, at, wp.float64(size))
        if before <= Real(0.0):
            count_at(tallies.impacts, at)

    @wp.func
    def put(state: kinds.State, now: Now, at: int, before: Real, kept: Real):
        """What an open contact keeps."""
        if before != kept and now.stage == 0:
            store_row(state.impact_speed, at, kept)

    @wp.func
    def pushed(watched: int):
        """Whether the force on sprockets is wanted beside the moment."""
        if wp.static(moving):
            return True
        elif wp.static(kind.pushes):
            return watched != 0
        else:
            return False

    @wp.func
    def add_wrench(shared: kinds.Shared, s: int, i: int, moment: wp.float64, force: vec2, watched: int):
        """Adds the moment [N m] and the opposite of a roller's force [N] to thread i's parts of those on body s."""
        at = s * wp.static(threads) + i
        store_part(shared.parts, at, load_part(shared.parts, at) + moment)
        if pushed(watched):
            x = at + wp.static(bodies * threads)
            store_part(shared.parts, x, load_part(shared.parts, x) - wp.float64(force[0]))
            y = at + wp.static(2 * bodies * threads)
            store_part(shared.parts, y, load_part(shared.parts, y) - wp.float64(force[1]))

    @wp.func
    def at_sprocket(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        s: int,
    ):
        """Adds the force of the teeth of sprocket s to roller j's, and its reaction to the sprocket if it is summed."""
        teeth = shared.teeth[s]
        pose = shared.poses[s]
        at = mine.memory + j + s * mine.rollers
        kept = load_whole(state.seat, at)
        before = load_row(state.impact_speed, at)
        p = place(shared.rows, j, pose.center)
        seat = tracked_seat(p, kept, pose.cosine, pose.sine, teeth, ensemble.seats)
        if seat.number != kept:
            store_whole(state.seat, at, seat.number)
        v = velocity(shared.rows, j)
        if wp.static(moving):
            v = vec2(v[0] - Real(pose.velocity[0]), v[1] - Real(pose.velocity[1]))
        penetration, normal, relative = in_teeth(p, v, Real(pose.speed), seat, teeth)
        if penetration > Real(0.0):
            force, size, first, damper, energy = respond(penetration, normal, relative, before, teeth.law)
            if now.flags & EXTRA != 0:  # at once, so that the energy is worked out only here
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = rub(size, normal, relative, shared.sliding[s])
                force = force + drag
            set_force(shared, j, force_on(shared, j) + force)
            keep(state, now, at, before, first)
            if now.measured != 0:
                a = acceleration(shared, j)
                damped = dissipated(damper * normal, relative, a, lag(mine))
                measure(tallies, now, at, before, size, damped, dissipated(drag, relative, a, lag(mine)))
                if before == Real(UNTOUCHED):
                    count_at(tallies.contacts, at)
            if (now.summed >> s) & 1 != 0:
                arm = vec2(Real(p[0]), Real(p[1]))
                add_wrench(shared, s, mine.thread, wp.float64(reaction(arm, force)), force, now.watched)
        else:
            put(state, now, at, before, after_teeth(before))

    @wp.func
    def at_profile(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, g: int, bar: kinds.Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on the profile of guide g."""
        pose = shared.poses[bar.body]
        arm = place(shared.rows, j, pose.center)
        q = in_frame(arm, pose)
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        kept = load_whole(state.seat, at)
        number = tracked_piece(q, kept, bar, ensemble.pieces)
        if number != kept:
            store_whole(state.seat, at, number)
        penetration, facing = on_profile(q, number, bar, ensemble.pieces)
        facing = turned(facing, pose.cosine, pose.sine)
        surface = surface_velocity(pose, arm)
        relative = vec2(Real(surface[0]), Real(surface[1])) - velocity(shared.rows, j)
        return penetration, vec2(Real(facing[0]), Real(facing[1])), relative

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
                p = place(shared.rows, j, bar.start)
                penetration, normal, relative = on_guide(p, velocity(shared.rows, j), vec2(), bar)
            return penetration, normal, relative
        else:
            still = vec2(Real(0.0), Real(0.0))
            p = place(shared.rows, j, bar.start)
            penetration, normal, relative = on_guide(p, velocity(shared.rows, j), still, bar)
            return penetration, normal, relative

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
        bar = shared.bars[g]
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        before = load_row(state.impact_speed, at)
        penetration, normal, relative = on_bar(ensemble, state, shared, mine, j, g, bar)
        if penetration > Real(0.0) and misses(penetration, before, bar):
            if now.measured != 0 and (before == Real(UNTOUCHED) or now.flags & START != 0):
                count_at(tallies.missed, at)
            put(state, now, at, before, Real(MISSED))
        elif penetration > Real(0.0):
            force, size, first, damper, energy = respond(penetration, normal, relative, before, bar.law)
            if now.flags & EXTRA != 0:
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].guide_force = state.extra[extra].guide_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = rub(size, normal, relative, shared.sliding[wp.static(sprockets) + g])
                force = force + drag
            set_force(shared, j, force_on(shared, j) + force)
            if wp.static(profiles):
                if bar.body < wp.static(bodies):
                    arm = place(shared.rows, j, shared.poses[bar.body].center)
                    moment = reaction(vec2(Real(arm[0]), Real(arm[1])), force)
                    add_wrench(shared, bar.body, mine.thread, wp.float64(moment), force, now.watched)
            keep(state, now, at, before, first)
            if now.measured != 0:
                a = acceleration(shared, j)
                damped = dissipated(damper * normal, relative, a, lag(mine))
                measure(tallies, now, at, before, size, damped, dissipated(drag, relative, a, lag(mine)))
        else:
            put(state, now, at, before, Real(UNTOUCHED))

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
        mine: Mine,
        now: Now,
        by_teeth: int,
        by_bar: int,
    ):
        """Adds the contacts' forces to those of the thread's rollers in `by_teeth` and `by_bar`, bits of their slots.

        Each thread goes on to its next such roller at once, so that few wait.
        """
        rest = int(0)
        while by_teeth != 0:
            j = slot(by_teeth) * wp.static(threads) + mine.thread
            if rest == 0:
                rest = shared.held[j] & SPROCKETS
            s = lowest_bit(rest)
            rest = rest & (rest - 1)
            if rest == 0:
                by_teeth = by_teeth & (by_teeth - 1)
            at_sprocket(ensemble, state, tallies, shared, mine, now, j, s)
        while by_bar != 0:
            j = slot(by_bar) * wp.static(threads) + mine.thread
            if rest == 0:
                rest = shared.held[j] & ~SPROCKETS
            p = lowest_bit(rest)
            rest = rest & (rest - 1)
            if rest == 0:
                by_bar = by_bar & (by_bar - 1)
            at_guide(ensemble, state, tallies, shared, mine, now, j, p - wp.static(sprockets))

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
    def body_of(i: int):
        """The body that thread i moves, negative for most: each group of threads has one, if they are few."""
        warps = wp.static(threads) // lanes()
        s = i // lanes() + warps * (i % lanes() // group() + lanes() // group() * (i % group()))
        return wp.where(s < wp.static(bodies), s, -1)

    @wp.func
    def total_on(shared: kinds.Shared, rows: int, i: int):
        """Sum of all threads' parts in the row of the body that thread i moves, of those from `rows` on."""
        total = wp.float64(0.0)
        warps = wp.static(threads) // lanes()
        groups = lanes() // group()
        turn = int(0)
        first = i // lanes()  # body of this warp
        while first < wp.static(bodies):
            s = first + warps * (i % lanes() // group())
            value = wp.float64(0.0)
            if s < wp.static(bodies):
                value = part(shared, rows + s, i)
            value = group_sum(value)
            if i % group() == turn:
                total = value
            turn = turn + 1
            first = first + warps * groups
        return total

    @wp.func
    def force_on_hub(shared: kinds.Shared, i: int):
        """The chain's force on the body that thread i moves [N], where it is wanted; all threads as for `wrench_on`."""
        force = wp.vec2d()
        warps = wp.static(threads) // lanes()
        groups = lanes() // group()
        turn = int(0)
        first = i // lanes()
        while first < wp.static(bodies):
            s = first + warps * (i % lanes() // group())
            x = wp.float64(0.0)
            y = wp.float64(0.0)
            if s < wp.static(bodies):
                x = part(shared, wp.static(bodies) + s, i)
                y = part(shared, wp.static(2 * bodies) + s, i)
            x = group_sum(x)
            y = group_sum(y)
            if i % group() == turn:
                force = wp.vec2d(x, y)
            turn = turn + 1
            first = first + warps * groups
        return force

    @wp.func
    def wrench_on(shared: kinds.Shared, i: int):
        """The chain's moment [N m] on the body that thread i moves and, if bodies move, its force [N].

        All threads together, between the barrier after the contacts and the next one.
        """
        wrench = Wrench()
        wrench.moment = total_on(shared, 0, i)
        if wp.static(moving):
            wrench.force = force_on_hub(shared, i)
        return wrench

    @wp.func
    def share_geometry(ensemble: kinds.Ensemble, shared: kinds.Shared, drive: Drive, variant: int, s: int):
        """Teeth and band of sprocket s, whose pose is shared; with the first one, the chain and the guide-bars."""
        center = shared.poses[s].center
        sprocket = ensemble.sprockets[drive.first_sprocket + s]
        shared.teeth[s] = sprocket
        band = kinds.Band()
        band.center = vec2(Real(center[0]), Real(center[1]))
        band.near_square = sprocket.near_square
        band.far_square = sprocket.far_square
        shared.bands[s] = band
        if wp.static(sliding):
            shared.sliding[s] = ensemble.tooth_sliding[drive.first_sprocket + s]
        if s == 0:
            shared.chain[0] = ensemble.chains[variant]
            if wp.static(kind.bending):
                shared.joint[0] = ensemble.joints[variant]
            if wp.static(kind.uneven):
                shared.links[0] = ensemble.links[variant]
            if wp.static(profiles):
                ground = Pose()
                ground.cosine = wp.float64(1.0)
                shared.poses[wp.static(bodies)] = ground
            for g in range(wp.static(guides)):
                bar = ensemble.guides[drive.first_guide + g]
                if wp.static(profiles):
                    bar.body = wp.where(bar.body == GROUND, wp.static(bodies), bar.body)
                    bar.first_piece = drive.first_piece + bar.first_piece
                shared.bars[g] = bar
                if wp.static(sliding):
                    shared.sliding[wp.static(sprockets) + g] = ensemble.guide_sliding[drive.first_guide + g]

    return ForceFunctions(
        SPROCKETS=SPROCKETS,
        near=near,
        leave=leave,
        contacts=contacts,
        body_of=body_of,
        force_on_hub=force_on_hub,
        wrench_on=wrench_on,
        share_geometry=share_geometry,
    )
