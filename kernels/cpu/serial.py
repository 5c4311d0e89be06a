"""The CPU kernel: one Warp thread takes one variant through the steps of a launch.

At step n, positions and forces are those of time n h; leapfrog's velocities are half a step behind, and what is
recorded is brought to the same instant, v(n) = v(n - 1/2) + h a(n) / 2.
"""

from functools import cache
from typing import Any

import warp as wp

from ..integrate import MOST, leapfrog_kick, stage_at, stages_of, stretching
from ..modules import own_module
from ..structs import DIVERGENCE_CHECK, Now, Sums, types
from .contact_pairs import nearness
from .contacts import contact_rows
from .neighbor_list import neighbor_list
from .observe import measuring, now_at, sampling
from .rollers import ROWS, passes
from .steps import evaluating, moving, stepping

SCRATCH_ROWS = len(ROWS)


@cache
def advance_kernel(Real: type, capacity: int, frame: Any, plain: bool) -> wp.Kernel:
    """The kernel that takes variants through the steps of a launch, for up to `capacity` - 1 rollers.

    Frames lie as `frame` says (`frames.frame_writers`). That of `plain` drives leaves out what few have and what takes
    long to compile: arms and tensioners, profiles of guides, led centers, stages. The rest does the same, to the bit.
    """
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    part = passes(Real, capacity)
    do = stepping(Real, capacity, plain)
    sums_of, frames_of = measuring(Real, capacity, plain), sampling(Real, capacity, frame, plain)
    forces = evaluating(Real, capacity, plain)
    neighbors, near, contact = (
        neighbor_list(Real, capacity),
        nearness(Real, capacity, plain),
        contact_rows(Real, capacity),
    )
    fetch_dampers, put_dampers_back = contact.fetch_dampers, contact.put_dampers_back
    inside, find_rates, bodies_sound = part.inside, moving(Real, plain).find_rates, moving(Real, plain).bodies_sound

    @wp.func
    def march(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        frames: wp.array[Real],
        w: wp.array[Real],
        steps: int,
    ):
        """One variant: `steps` steps on. A function, of which the kernel's two forms share the code."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        memory = near.at_chain(near.memory_of(state, drive), drive, chain)
        progress = state.progress[variant]
        n = drive.rollers
        part.fetch(state, ensemble.lengths, w, drive.first_roller, n)
        fetch_dampers(state, drive, w)
        neighbors.reset(w, drive)
        sums_of.clear(w, n)
        end = wp.min(progress.step + steps, drive.steps + 1)
        at = drive.first_value
        step = progress.step
        while step < end and progress.diverged == 0:
            now = now_at(drive, step)
            if neighbors.needs_rebuild(w, drive):
                near.rebuild(ensemble, state, drive, w)
            stage = int(0)
            while stage < stages_of(drive.integrator):
                memory.stage = stage
                memory.wanted = now
                if stage != 0:
                    memory.wanted = Now()
                at_stage = stage_at(drive.integrator, stage, now.time, drive.step)
                memory.time = at_stage.time
                memory.stretched = stretching(drive.integrator, stage, Real(1.0))
                forces.pull(ensemble, state, drive, chain, w, memory)
                forces.push(ensemble, state, drive, w, memory)
                find_rates(ensemble, state, drive, stage, at_stage.time)
                if stage == 0:
                    if memory.wanted.measures != 0:
                        sums_of.measure(ensemble, state, sums, variant, drive, w, now)
                    if memory.wanted.sizes != 0:
                        frames_of.sample(ensemble, state, variant, drive, w, frames, at, now)
                        at = at + wp.int64(frames_of.width(drive))
                    if step % DIVERGENCE_CHECK == 0 or step == drive.steps:
                        if inside(w, n, drive.low, drive.high) == 0 or bodies_sound(state, drive) == 0:
                            progress.diverged = 1
                if step == drive.steps or progress.diverged == 1:
                    stage = wp.static(MOST)
                elif drive.integrator == 0:
                    do.leapfrog(ensemble, state, drive, chain, w, now.time, leapfrog_kick(step, drive.step))
                    stage = stage + 1
                else:
                    if wp.static(not plain):
                        do.take_stage(ensemble, state, drive, chain, w, at_stage)
                    stage = stage + 1
            if progress.diverged == 0:
                step = step + 1
        sums_of.merge(ensemble, state, sums, variant, w)
        progress.step = step
        state.progress[variant] = progress
        part.put_back(state, w, drive.first_roller, n)
        put_dampers_back(state, drive, w)

    @wp.kernel(enable_backward=False, module=own_module(__file__, "advance", Real, capacity, frame, plain))
    def advance(
        ensemble: Ensemble, state: State, sums: Sums, frames: wp.array[Real], w: wp.array[Real], first: int, steps: int
    ):
        """Variants `first` + thread: `steps` steps on, sums and frames written on the way."""
        march(ensemble, state, sums, first + wp.tid(), frames, w, steps)

    return advance
