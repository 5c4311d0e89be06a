"""Contacts of the backs of a silent chain's links with one guide, run by run of their first pins (`physics.back`)."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.back import back_contact, back_guide, crown_gap, wheelward_normal
from ..physics.contact import AWAY, UNTOUCHED, rotated_vector
from ..physics.guide import frame_vector
from ..physics.toe import point_mobility
from ..structs import GROUND, Drive, Piece, Pose, types
from .back_facings import back_facing_functions
from .contact_rows import contact_row_functions
from .guides import guide_functions
from .link_forces import link_force_functions
from .link_motions import link_motion_functions
from .link_runs import LinkRun, link_run_functions
from .near_rollers import near_roller_functions
from .neighbor_list import Group, neighbor_list_functions
from .partners import partner_functions
from .rollers import rows


@dataclass(frozen=True)
class BackFunctions:
    """CPU functions of backs' contacts with one guide."""

    add_run_of_backs: wp.Function


@cache
def back_functions(Real: type, capacity: int) -> BackFunctions:
    """CPU functions of backs' contacts with one guide, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Memory, vec2 = kinds.Ensemble, kinds.State, kinds.Memory, kinds.vec2
    partners = partner_functions(Real)
    near_rollers = near_roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    guides = guide_functions(Real, capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)
    link_runs = link_run_functions(Real, capacity)
    motions = link_motion_functions(Real, capacity)
    link_forces = link_force_functions(Real, capacity, False)
    facings = back_facing_functions(Real, capacity)
    access = row_access(Real)
    row = rows(capacity)

    @wp.func(inline=True)
    def store_back_contacts(
        w: wp.array[Real],
        run: LinkRun,
        over: wp.uint64,
        side: Real,
        guide: kinds.Guide,
        body: Pose,
        is_bar: bool,
        memory: Memory,
    ):
        """Stores contacts of a run's backs with a guide, bits `over` of them over it, after `find_facing`."""
        contacts = access.shifted_rows(w, run.rows - run.low)
        high = run.low + run.pitch
        i = run.low
        while i < high:
            link = motions.link_at(w, i + 1)
            u = vec2(link.ux, link.uy)
            across = wheelward_normal(u, side)
            facing = vec2(access.load(contacts, row.normal_x + i), access.load(contacts, row.normal_y + i))
            height, curvature = (
                access.load(contacts, row.penetration + i),
                access.load(contacts, row.point_mobility + i),
            )
            turned = across
            if not is_bar:
                exact = frame_vector(wp.vec2d(wp.float64(across[0]), wp.float64(across[1])), body)
                turned = vec2(Real(exact[0]), Real(exact[1]))
            penetration, normal = crown_gap(height, facing, turned, curvature, guide.back_radius)
            if not is_bar:
                normal = rotated_vector(normal, Real(body.cosine), Real(body.sine))
            is_over = ((over >> wp.uint64(i - run.low)) & wp.uint64(1)) != wp.uint64(0)
            depth, z = back_contact(wp.where(is_over, penetration, Real(AWAY)), normal, u, across, link.length, guide)
            before = wp.where(is_over, access.load(contacts, row.v0_before + i), Real(UNTOUCHED))
            access.store(contacts, row.v0_before + i, before)
            depth = guides.face_penetration(contacts, i, depth, guide)
            contact_rows.store_place(contacts, i, depth, normal, z, point_mobility(z, normal, link.length))
            arm = motions.arm_of_middle(w, i, link, Real(1.0), body)
            motions.store_motion(contacts, i, arm, z, link, body, memory)
            i = i + 1

    @wp.func
    def find_back_contacts(
        w: wp.array[Real],
        run: LinkRun,
        group: Group,
        side: Real,
        partner: partners.Partner,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """Stores the contacts of the backs after a group's pins with a guide."""
        link_runs.recall_contacts(w, run, 1, memory)
        guide, body = back_guide(partner.guide), partner.pose
        over = facings.find_facings(w, run, group, side, guide, body, pieces, memory)
        if guide.pieces == 0:
            store_back_contacts(w, run, over, side, guide, body, True, memory)
        else:
            store_back_contacts(w, run, over, side, guide, body, False, memory)

    @wp.func(inline=False)
    def add_run_of_backs(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        place: int,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: Memory,
    ):
        """Adds the forces of guide `p` of a chain's partners on the backs after one run of pins, to rows of pins and to
        totals."""
        first, count = neighbor_list.run_span(w, drive, p, run)
        partner = partners.guide_partner(ensemble, state, drive, p - drive.sprockets)
        group = near_rollers.near_group(w, first, first + count, drive.rollers, partner, memory)
        if group.high > group.low:
            contact = drive.sprockets * (drive.points - 1) + p
            memory.damper_row = contact_rows.damper_row(contact)
            memory.push_row = contact_rows.push_row(drive, contact)
            memory.speed_row = contact_rows.speed_row(drive, contact)
            if partner.body != GROUND:
                memory.straight = vec2(Real(partner.pose.straight[0]), Real(partner.pose.straight[1]))
                memory.angular = Real(partner.pose.angular)
            links = link_runs.link_run(drive, group.first, group.near, 0, 0)
            find_back_contacts(w, links, group, ensemble.plates[place].side, partner, ensemble.pieces, memory)
            friction = partners.friction_of_partner(ensemble, drive, p)
            slot = drive.first_sprocket + drive.first_guide + p
            law = partner.guide.law
            link_forces.add_contact_forces(w, links, LinkRun(), law, friction, memory, state.totals, slot)

    return BackFunctions(add_run_of_backs=add_run_of_backs)
