"""Neighbor list on the CPU: runs of rollers that can come near a partner within the next steps.

Rollers near a partner widened by a skin are kept as runs of up to `GROUP` rollers. While no roller or body is faster
than a limit, no other comes through more than 0.7 of the skin, so that results do not depend on runs.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import LANES, row_access
from ..structs import Drive, types
from .rollers import rows

SKIN = 0.25
"""Width of the neighbor list's skin over the first link's length."""


GROUP = wp.constant(64)
"""Most rollers of a neighbor list's group."""


RUN_GAP = wp.constant(16)
"""Rollers between two near ones that end a run of the neighbor list."""


MOST_STEPS = 64
"""Most steps for which the neighbor list holds."""


@wp.struct
class Group:
    """Rollers in a row, some near a partner."""

    first: wp.int32
    near: wp.uint64  # bit k: roller `first` + k is near
    fresh: wp.uint64  # and has no seat, or piece, yet
    low: wp.int32  # the first that is near, or up to `native.LANES` - 1 before
    high: wp.int32  # after the last that is near, by a multiple of `native.LANES` from `low`


@wp.func_native("return __builtin_ctzll(bits);")
def lowest_bit(bits: wp.uint64) -> int:
    """Position of the lowest bit set of a neighbor group's 64."""


@wp.func_native("return 63 - __builtin_clzll(bits);")
def highest_bit(bits: wp.uint64) -> int:
    """Position of the highest bit set of a neighbor group's 64."""


@wp.func
def single_bit(k: int):
    """64 bits of a neighbor group, only bit `k` set."""
    return wp.uint64(1) << wp.uint64(k)


@wp.func
def without_lowest_bit(bits: wp.uint64):
    """A neighbor group's bits without the lowest."""
    return bits & (bits - wp.uint64(1))


@wp.func
def is_near(group: Group, i: int):
    """Whether roller `i`, between a neighbor group's `low` and `high`, is near."""
    return ((group.near >> wp.uint64(i - group.first)) & wp.uint64(1)) != wp.uint64(0)


@dataclass(frozen=True)
class NeighborListFunctions:
    """CPU neighbor list functions."""

    store_runs: wp.Function
    mark_all_near: wp.Function
    reset: wp.Function
    is_outdated: wp.Function
    invalidate_if_fast: wp.Function
    skin_width: wp.Function
    set_lifetime: wp.Function
    run_count: wp.Function
    run_span: wp.Function
    near_group: wp.Function
    whole_group: wp.Function


@cache
def neighbor_list_functions(Real: type, capacity: int) -> NeighborListFunctions:
    """CPU neighbor list functions."""
    kinds = types(Real)
    lanes = LANES[Real]
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def group_count(n: int):
        """Number of whole neighbor groups of `n` rollers."""
        return (n + GROUP - 1) // GROUP

    @wp.func
    def run_slots(n: int):
        """Most runs of one partner in the neighbor list."""
        return group_count(n) + 2

    @wp.func
    def is_crowded(drive: Drive):
        """Whether rows lack room for a neighbor list; runs are then whole groups."""
        return (drive.sprockets + drive.guides) * run_slots(drive.rollers) > wp.static(capacity)

    @wp.func
    def store_runs(w: wp.array[Real], n: int, p: int):
        """Stores the marked rollers as neighbor list runs of partner `p`."""
        place = p * run_slots(n) - 1
        count = int(0)
        first = int(0)
        last = int(0)
        i = int(0)
        while i < n:
            if access.find_unlike(w, row.near + i, wp.min(wp.static(lanes), n - i), Real(0.0)) != wp.uint64(0):
                spare = i - last > RUN_GAP and count + group_count(n - i) < run_slots(n)
                if count == 0 or i - first >= GROUP or spare:
                    count = count + 1
                    first = i
                    access.store(w, row.run_first + place + count, Real(first))
                access.store(w, row.run_rollers + place + count, Real(i - first + wp.static(lanes)))
                last = i
            i = i + wp.static(lanes)
        access.store(w, row.runs + p, Real(count))

    @wp.func
    def mark_all_near(w: wp.array[Real], n: int):
        """Marks all rollers as near, for the neighbor list."""
        i = int(0)
        while i < access.round_up(n):
            access.store(w, row.near + i, Real(1.0))
            i = i + 1

    @wp.func
    def reset(w: wp.array[Real], drive: Drive):
        """Makes the whole chain each partner's runs, until the neighbor list is rebuilt."""
        mark_all_near(w, drive.rollers)
        if not is_crowded(drive):
            for p in range(drive.sprockets + drive.guides):
                store_runs(w, drive.rollers, p)
        access.store(w, row.lifetime, Real(0.0))
        access.store(w, row.lifetime + 1, Real(0.0))

    @wp.func
    def is_outdated(w: wp.array[Real], drive: Drive):
        """Whether the neighbor list must be rebuilt before forces are evaluated."""
        return not (access.load(w, row.lifetime) > Real(0.0)) and drive.integrator == 0 and not is_crowded(drive)

    @wp.func
    def invalidate_if_fast(w: wp.array[Real], velocity: wp.vec2d):
        """Ends the neighbor list's lifetime if a moved body is too fast."""
        limit = wp.float64(access.load(w, row.lifetime + 1))
        if not (wp.dot(velocity, velocity) <= limit * limit):
            access.store(w, row.lifetime, Real(0.0))

    @wp.func
    def skin_width(w: wp.array[Real]):
        """Width [m] of the neighbor list's skin."""
        return access.load(w, row.length) * wp.static(Real(SKIN))

    @wp.func
    def set_lifetime(w: wp.array[Real], drive: Drive):
        """Sets the steps for which a new neighbor list holds, up to 5/4 of the fastest speed."""
        square = Real(0.0)
        for i in range(drive.rollers):
            vx = access.load(w, row.vx + i)
            vy = access.load(w, row.vy + i)
            square = wp.max(square, vx * vx + vy * vy)
        way = Real(0.35) * skin_width(w) / Real(drive.step)
        room = way / (Real(1.25) * wp.sqrt(square) + Real(1.0e-9))
        room = wp.floor(wp.clamp(room, Real(1.0), wp.static(Real(MOST_STEPS))))
        access.store(w, row.lifetime, room)
        access.store(w, row.lifetime + 1, way / room)

    @wp.func
    def run_count(w: wp.array[Real], drive: Drive, p: int):
        """Number of runs of partner `p` in the neighbor list."""
        if is_crowded(drive):
            return group_count(drive.rollers)
        return int(access.load(w, row.runs + p))

    @wp.func
    def run_span(w: wp.array[Real], drive: Drive, p: int, k: int):
        """First roller and number of rollers of the neighbor list's run `k` of partner `p`."""
        n = drive.rollers
        if is_crowded(drive):
            return k * GROUP, wp.min(access.round_up(n - k * GROUP), GROUP)
        place = p * run_slots(n) + k
        return int(access.load(w, row.run_first + place)), int(access.load(w, row.run_rollers + place))

    @wp.func
    def near_group(first: int, near: wp.uint64, fresh: wp.uint64):
        """Neighbor group from roller `first` on, with bits `near`, not 0, and `fresh`."""
        group = Group()
        group.first = first
        group.near = near
        group.fresh = fresh
        group.low = first + (lowest_bit(near) & wp.static(-lanes))
        group.high = first + (highest_bit(near) & wp.static(-lanes)) + wp.static(lanes)
        return group

    @wp.func
    def whole_group(first: int, end: int):
        """Neighbor group of all rollers from `first` to before `end`."""
        group = Group()
        group.first = first
        group.low = first
        group.high = end
        return group

    return NeighborListFunctions(
        store_runs=store_runs,
        mark_all_near=mark_all_near,
        reset=reset,
        is_outdated=is_outdated,
        invalidate_if_fast=invalidate_if_fast,
        skin_width=skin_width,
        set_lifetime=set_lifetime,
        run_count=run_count,
        run_span=run_span,
        near_group=near_group,
        whole_group=whole_group,
    )
