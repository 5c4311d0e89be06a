"""Contacts of the rollers of one variant with its partners, sprockets and guides."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import accessors, whole_lanes
from ..physics.body import pose_of
from ..physics.guide import carried_guide
from ..structs import GROUND, Drive, Now, Pose, Totals, Wrench, types
from .contacts import contact_forces, contact_friction, contact_rows, contact_sums
from .guides import guide_passes
from .neighbor_list import GROUP, Group, lowest_bit, neighbor_list, next_bits
from .rollers import rows
from .teeth import seat_passes, teeth_passes


@cache
def partners(Real: type) -> SimpleNamespace:
    """The partners of one variant, where they are now, with their contact laws."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.struct
    class Partner:
        """A sprocket, or a guide where `teeth` is 0, and the body that carries it."""

        teeth: wp.int32
        body: wp.int32  # of the drive, or `GROUND`
        pose: Pose
        sprocket: kinds.Sprocket
        guide: kinds.Guide

    @wp.func
    def sprocket_of(ensemble: Ensemble, state: State, drive: Drive, s: int):
        """Sprocket s of a drive, where it is now."""
        partner = Partner()
        partner.teeth = 1
        partner.body = s
        partner.pose = state.poses[drive.first_body + s]
        partner.sprocket = ensemble.sprockets[drive.first_sprocket + s]
        return partner

    @wp.func
    def guide_of(ensemble: Ensemble, state: State, drive: Drive, g: int):
        """Guide g of a drive, where it is now."""
        partner = Partner()
        bar = ensemble.guides[drive.first_guide + g]
        partner.body = bar.body
        partner.pose.cosine = wp.float64(1.0)
        if bar.body != GROUND:
            partner.pose = state.poses[drive.first_body + bar.body]
            if bar.pieces == 0:
                now = carried_guide(bar, partner.pose)
                bar.start = now.start
                bar.direction = now.direction
        bar.first_piece = drive.first_piece + bar.first_piece
        partner.guide = bar
        return partner

    @wp.func
    def partner_of(ensemble: Ensemble, state: State, drive: Drive, p: int):
        """Partner p of a drive, its sprockets and then its guides."""
        if p < drive.sprockets:
            partner = sprocket_of(ensemble, state, drive, p)
            return partner
        partner = guide_of(ensemble, state, drive, p - drive.sprockets)
        return partner

    @wp.func
    def law_of(ensemble: Ensemble, drive: Drive, p: int):
        """The contact law of partner p of a drive."""
        if p < drive.sprockets:
            law = ensemble.sprockets[drive.first_sprocket + p].law
            return law
        law = ensemble.guides[drive.first_guide + p - drive.sprockets].law
        return law

    @wp.func
    def friction_of(ensemble: Ensemble, drive: Drive, p: int):
        """The friction of partner p of a drive."""
        if p < drive.sprockets:
            friction = ensemble.tooth_friction[drive.first_sprocket + p]
            return friction
        friction = ensemble.guide_friction[drive.first_guide + p - drive.sprockets]
        return friction

    @wp.func
    def carrier_of(ensemble: Ensemble, drive: Drive, p: int):
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

    return SimpleNamespace(**locals())


@cache
def nearness(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that find which rollers are near a partner, for rows of `capacity` values of type `Real`."""
    kinds, partner_types = types(Real), partners(Real)
    State, Memory = kinds.State, kinds.Memory
    Partner, partner_of, widened = partner_types.Partner, partner_types.partner_of, partner_types.widened
    seats, face = seat_passes(Real, capacity), guide_passes(Real, capacity)
    unlike, whole, store_row = accessors(Real).unlike, whole_lanes(Real), accessors(Real).store_row
    store_seat, unlike_seat = accessors(wp.int32).store_row, accessors(wp.int32).unlike
    row, neighbors = rows(capacity), neighbor_list(Real, capacity)

    @wp.func
    def see_bodies(state: State, drive: Drive):
        """Finds all bodies' poses, one right after the other: each is a long chain that waits for itself only."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.poses[b] = pose_of(state.bodies[b])

    @wp.func
    def at_chain(memory: Memory, drive: Drive, chain: kinds.Chain):
        """The memory of contacts with the first partner of a drive, whose chain it is."""
        memory.first = drive.first_contact
        memory.inverse_mass = chain.inverse_mass
        memory.gravity = chain.gravity
        return memory

    @wp.func
    def memory_of(state: State, drive: Drive):
        """The same, but for the chain."""
        memory = Memory()
        memory.seat = state.seat
        memory.impact_speed = state.impact_speed
        memory.hold = state.contact_hold
        memory.stretched = Real(1.0)
        memory.first = drive.first_contact
        if drive.integrator == 0:
            memory.lag = Real(wp.float64(0.5) * drive.step)
        return memory

    @wp.func
    def find_near(w: wp.array[Real], first: int, end: int, partner: Partner):
        """Which rollers from `first` on, before `end`, are near a partner."""
        if partner.teeth != 0:
            seats.find_engaged(w, first, end, partner.sprocket, partner.pose)
        elif partner.guide.pieces == 0:
            face.find_over_bar(w, first, end, partner.guide)
        else:
            face.find_over_profile(w, first, end, partner.guide, partner.pose)

    @wp.func
    def leave_seats(first: int, count: int, near: wp.uint64, memory: Memory):
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
    def leave_partner(w: wp.array[Real], first: int, count: int, near: wp.uint64, partner: Partner, memory: Memory):
        """Forgets the contacts of those of `count` rollers that are not near; who had a seat or piece, as bits."""
        seated = wp.uint64(0)
        if partner.teeth != 0 or partner.guide.pieces != 0:
            seated = leave_seats(first, count, near, memory)
            if partner.teeth != 0:
                seats.disengage(w, first, seated & ~near)
        elif memory.stage == 0:
            face.leave_bar(first, count, near, memory)
        return seated

    @wp.func(inline=False)
    def rebuild(ensemble: kinds.Ensemble, state: State, drive: Drive, w: wp.array[Real]):
        """Rebuilds the neighbor list; a guide that moves keeps all rollers."""
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
    def near_group(w: wp.array[Real], first: int, end: int, n: int, partner: Partner, memory: Memory):
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

    return SimpleNamespace(**locals())


@wp.func
def with_reaction(wrench: Wrench, force: wp.vec2d, moment: wp.float64):
    """The wrench on a body with what one more partner's contacts do to it."""
    wrench.force = wrench.force + force
    wrench.moment = wrench.moment + moment
    return wrench


@cache
def contact_pairs(Real: type, capacity: int) -> SimpleNamespace:
    """The function that evaluates all contacts of one variant, for rows of `capacity` values of type `Real`."""
    kinds, of = types(Real), partners(Real)
    Ensemble, State, Memory, Chain = kinds.Ensemble, kinds.State, kinds.Memory, kinds.Chain
    Partner, near_group = of.Partner, nearness(Real, capacity).near_group
    seats, teeth, face = seat_passes(Real, capacity), teeth_passes(Real, capacity), guide_passes(Real, capacity)
    contact = contact_rows(Real, capacity)
    force, sums = contact_forces(Real, capacity), contact_sums(Real, capacity)
    rub_rollers = contact_friction(Real, capacity).rub_rollers
    row, neighbors = rows(capacity), neighbor_list(Real, capacity)

    @wp.func
    def place_on_sprocket(
        w: wp.array[Real], ensemble: Ensemble, first: int, end: int, n: int, partner: Partner, memory: Memory
    ):
        """Where the rollers from `first` on, before `end`, are in a sprocket's gaps; the group that may touch it.

        In most steps none of them comes, leaves or changes its seat.
        """
        moved, others = seats.place_in_gaps(w, first, end, n, partner.sprocket, partner.pose, partner.body)
        if others != 0 or moved != wp.uint64(0):
            group = near_group(w, first, end, n, partner, memory)
            if group.high > group.low:
                seats.seat_rollers(w, group, n, partner.sprocket, partner.pose, partner.body, ensemble.seats, memory)
            return group
        group = neighbors.whole_run(first, end)
        return group

    @wp.func
    def touch_guide(
        w: wp.array[Real], ensemble: Ensemble, first: int, end: int, n: int, partner: Partner, memory: Memory
    ):
        """Penetrations of the rollers from `first` to `end` in a guide; the group of those that may touch it."""
        group = near_group(w, first, end, n, partner, memory)
        if partner.guide.pieces == 0:
            face.touch_bar(w, group, partner.guide, partner.pose, memory)
        else:
            face.touch_profile(w, group, partner.guide, partner.pose, ensemble.pieces, memory)
        return group

    @wp.func
    def stand_on(ensemble: Ensemble, state: State, drive: Drive, w: wp.array[Real], p: int, run: int, memory: Memory):
        """Penetrations of the rollers of one run in partner p; the group of those that may touch it."""
        n = drive.rollers
        first, count = neighbors.run(w, drive, p, run)
        if p < drive.sprockets:
            partner = of.sprocket_of(ensemble, state, drive, p)
            group = place_on_sprocket(w, ensemble, first, first + count, n, partner, memory)
            teeth.touch_teeth(w, group.low, group.high, partner.sprocket, partner.pose, partner.body)
            return group
        guide = of.guide_of(ensemble, state, drive, p - drive.sprockets)
        group = touch_guide(w, ensemble, first, first + count, n, guide, memory)
        return group

    @wp.func
    def answer(
        w: wp.array[Real],
        group: Group,
        law: kinds.ContactLaw,
        friction: kinds.Friction,
        memory: Memory,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Forces of the contacts whose `touch` stands in the rows; adds them up in `totals[slot]`.

        Returns 1 if contacts keep something else from now on. Totals stand in memory: handed on by value, they would be
        copied where ways join.
        """
        measured = memory.wanted.measures != 0
        began = int(1)
        if law.answer > Real(0.0):
            force.copy_row(w, group, memory.dampers, row.damper_speed)
        changed = force.press(w, group, law, memory)
        if measured and law.exponent == Real(1.0) and friction.inertia == Real(0.0):
            began = force.add_measured_forces(w, group, law, memory)
        else:
            if friction.inertia > Real(0.0):
                rub_rollers(w, group, friction, memory)
            force.add_forces(w, group)
            if measured:
                force.lose(w, group, law, friction, memory)
        if law.answer > Real(0.0):
            force.copy_row(w, group, row.damper_speed, memory.dampers)
        if measured:
            sums.add_measured(w, group, law, friction, memory.wanted, totals, slot)
            if began != 0:
                totals[slot].impacts += sums.begun(w, group)
        else:
            sums.add_up(w, group, totals, slot, False)
        return changed

    @wp.func
    def take_down(
        w: wp.array[Real], group: Group, on_teeth: bool, impacts: int, wanted: Now, totals: wp.array[Totals], slot: int
    ):
        """Adds what only metrics count to the totals, `impacts` before this group; magnitudes for frames."""
        if wanted.sizes != 0:
            contact.add_sizes(w, group, wp.where(on_teeth, row.sprocket_force, row.guide_force))
        if wanted.measures != 0:
            if on_teeth:
                if totals[slot].impacts != impacts:
                    totals[slot].contacts += teeth.first_touches(w, group)
            else:
                totals[slot] = face.count_missed(w, group, totals[slot])

    @wp.func
    def evaluate_run(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: Memory,
    ):
        """Contacts of one run of rollers with partner p, eq. (5)-(23); adds them to its totals."""
        group = stand_on(ensemble, state, drive, w, p, run, memory)
        on_teeth = p < drive.sprockets
        if group.high > group.low:
            slot = drive.first_sprocket + drive.first_guide + p
            law = of.law_of(ensemble, drive, p)
            friction = of.friction_of(ensemble, drive, p)
            impacts = state.totals[slot].impacts
            body = of.carrier_of(ensemble, drive, p)
            if body != GROUND:
                pose = state.poses[drive.first_body + body]
                memory.straight = kinds.vec2(Real(pose.straight[0]), Real(pose.straight[1]))
                memory.angular = Real(pose.angular)
            changed = answer(w, group, law, friction, memory, state.totals, slot)
            if changed != 0 and memory.stage == 0:
                if on_teeth:
                    seats.keep(w, group.low, group.high, p, memory)
                else:
                    contact.keep(w, group, memory)
            take_down(w, group, on_teeth, impacts, memory.wanted, state.totals, slot)

    @wp.func
    def evaluate_all(ensemble: Ensemble, state: State, drive: Drive, w: wp.array[Real], memory: Memory):
        """Contacts of all rollers with all partners: each one's `Totals`, and the wrenches on their bodies.

        One loop over all runs, not one over each partner's: else what the loops over rollers want of a partner, common
        and rare ones alike, is laid out before its first run.
        """
        p = int(0)
        run = int(0)
        while p < drive.sprockets + drive.guides:
            slot = drive.first_sprocket + drive.first_guide + p
            runs = neighbors.count(w, drive, p)
            if run == 0:
                state.totals[slot] = Totals()
                memory.dampers = contact.damper_row(p)
            if run < runs:
                evaluate_run(ensemble, state, drive, w, p, run, memory)
                run += 1
            if run >= runs:
                body = of.carrier_of(ensemble, drive, p)
                if body != GROUND:
                    b = drive.first_body + body
                    state.wrenches[b] = with_reaction(
                        state.wrenches[b], state.totals[slot].push, state.totals[slot].moment
                    )
                memory.first = memory.first + drive.rollers
                run = 0
                p += 1

    return SimpleNamespace(**locals())
