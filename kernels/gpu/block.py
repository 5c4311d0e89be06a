"""The block kernel: one block of threads a variant, the whole time loop inside.

Thread i has the rollers i, i + threads, ...: one each where variants are few, all of the chain on one warp where they
are many, which then waits for no other. Rollers lie in shared rows. A few threads also take a body each on.
Whatever does not happen every step waits for the next event. One kernel is made for each `BlockKind`.

Where the code is long, several variants of a warp each share a block. Each is worked out as by itself; but
now and then they wait for each other, so that code which does not fit the instruction caches is fetched once for all.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..integrate import stages_of
from ..modules import own_module, uncontracted
from ..structs import Tallies
from .bodies import body_access, prescribed_motion
from .contact_pairs import contact_forces
from .contacts import wrench_parts
from .events import END, ENDS, block_sampling
from .hydraulics import block_tensioners, oil_warp
from .kind import WARP, BlockKind, Mine, inlined, mine_of
from .links import block_joints, link_forces
from .near import near_partners
from .observe import block_observing, block_strands
from .rings import block_rings
from .rollers import roller_rows
from .shared_memory import shared_arrays, view
from .stepping import advancing, touching, warp_steps
from .sync import sync


@cache
def launching(kind: BlockKind) -> SimpleNamespace:
    """The functions by which a launch begins and ends for a variant, and its loop goes from step to step."""
    Real, sprockets, measuring, staged = kind.Real, kind.parts.sprockets, kind.measuring, kind.staged
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared, Sums = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Sums
    row, observe, bodies, motions = roller_rows(kind), block_observing(kind), body_access(kind), prescribed_motion(kind)
    tensioners, leave = block_tensioners(kind), oil_warp(kind).leave
    find_strands, step_of, SPROCKETS = block_strands(kind).find_strands, row.step_of, near_partners(kind).SPROCKETS

    @wp.func
    def out_of(sums: Sums, tallies: Tallies, frames: wp.array[Real]):
        """Gathers the kernel's arguments for results."""
        out = Out()
        out.sums = sums
        out.tallies = tallies
        out.frames = frames
        return out

    @wp.func
    def driven(shared: Shared):
        """The sprockets whose moment moves them, as bits."""
        if wp.static(kind.moving):
            return SPROCKETS
        mask = int(0)
        for s in range(wp.static(sprockets)):
            if not motions.is_led(shared, s):
                mask = mask | (1 << s)
        return mask

    @wp.func
    def wanted(mine: Mine, now: Now):
        """Sets which sums this evaluation adds to: metrics at a step's start, and moments of which sprockets."""
        now.measured = 0
        if wp.static(measuring):
            now.weight = step_of(mine)
            if now.flags & ENDS != 0:
                now.weight = Real(0.5) * now.weight
            if now.stage == 0:
                now.measured = now.window
        else:
            now.summed = now.driven
            if now.flags != 0:
                now.summed = SPROCKETS
        return now

    @wp.func
    def instant(state: State, mine: Mine, begun: int):
        """Where a launch begins; the frames' buffer was begun at step `begun`."""
        now = Now()
        now.step = state.progress[mine.variant].step
        now.event = now.step
        now.diverged = state.progress[mine.variant].diverged
        now.going = 1
        now.begun = begun
        return now

    @wp.func
    def next_stage(now: Now):
        """The loop at the next stage or step; a variant that has diverged stays where it is."""
        if now.flags & END != 0:
            now.window = 0
        now.flags = 0
        if wp.static(staged):
            now.stage = now.stage + 1
        if (
            not wp.static(staged) or now.stage == stages_of(wp.static(kind.integrator)) or now.going == 0
        ) and now.diverged == 0:
            now.stage = 0
            now.step = now.step + 1
        return now

    @inlined
    def begin(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: Mine, step: int):
        """Shares bodies and sums, from the state."""
        if mine.body >= 0:
            bodies.start_body(ensemble, state, sums, shared, mine, step)
        if wp.static(measuring):
            observe.start_extremes(ensemble, sums, shared, mine)
            find_strands(ensemble, state, shared, mine)

    @wp.func
    def finish(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """Everything back into the state."""
        tensioners.end_oil(shared, mine.thread)
        if wp.static(measuring):
            observe.flush(out.tallies, shared, mine)
        row.put_back(state, shared, mine)
        if mine.body >= 0:
            bodies.end_body(ensemble, state, out.sums, shared, mine)
        if wp.static(measuring):
            observe.end_extremes(ensemble, out.sums, shared, mine)
        if mine.thread == 0:
            for r in range(wp.static(kind.parts.rings)):
                progress = state.progress[mine.variant + r]
                progress.step = now.step
                progress.diverged = now.diverged
                state.progress[mine.variant + r] = progress
        if wp.static(kind.shape.oil_warp):
            leave()

    return SimpleNamespace(**locals())


@cache
def block_kernel(kind: BlockKind, blocks: int, frame: Any) -> wp.Kernel:
    """The kernel for drives of a kind.

    Launch it with `dim` = variants * threads and `block_dim` = threads of all its variants. `blocks` is how many
    variants the compiler is to make room for on a multiprocessor; it bounds the registers of a thread. Frames lie as
    `frame` says (`frames.frame_writers`).
    """
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    measuring, staged = kind.measuring, kind.staged
    kinds = kind.types
    row, forces, motions = roller_rows(kind), contact_forces(kind), prescribed_motion(kind)
    on_event, sample_links = block_sampling(kind, frame).on_event, block_sampling(kind, frame).sample_links
    threads_of, barrier, body_of = sync(kind), sync(kind).barrier, wrench_parts(kind).body_of
    shared_of, lengths_of, remembered = shared_arrays(kind), view(Real), near_partners(kind).remembered
    rings, served, place_of = block_rings(kind), block_tensioners(kind).served, oil_warp(kind).place_of
    pull = block_joints(kind).pull if kind.friction.joints else link_forces(kind).pull
    loop, do, on_warp = launching(kind), advancing(kind, frame), warp_steps(kind, frame)
    touch_all = touching(kind, frame).touch_all
    # on several warps, which wait for each other, the next step's link forces are worked out while bodies move, and
    # what rollers may touch unless that depends on where the bodies are
    ahead = threads > WARP
    early = kind.early
    # rollers and bodies go ways of their own between events
    splitting = not measuring and kind.handing and early and not staged

    module = own_module(__file__, "advance_block", kind, blocks, frame)

    bounds = kind.shape.block_threads, max(blocks // kind.shape.variants_per_block, 1)

    @wp.kernel(enable_backward=False, module=module, grid_stride=False, launch_bounds=bounds)
    def advance_block(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: kinds.Sums,
        tallies: Tallies,
        frames: wp.array[Real],
        order: wp.array[wp.int32],
        ends: wp.array[wp.int32],
        begun: wp.array[wp.int32],
    ):
        """Takes variants `order[b]` on to before step `ends[b]`; the frames' buffer was begun at step `begun[b]`."""
        number, i, k = place_of(wp.tid())
        shared = shared_of(state, number)
        if served(ensemble, state, shared, order, number, k):
            return
        mine = rings.among(ensemble, shared, mine_of(ensemble.drives[order[number]], order[number], i, body_of(i)))
        shared.begins = rings.begins_of(shared)
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.shape.slots))  # and of no roller, beyond them
        out = loop.out_of(sums, tallies, frames)
        row.fetch(state, shared, mine)
        now = loop.instant(state, mine, begun[number])
        loop.begin(ensemble, state, sums, shared, mine, now.step)
        barrier()
        now.driven = loop.driven(shared)
        mine.course = motions.course_of(shared, mine.body)
        end = wp.min(ends[number], ensemble.drives[mine.variant].steps + 1)
        motions.plan(ensemble, shared, mine, now.step)
        if wp.static(ahead):
            tension, rate = pull(state, shared, mine, now, lengths)
        touch = forces.Touch()
        touch.near = remembered(state, shared, mine)
        if wp.static(early) and (wp.static(rollers_per_thread > 1) or i < mine.rollers):
            touch = on_warp.look(ensemble, state, shared, mine, now, touch)
        while now.step < end and now.diverged == 0:
            on_warp.wait_for_others(now)
            if wp.static(splitting) and now.step != now.event:
                now.summed = now.driven
                if i < wp.static(threads - WARP):
                    forces.contacts(ensemble, state, tallies, shared, mine, on_warp.plain(now), touch)
                    do.go_on(state, shared, mine, on_warp.plain(now))
                else:
                    do.load_moment_ahead(ensemble, shared, mine, now)
                    threads_of.taken_over()
                    do.advance_bodies(ensemble, state, out, shared, mine, on_warp.plain(now))
            else:
                if now.step == now.event and now.stage == 0:
                    now = on_event(ensemble, state, out, shared, mine, now)
                now = loop.wanted(mine, now)
                if wp.static(ahead):
                    if wp.static(not early):
                        touch = on_warp.look(ensemble, state, shared, mine, now, touch)
                    if wp.static(not measuring) and now.flags == 0:
                        touch_all(ensemble, state, out, shared, mine, on_warp.plain(now), touch)
                        do.load_moment_ahead(ensemble, shared, mine, now)
                        do.go_on(state, shared, mine, on_warp.plain(now))
                    else:
                        sample_links(state, shared, mine, now, lengths, tension, rate)
                        touch_all(ensemble, state, out, shared, mine, now, touch)
                        do.load_moment_ahead(ensemble, shared, mine, now)
                        if wp.static(kind.friction.joints) or now.flags != 0:
                            barrier()  # others may still be at rollers beside theirs
                            do.sample_rollers(ensemble, state, out, shared, mine, now)
                        do.go_on(state, shared, mine, now)
                    if wp.static(not kind.handing):
                        barrier()
                    do.advance_bodies(ensemble, state, out, shared, mine, now)
                elif wp.static(kind.twice) and on_warp.is_common(now):
                    now, touch = on_warp.to_event(ensemble, state, out, shared, mine, now, touch, end)
                    continue
                else:
                    touch = on_warp.step_of_a_warp(ensemble, state, out, shared, mine, now, touch)
            taken, now = now, loop.next_stage(now)
            if wp.static(early) and (wp.static(rollers_per_thread > 1) or i < mine.rollers):
                touch = on_warp.look(ensemble, state, shared, mine, now, touch)
            if wp.static(ahead) and now.step < end and now.diverged == 0:  # joints remember only steps that are taken
                tension, rate = pull(state, shared, mine, now, lengths)
            barrier()
            do.flow_apart(ensemble, state, shared, mine, taken)
        loop.finish(ensemble, state, out, shared, mine, now)

    return uncontracted(advance_block)
