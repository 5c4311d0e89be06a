"""Tensioners on blocks of threads: what they do to the body that they push, and how their oil goes on.

The oil wants no more than where its plunger is, and nothing wants it before the next step's contacts are done. So where
many variants share a block, a warp of its own takes the oil of all of them on, a tensioner a thread, while the others
are at the next step: by itself a thread would have its whole warp wait. They wait for each other by a number that
stands beside each stroke.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import stages_of
from ..native import by_device
from ..number import leading
from ..physics.tensioner import (
    advance_tensioner,
    extension_and_rate,
    extension_rate,
    plunger_arm,
    plunger_losses,
    supply_pressure,
    tensioner_energy,
    tensioner_push,
)
from ..sums import add_energy, add_flows, add_meter, add_tensioner
from .kind import END, ENDS, START, BlockKind, Mine, mine_of
from .rings import block_rings
from .rollers import roller_rows
from .sync import sync

DONE = wp.constant(0)
"""Requests of a stroke to the warp that has the oil: none,"""
STEP = wp.constant(1)  # a step,
METERED = wp.constant(2)  # one whose energies are wanted,
OVER = wp.constant(-1)  # and no more of them in this launch

NOWHERE = wp.constant(1 << 30)
"""A place in a block that is of no variant, and of no launch."""

ASKED = "*(volatile int*)&strokes.data[k].asked"
REQUEST = by_device(f"__threadfence_block(); {ASKED} = what;", "strokes.data[k].asked = what;")
REQUESTED = by_device(
    f"const int what = {ASKED}; __threadfence_block(); return what;",
    "WP_TILE_SYNC(); return strokes.data[k].asked;",
)
LEAVE = """
    static int left = 0;
    const int all = (left / COUNT + 1) * COUNT;
    ++left;
    while (left < all) WP_TILE_SYNC();
"""
AWAIT = by_device(
    f"for (int k = 0; k < COUNT; ++k) while ({ASKED} > 0);\n__threadfence_block(); __syncwarp();",
    "for (int k = 0; k < COUNT; ++k) while (strokes.data[k].asked > 0) WP_TILE_SYNC();",
)


@cache
def oil_warp(kind: BlockKind) -> SimpleNamespace:
    """The functions by which the variants of a block and the warp that has their oil wait for each other."""
    kinds, variants, tensioners = kind.types, kind.shape.variants_per_block, kind.parts.tensioners
    Ensemble, State, Shared, Stroke = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Stroke

    @wp.func
    def place_of(tid: int):
        """The number of a thread's variant in its launch, its own number there, and of the oil's warp the number of
        the tensioner whose oil it has, else -1.
        """
        block = tid // wp.static(kind.shape.block_threads)
        at = tid - block * wp.static(kind.shape.block_threads)
        place = at // wp.static(kind.shape.threads)
        i = at - place * wp.static(kind.shape.threads)
        k = int(-1)
        if wp.static(kind.shape.oil_warp):
            if place == wp.static(variants):
                place = i // wp.static(tensioners)
                k = i - place * wp.static(tensioners)
                if place >= wp.static(variants):
                    place, k = NOWHERE, -1
        return block * wp.static(variants) + place, i, k

    @wp.func_native(REQUEST)
    def request(strokes: wp.array[Stroke], k: int, what: int):
        """Sets the request of a stroke, once all that was written before is there for others."""

    @wp.func_native(REQUESTED)
    def requested(strokes: wp.array[Stroke], k: int) -> int:
        """The request that a stroke has; on fibers the others go on meanwhile."""

    @wp.func_native(AWAIT.replace("COUNT", str(tensioners)))
    def await_oil(strokes: wp.array[Stroke]):
        """Waits until the oil of all of a variant's tensioners has been taken along; all its threads together."""

    @wp.func_native(by_device("", LEAVE.replace("COUNT", str(kind.shape.block_threads))))
    def leave():
        """Ends a thread of the block; fibers, whose barriers do not bear that one ends before others, end together."""

    @wp.func
    def ask(shared: Shared, k: int, x: kinds.Number, rate: kinds.Real, metered: bool):
        """Has the oil of the variant's tensioner k taken along with its stroke."""
        shared.strokes[k].x = x
        shared.strokes[k].rate = rate
        request(shared.strokes, k, wp.where(metered, METERED, STEP))

    return SimpleNamespace(**locals())


@cache
def block_tensioners(kind: BlockKind) -> SimpleNamespace:
    """The functions of one variant's tensioners on a block."""
    tensioners_of, body_of = block_rings(kind).tensioners_of, block_rings(kind).body_of
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose
    oil, step_of = oil_warp(kind), roller_rows(kind).step_of
    ask, request, requested = oil.ask, oil.request, oil.requested
    barrier, together = sync(kind).barrier, sync(kind).together

    @wp.func
    def tensioner_at(ensemble: Ensemble, t: int):
        """Tensioner t of all."""
        tensioner = ensemble.tensioners[t]
        if wp.static(kind.parts.oil == 0):
            tensioner.hydraulic = 0  # so that the compiler knows
        return tensioner

    @wp.func
    def pushed(ensemble: Ensemble, state: State, mine: Mine, stage: int, pose: Pose, wrench: kinds.Wrench):
        """The wrench on the thread's body, at `pose` in a stage, with what its tensioners do to it."""
        kept = True
        if wp.static(kind.staged):
            kept = stage == 0
        drive = ensemble.drives[mine.row]
        for t in range(drive.first_tensioner, drive.first_tensioner + tensioners_of(drive)):
            tensioner = tensioner_at(ensemble, t)
            if tensioner.body == mine.number:
                push = tensioner_push(pose, kept, state.tensioners[t], tensioner)
                state.pushes[t] = push
                wrench.force = wrench.force + push.thrust
                wrench.moment = wrench.moment + push.moment
        return wrench

    @wp.func
    def observe_pushes(
        ensemble: Ensemble,
        state: State,
        out: kinds.Out,
        mine: Mine,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
    ):
        """One step of the tensioners of the thread's body for the window's sums.

        `before` is where the body was, `seen` has its rates at the step's instant.
        """
        drive = ensemble.drives[mine.row]
        for t in range(drive.first_tensioner, drive.first_tensioner + tensioners_of(drive)):
            tensioner = tensioner_at(ensemble, t)
            if tensioner.body == mine.number:
                push = state.pushes[t]
                rate = extension_rate(leading(plunger_arm(before, tensioner)), seen.speed, seen.velocity, tensioner)
                power, suction = plunger_losses(push, rate, state.tensioners[t], tensioner)
                sums = out.sums.tensioner[t]
                out.sums.tensioner[t] = add_tensioner(sums, push, power, suction, now.weight)
                if now.flags & ENDS != 0:
                    start, end = now.flags & START != 0, now.flags & END != 0
                    out.sums.tensioner[t] = add_meter(out.sums.tensioner[t], state.meters[t], start, end)
                    energy = wp.float64(tensioner_energy(push.extension, push.pressure, state.tensioners[t], tensioner))
                    at = drive.first_body + mine.number
                    out.tallies.body[at] = add_energy(out.tallies.body[at], now.flags & START != 0, energy)

    @wp.func
    def feed(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, time: kinds.Number):
        """Finds what tabulated supplies of the tensioners of the thread's body have at a step's start [s].

        No body moves meanwhile: what turns a pump is another thread's.
        """
        drive = ensemble.drives[mine.row]
        for t in range(drive.first_tensioner, drive.first_tensioner + tensioners_of(drive)):
            tensioner = ensemble.tensioners[t]
            if tensioner.body == mine.number and tensioner.supply_table.cells > 0:
                pump = body_of(ensemble, shared, mine.row, mine.row - mine.variant, tensioner.pump)
                forward = ensemble.motions[drive.first_body + tensioner.pump].sign * leading(shared.poses[pump].speed)
                state.tensioners[t].supply = supply_pressure(time, forward, tensioner, ensemble.tables)

    @wp.func
    def take_along(
        ensemble: Ensemble, state: State, t: int, x: kinds.Number, rate: kinds.Real, h: kinds.Real, metered: bool
    ):
        """Takes the oil of tensioner t of all a step of `h` [s] on, after a stroke to `x` [m] at `rate` [m/s]."""
        tensioner = tensioner_at(ensemble, t)
        if wp.static(kind.parts.fed > 0):
            if tensioner.supply_table.cells > 0:
                tensioner.supply = state.tensioners[t].supply
        after, flows = advance_tensioner(x, rate, h, metered, state.tensioners[t], tensioner)
        state.tensioners[t] = after
        state.meters[t] = add_flows(state.meters[t], flows)

    @wp.func
    def flow(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now):
        """Takes the tensioners of the thread's body along with its step, once it has moved."""
        if now.going != 0 and now.stage == stages_of(wp.static(kind.integrator)) - 1:
            drive = ensemble.drives[mine.row]
            for t in range(drive.first_tensioner, drive.first_tensioner + tensioners_of(drive)):
                tensioner = ensemble.tensioners[t]
                if tensioner.body == mine.number:
                    x, rate = extension_and_rate(shared.poses[mine.body], tensioner)
                    metered = wp.static(kind.measuring) and now.window != 0
                    if wp.static(kind.shape.oil_warp):
                        k = t - ensemble.drives[mine.variant].first_tensioner
                        ask(shared, k, x, rate, metered)
                    else:
                        take_along(ensemble, state, t, x, rate, step_of(mine), metered)

    @wp.func
    def await_oil(shared: Shared):
        """Waits for the oil, where another warp has it; all threads of the variant together."""
        if wp.static(kind.shape.oil_warp):
            oil.await_oil(shared.strokes)
            barrier()  # before the next stroke

    @wp.func
    def end_oil(shared: Shared, i: int):
        """Waits for the oil and lets its warp go, where it has one."""
        await_oil(shared)
        if wp.static(kind.shape.oil_warp):
            if i < wp.static(kind.parts.tensioners):
                request(shared.strokes, i, OVER)

    @wp.func
    def serve(ensemble: Ensemble, state: State, shared: Shared, variant: int, k: int):
        """Takes the oil of a variant's tensioner k along, whenever that is asked for, until the launch is over."""
        mine = mine_of(ensemble.drives[variant], variant, k, -1)
        asked = requested(shared.strokes, k)
        while asked != OVER:
            if asked != DONE:
                stroke = shared.strokes[k]
                t = ensemble.drives[variant].first_tensioner + k
                take_along(ensemble, state, t, stroke.x, stroke.rate, step_of(mine), asked == METERED)
                request(shared.strokes, k, DONE)
            asked = requested(shared.strokes, k)

    @wp.func
    def served(ensemble: Ensemble, state: State, shared: Shared, order: wp.array[wp.int32], number: int, k: int):
        """Whether a thread has no part in a variant; if `k` is not negative it has taken a tensioner's oil along."""
        over = False
        if wp.static(kind.shape.oil_warp):
            if k >= 0:
                shared.strokes[k].asked = DONE
            together()
            over = k >= 0 or number >= order.shape[0]
            if k >= 0 and number < order.shape[0]:
                serve(ensemble, state, shared, order[number], k)
            if over:
                oil.leave()
        return over

    return SimpleNamespace(**locals())
