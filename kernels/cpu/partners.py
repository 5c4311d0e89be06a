"""Partners of the chain: a variant's sprockets, then its guides; and which rollers are near each."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..physics.body import pose_of
from ..physics.guide import carried
from ..rows import accessors, whole_lanes
from ..structs import GROUND, Drive, Pose, types
from .guides import guide_passes
from .neighbor_list import GROUP, lowest_bit, neighbor_list, next_bits
from .rollers import rows
from .teeth import teeth_passes


@cache
def partners(Real: type) -> SimpleNamespace:
    """The partners of one variant, where they are now, with their contact laws."""
    kinds = types(Real)

    @wp.struct
    class Partner:
        """A sprocket, or a guide where `teeth` is 0, and the body that carries it."""

        teeth: wp.int32
        body: wp.int32  # of the drive, or `GROUND`
        pose: Pose
        sprocket: kinds.Sprocket
        guide: kinds.Guide

    @wp.func
    def sprocket_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int):
        """Sprocket s of a drive, where it is now."""
        partner = Partner()
        partner.teeth = 1
        partner.body = s
        partner.pose = state.poses[drive.first_body + s]
        partner.sprocket = ensemble.sprockets[drive.first_sprocket + s]
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
                now = carried(bar, partner.pose)
                bar.start = now.start
                bar.direction = now.direction
        bar.first_piece = drive.first_piece + bar.first_piece
        partner.guide = bar
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
    def law_of(ensemble: kinds.Ensemble, drive: Drive, p: int):
        """The contact law of partner p of a drive."""
        if p < drive.sprockets:
            law = ensemble.sprockets[drive.first_sprocket + p].law
            return law
        law = ensemble.guides[drive.first_guide + p - drive.sprockets].law
        return law

    @wp.func
    def sliding_of(ensemble: kinds.Ensemble, drive: Drive, p: int):
        """What rubs on partner p of a drive."""
        if p < drive.sprockets:
            sliding = ensemble.tooth_sliding[drive.first_sprocket + p]
            return sliding
        sliding = ensemble.guide_sliding[drive.first_guide + p - drive.sprockets]
        return sliding

    @wp.func
    def carrier_of(ensemble: kinds.Ensemble, drive: Drive, p: int):
        """The body of the drive that carries partner p, or `GROUND`."""
        body = p
        if p >= drive.sprockets:
            body = ensemble.guides[drive.first_guide + p - drive.sprockets].body
        return body

    @wp.func
    def widened(partner: Partner, skin: Real):
        """A partner with a skin [m] around where rollers are near it."""
        far = wp.sqrt(partner.sprocket.far_square) + skin
        near = wp.max(wp.sqrt(partner.sprocket.near_square) - skin, Real(0.0))
        partner.sprocket.far_square = far * far
        partner.sprocket.near_square = near * near
        if near == Real(0.0):
            partner.sprocket.near_square = Real(-1.0)
        partner.guide.end_radius += skin
        partner.guide.roller_radius += skin
        apart = wp.vec2d(wp.float64(skin), wp.float64(skin))
        partner.guide.low = partner.guide.low - apart
        partner.guide.high = partner.guide.high + apart
        return partner

    return namespace(Partner, sprocket_of, guide_of, partner_of, law_of, sliding_of, carrier_of, widened)


@cache
def nearness(Real: type, capacity: int, plain: bool) -> SimpleNamespace:
    """The functions that find which rollers are near a partner, for rows of `capacity` values of type `Real`."""
    kinds, partner_types = types(Real), partners(Real)
    Partner, partner_of, widened = partner_types.Partner, partner_types.partner_of, partner_types.widened
    teeth, face = teeth_passes(Real, capacity), guide_passes(Real, capacity)
    unlike, whole, store_row = accessors(Real).unlike, whole_lanes(Real), accessors(Real).store_row
    store_seat, unlike_seat = accessors(wp.int32).store_row, accessors(wp.int32).unlike
    row, neighbors = rows(capacity), neighbor_list(Real, capacity)

    @wp.func
    def see_bodies(state: kinds.State, drive: Drive):
        """Finds all bodies' poses, one right after the other: each is a long chain that waits for itself only."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.poses[b] = pose_of(state.bodies[b])

    @wp.func
    def memory_of(state: kinds.State, drive: Drive):
        """What contacts with the first partner of a drive keep."""
        memory = kinds.Memory()
        memory.seat = state.seat
        memory.impact_speed = state.impact_speed
        memory.first = drive.first_contact
        if drive.integrator == 0:
            memory.lag = Real(wp.float64(0.5) * drive.step)
        return memory

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
    def leave_seats(first: int, count: int, near: wp.uint64, memory: kinds.Memory):
        """Forgets the seats, or pieces, and contacts of rollers that are no longer near; who had one, as bits."""
        seated = unlike_seat(memory.seat, memory.first + first, count, -1)
        left = seated & ~near
        while left != wp.uint64(0):
            i = memory.first + first + lowest_bit(left)
            store_seat(memory.seat, i, -1)
            store_row(memory.impact_speed, i, Real(0.0))
            left = next_bits(left)
        return seated

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

    @wp.func(inline=False)
    def rebuild(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, w: wp.array[Real]):
        """Finds anew which rollers can come near each partner soon; of a guide that moves, all can."""
        n = drive.rollers
        memory = memory_of(state, drive)
        skin = neighbors.skin(w)
        see_bodies(state, drive)
        for p in range(drive.sprockets + drive.guides):
            partner = partner_of(ensemble, state, drive, p)
            if partner.teeth != 0 or partner.body == GROUND:
                find_near(w, 0, whole(n), widened(partner, skin))
            else:
                neighbors.mark_all(w, n)
            neighbors.gather(w, n, p)
            first = int(0)
            while first < n:
                count = wp.min(n - first, GROUP)
                leave_partner(w, first, count, unlike(w, row.near + first, count, Real(0.0)), partner, memory)
                first = first + GROUP
            memory.first = memory.first + n
        neighbors.set_lifetime(w, drive)

    @wp.func
    def near_group(w: wp.array[Real], first: int, end: int, n: int, partner: Partner, memory: kinds.Memory):
        """The group of rollers from `first` on, before `end`, that are near a partner; the others leave it."""
        find_near(w, first, end, partner)
        count = wp.min(n, end) - first
        near = unlike(w, row.near + first, count, Real(0.0))
        had = leave_partner(w, first, count, near, partner, memory)
        if near != wp.uint64(0):
            group = neighbors.group_of(first, near, near & ~had)
            return group
        group = neighbors.whole_run(first, first)
        return group

    return namespace(see_bodies, memory_of, rebuild, near_group)
