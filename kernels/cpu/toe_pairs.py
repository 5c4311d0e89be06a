"""Contacts of a silent chain's links with one wheel, run by run of its pins."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.toe import ENDS
from ..structs import Drive, Totals, types
from .contact_friction import contact_friction_functions
from .contact_rows import contact_row_functions
from .contact_sums import contact_sum_functions
from .link_runs import LinkRun, link_run_functions
from .near_rollers import near_roller_functions
from .neighbor_list import GROUP, Group, neighbor_list_functions
from .partners import partner_functions
from .pin_forces import pin_force_functions
from .rollers import rows
from .teeth import tooth_functions
from .toe_forces import toe_force_functions
from .toes import toe_functions


@dataclass(frozen=True)
class ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel, and what those of backs have in common with them."""

    add_run_of_toes: wp.Function
    add_back_forces: wp.Function


@cache
def toe_pair_functions(Real: type, capacity: int) -> ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Memory, Plate = kinds.Ensemble, kinds.State, kinds.Memory, kinds.Plate
    access = row_access(Real)
    partners = partner_functions(Real)
    link_runs = link_run_functions(Real, capacity)
    near_rollers = near_roller_functions(Real, capacity)
    teeth = tooth_functions(Real, capacity)
    toes = toe_functions(Real, capacity)
    toe_forces = toe_force_functions(Real, capacity)
    pin_forces = pin_force_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    contact_sums = contact_sum_functions(Real, capacity)
    contact_friction = contact_friction_functions(Real, capacity)
    row = rows(capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def add_friction(w: wp.array[Real], group: Group, pins: int, friction: kinds.Friction, memory: Memory):
        """Adds friction to forces of a group of contacts, whose bristles are those of `pins` more."""
        memory.first = memory.first + pins
        contact_friction.add_friction_forces(w, group, friction, memory)

    def force_function(on_teeth: bool) -> wp.Function:
        """Function that adds the forces of links' contacts on teeth or a guide."""
        sizes = row.sprocket_force if on_teeth else row.guide_force
        ends = int(ENDS) if on_teeth else 1
        find_normal_forces = toe_forces.find_normal_forces[int(not on_teeth)]
        add_to_pins = pin_forces.add_to_pins[int(not on_teeth)]

        @wp.func
        def add_contact_forces(
            w: wp.array[Real],
            run: LinkRun,
            law: kinds.ContactLaw,
            friction: kinds.Friction,
            memory: Memory,
            totals: wp.array[Totals],
            slot: int,
            n: int,
        ):
            """Adds the forces of a run's contacts to rows of pins and to the partner's totals."""
            measured = memory.wanted.measures != 0
            rubs = friction.inertia > Real(0.0)
            count = access.whole_vectors(run.count)
            contacts = access.shifted_rows(w, run.rows)
            find_normal_forces(contacts, count, law, memory)
            end = wp.where(rubs, 0, wp.static(ends))
            while end < wp.static(ends):
                group = neighbor_list.whole_group(end * GROUP, end * GROUP + count)
                add_friction(contacts, group, end * n + run.low - group.low, friction, memory)
                end = end + 1
            add_to_pins(w, run, count)
            if memory.stage == 0:
                link_runs.keep_contacts(w, run, wp.static(ends), memory)
            end = int(0)
            while end < wp.static(ends):
                group = neighbor_list.whole_group(end * GROUP, end * GROUP + run.count)
                if measured:
                    whole = neighbor_list.whole_group(group.low, group.low + count)
                    began = toe_forces.find_powers(contacts, whole, law, rubs, memory)
                    contact_sums.add_measured_totals(contacts, group, law, friction, memory.wanted, totals, slot)
                    if began != 0:
                        totals[slot].impacts += contact_sums.count_beginning(contacts, group)
                        if wp.static(on_teeth):
                            totals[slot].contacts += teeth.count_first_contacts(contacts, group)
                else:
                    contact_sums.add_totals(contacts, group, totals, slot, False, False)
                if memory.wanted.sizes != 0:
                    contact_rows.add_force_sizes(contacts, group, wp.static(sizes) - run.rows + run.low - group.low)
                end = end + 1

        return add_contact_forces

    add_toe_forces = force_function(True)

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
        links = toes.seated_run(w, drive, group, p)
        if links.count > 0:
            friction = partners.friction_of_partner(ensemble, drive, p)
            pose = state.poses[drive.first_body + p]
            own = plate_by_value(ensemble.plates[place])
            memory.straight = kinds.vec2(Real(pose.straight[0]), Real(pose.straight[1]))
            memory.angular = Real(pose.angular)
            memory.damper_row = contact_rows.damper_row(p * ENDS)
            memory.push_row = contact_rows.push_row(drive, p * ENDS)
            toes.find_contacts(w, links, own, partner.sprocket, partner.pose, partner.body, memory)
            slot = drive.first_sprocket + drive.first_guide + p
            add_toe_forces(w, links, partner.sprocket.law, friction, memory, state.totals, slot, n)

    return ToePairFunctions(
        add_run_of_toes=add_run_of_toes,
        add_back_forces=force_function(False),
    )
