"""The block kernel: one block of threads a variant, the whole time loop inside.

Thread i has the rollers i, i + threads, ... in shared rows; a few threads also move a body each. One warp has a whole
variant where variants are many; several such variants may share a block. What does not happen every step waits for the
next event.
"""

from functools import cache
from typing import Any

import warp as wp

from ..modules import own_module, without_contraction
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import thread_parts
from .chain_places import chain_place_functions
from .joints import joint_functions
from .launches import launch_functions
from .links import link_functions
from .near_partners import near_partner_functions
from .oil_warp import oil_warp_functions
from .prescribed_motion import prescribed_motion_functions
from .rollers import roller_functions
from .sampling import sampling_functions
from .shared_memory import array_view, shared_arrays
from .steps import step_functions
from .sync import sync_functions
from .tensioners import tensioner_functions
from .warp_steps import plain_step, warp_step_functions
from .wrench_parts import wrench_part_functions


@cache
def block_kernel(kind: BlockKind, blocks: int, frame: Any) -> wp.Kernel:
    """Block kernel that advances variants of drives of a kind, with `dim` = variants * threads.

    `block_dim` is the threads of a block's variants, `blocks` the variants that a multiprocessor has room for, `frame`
    the layout of frames (`kernels.frames`).
    """
    Real, slots = kind.Real, kind.shape.slots
    kinds = kind.types
    joints = joint_functions(kind)
    links = link_functions(kind)
    oil_warp = oil_warp_functions(kind)
    tensioners = tensioner_functions(kind)
    chain_places = chain_place_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    launches = launch_functions(kind)
    rollers = roller_functions(kind)
    sync = sync_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    near_partners = near_partner_functions(kind)
    warp_steps = warp_step_functions(kind, frame)
    steps = step_functions(kind, frame)
    sampling = sampling_functions(kind, frame)
    shared_of = shared_arrays(kind)
    lengths_of = array_view(Real)  # of as many links as the block has room for, some of no roller
    pull = joints.find_link_forces if kind.friction.joints else links.find_link_forces
    # on several warps, which wait for each other, the next step's link forces are worked out while bodies move, and
    # what rollers may touch unless that depends on where bodies are

    module = own_module(__file__, "advance_block", kind, blocks, frame)

    bounds = kind.block_threads, max(blocks // kind.shape.variants_per_block, 1)

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
        """Advances variants `order[b]` to before step `ends[b]`, a block each; frames begin at step `begun[b]`."""
        number, i, k = oil_warp.place_in_launch(wp.tid())
        shared = shared_of(state, number)
        if tensioners.serve_variant(ensemble, state, shared, order, number, k):
            return
        parts = thread_parts(ensemble.drives[order[number]], order[number], i, wrench_parts.thread_body(i))
        mine = chain_places.among_chains(ensemble, shared, parts)
        shared.first_rollers = chain_places.first_rollers(shared)
        lengths, out = lengths_of(ensemble.lengths, mine.first_roller, slots), launches.outputs(sums, tallies, frames)
        rollers.fetch(state, shared, mine)
        now = launches.first_instant(state, mine, begun[number])
        launches.begin_launch(ensemble, state, sums, shared, mine, now.step)
        sync.barrier()
        now.moved_sprockets = launches.moved_sprockets(shared)
        mine.prescribed_index = prescribed_motion.prescribed_index(shared, mine.body)
        end = wp.min(ends[number], ensemble.drives[mine.variant].steps + 1)
        prescribed_motion.plan_steps(ensemble, shared, mine, now.step)
        if wp.static(not kind.shape.is_one_warp):
            tension, rate = pull(state, shared, mine, now, lengths)
        near = near_partners.remembered_partners(state, shared, mine)
        if wp.static(kind.finds_partners_early) and i < mine.rollers:
            near = near_partners.update_near_partners(state, shared, mine, now, near)
        while now.step < end and now.diverged == 0:
            warp_steps.wait_for_other_variants(now)
            if now.step == now.next_event and now.stage == 0:
                now = sampling.handle_event(ensemble, state, out, shared, mine, now)
            now = launches.with_wanted_sums(mine, now)
            if wp.static(not kind.shape.is_one_warp):
                if wp.static(not kind.finds_partners_early):
                    near = near_partners.update_near_partners(state, shared, mine, now, near)
                if wp.static(not kind.measuring) and now.flags == 0:
                    steps.add_contact_forces(ensemble, state, out, shared, mine, plain_step(now), near)
                    steps.find_load_ahead(ensemble, shared, mine, now)
                    steps.advance_rollers_after_contacts(state, shared, mine, plain_step(now))
                else:
                    sampling.sample_links(state, shared, mine, now, lengths, tension, rate)
                    steps.add_contact_forces(ensemble, state, out, shared, mine, now, near)
                    steps.find_load_ahead(ensemble, shared, mine, now)
                    if wp.static(kind.friction.joints or kind.links == "varied") or now.flags != 0:
                        sync.barrier()  # others may still be at rollers beside theirs
                        steps.sample_rollers(ensemble, state, out, shared, mine, now)
                    steps.advance_rollers_after_contacts(state, shared, mine, now)
                steps.advance_bodies(ensemble, state, out, shared, mine, now)
            elif wp.static(kind.has_common_path) and warp_steps.is_common_step(now):
                now, near = warp_steps.take_steps_to_event(ensemble, state, out, shared, mine, now, near, end)
                continue
            else:
                near = warp_steps.take_step(ensemble, state, out, shared, mine, now, near)
            taken, now = now, launches.next_stage(now)
            if wp.static(kind.finds_partners_early) and i < mine.rollers:
                near = near_partners.update_near_partners(state, shared, mine, now, near)
            if wp.static(not kind.shape.is_one_warp) and now.step < end and now.diverged == 0:
                tension, rate = pull(state, shared, mine, now, lengths)  # joints remember only steps that are taken
            sync.barrier()
            steps.advance_oil_apart(ensemble, state, shared, mine, taken)
        launches.end_launch(ensemble, state, out, shared, mine, now)

    return without_contraction(advance_block)
