"""The block kernel: one block of threads a variant, the whole time loop inside.

Thread i has the rollers i, i + threads, ...: one each where variants are few, all of the chain on one warp where they
are many, which then waits for no other. Rollers lie in shared rows. A few threads also take a body each on.
Whatever does not happen every step waits for the next event. One kernel is made for each `BlockKind`.

Where the code is long, several variants of a warp each lie abreast in one block. Each is worked out as by itself; but
now and then they wait for each other, so that code which does not fit the instruction caches is fetched once for all.
"""

from functools import cache
from typing import Any

import warp as wp

from ..modules import own_module
from ..structs import types
from ..sum_structs import Sums, Tallies
from ..sums import WATCH_EVERY, add_hub_force, watch_weight
from .arms import block_arms
from .bodies import Seen, block_bodies
from .events import END, ENDS, EXTRA, START
from .forces import contact_forces
from .joints import block_joints
from .kind import WARP, BlockKind, Mine, mine_of, now_struct
from .link_forces import link_forces
from .near import near_partners
from .observe import block_observing
from .rk4 import block_rk4
from .roller_rows import roller_rows
from .sampling import block_sampling
from .shared_memory import shared_arrays, view
from .strands import block_strands
from .sync import sync
from .wheels import seen_wheel
from .wrench import wrench_parts

MEETING = wp.constant(16)
"""Steps after which variants abreast wait for each other."""


@cache
def block_kernel(kind: BlockKind, blocks: int, frame: Any) -> wp.Kernel:
    """The kernel for drives of a kind.

    Launch it with `dim` = variants * threads and `block_dim` = threads of all variants abreast. `blocks` is how many
    variants the compiler is to make room for on a multiprocessor; it bounds the registers of a thread. Frames lie as
    `frame` says (`frames.frame_writers`).
    """
    Real, threads, rollers_per_thread, sprockets = kind.Real, kind.threads, kind.rollers_per_thread, kind.sprockets
    moving, measuring, rk4 = kind.moving, kind.measuring, kind.rk4
    kinds, Now = types(Real), now_struct(Real)
    vec2, of_three, of_each = kinds.vec2, wp.types.vector(3, Real), wp.types.vector(rollers_per_thread, Real)
    row, forces, bodies = roller_rows(kind), contact_forces(kind), block_bodies(kind)
    sampling, partners = block_sampling(kind, frame), near_partners(kind)
    threads_of, barrier = sync(kind), sync(kind).barrier
    shared_of, lengths_of = shared_arrays(kind), view(Real)
    joints, arms = block_joints(kind), block_arms(kind)
    pull = joints.pull if kind.joint_friction else link_forces(kind).pull
    acceleration, velocity = row.acceleration, row.velocity
    set_velocity, move = row.set_velocity, row.move
    SPROCKETS, wrenches = partners.SPROCKETS, wrench_parts(kind)
    moment_on, acting_on = wrenches.moment_on, wrenches.acting_on
    wrench_of, body_of = wrenches.wrench_of, wrenches.body_of
    observe, step_of, find_strands = block_observing(kind), row.step_of, block_strands(kind).find_strands
    stage_roller = block_rk4(kind)
    # on several warps, which wait for each other, the next step's link forces are worked out while bodies move, and
    # what rollers may touch unless that depends on where the bodies are
    ahead = threads > WARP
    early = kind.early
    # what steps without a frame do stands in the code a second time, so that nothing stands between its parts that only
    # frames want: on several warps the contacts, on one all of it
    twice = not rk4
    # rollers and bodies go ways of their own between events
    splitting = not measuring and kind.handing and early and not rk4

    @wp.struct
    class Out:
        """Where goes what is taken from the steps."""

        sums: Sums
        tallies: Tallies
        frames: wp.array[Real]

    @wp.func
    def out_of(sums: Sums, tallies: Tallies, frames: wp.array[Real]):
        """What the kernel was given for that."""
        out = Out()
        out.sums = sums
        out.tallies = tallies
        out.frames = frames
        return out

    @wp.func
    def driven(shared: kinds.Shared):
        """The sprockets whose moment moves them, as bits."""
        if wp.static(moving):
            return SPROCKETS
        mask = int(0)
        for s in range(wp.static(sprockets)):
            if not bodies.is_led(shared, s):
                mask = mask | (1 << s)
        return mask

    @wp.func
    def wanted(mine: Mine, now: Now):
        """What is wanted of this evaluation: metrics at a step's start, and whose moments."""
        now.common = 0
        now.measured = 0
        now.watched = 0
        if wp.static(measuring):
            now.weight = step_of(mine)
            if now.flags & ENDS != 0:
                now.weight = Real(0.5) * now.weight
            now.watch_weight = watch_weight(step_of(mine))
            if now.stage == 0:
                now.measured = now.window
                if now.step % WATCH_EVERY == 0 or now.flags & START != 0:
                    now.watched = now.window
        else:
            now.summed = now.driven
            if now.flags != 0:
                now.summed = SPROCKETS
        return now

    @wp.func
    def plain(now: Now):
        """A step at which nothing is wanted but forces and motion: so the compiler leaves out what else there is."""
        now.flags = 0
        now.going = 1
        return now

    @wp.func
    def add_hub(shared: kinds.Shared, mine: Mine, now: Now, acting: wp.types.vector(3, Real)):
        """Adds the chain's force on the thread's sprocket to its sums."""
        hub = vec2(acting[1], acting[2])
        sums = shared.sprocket_sums[mine.sprocket]
        if wp.static(kind.paired):
            shared.sprocket_sums[mine.sprocket] = add_hub_force(sums, hub, now.watch_weight)
        else:
            force = wp.vec2d(wp.float64(hub[0]), wp.float64(hub[1]))
            shared.sprocket_sums[mine.sprocket] = add_hub_force(sums, force, wp.float64(now.watch_weight))

    @wp.func
    def advance_rollers(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now):
        """The thread's rollers a step on, or a stage."""
        if wp.static(rk4):
            j = int(mine.thread)
            while j < mine.rollers and now.going != 0:
                stage_roller(state, shared, mine, now, j)
                j = j + wp.static(threads)
        elif now.going != 0:
            h = step_of(mine)
            for k in range(wp.static(rollers_per_thread)):
                j = k * wp.static(threads) + mine.thread
                v = velocity(shared.rows, j) + h * acceleration(shared, j)
                set_velocity(shared, j, v)
                move(shared, j, h * v[0], h * v[1])

    @wp.func
    def chain_on(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now):
        """What the chain does to the thread's body, if it has one; all threads together.

        On one warp the rollers go on meanwhile, so that the threads do not wait for each other's sums.
        """
        moment = moment_on(shared, mine.thread)
        if wp.static(not ahead):
            advance_rollers(state, shared, mine, now)
        return acting_on(shared, mine.thread, moment, now.watched)

    @wp.func
    def advance_exact(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        out: Out,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """`advance_bodies` at float64."""
        acting = chain_on(state, shared, mine, now)
        if mine.sprocket >= 0:
            if wp.static(not ahead):
                load_moment_ahead(ensemble, shared, mine, now)
            before = shared.poses[mine.sprocket]
            wrench = wrench_of(acting)
            if wp.static(kind.tensioners > 0):
                wrench = arms.pushed(ensemble, state, shared, mine, mine.sprocket, wrench)
            body = bodies.advance(ensemble, state, shared, mine, now, wrench)
            if wp.static(measuring) and now.measured != 0:
                observe.observe_sprocket(ensemble, out.tallies, shared, mine, now, body, wrench, before)
                if now.watched != 0:
                    add_hub(shared, mine, now, acting)
                if wp.static(kind.tensioners > 0):
                    arms.observe_pushes(ensemble, state, out.sums, out.tallies, mine, now, mine.sprocket, body)
            sampling.write_sprocket_frame(ensemble, state, out.frames, mine, now, body, wrench.moment)
            if wp.static(kind.tensioners > 0):
                sampling.write_push_frames(ensemble, state, out.frames, shared, mine, now, mine.sprocket)
                arms.flow(ensemble, state, shared, mine, now, mine.sprocket)
        if wp.static(kind.arms > 0):
            if mine.arm >= 0:
                on_arm = wrench_of(acting)
                arm = arms.advance_arm(ensemble, state, out.sums, out.tallies, shared, mine, now, on_arm)
                b = wp.static(sprockets) + mine.arm
                sampling.write_arm_frame(ensemble, state, out.frames, mine, now, arm, on_arm.moment)
                sampling.write_push_frames(ensemble, state, out.frames, shared, mine, now, b)

    @wp.func
    def advance_paired(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        out: Out,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """`advance_bodies` at float32."""
        acting = chain_on(state, shared, mine, now)
        b = int(mine.sprocket)
        if mine.arm >= 0:
            b = wp.static(sprockets) + mine.arm
        if b >= 0:
            wheel = seen_wheel(shared.wheels, b)
            pushing = of_three()
            if wp.static(kind.tensioners > 0):
                pushing = arms.pushed(ensemble, shared, mine, b)
            seen = Seen()
            if mine.sprocket >= 0:
                seen = bodies.spin(ensemble, shared, mine, now, acting + pushing)
                seen.pushing = pushing
                if wp.static(measuring) and now.measured != 0:
                    observe.observe_spin(ensemble, out.tallies, shared, mine, now, seen, acting, wheel)
                    if now.watched != 0:
                        add_hub(shared, mine, now, acting)
                sampling.write_sprocket_frame(ensemble, state, out.frames, mine, now, seen, acting[0])
            if wp.static(kind.arms > 0):
                if mine.arm >= 0:
                    seen = arms.advance_arm(ensemble, shared, mine, now, acting[0] + pushing[0])
                    if wp.static(measuring) and now.measured != 0:
                        arms.observe_arm(ensemble, out.tallies, shared, mine, now, seen, acting[0], wheel)
                    sampling.write_arm_frame(ensemble, state, out.frames, mine, now, seen, acting[0])
            if wp.static(kind.tensioners > 0):
                if wp.static(measuring) and now.measured != 0:
                    arms.observe_pushes(ensemble, out.sums, out.tallies, shared, mine, now, wheel, seen)
                sampling.write_push_frames(ensemble, state, out.frames, shared, mine, now, b)
                arms.flow(ensemble, shared, mine, now, b)

    @wp.func
    def advance_bodies(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        out: Out,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """The thread's body a step on, or a stage, and what is seen of it; on one warp its rollers, too.

        All threads together work out what the chain does to it, while, on several warps, others move their rollers.
        """
        if wp.static(kind.paired):
            advance_paired(ensemble, state, out, shared, mine, now)
        else:
            advance_exact(ensemble, state, out, shared, mine, now)

    @wp.func
    def go_on(state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now):
        """The thread's rollers a step on, their contacts done; a warp that moves bodies does not wait for that."""
        if wp.static(kind.handing):
            if mine.thread < wp.static(threads - WARP):
                threads_of.hand_over()
                advance_rollers(state, shared, mine, now)
                threads_of.among_rollers()
            else:
                threads_of.taken_over()
        else:
            advance_rollers(state, shared, mine, now)

    @wp.func
    def load_moment_ahead(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now):
        """Works out the load on the thread's sprocket."""
        if mine.sprocket >= 0 and now.stage == 0:
            bodies.load_moment_ahead(ensemble, shared, mine, now)

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
        """What is wanted of the thread's rollers, whose forces are complete."""
        if now.flags & EXTRA != 0 or (now.step == 0 and now.flags != 0):
            sampling.sample_rollers(ensemble, state, tallies, shared, frames, mine, now)
        if wp.static(kind.joint_friction and measuring) and now.measured != 0:
            joints.add_friction(shared, mine, now)

    @wp.func
    def look(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: forces.Touch,
    ):
        """What the thread's rollers may touch, of which `touch` is what they were near at the step before."""
        near = partners.update_near(state, shared, mine, now, touch.near)
        return forces.touch_of(ensemble, state, shared, mine, near)

    @wp.func
    def is_common(now: Now):
        """Whether a step is neither the first nor the last, without a frame, and not at the window's ends."""
        whole = now.going != 0 and now.step != 0 and now.flags & EXTRA == 0
        if wp.static(measuring):
            return whole and now.measured != 0
        else:
            return whole

    @wp.func
    def common(mine: Mine, now: Now):
        """Such a step, so that the compiler leaves out what others want: it would stand between what all do."""
        now.measured = wp.static(int(measuring))
        now.weight = step_of(mine)
        now.summed = now.driven
        now.common = 1
        return plain(now)

    @wp.func
    def step_of_a_warp(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        out: Out,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: forces.Touch,
        rates: of_each,
    ):
        """A whole step or stage of a variant on one warp, as `look` has `touch`.

        A step that wants no more than most do adds its links' squared rates to `rates`, if these are carried on.
        """
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.slots))
        # first, so that both read places of rollers once, and nothing branches while they wait for them
        touch = look(ensemble, state, shared, mine, now, touch)
        tension, rate = pull(shared, lengths, mine.rollers, mine.thread)
        # before anything else, so that tensions and rates do not stay in registers any longer
        sampling.sample_links(state, shared, mine, now, lengths, tension, rate)
        if wp.static(kind.carrying) and now.common != 0:
            rates = observe.with_rates(rates, rate, now.weight)
        if wp.static(not measuring) and now.common != 0:
            forces.plain_contacts(ensemble, state, out.tallies, shared, mine, now, touch)
        else:
            forces.contacts(ensemble, state, out.tallies, shared, mine, now, touch)
        barrier()
        sample_rollers(ensemble, state, out.tallies, shared, out.frames, mine, now)
        advance_bodies(ensemble, state, out, shared, mine, now)
        return touch, rates

    @wp.func
    def wait_for_others(now: Now):
        """Waits now and then for the variants abreast, so that all go through the same code at the same time."""
        if wp.static(kind.variants_per_block > 1) and now.step % MEETING == 0:
            threads_of.together()

    @wp.func
    def to_event(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        out: Out,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        touch: forces.Touch,
        end: int,
    ):
        """Steps of a variant on one warp that want no more than most do, `now` being one: to an event, or to `end`."""
        now = common(mine, now)
        end = wp.min(end, now.event)
        rates = of_each()
        if wp.static(kind.carrying):
            rates = observe.rates_of(shared, mine.thread)
        while True:
            touch, rates = step_of_a_warp(ensemble, state, out, shared, mine, now, touch, rates)
            now.step = now.step + 1
            barrier()
            if now.step >= end:
                break
            wait_for_others(now)
            if wp.static(measuring):
                now.watched = wp.where(now.step % WATCH_EVERY == 0, 1, 0)
        if wp.static(kind.carrying):
            observe.set_rates(shared, mine.thread, rates)
        return now, touch

    @wp.func
    def instant(state: kinds.State, mine: Mine, since: int):
        """Where a launch begins, `since` steps after the frames' buffer."""
        now = Now()
        now.step = state.progress[mine.variant].step
        now.event = now.step
        now.diverged = state.progress[mine.variant].diverged
        now.going = 1
        now.since = since
        return now

    @wp.func
    def standing(shared: kinds.Shared, now: Now):
        """With what a launch does not change: the sprockets that their moment moves, and those with the usual laws."""
        now.driven = driven(shared)
        now.linear_hysteretic = forces.linear_hysteretic_laws(shared)
        return now

    @wp.func
    def next_stage(now: Now):
        """The loop at the next stage or step; a variant that has diverged stays where it is."""
        if now.flags & END != 0:
            now.window = 0
        now.flags = 0
        if wp.static(rk4):
            now.stage = now.stage + 1
        if (not wp.static(rk4) or now.stage == 4 or now.going == 0) and now.diverged == 0:
            now.stage = 0
            now.step = now.step + 1
        return now

    @wp.func
    def begin(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        shared: kinds.Shared,
        mine: Mine,
        step: int,
    ):
        """What is shared of bodies and sums, from the state."""
        if mine.sprocket >= 0:
            bodies.start_body(ensemble, state, sums, shared, mine, step)
            if wp.static(kind.paired and kind.tensioners > 0):
                arms.start_tensioners(ensemble, state, sums, shared, mine, mine.sprocket)
        if wp.static(measuring):
            observe.start_extremes(ensemble, sums, shared, mine)
            find_strands(ensemble, state, shared, mine)
        if wp.static(kind.arms > 0):
            if mine.arm >= 0:
                if wp.static(kind.paired):
                    arms.start_arm(ensemble, state, sums, shared, mine)
                else:
                    arms.start_arm(ensemble, state, shared, mine)

    @wp.func
    def finish(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
    ):
        """Everything back into the state."""
        if wp.static(measuring):
            observe.flush(tallies, shared, mine)
        row.put_back(state, shared, mine)
        if mine.sprocket >= 0:
            bodies.end_body(ensemble, state, sums, shared, mine)
            if wp.static(kind.paired and kind.tensioners > 0):
                arms.end_tensioners(ensemble, state, sums, shared, mine, mine.sprocket)
        if wp.static(measuring):
            observe.end_extremes(ensemble, sums, shared, mine)
        if wp.static(kind.arms > 0):
            if mine.arm >= 0:
                if wp.static(kind.paired):
                    arms.end_arm(ensemble, state, sums, shared, mine)
                else:
                    arms.end_arm(ensemble, state, shared, mine)
        if mine.thread == 0:
            progress = state.progress[mine.variant]
            progress.step = now.step
            progress.diverged = now.diverged
            state.progress[mine.variant] = progress

    module = own_module(__file__, "advance_block", kind, blocks, frame)

    bounds = kind.block_threads, max(blocks // kind.variants_per_block, 1)

    @wp.kernel(enable_backward=False, module=module, grid_stride=False, launch_bounds=bounds)
    def advance_block(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        frames: wp.array[Real],
        order: wp.array[wp.int32],
        steps: int,
        since: int,
    ):
        """Variants `order[b]`, each on threads of its own: `steps` steps on, sums and frames written on the way.

        The frames' buffer was begun `since` steps before this launch.
        """
        number = wp.tid() // wp.static(threads)
        i = wp.tid() % wp.static(threads)
        mine = mine_of(ensemble.drives[order[number]], order[number], i, body_of(i))
        shared = shared_of(state, number)
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.slots))  # threads without a roller read on
        out = out_of(sums, tallies, frames)
        row.fetch(state, shared, mine)
        now = instant(state, mine, since)
        begin(ensemble, state, sums, shared, mine, now.step)
        barrier()
        now = standing(shared, now)
        mine.course = bodies.course_of(shared, mine.sprocket)
        end = wp.min(now.step + steps, ensemble.drives[mine.variant].steps + 1)
        bodies.plan(ensemble, shared, mine, now.step)
        if wp.static(ahead):
            tension, rate = pull(shared, lengths, mine.rollers, i)
        touch = forces.Touch()
        touch.near = partners.remembered(state, mine)
        if wp.static(early) and (wp.static(rollers_per_thread > 1) or i < mine.rollers):
            touch = look(ensemble, state, shared, mine, now, touch)
        while now.step < end and now.diverged == 0:
            wait_for_others(now)
            if wp.static(splitting) and now.step != now.event:
                now.summed = now.driven
                if i < wp.static(threads - WARP):
                    forces.plain_contacts(ensemble, state, tallies, shared, mine, plain(now), touch)
                    go_on(state, shared, mine, plain(now))
                else:
                    load_moment_ahead(ensemble, shared, mine, now)
                    threads_of.taken_over()
                    advance_bodies(ensemble, state, out, shared, mine, plain(now))
            else:
                if now.step == now.event and now.stage == 0:
                    now = sampling.on_event(ensemble, state, sums, tallies, shared, mine, now)
                now = wanted(mine, now)
                if wp.static(ahead):
                    if wp.static(not early):
                        touch = look(ensemble, state, shared, mine, now, touch)
                    if wp.static(not measuring) and now.flags == 0:
                        forces.plain_contacts(ensemble, state, tallies, shared, mine, plain(now), touch)
                        load_moment_ahead(ensemble, shared, mine, now)
                        go_on(state, shared, mine, plain(now))
                    else:
                        sampling.sample_links(state, shared, mine, now, lengths, tension, rate)
                        forces.contacts(ensemble, state, tallies, shared, mine, now, touch)
                        load_moment_ahead(ensemble, shared, mine, now)
                        if wp.static(kind.joint_friction) or now.flags != 0:
                            barrier()  # others may still be at rollers beside theirs
                            sample_rollers(ensemble, state, tallies, shared, frames, mine, now)
                        go_on(state, shared, mine, now)
                    if wp.static(not kind.handing):
                        barrier()
                    advance_bodies(ensemble, state, out, shared, mine, now)
                elif wp.static(twice) and is_common(now):
                    now, touch = to_event(ensemble, state, out, shared, mine, now, touch, end)
                    continue
                else:
                    touch, _ = step_of_a_warp(ensemble, state, out, shared, mine, now, touch, of_each())
            now = next_stage(now)
            if wp.static(early) and (wp.static(rollers_per_thread > 1) or i < mine.rollers):
                touch = look(ensemble, state, shared, mine, now, touch)
            if wp.static(ahead):
                tension, rate = pull(shared, lengths, mine.rollers, i)
            barrier()
        finish(ensemble, state, sums, tallies, shared, mine, now)

    return advance_block
