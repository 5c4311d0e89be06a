"""Steps of one variant on a block: its rollers and bodies, from evaluated forces, and whole steps on one warp."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..native import moved
from ..sums import add_hub_force
from .bodies import block_bearings, body_access, body_steps
from .contact_pairs import contact_forces
from .contacts import wrench_parts
from .events import block_sampling
from .hydraulics import block_tensioners
from .jointed import block_jointed
from .kind import ENDS, EXTRA, WARP, BlockKind, Mine, inlined
from .links import block_joints, link_forces
from .near import near_partners
from .observe import body_observing
from .rollers import block_stages, roller_rows
from .shared_memory import view
from .sync import sync
from .trains import block_trains

MEETING = wp.constant(16)
"""Steps after which variants of a block wait for each other."""


@cache
def touching(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The function that evaluates the contacts."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2, of_each = kinds.vec2, wp.types.vector(rollers_per_thread, Real)
    forces, barrier, row = contact_forces(kind), sync(kind).barrier, roller_rows(kind)
    bodies, wrenches = body_steps(kind), wrench_parts(kind)
    tensioners, trains, bearings = block_tensioners(kind), block_trains(kind, frame), block_bearings(kind)
    moment_on, acting_on, wrench_of = wrenches.moment_on, wrenches.acting_on, wrenches.wrench_of
    carry, SPROCKETS = body_access(kind).carry, near_partners(kind).SPROCKETS

    @inlined
    def touch_all(
        ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now, touch: forces.Touch
    ):
        """Adds the contacts' forces, the lifts of valves shared before.

        All threads together, links' forces done.
        """
        if wp.static(kind.parts.valves > 0):
            trains.cams.share_lifts(ensemble, shared, mine)
        forces.contacts(ensemble, state, out.tallies, shared, mine, now, touch)

    return SimpleNamespace(**locals())


@cache
def advancing(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The functions that move the rollers and bodies of one variant on a block, and sample them."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    measuring, staged = kind.measuring, kind.staged
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    barrier = sync(kind).barrier
    row, bodies, wrenches = roller_rows(kind), body_steps(kind), wrench_parts(kind)
    sampling, tensioners, joints = block_sampling(kind, frame), block_tensioners(kind), block_jointed(kind)
    hang, add_friction = joints.hang, block_joints(kind).add_friction
    observe, threads_of, trains = body_observing(kind), sync(kind), block_trains(kind, frame)
    bearings = block_bearings(kind)
    acceleration, velocity, set_velocity, move = row.acceleration, row.velocity, row.set_velocity, row.move
    moment_on, acting_on, wrench_of = wrenches.moment_on, wrenches.acting_on, wrenches.wrench_of
    step_of, stage_roller, ahead = row.step_of, block_stages(kind), threads > WARP

    @wp.func
    def advance_rollers(state: State, shared: Shared, mine: Mine, now: Now):
        """The thread's rollers a step on, or a stage."""
        if wp.static(staged):
            j = int(mine.thread)
            while j < mine.rollers and now.going != 0:
                stage_roller(state, shared, mine, now, j)
                j = j + wp.static(threads)
        elif now.going != 0:
            h = step_of(mine)
            for k in range(wp.static(rollers_per_thread)):
                j = k * wp.static(threads) + mine.thread
                v = moved(velocity(shared.rows, j), h, acceleration(shared, j))
                set_velocity(shared, j, v)
                move(shared, j, h, v)

    @wp.func
    def chain_on(state: State, shared: Shared, mine: Mine, now: Now):
        """The chain's wrench on the thread's body, if it has one; all threads together.

        On one warp the rollers go on meanwhile, so that the threads do not wait for each other's sums.
        """
        moment = moment_on(shared, mine.thread)
        if wp.static(not ahead):
            advance_rollers(state, shared, mine, now)
        return acting_on(shared, mine.thread, moment, now.measured)

    @inlined
    def advance_body(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: Mine,
        now: Now,
        acting: of_three,
        whole: kinds.Wrench,
    ):
        """The thread's body a step on, or a stage, and what is seen of it.

        `acting` is what the chain does to it, `whole` the same with its bearing and tensioners.
        """
        before = shared.poses[mine.body]
        seen, whole = bodies.advance(ensemble, state, shared, mine, now, before, whole)
        if wp.static(measuring) and now.measured != 0:
            if mine.sprocket >= 0:
                observe.observe_sprocket(ensemble, shared, mine, now, before, seen, acting, whole)
                sums = shared.sprocket_sums[mine.sprocket]
                shared.sprocket_sums[mine.sprocket] = add_hub_force(sums, vec2(acting[1], acting[2]), now.weight)
            if wp.static(kind.parts.arms > 0):
                if mine.arm >= 0:
                    led = observe.leading_power(ensemble, shared, mine, now, before, seen, whole)
                    powers = vec2(led, observe.late_on(shared, mine, now, before, seen, acting))
                    observe.observe_arm(ensemble, out.sums, shared, mine, now, seen, acting[0], powers)
            if now.flags & ENDS != 0:
                observe.observe_energy(ensemble, out.tallies, shared, mine, now, before, seen)
            if wp.static(kind.parts.tensioners > 0):
                tensioners.observe_pushes(ensemble, state, out, mine, now, before, seen)
        if wp.static(kind.parts.hubs > 0):
            shared.turning[mine.body] = seen.speed
        sampling.write_body(ensemble, state, out.frames, mine, now, seen, acting[0], vec2(acting[1], acting[2]))

    @wp.func
    def flow(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now):
        """Takes the oil of the thread's body along with its step of `now`."""
        if wp.static(kind.parts.tensioners > 0):
            if mine.body >= 0:
                tensioners.flow(ensemble, state, shared, mine, now)

    @wp.func
    def flow_apart(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now):
        """`flow` on several warps, while other threads are at the next contacts."""
        if wp.static(ahead):
            flow(ensemble, state, shared, mine, now)

    @wp.func
    def advance_bodies(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """The thread's body a step on, or a stage, and what is seen of it; on one warp its rollers, too.

        All threads together work out what the chain does to it, while, on several warps, others move their rollers.
        """
        tensioners.await_oil(shared)
        if wp.static(kind.parts.fed > 0):
            if mine.body >= 0 and now.stage == 0:
                tensioners.feed(ensemble, state, shared, mine, bodies.time_of(mine, now))
            barrier()
        acting = hang(ensemble, shared, mine, chain_on(state, shared, mine, now))
        whole = bearings.rub(ensemble, state, shared, mine, now, wrench_of(acting))
        if wp.static(kind.parts.tensioners > 0):
            if mine.body >= 0:
                whole = tensioners.pushed(ensemble, state, mine, now.stage, shared.poses[mine.body], whole)
        if wp.static(kind.parts.tied > 0):
            trains.tie(ensemble, state, out, shared, mine, now, whole)
        if wp.static(kind.parts.jointed):
            joints.couple(ensemble, shared, mine, now, whole)
        if mine.body >= 0:
            advance_body(ensemble, state, out, shared, mine, now, acting, whole)
        if wp.static(kind.parts.jointed):
            barrier()
            joints.carry(ensemble, shared, mine, now.going)
        bearings.go_along(shared, mine, now)

    @wp.func
    def go_on(state: State, shared: Shared, mine: Mine, now: Now):
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
    def load_moment_ahead(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now):
        """Works out the load on the thread's body."""
        if mine.body >= 0 and now.stage == 0:
            bodies.load_moment_ahead(ensemble, shared, mine, now)

    @wp.func
    def sample_rollers(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now):
        """Samples the thread's rollers, whose forces are complete, where that is due."""
        if now.flags & EXTRA != 0 or (now.step == 0 and now.flags != 0):
            sampling.sample_rollers(ensemble, state, out, shared, mine, now)
        if wp.static(kind.friction.joints and measuring) and now.measured != 0:
            add_friction(shared, mine, now)

    return SimpleNamespace(**locals())


@cache
def warp_steps(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The functions that take a variant on one warp through whole steps."""
    Real, measuring = kind.Real, kind.measuring
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    forces, partners, lengths_of = contact_forces(kind), near_partners(kind), view(Real)
    sampling, step_of = block_sampling(kind, frame), roller_rows(kind).step_of
    pull = block_joints(kind).pull if kind.friction.joints else link_forces(kind).pull
    do, threads_of, barrier = advancing(kind, frame), sync(kind), sync(kind).barrier
    touch_all = touching(kind, frame).touch_all
    sample_rollers, advance_bodies = do.sample_rollers, do.advance_bodies

    @wp.func
    def look(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now, touch: forces.Touch):
        """The partners that the thread's rollers may touch, from those of the step before in `touch`."""
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
    def plain(now: Now):
        """A step at which nothing is wanted but forces and motion: so the compiler leaves out what else there is."""
        now.flags = 0
        now.going = 1
        return now

    @wp.func
    def common(mine: Mine, now: Now):
        """Such a step, so that the compiler leaves out what others want: it would stand between what all do."""
        now.measured = wp.static(int(measuring))
        now.weight = step_of(mine)
        now.summed = now.driven
        return plain(now)

    @inlined
    def step_of_a_warp(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: Mine,
        now: Now,
        touch: forces.Touch,
    ):
        """A whole step or stage of a variant on one warp, as `look` has `touch`."""
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.shape.slots))
        # first, so that both read places of rollers once, and nothing branches while they wait for them
        touch = look(ensemble, state, shared, mine, now, touch)
        tension, rate = pull(state, shared, mine, now, lengths)
        # before anything else, so that tensions and rates do not stay in registers any longer
        sampling.sample_links(state, shared, mine, now, lengths, tension, rate)
        touch_all(ensemble, state, out, shared, mine, now, touch)
        barrier()
        sample_rollers(ensemble, state, out, shared, mine, now)
        advance_bodies(ensemble, state, out, shared, mine, now)
        do.flow(ensemble, state, shared, mine, now)
        return touch

    @wp.func
    def wait_for_others(now: Now):
        """Waits now and then for the block's other variants, so that all go through the same code at the same time."""
        if wp.static(kind.shape.variants_per_block > 1 and not kind.shape.oil_warp) and now.step % MEETING == 0:
            threads_of.together()

    @inlined
    def to_event(
        ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now, touch: forces.Touch, end: int
    ):
        """Steps of a variant on one warp that want no more than most do, `now` being one: to an event, or to `end`."""
        now = common(mine, now)
        end = wp.min(end, now.event)
        while True:
            touch = step_of_a_warp(ensemble, state, out, shared, mine, now, touch)
            now.step = now.step + 1
            barrier()
            if now.step >= end:
                break
            wait_for_others(now)
        return now, touch

    return SimpleNamespace(**locals())
