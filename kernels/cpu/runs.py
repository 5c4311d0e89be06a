"""Which rollers can come near a partner within the next steps: only these are looked at.

Every so often all rollers are held against each partner, widened by a margin. Those found are kept as runs of up to
`contacts.GROUP` rollers one after the other, those in between included. As long as no roller and no body is faster than
a limit, none of the others comes through more than 0.7 of the margin in the steps for which the runs hold, which leaves
more than float32 rounds off. So results do not depend on runs.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..rows import LANES, accessors, whole_lanes
from ..structs import Drive, types
from .contacts import GROUP
from .rollers import rows

MARGIN = 0.125
"""By how much partners are widened, of the first link's length."""
APART = wp.constant(16)
"""Rollers between two that are near from which on a run ends; where a sprocket has both ends of the chain, say."""
LONGEST = 64
"""Steps for which runs hold at most."""


@dataclass(frozen=True)
class Runs:
    """The runs of rollers that can come near the partners of one variant."""

    call_all: wp.Function
    forget: wp.Function
    used_up: wp.Function
    renew: wp.Function
    hurry: wp.Function
    margin: wp.Function
    gather: wp.Function
    count: wp.Function
    run: wp.Function


@cache
def runs(Real: type, capacity: int) -> Runs:
    """The functions that keep runs in rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    lanes = LANES[Real]
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    unlike = accessors(Real).unlike
    at = rows(capacity)
    VX, VY, LENGTH, NEAR = at.vx, at.vy, at.length, at.near
    RUN_FIRST, RUN_COUNT, RUNS, ROOM = at.run_first, at.run_count, at.runs, at.room

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
            if unlike(w, NEAR + i, wp.min(wp.static(lanes), n - i), Real(0.0)) != wp.uint64(0):
                spare = i - last > APART and count + groups(n - i) < slots(n)
                if count == 0 or i - first >= GROUP or spare:
                    count = count + 1
                    first = i
                    store_row(w, RUN_FIRST + place + count, Real(first))
                store_row(w, RUN_COUNT + place + count, Real(i - first + wp.static(lanes)))
                last = i
            i = i + wp.static(lanes)
        store_row(w, RUNS + p, Real(count))

    @wp.func
    def call_all(w: wp.array[Real], n: int):
        """Says of all rollers that they are near."""
        i = int(0)
        while i < whole(n):
            store_row(w, NEAR + i, Real(1.0))
            i = i + 1

    @wp.func
    def forget(w: wp.array[Real], drive: Drive):
        """Makes the whole chain the runs of each partner, which hold for no step."""
        call_all(w, drive.rollers)
        if not crowded(drive):
            for p in range(drive.sprockets + drive.guides):
                gather(w, drive.rollers, p)
        store_row(w, ROOM, Real(0.0))
        store_row(w, ROOM + 1, Real(0.0))

    @wp.func
    def used_up(w: wp.array[Real], drive: Drive):
        """Whether runs are to be made anew before forces are evaluated."""
        return not (load_row(w, ROOM) > Real(0.0)) and drive.integrator == 0 and not crowded(drive)

    @wp.func
    def hurry(w: wp.array[Real], velocity: wp.vec2d):
        """Ends the time for which runs hold if the center of a body, which has moved, is too fast."""
        limit = wp.float64(load_row(w, ROOM + 1))
        if not (wp.dot(velocity, velocity) <= limit * limit):
            store_row(w, ROOM, Real(0.0))

    @wp.func
    def margin(w: wp.array[Real]):
        """By how much partners are widened [m]."""
        return load_row(w, LENGTH) * wp.static(Real(MARGIN))

    @wp.func
    def renew(w: wp.array[Real], drive: Drive):
        """For how many steps new runs hold, at twice the speed of now."""
        square = Real(0.0)
        for i in range(drive.rollers):
            vx = load_row(w, VX + i)
            vy = load_row(w, VY + i)
            square = wp.max(square, vx * vx + vy * vy)
        way = Real(0.35) * margin(w) / Real(drive.step)
        room = way / (Real(2.0) * wp.sqrt(square) + Real(1.0e-9))
        room = wp.floor(wp.clamp(room, Real(1.0), wp.static(Real(LONGEST))))
        store_row(w, ROOM, room)
        store_row(w, ROOM + 1, way / room)

    @wp.func
    def count(w: wp.array[Real], drive: Drive, p: int):
        """How many runs partner p has."""
        if crowded(drive):
            return groups(drive.rollers)
        return int(load_row(w, RUNS + p))

    @wp.func
    def run(w: wp.array[Real], drive: Drive, p: int, k: int):
        """Run k of partner p: its first roller, a multiple of the lanes, and how many rollers, which is one too."""
        n = drive.rollers
        if crowded(drive):
            return k * GROUP, wp.min(whole(n - k * GROUP), GROUP)
        place = p * slots(n) + k
        return int(load_row(w, RUN_FIRST + place)), int(load_row(w, RUN_COUNT + place))

    return Runs(call_all, forget, used_up, renew, hurry, margin, gather, count, run)
