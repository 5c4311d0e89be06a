"""Contacts of the backs of a silent chain's links with one guide, run by run of their first pins (`physics.back`)."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.back import back_contact, back_guide, crown_bar_contact, crown_piece_contact, wheelward_normal
from ..physics.contact import AWAY, UNTOUCHED, rotated_vector
from ..physics.guide import frame_vector, tracked_piece
from ..physics.toe import point_mobility
from ..structs import GROUND, Drive, Piece, types
from .contact_rows import contact_row_functions
from .guides import guide_functions
from .link_motions import link_motion_functions
from .link_runs import LinkRun, link_run_functions
from .near_rollers import near_roller_functions
from .neighbor_list import Group, is_near, lowest_bit, neighbor_list_functions, without_lowest_bit
from .partners import partner_functions
from .rollers import roller_functions, rows
from .toe_pairs import toe_pair_functions


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
    toe_pairs = toe_pair_functions(Real, capacity)
    rollers = roller_functions(Real, capacity)
    access, seat_access = row_access(Real), row_access(wp.int32)
    row = rows(capacity)

    @wp.func
    def exact_vector(v: vec2):
        """A vector in float64."""
        return wp.vec2d(wp.float64(v[0]), wp.float64(v[1]))

    @wp.func
    def crown_contact(
        top: wp.vec2d, across: vec2, at: int, partner: partners.Partner, pieces: wp.array[Piece], memory: Memory
    ):
        """Penetration [m] and normal of a crown with its top at `top` [m]; its piece of a profile is kept at `at`."""
        guide, body = partner.guide, partner.pose
        if guide.pieces == 0:
            depth, facing = crown_bar_contact(top - guide.start, across, guide)
            return depth, facing
        q, turned = frame_vector(top - body.center, body), frame_vector(exact_vector(across), body)
        center = q + wp.float64(guide.back_radius) * turned
        kept = seat_access.load(memory.seat, at)
        number = tracked_piece(center, kept, guide, pieces)
        seat_access.store(memory.seat, at, number)
        w = vec2(Real(turned[0]), Real(turned[1]))
        penetration, normal = crown_piece_contact(q, center, w, number, guide, pieces)
        return penetration, rotated_vector(normal, Real(body.cosine), Real(body.sine))

    @wp.func
    def store_back_contact(
        w: wp.array[Real],
        i: int,
        c: int,
        side: Real,
        partner: partners.Partner,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """Stores contact `c`, of the back of link `i` with a guide."""
        guide = partner.guide
        link = motions.link_at(w, i + 1)
        u = vec2(link.ux, link.uy)
        across = wheelward_normal(u, side)
        top = rollers.exact_position(w, i) + exact_vector(Real(0.5) * link.length * u - guide.roller_radius * across)
        penetration, normal = crown_contact(top, across, memory.first + i, partner, pieces, memory)
        depth, z = back_contact(penetration, normal, u, across, link.length, guide)
        depth = guides.face_penetration(w, c, depth, guide)
        contact_rows.store_place(w, c, depth, normal, z, point_mobility(z, normal, link.length))
        arm = motions.arm_of_middle(w, i, link, Real(1.0), partner.pose)
        motions.store_motion(w, c, arm, z, link, partner.pose, memory)

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
        c = int(0)
        while c < access.whole_vectors(run.count):
            i = run.low + c
            near = c < run.count and is_near(group, i)
            before = wp.where(near, access.load(w, row.v0_before + c), Real(UNTOUCHED))
            access.store(w, row.v0_before + c, before)
            access.store(w, row.v0_open + c, Real(UNTOUCHED))
            access.store(w, row.penetration + c, Real(AWAY))
            access.store(w, row.point_mobility + c, Real(0.5))
            c = c + 1
        partner.guide = back_guide(partner.guide)
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            store_back_contact(w, i, i - run.low, side, partner, pieces, memory)
            bits = without_lowest_bit(bits)

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
            links = link_runs.link_run(group.first, group.near)
            find_back_contacts(w, links, group, ensemble.plates[place].side, partner, ensemble.pieces, memory)
            friction = partners.friction_of_partner(ensemble, drive, p)
            slot = drive.first_sprocket + drive.first_guide + p
            toe_pairs.add_back_forces(w, links, partner.guide.law, friction, memory, state.totals, slot, drive.rollers)

    return BackFunctions(add_run_of_backs=add_run_of_backs)
