"""The block kernel: one block of threads a variant, the whole time loop inside.

Thread i has the rollers i, i + threads, ...: one each where variants are few, all of the chain on one warp where they
are many, which then never waits for another. Rollers lie in shared rows. A few threads also move a sprocket each.
Whatever does not happen every step waits for the next event. One kernel is made for each precision, number of threads,
of rollers a thread, and of sprockets and guide-bars.
"""

from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..rows import accessors
from ..structs import SprocketState, types, vec2d
from ..sum_structs import Sums, Tallies
from ..sums import STRAND_LOOK_EVERY, add_energy
from .block_events import CHECK, END, ENDS, FRAME, LAST, START, block_events, flags_of, next_event
from .block_forces import block_forces
from .block_observe import block_observing
from .block_rk4 import block_rk4
from .block_rows import block_rows
from .block_sprockets import block_sprockets
from .exchange import any_thread


@cache
def block_kernel(
    Real: type,
    threads: int,
    per: int,
    sprockets: int,
    guides: int,
    blocks: int,
    moving: bool = False,
    measuring: bool = True,
    rk4: bool = False,
    *,
    frame: Any,
) -> wp.Kernel:
    """The kernel for drives of up to `threads * per` rollers and of these numbers of sprockets and guide-bars.

    Launch it with `dim` = variants * threads and `block_dim` = threads. `blocks` is how many blocks the compiler is to
    make room for on a multiprocessor; it bounds the registers of a thread. `moving` is for drives whose
    sprockets' centers may move or that have balance wheels. Without `measuring` the kernel takes no metrics. `rk4` is
    for the classical Runge-Kutta scheme instead of leapfrog. Frames lie as `frame` says (`frames.frame_writers`).
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    of_each = wp.types.vector(per, Real)
    whole_numbers = wp.types.vector(per, wp.int32)
    row = block_rows(Real, threads, per, sprockets, guides, moving, measuring)
    part = block_forces(Real, threads, per, sprockets, guides, moving, measuring)
    frame_at, write = block_events(Real, sprockets, frame).frame_at, frame_writers(Real, frame)
    look = block_observing(Real, threads, per, sprockets, guides, moving, measuring)
    wheels = block_sprockets(Real, threads, per, sprockets, guides, moving, measuring)
    barrier, shared_arrays, view = row.talk.barrier, row.talk.shared_arrays, row.talk.view
    link_of, before, acceleration, velocity = row.link_of, row.before, row.acceleration, row.velocity
    force_on, set_force = row.force_on, row.set_force
    near, leave, contacts, contacts_on = part.near, part.leave, part.contacts, part.contacts_on
    set_velocity, move, fetch, put_back, place = row.set_velocity, row.move, row.fetch, row.put_back, row.place
    SPROCKETS = part.SPROCKETS
    sprocket_of, load, X, Y = part.sprocket_of, accessors(Real).load, row.X, row.Y
    center_outside, set_heading = wheels.center_outside, wheels.set_heading
    start_sprocket, end_sprocket, foresee = wheels.start_sprocket, wheels.end_sprocket, wheels.foresee
    plan, turn, turn_and_move = wheels.plan, wheels.turn, wheels.turn_and_move

    staged = block_rk4(Real, threads, per, sprockets, guides, moving, measuring)
    stage_roller, standing, stage_sprocket = staged.stage_roller, staged.standing, staged.stage_sprocket

    @wp.struct
    class Now:
        """Where the time loop is; all threads of a block agree."""

        step: wp.int32
        stage: wp.int32  # of the step, 0 to 3 with rk4
        event: wp.int32  # the next step at which more happens than forces and motion
        flags: wp.int32  # what happens now, as bits
        measured: wp.int32  # 1 in the window
        weight: Real  # time that this step stands for in the window's sums [s]
        samples: wp.int32  # tensions of each link that have not gone to its tally yet
        diverged: wp.int32
        going: wp.int32  # 0 at the run's last step and where it diverged

    @wp.func
    def outside(ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, j: int):
        """1 where roller j is not finite or has left the drive's box."""
        drive = ensemble.drives[variant]
        p = place(shared.rows, j, vec2d(wp.float64(0.0), wp.float64(0.0)))
        inside = p[0] > drive.low[0] and p[0] < drive.high[0] and p[1] > drive.low[1] and p[1] < drive.high[1]
        return int(j < drive.rollers and not inside)

    @wp.func
    def position(shared: kinds.Shared, j: int):
        """Position of roller j [m]."""
        return vec2(load(shared.rows, X + j), load(shared.rows, Y + j))

    @wp.func
    def partners_of(shared: kinds.Shared, j: int, n: int, held: int, stage: int):
        """The partners that roller j may touch, as bits; guide-bars are let go of at a step's start only."""
        partners = near(shared, j, n)
        if wp.static(rk4):
            if stage != 0:
                partners = partners | (held & ~SPROCKETS)
        return partners

    @wp.func
    def heeded_always(shared: kinds.Shared):
        """The sprockets whose moment moves them, as bits."""
        mask = int(0)
        for s in range(wp.static(sprockets)):
            if wp.static(moving):
                mask = mask | (1 << s)
            elif shared.motions[s].prescribed == 0:
                mask = mask | (1 << s)
        return mask

    @wp.kernel(enable_backward=False, module="unique", grid_stride=False, launch_bounds=(threads, blocks))
    def advance_block(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        frames: wp.array(dtype=Real),
        order: wp.array(dtype=wp.int32),
        block: int,
        since: int,
    ):
        """Variants `order[b]`, one a block of threads: `block` steps on, sums and frames written on the way.

        The frames' buffer was begun `since` steps before this launch.
        """
        number = wp.tid() // wp.static(threads)
        variant = order[number]
        i = wp.tid() % wp.static(threads)
        n = ensemble.drives[variant].rollers
        first = ensemble.drives[variant].first_roller
        memory = ensemble.drives[variant].first_contact
        shared = shared_arrays(state, number)
        lengths = view(ensemble.lengths, first, n)
        s = sprocket_of(i)
        fetch(ensemble, state, shared, variant, i)
        now = Now()
        now.step = state.progress[variant].step
        now.event = now.step
        now.diverged = state.progress[variant].diverged
        if s >= 0:
            start_sprocket(ensemble, state, sums, shared, variant, s, now.step)
        barrier()
        chain_heeds = heeded_always(shared)
        step_time = ensemble.drives[variant].step
        h = Real(step_time)
        now.going = 1
        end = wp.min(now.step + block, ensemble.drives[variant].steps + 1)
        held = whole_numbers()
        for k in range(wp.static(per)):
            held[k] = shared.held[k * wp.static(threads) + i]
        plan(ensemble, shared, variant, i, now.step)
        while now.step < end and now.diverged == 0:
            if now.step == now.event and now.stage == 0:
                drive = ensemble.drives[variant]
                now.flags = flags_of(drive, now.step)
                now.event = next_event(drive, now.step)
                if wp.static(measuring) and now.step >= drive.window_start and now.step <= drive.window_end:
                    now.measured = 1
                    now.weight = h
                    if now.flags & ENDS != 0:
                        now.weight = Real(0.5) * h
                    if now.step % STRAND_LOOK_EVERY == 0 or now.flags & START != 0:
                        if now.samples > 0:
                            j = int(i)
                            while j < n:
                                look.flush(ensemble, tallies, shared, variant, j, n, now.samples)
                                j = j + wp.static(threads)
                            now.samples = 0
                        barrier()
                        if s >= 0:
                            look.look(shared, n, s)
                    if now.samples == 0:
                        j = int(i)
                        while j < n:
                            look.begin_seeing(shared, j)
                            j = j + wp.static(threads)
                if now.flags & CHECK != 0:
                    gone = int(0)
                    j = int(i)
                    while j < n:
                        gone = wp.max(gone, outside(ensemble, shared, variant, j))
                        j = j + wp.static(threads)
                    if wp.static(moving):
                        if s >= 0:
                            gone = wp.max(gone, center_outside(ensemble, shared, variant, s))
                    now.diverged = any_thread(gone)
                    if s >= 0:
                        set_heading(shared, s)
                    plan(ensemble, shared, variant, i, now.step)
                    barrier()
                if now.flags & LAST != 0 or now.diverged != 0:
                    now.going = 0
            measured = int(0)
            if wp.static(measuring) and now.stage == 0:
                measured = now.measured
            heeded = chain_heeds
            if measured != 0 or now.flags != 0:
                heeded = SPROCKETS
            # links: a thread's together, so that one's latency hides behind the others' work
            tension = of_each()
            rate = of_each()
            pull_x = of_each()
            pull_y = of_each()
            for k in range(wp.static(per)):
                j = k * wp.static(threads) + i
                tension_k, rate_k, force = link_of(shared, j, n, load(lengths, j))
                set_force(shared, j, force)
                tension[k] = tension_k
                rate[k] = rate_k
                pull_x[k] = force[0]
                pull_y[k] = force[1]
            barrier()
            for k in range(wp.static(per)):
                force = force_on(shared, before(k * wp.static(threads) + i, n))
                pull_x[k] = pull_x[k] - force[0]
                pull_y[k] = pull_y[k] - force[1]
            barrier()
            for k in range(wp.static(per)):
                set_force(shared, k * wp.static(threads) + i, vec2(pull_x[k], pull_y[k]))
            if wp.static(measuring) and measured != 0:
                for k in range(wp.static(per)):
                    look.see(shared, k * wp.static(threads) + i, tension[k], rate[k], now.weight)
                now.samples = now.samples + 1
                if s >= 0:
                    look.add_middle(shared, n, s)
            if now.flags & (FRAME | ENDS) != 0:
                j = int(i)
                while j < n:
                    tension_j, rate_j, force = link_of(shared, j, n, load(lengths, j))
                    extra = kinds.Extra()
                    extra.tension = tension_j
                    extra.rate = rate_j
                    state.extra[first + j] = extra
                    j = j + wp.static(threads)
            # contacts: first who is near what, then each thread one of its rollers after the other
            next_held = whole_numbers()
            by_teeth = int(0)
            by_bar = int(0)
            changed = int(0)
            for k in range(wp.static(per)):
                partners = partners_of(shared, k * wp.static(threads) + i, n, held[k], now.stage)
                by_teeth = by_teeth | wp.where(partners & SPROCKETS != 0, (1 << k), 0)
                by_bar = by_bar | wp.where(partners & ~SPROCKETS != 0, (1 << k), 0)
                changed = changed | (partners ^ held[k])
                next_held[k] = partners
            if changed != 0:
                j = int(i)
                while j < n:
                    partners = partners_of(shared, j, n, shared.held[j], now.stage)
                    leave(state, memory + j, n, shared.held[j] & ~partners)
                    shared.held[j] = partners
                    j = j + wp.static(threads)
                for k in range(wp.static(per)):
                    held[k] = next_held[k]
            wanted = now.flags & (FRAME | ENDS)
            contacts(
                ensemble,
                state,
                tallies,
                shared,
                first,
                memory,
                n,
                i,
                by_teeth,
                by_bar,
                heeded,
                now.stage,
                measured,
                now.weight,
                wanted,
            )
            if s >= 0 and now.stage == 0:
                foresee(ensemble, shared, s, wp.float64(now.step) * step_time)
            barrier()
            if now.flags != 0:
                j = int(i)
                while j < n:
                    a = acceleration(shared, j)
                    v = velocity(shared.rows, j)
                    if wp.static(not rk4):
                        if now.step == 0:  # leapfrog's velocities are half a step behind from here on
                            v = v - Real(0.5) * h * a
                            set_velocity(shared, j, v)
                        v = v + Real(0.5) * h * a
                    if wanted != 0:
                        extra = state.extra[first + j]
                        if now.flags & FRAME != 0:
                            at = frame_at(ensemble, state, variant, since, now.step)
                            write.write_roller(frames, at, n, j, position(shared, j), v, extra)
                        if wp.static(measuring) and now.flags & ENDS != 0:
                            energy = look.roller_energy(ensemble, shared, variant, j, v, extra)
                            tally = tallies.roller[first + j]
                            tallies.roller[first + j] = add_energy(tally, now.flags & START != 0, energy)
                    j = j + wp.static(threads)
            # sprockets, while the other threads move their rollers
            on = contacts_on(shared, i)
            if s >= 0:
                going = now.going != 0
                active = int(0)
                if wp.static(moving):
                    active = shared.mounts[s].active
                loaded = shared.wheels[s].load
                half_behind = shared.wheels[s].speed
                body = SprocketState()
                if wp.static(rk4):
                    body = standing(shared, s)
                    if going:
                        start = wp.float64(now.step) * step_time
                        stage_sprocket(ensemble, state, shared, variant, s, on, start, now.stage, step_time)
                elif active != 0:
                    if wp.static(moving):
                        body = turn_and_move(ensemble, shared, s, on, step_time, now.step, going)
                else:
                    body = turn(shared, s, on, step_time, now.step, going)
                if wp.static(measuring) and measured != 0:
                    time = wp.float64(now.step) * step_time
                    weight = wp.float64(now.weight)
                    look.observe_sprocket(
                        ensemble,
                        tallies,
                        shared,
                        variant,
                        s,
                        time,
                        body,
                        on,
                        loaded,
                        half_behind,
                        weight,
                        now.flags,
                    )
                if now.flags & FRAME != 0:
                    at = frame_at(ensemble, state, variant, since, now.step)
                    write.write_sprocket(frames, at, n, s, body, on.moment)
            if wp.static(rk4):
                j = int(i)
                while j < n and now.going != 0:
                    stage_roller(state, shared, first, n, j, now.stage, step_time)
                    j = j + wp.static(threads)
            elif now.going != 0:
                for k in range(wp.static(per)):
                    j = k * wp.static(threads) + i
                    v = velocity(shared.rows, j) + h * acceleration(shared, j)
                    set_velocity(shared, j, v)
                    move(shared, j, h * v[0], h * v[1])
            if now.flags & END != 0:
                now.measured = 0
            now.flags = 0
            if wp.static(rk4):
                now.stage = now.stage + 1
            if (not wp.static(rk4) or now.stage == 4 or now.going == 0) and now.diverged == 0:
                now.stage = 0
                now.step = now.step + 1
            barrier()
        if wp.static(measuring) and now.samples > 0:
            j = int(i)
            while j < n:
                look.flush(ensemble, tallies, shared, variant, j, n, now.samples)
                j = j + wp.static(threads)
            now.samples = 0
        put_back(ensemble, state, shared, variant, i)
        if s >= 0:
            end_sprocket(ensemble, state, sums, shared, variant, s)
        if i == 0:
            progress = state.progress[variant]
            progress.step = now.step
            progress.diverged = now.diverged
            state.progress[variant] = progress

    return advance_block
