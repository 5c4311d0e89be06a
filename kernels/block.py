"""The block kernel: one block of threads a variant, one roller a thread, the whole time loop inside (leapfrog).

A roller's state stays in registers; its seats and its contacts' memories are touched only while it is engaged. Thread s
also moves sprocket s. One kernel is made for each precision, number of threads, and capacity for sprockets.
"""

from functools import cache

import warp as wp

from .block_forces import block_forces
from .block_observe import block_observing
from .board import (
    ANGLE,
    CENTER_X,
    CENTER_Y,
    COSINE,
    EXACT_SPEED,
    FAR,
    NEAR,
    NEXT_SPEED,
    SINE,
    SLATE_STRIDE,
    SLATE_X,
    SLATE_Y,
    SPEED,
    STRIDE,
    TARGET,
)
from .body import load_at, prescribed_at
from .exchange import again, any_thread, barrier
from .rollers import STATE_ROWS
from .serial import DIVERGENCE_CHECK
from .structs import Sums, Tallies, types, vec2d
from .sums import STRAND_LOOK_EVERY
from .trigonometry import sine_cosine

HEADING_EVERY = wp.constant(1024)
"""Steps between two computations of a sprocket's cosine and sine from its angle; in between they are turned."""


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
def block_kernel(Real: type, threads: int, sprockets: int = 4, blocks: int = 4) -> wp.Kernel:
    """The kernel for drives of up to `threads` rollers and `sprockets` sprockets.

    Launch it with `dim` = variants * threads and `block_dim` = threads. `blocks` is how many blocks the compiler is to
    make room for on a multiprocessor; it bounds the registers of a thread.
    """
    kinds = types(Real)
    vec2 = kinds.vec2
    part = block_forces(Real, threads, sprockets)
    look = block_observing(Real, threads, sprockets)
    State = part.State
    get, put, slate_put = part.get, part.put, part.slate_put
    state_of_next, force_of_previous, evaluate = part.state_of_next, part.force_of_previous, part.evaluate
    moment_on, move = part.moment_on, part.move

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
    def publish(ensemble: kinds.Ensemble, state: kinds.State, variant: int, own: State, i: int):
        """Position of roller i into its rows, for other threads to read."""
        drive = ensemble.drives[variant]
        row = STATE_ROWS * drive.first_roller + i
        state.rollers[row] = own[0]
        state.rollers[row + drive.rollers] = own[1]

    @wp.func
    def engaged(ensemble: kinds.Ensemble, state: kinds.State, variant: int, i: int):
        """Sprockets that roller i is engaged with, as bits."""
        drive = ensemble.drives[variant]
        held = int(0)
        if i < drive.rollers:
            for s in range(drive.sprockets):
                if state.seat[drive.first_contact + s * drive.rollers + i] >= 0:
                    held = held | (1 << s)
        return held

    @wp.func
    def window(ensemble: kinds.Ensemble, variant: int, step: int):
        """1 where the step is measured; and 1 at the window's start, 2 at its end."""
        drive = ensemble.drives[variant]
        measuring = int(0)
        ends = int(0)
        if step >= drive.window_start and step <= drive.window_end:
            measuring = int(1)
            if step == drive.window_start:
                ends = int(1)
            if step == drive.window_end:
                ends = int(2)
        return measuring, ends

    @wp.func
    def is_sampled(ensemble: kinds.Ensemble, variant: int, step: int):
        """1 where the step is a frame."""
        every = ensemble.drives[variant].sample_every
        if every > 0:
            return int(step % every == 0)
        return int(0)

    @wp.func
    def outside(ensemble: kinds.Ensemble, variant: int, own: State, i: int):
        """1 where roller i is not finite or has left the drive's box."""
        drive = ensemble.drives[variant]
        x = wp.float64(own[0])
        y = wp.float64(own[1])
        inside = x > drive.low[0] and x < drive.high[0] and y > drive.low[1] and y < drive.high[1]
        return int(i < drive.rollers and not inside)

    @wp.func
    def acceleration(ensemble: kinds.Ensemble, variant: int, force: part.Forces, previous: vec2):
        """Acceleration of the roller [m/s^2], eq. (1)."""
        chain = ensemble.chains[variant]
        total = force.link + force.contact - previous
        return vec2(chain.inverse_mass * total[0] + chain.gravity[0], chain.inverse_mass * total[1] + chain.gravity[1])

    @wp.func
    def start_sprocket(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, variant: int, s: int, step: int):
        """Sprocket s and its sums, onto board and slate."""
        drive = ensemble.drives[variant]
        mine = drive.first_sprocket + s
        body = state.sprockets[mine]
        at = s * STRIDE
        sine, cosine = sine_cosine(body.angle)
        put(at + COSINE, cosine)
        put(at + SINE, sine)
        put(at + SPEED, body.speed)
        put(at + ANGLE, body.angle)
        put(at + CENTER_X, body.center[0])
        put(at + CENTER_Y, body.center[1])
        slate_put(s * SLATE_STRIDE + SLATE_X, Real(body.center[0]))
        slate_put(s * SLATE_STRIDE + SLATE_Y, Real(body.center[1]))
        slate_put(s * SLATE_STRIDE + NEAR, ensemble.sprockets[mine].near_square)
        slate_put(s * SLATE_STRIDE + FAR, ensemble.sprockets[mine].far_square)
        angle, exact = prescribed_at(wp.float64(step) * drive.step, ensemble.motions[mine], ensemble.harmonics)
        put(at + EXACT_SPEED, exact)
        look.load_sums(sums, drive, s)

    @wp.func
    def end_sprocket(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, variant: int, s: int):
        """Sprocket s and its sums, back from the board."""
        drive = ensemble.drives[variant]
        body = state.sprockets[drive.first_sprocket + s]
        body.angle = get(s * STRIDE + ANGLE)
        body.speed = get(s * STRIDE + SPEED)
        state.sprockets[drive.first_sprocket + s] = body
        look.store_sums(sums, drive, s)

    @wp.func
    def foresee(ensemble: kinds.Ensemble, variant: int, s: int, step: int):
        """What sprocket s needs at the step's end and the rollers do not decide: its prescribed angle, or its load."""
        drive = ensemble.drives[variant]
        motion = ensemble.motions[drive.first_sprocket + s]
        time = wp.float64(step) * drive.step
        at = s * STRIDE
        if motion.prescribed == 1:
            target, exact = prescribed_at(time + drive.step, motion, ensemble.harmonics)
            put(at + TARGET, target)
            put(at + NEXT_SPEED, exact)
        else:
            put(at + TARGET, load_at(time, get(at + ANGLE), get(at + SPEED), motion, ensemble.harmonics))

    @wp.func
    def turn(ensemble: kinds.Ensemble, variant: int, s: int, step: int, kick: wp.float64, back: wp.float64, going: int):
        """Takes sprocket s one step on if `going`; returns its angle, angular velocity and contact moment before."""
        drive = ensemble.drives[variant]
        mine = drive.first_sprocket + s
        at = s * STRIDE
        moment = moment_on(s, drive.rollers)
        angle = get(at + ANGLE)
        speed = get(at + SPEED)
        now = get(at + EXACT_SPEED)
        turned = get(at + TARGET) - angle
        if ensemble.motions[mine].prescribed == 1:
            put(at + EXACT_SPEED, get(at + NEXT_SPEED))
            speed = turned / drive.step
        else:
            slope = (moment + get(at + TARGET)) * ensemble.motions[mine].inverse_inertia
            now = speed + back * slope
            speed = speed + kick * slope
            turned = drive.step * speed
        if going != 0:
            put(at + SPEED, speed)
            put(at + ANGLE, angle + turned)
            if (step + 1) % HEADING_EVERY == 0:
                sine, cosine = sine_cosine(angle + turned)
                put(at + COSINE, cosine)
                put(at + SINE, sine)
            else:
                heading = rotated(vec2d(get(at + COSINE), get(at + SINE)), turned)
                put(at + COSINE, heading[0])
                put(at + SINE, heading[1])
        return angle, now, moment

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
        own = fetch(ensemble, state, variant, i)
        held = engaged(ensemble, state, variant, i)
        step = state.progress[variant].step
        if i < ensemble.drives[variant].sprockets:
            start_sprocket(ensemble, state, sums, variant, i, step)
        h = Real(ensemble.drives[variant].step)
        steps = ensemble.drives[variant].steps
        end = wp.min(step + block, steps + 1)
        begin = step
        frame = int(ensemble.drives[variant].first_value)
        recent = look.fresh()
        category = ensemble.drives[variant].sprockets
        middle = int(0)
        diverged = state.progress[variant].diverged
        while step < end and diverged == 0:
            variant = again(variant)
            measuring, ends = window(ensemble, variant, step)
            share = Real(0.0)
            if measuring != 0:
                share = Real(1.0)
                if ends != 0:
                    share = Real(0.5)
                due = step % STRAND_LOOK_EVERY == 0 or step == ensemble.drives[variant].window_start
                if due:
                    if live:
                        look.flush(ensemble, tallies, variant, recent, category, i)
                        publish(ensemble, state, variant, own, i)
                        recent = look.fresh()
                    barrier()
                    look.look(ensemble, state, variant, i)
                    barrier()
                if due or step == begin:
                    category, middle = look.category_of(ensemble, state, variant, i)
            kick = h
            back = Real(0.5) * h
            if step == 0:
                kick = Real(0.5) * h
                back = Real(0.0)
            variant = again(variant)
            other = state_of_next(own, i, n)
            force, held = evaluate(ensemble, state, tallies, variant, own, other, held, i, 0, share * h)
            variant = again(variant)
            if i < ensemble.drives[variant].sprockets:
                foresee(ensemble, variant, i, step)
            if step % DIVERGENCE_CHECK == 0 or step == steps:
                diverged = any_thread(outside(ensemble, variant, own, i))
            variant = again(variant)
            previous = force_of_previous(force.link, i, n)
            a = acceleration(ensemble, variant, force, previous)
            if measuring != 0 and live:
                recent = look.add_link(recent, force, share)
                if middle != 0:
                    look.add_middle(ensemble, state, variant, own, other, middle)
            sampled = is_sampled(ensemble, variant, step)
            if (sampled != 0 or ends != 0) and live:
                v = vec2(own[2] + back * a[0], own[3] + back * a[1])
                if sampled != 0:
                    look.write_roller(frames, frame + i, n, own, force, v)
                if ends != 0:
                    look.add_energy(
                        ensemble, tallies, variant, i, ends, look.roller_energy(ensemble, variant, own, force, v)
                    )
            if i < ensemble.drives[variant].sprockets:
                angle, now, moment = turn(
                    ensemble, variant, i, step, wp.float64(kick), wp.float64(back), int(step < steps and diverged == 0)
                )
                if measuring != 0:
                    look.observe_sprocket(
                        ensemble, tallies, variant, i, step, angle, now, moment, wp.float64(share * h), ends
                    )
                if sampled != 0:
                    look.write_sprocket(frames, frame + 7 * n + 5 * i, i, angle, now, moment)
            if sampled != 0:
                frame = frame + 7 * n + 5 * ensemble.drives[variant].sprockets
            if diverged == 0:
                if step < steps:
                    own[2] = own[2] + kick * a[0]
                    own[3] = own[3] + kick * a[1]
                    own = move(own, h * own[2], h * own[3])
                step = step + 1
        if live:
            look.flush(ensemble, tallies, variant, recent, category, i)
            put_back(ensemble, state, variant, own, i)
        if i < ensemble.drives[variant].sprockets:
            end_sprocket(ensemble, state, sums, variant, i)
        if i == 0:
            progress = state.progress[variant]
            progress.step = step
            progress.diverged = diverged
            state.progress[variant] = progress

    return advance_block
