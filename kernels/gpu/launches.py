"""Begin and end of a launch for one variant on a block, and its way from step to step."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import stage_count
from ..structs import Tallies
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .body_states import body_state_functions
from .events import END, ENDS
from .link_tallies import link_tally_functions
from .oil_warp import oil_warp_functions
from .prescribed_motion import prescribed_motion_functions
from .rollers import roller_functions
from .strands import strand_functions
from .tensioners import tensioner_functions


@dataclass(frozen=True)
class LaunchFunctions:
    """Launch functions of a block."""

    outputs: wp.Function
    moved_sprockets: wp.Function
    with_wanted_sums: wp.Function
    first_instant: wp.Function
    next_stage: wp.Function
    begin_launch: wp.Function
    end_launch: wp.Function


@cache
def launch_functions(kind: BlockKind) -> LaunchFunctions:
    """Launch functions of block kernels."""
    Real, sprockets, integrator = kind.Real, kind.parts.sprockets, kind.integrator
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared, Sums = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Sums
    ALL_SPROCKETS = wp.constant((1 << sprockets) - 1)
    prescribed_motion = prescribed_motion_functions(kind)
    rollers = roller_functions(kind)
    body_states = body_state_functions(kind)
    link_tallies = link_tally_functions(kind)
    strands = strand_functions(kind)
    tensioners = tensioner_functions(kind)
    oil_warp = oil_warp_functions(kind)

    @wp.func
    def outputs(sums: Sums, tallies: Tallies, frames: wp.array[Real]):
        """Sums, tallies and frames of a block's launch as one struct."""
        out = Out()
        out.sums = sums
        out.tallies = tallies
        out.frames = frames
        return out

    @wp.func
    def moved_sprockets(shared: Shared):
        """Sprockets of a block whose moment moves them, as bits."""
        if wp.static(kind.moving):
            return ALL_SPROCKETS
        mask = int(0)
        for s in range(sprockets):
            if not prescribed_motion.is_prescribed(shared, s):
                mask = mask | (1 << s)
        return mask

    @wp.func
    def with_wanted_sums(mine: ThreadParts, now: Now):
        """Time loop's state with the sums wanted now: metrics at a step's start, and moments of which sprockets."""
        now.measures = 0
        if wp.static(kind.measuring):
            now.weight = rollers.time_step(mine)
            if now.flags & ENDS != 0:
                now.weight = Real(0.5) * now.weight
            if now.stage == 0:
                now.measures = now.in_window
        else:
            now.wanted_moments = now.moved_sprockets
            if now.flags != 0:
                now.wanted_moments = ALL_SPROCKETS
        return now

    @wp.func
    def first_instant(state: State, mine: ThreadParts, begun: int):
        """Time loop's state at a launch's begin; the frames' buffer begins at step `begun`."""
        now = Now()
        now.step = state.progress[mine.variant].step
        now.next_event = now.step
        now.diverged = state.progress[mine.variant].diverged
        now.goes_on = 1
        now.frames_begun = begun
        return now

    @wp.func
    def next_stage(now: Now):
        """Time loop's state at the next stage or step; unchanged for a variant that has diverged."""
        if now.flags & END != 0:
            now.in_window = 0
        now.flags = 0
        if wp.static(kind.has_stages):
            now.stage = now.stage + 1
        if (
            not wp.static(kind.has_stages) or now.stage == stage_count(integrator) or now.goes_on == 0
        ) and now.diverged == 0:
            now.stage = 0
            now.step = now.step + 1
        return now

    @inlined
    def begin_launch(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: ThreadParts, step: int):
        """Shares bodies and sums from the state, at a block's launch."""
        if mine.body >= 0:
            body_states.share_body(ensemble, state, sums, shared, mine, step)
        if wp.static(kind.measuring):
            link_tallies.begin_extremes(ensemble, sums, shared, mine)
            strands.find_strands(ensemble, state, shared, mine)

    @wp.func
    def end_launch(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Puts rollers, bodies and sums back into the state, at the end of a block's launch."""
        tensioners.end_oil_warp(shared, mine.thread)
        if wp.static(kind.measuring):
            link_tallies.merge_tallies(out.tallies, shared, mine)
        rollers.put_back(state, shared, mine)
        if mine.body >= 0:
            body_states.put_back_body(ensemble, state, out.sums, shared, mine)
        if wp.static(kind.measuring):
            link_tallies.merge_extremes_of_strands(ensemble, out.sums, shared, mine)
        if mine.thread == 0:
            for r in range(wp.static(kind.parts.chains)):
                progress = state.progress[mine.variant + r]
                progress.step = now.step
                progress.diverged = now.diverged
                state.progress[mine.variant + r] = progress
        if wp.static(kind.has_oil_warp):
            oil_warp.end_thread()

    return LaunchFunctions(
        outputs=outputs,
        moved_sprockets=moved_sprockets,
        with_wanted_sums=with_wanted_sums,
        first_instant=first_instant,
        next_stage=next_stage,
        begin_launch=begin_launch,
        end_launch=end_launch,
    )
