"""Contacts of the rollers of one variant with its partners, sprockets and guides, on the CPU."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.body import pose_of
from ..physics.contact import carried
from ..rows import accessors, whole_lanes
from ..structs import GROUND, Drive, Wanted, Wrench, types
from ..sum_structs import Totals
from .contacts import GROUP, Group, contacts
from .guides import guide_passes
from .partner import partner_type
from .rollers import rows
from .runs import runs
from .teeth import teeth_passes


@wp.struct
class Visit:
    """A run of rollers to meet a partner, and what the runs before add up to."""

    partner: wp.int32  # of the drive: its sprockets, then its guides
    run: wp.int32
    totals: Totals


@wp.func
def with_reaction(wrench: Wrench, force: wp.vec2d, moment: wp.float64):
    """The wrench on a body with what one more partner's contacts do to it."""
    wrench.force = wrench.force + force
    wrench.moment = wrench.moment + moment
    return wrench


@dataclass(frozen=True)
class Partners:
    """What meets the partners of one variant."""

    memory_of: wp.Function
    see_bodies: wp.Function
    look_around: wp.Function
    meet_all: wp.Function


@cache
def partners(Real: type, capacity: int, plain: bool) -> Partners:
    """The function that meets the partners of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Partner = partner_type(Real)
    teeth, face, contact = teeth_passes(Real, capacity), guide_passes(Real, capacity), contacts(Real, capacity)
    group_of, answer, add_sizes, leave_seats = (
        contact.group_of,
        contact.answer,
        contact.add_sizes,
        contact.leave_seats,
    )
    at = rows(capacity)
    NEAR, SPROCKET_FORCE, GUIDE_FORCE = at.near, at.sprocket_force, at.guide_force
    unlike, whole = accessors(Real).unlike, whole_lanes(Real)
    soon = runs(Real, capacity)

    @wp.func
    def see_bodies(state: kinds.State, drive: Drive):
        """Finds all bodies' poses, one right after the other: each is a long chain that waits for itself only."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.poses[b] = pose_of(state.bodies[b])

    @wp.func
    def sprocket_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int):
        """Sprocket s of a drive, where it is now."""
        partner = Partner()
        partner.teeth = 1
        partner.body = s
        partner.pose = state.poses[drive.first_body + s]
        partner.sprocket = ensemble.sprockets[drive.first_sprocket + s]
        partner.law = partner.sprocket.law
        partner.sliding = ensemble.tooth_sliding[drive.first_sprocket + s]
        return partner

    @wp.func
    def guide_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, g: int):
        """Guide g of a drive, where it is now."""
        partner = Partner()
        bar = ensemble.guides[drive.first_guide + g]
        partner.body = bar.body
        partner.pose.cosine = wp.float64(1.0)
        if bar.body != GROUND:
            partner.pose = state.poses[drive.first_body + bar.body]
            if bar.pieces == 0:
                bar = carried(bar, partner.pose)
        bar.first_piece = drive.first_piece + bar.first_piece
        partner.guide = bar
        partner.law = bar.law
        partner.sliding = ensemble.guide_sliding[drive.first_guide + g]
        return partner

    @wp.func
    def partner_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, p: int):
        """Partner p of a drive, its sprockets and then its guides."""
        if p < drive.sprockets:
            partner = sprocket_of(ensemble, state, drive, p)
            return partner
        partner = guide_of(ensemble, state, drive, p - drive.sprockets)
        return partner

    @wp.func
    def carrier_of(ensemble: kinds.Ensemble, drive: Drive, p: int):
        """The body of the drive that carries partner p, or `GROUND`."""
        body = p
        if p >= drive.sprockets:
            body = ensemble.guides[drive.first_guide + p - drive.sprockets].body
        return body

    @wp.func
    def widened(partner: Partner, margin: Real):
        """A partner with a margin [m] around where rollers are near it."""
        far = wp.sqrt(partner.sprocket.far_square) + margin
        near = wp.max(wp.sqrt(partner.sprocket.near_square) - margin, Real(0.0))
        partner.sprocket.far_square = far * far
        partner.sprocket.near_square = near * near
        if near == Real(0.0):
            partner.sprocket.near_square = Real(-1.0)
        partner.guide.end_radius += margin
        partner.guide.roller_radius += margin
        apart = wp.vec2d(wp.float64(margin), wp.float64(margin))
        partner.guide.low = partner.guide.low - apart
        partner.guide.high = partner.guide.high + apart
        return partner

    @wp.func
    def find_near(w: wp.array[Real], first: int, end: int, partner: Partner):
        """Which rollers from `first` on, before `end`, are near a partner."""
        if partner.teeth != 0:
            teeth.find_engaged(w, first, end, partner.sprocket, partner.pose)
        elif partner.guide.pieces == 0:
            face.find_over_bar(w, first, end, partner.guide)
        elif wp.static(not plain):
            face.find_over_profile(w, first, end, partner.guide, partner.pose)

    @wp.func
    def leave_partner(
        w: wp.array[Real], first: int, count: int, near: wp.uint64, partner: Partner, memory: kinds.Memory
    ):
        """Forgets the contacts of those of `count` rollers that are not near; who had a seat or piece, as bits."""
        seated = wp.uint64(0)
        if partner.teeth != 0 or partner.guide.pieces != 0:
            seated = leave_seats(first, count, near, memory)
            if partner.teeth != 0:
                teeth.disengage(w, first, seated & ~near)
        elif memory.stage == 0:
            face.leave_bar(first, count, near, memory)
        return seated

    @wp.func
    def memory_of(state: kinds.State, drive: Drive):
        """What contacts with the first partner of a drive keep."""
        memory = kinds.Memory()
        memory.seat = state.seat
        memory.impact_speed = state.impact_speed
        memory.first = drive.first_contact
        return memory

    @wp.func(inline=False)
    def look_around(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, w: wp.array[Real]):
        """Finds anew which rollers can come near each partner soon; of a guide that moves, all can."""
        n = drive.rollers
        memory = memory_of(state, drive)
        margin = soon.margin(w)
        see_bodies(state, drive)
        for p in range(drive.sprockets + drive.guides):
            partner = partner_of(ensemble, state, drive, p)
            if partner.teeth != 0 or partner.body == GROUND:
                find_near(w, 0, whole(n), widened(partner, margin))
            else:
                soon.call_all(w, n)
            soon.gather(w, n, p)
            first = int(0)
            while first < n:
                count = wp.min(n - first, GROUP)
                leave_partner(w, first, count, unlike(w, NEAR + first, count, Real(0.0)), partner, memory)
                first = first + GROUP
            memory.first = memory.first + n
        soon.renew(w, drive)

    @wp.func
    def near_group(w: wp.array[Real], first: int, end: int, n: int, partner: Partner, memory: kinds.Memory):
        """The group of rollers from `first` on, before `end`, that are near a partner; the others leave it."""
        find_near(w, first, end, partner)
        count = wp.min(n, end) - first
        near = unlike(w, NEAR + first, count, Real(0.0))
        had = leave_partner(w, first, count, near, partner, memory)
        group = Group()
        group.first = first
        group.low = first
        group.high = first
        if near != wp.uint64(0):
            group = group_of(first, near, near & ~had)
        return group

    @wp.func
    def touch_sprocket(
        w: wp.array[Real],
        ensemble: kinds.Ensemble,
        first: int,
        end: int,
        n: int,
        partner: Partner,
        memory: kinds.Memory,
    ):
        """How the rollers from `first` on, before `end`, stand on a sprocket; the group of those that may touch it.

        In most steps none of them comes, leaves or changes its seat.
        """
        group = Group()
        group.first = first
        group.low = first
        group.high = end
        moved, others = teeth.place_in_gaps(w, first, end, n, partner.sprocket, partner.pose, partner.body)
        if others != 0 or moved != wp.uint64(0):
            group = near_group(w, first, end, n, partner, memory)
            if group.high > group.low:
                teeth.seat_rollers(w, group, n, partner.sprocket, partner.pose, partner.body, ensemble.seats, memory)
        teeth.touch_teeth(w, group.low, group.high, partner.sprocket, partner.pose, partner.body)
        return group

    @wp.func
    def touch_guide(
        w: wp.array[Real],
        ensemble: kinds.Ensemble,
        first: int,
        end: int,
        n: int,
        partner: Partner,
        memory: kinds.Memory,
    ):
        """How the rollers from `first` on, before `end`, stand on a guide; the group of those that may touch it."""
        group = near_group(w, first, end, n, partner, memory)
        if partner.guide.pieces == 0:
            face.touch_bar(w, group, partner.guide, partner.pose, memory)
        elif wp.static(not plain):
            face.touch_profile(w, group, partner.guide, partner.pose, ensemble.pieces, memory)
        return group

    @wp.func
    def take_down(w: wp.array[Real], group: Group, on_teeth: bool, impacts: int, wanted: Wanted, totals: Totals):
        """`totals` with what only metrics count, `impacts` before this group; magnitudes for frames."""
        if wanted.sizes != 0:
            add_sizes(w, group, wp.where(on_teeth, SPROCKET_FORCE, GUIDE_FORCE))
        if wanted.measures != 0:
            if on_teeth:
                if totals.impacts != impacts:
                    totals.contacts += teeth.first_touches(w, group)
            else:
                totals = face.count_missed(w, group, totals)
        return totals

    @wp.func
    def meet(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        visit: Visit,
        memory: kinds.Memory,
    ):
        """Contacts of one run of rollers with one partner, eq. (5)-(23); returns the visit with them in its totals."""
        n = drive.rollers
        first, count = soon.run(w, drive, visit.partner, visit.run)
        on_teeth = visit.partner < drive.sprockets
        group = Group()
        law = kinds.ContactLaw()
        sliding = kinds.Sliding()
        if on_teeth:
            partner = sprocket_of(ensemble, state, drive, visit.partner)
            group = touch_sprocket(w, ensemble, first, first + count, n, partner, memory)
            law = partner.law
            sliding = partner.sliding
        else:
            guide = guide_of(ensemble, state, drive, visit.partner - drive.sprockets)
            group = touch_guide(w, ensemble, first, first + count, n, guide, memory)
            law = guide.law
            sliding = guide.sliding
        if group.high > group.low:
            impacts = visit.totals.impacts
            totals, changed = answer(w, group, law, sliding, memory, chain, visit.totals)
            if changed != 0 and memory.stage == 0:
                if on_teeth:
                    teeth.keep(w, group.low, group.high, visit.partner, memory)
                else:
                    contact.keep(w, group, memory)
            visit.totals = take_down(w, group, on_teeth, impacts, memory.wanted, totals)
        return visit

    @wp.func
    def meet_all(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Contacts of all rollers with all partners: each one's `Totals`, and the wrenches on their bodies.

        One loop over all runs, not one over each partner's: else what the loops over rollers want of a partner, common
        and rare ones alike, is laid out before its first run.
        """
        visit = Visit()
        while visit.partner < drive.sprockets + drive.guides:
            runs = soon.count(w, drive, visit.partner)
            if visit.run < runs:
                visit = meet(ensemble, state, drive, chain, w, visit, memory)
                visit.run += 1
            if visit.run >= runs:
                state.totals[drive.first_sprocket + drive.first_guide + visit.partner] = visit.totals
                body = carrier_of(ensemble, drive, visit.partner)
                if body != GROUND:
                    b = drive.first_body + body
                    state.wrenches[b] = with_reaction(state.wrenches[b], visit.totals.push, visit.totals.moment)
                memory.first = memory.first + drive.rollers
                visit.totals = Totals()
                visit.run = 0
                visit.partner += 1

    return Partners(memory_of=memory_of, see_bodies=see_bodies, look_around=look_around, meet_all=meet_all)
