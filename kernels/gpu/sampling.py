"""What a block does at some steps only: events, and samples of links, rollers and sprockets for metrics and frames."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..number import gathered
from ..physics.body import in_box
from ..rows import accessors
from ..structs import Drive, types
from ..sum_structs import Sums, Tallies
from ..sums import MERGE_EVERY, add_energy, is_look
from .bodies import block_bodies
from .events import CHECK, ENDS, EXTRA, FRAME, LAST, START, block_events, flags_of, next_event
from .joints import block_joints
from .kind import BlockKind, Mine, now_struct
from .link_forces import link_forces
from .observe import block_observing
from .roller_rows import roller_rows
from .statistics import block_statistics
from .strands import block_strands
from .sync import sync
from .wheels import within


@dataclass(frozen=True)
class SamplingFunctions:
    """A block's sampling, as functions of kernels."""

    on_event: wp.Function
    sample_links: wp.Function
    sample_rollers: wp.Function
    write_sprocket_frame: wp.Function
    write_arm_frame: wp.Function
    write_push_frames: wp.Function


@cache
def block_sampling(kind: BlockKind, frame: Any) -> SamplingFunctions:
    """The functions that observe one variant on a block, when it is time to; `frame` as in `frames.frame_writers`."""
    Real, threads, rollers_per_thread, sprockets = kind.Real, kind.threads, kind.rollers_per_thread, kind.sprockets
    measuring, rk4 = kind.measuring, kind.rk4
    kinds, Now = types(Real), now_struct(Real)
    of_each = wp.types.vector(rollers_per_thread, Real)
    row, bodies, observe = roller_rows(kind), block_bodies(kind), block_observing(kind)
    statistics, joint_power = block_statistics(kind), block_joints(kind).joint_power
    frame_at, write = block_events(Real, sprockets, frame).frame_at, frame_writers(Real, frame)
    load_row, position = accessors(Real).load_row, row.position
    barrier, any_thread = sync(kind).barrier, sync(kind).any_thread
    link_of, length_of = link_forces(kind).link_of, link_forces(kind).length_of
    acceleration, velocity, set_velocity = row.acceleration, row.velocity, row.set_velocity
    step_of, find_strands = row.step_of, block_strands(kind).find_strands
    body_gone, set_heading, plan = bodies.body_gone, bodies.set_heading, bodies.plan

    @wp.func
    def look_at_chain(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """Notes what is due, brings the strands up to date, and adds what is looked at now and then to the sums."""
        if now.flags & START == 0:
            statistics.note(ensemble, tallies, sums, shared, mine, now.step)
        if mine.sprocket >= 0:
            first = ensemble.drives[mine.variant].first_sprocket
            observe.update_strand(state, shared, mine.rollers, first + mine.sprocket)
        barrier()
        find_strands(ensemble, state, shared, mine)
        statistics.look(ensemble, state, sums, tallies, shared, mine)

    @wp.func
    def merge(tallies: Tallies, shared: kinds.Shared, mine: Mine):
        """Adds to the sums what the thread's links and its sprocket have gathered since it was done last."""
        if wp.static(kind.paired):
            if mine.sprocket >= 0:
                shared.sprocket_sums[mine.sprocket] = gathered(shared.sprocket_sums[mine.sprocket])
        observe.flush(tallies, shared, mine)

    @wp.func
    def gone_from(drive: Drive, shared: kinds.Shared, mine: Mine):
        """1 where a roller of the thread, or its sprocket, is not finite or has left the drive's box."""
        gone = int(0)
        j = int(mine.thread)
        while j < mine.rollers:
            if wp.static(kind.paired):
                gone = wp.max(gone, int(not within(shared.box[0], position(shared.rows, j))))
            else:
                gone = wp.max(gone, int(not in_box(drive, position(shared.rows, j))))
            j = j + wp.static(threads)
        if mine.sprocket >= 0:
            gone = wp.max(gone, body_gone(drive, shared, mine.sprocket))
        if wp.static(kind.arms > 0):
            if mine.arm >= 0:
                gone = wp.max(gone, body_gone(drive, shared, wp.static(sprockets) + mine.arm))
        return gone

    @wp.func
    def on_event(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """What is due at this step beside forces and motion; all threads together."""
        drive = ensemble.drives[mine.variant]
        now.flags = flags_of(drive, now.step)
        now.event = next_event(drive, now.step)
        if wp.static(measuring) and now.step >= drive.window_start and now.step <= drive.window_end:
            now.window = 1
            if now.step % MERGE_EVERY == 0:
                merge(tallies, shared, mine)
            if is_look(drive, now.step):
                look_at_chain(ensemble, state, sums, tallies, shared, mine, now)
        if now.flags & CHECK != 0:
            now.diverged = any_thread(gone_from(drive, shared, mine))
            if mine.sprocket >= 0:
                set_heading(shared, mine.sprocket)
            if wp.static(kind.paired and kind.arms > 0):
                if mine.arm >= 0:
                    set_heading(shared, wp.static(sprockets) + mine.arm)
            plan(ensemble, shared, mine, now.step)
            barrier()
        if now.flags & LAST != 0 or now.diverged != 0:
            now.going = 0
        return now

    @wp.func
    def sample_links(
        state: kinds.State,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        lengths: wp.array[Real],
        tension: of_each,
        rate: of_each,
    ):
        """Adds what metrics want of the thread's links in this step; keeps what frames or ends want of them."""
        n = mine.rollers
        if wp.static(measuring) and now.measured != 0:
            if wp.static(not kind.carrying) or now.common == 0:
                sums = observe.with_rates(observe.rates_of(shared, mine.thread), rate, now.weight)
                observe.set_rates(shared, mine.thread, sums)
            if now.watched != 0:
                observe.watch(shared, mine.thread, tension)
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
    def sample_joints(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now):
        """Keeps what friction takes from the thread's joints, for a frame; all threads together."""
        lag = Real(0.0)
        if wp.static(not rk4):
            lag = wp.where(now.step == 0, Real(0.0), Real(0.5) * step_of(mine))
        j = int(mine.thread)
        while j < mine.rollers:
            state.extra[mine.first + j].friction_power = joint_power(ensemble, shared, mine, j, lag)
            j = j + wp.static(threads)
        barrier()  # neighbors' velocities are set at once

    @wp.func
    def sample_rollers(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        frames: wp.array[Real],
        mine: Mine,
        now: Now,
    ):
        """Writes the thread's rollers to the frame, and their energy to the tallies, where that is due."""
        if wp.static(kind.joint_friction and frame.holds("joint_friction_power")):
            if now.flags & FRAME != 0:
                sample_joints(ensemble, state, shared, mine, now)
        drive = ensemble.drives[mine.variant]
        j = int(mine.thread)
        while j < mine.rollers:
            a = acceleration(shared, j)
            v = velocity(shared.rows, j)
            if wp.static(not rk4):
                if now.step == 0:  # leapfrog's velocities are half a step behind from here on
                    v = v - Real(0.5) * step_of(mine) * a
                    set_velocity(shared, j, v)
                v = v + Real(0.5) * step_of(mine) * a
            if now.flags & EXTRA != 0:
                extra = state.extra[mine.first + j]
                if now.flags & FRAME != 0:
                    at = frame_at(ensemble, state, mine.variant, now.since, now.step)
                    write.write_roller(frames, at, mine.rollers, j, position(shared.rows, j), v, extra)
                if wp.static(measuring) and now.flags & ENDS != 0:
                    energy = observe.energy_of_roller(shared, j, v, extra)
                    tally = tallies.roller[mine.first + j]
                    tallies.roller[mine.first + j] = add_energy(tally, now.flags & START != 0, energy)
            j = j + wp.static(threads)

    @wp.func
    def write_frame(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        frames: wp.array[Real],
        mine: Mine,
        now: Now,
        body: Any,
        moment: Any,
    ):
        """Writes the thread's sprocket to the frame, where that is due; `moment` is the chain's on it [N m]."""
        if now.flags & FRAME != 0:
            at = frame_at(ensemble, state, mine.variant, now.since, now.step)
            write.write_sprocket(frames, at, mine.rollers, mine.sprocket, body, moment)

    @wp.func
    def write_arm_frame(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        frames: wp.array[Real],
        mine: Mine,
        now: Now,
        body: Any,
        moment: Any,
    ):
        """Writes the thread's arm to the frame, where that is due; `moment` is the chain's on it [N m]."""
        if now.flags & FRAME != 0:
            at = frame_at(ensemble, state, mine.variant, now.since, now.step)
            write.write_arm(frames, at, ensemble.drives[mine.variant], mine.arm, body, moment)

    @wp.func
    def write_push_frames(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        frames: wp.array[Real],
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        b: int,
    ):
        """Writes the tensioners of body b to the frame, where that is due."""
        if now.flags & FRAME != 0:
            at = frame_at(ensemble, state, mine.variant, now.since, now.step)
            drive = ensemble.drives[mine.variant]
            for t in range(wp.static(kind.tensioners)):
                if ensemble.tensioners[drive.first_tensioner + t].body == b:
                    if wp.static(kind.paired):
                        write.write_tensioner(frames, at, drive, t, shared.pushes[t])
                    else:
                        write.write_tensioner(frames, at, drive, t, state.pushes[drive.first_tensioner + t])

    return SamplingFunctions(
        write_arm_frame=write_arm_frame,
        write_push_frames=write_push_frames,
        on_event=on_event,
        sample_links=sample_links,
        sample_rollers=sample_rollers,
        write_sprocket_frame=write_frame,
    )
