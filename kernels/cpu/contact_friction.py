"""Friction of rollers' contacts with one partner on the CPU."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.contact import sliding_speed
from ..physics.friction import bristle_friction, friction_coefficient
from ..structs import types
from .contact_forces import contact_force_functions
from .neighbor_list import Group
from .rollers import rows


@dataclass(frozen=True)
class ContactFrictionFunctions:
    """CPU contact friction functions."""

    recall_bristles: wp.Function
    add_friction: wp.Function
    keep_bristles: wp.Function
    add_friction_forces: wp.Function


@cache
def contact_friction_functions(Real: type, capacity: int) -> ContactFrictionFunctions:
    """CPU contact friction functions."""
    kinds = types(Real)
    Memory = kinds.Memory
    row = rows(capacity)
    contact_forces = contact_force_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def roller_sliding_speed(w: wp.array[Real], i: int):
        """Sliding speed [m/s] of roller i's contact, by rows."""
        x, y = access.load(w, row.relative_x + i), access.load(w, row.relative_y + i)
        return sliding_speed(x, y, access.load(w, row.normal_x + i), access.load(w, row.normal_y + i))

    @wp.func
    def store_friction(w: wp.array[Real], i: int, drag: Real, holds: Real):
        """Stores in rows friction `drag` and bristle of roller i's contact, and adds it to the contact force."""
        # numbers, not vectors, which would keep loops from vectorizing
        x = contact_forces.value_if_touching(w, i, drag * -access.load(w, row.normal_y + i))
        y = contact_forces.value_if_touching(w, i, drag * access.load(w, row.normal_x + i))
        access.store(w, row.friction_x + i, x)
        access.store(w, row.friction_y + i, y)
        access.store(w, row.force_x + i, access.load(w, row.force_x + i) + x)
        access.store(w, row.force_y + i, access.load(w, row.force_y + i) + y)
        access.store(w, row.bristle + i, holds)

    @wp.func
    def recall_bristles(w: wp.array[Real], group: Group, memory: Memory):
        """Copies bristles' forces from contacts' memory to their row, 0 for beginning contacts."""
        i = group.low
        while i < group.high:
            held = Real(0.0)
            if access.load(w, row.penetration + i) > Real(0.0) and access.load(w, row.v0_before + i) > Real(0.0):
                held = access.load(memory.bristle, memory.first + i)
            access.store(w, row.bristle + i, held)
            i = i + 1

    @wp.func
    def keep_bristles(w: wp.array[Real], group: Group, memory: Memory):
        """Copies bristles' forces from their row to contacts' memory."""
        i = group.low
        while i < group.high:
            if access.load(w, row.penetration + i) > Real(0.0):
                access.store(memory.bristle, memory.first + i, access.load(w, row.bristle + i))
            i = i + 1

    @wp.func
    def add_friction(w: wp.array[Real], group: Group, friction: kinds.Friction, stretch_part: Real):
        """Adds friction to the contact forces of a group, whose bristles are in their row."""
        i = group.low
        while i < group.high:
            access.store(w, row.mu + i, friction.mu_dynamic)
            i = i + 1
        if friction.mu_static != friction.mu_dynamic:
            i = group.low
            while i < group.high:
                if access.load(w, row.force_size + i) > Real(0.0):
                    access.store(w, row.mu + i, friction_coefficient(wp.abs(roller_sliding_speed(w, i)), friction))
                i = i + 1
        i = group.low
        while i < group.high:
            size, mu, held = (
                access.load(w, row.force_size + i),
                access.load(w, row.mu + i),
                access.load(w, row.bristle + i),
            )
            drag, holds = bristle_friction(
                mu * size, roller_sliding_speed(w, i), held, friction.spring, friction.damper, stretch_part
            )
            store_friction(w, i, drag, holds)
            i = i + 1

    @wp.func
    def add_friction_forces(w: wp.array[Real], group: Group, friction: kinds.Friction, memory: Memory):
        """Adds friction to the contact forces of a group of rollers."""
        recall_bristles(w, group, memory)
        add_friction(w, group, friction, memory.stretch_part)
        if memory.stage == 0:
            keep_bristles(w, group, memory)

    return ContactFrictionFunctions(
        recall_bristles=recall_bristles,
        add_friction=add_friction,
        keep_bristles=keep_bristles,
        add_friction_forces=add_friction_forces,
    )
