"""The CPU kernel of drives with several chains: one Warp thread takes all chains of a variant through a launch's steps.

Each chain is a row of `Drive` with bodies of its own, one row after the other, and goes through the same functions as
a drive of one chain. What chains have in common are shafts: accelerations of the bodies of one shaft, whose inertia
each of them has, are added in their order, and all of them take the sum.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..integrate import MOST, Stage, leapfrog_kick, stage_at, stages_of, stretching
from ..modules import own_module
from ..physics.valve import valves_share
from ..structs import DIVERGENCE_CHECK, Drive, Now, Sums, types
from .contact_pairs import nearness
from .contacts import contact_rows
from .neighbor_list import neighbor_list
from .observe import measuring, now_at, sampling
from .rollers import passes
from .steps import evaluating, loading, moving, stepping


@cache
def shafts(Real: type, plain: bool) -> SimpleNamespace:
    """The functions that make the bodies of each shaft of a variant turn as one."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    find_rates = moving(Real, plain).find_rates
    cam_on, kick_of = loading(Real, plain).cam_on, loading(Real, plain).kick_of

    @wp.func
    def bodies_of(ensemble: Ensemble, first: int, rings: int):
        """Number of bodies of a variant whose chains begin at row `first`."""
        last = ensemble.drives[first + rings - 1]
        return last.first_body + last.bodies - ensemble.drives[first].first_body

    @wp.func
    def hand_on(ensemble: Ensemble, state: State, begin: int, count: int, b: int, kick: wp.float64, lifting: bool):
        """Adds to the accelerations of a train what the moment on body `b` does, which is of another chain.

        Args:
            kick: as `kick_of`.
            lifting: whether cams lift valves.
        """
        first = b + ensemble.motions[b].apart
        mine, wrench, more = ensemble.motions[first], state.wrenches[b], state.rates[b][2]
        if wp.static(not plain):
            if lifting:
                cam = cam_on(ensemble, state, begin, count, first)
                share = valves_share(state.bodies[first].speed, kick, cam, mine)
                more = more / (wp.float64(1.0) + share)
        state.passed[first] = state.passed[first] + wrench.moment + wrench.bearing + wrench.load
        if ensemble.motions[b].prescribed == 0:
            for other in range(begin, begin + count):
                motion = ensemble.motions[other]
                if motion.train == mine.train and motion.apart == 0:
                    rates = state.rates[other]
                    rates[2] = rates[2] + motion.ratio / mine.ratio * more
                    state.rates[other] = rates

    @wp.func
    def join(ensemble: Ensemble, state: State, begin: int, count: int, kick: wp.float64, lifting: bool):
        """Gives all bodies of each shaft, of `count` from `begin` on, the sum of their angular accelerations."""
        for b in range(begin, begin + count):
            if ensemble.motions[b].apart != 0:
                hand_on(ensemble, state, begin, count, b, kick, lifting)
        for b in range(begin, begin + count):
            if ensemble.motions[b].apart != 0 and ensemble.motions[b].prescribed == 0:
                rates = state.rates[b]
                rates[2] = state.rates[b + ensemble.motions[b].apart][2]
                state.rates[b] = rates

    @wp.func
    def join_all(ensemble: Ensemble, state: State, variant: int, rings: int, time: wp.float64):
        """`join`, of all bodies of a variant, at a stage's `time`."""
        drive, last = ensemble.drives[variant], ensemble.drives[variant + rings - 1]
        lifting = last.first_valve + last.valves > drive.first_valve
        join(ensemble, state, drive.first_body, bodies_of(ensemble, variant, rings), kick_of(drive, time), lifting)

    return SimpleNamespace(**locals())


@cache
def chains_kernel(Real: type, capacity: int, frame: Any, plain: bool) -> wp.Kernel:
    """The kernel that takes variants of several chains through the steps of a launch (`serial.advance_kernel`)."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    part = passes(Real, capacity)
    do, of_bodies, together = stepping(Real, capacity, plain), moving(Real, plain), shafts(Real, plain)
    sums_of, frames_of = measuring(Real, capacity, plain), sampling(Real, capacity, frame, plain)
    forces = evaluating(Real, capacity, plain)
    neighbors, near, contact = (
        neighbor_list(Real, capacity),
        nearness(Real, capacity, plain),
        contact_rows(Real, capacity),
    )
    fetch_dampers, put_dampers_back = contact.fetch_dampers, contact.put_dampers_back

    @wp.func
    def pull(ensemble: Ensemble, state: State, r: int, drive: Drive, w: wp.array[Real], memory: kinds.Memory):
        """`steps.evaluating`'s, of the chain in row r."""
        forces.pull(ensemble, state, drive, ensemble.chains[r], w, memory)

    @wp.func
    def evaluate(
        ensemble: Ensemble, state: State, variant: int, rings: int, scratch: wp.array2d[Real], memory: kinds.Memory
    ):
        """Forces on all rollers and wrenches on all bodies, then the bodies' accelerations.

        A drive of one chain may have trains of its own.
        """
        for c in range(rings):
            drive = ensemble.drives[variant + c]
            memory = near.at_chain(memory, drive, ensemble.chains[variant + c])
            pull(ensemble, state, variant + c, drive, scratch[c], memory)
            forces.push(ensemble, state, drive, scratch[c], memory)
            together.find_rates(ensemble, state, drive, memory.stage, memory.time)
        together.join_all(ensemble, state, variant, rings, memory.time)

    @wp.func
    def observe(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        now: Now,
        taken: int,
    ):
        """Adds an evaluated step to the sums and writes its frames, after `taken` others; 1 where it has diverged."""
        diverged = int(0)
        for c in range(ensemble.drives[variant].rings):
            r = variant + c
            drive = ensemble.drives[r]
            n = drive.rollers
            if now.measures != 0:
                sums_of.measure(ensemble, state, sums, r, drive, scratch[c], now)
            if now.sizes != 0:
                width = wp.int64(frames_of.width(drive))
                begin = drive.first_value + wp.int64(taken) * width
                frames_of.sample(ensemble, state, r, drive, scratch[c], frames, begin, now)
            if now.step % DIVERGENCE_CHECK == 0 or now.step == drive.steps:
                if part.inside(scratch[c], n, drive.low, drive.high) == 0 or of_bodies.bodies_sound(state, drive) == 0:
                    diverged = int(1)
        return diverged

    @wp.func
    def move(
        ensemble: Ensemble, state: State, variant: int, rings: int, scratch: wp.array2d[Real], at: Stage, now: Now
    ):
        """Takes all chains on: a step by leapfrog, or a stage of one."""
        for c in range(rings):
            drive, chain = ensemble.drives[variant + c], ensemble.chains[variant + c]
            if drive.integrator == 0:
                kick = leapfrog_kick(now.step, drive.step)
                do.leapfrog(ensemble, state, drive, chain, scratch[c], now.time, kick)
            elif wp.static(not plain):
                do.take_stage(ensemble, state, drive, chain, scratch[c], at)

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
        """One variant, whose chains begin at row `variant`: `steps` steps on, as `serial.march`."""
        whole = ensemble.drives[variant]
        rings = whole.rings
        memory = near.memory_of(state, whole)
        progress = state.progress[variant]
        for c in range(rings):
            drive = ensemble.drives[variant + c]
            part.fetch(state, ensemble.lengths, scratch[c], drive.first_roller, drive.rollers)
            fetch_dampers(state, drive, scratch[c])
            neighbors.reset(scratch[c], drive)
            sums_of.clear(scratch[c], drive.rollers)
        end = wp.min(progress.step + steps, whole.steps + 1)
        taken = int(0)
        step = progress.step
        while step < end and progress.diverged == 0:
            now = now_at(whole, step)
            for c in range(rings):
                drive = ensemble.drives[variant + c]
                if neighbors.needs_rebuild(scratch[c], drive):
                    near.rebuild(ensemble, state, drive, scratch[c])
            stage = int(0)
            while stage < stages_of(whole.integrator):
                at = stage_at(whole.integrator, stage, now.time, whole.step)
                memory.stage = stage
                memory.wanted = now
                if stage != 0:
                    memory.wanted = Now()
                memory.time = at.time
                memory.stretched = stretching(whole.integrator, stage, Real(1.0))
                evaluate(ensemble, state, variant, rings, scratch, memory)
                checks = step % DIVERGENCE_CHECK == 0 or step == whole.steps
                if stage == 0 and (checks or now.measures != 0 or now.sizes != 0):
                    progress.diverged = observe(ensemble, state, sums, variant, frames, scratch, now, taken)
                    if now.sizes != 0:
                        taken = taken + 1
                stage = stage + 1
                if step == whole.steps or progress.diverged == 1:
                    stage = wp.static(MOST)
                else:
                    move(ensemble, state, variant, rings, scratch, at, now)
            if progress.diverged == 0:
                step = step + 1
        progress.step = step
        for c in range(rings):
            drive = ensemble.drives[variant + c]
            sums_of.merge(ensemble, state, sums, variant + c, scratch[c])
            state.progress[variant + c] = progress
            part.put_back(state, scratch[c], drive.first_roller, drive.rollers)
            put_dampers_back(state, drive, scratch[c])

    @wp.kernel(enable_backward=False, module=own_module(__file__, "advance_chains", Real, capacity, frame, plain))
    def advance(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        frames: wp.array[Real],
        scratch: wp.array2d[Real],
        first: int,
        steps: int,
    ):
        """Variants whose chains begin at rows `first` + thread: `steps` steps on, as `serial.advance_kernel`'s."""
        variant = first + wp.tid()
        if ensemble.drives[variant].rings > 0:
            march(ensemble, state, sums, variant, frames, scratch, steps)

    return advance
