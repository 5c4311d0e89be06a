"""Tensioners on blocks: forces on bodies that they push, and steps of their oil.

Where many variants share a block, a warp of its own (`oil_warp`) advances the oil, a tensioner a thread.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..bodies.tensioners import advance_tensioner_at, find_supply, tensioner_sums
from ..integrate import stage_count
from ..physics.tensioner import extension_and_rate, tensioner_energy, tensioner_push
from ..sums import add_energy, add_meter
from .block_kinds import BlockKind
from .block_structs import ThreadParts, thread_parts
from .chains import chain_functions
from .events import END, ENDS, START
from .oil_warp import DONE, METERED, OVER, oil_warp_functions
from .rollers import roller_functions
from .sync import sync_functions


@dataclass(frozen=True)
class TensionerFunctions:
    """Tensioner functions of a block."""

    add_tensioner_forces: wp.Function
    add_tensioner_step: wp.Function
    find_supplies: wp.Function
    advance_tensioners: wp.Function
    await_oil: wp.Function
    end_oil_warp: wp.Function
    serve_variant: wp.Function


@cache
def tensioner_functions(kind: BlockKind) -> TensionerFunctions:
    """Tensioner functions of block kernels."""
    chains = chain_functions(kind)
    oil_warp = oil_warp_functions(kind)
    rollers = roller_functions(kind)
    sync = sync_functions(kind)
    kinds, Now, integrator = kind.types, kind.types.Now, kind.integrator
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose

    @wp.func
    def tensioner_at(ensemble: Ensemble, t: int):
        """Tensioner t of all, with constants of the block kernel's kind."""
        tensioner = ensemble.tensioners[t]
        if wp.static(not kind.parts.hydraulic):
            tensioner.hydraulic = 0  # so that the compiler knows
        return tensioner

    @wp.func
    def add_tensioner_forces(
        ensemble: Ensemble, state: State, mine: ThreadParts, stage: int, pose: Pose, wrench: kinds.Wrench
    ):
        """Wrench on the thread's body, at `pose` in a stage, with its tensioners' forces."""
        kept = True
        if wp.static(kind.has_stages):
            kept = stage == 0
        drive = ensemble.drives[mine.drive_row]
        for t in range(drive.first_tensioner, drive.first_tensioner + chains.tensioner_count(drive)):
            tensioner = tensioner_at(ensemble, t)
            if tensioner.body == mine.body_number:
                push = tensioner_push(pose, kept, state.tensioners[t], tensioner)
                state.pushes[t] = push
                wrench.force = wrench.force + push.thrust
                wrench.moment = wrench.moment + push.moment
        return wrench

    @wp.func
    def add_tensioner_step(
        ensemble: Ensemble,
        state: State,
        out: kinds.Out,
        mine: ThreadParts,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
    ):
        """Adds a step of the thread's tensioners to the window's sums.

        `before` is its pose before the step; `seen` has rates of the step's instant.
        """
        drive = ensemble.drives[mine.drive_row]
        for t in range(drive.first_tensioner, drive.first_tensioner + chains.tensioner_count(drive)):
            tensioner = tensioner_at(ensemble, t)
            if tensioner.body == mine.body_number:
                push = state.pushes[t]
                sums = out.sums.tensioner[t]
                out.sums.tensioner[t] = tensioner_sums(sums, before, seen, state, t, tensioner, now.weight)
                if now.flags & ENDS != 0:
                    start, end = now.flags & START != 0, now.flags & END != 0
                    out.sums.tensioner[t] = add_meter(out.sums.tensioner[t], state.meters[t], start, end)
                    energy = wp.float64(tensioner_energy(push.extension, push.pressure, state.tensioners[t], tensioner))
                    at = drive.first_body + mine.body_number
                    out.tallies.body[at] = add_energy(out.tallies.body[at], now.flags & START != 0, energy)

    @wp.func
    def find_supplies(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, time: kinds.Number):
        """Stores supply pressures of the thread's tensioners at a step's start, while no body moves."""
        drive = ensemble.drives[mine.drive_row]
        for t in range(drive.first_tensioner, drive.first_tensioner + chains.tensioner_count(drive)):
            tensioner = ensemble.tensioners[t]
            if tensioner.body == mine.body_number and tensioner.supply_table.cells > 0:
                chain = mine.drive_row - mine.variant
                pump = chains.body_on_block(ensemble, shared, mine.drive_row, chain, tensioner.pump)
                find_supply(time, ensemble, state, drive, t, shared.poses, pump)

    @wp.func
    def advance_tensioners(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Advances the tensioners of the thread's body by a step, once it has moved."""
        if now.goes_on != 0 and now.stage == stage_count(integrator) - 1:
            drive = ensemble.drives[mine.drive_row]
            for t in range(drive.first_tensioner, drive.first_tensioner + chains.tensioner_count(drive)):
                tensioner = ensemble.tensioners[t]
                if tensioner.body == mine.body_number:
                    x, rate = extension_and_rate(shared.poses[mine.body], tensioner)
                    metered = wp.static(kind.measuring) and now.in_window != 0
                    if wp.static(kind.has_oil_warp):
                        k = t - ensemble.drives[mine.variant].first_tensioner
                        oil_warp.request_oil_step(shared, k, x, rate, metered)
                    else:
                        advance_tensioner_at(
                            x, rate, rollers.time_step(mine), metered, state, t, tensioner_at(ensemble, t)
                        )

    @wp.func
    def await_oil(shared: Shared):
        """Waits for tensioners' oil on the oil warp; all threads of the variant together."""
        if wp.static(kind.has_oil_warp):
            oil_warp.await_oil(shared.strokes)
            sync.barrier()  # before the next stroke

    @wp.func
    def end_oil_warp(shared: Shared, i: int):
        """Waits for tensioners' oil and ends the oil warp, if any."""
        await_oil(shared)
        if wp.static(kind.has_oil_warp):
            if i < wp.static(kind.parts.tensioners):
                oil_warp.set_request(shared.strokes, i, OVER)

    @wp.func
    def serve_tensioner(ensemble: Ensemble, state: State, shared: Shared, variant: int, k: int):
        """Advances the oil of a variant's tensioner k at each request, until the launch is over."""
        mine = thread_parts(ensemble.drives[variant], variant, k, -1)
        asked = oil_warp.request_of(shared.strokes, k)
        while asked != OVER:
            if asked != DONE:
                stroke = shared.strokes[k]
                t = ensemble.drives[variant].first_tensioner + k
                h, tensioner = rollers.time_step(mine), tensioner_at(ensemble, t)
                advance_tensioner_at(stroke.x, stroke.rate, h, asked == METERED, state, t, tensioner)
                oil_warp.set_request(shared.strokes, k, DONE)
            asked = oil_warp.request_of(shared.strokes, k)

    @wp.func
    def serve_variant(ensemble: Ensemble, state: State, shared: Shared, order: wp.array[wp.int32], number: int, k: int):
        """Advances the oil of tensioner `k`, if any, to the launch's end; whether the thread has no variant to step."""
        over = False
        if wp.static(kind.has_oil_warp):
            if k >= 0:
                shared.strokes[k].asked = DONE
            sync.block_barrier()
            over = k >= 0 or number >= order.shape[0]
            if k >= 0 and number < order.shape[0]:
                serve_tensioner(ensemble, state, shared, order[number], k)
            if over:
                oil_warp.end_thread()
        return over

    return TensionerFunctions(
        add_tensioner_forces=add_tensioner_forces,
        add_tensioner_step=add_tensioner_step,
        find_supplies=find_supplies,
        advance_tensioners=advance_tensioners,
        await_oil=await_oil,
        end_oil_warp=end_oil_warp,
        serve_variant=serve_variant,
    )
