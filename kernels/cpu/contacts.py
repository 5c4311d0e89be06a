"""What the CPU kernel's contacts with one partner answer: the passes that teeth, guide-bars and profiles share.

Rollers are looked at in groups of 64, of which a mask of bits says which are near the partner. What tracks a seat or a
piece goes from bit to bit; the rest are plain loops over rows, from the first roller that is near to the last, which
vectorize (see `rollers`). A roller in between that is not near has a penetration of 0, as one that does not touch.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import power_taken, pressed, reaction, rub, rub_evenly, stored
from ..physics.impact import elastic_force
from ..rows import LANES, accessors
from ..structs import Wanted, types
from ..sum_structs import Totals
from .rollers import passes, rows

GROUP = wp.constant(64)
"""Rollers of a group."""


@wp.struct
class Group:
    """Rollers one after the other of which some are near a partner."""

    first: wp.int32
    near: wp.uint64  # bit k: roller `first` + k is near
    fresh: wp.uint64  # and has no seat, or piece, yet
    low: wp.int32  # the first that is near, or up to `rows.LANES` - 1 before
    high: wp.int32  # after the last that is near, by a multiple of `rows.LANES` from `low`


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


@dataclass(frozen=True)
class Contacts:
    """The passes of contacts with one partner."""

    group_of: wp.Function
    leave_seats: wp.Function
    recall: wp.Function
    place_arm: wp.Function
    touch: wp.Function
    answer: wp.Function
    keep: wp.Function
    clear_sizes: wp.Function
    add_sizes: wp.Function


@cache
def contacts(Real: type, capacity: int) -> Contacts:
    """The passes of contacts with one partner, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    lanes = LANES[Real]
    vec2, accelerations = kinds.vec2, passes(Real, capacity).accelerations
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    store_seat, unlike_seat = accessors(wp.int32).store_row, accessors(wp.int32).unlike
    at = rows(capacity)
    FX, FY, BEFORE, OPEN, KEPT = at.fx, at.fy, at.before, at.open, at.kept
    PENETRATION, SIZE, DAMPER = at.penetration, at.size, at.damper
    SPROCKET_FORCE, GUIDE_FORCE = at.sprocket_force, at.guide_force
    ARM_X, ARM_Y, NORMAL_X, NORMAL_Y, RELATIVE_X, RELATIVE_Y = (
        at.arm_x,
        at.arm_y,
        at.normal_x,
        at.normal_y,
        at.relative_x,
        at.relative_y,
    )
    PRESS_X, PRESS_Y, DRAG_X, DRAG_Y = at.press_x, at.press_y, at.drag_x, at.drag_y
    MOMENT, DAMPED, RUBBED = at.moment_of, at.damped, at.rubbed

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
    def leave_seats(first: int, count: int, near: wp.uint64, memory: kinds.Memory):
        """Forgets the seats, or pieces, and contacts of rollers that are no longer near; who had one, as bits."""
        seated = unlike_seat(memory.seat, memory.first + first, count, -1)
        left = seated & ~near
        while left != wp.uint64(0):
            i = memory.first + first + lowest_bit(left)
            store_seat(memory.seat, i, -1)
            store_row(memory.impact_speed, i, Real(0.0))
            left = next_bits(left)
        return seated

    @wp.func
    def recall(w: wp.array[Real], i: int, group: Group, memory: kinds.Memory):
        """What roller i's contact has kept until now [m/s]."""
        before = Real(0.0)
        if is_near(group, i):
            before = load_row(memory.impact_speed, memory.first + i)
        store_row(w, BEFORE + i, before)
        return before

    @wp.func
    def keep(w: wp.array[Real], group: Group, memory: kinds.Memory):
        """What contacts keep from now on."""
        i = group.low
        while i < group.high:
            if is_near(group, i):
                store_row(memory.impact_speed, memory.first + i, load_row(w, KEPT + i))
            i = i + 1

    @wp.func
    def place_arm(w: wp.array[Real], i: int, x: Real, y: Real):
        """Where roller i is from the center of the partner's body."""
        store_row(w, ARM_X + i, x)
        store_row(w, ARM_Y + i, y)

    @wp.func
    def touch(
        w: wp.array[Real],
        i: int,
        penetration: Real,
        normal_x: Real,
        normal_y: Real,
        relative_x: Real,
        relative_y: Real,
    ):
        """How roller i stands on the partner, 0 or less deep where it does not touch; in numbers, not vectors."""
        store_row(w, PENETRATION + i, penetration)
        store_row(w, NORMAL_X + i, normal_x)
        store_row(w, NORMAL_Y + i, normal_y)
        store_row(w, RELATIVE_X + i, relative_x)
        store_row(w, RELATIVE_Y + i, relative_y)

    @wp.func
    def normal_of(w: wp.array[Real], i: int):
        """Normal of roller i's contact."""
        return vec2(load_row(w, NORMAL_X + i), load_row(w, NORMAL_Y + i))

    @wp.func
    def relative_of(w: wp.array[Real], i: int):
        """Relative velocity of roller i's contact [m/s]."""
        return vec2(load_row(w, RELATIVE_X + i), load_row(w, RELATIVE_Y + i))

    @wp.func
    def where_touching(w: wp.array[Real], i: int, value: Real):
        """`value` where roller i touches, else 0: beyond the chain's end values need not be numbers."""
        return wp.where(load_row(w, PENETRATION + i) > Real(0.0), value, Real(0.0))

    @wp.func
    def press_one(w: wp.array[Real], i: int, law: kinds.ContactLaw):
        """The normal force on roller i, and what its contact keeps; 1 if that is something else than before."""
        penetration = load_row(w, PENETRATION + i)
        normal_x = load_row(w, NORMAL_X + i)
        normal_y = load_row(w, NORMAL_Y + i)
        speed = load_row(w, RELATIVE_X + i) * normal_x + load_row(w, RELATIVE_Y + i) * normal_y
        x = Real(0.0)
        y = Real(0.0)
        size = Real(0.0)
        damper = Real(0.0)
        kept = load_row(w, OPEN + i)
        if penetration > Real(0.0):
            size, kept, damper, energy = pressed(penetration, speed, load_row(w, BEFORE + i), law)
            x = size * normal_x
            y = size * normal_y
        store_row(w, PRESS_X + i, x)
        store_row(w, PRESS_Y + i, y)
        store_row(w, SIZE + i, size)
        store_row(w, KEPT + i, kept)
        store_row(w, DAMPER + i, damper)
        return wp.where(kept == load_row(w, BEFORE + i), 0, 1)

    @wp.func
    def add_force(w: wp.array[Real], i: int):
        """Adds the force to that on roller i; its moment."""
        force = vec2(load_row(w, PRESS_X + i), load_row(w, PRESS_Y + i))
        arm = vec2(load_row(w, ARM_X + i), load_row(w, ARM_Y + i))
        store_row(w, FX + i, load_row(w, FX + i) + force[0])
        store_row(w, FY + i, load_row(w, FY + i) + force[1])
        store_row(w, MOMENT + i, where_touching(w, i, reaction(arm, force)))

    @wp.func
    def press(w: wp.array[Real], group: Group, law: kinds.ContactLaw):
        """Normal forces; of a linear law in a loop of its own, which vectorizes. 1 if contacts keep something else."""
        changed = int(0)
        i = group.low
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            while i < group.high:
                changed = changed | press_one(w, i, law)
                i = i + 1
        else:
            while i < group.high:
                changed = changed | press_one(w, i, law)
                i = i + 1
        return changed

    @wp.func
    def begins(w: wp.array[Real], i: int):
        """1 where roller i's contact begins."""
        return wp.where(load_row(w, PENETRATION + i) > Real(0.0) and load_row(w, BEFORE + i) <= Real(0.0), 1, 0)

    @wp.func
    def power_of(w: wp.array[Real], i: int, x: Real, y: Real, memory: kinds.Memory, chain: kinds.Chain):
        """Power that a force on roller i takes, as `contact.dissipated`."""
        ax, ay = accelerations(w, i, chain.inverse_mass, chain.gravity)
        speed_x = load_row(w, RELATIVE_X + i) - memory.lag * ax
        speed_y = load_row(w, RELATIVE_Y + i) - memory.lag * ay
        return where_touching(w, i, power_taken(x, y, speed_x, speed_y))

    @wp.func
    def lose_one(w: wp.array[Real], i: int, memory: kinds.Memory, chain: kinds.Chain):
        """Power that roller i's damper takes."""
        damper = load_row(w, DAMPER + i)
        x = damper * load_row(w, NORMAL_X + i)
        y = damper * load_row(w, NORMAL_Y + i)
        store_row(w, DAMPED + i, power_of(w, i, x, y, memory, chain))

    @wp.func
    def press_smoothly(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        memory: kinds.Memory,
        chain: kinds.Chain,
        measured: bool,
    ):
        """Forces of a linear law where nothing rubs, and what comes of them, in one loop.

        Returns 1 each if contacts keep something else, and if any begins.
        """
        law.exponent = Real(1.0)  # so that the compiler knows
        changed = int(0)
        began = int(0)
        i = group.low
        while i < group.high:
            changed = changed | press_one(w, i, law)
            add_force(w, i)
            if measured:
                lose_one(w, i, memory, chain)
                began = began | begins(w, i)
            i = i + 1
        return changed, began

    @wp.func
    def add_drag(w: wp.array[Real], i: int, drag: vec2):
        """Adds friction to the force on roller i."""
        x = where_touching(w, i, drag[0])
        y = where_touching(w, i, drag[1])
        store_row(w, DRAG_X + i, x)
        store_row(w, DRAG_Y + i, y)
        store_row(w, PRESS_X + i, load_row(w, PRESS_X + i) + x)
        store_row(w, PRESS_Y + i, load_row(w, PRESS_Y + i) + y)

    @wp.func
    def rub_rollers(w: wp.array[Real], group: Group, sliding: kinds.Sliding):
        """Friction; of one coefficient at all speeds in a loop of its own, which vectorizes."""
        i = group.low
        if sliding.law.mu_static == sliding.law.mu_dynamic:
            while i < group.high:
                add_drag(w, i, rub_evenly(load_row(w, SIZE + i), normal_of(w, i), relative_of(w, i), sliding))
                i = i + 1
        else:
            while i < group.high:
                add_drag(w, i, rub(load_row(w, SIZE + i), normal_of(w, i), relative_of(w, i), sliding))
                i = i + 1

    @wp.func
    def add_forces(w: wp.array[Real], group: Group):
        """Adds the forces to those on rollers; the moments of each."""
        i = group.low
        while i < group.high:
            add_force(w, i)
            i = i + 1

    @wp.func
    def clear_sizes(w: wp.array[Real], n: int):
        """Begins the sums of the forces' magnitudes anew."""
        i = int(0)
        while i < n:
            store_row(w, SPROCKET_FORCE + i, Real(0.0))
            store_row(w, GUIDE_FORCE + i, Real(0.0))
            i = i + 1

    @wp.func
    def add_sizes(w: wp.array[Real], group: Group, row: int):
        """Adds the forces' magnitudes to a row, which frames show."""
        i = group.low
        while i < group.high:
            store_row(w, row + i, load_row(w, row + i) + load_row(w, SIZE + i))
            i = i + 1

    @wp.func
    def lose(w: wp.array[Real], group: Group, sliding: kinds.Sliding, memory: kinds.Memory, chain: kinds.Chain):
        """Powers that dampers and friction take."""
        i = group.low
        while i < group.high:
            lose_one(w, i, memory, chain)
            i = i + 1
        if sliding.rubs != 0:
            i = group.low
            while i < group.high:
                x = load_row(w, DRAG_X + i)
                y = load_row(w, DRAG_Y + i)
                store_row(w, RUBBED + i, power_of(w, i, x, y, memory, chain))
                i = i + 1

    @wp.func
    def add_up(w: wp.array[Real], group: Group, totals: wp.array[Totals], slot: int, measured: bool, watched: bool):
        """Adds what the group's contacts add up to, roller by roller: where `measured`, what dampers take too, and
        where `watched`, the magnitudes of the forces.
        """
        moment = totals[slot].moment
        x = Real(totals[slot].push[0])
        y = Real(totals[slot].push[1])
        damped = totals[slot].dissipated
        force = totals[slot].force
        largest = totals[slot].force_max
        i = group.low
        while i < group.high:
            moment += wp.float64(load_row(w, MOMENT + i))
            x -= load_row(w, PRESS_X + i)
            y -= load_row(w, PRESS_Y + i)
            if measured:
                damped += wp.float64(load_row(w, DAMPED + i))
            if watched:
                size = wp.float64(load_row(w, SIZE + i))
                force += size
                largest = wp.max(largest, size)
            i = i + 1
        totals[slot].moment = moment
        totals[slot].push = wp.vec2d(wp.float64(x), wp.float64(y))
        if measured:
            totals[slot].dissipated = damped
        if watched:
            totals[slot].force = force
            totals[slot].force_max = largest

    @wp.func
    def begun(w: wp.array[Real], group: Group):
        """How many contacts began."""
        count = int(0)
        i = group.low
        while i < group.high:
            count = count + begins(w, i)
            i = i + 1
        return count

    @wp.func
    def add_energies(w: wp.array[Real], group: Group, law: kinds.ContactLaw, totals: wp.array[Totals], slot: int):
        """Adds elastic energies to the totals."""
        energy = totals[slot].energy
        i = group.low
        while i < group.high:
            penetration = load_row(w, PENETRATION + i)
            if penetration > Real(0.0):
                elastic = elastic_force(penetration, law.stiffness, law.exponent)
                energy += wp.float64(stored(penetration, elastic, law))
            i = i + 1
        totals[slot].energy = energy

    @wp.func
    def add_measured(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        sliding: kinds.Sliding,
        wanted: Wanted,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds what only metrics want to the totals."""
        if wanted.forces != 0:
            add_up(w, group, totals, slot, True, True)
        else:
            add_up(w, group, totals, slot, True, False)
        if wanted.energy != 0:
            add_energies(w, group, law, totals, slot)
        if sliding.rubs != 0:
            friction = totals[slot].friction
            i = group.low
            while i < group.high:
                friction += wp.float64(load_row(w, RUBBED + i))
                i = i + 1
            totals[slot].friction = friction

    @wp.func
    def answer(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        sliding: kinds.Sliding,
        memory: kinds.Memory,
        chain: kinds.Chain,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Forces of the contacts whose `touch` stands in the rows; adds them up in `totals[slot]`.

        Returns 1 if contacts keep something else from now on. Totals stand in memory: handed on by value, they would be
        copied where ways join.
        """
        measured = memory.wanted.measures != 0
        changed = int(0)
        began = int(1)
        if law.exponent == Real(1.0) and sliding.rubs == 0:
            if measured:
                changed, began = press_smoothly(w, group, law, memory, chain, True)
            else:
                changed, began = press_smoothly(w, group, law, memory, chain, False)
        else:
            changed = press(w, group, law)
            if sliding.rubs != 0:
                rub_rollers(w, group, sliding)
            add_forces(w, group)
            if measured:
                lose(w, group, sliding, memory, chain)
        if measured:
            add_measured(w, group, law, sliding, memory.wanted, totals, slot)
            if began != 0:
                totals[slot].impacts += begun(w, group)
        else:
            add_up(w, group, totals, slot, False, False)
        return changed

    return Contacts(
        group_of=group_of,
        leave_seats=leave_seats,
        recall=recall,
        place_arm=place_arm,
        touch=touch,
        answer=answer,
        keep=keep,
        clear_sizes=clear_sizes,
        add_sizes=add_sizes,
    )
