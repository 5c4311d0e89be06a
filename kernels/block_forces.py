"""The block kernels' forces: of the link after the roller that a thread holds, and of its contacts."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .contact import closed_contact, elastic_energy, gap_approach, guide_approach, in_gap
from .exchange import any_lane, exchange, lanes, lowest_bit
from .link import link_force
from .rollers import STATE_ROWS
from .structs import Drive, types, vec2d
from .sum_structs import ContactSums, Tallies, Totals
from .tooth import nearest_seat, seat_step, wrapped_seat


@cache
def block_forces(Real: type, threads: int, sprockets: int, guides: int, moving: bool = False) -> SimpleNamespace:
    """The functions that evaluate one variant on a block of `threads` threads.

    `moving` is for drives whose sprockets' centers may move or that have balance wheels.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    talk = exchange(Real, threads, sprockets, guides)
    State = talk.state
    compensated = Real == wp.float32
    warp_sum = talk.warp_sum

    @wp.struct
    class Mesh:
        """How a roller is engaged: the sprocket it was looked at last, its seat there and the contact's memory."""

        sprocket: wp.int32  # negative: none
        seat: wp.int32
        direction: vec2d  # of the seat at angle zero
        impact_speed: Real  # v0, 0 while open [m/s]
        held: wp.int32  # all sprockets it is engaged with, as bits
        guides: wp.int32  # guide-bars it touches, as bits

    @wp.struct
    class Gap:
        """Where a roller is in its tooth gap."""

        e: vec2d  # outward direction of the seat
        radial: wp.float64  # along it, from the sprocket's center [m]
        lateral: wp.float64  # across it [m]

    @wp.struct
    class Net:
        """What a roller's contacts add up to while they are gone through."""

        x: Real  # force [N]
        y: Real
        moment: Real  # of the last contact, on sprocket `on` [N m]
        push_x: Real  # and its force on that [N]
        push_y: Real
        on: wp.int32

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
        """The sums with one step of a contact, for the time `weight` [s]; `before` is its v0 so far."""
        sums.force_max = wp.max(sums.force_max, wp.float64(force))
        sums.impulse = sums.impulse + wp.float64(weight * force)
        sums.dissipated = sums.dissipated + wp.float64(weight * dissipated)
        if before == Real(0.0):
            sums.impacts = sums.impacts + 1
        return sums

    @wp.func
    def link_of(shared: kinds.Shared, own: State, other: State, length: Real):
        """Tension [N], rate of elongation [m/s] and force on the roller [N] of the link to `other`, eq. (2), (3)."""
        chain = shared.chain[0]
        d = vec2(other[0] - own[0], other[1] - own[1])
        if wp.static(compensated):
            d = d + vec2(other[4] - own[4], other[5] - own[5])
        tension, rate, u = link_force(
            d, vec2(other[2] - own[2], other[3] - own[3]), length, chain.stiffness, chain.damping
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
    def add_part(shared: kinds.Shared, value: Real, at: int, i: int):
        """Adds the warp's sum of `value` to its entry of row `at` of the parts."""
        total = warp_sum(value)
        if i % lanes() == 0:
            k = at * (wp.static(threads) // lanes()) + i // lanes()
            shared.parts[k] = shared.parts[k] + wp.float64(total)

    @wp.func
    def add_moments(shared: kinds.Shared, net: Net, i: int):
        """Adds this warp's part of each sprocket's moment, and of the force on it if it may move."""
        zero = Real(0.0)
        for s in range(wp.static(sprockets)):
            mine = net.on == s
            if any_lane(int(mine)) != 0:
                add_part(shared, wp.where(mine, net.moment, zero), wp.static(3 * s), i)
                if wp.static(moving):
                    add_part(shared, wp.where(mine, net.push_x, zero), wp.static(3 * s + 1), i)
                    add_part(shared, wp.where(mine, net.push_y, zero), wp.static(3 * s + 2), i)

    @wp.func
    def taken(shared: kinds.Shared, at: int):
        """The parts of row `at` added up, warp by warp, and set to zero; between the second barrier and the first."""
        total = wp.float64(0.0)
        for w in range(wp.static(threads) // lanes()):
            k = at * (wp.static(threads) // lanes()) + w
            total = total + shared.parts[k]
            shared.parts[k] = wp.float64(0.0)
        return total

    @wp.func
    def contacts_on(shared: kinds.Shared, s: int):
        """The chain's moment [N m] on sprocket `s` and, if it may move, its force [N]; they start anew at zero."""
        totals = Totals()
        totals.moment = taken(shared, 3 * s)
        if wp.static(moving):
            totals.push = vec2d(taken(shared, 3 * s + 1), taken(shared, 3 * s + 2))
        return totals

    @wp.func
    def contacts(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        variant: int,
        own: State,
        mesh: Mesh,
        i: int,
        live: bool,
        stage: int,
        measured: int,
        weight: Real,
        extra: int,
    ):
        """Contact force on roller i [N], and how it is engaged now; all threads together.

        The moments on the sprockets go to `shared.parts`, contacts to their sums if `measured`, for the time `weight`
        [s], forces and energy to `shared.extra` if `extra`. v0 is kept at `stage` 0 only.
        """
        total = Net()
        v = vec2(own[2], own[3])
        todo = int(0)
        if live:
            todo = engagements(shared, own)
            if todo != mesh.held:
                drive = ensemble.drives[variant]
                store_mesh(state, tallies, shared, drive, mesh, i)
                mesh.sprocket = -1
                leave(state, drive, mesh.held & ~todo, i)
                mesh.held = todo
        more = int(1)
        while more != 0:
            total.on = -1
            if todo != 0:
                s = lowest_bit(todo)
                todo = todo & (todo - 1)
                if s != mesh.sprocket:
                    drive = ensemble.drives[variant]
                    store_mesh(state, tallies, shared, drive, mesh, i)
                    new = load_mesh(ensemble, state, tallies, shared, drive, own, s, i)
                    mesh.sprocket = s
                    mesh.seat = new.seat
                    mesh.direction = new.direction
                    mesh.impact_speed = new.impact_speed
                sprocket = shared.teeth[s]
                wheel = shared.wheels[s]
                p = place(own, wheel.center)
                e, radial, lateral = in_gap(p, mesh.direction, wheel.cosine, wheel.sine)
                gap = Gap()
                gap.e = e
                gap.radial = radial
                gap.lateral = lateral
                move = seat_step(radial, lateral, wp.float64(sprocket.half_pitch_tangent))
                if move != 0:
                    mesh.seat = wrapped_seat(mesh.seat + move, sprocket.teeth)
                    mesh.direction = ensemble.seats[sprocket.first_seat + mesh.seat]
                    new_e, new_radial, new_lateral = in_gap(p, mesh.direction, wheel.cosine, wheel.sine)
                    gap.e = new_e
                    gap.radial = new_radial
                    gap.lateral = new_lateral
                relative = v
                if wp.static(moving):
                    relative = vec2(v[0] - Real(wheel.velocity[0]), v[1] - Real(wheel.velocity[1]))
                penetration, normal, speed = gap_approach(
                    p, relative, Real(wheel.speed), gap.e, gap.radial, gap.lateral, sprocket
                )
                if penetration > Real(0.0):
                    size, first, elastic = closed_contact(penetration, speed, mesh.impact_speed, sprocket.law)
                    f = size * normal
                    total.x = total.x + f[0]
                    total.y = total.y + f[1]
                    total.moment = Real(p[1]) * f[0] - Real(p[0]) * f[1]
                    total.push_x = -f[0]
                    total.push_y = -f[1]
                    total.on = s
                    if measured != 0:
                        before = mesh.impact_speed
                        dissipated = (size - elastic) * speed
                        shared.contact_sums[i] = with_contact(shared.contact_sums[i], weight, size, dissipated, before)
                    if extra != 0:
                        shared.extra[i].sprocket_force = shared.extra[i].sprocket_force + size
                        energy = elastic_energy(elastic, penetration, sprocket.law)
                        shared.extra[i].energy = shared.extra[i].energy + energy
                    if stage == 0:
                        mesh.impact_speed = first
                else:
                    if stage == 0:
                        mesh.impact_speed = Real(0.0)
            add_moments(shared, total, i)
            more = any_lane(todo)
        if live:
            for g in range(wp.static(guides)):
                bar = shared.bars[g]
                penetration, normal = guide_approach(place(own, bar.start), v, weight, bar)
                touched = (mesh.guides & wp.static(1 << g)) != 0
                if penetration > Real(0.0) or touched:
                    drive = ensemble.drives[variant]
                    memory = drive.first_contact + wp.static(sprockets + g) * drive.rollers + i
                    if penetration > Real(0.0):
                        before = state.impact_speed[memory]
                        speed = -wp.dot(v, normal)
                        size, first, elastic = closed_contact(penetration, speed, before, bar.law)
                        total.x = total.x + size * normal[0]
                        total.y = total.y + size * normal[1]
                        mesh.guides = mesh.guides | wp.static(1 << g)
                        if stage == 0 and first != before:
                            state.impact_speed[memory] = first
                        if measured != 0:
                            dissipated = (size - elastic) * speed
                            sums = tallies.contact[memory]
                            tallies.contact[memory] = with_contact(sums, weight, size, dissipated, before)
                        if extra != 0:
                            shared.extra[i].guide_force = shared.extra[i].guide_force + size
                            energy = elastic_energy(elastic, penetration, bar.law)
                            shared.extra[i].energy = shared.extra[i].energy + energy
                    elif stage == 0:
                        mesh.guides = mesh.guides & wp.static(~(1 << g))
                        state.impact_speed[memory] = Real(0.0)
        return vec2(total.x, total.y), mesh

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

    @wp.func
    def fetch(ensemble: kinds.Ensemble, state: kinds.State, variant: int, i: int):
        """State of roller i, of the last one where there is none."""
        drive = ensemble.drives[variant]
        row = STATE_ROWS * drive.first_roller + wp.min(i, drive.rollers - 1)
        own = State()
        for k in range(wp.static(6)):
            own[k] = state.rollers[row + k * drive.rollers]
        return own

    @wp.func
    def put_back(ensemble: kinds.Ensemble, state: kinds.State, variant: int, own: State, i: int):
        """State of roller i back into its rows."""
        drive = ensemble.drives[variant]
        row = STATE_ROWS * drive.first_roller + i
        for k in range(wp.static(6)):
            state.rollers[row + k * drive.rollers] = own[k]

    @wp.func
    def engaged(ensemble: kinds.Ensemble, state: kinds.State, variant: int, i: int):
        """The sprockets that roller i is engaged with and the guide-bars it touches."""
        drive = ensemble.drives[variant]
        mesh = Mesh()
        mesh.sprocket = -1
        if i < drive.rollers:
            memory = drive.first_contact + i
            for s in range(wp.static(sprockets)):
                if state.seat[memory + s * drive.rollers] >= 0:
                    mesh.held = mesh.held | (1 << s)
            for g in range(drive.guides):
                if state.impact_speed[memory + (wp.static(sprockets) + g) * drive.rollers] != Real(0.0):
                    mesh.guides = mesh.guides | (1 << g)
        return mesh

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
        State=State,
        Mesh=Mesh,
        talk=talk,
        link_of=link_of,
        contacts=contacts,
        share_geometry=share_geometry,
        store_mesh=store_mesh,
        contacts_on=contacts_on,
        move=move,
        fetch=fetch,
        put_back=put_back,
        engaged=engaged,
    )
