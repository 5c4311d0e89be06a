"""Sampling in the block kernel's time loop: work at some steps only, and when it is due."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writer_functions
from ..physics.body import is_in_box
from ..structs import Tallies
from ..sums import MERGE_EVERY, add_energy, gathered_sprocket_sums, is_sample_step
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .body_states import body_state_functions
from .chains import chain_functions
from .events import CHECK, ENDS, EXTRA, FRAME, LAST, START, event_flags, next_event
from .frame_output import frame_output_functions
from .joint_powers import joint_power_functions
from .link_tallies import link_tally_functions
from .links import link_functions
from .prescribed_motion import prescribed_motion_functions
from .rollers import roller_functions
from .statistics import statistics_functions
from .strands import strand_functions
from .sync import sync_functions


@dataclass(frozen=True)
class SamplingFunctions:
    """Sampling functions of a block: checks, samples, frames."""

    handle_event: wp.Function
    sample_links: wp.Function
    sample_rollers: wp.Function


@cache
def sampling_functions(kind: BlockKind, frame: Any) -> SamplingFunctions:
    """Sampling functions of block kernels, and frames of layout `frame`."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Out = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Out
    of_each = wp.types.vector(rollers_per_thread, Real)
    frame_writers = frame_writer_functions(Real, frame)
    statistics = statistics_functions(kind)
    chains = chain_functions(kind)
    link_tallies = link_tally_functions(kind)
    sync = sync_functions(kind)
    strands = strand_functions(kind)
    rollers = roller_functions(kind)
    body_states = body_state_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    links = link_functions(kind)
    joint_powers = joint_power_functions(kind)
    frame_output = frame_output_functions(kind, frame)

    @wp.func
    def sample_chain(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Notes due sums, updates the strands, and samples the block's chain."""
        if now.flags & START == 0:
            statistics.note_sums(ensemble, out, shared, mine, now.step)
        if mine.sprocket >= 0:
            begin, count = chains.own_chain_span(shared, mine)
            at = ensemble.drives[mine.variant].first_sprocket + mine.sprocket
            link_tallies.update_strand(state, shared, begin, count, at, now.flags & START != 0)
        sync.barrier()
        strands.find_strands(ensemble, state, shared, mine)
        statistics.sample_chain(ensemble, state, out, shared, mine)

    @wp.func
    def merge_tallies(tallies: Tallies, shared: Shared, mine: ThreadParts):
        """Adds the tallies of the thread's links and sprocket since the last merge to the sums."""
        if mine.sprocket >= 0:
            shared.sprocket_sums[mine.sprocket] = gathered_sprocket_sums(shared.sprocket_sums[mine.sprocket])
        link_tallies.merge_tallies(tallies, shared, mine)

    @wp.func
    def has_left(shared: Shared, mine: ThreadParts):
        """1 where a roller of the thread, or its body, is not finite or out of the drive's box, else 0."""
        gone = int(0)
        j = int(mine.thread)
        while j < mine.rollers:
            box = 2 * chains.chain_number(shared, j)
            gone = wp.max(
                gone, int(not is_in_box(shared.boxes[box], shared.boxes[box + 1], rollers.position(shared.rows, j)))
            )
            j = j + threads
        if mine.body >= 0:
            gone = wp.max(gone, body_states.has_body_left(shared, mine))
        return gone

    @inlined
    def handle_event(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Handles the events of this step on a block; all threads together."""
        drive = ensemble.drives[mine.variant]
        now.flags = event_flags(drive, now.step)
        now.next_event = next_event(drive, now.step)
        if wp.static(kind.measuring) and now.step >= drive.window_start and now.step <= drive.window_end:
            now.in_window = 1
            if now.step % MERGE_EVERY == 0:
                merge_tallies(out.tallies, shared, mine)
            if is_sample_step(drive, now.step):
                sample_chain(ensemble, state, out, shared, mine, now)
        if now.flags & CHECK != 0:
            now.diverged = sync.is_set_in_any_thread(has_left(shared, mine))
            if mine.body >= 0:
                body_states.align_pose(shared, mine.body)
            prescribed_motion.plan_steps(ensemble, shared, mine, now.step)
            sync.barrier()
        if now.flags & LAST != 0 or now.diverged != 0:
            now.goes_on = 0
        return now

    @wp.func
    def sample_links(
        state: State,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        lengths: wp.array[Real],
        tension: of_each,
        rate: of_each,
    ):
        """Adds the thread's links to metrics in this step, and keeps their values for frames or ends."""
        n = mine.rollers
        if wp.static(kind.measuring) and now.measures != 0:
            link_tallies.add_rates(shared, mine.thread, rate, now.weight)
            link_tallies.widen_extremes(shared, mine.thread, tension)
        if now.flags & EXTRA != 0:
            j = int(mine.thread)
            while j < n:
                tension_j, rate_j, force = links.link_load(shared, j, n, links.link_length(shared, lengths, j))
                extra = kinds.Extra()
                extra.tension = tension_j
                extra.rate = rate_j
                state.extra[mine.first_roller + j] = extra
                j = j + threads

    @wp.func
    def find_joint_powers(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Keeps the friction powers of the thread's joints for a frame; all threads together."""
        lag = Real(0.0)
        if wp.static(not kind.has_stages):
            lag = wp.where(now.step == 0, Real(0.0), Real(0.5) * rollers.time_step(mine))
        j = int(mine.thread)
        while j < mine.rollers:
            state.extra[mine.first_roller + j].friction_power = joint_powers.friction_power(
                ensemble, state, shared, mine, j, lag
            )
            j = j + threads
        sync.barrier()  # neighbors' velocities are set at once

    @wp.func
    def sample_rollers(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Writes the thread's rollers to a due frame, and their energy to due tallies."""
        if wp.static(kind.friction.joints and frame.holds("joint_friction_power")):
            if now.flags & FRAME != 0:
                find_joint_powers(ensemble, state, shared, mine, now)
        j = int(mine.thread)
        while j < mine.rollers:
            a = rollers.acceleration(shared, j)
            v = rollers.velocity(shared.rows, j)
            if wp.static(not kind.has_stages):
                if now.step == 0:  # leapfrog's velocities are half a step behind from here on
                    v = v - Real(0.5) * rollers.time_step(mine) * a
                    rollers.set_velocity(shared, j, v)
                v = v + Real(0.5) * rollers.time_step(mine) * a
            if now.flags & EXTRA != 0:
                extra = state.extra[mine.first_roller + j]
                if now.flags & FRAME != 0:
                    at = frame_output.frame_begin(ensemble.drives[chains.drive_row(shared, mine, j)], now)
                    first, n = chains.chain_span(shared, j, mine.rollers)
                    frame_writers.write_roller(out.frames, at, n, j - first, rollers.position(shared.rows, j), v, extra)
                if wp.static(kind.measuring) and now.flags & ENDS != 0:
                    energy = link_tallies.energy_of_roller(shared, j, mine.rollers, v, extra)
                    tally = out.tallies.roller[mine.first_roller + j]
                    out.tallies.roller[mine.first_roller + j] = add_energy(tally, now.flags & START != 0, energy)
            j = j + threads

    return SamplingFunctions(
        handle_event=handle_event,
        sample_links=sample_links,
        sample_rollers=sample_rollers,
    )
