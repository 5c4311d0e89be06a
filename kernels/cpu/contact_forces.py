"""Normal forces of rollers' contacts with one partner on the CPU, and powers of contacts and friction."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.contact import (
    is_changing_contact,
    normal_force,
    power_of_force,
    reaction_moment,
    relative_acceleration,
    steady_force,
)
from ..physics.impact import elastic_force, law_at_roller
from ..structs import types
from .contact_rows import contact_row_functions
from .neighbor_list import Group
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class ContactForceFunctions:
    """CPU contact force functions."""

    value_if_touching: wp.Function
    copy_row: wp.Function
    find_normal_forces: wp.Function
    add_measured_forces: wp.Function
    add_forces: wp.Function


@cache
def contact_force_functions(Real: type, capacity: int) -> ContactForceFunctions:
    """CPU contact force functions."""
    kinds = types(Real)
    Memory = kinds.Memory
    vec2 = kinds.vec2
    rollers = roller_functions(Real, capacity)
    access = row_access(Real)
    row = rows(capacity)
    contact_rows = contact_row_functions(Real, capacity)

    @wp.func
    def value_if_touching(w: wp.array[Real], i: int, value: Real):
        """`value` where roller `i` touches by its row, else 0."""
        # beyond the chain's end values may be no numbers
        return wp.where(access.load(w, row.penetration + i) > Real(0.0), value, Real(0.0))

    @wp.func
    def approach_acceleration(w: wp.array[Real], i: int, memory: Memory):
        """Acceleration [m/s^2] of the relative velocity of roller i's contact, by the forces in CPU rows so far."""
        arm = vec2(access.load(w, row.arm_x + i), access.load(w, row.arm_y + i))
        return relative_acceleration(
            memory.straight, memory.angular, arm, rollers.acceleration(w, i, memory.inverse_mass, memory.gravity)
        )

    @wp.func
    def normal_approach(w: wp.array[Real], i: int, memory: Memory):
        """Speed [m/s] at which roller i's penetration grows, and acceleration [m/s^2], by rows."""
        normal_x = access.load(w, row.normal_x + i)
        normal_y = access.load(w, row.normal_y + i)
        more = approach_acceleration(w, i, memory)
        speed = access.load(w, row.relative_x + i) * normal_x + access.load(w, row.relative_y + i) * normal_y
        return speed, more[0] * normal_x + more[1] * normal_y

    @wp.func
    def own_law(w: wp.array[Real], i: int, law: kinds.ContactLaw):
        """Contact law of roller i, by its mass in rows."""
        return law_at_roller(law, access.load(w, row.relative_mass + i), access.load(w, row.mobility + i))

    @wp.func
    def store_normal_force(w: wp.array[Real], i: int, size: Real, kept: Real, damper_speed: Real):
        """Stores roller i's normal force and the contact's memory in their rows."""
        x = value_if_touching(w, i, size * access.load(w, row.normal_x + i))
        y = value_if_touching(w, i, size * access.load(w, row.normal_y + i))
        access.store(w, row.force_x + i, x)
        access.store(w, row.force_y + i, y)
        access.store(w, row.force_size + i, size)
        access.store(w, row.v0_kept + i, kept)
        access.store(w, row.damper_speed + i, damper_speed)

    @wp.func
    def find_steady_force(w: wp.array[Real], i: int, law: kinds.ContactLaw, memory: Memory):
        """Stores in rows roller i's normal force for a contact that does not change within the step.

        Returns 1 if the contact's memory changes, plus 2 if it opens, closes or begins.
        """
        penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
        speed, growth = normal_approach(w, i, memory)
        speed_before = access.load(w, row.damper_speed + i)
        size, damper_speed = steady_force(penetration, speed, growth, before, speed_before, law)
        kept = wp.where(penetration > Real(0.0), before, access.load(w, row.v0_open + i))
        store_normal_force(w, i, size, kept, damper_speed)
        return wp.where(kept == before, 0, 1) | 2 * is_changing_contact(penetration, speed, growth, before, law)

    @wp.func
    def mend_changing_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Stores in rows normal forces of contacts that open, close or begin; returns 1."""
        i = group.low
        while i < group.high:
            penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
            speed, growth = normal_approach(w, i, memory)
            if is_changing_contact(penetration, speed, growth, before, law) != 0:
                speed_before = access.load(w, memory.damper_row + i)
                own = own_law(w, i, law)
                mean, elastic, size, first, damper = normal_force(penetration, speed, growth, before, speed_before, own)
                access.store(w, row.penetration + i, mean)
                kept = wp.where(mean > Real(0.0), first, access.load(w, row.v0_open + i))
                store_normal_force(w, i, size, kept, damper)
            i = i + 1
        return int(1)

    @wp.func
    def add_force(w: wp.array[Real], i: int):
        """Adds the contact force in its row to roller `i`, and stores its moment on the partner's body."""
        force = vec2(access.load(w, row.force_x + i), access.load(w, row.force_y + i))
        arm = vec2(access.load(w, row.arm_x + i), access.load(w, row.arm_y + i))
        access.store(w, row.fx + i, access.load(w, row.fx + i) + force[0])
        access.store(w, row.fy + i, access.load(w, row.fy + i) + force[1])
        access.store(w, row.reaction + i, value_if_touching(w, i, reaction_moment(arm, force)))

    @wp.func
    def copy_row(w: wp.array[Real], group: Group, source: int, to: int):
        """Copies the group's values from row `source` to row `to`."""
        # loops vectorize over rows whose place the compiler knows
        i = group.low
        while i < group.high:
            access.store(w, to + i, access.load(w, source + i))
            i = i + 1

    @wp.func
    def find_normal_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal forces of a group's contacts; returns 1 if memories change."""
        changed = int(0)
        i = group.low
        if memory.unlike_masses != 0:
            while i < group.high:
                changed = changed | find_steady_force(w, i, own_law(w, i, law), memory)
                i = i + 1
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            while i < group.high:
                changed = changed | find_steady_force(w, i, law, memory)
                i = i + 1
        while i < group.high:
            changed = changed | find_steady_force(w, i, law, memory)
            i = i + 1
        if changed > 1:
            changed = mend_changing_forces(w, group, law, memory)
        return changed

    @wp.func
    def find_powers(w: wp.array[Real], i: int, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Stores the powers of roller i's contact, with friction's where it `rubs`."""
        more = approach_acceleration(w, i, memory)
        speed_x = access.load(w, row.relative_x + i) + memory.lag * more[0]
        speed_y = access.load(w, row.relative_y + i) + memory.lag * more[1]
        elastic = elastic_force(access.load(w, row.penetration + i), law.stiffness, law.exponent)
        size = access.load(w, row.force_size + i) - wp.where(memory.lag > Real(0.0), Real(0.0), elastic)
        x, y = size * access.load(w, row.normal_x + i), size * access.load(w, row.normal_y + i)
        power = power_of_force(x, y, speed_x, speed_y)
        access.store(w, row.damper_power + i, value_if_touching(w, i, power))
        if rubs:
            x, y = access.load(w, row.friction_x + i), access.load(w, row.friction_y + i)
            power = power_of_force(x, y, speed_x, speed_y)
            access.store(w, row.friction_power + i, value_if_touching(w, i, power))

    @wp.func
    def add_measured_force(w: wp.array[Real], i: int, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Adds the contact force to roller `i`, stores moment and powers; returns 1 if it begins."""
        add_force(w, i)
        find_powers(w, i, law, rubs, memory)
        return contact_rows.is_beginning(w, i)

    @wp.func
    def add_measured_forces(
        w: wp.array[Real], group: Group, law: kinds.ContactLaw, friction: kinds.Friction, memory: Memory
    ):
        """Adds a group's contact forces to rollers, stores moments and powers; returns 1 if any begins."""
        began = int(0)
        rubs = friction.inertia > Real(0.0)
        i = group.low
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            if rubs:
                while i < group.high:
                    began = began | add_measured_force(w, i, law, True, memory)
                    i = i + 1
            while i < group.high:
                began = began | add_measured_force(w, i, law, False, memory)
                i = i + 1
        while i < group.high:
            began = began | add_measured_force(w, i, law, rubs, memory)
            i = i + 1
        return began

    @wp.func
    def add_forces(w: wp.array[Real], group: Group):
        """Adds a group's contact forces to rollers, and stores moments on the partner's body."""
        i = group.low
        while i < group.high:
            add_force(w, i)
            i = i + 1

    return ContactForceFunctions(
        value_if_touching=value_if_touching,
        copy_row=copy_row,
        find_normal_forces=find_normal_forces,
        add_measured_forces=add_measured_forces,
        add_forces=add_forces,
    )
