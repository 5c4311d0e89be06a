"""Whole steps of one variant on one warp, and waits of a block's variants for each other."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .events import EXTRA
from .joints import joint_functions
from .links import link_functions
from .near_partners import near_partner_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions
from .sampling import sampling_functions
from .shared_memory import array_view
from .steps import step_functions
from .sync import sync_functions

MEETING_INTERVAL = wp.constant(16)
"""Steps after which variants of a block wait for each other."""


@wp.func
def plain_step(now: Any):
    """Time loop's state of a step with nothing but forces and motion."""
    now.flags = 0
    now.goes_on = 1
    return now


@dataclass(frozen=True)
class WarpStepFunctions:
    """Warp step functions of a block."""

    is_common_step: wp.Function
    take_step: wp.Function
    wait_for_other_variants: wp.Function
    take_steps_to_event: wp.Function


@cache
def warp_step_functions(kind: BlockKind, frame: Any) -> WarpStepFunctions:
    """Warp step functions of block kernels, and frames of layout `frame`."""
    Real = kind.Real
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    joints = joint_functions(kind)
    links = link_functions(kind)
    near_partners, partner_bits = near_partner_functions(kind), partner_bit_functions(kind)
    rollers = roller_functions(kind)
    sampling = sampling_functions(kind, frame)
    sync = sync_functions(kind)
    steps = step_functions(kind, frame)
    lengths_of = array_view(Real)
    pull = joints.find_link_forces if kind.friction.joints else links.find_link_forces

    @wp.func
    def is_common_step(now: Now):
        """Whether a warp's step is neither the run's first nor last, without a frame, and not at the window's ends."""
        whole = now.goes_on != 0 and now.step != 0 and now.flags & EXTRA == 0
        if wp.static(kind.measuring):
            return whole and now.measures != 0
        else:
            return whole

    @wp.func
    def common_step(mine: ThreadParts, now: Now):
        """Time loop's state of a step with metrics in full, but no frames or events."""
        now.measures = wp.static(int(kind.measuring))
        now.weight = rollers.time_step(mine)
        now.wanted_moments = now.moved_sprockets
        return plain_step(now)

    @inlined
    def take_step(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
    ):
        """A step or stage of a variant on one warp; takes the partners that were near, and returns those that are."""
        lengths = lengths_of(ensemble.lengths, mine.first_roller, wp.static(kind.shape.slots))
        # first, so that both read places of rollers once, and nothing branches while they wait for them
        near = near_partners.update_near_partners(state, shared, mine, now, near)
        tension, rate = pull(state, shared, mine, now, lengths)
        # before anything else, so that tensions and rates do not stay in registers any longer
        sampling.sample_links(state, shared, mine, now, lengths, tension, rate)
        steps.add_contact_forces(ensemble, state, out, shared, mine, now, near)
        sync.barrier()
        steps.sample_rollers(ensemble, state, out, shared, mine, now)
        steps.advance_bodies(ensemble, state, out, shared, mine, now)
        steps.advance_oil(ensemble, state, shared, mine, now)
        return near

    @wp.func
    def wait_for_other_variants(now: Now):
        """Waits now and then for the block's other variants, so that code is fetched once for all."""
        if wp.static(kind.shape.variants_per_block > 1 and not kind.has_oil_warp) and now.step % MEETING_INTERVAL == 0:
            sync.block_barrier()

    @inlined
    def take_steps_to_event(
        ensemble: Ensemble,
        state: State,
        out: Out,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        near: partner_bits.Bits,
        end: int,
    ):
        """Takes common steps of a variant on one warp from `now` on, to an event or to `end`."""
        now = common_step(mine, now)
        end = wp.min(end, now.next_event)
        while True:
            near = take_step(ensemble, state, out, shared, mine, now, near)
            now.step = now.step + 1
            sync.barrier()
            if now.step >= end:
                break
            wait_for_other_variants(now)
        return now, near

    return WarpStepFunctions(
        is_common_step=is_common_step,
        take_step=take_step,
        wait_for_other_variants=wait_for_other_variants,
        take_steps_to_event=take_steps_to_event,
    )
