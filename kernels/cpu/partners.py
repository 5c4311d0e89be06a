"""Contacts of the rollers of one variant with its partners, sprockets and guides, on the CPU."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.body import pose_of
from ..physics.contact import carried
from ..rows import accessors
from ..structs import GROUND, Drive, Pose, types
from ..sum_structs import Totals
from .contacts import GROUP, Group, contacts
from .guides import guide_passes
from .rollers import rows
from .teeth import teeth_passes


@dataclass(frozen=True)
class Partners:
    """What meets the partners of one variant."""

    meet: wp.Function


@cache
def partners(Real: type, capacity: int, plain: bool) -> Partners:
    """The function that meets the partners of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    teeth, face, contact = teeth_passes(Real, capacity), guide_passes(Real, capacity), contacts(Real, capacity)
    group_of, answer, add_sizes, leave_seats = (
        contact.group_of,
        contact.answer,
        contact.add_sizes,
        contact.leave_seats,
    )
    at = rows(capacity)
    NEAR, SPROCKET_FORCE, GUIDE_FORCE = at.near, at.sprocket_force, at.guide_force
    unlike = accessors(Real).unlike

    @wp.struct
    class Partner:
        """A sprocket, or a guide where `teeth` is 0, and the body that carries it."""

        teeth: wp.int32
        body: wp.int32  # of the drive, or `GROUND`
        pose: Pose
        sprocket: kinds.Sprocket
        guide: kinds.Guide
        law: kinds.ContactLaw
        sliding: kinds.Sliding

    @wp.func
    def partner_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, p: int):
        """Partner p of a drive, its sprockets and then its guides, where it is now."""
        partner = Partner()
        if p < drive.sprockets:
            partner.teeth = 1
            partner.body = p
            partner.pose = pose_of(state.bodies[drive.first_body + p])
            partner.sprocket = ensemble.sprockets[drive.first_sprocket + p]
            partner.law = partner.sprocket.law
            partner.sliding = ensemble.tooth_sliding[drive.first_sprocket + p]
        else:
            bar = ensemble.guides[drive.first_guide + p - drive.sprockets]
            partner.body = bar.body
            partner.pose.cosine = wp.float64(1.0)
            if bar.body != GROUND:
                partner.pose = pose_of(state.bodies[drive.first_body + bar.body])
                if bar.pieces == 0:
                    bar = carried(bar, partner.pose)
            bar.first_piece = drive.first_piece + bar.first_piece
            partner.guide = bar
            partner.law = bar.law
            partner.sliding = ensemble.guide_sliding[drive.first_guide + p - drive.sprockets]
        return partner

    @wp.func
    def find_near(w: wp.array[Real], n: int, partner: Partner):
        """Which rollers are near a partner."""
        if partner.teeth != 0:
            teeth.find_engaged(w, n, partner.sprocket, partner.pose)
        elif partner.guide.pieces == 0:
            face.find_over_bar(w, n, partner.guide)
        elif wp.static(not plain):
            face.find_over_profile(w, n, partner.guide, partner.pose)

    @wp.func
    def leave_partner(first: int, count: int, near: wp.uint64, partner: Partner, memory: kinds.Memory):
        """Forgets the contacts of those of `count` rollers that are not near; who had a seat or piece, as bits."""
        seated = wp.uint64(0)
        if partner.teeth != 0 or partner.guide.pieces != 0:
            seated = leave_seats(first, count, near, memory)
        elif memory.stage == 0:
            face.leave_bar(first, count, near, memory)
        return seated

    @wp.func
    def touch_partner(
        w: wp.array[Real], ensemble: kinds.Ensemble, group: Group, partner: Partner, memory: kinds.Memory
    ):
        """How the rollers of a group stand on a partner."""
        if partner.teeth != 0:
            teeth.touch_teeth(w, group, partner.sprocket, partner.pose, partner.body, ensemble.seats, memory)
        elif partner.guide.pieces == 0:
            face.touch_bar(w, group, partner.guide, partner.pose, memory)
        elif wp.static(not plain):
            face.touch_profile(w, group, partner.guide, partner.pose, ensemble.pieces, memory)

    @wp.func
    def meet(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        p: int,
        memory: kinds.Memory,
    ):
        """Contacts of all rollers with partner p, eq. (5)-(23); returns their `Totals` and its body."""
        n = drive.rollers
        totals = Totals()
        partner = partner_of(ensemble, state, drive, p)
        find_near(w, n, partner)
        first = int(0)
        while first < n:
            count = wp.min(n - first, GROUP)
            near = unlike(w, NEAR + first, count, Real(0.0))
            seated = leave_partner(first, count, near, partner, memory)
            if near != wp.uint64(0):
                group = group_of(first, near, near & ~seated)
                touch_partner(w, ensemble, group, partner, memory)
                impacts = totals.impacts
                totals = answer(w, group, partner.law, partner.sliding, memory, chain, totals)
                if memory.wanted.sizes != 0:
                    add_sizes(w, group, wp.where(partner.teeth != 0, SPROCKET_FORCE, GUIDE_FORCE))
                if memory.wanted.measures != 0:
                    if partner.teeth != 0:
                        if totals.impacts != impacts:
                            totals.contacts += teeth.first_touches(w, group)
                    else:
                        totals = face.count_missed(w, group, totals)
            first = first + GROUP
        return totals, partner.body

    return Partners(meet=meet)
