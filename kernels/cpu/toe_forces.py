"""Normal forces of contacts of a silent chain's links (`link_runs`), and powers of contacts and friction."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import is_changing_contact, normal_force, power_of_force, steady_force
from ..physics.impact import elastic_force, law_at_roller
from ..structs import types
from .contact_rows import contact_row_functions
from .neighbor_list import GROUP, Group, lowest_bit, without_lowest_bit
from .rollers import rows


@dataclass(frozen=True)
class ToeForceFunctions:
    """CPU functions of the forces of teeth on toes."""

    find_normal_forces: wp.Function
    find_powers: wp.Function


@cache
def toe_force_functions(Real: type, capacity: int) -> ToeForceFunctions:
    """CPU functions of the forces of teeth on toes, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, vec2 = kinds.Memory, kinds.vec2
    row = rows(capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def store_normal_force(w: wp.array[Real], i: int, size: Real, kept: Real, damper: Real):
        """Stores the normal force of pin i's contact, and what the contact keeps."""
        closed = access.load(w, row.penetration + i) > Real(0.0)
        size = wp.where(closed, size, Real(0.0))
        access.store(w, row.force_size + i, size)
        access.store(w, row.force_x + i, wp.where(closed, size * access.load(w, row.normal_x + i), Real(0.0)))
        access.store(w, row.force_y + i, wp.where(closed, size * access.load(w, row.normal_y + i), Real(0.0)))
        access.store(w, row.v0_kept + i, kept)
        access.store(w, row.damper_speed + i, wp.where(closed, damper, Real(0.0)))

    @wp.func
    def find_approach(w: wp.array[Real], i: int, memory: Memory):
        """Speed [m/s] at which pin i's contact closes, its rate by all else, and what acted until now [N]."""
        nx, ny = access.load(w, row.normal_x + i), access.load(w, row.normal_y + i)
        pushed = wp.where(access.load(w, row.v0_before + i) > Real(0.0), access.load(w, row.pushed + i), Real(0.0))
        speed = products(access.load(w, row.relative_x + i), nx, access.load(w, row.relative_y + i), ny)
        growth = products(access.load(w, row.more_x + i), nx, access.load(w, row.more_y + i), ny)
        return speed, growth + memory.inverse_mass * access.load(w, row.point_mobility + i) * pushed

    @wp.func
    def own_law(w: wp.array[Real], i: int, law: kinds.ContactLaw):
        """Contact law of pin i's contact, by the inverse mass of its place."""
        mobility = access.load(w, row.point_mobility + i)
        return law_at_roller(law, Real(1.0) / mobility, mobility)

    @wp.func(inline=True)
    def find_steady_force(w: wp.array[Real], i: int, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal force of a contact that does not change within the step; returns 1 if it does."""
        penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
        speed, growth = find_approach(w, i, memory)
        own, held = own_law(w, i, law), access.load(w, row.held + i)
        size, damper = steady_force(penetration, speed, growth, before, held, own)
        store_normal_force(
            w, i, size, wp.where(penetration > Real(0.0), before, access.load(w, row.v0_open + i)), damper
        )
        changing = is_changing_contact(penetration, speed, growth, before, law)
        access.store(w, row.exception + i, Real(changing))
        return changing

    @wp.func
    def mend_changing_forces(w: wp.array[Real], first: int, count: int, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal forces of `count` contacts from `first` on that open, close or begin within the step."""
        bits = access.find_unlike(w, row.exception + first, count, Real(0.0))
        while bits != wp.uint64(0):
            i = first + lowest_bit(bits)
            penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
            speed, growth = find_approach(w, i, memory)
            own, held = own_law(w, i, law), access.load(w, row.held + i)
            mean, elastic, size, begun, damper = normal_force(penetration, speed, growth, before, held, own)
            access.store(w, row.penetration + i, mean)
            kept = wp.where(mean > Real(0.0), begun, access.load(w, row.v0_open + i))
            store_normal_force(w, i, size, kept, damper)
            bits = without_lowest_bit(bits)

    @wp.func
    def find_normal_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal forces of a group's contacts."""
        changing = int(0)
        i = group.low
        if law.exponent == Real(1.0) and law.most_damping == Real(0.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            law.most_damping = Real(0.0)
            while i < group.high:
                changing = changing | find_steady_force(w, i, law, memory)
                i = i + 1
        while i < group.high:
            changing = changing | find_steady_force(w, i, law, memory)
            i = i + 1
        first = wp.where(changing != 0, group.low, group.high)
        while first < group.high:
            mend_changing_forces(w, first, wp.min(group.high - first, GROUP), law, memory)
            first = first + GROUP

    @wp.func
    def store_powers(w: wp.array[Real], i: int, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Stores the powers of pin i's contact, with friction's where it rubs; returns 1 if it begins."""
        closed = access.load(w, row.penetration + i) > Real(0.0)
        speed_x = access.load(w, row.relative_x + i) + memory.lag * access.load(w, row.more_x + i)
        speed_y = access.load(w, row.relative_y + i) + memory.lag * access.load(w, row.more_y + i)
        elastic = elastic_force(wp.max(access.load(w, row.penetration + i), Real(0.0)), law.stiffness, law.exponent)
        size = access.load(w, row.force_size + i) - wp.where(memory.lag > Real(0.0), Real(0.0), elastic)
        x, y = size * access.load(w, row.normal_x + i), size * access.load(w, row.normal_y + i)
        access.store(w, row.damper_power + i, wp.where(closed, power_of_force(x, y, speed_x, speed_y), Real(0.0)))
        if rubs:
            x, y = access.load(w, row.friction_x + i), access.load(w, row.friction_y + i)
            power = power_of_force(x, y, speed_x, speed_y)
            access.store(w, row.friction_power + i, wp.where(closed, power, Real(0.0)))
        return contact_rows.is_beginning(w, i)

    @wp.func
    def find_powers(w: wp.array[Real], group: Group, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Stores the powers of a group's contacts, with friction's where they rub; returns 1 if any contact begins.

        Accelerations are by contacts as in the step before: `join_forces` has the rest.
        """
        began = int(0)
        i = group.low
        if law.exponent == Real(1.0):
            law.exponent = Real(1.0)  # so that the compiler knows
            while i < group.high:
                began = began | store_powers(w, i, law, rubs, memory)
                i = i + 1
        while i < group.high:
            began = began | store_powers(w, i, law, rubs, memory)
            i = i + 1
        return began

    return ToeForceFunctions(find_normal_forces=find_normal_forces, find_powers=find_powers)
