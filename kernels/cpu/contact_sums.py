"""Totals over rollers' contacts with one partner on the CPU, group by group."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import larger, row_access
from ..physics.contact import contact_energy
from ..physics.impact import elastic_force
from ..structs import Now, Totals, types
from .contact_rows import contact_row_functions
from .neighbor_list import Group
from .rollers import rows


@dataclass(frozen=True)
class ContactSumFunctions:
    """CPU contact total functions."""

    add_totals: wp.Function
    count_beginning: wp.Function
    add_measured_totals: wp.Function


@cache
def contact_sum_functions(Real: type, capacity: int) -> ContactSumFunctions:
    """CPU contact total functions."""
    kinds = types(Real)
    access = row_access(Real)
    row = rows(capacity)
    contact_rows = contact_row_functions(Real, capacity)

    @wp.func
    def add_totals(w: wp.array[Real], group: Group, totals: wp.array[Totals], slot: int, measured: bool, rubs: bool):
        """Adds a group's contact forces and moments to totals; if `measured`, powers and sizes."""
        # one loop: each sum waits for its own last value only
        moment = totals[slot].moment
        x = Real(totals[slot].push[0])
        y = Real(totals[slot].push[1])
        damped = totals[slot].dissipated
        rubbed = totals[slot].friction
        force = totals[slot].force
        largest = Real(totals[slot].force_max)
        i = group.low
        while i < group.high:
            moment += wp.float64(access.load(w, row.reaction + i))
            x -= access.load(w, row.force_x + i)
            y -= access.load(w, row.force_y + i)
            if measured:
                damped += wp.float64(access.load(w, row.damper_power + i))
                size = access.load(w, row.force_size + i)
                force += wp.float64(size)
                largest = larger(largest, size)
            if rubs:
                rubbed += wp.float64(access.load(w, row.friction_power + i))
            i = i + 1
        totals[slot].moment = moment
        totals[slot].push = wp.vec2d(wp.float64(x), wp.float64(y))
        if measured:
            totals[slot].dissipated = damped
            totals[slot].force = force
            totals[slot].force_max = wp.float64(largest)
        if rubs:
            totals[slot].friction = rubbed

    @wp.func
    def count_beginning(w: wp.array[Real], group: Group):
        """Number of contacts of the group that begin."""
        count = int(0)
        i = group.low
        while i < group.high:
            count = count + contact_rows.is_beginning(w, i)
            i = i + 1
        return count

    @wp.func
    def add_energies(w: wp.array[Real], group: Group, law: kinds.ContactLaw, totals: wp.array[Totals], slot: int):
        """Adds elastic energies of a group's contacts to totals."""
        energy = totals[slot].energy
        i = group.low
        while i < group.high:
            penetration = access.load(w, row.penetration + i)
            if penetration > Real(0.0):
                elastic = elastic_force(penetration, law.stiffness, law.exponent)
                energy += wp.float64(contact_energy(penetration, elastic, law))
            i = i + 1
        totals[slot].energy = energy

    @wp.func
    def add_measured_totals(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        wanted: Now,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds a group's contact forces, moments, powers and, at the window's ends, energies to totals."""
        if friction.inertia > Real(0.0):
            add_totals(w, group, totals, slot, True, True)
        else:
            add_totals(w, group, totals, slot, True, False)
        if wanted.ends != 0:
            add_energies(w, group, law, totals, slot)

    return ContactSumFunctions(
        add_totals=add_totals, count_beginning=count_beginning, add_measured_totals=add_measured_totals
    )
