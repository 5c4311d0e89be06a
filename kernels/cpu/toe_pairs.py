"""Contacts of a silent chain's links with one wheel, run by run of its pins."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import LANES
from ..physics.toe import ENDS
from ..structs import Drive, Totals, types
from .contact_forces import contact_force_functions
from .contact_friction import contact_friction_functions
from .contact_rows import contact_row_functions
from .contact_sums import contact_sum_functions
from .near_rollers import near_roller_functions
from .neighbor_list import Group, neighbor_list_functions
from .partners import partner_functions
from .rollers import rows
from .teeth import tooth_functions
from .toe_forces import toe_force_functions
from .toes import toe_functions


@dataclass(frozen=True)
class ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel, and what those of backs have in common with them."""

    add_run_of_toes: wp.Function
    recall_contacts: wp.Function
    add_back_forces: wp.Function


@cache
def toe_pair_functions(Real: type, capacity: int) -> ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Memory, Plate = kinds.Ensemble, kinds.State, kinds.Memory, kinds.Plate
    partners = partner_functions(Real)
    near_rollers = near_roller_functions(Real, capacity)
    teeth = tooth_functions(Real, capacity)
    toes = toe_functions(Real, capacity)
    toe_forces = toe_force_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    contact_forces = contact_force_functions(Real, capacity)
    contact_sums = contact_sum_functions(Real, capacity)
    contact_friction = contact_friction_functions(Real, capacity)
    row = rows(capacity)
    wide = wp.constant(2 * LANES[Real])  # pins at a time that these long loops take; others would go one by one
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.struct
    class ToeRun:
        """Pins of a wheel's run, in whole vectors."""

        group: Group
        last: wp.int32  # after the run's last pin; beyond it none is seated
        slot: wp.int32  # of the wheel's totals

    @wp.func
    def recall_contacts(w: wp.array[Real], group: Group, memory: Memory):
        """Copies what a group's contacts of links have kept to its rows."""
        contact_forces.copy_row(w, group, memory.speed_row, row.v0_before)
        contact_forces.copy_row(w, group, memory.push_row, row.pushed)
        contact_forces.copy_row(w, group, memory.damper_row, row.damper_speed)

    def force_function(after: bool, on_teeth: bool) -> wp.Function:
        """Function that adds the forces of contacts of links after pins, or before them, on teeth or a guide."""
        add_forces = toe_forces.add_forces[int(not after)]
        sizes = row.sprocket_force if on_teeth else row.guide_force

        @wp.func
        def add_contact_forces(
            w: wp.array[Real],
            group: Group,
            law: kinds.ContactLaw,
            friction: kinds.Friction,
            memory: Memory,
            totals: wp.array[Totals],
            slot: int,
        ):
            """Adds the forces of a group's contacts to rows of pins and to the partner's totals."""
            measured = memory.wanted.measures != 0
            toe_forces.find_normal_forces(w, group, law, memory)
            if friction.inertia > Real(0.0):
                contact_friction.add_friction_forces(w, group, friction, memory)
            add_forces(w, group)
            if memory.stage == 0:
                contact_forces.copy_row(w, group, row.v0_kept, memory.speed_row)
                contact_forces.copy_row(w, group, row.force_size, memory.push_row)
                contact_forces.copy_row(w, group, row.damper_speed, memory.damper_row)
            if measured:
                began = toe_forces.find_powers(w, group, law, friction.inertia > Real(0.0), memory)
                contact_sums.add_measured_totals(w, group, law, friction, memory.wanted, totals, slot)
                if began != 0:
                    totals[slot].impacts += contact_sums.count_beginning(w, group)
                    if wp.static(on_teeth):
                        totals[slot].contacts += teeth.count_first_contacts(w, group)
            else:
                contact_sums.add_totals(w, group, totals, slot, False, False)
            if memory.wanted.sizes != 0:
                contact_rows.add_force_sizes(w, group, wp.static(sizes))

        return add_contact_forces

    def end_function(end: int) -> wp.Function:
        """Function that adds the forces of flank end `end`."""
        find_contacts, add_forces = toes.find_contacts[end], force_function(end < 2, True)

        @wp.func
        def add_end_forces(
            w: wp.array[Real],
            run: ToeRun,
            plate: Plate,
            partner: partners.Partner,
            friction: kinds.Friction,
            memory: Memory,
            totals: wp.array[Totals],
        ):
            """Adds the forces of one flank end at a run's pins to rows of pins and to the wheel's totals."""
            recall_contacts(w, run.group, memory)
            find_contacts(w, run.group, run.last, plate, partner.sprocket, partner.pose, partner.body, memory)
            add_forces(w, run.group, partner.sprocket.law, friction, memory, totals, run.slot)

        return add_end_forces

    first_end, second_end, third_end, fourth_end = (end_function(end) for end in range(int(ENDS)))

    @wp.func
    def plate_by_value(plate: Plate):
        """A plate whose values loops keep, as no row can lie in its place."""
        own = Plate()
        own.begin = plate.begin
        own.tip = plate.tip
        own.radius = plate.radius
        own.cos_flank = plate.cos_flank
        own.sin_flank = plate.sin_flank
        own.side = plate.side
        return own

    @wp.func
    def next_end(memory: Memory, n: int):
        """Memory of the next flank end's contacts of `n` pins."""
        memory.first = memory.first + n
        memory.damper_row = memory.damper_row + wp.static(capacity)
        memory.push_row = memory.push_row + wp.static(capacity)
        memory.speed_row = memory.speed_row + wp.static(capacity)
        return memory

    @wp.func(inline=False)
    def add_run_of_toes(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        place: int,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: Memory,
    ):
        """Adds the forces of wheel `p` on the links of one run of pins, to rows of pins and to totals."""
        n = drive.rollers
        first, count = neighbor_list.run_span(w, drive, p, run)
        partner = partners.sprocket_partner(ensemble, state, drive, p)
        memory.speed_row = contact_rows.speed_row(drive, p * ENDS)
        group = near_rollers.find_gap_contacts(w, ensemble, first, first + count, n, partner, memory)
        if group.high > group.low:
            some = ToeRun()
            some.last = group.high
            some.slot = drive.first_sprocket + drive.first_guide + p
            group.high = group.low + (group.high - group.low + wide - 1) // wide * wide
            some.group = group
            friction = partners.friction_of_partner(ensemble, drive, p)
            pose = state.poses[drive.first_body + p]
            own = plate_by_value(ensemble.plates[place])
            memory.straight = kinds.vec2(Real(pose.straight[0]), Real(pose.straight[1]))
            memory.angular = Real(pose.angular)
            memory.damper_row = contact_rows.damper_row(p * ENDS)
            memory.push_row = contact_rows.push_row(drive, p * ENDS)
            first_end(w, some, own, partner, friction, memory, state.totals)
            memory = next_end(memory, n)
            second_end(w, some, own, partner, friction, memory, state.totals)
            memory = next_end(memory, n)
            third_end(w, some, own, partner, friction, memory, state.totals)
            memory = next_end(memory, n)
            fourth_end(w, some, own, partner, friction, memory, state.totals)

    return ToePairFunctions(
        add_run_of_toes=add_run_of_toes,
        recall_contacts=recall_contacts,
        add_back_forces=force_function(True, False),
    )
