"""Contacts of a silent chain's links with one wheel, run by run of its pins."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.toe import ENDS, LINK_ENDS
from ..structs import Drive, types
from .contact_rows import contact_row_functions
from .link_forces import link_force_functions
from .link_runs import link_run_functions
from .near_rollers import near_roller_functions
from .neighbor_list import neighbor_list_functions
from .partners import partner_functions
from .toes import toe_functions


@dataclass(frozen=True)
class ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel."""

    add_run_of_toes: wp.Function


@cache
def toe_pair_functions(Real: type, capacity: int) -> ToePairFunctions:
    """CPU functions of a silent chain's contacts with one wheel, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Memory, Plate = kinds.Ensemble, kinds.State, kinds.Memory, kinds.Plate
    partners = partner_functions(Real)
    link_runs = link_run_functions(Real, capacity)
    link_forces = link_force_functions(Real, capacity, True)
    near_rollers = near_roller_functions(Real, capacity)
    toes = toe_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

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
        own = plate_by_value(ensemble.plates[place])
        pose = state.poses[drive.first_body + p]
        memory.straight = kinds.vec2(Real(pose.straight[0]), Real(pose.straight[1]))
        memory.angular = Real(pose.angular)
        after_bits, before_bits = toes.find_near_toes(w, group, own, partner, p, memory)
        after = link_runs.link_run(drive, group.first, after_bits, 0, 0)
        before = link_runs.link_run(drive, group.first, before_bits, LINK_ENDS, after.pitch)
        if after.count + before.count > 0:
            friction = partners.friction_of_partner(ensemble, drive, p)
            memory.damper_row = contact_rows.damper_row(p * ENDS)
            memory.push_row = contact_rows.push_row(drive, p * ENDS)
            side = int(0)
            while side < 2:
                links = link_forces.run_of_side(after, before, side)
                toes.find_contacts(w, links, group.high, own, partner.sprocket, partner.pose, p, memory)
                side = side + 1
            slot = drive.first_sprocket + drive.first_guide + p
            law = partner.sprocket.law
            link_forces.add_contact_forces(w, after, before, law, friction, memory, state.totals, slot)

    return ToePairFunctions(add_run_of_toes=add_run_of_toes)
