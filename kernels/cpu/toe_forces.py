"""Forces of wheel teeth on the toes of a silent chain, shared among pins (`physics.toe`).

Forces on far pins are kept in rows of their own until all wheels are done.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import normal_force, power_of_force, reaction_moment
from ..physics.impact import elastic_force, law_at_roller
from ..physics.toe import force_on_far_pin
from ..structs import types
from .contact_rows import contact_row_functions
from .neighbor_list import Group
from .rollers import rows


@dataclass(frozen=True)
class ToeForceFunctions:
    """CPU functions of the forces of teeth on toes."""

    find_normal_forces: wp.Function
    add_forces: wp.Function
    find_powers: wp.Function
    join_forces: wp.Function


@cache
def toe_force_functions(Real: type, capacity: int) -> ToeForceFunctions:
    """CPU functions of the forces of teeth on toes, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, vec2 = kinds.Memory, kinds.vec2
    row = rows(capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def find_normal_forces(w: wp.array[Real], group: Group, law: kinds.ContactLaw, memory: Memory):
        """Stores the normal forces of a group's contacts."""
        i = group.low
        while i < group.high:
            nx, ny = access.load(w, row.normal_x + i), access.load(w, row.normal_y + i)
            penetration = access.load(w, row.penetration + i)
            before = access.load(w, row.v0_before + i)
            mobility = access.load(w, row.point_mobility + i)
            pushed = wp.where(before > Real(0.0), access.load(w, memory.push_row + i), Real(0.0))
            speed = products(access.load(w, row.relative_x + i), nx, access.load(w, row.relative_y + i), ny)
            growth = products(access.load(w, row.more_x + i), nx, access.load(w, row.more_y + i), ny)
            growth = growth + memory.inverse_mass * mobility * pushed
            own = law_at_roller(law, Real(1.0) / mobility, mobility)
            held = access.load(w, memory.damper_row + i)
            mean, elastic, size, first, damper = normal_force(penetration, speed, growth, before, held, own)
            closed = mean > Real(0.0)
            size = wp.where(closed, size, Real(0.0))
            access.store(w, row.penetration + i, mean)
            access.store(w, row.force_size + i, size)
            access.store(w, row.force_x + i, wp.where(closed, size * nx, Real(0.0)))
            access.store(w, row.force_y + i, wp.where(closed, size * ny, Real(0.0)))
            access.store(w, row.v0_kept + i, wp.where(closed, first, access.load(w, row.v0_open + i)))
            access.store(w, row.damper_speed + i, wp.where(closed, damper, Real(0.0)))
            i = i + 1

    @wp.func
    def add_forces(w: wp.array[Real], group: Group, after: bool, memory: Memory):
        """Adds a group's contact forces to their two pins, and stores their moments on the wheel and what is kept."""
        sign, apart, to_x, to_y = Real(1.0), int(1), row.next_x, row.next_y
        if not after:
            sign, apart, to_x, to_y = Real(-1.0), int(0), row.last_x, row.last_y
        i = group.low
        while i < group.high:
            at = i + apart
            u = vec2(sign * access.load(w, row.link_ux + at), sign * access.load(w, row.link_uy + at))
            force = vec2(access.load(w, row.force_x + i), access.load(w, row.force_y + i))
            closed = access.load(w, row.penetration + i) > Real(0.0)
            z = vec2(access.load(w, row.place_x + i), access.load(w, row.place_y + i))
            far = force_on_far_pin(force, z, u, access.load(w, row.link_length + at))
            far_x, far_y = wp.where(closed, far[0], Real(0.0)), wp.where(closed, far[1], Real(0.0))
            access.store(w, row.fx + i, access.load(w, row.fx + i) + wp.where(closed, force[0] - far_x, Real(0.0)))
            access.store(w, row.fy + i, access.load(w, row.fy + i) + wp.where(closed, force[1] - far_y, Real(0.0)))
            access.store(w, to_x + i, access.load(w, to_x + i) + far_x)
            access.store(w, to_y + i, access.load(w, to_y + i) + far_y)
            arm = vec2(access.load(w, row.arm_x + i), access.load(w, row.arm_y + i))
            access.store(w, row.reaction + i, wp.where(closed, reaction_moment(arm, force), Real(0.0)))
            if memory.stage == 0:
                access.store(w, memory.push_row + i, access.load(w, row.force_size + i))
                access.store(w, memory.damper_row + i, access.load(w, row.damper_speed + i))
                access.store(w, memory.speed_row + i, access.load(w, row.v0_kept + i))
            i = i + 1

    @wp.func
    def find_powers(w: wp.array[Real], group: Group, law: kinds.ContactLaw, rubs: bool, memory: Memory):
        """Stores the powers of a group's contacts, with friction's where they rub; returns 1 if any contact begins."""
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
                access.store(
                    w, row.friction_power + i, wp.where(closed, power_of_force(x, y, speed_x, speed_y), Real(0.0))
                )
            began = began | contact_rows.is_beginning(w, i)
            i = i + 1
        return began

    @wp.func
    def join_forces(w: wp.array[Real], n: int, memory: Memory):
        """Adds to each pin what teeth exert on it by links of its neighbors, and keeps the teeth's force on it."""
        i = int(0)
        while i < n:
            before, behind = wp.where(i == 0, n - 1, i - 1), wp.where(i == n - 1, 0, i + 1)
            x = access.load(w, row.fx + i) + access.load(w, row.next_x + before) + access.load(w, row.last_x + behind)
            y = access.load(w, row.fy + i) + access.load(w, row.next_y + before) + access.load(w, row.last_y + behind)
            access.store(w, row.fx + i, x)
            access.store(w, row.fy + i, y)
            if memory.stage == 0:
                access.store(w, row.toe_x + i, x)
                access.store(w, row.toe_y + i, y)
            i = i + 1

    return ToeForceFunctions(
        find_normal_forces=find_normal_forces,
        add_forces=add_forces,
        find_powers=find_powers,
        join_forces=join_forces,
    )
