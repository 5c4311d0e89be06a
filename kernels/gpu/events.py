"""Work of the block kernels' time loop at some steps only, and when it is due."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..physics.body import is_in_box
from ..structs import DIVERGENCE_CHECK, Drive, Tallies
from ..sums import MERGE_EVERY, add_energy, gathered_powers, is_look
from .bodies import body_access, prescribed_motion
from .kind import CHECK, END, ENDS, EVENT, EXTRA, FRAME, LAST, START, BlockKind, Mine, inlined
from .links import block_joints, link_forces
from .observe import block_observing, block_strands
from .rings import block_rings
from .rollers import roller_rows
from .statistics import block_statistics
from .sync import sync


@wp.func
def next_event(drive: Drive, step: int):
    """The next step after `step` at which more happens than forces and motion."""
    event = (step // DIVERGENCE_CHECK + 1) * DIVERGENCE_CHECK
    if step < drive.window_end:
        event = wp.min(event, (step // MERGE_EVERY + 1) * MERGE_EVERY)
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
    """The events of `step`, as bits."""
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


@cache
def block_sampling(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The functions that observe one variant on a block, when it is time to; `frame` as in `frames.frame_writers`."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets = kind.parts.sprockets
    measuring, staged = kind.measuring, kind.staged
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Out = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Out
    of_each, vec2 = wp.types.vector(rollers_per_thread, Real), kinds.vec2
    row, observe = roller_rows(kind), block_observing(kind)
    statistics, joint_power = block_statistics(kind), block_joints(kind).joint_power
    write = frame_writers(Real, frame)
    position = row.position
    barrier, any_thread = sync(kind).barrier, sync(kind).any_thread
    link_of, length_of = link_forces(kind).link_of, link_forces(kind).length_of
    acceleration, velocity, set_velocity = row.acceleration, row.velocity, row.set_velocity
    step_of, find_strands = row.step_of, block_strands(kind).find_strands
    rings = block_rings(kind)
    ring_of, row_of, span_of, own_span = rings.ring_of, rings.row_of, rings.span_of, rings.own_span
    tensioners_of = rings.tensioners_of
    body_gone, align, plan = body_access(kind).body_gone, body_access(kind).align, prescribed_motion(kind).plan

    @wp.func
    def frame_at(drive: Drive, now: Now):
        """Where this step's frame begins in the buffer."""
        every = drive.sample_every
        number = now.step // every - (now.begun + every - 1) // every
        return int(drive.first_value) + number * write.width_of(drive)

    @wp.func
    def look_at_chain(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """Notes what is due, brings the strands up to date, and adds what is looked at now and then to the sums."""
        if now.flags & START == 0:
            statistics.note(ensemble, out, shared, mine, now.step)
        if mine.sprocket >= 0:
            begin, count = own_span(shared, mine)
            at = ensemble.drives[mine.variant].first_sprocket + mine.sprocket
            observe.update_strand(state, shared, begin, count, at, now.flags & START != 0)
        barrier()
        find_strands(ensemble, state, shared, mine)
        statistics.look(ensemble, state, out, shared, mine)

    @wp.func
    def merge(tallies: Tallies, shared: Shared, mine: Mine):
        """Adds to the sums what the thread's links and its sprocket have gathered since it was done last."""
        if mine.sprocket >= 0:
            shared.sprocket_sums[mine.sprocket] = gathered_powers(shared.sprocket_sums[mine.sprocket])
        observe.flush(tallies, shared, mine)

    @wp.func
    def gone_from(shared: Shared, mine: Mine):
        """1 where a roller of the thread, or its body, is not finite or has left the drive's box."""
        gone = int(0)
        j = int(mine.thread)
        while j < mine.rollers:
            box = 2 * ring_of(shared, j)
            gone = wp.max(gone, int(not is_in_box(shared.box[box], shared.box[box + 1], position(shared.rows, j))))
            j = j + wp.static(threads)
        if mine.body >= 0:
            gone = wp.max(gone, body_gone(shared, mine))
        return gone

    @inlined
    def on_event(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """Does what is due at this step beside forces and motion; all threads together."""
        drive = ensemble.drives[mine.variant]
        now.flags = flags_of(drive, now.step)
        now.event = next_event(drive, now.step)
        if wp.static(measuring) and now.step >= drive.window_start and now.step <= drive.window_end:
            now.window = 1
            if now.step % MERGE_EVERY == 0:
                merge(out.tallies, shared, mine)
            if is_look(drive, now.step):
                look_at_chain(ensemble, state, out, shared, mine, now)
        if now.flags & CHECK != 0:
            now.diverged = any_thread(gone_from(shared, mine))
            if mine.body >= 0:
                align(shared, mine.body)
            plan(ensemble, shared, mine, now.step)
            barrier()
        if now.flags & LAST != 0 or now.diverged != 0:
            now.going = 0
        return now

    @wp.func
    def sample_links(
        state: State, shared: Shared, mine: Mine, now: Now, lengths: wp.array[Real], tension: of_each, rate: of_each
    ):
        """Adds what metrics want of the thread's links in this step; keeps what frames or ends want of them."""
        n = mine.rollers
        if wp.static(measuring) and now.measured != 0:
            observe.add_rates(shared, mine.thread, rate, now.weight)
            observe.hold_extremes(shared, mine.thread, tension)
        if now.flags & EXTRA != 0:
            j = int(mine.thread)
            while j < n:
                tension_j, rate_j, force = link_of(shared, j, n, length_of(shared, lengths, j))
                extra = kinds.Extra()
                extra.tension = tension_j
                extra.rate = rate_j
                state.extra[mine.first + j] = extra
                j = j + wp.static(threads)

    @wp.func
    def sample_joints(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now):
        """Keeps what friction takes from the thread's joints, for a frame; all threads together."""
        lag = Real(0.0)
        if wp.static(not staged):
            lag = wp.where(now.step == 0, Real(0.0), Real(0.5) * step_of(mine))
        j = int(mine.thread)
        while j < mine.rollers:
            state.extra[mine.first + j].friction_power = joint_power(ensemble, state, shared, mine, j, lag)
            j = j + wp.static(threads)
        barrier()  # neighbors' velocities are set at once

    @wp.func
    def sample_rollers(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """Writes the thread's rollers to the frame, and their energy to the tallies, where that is due."""
        if wp.static(kind.friction.joints and frame.holds("joint_friction_power")):
            if now.flags & FRAME != 0:
                sample_joints(ensemble, state, shared, mine, now)
        j = int(mine.thread)
        while j < mine.rollers:
            a = acceleration(shared, j)
            v = velocity(shared.rows, j)
            if wp.static(not staged):
                if now.step == 0:  # leapfrog's velocities are half a step behind from here on
                    v = v - Real(0.5) * step_of(mine) * a
                    set_velocity(shared, j, v)
                v = v + Real(0.5) * step_of(mine) * a
            if now.flags & EXTRA != 0:
                extra = state.extra[mine.first + j]
                if now.flags & FRAME != 0:
                    at = frame_at(ensemble.drives[row_of(shared, mine, j)], now)
                    first, n = span_of(shared, j, mine.rollers)
                    write.write_roller(out.frames, at, n, j - first, position(shared.rows, j), v, extra)
                if wp.static(measuring) and now.flags & ENDS != 0:
                    energy = observe.energy_of_roller(shared, j, mine.rollers, v, extra)
                    tally = out.tallies.roller[mine.first + j]
                    out.tallies.roller[mine.first + j] = add_energy(tally, now.flags & START != 0, energy)
            j = j + wp.static(threads)

    @wp.func
    def write_body(
        ensemble: Ensemble,
        state: State,
        frames: wp.array[Real],
        mine: Mine,
        now: Now,
        body: kinds.Instant,
        moment: Real,
        force: vec2,
    ):
        """Writes the thread's body and its tensioners to the frame, where due; moment [N m] and force [N] are the
        chain's.
        """
        if now.flags & FRAME != 0:
            drive = ensemble.drives[mine.row]
            at = frame_at(drive, now)
            if mine.sprocket >= 0:
                write.write_sprocket(frames, at, drive.rollers, mine.number, body, moment, force)
            if wp.static(kind.parts.arms > 0):
                if mine.arm >= 0:
                    write.write_arm(frames, at, drive, mine.number - (drive.bodies - drive.arms), body, moment)
            for t in range(tensioners_of(drive)):
                if ensemble.tensioners[drive.first_tensioner + t].body == mine.number:
                    write.write_tensioner(frames, at, drive, t, state.pushes[drive.first_tensioner + t])
            if wp.static(kind.parts.tied > 0):
                if mine.body >= wp.static(sprockets) and mine.body < wp.static(kind.parts.mounted):
                    write.write_shaft(frames, at, drive, mine.number - drive.sprockets, body)

    @wp.func
    def write_coupling(
        ensemble: Ensemble,
        frames: wp.array[Real],
        mine: Mine,
        now: Now,
        c: int,
        twist: Real,
        moment: Real,
    ):
        """Writes coupling c of all to the frame."""
        drive = ensemble.drives[mine.row]
        at = frame_at(drive, now)
        write.write_coupling(frames, at, drive, c - drive.first_coupling, twist, moment)

    return SimpleNamespace(**locals())
