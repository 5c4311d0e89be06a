"""Partners that a block's rollers may touch, sprockets and guides, from step to step."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import is_between, products
from ..physics.guide import coarse_frame_vector, is_near_bar, is_near_profile
from ..physics.toe import ENDS
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .geometry import geometry_functions
from .partner_bits import partner_bit_functions
from .rollers import roller_functions


@dataclass(frozen=True)
class NearPartnerFunctions:
    """Near partner functions of a block."""

    remembered_partners: wp.Function
    update_near_partners: wp.Function


@cache
def near_partner_functions(kind: BlockKind) -> NearPartnerFunctions:
    """Near partner functions of block kernels."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets, guides, body_count = kind.parts.sprockets, kind.parts.guides, kind.parts.bodies
    partners = sprockets + guides
    kinds, Now = kind.types, kind.types.Now
    State, Shared, Guide = kinds.State, kinds.Shared, kinds.Guide
    geometry = geometry_functions(kind)
    rollers = roller_functions(kind)
    partner_bits = partner_bit_functions(kind)
    chains = chain_functions(kind)
    of_each = wp.types.vector(rollers_per_thread, wp.int32)

    @wp.func
    def has_profile(bar: Guide):
        """Whether a guide that a block's rollers are near has a profile."""
        if wp.static(kind.profiles):
            return bar.pieces != 0
        else:
            return False

    @wp.func
    def is_in_profile_box(shared: Shared, j: int, bar: Guide):
        """1 where a block's roller j is in the box about a profiled guide's chord, else 0."""
        q = geometry.arm_from_body(shared, j, bar.body)
        if bar.body < body_count:  # the ground has not turned
            q = coarse_frame_vector(q, shared.poses[bar.body])
        return is_near_profile(q, bar)

    @wp.func
    def partners_near_now(shared: Shared, mine: ThreadParts):
        """Partners, as bits, near the thread's rollers now: sprockets by their bands, guides by their boxes."""
        found = of_each()
        s = int(0)  # loops that Warp does not unroll, or many partners would take minutes to compile
        while s < sprockets:
            band = shared.bands[s]
            for k in range(rollers_per_thread):
                p = rollers.position(shared.rows, k * threads + mine.thread)
                from_x = p[0] - band.center[0]
                from_y = p[1] - band.center[1]
                square = products(from_x, from_x, from_y, from_y)
                near = is_between(square, band.near_square, band.far_square)
                if wp.static(kind.links == "varied"):
                    first, count = chains.chain_span(shared, k * threads + mine.thread, mine.rollers)
                    pin = shared.teeth[s].pin
                    near = wp.where(pin == 0 or pin == k * threads + mine.thread - first + 1, near, 0)
                found[k] = found[k] | (near << s)
            s = s + 1
        g = int(0)
        while g < guides:
            bar = geometry.guide_now(shared, g)
            for k in range(rollers_per_thread):
                j = k * threads + mine.thread
                if has_profile(bar):
                    found[k] = found[k] | (is_in_profile_box(shared, j, bar) << (sprockets + g))
                else:
                    found[k] = found[k] | (is_near_bar(rollers.exact_position(shared.rows, j), bar) << (sprockets + g))
            g = g + 1
        return found

    @wp.func
    def remembered_partners(state: State, shared: Shared, mine: ThreadParts):
        """Partners, as bits, near the thread's rollers by the contact memory of the state."""
        held = partner_bits.Bits()
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            if j < mine.rollers:
                found = int(0)
                p = int(0)
                while p < partners:
                    at = chains.contact_memory(shared, mine, j, p)
                    if state.seat[at] >= 0 or state.impact_speed[at] != Real(0.0):
                        found = found | (1 << p)
                    p = p + 1
                held = partner_bits.with_roller(held, k, chains.partners_of_chain(shared, j, found))
        return held

    @wp.func
    def forget_partners(state: State, shared: Shared, mine: ThreadParts, left: partner_bits.Bits):
        """Resets the contact memories of the partners `left`, no longer near the thread's rollers."""
        while partner_bits.has_any(left):
            j, p = partner_bits.first_pair(left, mine.thread)
            left = partner_bits.without_first_pair(left)
            at = chains.contact_memory(shared, mine, j, p)
            state.seat[at] = -1
            state.impact_speed[at] = Real(0.0)
            if wp.static(kind.silent):
                if p < sprockets and shared.plates[chains.chain_number(shared, j)].radius > Real(0.0):
                    for end in range(1, ENDS):
                        state.impact_speed[at + end * chains.chain_length(shared, mine, j)] = Real(0.0)

    @wp.func
    def update_near_partners(state: State, shared: Shared, mine: ThreadParts, now: Now, held: partner_bits.Bits):
        """Partners, as bits, near the thread's rollers, from `held` of the step before.

        Guide-bars leave at a step's start only.
        """
        partners_near = partners_near_now(shared, mine)
        found = partner_bits.Bits()
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            found = partner_bits.with_roller(
                found, k, wp.where(j < mine.rollers, chains.partners_of_chain(shared, j, partners_near[k]), 0)
            )
        if wp.static(kind.has_stages):
            if now.stage != 0:
                found = found | partner_bits.of_guides(held)
        if not (found == held):
            forget_partners(state, shared, mine, held & ~found)
        return found

    return NearPartnerFunctions(
        remembered_partners=remembered_partners,
        update_near_partners=update_near_partners,
    )
