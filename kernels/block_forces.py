"""The block kernels' evaluation: the forces on the roller that a thread holds, and the moments on the sprockets."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .contact import gap_contact, guide_contact, in_gap, moved_seat
from .exchange import exchange, lanes, lowest_bit
from .link import link_force
from .structs import ContactSums, Drive, Tallies, types, vec2d
from .tooth import nearest_seat, seat_step


@cache
def block_forces(Real: type, threads: int, sprockets: int) -> SimpleNamespace:
    """The functions that evaluate one variant on a block of `threads` threads, with `sprockets` sprockets."""
    kinds = types(Real)
    vec2 = kinds.vec2
    Moments = wp.types.vector(sprockets, Real)
    talk = exchange(Real, threads, sprockets)
    State = talk.state
    compensated = Real == wp.float32
    warp_sum = talk.warp_sum

    @wp.struct
    class Mesh:
        """The sprocket that a roller was engaged with last: its seat there and the contact's memory."""

        sprocket: wp.int32  # negative: none
        seat: wp.int32
        direction: vec2d  # of the seat at angle zero
        impact_speed: Real  # v0, 0 while open [m/s]

    @wp.struct
    class Forces:
        """What an evaluation finds for one roller and the link after it."""

        link: vec2  # force of the link after, on the roller [N]
        contact: vec2  # force of all contacts [N]
        tension: Real  # [N]
        rate: Real  # of the link's elongation [m/s]
        sprocket_force: Real  # sum of magnitudes [N]
        guide_force: Real  # [N]
        energy: Real  # elastic, of the contacts, if asked for [J]

    @wp.func
    def place(own: State, center: vec2d):
        """Position in float64 from `center` [m]."""
        if wp.static(compensated):
            return vec2d(
                wp.float64(own[0]) - center[0] + wp.float64(own[4]),
                wp.float64(own[1]) - center[1] + wp.float64(own[5]),
            )
        else:
            return vec2d(wp.float64(own[0]) - center[0], wp.float64(own[1]) - center[1])

    @wp.func
    def engagements(shared: kinds.Shared, own: State):
        """The sprockets whose band the roller is in, as bits."""
        mask = int(0)
        for s in range(wp.static(sprockets)):
            band = shared.bands[s]
            x = own[0] - band.center[0]
            y = own[1] - band.center[1]
            square = x * x + y * y
            if square > band.near_square and square < band.far_square:
                mask = mask | wp.static(1 << s)
        return mask

    @wp.func
    def with_contact(sums: ContactSums, weight: Real, force: Real, dissipated: Real, before: Real):
        """The sums with one roller's contact of one step; `weight` is the time it stands for [s], `before` its v0 so far."""
        sums.force_max = wp.max(sums.force_max, wp.float64(force))
        sums.impulse = sums.impulse + wp.float64(weight * force)
        sums.dissipated = sums.dissipated + wp.float64(weight * dissipated)
        if before == Real(0.0):
            sums.impacts = sums.impacts + 1
        return sums

    @wp.func
    def link_of(shared: kinds.Shared, own: State, other: State):
        """Tension [N], rate of elongation [m/s] and force on the roller [N] of the link to `other`, eq. (2), (3)."""
        chain = shared.chain[0]
        d = vec2(other[0] - own[0], other[1] - own[1])
        if wp.static(compensated):
            d = d + vec2(other[4] - own[4], other[5] - own[5])
        tension, rate, u = link_force(
            d, vec2(other[2] - own[2], other[3] - own[3]), chain.pitch, chain.stiffness, chain.damping
        )
        return tension, rate, tension * u

    @wp.func
    def store_mesh(state: kinds.State, tallies: Tallies, shared: kinds.Shared, drive: Drive, mesh: Mesh, i: int):
        """Seat, contact memory and sums of roller i's contact, into the state and the tallies."""
        if mesh.sprocket >= 0:
            memory = drive.first_contact + mesh.sprocket * drive.rollers + i
            state.seat[memory] = mesh.seat
            state.impact_speed[memory] = mesh.impact_speed
            tallies.contact[memory] = shared.contact_sums[i]

    @wp.func
    def load_mesh(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        drive: Drive,
        own: State,
        s: int,
        i: int,
    ):
        """Seat, contact memory and sums of roller i on sprocket s; the nearest seat if it has none."""
        memory = drive.first_contact + s * drive.rollers + i
        teeth = shared.teeth[s]
        mesh = Mesh()
        mesh.sprocket = s
        mesh.seat = state.seat[memory]
        mesh.impact_speed = state.impact_speed[memory]
        if mesh.seat < 0:
            wheel = shared.wheels[s]
            mesh.seat = nearest_seat(place(own, wheel.center), wheel.cosine, wheel.sine, teeth.teeth)
        mesh.direction = ensemble.seats[teeth.first_seat + mesh.seat]
        shared.contact_sums[i] = tallies.contact[memory]
        return mesh

    @wp.func
    def leave(state: kinds.State, drive: Drive, left: int, i: int):
        """Roller i is no longer engaged with the sprockets `left`, as bits."""
        while left != 0:
            memory = drive.first_contact + lowest_bit(left) * drive.rollers + i
            left = left & (left - 1)
            state.seat[memory] = -1
            state.impact_speed[memory] = Real(0.0)

    @wp.func
    def sum_moments(shared: kinds.Shared, moment: Moments, i: int):
        """This warp's part of each sprocket's moment, for all to see."""
        for s in range(wp.static(sprockets)):
            total = moment[s]
            total = warp_sum(total)
            if i % lanes() == 0:
                shared.parts[s * (wp.static(threads) // lanes()) + i // lanes()] = wp.float64(total)

    @wp.func
    def moment_on(shared: kinds.Shared, s: int):
        """Sum of the moments on sprocket `s` [N m], warp by warp; after the second barrier."""
        total = wp.float64(0.0)
        for w in range(wp.static(threads) // lanes()):
            total = total + shared.parts[s * (wp.static(threads) // lanes()) + w]
        return total

    @wp.func
    def evaluate(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        variant: int,
        own: State,
        other: State,
        mesh: Mesh,
        held: int,
        i: int,
        live: bool,
        stage: int,
        weight: Real,
        energetic: int,
    ):
        """Link and contact forces on roller i, the next roller's state being `other`; all threads together.

        `held` are the sprockets it was engaged with, as bits; v0 is kept at `stage` 0 only. Contacts are added to
        `tallies` where `weight` [s] is not zero. Returns the forces, and how the roller is engaged now.
        """
        out = Forces()
        tension, rate, link = link_of(shared, own, other)
        out.tension = tension
        out.rate = rate
        out.link = link
        v = vec2(own[2], own[3])
        moment = Moments()
        mask = int(0)
        if live:
            mask = engagements(shared, own)
            if mask != held:
                store_mesh(state, tallies, shared, ensemble.drives[variant], mesh, i)
                mesh.sprocket = -1
                leave(state, ensemble.drives[variant], held & ~mask, i)
        todo = mask
        while todo != 0:
            s = lowest_bit(todo)
            todo = todo & (todo - 1)
            if s != mesh.sprocket:
                store_mesh(state, tallies, shared, ensemble.drives[variant], mesh, i)
                new = load_mesh(ensemble, state, tallies, shared, ensemble.drives[variant], own, s, i)
                mesh.sprocket = s
                mesh.seat = new.seat
                mesh.direction = new.direction
                mesh.impact_speed = new.impact_speed
            sprocket = shared.teeth[s]
            wheel = shared.wheels[s]
            p = place(own, wheel.center)
            e, radial, lateral = in_gap(p, mesh.direction, wheel.cosine, wheel.sine)
            move = seat_step(radial, lateral, wp.float64(sprocket.half_pitch_tangent))
            if move != 0:
                mesh.seat = moved_seat(mesh.seat, move, sprocket.teeth)
                mesh.direction = ensemble.seats[sprocket.first_seat + mesh.seat]
                e, radial, lateral = in_gap(p, mesh.direction, wheel.cosine, wheel.sine)
            before = mesh.impact_speed
            f, size, first, dissipated, energy = gap_contact(
                p, v, Real(wheel.speed), e, radial, lateral, before, sprocket
            )
            if stage == 0:
                mesh.impact_speed = first
            if first != Real(0.0):
                out.contact = out.contact + f
                out.sprocket_force = out.sprocket_force + size
                turning = Real(p[1]) * f[0] - Real(p[0]) * f[1]
                for q in range(wp.static(sprockets)):
                    if q == s:
                        moment[q] = moment[q] + turning
                if energetic != 0:
                    out.energy = out.energy + energy
                if weight != Real(0.0):
                    shared.contact_sums[i] = with_contact(shared.contact_sums[i], weight, size, dissipated, before)
        sum_moments(shared, moment, i)
        if live:
            drive = ensemble.drives[variant]
            for g in range(drive.guides):
                memory = drive.first_contact + (wp.static(sprockets) + g) * drive.rollers + i
                bar = ensemble.guides[drive.first_guide + g]
                before = state.impact_speed[memory]
                f, size, first, dissipated, energy = guide_contact(place(own, bar.start), v, before, bar)
                if first != before and stage == 0:
                    state.impact_speed[memory] = first
                if first != Real(0.0):
                    out.contact = out.contact + f
                    out.guide_force = out.guide_force + size
                    if energetic != 0:
                        out.energy = out.energy + energy
                    if weight != Real(0.0):
                        sums = tallies.contact[memory]
                        tallies.contact[memory] = with_contact(sums, weight, size, dissipated, before)
        return out, mesh, mask

    @wp.func
    def move(own: State, dx: Real, dy: Real):
        """The state moved by (dx, dy) [m]; what float32 rounds off goes to the low parts (fast two-sum)."""
        if wp.static(compensated):
            low_x = own[4] + dx
            low_y = own[5] + dy
            x = own[0] + low_x
            y = own[1] + low_y
            own[4] = low_x - (x - own[0])
            own[5] = low_y - (y - own[1])
            own[0] = x
            own[1] = y
        else:
            own[0] = own[0] + dx
            own[1] = own[1] + dy
        return own

    return SimpleNamespace(
        State=State,
        Mesh=Mesh,
        Forces=Forces,
        talk=talk,
        evaluate=evaluate,
        store_mesh=store_mesh,
        moment_on=moment_on,
        move=move,
    )
