"""Contacts of a group of rollers with one partner: forces, what contacts keep, and what comes of them in metrics.

Teeth, guide-bars and profiles say with `touch` how rollers touch them; the rest is the same for all. What tracks a seat
or a piece goes from roller to roller; passes are plain loops over rows, from the first roller of the group that is near
to the last, which vectorize (see `rollers`). A roller in between that is not near has a penetration of 0, as one that
does not touch.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import accessors
from ..physics.contact import (
    contact_energy,
    is_changing,
    normal_force,
    power_of_force,
    reaction_moment,
    relative_acceleration,
    sliding_speed,
    steady_force,
)
from ..physics.friction import bristle_friction, friction_coefficient
from ..physics.impact import elastic_force
from ..structs import Drive, Now, Totals, types
from .neighbor_list import Group, is_near
from .rollers import ROWS, passes, rows


@cache
def contact_rows(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that write how rollers touch a partner, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, State = kinds.Memory, kinds.State
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    row = rows(capacity)

    @wp.func
    def recall(w: wp.array[Real], i: int, group: Group, memory: Memory):
        """The v0 that roller i's contact has kept until now [m/s]."""
        before = Real(0.0)
        if is_near(group, i):
            before = load_row(memory.impact_speed, memory.first + i)
        store_row(w, row.before + i, before)
        return before

    @wp.func
    def keep(w: wp.array[Real], group: Group, memory: Memory):
        """Sets the v0 that contacts keep from now on."""
        i = group.low
        while i < group.high:
            if is_near(group, i):
                store_row(memory.impact_speed, memory.first + i, load_row(w, row.kept + i))
            i = i + 1

    @wp.func
    def place_arm(w: wp.array[Real], i: int, x: Real, y: Real):
        """Where roller i is from the center of the partner's body."""
        store_row(w, row.arm_x + i, x)
        store_row(w, row.arm_y + i, y)

    @wp.func
    def touch(
        w: wp.array[Real], i: int, penetration: Real, normal_x: Real, normal_y: Real, relative_x: Real, relative_y: Real
    ):
        """Stores where roller i is to the partner, away where it is not near; in numbers, not vectors."""
        store_row(w, row.penetration + i, penetration)
        store_row(w, row.normal_x + i, normal_x)
        store_row(w, row.normal_y + i, normal_y)
        store_row(w, row.relative_x + i, relative_x)
        store_row(w, row.relative_y + i, relative_y)

    @wp.func
    def damper_row(p: int):
        """First index of the row of speeds at which dampers of contacts with partner p acted in the step before."""
        return wp.static(len(ROWS) * capacity) + p * wp.static(capacity)

    @wp.func
    def fetch_dampers(state: State, drive: Drive, w: wp.array[Real]):
        """Brings these rows from the state, as a launch begins."""
        for p in range(drive.sprockets + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                store_row(w, first + i, load_row(state.damper_speed, at + i))

    @wp.func
    def put_dampers_back(state: State, drive: Drive, w: wp.array[Real]):
        """Brings them back, as it ends."""
        for p in range(drive.sprockets + drive.guides):
            first, at = damper_row(p), drive.first_contact + p * drive.rollers
            for i in range(drive.rollers):
                store_row(state.damper_speed, at + i, load_row(w, first + i))

    @wp.func
    def begins(w: wp.array[Real], i: int):
        """1 where roller i's contact begins."""
        return wp.where(load_row(w, row.penetration + i) > Real(0.0) and load_row(w, row.before + i) <= Real(0.0), 1, 0)

    @wp.func
    def add_sizes(w: wp.array[Real], group: Group, sizes: int):
        """Adds the forces' magnitudes to those in row `sizes`, which frames show."""
        i = group.low
        while i < group.high:
            store_row(w, sizes + i, load_row(w, sizes + i) + load_row(w, row.size + i))
            i = i + 1

    return SimpleNamespace(**locals())


@cache
def contact_forces(Real: type, capacity: int) -> SimpleNamespace:
    """The forces of contacts whose `touch` is in the rows, with what dampers and friction take."""
    kinds = types(Real)
    Memory = kinds.Memory
    vec2, acceleration = kinds.vec2, passes(Real, capacity).acceleration
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    row, begins = rows(capacity), contact_rows(Real, capacity).begins

    @wp.func
    def where_touching(w: wp.array[Real], i: int, value: Real):
        """`value` where roller i touches, else 0: beyond the chain's end values need not be numbers."""
        return wp.where(load_row(w, row.penetration + i) > Real(0.0), value, Real(0.0))

    @wp.func
    def gaining(w: wp.array[Real], i: int, memory: Memory):
        """Acceleration of the relative velocity of roller i's contact [m/s^2], by the forces so far."""
        arm = vec2(load_row(w, row.arm_x + i), load_row(w, row.arm_y + i))
        return relative_acceleration(
            memory.straight, memory.angular, arm, acceleration(w, i, memory.inverse_mass, memory.gravity)
        )

    @wp.func
    def approach(w: wp.array[Real], i: int, memory: Memory):
        """The speed at which roller i's penetration grows [m/s], and its acceleration by the forces so far [m/s^2]."""
        normal_x = load_row(w, row.normal_x + i)
        normal_y = load_row(w, row.normal_y + i)
        more = gaining(w, i, memory)
        speed = load_row(w, row.relative_x + i) * normal_x + load_row(w, row.relative_y + i) * normal_y
        return speed, more[0] * normal_x + more[1] * normal_y

    @wp.func
    def store_press(w: wp.array[Real], i: int, size: Real, kept: Real, damper_speed: Real):
        """Stores the normal force on roller i, and what its contact keeps."""
        x = where_touching(w, i, size * load_row(w, row.normal_x + i))
        y = where_touching(w, i, size * load_row(w, row.normal_y + i))
        store_row(w, row.press_x + i, x)
        store_row(w, row.press_y + i, y)
        store_row(w, row.size + i, size)
        store_row(w, row.kept + i, kept)
        store_row(w, row.damper_speed + i, damper_speed)

    @wp.func
    def press_one(w: wp.array[Real], i: int, law: kinds.ContactLaw, memory: Memory):
        """The normal force on roller i as of a contact that does not change; 1 if it keeps something else, 2 if it does
        change.
        """
        penetration, before = load_row(w, row.penetration + i), load_row(w, row.before + i)
        speed, growth = approach(w, i, memory)
        speed_before = load_row(w, row.damper_speed + i)
        size, damper_speed = steady_force(penetration, speed, growth, before, speed_before, law)
        kept = wp.where(penetration > Real(0.0), before, load_row(w, row.open + i))
        store_press(w, i, size, kept, damper_speed)
        return wp.where(kept == before, 0, 1) | 2 * is_changing(penetration, speed, growth, before, law)

    @wp.func
    def press_changing(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Mends the normal forces of contacts that open, close or begin in this step, which are few; 1."""
        i = group.low
        while i < group.high:
            penetration, before = load_row(w, row.penetration + i), load_row(w, row.before + i)
            speed, growth = approach(w, i, memory)
            if is_changing(penetration, speed, growth, before, law) != 0:
                speed_before = load_row(w, memory.dampers + i)
                mean, elastic, size, first, damper = normal_force(penetration, speed, growth, before, speed_before, law)
                store_row(w, row.penetration + i, mean)
                kept = wp.where(mean > Real(0.0), first, load_row(w, row.open + i))
                store_press(w, i, size, kept, damper)
            i = i + 1
        return int(1)

    @wp.func
    def add_force(w: wp.array[Real], i: int):
        """Adds the force to that on roller i; its moment."""
        force = vec2(load_row(w, row.press_x + i), load_row(w, row.press_y + i))
        arm = vec2(load_row(w, row.arm_x + i), load_row(w, row.arm_y + i))
        store_row(w, row.fx + i, load_row(w, row.fx + i) + force[0])
        store_row(w, row.fy + i, load_row(w, row.fy + i) + force[1])
        store_row(w, row.moment_of + i, where_touching(w, i, reaction_moment(arm, force)))

    @wp.func
    def copy_row(w: wp.array[Real], group: Group, source: int, to: int):
        """Copies the group's values of a row; in one whose place the compiler knows loops vectorize."""
        i = group.low
        while i < group.high:
            store_row(w, to + i, load_row(w, source + i))
            i = i + 1

    @wp.func
    def press(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Normal forces; of a linear law in a loop of its own, which vectorizes. 1 if contacts keep something else."""
        changed = int(0)
        i = group.low
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            while i < group.high:
                changed = changed | press_one(w, i, law, memory)
                i = i + 1
        while i < group.high:
            changed = changed | press_one(w, i, law, memory)
            i = i + 1
        if changed > 1:
            changed = press_changing(w, group, law, memory)
        return changed

    @wp.func
    def power_of(w: wp.array[Real], i: int, x: Real, y: Real, memory: Memory):
        """Power that a force on roller i takes, as `contact.dissipated_power`."""
        more = gaining(w, i, memory)
        speed_x = load_row(w, row.relative_x + i) + memory.lag * more[0]
        speed_y = load_row(w, row.relative_y + i) + memory.lag * more[1]
        return where_touching(w, i, power_of_force(x, y, speed_x, speed_y))

    @wp.func
    def lose_one(w: wp.array[Real], i: int, law: kinds.ContactLaw, memory: Memory):
        """Power that roller i's contact takes but for friction; with stages that of its damper."""
        elastic = elastic_force(load_row(w, row.penetration + i), law.stiffness, law.exponent)
        size = load_row(w, row.size + i) - wp.where(memory.lag > Real(0.0), Real(0.0), elastic)
        x = size * load_row(w, row.normal_x + i)
        y = size * load_row(w, row.normal_y + i)
        store_row(w, row.damped + i, power_of(w, i, x, y, memory))

    @wp.func
    def add_measured_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Adds the forces of a linear law where nothing rubs to those on rollers, with their moments and powers, in one
        loop; 1 if any contact begins.
        """
        law.exponent = Real(1.0)  # so that the compiler knows
        began = int(0)
        i = group.low
        while i < group.high:
            add_force(w, i)
            lose_one(w, i, law, memory)
            began = began | begins(w, i)
            i = i + 1
        return began

    @wp.func
    def add_forces(w: wp.array[Real], group: Group):
        """Adds the forces to those on rollers; the moments of each."""
        i = group.low
        while i < group.high:
            add_force(w, i)
            i = i + 1

    @wp.func
    def lose(w: wp.array[Real], group: Group, law: kinds.ContactLaw, friction: kinds.Friction, memory: Memory):
        """Powers that contacts and friction take; of a linear law in a loop of its own, which vectorizes."""
        i = group.low
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            while i < group.high:
                lose_one(w, i, law, memory)
                i = i + 1
        while i < group.high:
            lose_one(w, i, law, memory)
            i = i + 1
        if friction.inertia > Real(0.0):
            i = group.low
            while i < group.high:
                x = load_row(w, row.drag_x + i)
                y = load_row(w, row.drag_y + i)
                store_row(w, row.rubbed + i, power_of(w, i, x, y, memory))
                i = i + 1

    return SimpleNamespace(**locals())


@cache
def contact_friction(Real: type, capacity: int) -> SimpleNamespace:
    """Friction of contacts whose normal forces are in the rows."""
    kinds = types(Real)
    Memory, row, where_touching = kinds.Memory, rows(capacity), contact_forces(Real, capacity).where_touching
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row

    @wp.func
    def slides(w: wp.array[Real], i: int):
        """Speed at which roller i's contact slides [m/s]."""
        x, y = load_row(w, row.relative_x + i), load_row(w, row.relative_y + i)
        return sliding_speed(x, y, load_row(w, row.normal_x + i), load_row(w, row.normal_y + i))

    @wp.func
    def add_drag(w: wp.array[Real], i: int, drag: Real, holds: Real):
        """Adds friction to the force on roller i, and sets what its contact holds; in numbers, not vectors."""
        x = where_touching(w, i, drag * -load_row(w, row.normal_y + i))
        y = where_touching(w, i, drag * load_row(w, row.normal_x + i))
        store_row(w, row.drag_x + i, x)
        store_row(w, row.drag_y + i, y)
        store_row(w, row.press_x + i, load_row(w, row.press_x + i) + x)
        store_row(w, row.press_y + i, load_row(w, row.press_y + i) + y)
        store_row(w, row.hold + i, holds)

    @wp.func
    def recall_holds(w: wp.array[Real], group: Group, memory: Memory):
        """Puts the friction that contacts have held until now into their row; none of one that begins."""
        i = group.low
        while i < group.high:
            held = Real(0.0)
            if load_row(w, row.penetration + i) > Real(0.0) and load_row(w, row.before + i) > Real(0.0):
                held = load_row(memory.hold, memory.first + i)
            store_row(w, row.hold + i, held)
            i = i + 1

    @wp.func
    def keep_holds(w: wp.array[Real], group: Group, memory: Memory):
        """Sets what the contacts hold from now on."""
        i = group.low
        while i < group.high:
            if load_row(w, row.penetration + i) > Real(0.0):
                store_row(memory.hold, memory.first + i, load_row(w, row.hold + i))
            i = i + 1

    @wp.func
    def rub_rollers(w: wp.array[Real], group: Group, friction: kinds.Friction, memory: Memory):
        """Friction; coefficients that hang on the speed in a loop of their own, which does not vectorize."""
        recall_holds(w, group, memory)
        i = group.low
        while i < group.high:
            store_row(w, row.mu + i, friction.mu_dynamic)
            i = i + 1
        if friction.mu_static != friction.mu_dynamic:
            i = group.low
            while i < group.high:
                if load_row(w, row.size + i) > Real(0.0):
                    store_row(w, row.mu + i, friction_coefficient(wp.abs(slides(w, i)), friction))
                i = i + 1
        i = group.low
        while i < group.high:
            size, mu, held = load_row(w, row.size + i), load_row(w, row.mu + i), load_row(w, row.hold + i)
            drag, holds = bristle_friction(
                mu * size, slides(w, i), held, friction.spring, friction.damper, memory.stretched
            )
            add_drag(w, i, drag, holds)
            i = i + 1
        if memory.stage == 0:
            keep_holds(w, group, memory)

    return SimpleNamespace(**locals())


@cache
def contact_sums(Real: type, capacity: int) -> SimpleNamespace:
    """The sums over a group's contacts, and over all groups of a partner."""
    kinds = types(Real)
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    row, begins = rows(capacity), contact_rows(Real, capacity).begins

    @wp.func
    def add_up(w: wp.array[Real], group: Group, totals: wp.array[Totals], slot: int, measured: bool):
        """Adds what the group's contacts add up to, roller by roller: where `measured`, what dampers take and the
        magnitudes of the forces, too.
        """
        moment = totals[slot].moment
        x = Real(totals[slot].push[0])
        y = Real(totals[slot].push[1])
        damped = totals[slot].dissipated
        force = totals[slot].force
        largest = totals[slot].force_max
        i = group.low
        while i < group.high:
            moment += wp.float64(load_row(w, row.moment_of + i))
            x -= load_row(w, row.press_x + i)
            y -= load_row(w, row.press_y + i)
            if measured:
                damped += wp.float64(load_row(w, row.damped + i))
                size = wp.float64(load_row(w, row.size + i))
                force += size
                largest = wp.max(largest, size)
            i = i + 1
        totals[slot].moment = moment
        totals[slot].push = wp.vec2d(wp.float64(x), wp.float64(y))
        if measured:
            totals[slot].dissipated = damped
            totals[slot].force = force
            totals[slot].force_max = largest

    @wp.func
    def begun(w: wp.array[Real], group: Group):
        """The number of contacts that began."""
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
            penetration = load_row(w, row.penetration + i)
            if penetration > Real(0.0):
                elastic = elastic_force(penetration, law.stiffness, law.exponent)
                energy += wp.float64(contact_energy(penetration, elastic, law))
            i = i + 1
        totals[slot].energy = energy

    @wp.func
    def add_measured(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        wanted: Now,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds what only metrics want to the totals."""
        add_up(w, group, totals, slot, True)
        if wanted.ends != 0:
            add_energies(w, group, law, totals, slot)
        if friction.inertia > Real(0.0):
            taken = totals[slot].friction
            i = group.low
            while i < group.high:
                taken += wp.float64(load_row(w, row.rubbed + i))
                i = i + 1
            totals[slot].friction = taken

    return SimpleNamespace(**locals())
