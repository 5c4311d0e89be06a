"""Forces of one partner's contacts on a silent chain's links, of a run of links after pins and of one before them."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.toe import LINK_ENDS
from ..structs import Totals, types
from .contact_friction import contact_friction_functions
from .contact_rows import contact_row_functions
from .contact_sums import contact_sum_functions
from .link_runs import ENDS_APART, LinkRun, link_run_functions
from .neighbor_list import Group, neighbor_list_functions
from .pin_forces import pin_force_functions
from .rollers import rows
from .teeth import tooth_functions
from .toe_forces import toe_force_functions


@dataclass(frozen=True)
class LinkForceFunctions:
    """CPU functions of forces on a silent chain's links."""

    run_of_side: wp.Function
    add_contact_forces: wp.Function


@cache
def link_force_functions(Real: type, capacity: int, on_teeth: bool) -> LinkForceFunctions:
    """CPU functions of forces of wheel teeth on links, or of guides, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory = kinds.Memory
    access = row_access(Real)
    row = rows(capacity)
    sizes = row.sprocket_force if on_teeth else row.guide_force
    ends, sides = (int(LINK_ENDS), 2) if on_teeth else (1, 1)
    link_runs = link_run_functions(Real, capacity)
    teeth = tooth_functions(Real, capacity)
    toe_forces = toe_force_functions(Real, capacity)
    add_to_pins = pin_force_functions(Real, capacity).add_to_pins[int(not on_teeth)]
    contact_rows = contact_row_functions(Real, capacity)
    contact_sums = contact_sum_functions(Real, capacity)
    contact_friction = contact_friction_functions(Real, capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def run_of_side(after: LinkRun, before: LinkRun, side: int):
        """Run of links after pins, of side 0, or before them."""
        if side == 0:
            return after
        return before

    @wp.func
    def copy_bristles(contacts: wp.array[Real], run: LinkRun, end: int, at: int, keeps: bool, memory: Memory):
        """Copies bristles' forces of a run's contacts with end `end`, from `at` on, from memory or to it."""
        group = neighbor_list.whole_group(at, at + run.pitch)
        memory.first = memory.first + (run.end + end) * run.pins + run.low - at
        if keeps:
            contact_friction.keep_bristles(contacts, group, memory)
        else:
            contact_friction.recall_bristles(contacts, group, memory)

    @wp.func
    def add_friction(
        contacts: wp.array[Real],
        after: LinkRun,
        before: LinkRun,
        end: int,
        friction: kinds.Friction,
        memory: Memory,
    ):
        """Adds friction to the forces of two runs' contacts with one end."""
        at = end * ENDS_APART
        middle = at + after.pitch
        copy_bristles(contacts, after, end, at, False, memory)
        copy_bristles(contacts, before, end, middle, False, memory)
        contact_friction.add_friction(
            contacts, neighbor_list.whole_group(at, middle + before.pitch), friction, memory.stretch_part
        )
        if memory.stage == 0:
            copy_bristles(contacts, after, end, at, True, memory)
            copy_bristles(contacts, before, end, middle, True, memory)

    @wp.func
    def add_run(w: wp.array[Real], run: LinkRun, memory: Memory):
        """Adds the forces of a run's contacts to rows of pins, and keeps what the next step needs of them."""
        add_to_pins(w, run)
        if memory.stage == 0:
            link_runs.keep_contacts(w, run, wp.static(ends), memory)
        if memory.wanted.sizes != 0:
            contacts = access.shifted_rows(w, run.rows)
            for end in range(wp.static(ends)):
                low = end * ENDS_APART
                of_end = neighbor_list.whole_group(low, low + run.count)
                contact_rows.add_force_sizes(contacts, of_end, wp.static(sizes) - run.rows + run.low - low)

    @wp.func
    def add_totals(
        contacts: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        memory: Memory,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds a group's contacts to the partner's totals."""
        if memory.wanted.measures != 0:
            began = toe_forces.find_powers(contacts, group, law, friction.inertia > Real(0.0), memory)
            contact_sums.add_measured_totals(contacts, group, law, friction, memory.wanted, totals, slot)
            if began != 0:
                totals[slot].impacts += contact_sums.count_beginning(contacts, group)
                if wp.static(on_teeth):
                    totals[slot].contacts += teeth.count_first_contacts(contacts, group)
        else:
            contact_sums.add_totals(contacts, group, totals, slot, False, False)

    @wp.func
    def add_contact_forces(
        w: wp.array[Real],
        after: LinkRun,
        before: LinkRun,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        memory: Memory,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds the forces of two runs' contacts to rows of pins and to the partner's totals."""
        contacts, count = access.shifted_rows(w, after.rows), after.pitch + before.pitch
        end = int(0)
        while end < wp.static(ends):
            group = neighbor_list.whole_group(end * ENDS_APART, end * ENDS_APART + count)
            toe_forces.find_normal_forces(contacts, group, law, memory)
            if friction.inertia > Real(0.0):
                add_friction(contacts, after, before, end, friction, memory)
            end = end + 1
        side = int(0)
        while side < wp.static(sides):
            add_run(w, run_of_side(after, before, side), memory)
            side = side + 1
        end = int(0)
        while end < wp.static(ends):
            group = neighbor_list.whole_group(end * ENDS_APART, end * ENDS_APART + count)
            add_totals(contacts, group, law, friction, memory, totals, slot)
            end = end + 1

    return LinkForceFunctions(run_of_side=run_of_side, add_contact_forces=add_contact_forces)
