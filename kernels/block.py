"""The block kernel: one block of threads a variant, one roller a thread, the whole time loop inside (leapfrog).

A roller's state, its seats and its contacts' memories stay in registers. Thread s also moves sprocket s. One kernel is
made for each precision, number of threads, and number of sprockets and guide-bars.
"""

from functools import cache

import warp as wp

from .body import load_at, prescribed_at
from .contact import guide_contact, sprocket_contact
from .exchange import exchange
from .link import link_force
from .rollers import STATE_ROWS
from .structs import types, vec2d
from .tooth import nearest_seat

vec3d = wp.types.vector(3, wp.float64)


@wp.func
def rotated(direction: vec2d, angle: wp.float64):
    """A unit vector turned by a small angle: the series to fifth order, then back to length one."""
    square = angle * angle
    cosine = wp.float64(1.0) - square * (wp.float64(0.5) - square * wp.float64(1.0 / 24.0))
    sine = angle * (wp.float64(1.0) - square * (wp.float64(1.0 / 6.0) - square * wp.float64(1.0 / 120.0)))
    x = direction[0] * cosine - direction[1] * sine
    y = direction[0] * sine + direction[1] * cosine
    scale = wp.float64(1.5) - wp.float64(0.5) * (x * x + y * y)
    return vec2d(x * scale, y * scale)


@cache
def block_kernel(Real: type, threads: int, sprockets: int, guides: int, blocks: int = 4) -> wp.Kernel:
    """The kernel for drives of up to `threads` rollers with these numbers of sprockets and guide-bars.

    Launch it with `dim` = variants * threads and `block_dim` = threads. `blocks` is how many blocks the compiler is to
    make room for on a multiprocessor; it bounds the registers of a thread.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    talk = exchange(Real, threads, sprockets)
    State, Moments = talk.state, talk.moments
    Seats = wp.types.vector(sprockets, wp.int32)
    Memories = wp.types.vector(sprockets + guides, Real)
    compensated = Real == wp.float32
    state_of_next, finish, sprocket_body = talk.state_of_next, talk.finish, talk.sprocket_body

    @wp.func
    def place(own: State, center: vec2d):
        """Position in float64 from `center` [m]."""
        return vec2d(
            wp.float64(own[0]) - center[0] + wp.float64(own[4]), wp.float64(own[1]) - center[1] + wp.float64(own[5])
        )

    @wp.func
    def move(own: State, dx: Real, dy: Real):
        """The state moved by (dx, dy); what float32 rounds off goes to the low parts."""
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

    @wp.kernel(enable_backward=False, module="unique", grid_stride=False, launch_bounds=(threads, blocks))
    def advance_block(ensemble: kinds.Ensemble, state: kinds.State, order: wp.array(dtype=wp.int32), block: int):
        """Variants `order[b]`, one a block of threads: `block` steps on."""
        variant = order[wp.tid() // wp.static(threads)]
        i = wp.tid() % wp.static(threads)
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        progress = state.progress[variant]
        n = drive.rollers
        live = i < n
        row = STATE_ROWS * drive.first_roller + wp.min(i, n - 1)
        own = State()
        for k in range(wp.static(6)):
            own[k] = state.rollers[row + k * n]
        seat = Seats()
        memory = Memories()
        for s in range(wp.static(sprockets)):
            seat[s] = state.seat[drive.first_contact + s * n + wp.min(i, n - 1)]
        for p in range(wp.static(sprockets + guides)):
            memory[p] = state.impact_speed[drive.first_contact + p * n + wp.min(i, n - 1)]
        mine = drive.first_sprocket + wp.min(i, wp.static(sprockets - 1))
        motion = ensemble.motions[mine]
        body = state.sprockets[mine]
        heading = vec2d(wp.cos(body.angle), wp.sin(body.angle))
        if i < wp.static(sprockets):
            sprocket_body(1, i, vec3d(heading[0], heading[1], body.speed))
        center_x = Moments()
        center_y = Moments()
        near = Moments()
        far = Moments()
        for s in range(wp.static(sprockets)):
            center_x[s] = Real(state.sprockets[drive.first_sprocket + s].center[0])
            center_y[s] = Real(state.sprockets[drive.first_sprocket + s].center[1])
            near[s] = ensemble.sprockets[drive.first_sprocket + s].near_square
            far[s] = ensemble.sprockets[drive.first_sprocket + s].far_square
        inverse_mass = Real(1.0) / chain.mass
        h = Real(drive.step)
        end = wp.min(progress.step + block, drive.steps)
        step = progress.step
        while step < end:
            kick = h
            if step == 0:
                kick = Real(0.5) * h
            other = state_of_next(own, i, n)
            d = vec2(other[0] - own[0], other[1] - own[1])
            if wp.static(compensated):
                d = d + vec2(other[4] - own[4], other[5] - own[5])
            tension, rate, u = link_force(
                d, vec2(other[2] - own[2], other[3] - own[3]), chain.pitch, chain.stiffness, chain.damping
            )
            force = tension * u
            link = force
            v = vec2(own[2], own[3])
            moment = Moments()
            for s in range(wp.static(sprockets)):
                r = vec2(own[0] - center_x[s], own[1] - center_y[s])
                square = wp.dot(r, r)
                if live and square > near[s] and square < far[s]:
                    sprocket = ensemble.sprockets[drive.first_sprocket + s]
                    center = state.sprockets[drive.first_sprocket + s].center
                    now = sprocket_body(0, s, vec3d())
                    at = place(own, center)
                    held = seat[s]
                    if held < 0:
                        held = nearest_seat(at, now[0], now[1], sprocket.teeth)
                    f, size, moved, first, dissipated, energy = sprocket_contact(
                        at, v, Real(now[2]), now[0], now[1], held, memory[s], sprocket, ensemble.seats
                    )
                    seat[s] = moved
                    memory[s] = first
                    force = force + f
                    moment[s] = r[1] * f[0] - r[0] * f[1]
                else:
                    seat[s] = -1
                    memory[s] = Real(0.0)
            for g in range(wp.static(guides)):
                bar = ensemble.guides[drive.first_guide + g]
                f, size, first, dissipated, energy = guide_contact(
                    place(own, bar.start), v, memory[wp.static(sprockets) + g], bar
                )
                memory[wp.static(sprockets) + g] = first
                force = force + f
            done = finish(link, moment, i, n)
            force = force - vec2(done[0], done[1])
            own[2] = own[2] + kick * (inverse_mass * force[0] + chain.gravity[0])
            own[3] = own[3] + kick * (inverse_mass * force[1] + chain.gravity[1])
            own = move(own, h * own[2], h * own[3])
            if i < wp.static(sprockets):
                total = Real(0.0)
                for s in range(wp.static(sprockets)):
                    if i == s:
                        total = done[2 + s]
                time = wp.float64(step) * drive.step
                before = body.angle
                if motion.prescribed == 1:
                    angle, exact = prescribed_at(time + drive.step, motion, ensemble.harmonics, ensemble.tables)
                    body.speed = (angle - body.angle) / drive.step
                    body.angle = angle
                else:
                    load = load_at(time, body.angle, body.speed, motion, ensemble.harmonics, ensemble.tables)
                    body.speed = body.speed + wp.float64(kick) * (wp.float64(total) + load) * motion.inverse_inertia
                    body.angle = body.angle + drive.step * body.speed
                heading = rotated(heading, body.angle - before)
                sprocket_body(1, i, vec3d(heading[0], heading[1], body.speed))
            step = step + 1
        if live:
            for k in range(wp.static(6)):
                state.rollers[row + k * n] = own[k]
            for s in range(wp.static(sprockets)):
                state.seat[drive.first_contact + s * n + i] = seat[s]
            for p in range(wp.static(sprockets + guides)):
                state.impact_speed[drive.first_contact + p * n + i] = memory[p]
        if i < wp.static(sprockets):
            state.sprockets[mine] = body
        if i == 0:
            progress.step = step
            state.progress[variant] = progress

    return advance_block
