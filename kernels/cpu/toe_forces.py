"""Forces of wheel teeth on the toes of a silent chain, shared among pins (`physics.toe`).

Forces on near and far pins are kept in rows of their own until the wheel is done.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import is_changing_contact, normal_force, power_of_force, reaction_moment, steady_force
from ..physics.impact import elastic_force, law_at_roller
from ..physics.toe import force_on_far_pin
from ..structs import types
from .contact_rows import contact_row_functions
from .neighbor_list import Group, lowest_bit, without_lowest_bit
from .rollers import rows


@dataclass(frozen=True)
class ToeForceFunctions:
    """CPU functions of the forces of teeth on toes."""

    find_normal_forces: wp.Function
    add_forces: tuple[wp.Function, wp.Function]  # of links after pins, and of those before
    find_powers: wp.Function
    join_forces: wp.Function
    keep_forces: wp.Function


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

    @wp.func
    def find_steady_force(w: wp.array[Real], i: int, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal force of a contact that does not change within the step; returns 1 if it does."""
        penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
        speed, growth = find_approach(w, i, memory)
        own, held = own_law(w, i, law), access.load(w, row.damper_speed + i)
        size, damper = steady_force(penetration, speed, growth, before, held, own)
        access.store(w, row.held + i, held)
        store_normal_force(
            w, i, size, wp.where(penetration > Real(0.0), before, access.load(w, row.v0_open + i)), damper
        )
        changing = is_changing_contact(penetration, speed, growth, before, law)
        access.store(w, row.exception + i, Real(changing))
        return changing

    @wp.func
    def mend_changing_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal forces of contacts that open, close or begin within the step."""
        bits = access.find_unlike(w, row.exception + group.low, group.high - group.low, Real(0.0))
        while bits != wp.uint64(0):
            i = group.low + lowest_bit(bits)
            penetration, before = access.load(w, row.penetration + i), access.load(w, row.v0_before + i)
            speed, growth = find_approach(w, i, memory)
            own, held = own_law(w, i, law), access.load(w, row.held + i)
            mean, elastic, size, first, damper = normal_force(penetration, speed, growth, before, held, own)
            access.store(w, row.penetration + i, mean)
            kept = wp.where(mean > Real(0.0), first, access.load(w, row.v0_open + i))
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
        if changing != 0:
            mend_changing_forces(w, group, law, memory)

    def force_function(after: bool) -> wp.Function:
        """Function that adds contact forces on the links after pins, or before them."""
        apart, sign = int(after), 1.0 if after else -1.0
        to_x, to_y = (row.next_x + 1, row.next_y + 1) if after else (row.last_x + 1, row.last_y + 1)

        @wp.func
        def add_forces(w: wp.array[Real], group: Group):
            """Adds a group's contact forces to rows of their pins, and stores their moments on the wheel."""
            i = group.low
            while i < group.high:
                at = i + wp.static(apart)
                u = vec2(
                    wp.static(Real(sign)) * access.load(w, row.link_ux + at),
                    wp.static(Real(sign)) * access.load(w, row.link_uy + at),
                )
                force = vec2(access.load(w, row.force_x + i), access.load(w, row.force_y + i))
                closed = access.load(w, row.penetration + i) > Real(0.0)
                z = vec2(access.load(w, row.place_x + i), access.load(w, row.place_y + i))
                far = force_on_far_pin(force, z, u, access.load(w, row.link_length + at))
                far_x, far_y = wp.where(closed, far[0], Real(0.0)), wp.where(closed, far[1], Real(0.0))
                near_x, near_y = (
                    wp.where(closed, force[0] - far_x, Real(0.0)),
                    wp.where(closed, force[1] - far_y, Real(0.0)),
                )
                access.store(w, row.near_x + i, access.load(w, row.near_x + i) + near_x)
                access.store(w, row.near_y + i, access.load(w, row.near_y + i) + near_y)
                access.store(w, wp.static(to_x) + i, access.load(w, wp.static(to_x) + i) + far_x)
                access.store(w, wp.static(to_y) + i, access.load(w, wp.static(to_y) + i) + far_y)
                arm = vec2(access.load(w, row.arm_x + i), access.load(w, row.arm_y + i))
                access.store(w, row.reaction + i, wp.where(closed, reaction_moment(arm, force), Real(0.0)))
                i = i + 1

        return add_forces

    @wp.func
    def find_powers(w: wp.array[Real], group: Group, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Stores the powers of a group's contacts, with friction's where they rub; returns 1 if any contact begins.

        Accelerations are by contacts as in the step before: `join_forces` has the rest.
        """
        began = int(0)
        i = group.low
        while i < group.high:
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
            began = began | contact_rows.is_beginning(w, i)
            i = i + 1
        return began

    @wp.func
    def join_forces(w: wp.array[Real], n: int, memory: Memory):
        """Adds to each pin what a wheel's teeth exert on its two links.

        Returns the power [W] that contacts take less where pins accelerate by this, not as in the step before.
        """
        # rows of far pins' forces with one more at either end, so that the loop has no exceptions
        access.store(w, row.next_x, access.load(w, row.next_x + n))
        access.store(w, row.next_y, access.load(w, row.next_y + n))
        access.store(w, row.last_x + n + 1, access.load(w, row.last_x + 1))
        access.store(w, row.last_y + n + 1, access.load(w, row.last_y + 1))
        i = int(0)
        while i < n:
            x = access.load(w, row.near_x + i) + access.load(w, row.next_x + i) + access.load(w, row.last_x + i + 2)
            y = access.load(w, row.near_y + i) + access.load(w, row.next_y + i) + access.load(w, row.last_y + i + 2)
            access.store(w, row.near_x + i, x)
            access.store(w, row.near_y + i, y)
            access.store(w, row.fx + i, access.load(w, row.fx + i) + x)
            access.store(w, row.fy + i, access.load(w, row.fy + i) + y)
            i = i + 1
        less = Real(0.0)
        i = wp.where(memory.wanted.measures != 0, 0, n)
        while i < n:
            x, y = access.load(w, row.near_x + i), access.load(w, row.near_y + i)
            # with those joined before, so that all together take what they do in their sum
            change_x = Real(2.0) * access.load(w, row.fx + i) - x - access.load(w, row.toe_x + i)
            change_y = Real(2.0) * access.load(w, row.fy + i) - y - access.load(w, row.toe_y + i)
            less += access.load(w, row.mobility + i) * (x * change_x + y * change_y)
            i = i + 1
        return wp.float64(memory.lag * memory.inverse_mass * less)

    @wp.func
    def keep_forces(w: wp.array[Real], n: int):
        """Keeps the force of all contacts on each pin for the next step."""
        i = int(0)
        while i < n:
            access.store(w, row.toe_x + i, access.load(w, row.fx + i))
            access.store(w, row.toe_y + i, access.load(w, row.fy + i))
            i = i + 1

    return ToeForceFunctions(
        find_normal_forces=find_normal_forces,
        add_forces=(force_function(True), force_function(False)),
        find_powers=find_powers,
        join_forces=join_forces,
        keep_forces=keep_forces,
    )
