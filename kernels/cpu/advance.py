"""The CPU kernel: one Warp thread advances all chains of a variant through a launch's steps.

At step n, positions and forces are of time n h; leapfrog's velocities, half a step behind, are recorded as
v(n) = v(n - 1/2) + h a(n) / 2.
"""

from functools import cache
from typing import Any

import warp as wp

from ..integrate import MOST_STAGES, leapfrog_kick, leapfrog_lag, stage_at, stage_count, stretched_part
from ..modules import own_module
from ..structs import DIVERGENCE_CHECK, Drive, Now, Sums, types
from . import bodies, body_states, shared_shafts
from .chain_sums import chain_sum_functions
from .contact_rows import contact_row_functions
from .forces import force_functions
from .frame_output import frame_output_functions
from .link_runs import link_run_functions
from .link_tallies import link_tally_functions
from .near_rollers import near_roller_functions
from .neighbor_list import neighbor_list_functions
from .rollers import ROWS, roller_functions
from .steps import step_functions
from .window_sums import window_sum_functions

SCRATCH_ROWS = len(ROWS)

IS_KEPT, KEEP = wp.constant(1), wp.constant(2)
"""Bits of a launch: the scratch has the variant already; it is to keep it for the next launch."""


@wp.func
def step_now(drive: Drive, step: int):
    """`Now` of step `step`, with the sums and frames wanted of it."""
    now = Now()
    now.step = step
    now.time = wp.float64(step) * drive.step
    if drive.integrator == 0:
        now.lag = leapfrog_lag(step, drive.step)
    now.weight = drive.step
    if step >= drive.window_start and step <= drive.window_end:
        now.measures = 1
        now.ends = wp.where(step == drive.window_start or step == drive.window_end, 1, 0)
    if now.ends != 0:
        now.weight = wp.float64(0.5) * now.weight
    if drive.frame_interval > 0:
        now.sizes = wp.where(step % drive.frame_interval == 0, 1, 0)
    return now


@cache
def advance_kernel(Real: type, capacity: int, frame: Any, several: bool, silent: bool = False) -> wp.Kernel:
    """CPU kernel that advances variants through a launch's steps, for up to `capacity` - 1 rollers of a chain.

    `frame` is the layout of frames (`kernels.frames`). Only with `several` may variants have several chains, only with
    `silent` silent ones.
    """
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    rollers = roller_functions(Real, capacity)
    steps = step_functions(Real, capacity)
    window_sums = window_sum_functions(Real, capacity)
    frame_output = frame_output_functions(Real, capacity, frame)
    link_tallies = link_tally_functions(Real, capacity)
    chain_sums = chain_sum_functions(Real, capacity)
    forces = force_functions(Real, capacity, silent)
    neighbor_list = neighbor_list_functions(Real, capacity)
    near_rollers = near_roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    link_runs = link_run_functions(Real, capacity)

    @wp.func
    def drive_at(ensemble: Ensemble, row: int):
        """`Drive` row of a chain, by value, in the CPU kernel."""
        return ensemble.drives[row]

    @wp.func
    def chain_at(ensemble: Ensemble, row: int):
        """`Chain` of a row, by value, in the CPU kernel."""
        return ensemble.chains[row]

    @wp.func
    def has_left(state: State, drive: Drive, w: wp.array[Real]):
        """Whether a chain's roller or body on the CPU has left the drive's box, or is not finite."""
        inside = rollers.is_inside(w, drive.rollers, drive.low, drive.high)
        return inside == 0 or body_states.has_sound_bodies(state, drive) == 0

    @wp.func
    def begin_launch(ensemble: Ensemble, state: State, drive: Drive, w: wp.array[Real], kept: int):
        """Copies a chain from the state into the CPU's scratch at a launch's begin, unless there."""
        if kept & IS_KEPT == 0:
            rollers.fetch(state, ensemble.lengths, w, drive.first_roller, drive.rollers)
            contact_rows.fetch_dampers(state, drive, w)
            if wp.static(silent):
                if drive.points > 1:
                    link_runs.fetch_pushes(state, drive, w)
            neighbor_list.reset(w, drive)
            link_tallies.clear(w, drive.rollers)

    @wp.func
    def end_launch(ensemble: Ensemble, state: State, sums: Sums, row: int, drive: Drive, w: wp.array[Real], kept: int):
        """Copies a chain from the CPU's scratch into the state at a launch's end, unless kept; merges sums."""
        if kept & KEEP == 0:
            chain_sums.merge_tallies(ensemble, state, sums, row, w)
            rollers.put_back(state, w, drive.first_roller, drive.rollers)
            contact_rows.put_back_dampers(state, drive, w)
            if wp.static(silent):
                if drive.points > 1:
                    link_runs.put_back_pushes(state, drive, w)

    @wp.func
    def advance_variant(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        kept: int,
        count: int,
    ):
        """Advances a variant's chains on the CPU, from row `variant` on, up to `count` steps."""
        chains, w = wp.static(1), scratch[0]
        if wp.static(several):
            drive, chain = drive_at(ensemble, variant), chain_at(ensemble, variant)
            chains = drive.chains
        else:
            drive, chain = ensemble.drives[variant], ensemble.chains[variant]
        integrator, h, last = drive.integrator, drive.step, drive.steps
        memory = near_rollers.memory_at_chain(near_rollers.contact_memory(state, drive), drive, chain)
        progress = state.progress[variant]
        for c in range(chains):
            begin_launch(ensemble, state, ensemble.drives[variant + c], scratch[c], kept)
        end = wp.min(progress.step + count, last + 1)
        number = int(0)  # of frames written
        step = progress.step
        while step < end and progress.diverged == 0:
            now = step_now(drive, step)
            for c in range(chains):
                if wp.static(several):
                    drive, w = drive_at(ensemble, variant + c), scratch[c]
                if neighbor_list.is_outdated(w, drive):
                    near_rollers.rebuild_neighbor_list(ensemble, state, drive, w)
            stage = int(0)
            while stage < stage_count(integrator):
                at = stage_at(integrator, stage, now.time, h)
                memory.stage = stage
                memory.wanted = now
                if stage != 0:
                    memory.wanted = Now()
                memory.time = at.time
                memory.stretch_part = stretched_part(integrator, stage, Real(1.0))
                for c in range(chains):
                    if wp.static(several):
                        drive, chain, w = drive_at(ensemble, variant + c), chain_at(ensemble, variant + c), scratch[c]
                        memory = near_rollers.memory_at_chain(memory, drive, chain)
                    forces.add_link_forces(ensemble, state, drive, chain, w, memory)
                    forces.add_contact_forces(ensemble, state, drive, variant + c, w, memory)
                    bodies.find_accelerations(ensemble, state, drive, stage, at.time)
                if wp.static(several):
                    shared_shafts.join_shafts_of_variant(ensemble, state, variant, chains, at.time)
                for c in range(chains):
                    if wp.static(several):
                        drive, w = drive_at(ensemble, variant + c), scratch[c]
                    if memory.wanted.measures != 0:
                        window_sums.add_step(ensemble, state, sums, variant + c, drive, w, now)
                    if memory.wanted.sizes != 0:
                        frame_output.write_frame(ensemble, state, variant + c, drive, w, frames, number, now)
                    if stage == 0 and (step % DIVERGENCE_CHECK == 0 or step == last):
                        if has_left(state, drive, w):
                            progress.diverged = 1
                number = number + memory.wanted.sizes
                stage = stage + 1
                if step == last or progress.diverged == 1:
                    stage = wp.static(MOST_STAGES)
                else:
                    for c in range(chains):
                        if wp.static(several):
                            r = variant + c
                            drive, chain, w = drive_at(ensemble, r), chain_at(ensemble, r), scratch[c]
                        if integrator == 0:
                            steps.take_leapfrog_step(ensemble, state, drive, chain, w, now.time, leapfrog_kick(step, h))
                        else:
                            steps.take_stage(ensemble, state, drive, chain, w, at)
            step = step + 1 - progress.diverged
        progress.step = step
        for c in range(chains):
            end_launch(ensemble, state, sums, variant + c, ensemble.drives[variant + c], scratch[c], kept)
            state.progress[variant + c] = progress

    @wp.kernel(enable_backward=False, module=own_module(__file__, "advance", Real, capacity, frame, several, silent))
    def advance(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        first: int,
        kept: int,
        steps: int,
    ):
        """Advances variants, a CPU thread each from row `first` on, up to `steps` steps, with sums and frames."""
        variant = first + wp.tid()
        if ensemble.drives[variant].chains > 0:
            advance_variant(ensemble, state, sums, variant, frames, scratch, kept, steps)

    return advance
