"""Which rollers can come near a partner within the next steps: only these are looked at.

Every so often all rollers are held against each partner, widened by a skin. Those found are kept as runs of up to
`GROUP` rollers one after the other, those in between included. As long as no roller and no body is faster than
a limit, none of the others comes through more than 0.7 of the skin in the steps for which the runs hold, which leaves
more than float32 rounds off. So results do not depend on runs.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import LANES, accessors, whole_lanes
from ..structs import Drive, types
from .rollers import rows

SKIN = 0.25
"""By how much partners are widened, of the first link's length."""
GROUP = wp.constant(64)
"""Rollers of a group."""
APART = wp.constant(16)
"""Rollers between two that are near from which on a run ends; where a sprocket has both ends of the chain, say."""
LONGEST = 64
"""Steps for which runs hold at most."""


@wp.struct
class Group:
    """Rollers one after the other of which some are near a partner."""

    first: wp.int32
    near: wp.uint64  # bit k: roller `first` + k is near
    fresh: wp.uint64  # and has no seat, or piece, yet
    low: wp.int32  # the first that is near, or up to `native.LANES` - 1 before
    high: wp.int32  # after the last that is near, by a multiple of `native.LANES` from `low`


@wp.func_native("return __builtin_ctzll(bits);")
def lowest_bit(bits: wp.uint64) -> int: ...


@wp.func_native("return 63 - __builtin_clzll(bits);")
def highest_bit(bits: wp.uint64) -> int: ...


@wp.func
def bit_of(k: int):
    """Bit k."""
    return wp.uint64(1) << wp.uint64(k)


@wp.func
def next_bits(bits: wp.uint64):
    """`bits` without the lowest."""
    return bits & (bits - wp.uint64(1))


@wp.func
def is_near(group: Group, i: int):
    """Whether roller i, between `low` and `high`, is near."""
    return ((group.near >> wp.uint64(i - group.first)) & wp.uint64(1)) != wp.uint64(0)


@cache
def neighbor_list(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that keep runs in rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    lanes = LANES[Real]
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    unlike = accessors(Real).unlike
    row = rows(capacity)

    @wp.func
    def groups(n: int):
        """Runs that so many rollers are at most where each but the last is a whole group."""
        return (n + GROUP - 1) // GROUP

    @wp.func
    def slots(n: int):
        """Runs that a partner has at most: whole groups, and two that end where others follow only later."""
        return groups(n) + 2

    @wp.func
    def crowded(drive: Drive):
        """Whether there is no place for so many runs."""
        return (drive.sprockets + drive.guides) * slots(drive.rollers) > wp.static(capacity)

    @wp.func
    def gather(w: wp.array[Real], n: int, p: int):
        """Keeps the rollers whose row says that they are near as the runs of partner p."""
        place = p * slots(n) - 1
        count = int(0)
        first = int(0)
        last = int(0)
        i = int(0)
        while i < n:
            if unlike(w, row.near + i, wp.min(wp.static(lanes), n - i), Real(0.0)) != wp.uint64(0):
                spare = i - last > APART and count + groups(n - i) < slots(n)
                if count == 0 or i - first >= GROUP or spare:
                    count = count + 1
                    first = i
                    store_row(w, row.run_first + place + count, Real(first))
                store_row(w, row.run_count + place + count, Real(i - first + wp.static(lanes)))
                last = i
            i = i + wp.static(lanes)
        store_row(w, row.runs + p, Real(count))

    @wp.func
    def mark_all(w: wp.array[Real], n: int):
        """Says of all rollers that they are near."""
        i = int(0)
        while i < whole(n):
            store_row(w, row.near + i, Real(1.0))
            i = i + 1

    @wp.func
    def reset(w: wp.array[Real], drive: Drive):
        """Makes the whole chain the runs of each partner, which hold for no step."""
        mark_all(w, drive.rollers)
        if not crowded(drive):
            for p in range(drive.sprockets + drive.guides):
                gather(w, drive.rollers, p)
        store_row(w, row.room, Real(0.0))
        store_row(w, row.room + 1, Real(0.0))

    @wp.func
    def needs_rebuild(w: wp.array[Real], drive: Drive):
        """Whether runs are to be made anew before forces are evaluated."""
        return not (load_row(w, row.room) > Real(0.0)) and drive.integrator == 0 and not crowded(drive)

    @wp.func
    def invalidate(w: wp.array[Real], velocity: wp.vec2d):
        """Ends the time for which runs hold if the center of a body, which has moved, is too fast."""
        limit = wp.float64(load_row(w, row.room + 1))
        if not (wp.dot(velocity, velocity) <= limit * limit):
            store_row(w, row.room, Real(0.0))

    @wp.func
    def skin(w: wp.array[Real]):
        """By how much partners are widened [m]."""
        return load_row(w, row.length) * wp.static(Real(SKIN))

    @wp.func
    def set_lifetime(w: wp.array[Real], drive: Drive):
        """For how many steps new runs hold, while none is a quarter faster than the fastest is now."""
        square = Real(0.0)
        for i in range(drive.rollers):
            vx = load_row(w, row.vx + i)
            vy = load_row(w, row.vy + i)
            square = wp.max(square, vx * vx + vy * vy)
        way = Real(0.35) * skin(w) / Real(drive.step)
        room = way / (Real(1.25) * wp.sqrt(square) + Real(1.0e-9))
        room = wp.floor(wp.clamp(room, Real(1.0), wp.static(Real(LONGEST))))
        store_row(w, row.room, room)
        store_row(w, row.room + 1, way / room)

    @wp.func
    def count(w: wp.array[Real], drive: Drive, p: int):
        """The number of runs of partner p."""
        if crowded(drive):
            return groups(drive.rollers)
        return int(load_row(w, row.runs + p))

    @wp.func
    def run(w: wp.array[Real], drive: Drive, p: int, k: int):
        """Run k of partner p: its first roller, a multiple of the lanes, and how many rollers, which is one too."""
        n = drive.rollers
        if crowded(drive):
            return k * GROUP, wp.min(whole(n - k * GROUP), GROUP)
        place = p * slots(n) + k
        return int(load_row(w, row.run_first + place)), int(load_row(w, row.run_count + place))

    @wp.func
    def group_of(first: int, near: wp.uint64, fresh: wp.uint64):
        """The group that begins at roller `first`; `near` is not 0."""
        group = Group()
        group.first = first
        group.near = near
        group.fresh = fresh
        group.low = first + (lowest_bit(near) & wp.static(-lanes))
        group.high = first + (highest_bit(near) & wp.static(-lanes)) + wp.static(lanes)
        return group

    @wp.func
    def whole_run(first: int, end: int):
        """The rollers from `first` on, before `end`, as a group."""
        group = Group()
        group.first = first
        group.low = first
        group.high = end
        return group

    return SimpleNamespace(**locals())
