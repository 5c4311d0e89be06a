"""The block kernel: one block of threads a variant, one roller a thread, the whole time loop inside (leapfrog).

A roller's state stays in registers, with seat and memory of the contact it is in. A few threads also move a sprocket
each. Whatever does not happen every step waits for the next event. One kernel is made for each precision, number of
threads and number of sprockets.
"""

from functools import cache

import warp as wp

from .block_forces import block_forces
from .block_observe import CHECK, END, ENDS, EVENT, FRAME, LAST, START, block_observing
from .block_sprockets import block_sprockets
from .exchange import any_thread, barrier
from .rollers import STATE_ROWS
from .serial import DIVERGENCE_CHECK
from .structs import Drive, SprocketState, types
from .sum_structs import Sums, Tallies, Totals
from .sums import STRAND_LOOK_EVERY


@cache
def block_kernel(
    Real: type, threads: int, sprockets: int, guides: int, blocks: int = 4, moving: bool = False
) -> wp.Kernel:
    """The kernel for drives of up to `threads` rollers and of these numbers of sprockets and guide-bars.

    Launch it with `dim` = variants * threads and `block_dim` = threads. `blocks` is how many blocks the compiler is to
    make room for on a multiprocessor; it bounds the registers of a thread. `moving` is for drives whose
    sprockets' centers may move or that have balance wheels.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    part = block_forces(Real, threads, sprockets, guides, moving)
    look = block_observing(Real, threads, sprockets, guides, moving)
    State = part.State
    talk = part.talk
    shared_arrays, state_of_next, force_of_previous = talk.shared_arrays, talk.state_of_next, talk.force_of_previous
    link_of, contacts, store_mesh = part.link_of, part.contacts, part.store_mesh
    move = part.move
    wheels = block_sprockets(Real, threads, sprockets, guides, moving)
    sprocket_of, center_outside, set_heading = wheels.sprocket_of, wheels.center_outside, wheels.set_heading
    start_sprocket, end_sprocket, foresee = wheels.start_sprocket, wheels.end_sprocket, wheels.foresee
    turn, turn_and_move = wheels.turn, wheels.turn_and_move
    fetch, put_back, engaged = part.fetch, part.put_back, part.engaged

    @wp.struct
    class Now:
        """Where the time loop is; all threads of a block agree but on category and middle."""

        step: wp.int32
        event: wp.int32  # the next step at which more happens than forces and motion
        flags: wp.int32  # what happens now, as bits
        measured: wp.int32  # 1 in the window
        weight: Real  # time that this step stands for in the window's sums [s]
        category: wp.int32  # strand that this thread's link is on (S: none)
        middle: wp.int32  # strands whose middle it passes, as bits
        diverged: wp.int32
        going: wp.int32  # 0 at the run's last step and where it diverged

    @wp.func
    def publish(ensemble: kinds.Ensemble, state: kinds.State, variant: int, own: State, i: int):
        """Position of roller i into its rows, for other threads to read."""
        drive = ensemble.drives[variant]
        row = STATE_ROWS * drive.first_roller + i
        state.rollers[row] = own[0]
        state.rollers[row + drive.rollers] = own[1]

    @wp.func
    def next_event(drive: Drive, step: int):
        """The next step after `step` at which more happens than forces and motion."""
        event = (step // DIVERGENCE_CHECK + 1) * DIVERGENCE_CHECK
        if step < drive.window_end:
            event = wp.min(event, (step // STRAND_LOOK_EVERY + 1) * STRAND_LOOK_EVERY)
            event = wp.min(event, drive.window_end)
        if step < drive.window_start:
            event = wp.min(event, drive.window_start)
        if step == drive.window_start or step == drive.window_end:
            event = step + 1
        if drive.sample_every > 0:
            event = wp.min(event, (step // drive.sample_every + 1) * drive.sample_every)
        if step < drive.steps:
            event = wp.min(event, drive.steps)
        return event

    @wp.func
    def flags_of(drive: Drive, step: int):
        """What happens at `step`, as bits."""
        flags = int(EVENT)
        if step == drive.steps:
            flags = flags | LAST
        if drive.sample_every > 0:
            if step % drive.sample_every == 0:
                flags = flags | FRAME
        if step == drive.window_start:
            flags = flags | START
        if step == drive.window_end:
            flags = flags | END
        if step % DIVERGENCE_CHECK == 0 or step == drive.steps:
            flags = flags | CHECK
        return flags

    @wp.func
    def frame_at(ensemble: kinds.Ensemble, state: kinds.State, variant: int, step: int):
        """Where the frame of `step` begins in the launch's buffer."""
        drive = ensemble.drives[variant]
        every = drive.sample_every
        number = step // every - (state.progress[variant].step + every - 1) // every
        return int(drive.first_value) + number * (7 * drive.rollers + wp.static(5 * sprockets))

    @wp.func
    def outside(ensemble: kinds.Ensemble, variant: int, own: State, i: int):
        """1 where roller i is not finite or has left the drive's box."""
        drive = ensemble.drives[variant]
        x = wp.float64(own[0])
        y = wp.float64(own[1])
        inside = x > drive.low[0] and x < drive.high[0] and y > drive.low[1] and y < drive.high[1]
        return int(i < drive.rollers and not inside)

    @wp.func
    def acceleration(shared: kinds.Shared, force: vec2, previous: vec2):
        """Acceleration of the roller [m/s^2], eq. (1), from its forces without those of the link before."""
        chain = shared.chain[0]
        return vec2(
            chain.inverse_mass * (force[0] - previous[0]) + chain.gravity[0],
            chain.inverse_mass * (force[1] - previous[1]) + chain.gravity[1],
        )

    @wp.kernel(enable_backward=False, module="unique", grid_stride=False, launch_bounds=(threads, blocks))
    def advance_block(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        frames: wp.array(dtype=Real),
        order: wp.array(dtype=wp.int32),
        block: int,
    ):
        """Variants `order[b]`, one a block of threads: `block` steps on, sums and frames written on the way."""
        variant = order[wp.tid() // wp.static(threads)]
        i = wp.tid() % wp.static(threads)
        n = ensemble.drives[variant].rollers
        live = i < n
        shared = shared_arrays(state, ensemble.drives[variant].first_roller, n)
        s = sprocket_of(i)
        own = fetch(ensemble, state, variant, i)
        length = ensemble.lengths[ensemble.drives[variant].first_roller + wp.min(i, n - 1)]
        mesh = engaged(ensemble, state, variant, i)
        now = Now()
        now.step = state.progress[variant].step
        now.event = now.step
        now.category = wp.static(sprockets)
        now.diverged = state.progress[variant].diverged
        if s >= 0:
            start_sprocket(ensemble, state, sums, shared, variant, s, now.step)
        if live:
            shared.recent[i] = look.fresh()
        h = Real(ensemble.drives[variant].step)
        now.going = 1
        end = wp.min(now.step + block, ensemble.drives[variant].steps + 1)
        while now.step < end and now.diverged == 0:
            if now.step == now.event:
                drive = ensemble.drives[variant]
                now.flags = flags_of(drive, now.step)
                now.event = next_event(drive, now.step)
                if now.step >= drive.window_start and now.step <= drive.window_end:
                    now.measured = 1
                    now.weight = h
                    if now.flags & ENDS != 0:
                        now.weight = Real(0.5) * h
                    if now.step % STRAND_LOOK_EVERY == 0 or now.flags & START != 0:
                        if live:
                            look.flush(ensemble, tallies, variant, shared.recent[i], now.category, i)
                            publish(ensemble, state, variant, own, i)
                            shared.recent[i] = look.fresh()
                        barrier()
                        if s >= 0:
                            look.look(ensemble, state, shared, variant, s)
                        barrier()
                    category, middle = look.category_of(ensemble, shared, variant, i)
                    now.category = category
                    now.middle = middle
                if now.flags & (FRAME | ENDS) != 0 and live:
                    shared.extra[i] = kinds.Extra()
                if now.flags & CHECK != 0:
                    gone = outside(ensemble, variant, own, i)
                    if wp.static(moving):
                        if s >= 0:
                            gone = wp.max(gone, center_outside(ensemble, shared, variant, s))
                    now.diverged = any_thread(gone)
                    if s >= 0:
                        set_heading(shared, s)
                if now.flags & LAST != 0 or now.diverged != 0:
                    now.going = 0
            other = state_of_next(own, i, n)
            tension, rate, link = link_of(shared, own, other, length)
            if now.measured != 0 and live:
                shared.recent[i] = look.with_link(shared.recent[i], tension, rate, now.weight)
                if now.middle != 0:
                    look.add_middle(shared, own, other, now.middle)
            if now.flags != 0 and live:
                if now.flags & FRAME != 0:
                    at = frame_at(ensemble, state, variant, now.step)
                    look.write_link(frames, at + i, n, own, tension)
                if now.flags & ENDS != 0:
                    energy = look.link_energy(ensemble, variant, own, tension, rate)
                    look.add_energy(ensemble, tallies, variant, i, now.flags & START, energy)
            contact, mesh = contacts(
                ensemble, state, tallies, shared, variant, own, mesh, i, live, 0, now.measured, now.weight, now.flags
            )
            if s >= 0:
                foresee(ensemble, shared, variant, s, now.step)
            previous = force_of_previous(link, i, n)
            a = acceleration(shared, link + contact, previous)
            if now.flags != 0:
                if now.step == 0:  # leapfrog's velocities are half a step behind from here on
                    own[2] = own[2] - Real(0.5) * h * a[0]
                    own[3] = own[3] - Real(0.5) * h * a[1]
                if now.flags & (FRAME | ENDS) != 0 and live:
                    v = vec2(own[2] + Real(0.5) * h * a[0], own[3] + Real(0.5) * h * a[1])
                    if now.flags & FRAME != 0:
                        at = frame_at(ensemble, state, variant, now.step)
                        look.write_rest(frames, at + i, n, v, shared.extra[i])
                    if now.flags & ENDS != 0:
                        energy = look.motion_energy(ensemble, variant, v) + wp.float64(shared.extra[i].energy)
                        look.add_energy(ensemble, tallies, variant, i, now.flags & START, energy)
            if s >= 0:
                going = now.going != 0
                step_time = ensemble.drives[variant].step
                active = int(0)
                if wp.static(moving):
                    active = shared.mounts[s].active
                target = shared.wheels[s].target
                half_behind = shared.wheels[s].speed
                body = SprocketState()
                on = Totals()
                if active != 0:
                    if wp.static(moving):
                        body, on = turn_and_move(ensemble, shared, s, step_time, now.step, going)
                else:
                    body, on = turn(shared, s, step_time, now.step, going)
                if now.measured != 0:
                    time = wp.float64(now.step) * step_time
                    weight = wp.float64(now.weight)
                    look.observe_sprocket(
                        ensemble,
                        tallies,
                        shared,
                        variant,
                        s,
                        i,
                        time,
                        body,
                        on,
                        target,
                        half_behind,
                        weight,
                        now.flags,
                    )
                if now.flags & FRAME != 0:
                    at = frame_at(ensemble, state, variant, now.step)
                    look.write_sprocket(frames, at + 7 * n + 5 * s, body, on.moment)
            if now.going != 0:
                own[2] = own[2] + h * a[0]
                own[3] = own[3] + h * a[1]
                moved = move(own, h * own[2], h * own[3])
                for k in range(wp.static(6)):
                    own[k] = moved[k]
            if now.flags & END != 0:
                now.measured = 0
            now.flags = 0
            if now.diverged == 0:
                now.step = now.step + 1
        if live:
            look.flush(ensemble, tallies, variant, shared.recent[i], now.category, i)
            put_back(ensemble, state, variant, own, i)
            store_mesh(state, tallies, shared, ensemble.drives[variant], mesh, i)
        if s >= 0:
            end_sprocket(ensemble, state, sums, shared, variant, s)
        barrier()  # `frame_at` reads where the launch began
        if i == 0:
            progress = state.progress[variant]
            progress.step = now.step
            progress.diverged = now.diverged
            state.progress[variant] = progress

    return advance_block
