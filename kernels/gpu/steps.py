"""Steps of one variant on a block: its rollers and bodies, from evaluated forces."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import sum_with_multiple
from ..sums import add_hub_force
from .block_kinds import WARP, BlockKind, inlined
from .block_structs import ThreadParts
from .bodies import body_functions
from .body_sums import body_sum_functions
from .carried_arms import carried_arm_functions
from .contact_forces import contact_force_functions
from .events import ENDS, EXTRA
from .frame_output import frame_output_functions
from .hubs import hub_functions
from .joints import joint_functions
from .loads import load_functions
from .partner_bits import partner_bit_functions
from .prescribed_motion import prescribed_motion_functions
from .rollers import roller_functions, roller_stage_function
from .sampling import sampling_functions
from .strand_loads import strand_load_functions
from .sync import sync_functions
from .tensioners import tensioner_functions
from .trains import train_functions
from .valves import valve_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class StepFunctions:
    """Step functions of a block."""

    add_contact_forces: wp.Function
    advance_oil: wp.Function
    advance_oil_apart: wp.Function
    advance_bodies: wp.Function
    advance_rollers_after_contacts: wp.Function
    find_load_ahead: wp.Function
    sample_rollers: wp.Function


@cache
def step_functions(kind: BlockKind, frame: Any) -> StepFunctions:
    """Step functions of block kernels, and frames of layout `frame`."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    roller_threads = threads - WARP  # where the last warp has none
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    rollers = roller_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    bodies, loads = body_functions(kind), load_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    body_sums = body_sum_functions(kind)
    tensioners = tensioner_functions(kind)
    sampling = sampling_functions(kind, frame)
    frame_output = frame_output_functions(kind, frame)
    sync = sync_functions(kind)
    carried_arms = carried_arm_functions(kind)
    hubs = hub_functions(kind)
    partner_bits = partner_bit_functions(kind)
    contact_forces = contact_force_functions(kind)
    trains = train_functions(kind, frame)
    valves = valve_functions(kind, frame)
    joints, strand_loads = joint_functions(kind), strand_load_functions(kind)
    stage_roller = roller_stage_function(kind)

    @inlined
    def add_contact_forces(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """Adds contact forces after the links', and shares valves' lifts; all threads together."""
        if wp.static(kind.parts.valves):
            valves.share_lifts(ensemble, shared, mine)
        contact_forces.add_contact_forces(ensemble, state, out.tallies, shared, mine, now, near)

    @wp.func
    def advance_rollers(state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Moves the thread's rollers by a step or a stage."""
        if wp.static(kind.has_stages):
            j = int(mine.thread)
            while j < mine.rollers and now.goes_on != 0:
                stage_roller(state, shared, mine, now, j)
                j = j + threads
        elif now.goes_on != 0:
            h = rollers.time_step(mine)
            for k in range(rollers_per_thread):
                j = k * threads + mine.thread
                v = sum_with_multiple(rollers.velocity(shared.rows, j), h, rollers.acceleration(shared, j))
                rollers.set_velocity(shared, j, v)
                rollers.move(shared, j, h, v)

    @wp.func
    def find_chain_wrench(state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Chain's moment and force on the thread's body, if any; all threads together.

        On one warp this also moves the thread's rollers.
        """
        moment = wrench_parts.chain_moment(shared, mine.thread)
        if wp.static(kind.shape.is_one_warp):
            advance_rollers(state, shared, mine, now)
        return wrench_parts.chain_moment_and_force(shared, mine.thread, moment, now.measures)

    @inlined
    def advance_and_observe_body(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        acting: of_three,
        whole: kinds.Wrench,
    ):
        """Moves the thread's body by a step or a stage, and adds it to sums and frames.

        `acting` is the chain's moment and force, `whole` the wrench with bearing and tensioners.
        """
        before = shared.poses[mine.body]
        seen, whole = bodies.advance_body(ensemble, state, shared, mine, now, before, whole)
        if wp.static(kind.measuring) and now.measures != 0:
            if mine.sprocket >= 0:
                body_sums.add_sprocket_step(ensemble, shared, mine, now, before, seen, acting, whole)
                sums = shared.sprocket_sums[mine.sprocket]
                shared.sprocket_sums[mine.sprocket] = add_hub_force(sums, vec2(acting[1], acting[2]), now.weight)
            if wp.static(kind.parts.arms):
                if mine.arm >= 0:
                    led = body_sums.power_on_pivot(ensemble, shared, mine, now, before, seen, whole)
                    powers = vec2(led, body_sums.late_power_on_body(shared, mine, now, before, seen, acting))
                    body_sums.add_arm_step(ensemble, out.sums, shared, mine, now, seen, acting[0], powers)
            if now.flags & ENDS != 0:
                body_sums.add_body_energy(ensemble, out.tallies, shared, mine, now, before, seen)
            if wp.static(kind.parts.tensioners):
                tensioners.add_tensioner_step(ensemble, state, out, mine, now, before, seen)
        if wp.static(kind.parts.hubs):
            shared.speeds_now[mine.body] = seen.speed
        frame_output.write_body(ensemble, state, out.frames, mine, now, seen, acting[0], vec2(acting[1], acting[2]))

    @wp.func
    def advance_oil(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Moves the tensioners of the thread's body on, after its step."""
        if wp.static(kind.parts.tensioners):
            if mine.body >= 0:
                tensioners.advance_tensioners(ensemble, state, shared, mine, now)

    @wp.func
    def advance_oil_apart(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Moves the tensioners of the thread's body on, on several warps only."""
        if wp.static(not kind.shape.is_one_warp):
            advance_oil(ensemble, state, shared, mine, now)

    @inlined
    def advance_bodies(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Moves the thread's body by a step or a stage and observes it; on one warp its rollers, too.

        All threads together; on several warps others move their rollers meanwhile.
        """
        tensioners.await_oil(shared)
        if wp.static(kind.parts.hydraulic):
            if mine.body >= 0 and now.stage == 0:
                tensioners.find_supplies(ensemble, state, shared, mine, prescribed_motion.step_time(mine, now))
            sync.barrier()
        acting = carried_arms.add_carried_wrenches(ensemble, shared, mine, find_chain_wrench(state, shared, mine, now))
        whole = hubs.add_bearing_moments(ensemble, state, shared, mine, now, wrench_parts.wrench_from_vector(acting))
        if wp.static(kind.parts.tensioners):
            if mine.body >= 0:
                whole = tensioners.add_tensioner_forces(
                    ensemble, state, mine, now.stage, shared.poses[mine.body], whole
                )
        if wp.static(kind.parts.is_tied):
            trains.find_train_moments(ensemble, state, out, shared, mine, now, whole)
        if wp.static(kind.parts.jointed):
            carried_arms.couple_accelerations(ensemble, shared, mine, now, whole)
        if mine.body >= 0:
            advance_and_observe_body(ensemble, state, out, shared, mine, now, acting, whole)
        if wp.static(kind.parts.jointed):
            sync.barrier()
            carried_arms.place_carried_arm(ensemble, shared, mine, now.goes_on)
        hubs.end_hub_step(shared, mine, now)

    @wp.func
    def advance_rollers_after_contacts(state: State, shared: Shared, mine: ThreadParts, now: Now):
        """Moves the thread's rollers after their contacts, and waits for the other threads'.

        A warp that moves the bodies waits for contacts only.
        """
        if wp.static(kind.hands_over):
            if mine.thread < roller_threads:
                sync.hand_over_contacts()
                advance_rollers(state, shared, mine, now)
                sync.roller_barrier()
            else:
                sync.await_contacts()
        else:
            advance_rollers(state, shared, mine, now)
            sync.barrier()

    @wp.func
    def find_load_ahead(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now):
        """Stores the load on the thread's body ahead of its step."""
        if mine.body >= 0 and now.stage == 0:
            loads.find_load_ahead(ensemble, shared, mine, now)

    @wp.func
    def sample_rollers(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now):
        """Samples the thread's rollers where that is due, once their forces are complete."""
        if now.flags & EXTRA != 0 or (now.step == 0 and now.flags != 0):
            sampling.sample_rollers(ensemble, state, out, shared, mine, now)
        if wp.static(kind.measuring) and now.measures != 0:
            if wp.static(kind.friction.joints):
                joints.add_friction_work(shared, mine, now)
            if wp.static(kind.links == "varied"):
                strand_loads.add_goods_work(out.tallies, shared, mine, now)

    return StepFunctions(
        add_contact_forces=add_contact_forces,
        advance_oil=advance_oil,
        advance_oil_apart=advance_oil_apart,
        advance_bodies=advance_bodies,
        advance_rollers_after_contacts=advance_rollers_after_contacts,
        find_load_ahead=find_load_ahead,
        sample_rollers=sample_rollers,
    )
