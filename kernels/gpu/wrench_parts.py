"""Moments and forces of a block's rollers on bodies, added up from a part of each roller or thread."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..number import difference, leading_value
from ..physics.contact import reaction_moment
from ..structs import GROUND
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .shared_memory import parts_per_body
from .sync import group_lanes, sync_functions, warp_lanes


@dataclass(frozen=True)
class WrenchPartFunctions:
    """Wrench part functions of a block."""

    add_moment: wp.Function
    add_reaction: wp.Function
    add_wrench: wp.Function
    add_wrench_on_carrier: wp.Function
    thread_body: wp.Function
    chain_moment: wp.Function
    chain_moment_and_force: wp.Function
    wrench_from_vector: wp.Function


@cache
def wrench_part_functions(kind: BlockKind) -> WrenchPartFunctions:
    """Wrench part functions of block kernels."""
    Real, threads, body_count = kind.Real, kind.shape.threads, kind.parts.bodies
    kinds, Now = kind.types, kind.types.Now
    Shared = kinds.Shared
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    access = row_access(Real)
    sync = sync_functions(kind)
    width = parts_per_body(kind)
    of_rollers = width != threads

    @wp.func
    def is_force_wanted(measured: int):
        """Whether a block wants rollers' force on sprockets beside the moment."""
        if wp.static(kind.moving):
            return True
        else:
            return wp.static(kind.measuring) and measured != 0

    @wp.func
    def part_index(mine: ThreadParts, k: int, s: int, j: int):
        """Index of the part of body s of roller j, or of its thread, in row k: of moments, forces in x, forces in y."""
        first = (body_count * k + s) * width
        if wp.static(of_rollers):
            return first + j
        else:
            return first + mine.thread

    @wp.func
    def add_part(shared: Shared, at: int, value: Real):
        """Adds `value` to a block's wrench part at `at`."""
        access.store(shared.wrench_parts, at, access.load(shared.wrench_parts, at) + value)

    @wp.func
    def add_moment(shared: Shared, mine: ThreadParts, s: int, j: int, moment: Real):
        """Adds the moment [N m] of a block's roller j's force to the parts of body s."""
        add_part(shared, part_index(mine, 0, s, j), moment)

    @wp.func
    def add_reaction(shared: Shared, mine: ThreadParts, s: int, j: int, force: vec2):
        """Adds the opposite of a block's roller j's force [N] to the parts of body s."""
        add_part(shared, part_index(mine, 1, s, j), -force[0])
        add_part(shared, part_index(mine, 2, s, j), -force[1])

    @wp.func
    def add_wrench(shared: Shared, mine: ThreadParts, s: int, j: int, moment: Real, force: vec2, measured: int):
        """Adds moment [N m] and, if wanted, opposite of a block's roller j's force [N] to the parts of body s."""
        add_moment(shared, mine, s, j, moment)
        if is_force_wanted(measured):
            add_reaction(shared, mine, s, j, force)

    @wp.func
    def add_wrench_on_carrier(shared: Shared, mine: ThreadParts, now: Now, s: int, j: int, force: vec2):
        """Adds the wrench of a block's roller j's force to the parts of the arm that carries sprocket s, if any."""
        if wp.static(kind.parts.hubs):
            arm = shared.hubs[s].arm
            if arm != GROUND:
                lever = leading_value(difference(shared.poses[s].center, shared.poses[arm].center))
                add_wrench(shared, mine, arm, j, reaction_moment(lever, force), force, now.measures)

    @wp.func
    def part_sum(shared: Shared, s: int, k: int, i: int):
        """Thread's share of the sum of the wrench parts of body s, if there is one, in row k; clears the parts."""
        value = Real(0.0)
        first = (body_count * k + wp.min(s, wp.static(kind.parts.bodies - 1))) * wp.static(width) + i % group_lanes()
        for q in range(warp_lanes() // group_lanes()):
            of_lane = Real(0.0)
            for w in range(width // warp_lanes()):
                of_lane = of_lane + access.load(shared.wrench_parts, first + w * warp_lanes() + q * group_lanes())
            value = value + of_lane
        if warp_lanes() == 1:
            value = sync.sum_of_lanes(shared.wrench_parts, first, width)
        if s < body_count:
            for w in range(width // group_lanes()):
                access.store(shared.wrench_parts, first + w * group_lanes(), Real(0.0))
        return value

    @wp.func
    def moving_warps():
        """Number of a block's warps that move bodies: all, or only the last, which has no rollers."""
        if wp.static(kind.shape.body_warp and kind.parts.bodies <= 4):
            if warp_lanes() > 1:
                return int(1)
        return threads // warp_lanes()

    @wp.func
    def first_body(i: int):
        """First body of thread i's warp; the number of bodies where it has none."""
        if wp.static(kind.shape.is_one_warp):
            if warp_lanes() > 1:
                return int(0)
        place = threads // warp_lanes() - 1 - i // warp_lanes()
        return wp.where(place < moving_warps(), place, body_count)

    @wp.func
    def thread_body(i: int):
        """Body that thread i moves, -1 for none."""
        s = first_body(i) + moving_warps() * (
            i % warp_lanes() // group_lanes() + warp_lanes() // group_lanes() * (i % group_lanes())
        )
        return wp.where(s < body_count, s, -1)

    @wp.func
    def row_sum(shared: Shared, k: int, i: int):
        """Row k of the rollers' wrench on thread i's body: moment [N m], force in x, in y [N].

        All threads together, between the contacts' barrier and the next.
        """
        acting = Real(0.0)
        turn = int(0)
        first = first_body(i)
        while first < body_count:
            value = sync.group_sum(part_sum(shared, first + moving_warps() * (i % warp_lanes() // group_lanes()), k, i))
            if i % group_lanes() == turn:
                acting = value
            turn = turn + 1
            first = first + moving_warps() * (warp_lanes() // group_lanes())
        return acting

    @wp.func
    def chain_moment(shared: Shared, i: int):
        """Chain's moment [N m] on thread i's body; all threads together."""
        return row_sum(shared, 0, i)

    @wp.func
    def chain_moment_and_force(shared: Shared, i: int, moment: Real, measured: int):
        """Chain's `moment` [N m] and, if wanted, force (x, y) [N] on thread i's body; all threads together."""
        acting = of_three()
        acting[0] = moment
        if is_force_wanted(measured):
            acting[1] = row_sum(shared, 1, i)
            acting[2] = row_sum(shared, 2, i)
        return acting

    @wp.func
    def wrench_from_vector(acting: of_three):
        """Wrench on a block's body from `chain_moment_and_force`; with the force where bodies move."""
        wrench = kinds.Wrench()
        wrench.moment = acting[0]
        if wp.static(kind.moving):
            wrench.force = vec2(acting[1], acting[2])
        return wrench

    return WrenchPartFunctions(
        add_moment=add_moment,
        add_reaction=add_reaction,
        add_wrench=add_wrench,
        add_wrench_on_carrier=add_wrench_on_carrier,
        thread_body=thread_body,
        chain_moment=chain_moment,
        chain_moment_and_force=chain_moment_and_force,
        wrench_from_vector=wrench_from_vector,
    )
