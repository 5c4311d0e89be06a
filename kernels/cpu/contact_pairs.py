"""Contacts of one variant's rollers with sprockets and guides on the CPU, run by run."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.back import back_count
from ..physics.body import wrench_with_force
from ..structs import GROUND, Drive, Now, Totals, types
from .backs import back_functions
from .contact_forces import contact_force_functions
from .contact_friction import contact_friction_functions
from .contact_rows import contact_row_functions
from .contact_sums import contact_sum_functions
from .guides import guide_functions
from .link_motions import link_motion_functions
from .near_rollers import near_roller_functions
from .neighbor_list import Group, neighbor_list_functions
from .partners import partner_functions
from .pin_forces import pin_force_functions
from .rollers import rows
from .seats import seat_functions
from .teeth import tooth_functions
from .toe_pairs import toe_pair_functions


@dataclass(frozen=True)
class ContactPairFunctions:
    """CPU contact pair functions."""

    add_contact_forces: wp.Function


@cache
def contact_pair_functions(Real: type, capacity: int, silent: bool) -> ContactPairFunctions:
    """CPU contact pair functions, with silent chains only where `silent`."""
    kinds = types(Real)
    Ensemble, State, Memory = kinds.Ensemble, kinds.State, kinds.Memory
    access = row_access(Real)
    partners = partner_functions(Real)
    near_rollers = near_roller_functions(Real, capacity)
    seats = seat_functions(Real, capacity)
    teeth = tooth_functions(Real, capacity)
    motions = link_motion_functions(Real, capacity)
    pin_forces = pin_force_functions(Real, capacity)
    toe_pairs = toe_pair_functions(Real, capacity)
    backs = back_functions(Real, capacity)
    guides = guide_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    contact_forces = contact_force_functions(Real, capacity)
    contact_sums = contact_sum_functions(Real, capacity)
    contact_friction = contact_friction_functions(Real, capacity)
    row = rows(capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def find_guide_contacts(
        w: wp.array[Real], ensemble: Ensemble, first: int, end: int, n: int, partner: partners.Partner, memory: Memory
    ):
        """Stores contacts of rollers `first` to before `end` with a guide; returns the group that may touch."""
        group = near_rollers.near_group(w, first, end, n, partner, memory)
        if partner.guide.pieces == 0:
            guides.find_bar_contacts(w, group, partner.guide, partner.pose, memory)
        else:
            guides.find_profile_contacts(w, group, partner.guide, partner.pose, ensemble.pieces, memory)
        return group

    @wp.func
    def find_run_contacts(
        ensemble: Ensemble, state: State, drive: Drive, w: wp.array[Real], p: int, run: int, memory: Memory
    ):
        """Stores contacts of one run of rollers with partner `p`; returns the group that may touch."""
        n = drive.rollers
        first, count = neighbor_list.run_span(w, drive, p, run)
        if p < drive.sprockets:
            partner = partners.sprocket_partner(ensemble, state, drive, p)
            group = near_rollers.find_gap_contacts(w, ensemble, first, first + count, n, partner, memory)
            teeth.find_contacts(w, group.low, group.high, partner.sprocket, partner.pose, partner.body)
            return group
        guide = partners.guide_partner(ensemble, state, drive, p - drive.sprockets)
        group = find_guide_contacts(w, ensemble, first, first + count, n, guide, memory)
        return group

    @wp.func
    def add_group_forces(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        memory: Memory,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Adds a group's contact forces to rollers and `totals[slot]`; returns 1 if memories change."""
        # totals stay in memory: by value they would be copied where branches join
        measured = memory.wanted.measures != 0
        if law.answer > Real(0.0):
            contact_forces.copy_row(w, group, memory.damper_row, row.damper_speed)
        changed = contact_forces.find_normal_forces(w, group, law, memory)
        if friction.inertia > Real(0.0):
            contact_friction.add_friction_forces(w, group, friction, memory)
        began = int(0)
        if measured:
            began = contact_forces.add_measured_forces(w, group, law, friction, memory)
        else:
            contact_forces.add_forces(w, group)
        if law.answer > Real(0.0):
            contact_forces.copy_row(w, group, row.damper_speed, memory.damper_row)
        if measured:
            contact_sums.add_measured_totals(w, group, law, friction, memory.wanted, totals, slot)
            if began != 0:
                totals[slot].impacts += contact_sums.count_beginning(w, group)
        else:
            contact_sums.add_totals(w, group, totals, slot, False, False)
        return changed

    @wp.func
    def add_counts_and_sizes(
        w: wp.array[Real], group: Group, on_teeth: bool, impacts: int, wanted: Now, totals: wp.array[Totals], slot: int
    ):
        """Adds first contacts and missed faces to totals, force sizes to rows for frames."""
        if wanted.sizes != 0:
            contact_rows.add_force_sizes(w, group, wp.where(on_teeth, row.sprocket_force, row.guide_force))
        if wanted.measures != 0:
            if on_teeth:
                if totals[slot].impacts != impacts:
                    totals[slot].contacts += teeth.count_first_contacts(w, group)
            else:
                totals[slot] = guides.count_missed(w, group, totals[slot])

    @wp.func
    def late_power(w: wp.array[Real], group: Group, memory: Memory):
        """Power [W] that contacts of links take less where the group's pins accelerate by their own contacts, too."""
        less = Real(0.0)
        i = group.low
        while i < group.high:
            if access.load(w, row.penetration + i) > Real(0.0):
                x, y = access.load(w, row.force_x + i), access.load(w, row.force_y + i)
                before_x, before_y = access.load(w, row.fx + i) - x, access.load(w, row.fy + i) - y
                less += access.load(w, row.mobility + i) * (x * before_x + y * before_y)
            i = i + 1
        return wp.float64(memory.lag * memory.inverse_mass * less)

    @wp.func
    def add_run_forces(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: Memory,
    ):
        """Adds contact forces of one run of rollers with partner `p`, eq. (5)-(23), to rollers and totals."""
        group = find_run_contacts(ensemble, state, drive, w, p, run, memory)
        on_teeth = p < drive.sprockets
        if group.high > group.low:
            slot = drive.first_sprocket + drive.first_guide + p
            law = partners.law_of_partner(ensemble, drive, p)
            friction = partners.friction_of_partner(ensemble, drive, p)
            impacts = state.totals[slot].impacts
            body = partners.carrier_of_partner(ensemble, drive, p)
            if body != GROUND:
                pose = state.poses[drive.first_body + body]
                memory.straight = kinds.vec2(Real(pose.straight[0]), Real(pose.straight[1]))
                memory.angular = Real(pose.angular)
            changed = add_group_forces(w, group, law, friction, memory, state.totals, slot)
            if wp.static(silent):
                if drive.points > 1 and memory.wanted.measures != 0:
                    state.totals[slot].dissipated -= late_power(w, group, memory)
            if changed != 0 and memory.stage == 0:
                if on_teeth:
                    seats.keep_impact_speeds(w, group.low, group.high, p, memory)
                else:
                    contact_rows.keep_impact_speeds(w, group, memory)
            add_counts_and_sizes(w, group, on_teeth, impacts, memory.wanted, state.totals, slot)

    @wp.func
    def add_contact_forces(
        ensemble: Ensemble, state: State, drive: Drive, place: int, w: wp.array[Real], memory: Memory
    ):
        """Adds all contact forces of a chain, `place` among all, to CPU rows, `Totals` and bodies' wrenches."""
        if wp.static(silent):
            if drive.points > 1:
                motions.find_link_motions(w, drive.rollers, ensemble.chains[place])
        # one loop over all runs: with one over each partner's, rare values of a partner are laid out before its runs
        p = int(0)
        run = int(0)
        if wp.static(silent):
            links_end = drive.sprockets + back_count(drive.points, drive.guides)  # after what touches links
        while p < drive.sprockets + drive.guides:
            slot = drive.first_sprocket + drive.first_guide + p
            runs = neighbor_list.run_count(w, drive, p)
            if run == 0:
                state.totals[slot] = Totals()
                memory.damper_row = contact_rows.damper_row(p)
                if wp.static(silent):
                    if drive.points > 1 and p < wp.min(links_end, drive.sprockets + 1):  # all backs are joined at once
                        pin_forces.clear_rows(w, drive.rollers)
                    elif drive.points > 1:
                        memory.damper_row = contact_rows.damper_row(drive.sprockets * (drive.points - 1) + p)
            if run < runs:
                if wp.static(silent):
                    if drive.points > 1 and p < drive.sprockets:
                        toe_pairs.add_run_of_toes(ensemble, state, drive, place, w, p, run, memory)
                    elif drive.points > 1 and p < links_end:
                        backs.add_run_of_backs(ensemble, state, drive, place, w, p, run, memory)
                    else:
                        add_run_forces(ensemble, state, drive, w, p, run, memory)
                else:
                    add_run_forces(ensemble, state, drive, w, p, run, memory)
                run += 1
            if run >= runs:
                body = partners.carrier_of_partner(ensemble, drive, p)
                if body != GROUND:
                    b = drive.first_body + body
                    state.wrenches[b] = wrench_with_force(
                        state.wrenches[b], state.totals[slot].push, state.totals[slot].moment
                    )
                if wp.static(silent):
                    memory.first = memory.first + wp.where(p < drive.sprockets, drive.points, 1) * drive.rollers
                    if drive.points > 1 and (p < drive.sprockets or p == links_end - 1):
                        of = wp.min(p, drive.sprockets) - p  # of all backs at the first guide
                        state.totals[slot + of].dissipated -= pin_forces.join_forces(w, drive.rollers, memory)
                    if drive.points > 1 and p == drive.sprockets + drive.guides - 1 and memory.stage == 0:
                        pin_forces.keep_forces(w, drive.rollers)
                else:
                    memory.first = memory.first + drive.rollers
                run = 0
                p += 1

    return ContactPairFunctions(add_contact_forces=add_contact_forces)
