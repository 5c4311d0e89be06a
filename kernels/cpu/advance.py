"""The CPU kernel: one Warp thread takes all chains of one variant through the steps of a launch.

At step n, positions and forces are those of time n h; leapfrog's velocities are half a step behind, and what is
recorded is brought to the same instant, v(n) = v(n - 1/2) + h a(n) / 2.
"""

from functools import cache
from typing import Any

import warp as wp

from ..integrate import MOST, leapfrog_kick, stage_at, stages_of, stretching
from ..modules import own_module
from ..structs import DIVERGENCE_CHECK, Drive, Now, Sums, types
from .contact_pairs import nearness
from .contacts import contact_rows
from .neighbor_list import neighbor_list
from .observe import measuring, now_at, sampling
from .rollers import ROWS, passes
from .shafts import shafts
from .steps import evaluating, moving, stepping

SCRATCH_ROWS = len(ROWS)


@cache
def advance_kernel(Real: type, capacity: int, frame: Any, several: bool) -> wp.Kernel:
    """The kernel that takes variants through the steps of a launch, for up to `capacity` - 1 rollers of a chain.

    Frames lie as `frame` says (`frames.frame_writers`). Only with `several` may a variant have more than one chain.
    """
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    part, of_bodies = passes(Real, capacity), moving(Real)
    do, join_all = stepping(Real, capacity), shafts(Real).join_all
    sums_of, frames_of = measuring(Real, capacity), sampling(Real, capacity, frame)
    forces, neighbors = evaluating(Real, capacity), neighbor_list(Real, capacity)
    near, contact = nearness(Real, capacity), contact_rows(Real, capacity)

    @wp.func
    def drive_at(ensemble: Ensemble, row: int):
        """The row of a chain, by value, so that another may take its place in a variable."""
        return ensemble.drives[row]

    @wp.func
    def chain_at(ensemble: Ensemble, row: int):
        """The chain of a row, by value."""
        return ensemble.chains[row]

    @wp.func
    def has_left(state: State, drive: Drive, w: wp.array[Real]):
        """Whether a roller or body of a chain is out of the drive's box, or is no number."""
        inside = part.inside(w, drive.rollers, drive.low, drive.high)
        return inside == 0 or of_bodies.bodies_sound(state, drive) == 0

    @wp.func
    def begin_launch(ensemble: Ensemble, state: State, drive: Drive, w: wp.array[Real]):
        """Brings a chain into the scratch's rows."""
        part.fetch(state, ensemble.lengths, w, drive.first_roller, drive.rollers)
        contact.fetch_dampers(state, drive, w)
        neighbors.reset(w, drive)
        sums_of.clear(w, drive.rollers)

    @wp.func
    def end_launch(ensemble: Ensemble, state: State, sums: Sums, row: int, drive: Drive, w: wp.array[Real]):
        """Brings the chain of a row back from the scratch, and its sums together."""
        sums_of.merge(ensemble, state, sums, row, w)
        part.put_back(state, w, drive.first_roller, drive.rollers)
        contact.put_dampers_back(state, drive, w)

    @wp.func
    def march(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        steps: int,
    ):
        """Takes the chains of a variant, which begin at row `variant`, `steps` steps on."""
        chains, w = wp.static(1), scratch[0]
        if wp.static(several):
            drive, chain = drive_at(ensemble, variant), chain_at(ensemble, variant)
            chains = drive.rings
        else:
            drive, chain = ensemble.drives[variant], ensemble.chains[variant]
        integrator, h, last = drive.integrator, drive.step, drive.steps
        memory = near.at_chain(near.memory_of(state, drive), drive, chain)
        progress = state.progress[variant]
        for c in range(chains):
            begin_launch(ensemble, state, ensemble.drives[variant + c], scratch[c])
        end = wp.min(progress.step + steps, last + 1)
        number = int(0)  # of frames written
        step = progress.step
        while step < end and progress.diverged == 0:
            now = now_at(drive, step)
            for c in range(chains):
                if wp.static(several):
                    drive, w = drive_at(ensemble, variant + c), scratch[c]
                if neighbors.needs_rebuild(w, drive):
                    near.rebuild(ensemble, state, drive, w)
            stage = int(0)
            while stage < stages_of(integrator):
                at = stage_at(integrator, stage, now.time, h)
                memory.stage = stage
                memory.wanted = now
                if stage != 0:
                    memory.wanted = Now()
                memory.time = at.time
                memory.stretched = stretching(integrator, stage, Real(1.0))
                for c in range(chains):
                    if wp.static(several):
                        drive, chain, w = drive_at(ensemble, variant + c), chain_at(ensemble, variant + c), scratch[c]
                        memory = near.at_chain(memory, drive, chain)
                    forces.pull(ensemble, state, drive, chain, w, memory)
                    forces.push(ensemble, state, drive, w, memory)
                    of_bodies.find_rates(ensemble, state, drive, stage, at.time)
                if wp.static(several):
                    join_all(ensemble, state, variant, chains, at.time)
                for c in range(chains):
                    if wp.static(several):
                        drive, w = drive_at(ensemble, variant + c), scratch[c]
                    if memory.wanted.measures != 0:
                        sums_of.measure(ensemble, state, sums, variant + c, drive, w, now)
                    if memory.wanted.sizes != 0:
                        frames_of.sample(ensemble, state, variant + c, drive, w, frames, number, now)
                    if stage == 0 and (step % DIVERGENCE_CHECK == 0 or step == last):
                        if has_left(state, drive, w):
                            progress.diverged = 1
                number = number + memory.wanted.sizes
                stage = stage + 1
                if step == last or progress.diverged == 1:
                    stage = wp.static(MOST)
                else:
                    for c in range(chains):
                        if wp.static(several):
                            r = variant + c
                            drive, chain, w = drive_at(ensemble, r), chain_at(ensemble, r), scratch[c]
                        if integrator == 0:
                            do.leapfrog(ensemble, state, drive, chain, w, now.time, leapfrog_kick(step, h))
                        else:
                            do.take_stage(ensemble, state, drive, chain, w, at)
            step = step + 1 - progress.diverged
        progress.step = step
        for c in range(chains):
            end_launch(ensemble, state, sums, variant + c, ensemble.drives[variant + c], scratch[c])
            state.progress[variant + c] = progress

    @wp.kernel(enable_backward=False, module=own_module(__file__, "advance", Real, capacity, frame, several))
    def advance(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        first: int,
        steps: int,
    ):
        """Variants whose chains begin at rows `first` + thread: `steps` steps on, with sums and frames."""
        variant = first + wp.tid()
        if ensemble.drives[variant].rings > 0:
            march(ensemble, state, sums, variant, frames, scratch, steps)

    return advance
