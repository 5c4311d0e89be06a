"""Contacts of the rollers of one variant with its partners, sprockets and guides."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..structs import GROUND, Drive, Wanted, Wrench, types
from ..sum_structs import Totals
from .contacts import contact_forces, contact_rows, contact_sums
from .guides import guide_passes
from .neighbor_list import Group, neighbor_list
from .partners import nearness, partners
from .rollers import rows
from .teeth import teeth_passes


@wp.func
def with_reaction(wrench: Wrench, force: wp.vec2d, moment: wp.float64):
    """The wrench on a body with what one more partner's contacts do to it."""
    wrench.force = wrench.force + force
    wrench.moment = wrench.moment + moment
    return wrench


@cache
def contact_pairs(Real: type, capacity: int, plain: bool) -> SimpleNamespace:
    """The function that evaluates all contacts of one variant, for rows of `capacity` values of type `Real`."""
    kinds, of = types(Real), partners(Real)
    Partner, near_group = of.Partner, nearness(Real, capacity, plain).near_group
    teeth, face = teeth_passes(Real, capacity), guide_passes(Real, capacity)
    contact = contact_rows(Real, capacity)
    force, sums = contact_forces(Real, capacity), contact_sums(Real, capacity)
    row, neighbors = rows(capacity), neighbor_list(Real, capacity)

    @wp.func
    def place_on_sprocket(
        w: wp.array[Real],
        ensemble: kinds.Ensemble,
        first: int,
        end: int,
        n: int,
        partner: Partner,
        memory: kinds.Memory,
    ):
        """Where the rollers from `first` on, before `end`, are in a sprocket's gaps; the group that may touch it.

        In most steps none of them comes, leaves or changes its seat.
        """
        moved, others = teeth.place_in_gaps(w, first, end, n, partner.sprocket, partner.pose, partner.body)
        if others != 0 or moved != wp.uint64(0):
            group = near_group(w, first, end, n, partner, memory)
            if group.high > group.low:
                teeth.seat_rollers(w, group, n, partner.sprocket, partner.pose, partner.body, ensemble.seats, memory)
            return group
        group = neighbors.whole_run(first, end)
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
    def stand_on(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: kinds.Memory,
    ):
        """How the rollers of one run stand on partner p; the group of those that may touch it."""
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
        sliding: kinds.Sliding,
        memory: kinds.Memory,
        chain: kinds.Chain,
        totals: wp.array[Totals],
        slot: int,
    ):
        """Forces of the contacts whose `touch` stands in the rows; adds them up in `totals[slot]`.

        Returns 1 if contacts keep something else from now on. Totals stand in memory: handed on by value, they would be
        copied where ways join.
        """
        measured = memory.wanted.measures != 0
        changed = int(0)
        began = int(1)
        if law.exponent == Real(1.0) and sliding.rubs == 0:
            if measured:
                changed, began = force.press_smoothly(w, group, law, memory, chain, True)
            else:
                changed, began = force.press_smoothly(w, group, law, memory, chain, False)
        else:
            changed = force.press(w, group, law)
            if sliding.rubs != 0:
                force.rub_rollers(w, group, sliding)
            force.add_forces(w, group)
            if measured:
                force.lose(w, group, sliding, memory, chain)
        if measured:
            sums.add_measured(w, group, law, sliding, memory.wanted, totals, slot)
            if began != 0:
                totals[slot].impacts += sums.begun(w, group)
        else:
            sums.add_up(w, group, totals, slot, False, False)
        return changed

    @wp.func
    def take_down(
        w: wp.array[Real],
        group: Group,
        on_teeth: bool,
        impacts: int,
        wanted: Wanted,
        totals: wp.array[Totals],
        slot: int,
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
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        p: int,
        run: int,
        memory: kinds.Memory,
    ):
        """Contacts of one run of rollers with partner p, eq. (5)-(23); adds them to its totals."""
        group = stand_on(ensemble, state, drive, w, p, run, memory)
        on_teeth = p < drive.sprockets
        if group.high > group.low:
            slot = drive.first_sprocket + drive.first_guide + p
            law = of.law_of(ensemble, drive, p)
            sliding = of.sliding_of(ensemble, drive, p)
            impacts = state.totals[slot].impacts
            changed = answer(w, group, law, sliding, memory, chain, state.totals, slot)
            if changed != 0 and memory.stage == 0:
                if on_teeth:
                    teeth.keep(w, group.low, group.high, p, memory)
                else:
                    contact.keep(w, group, memory)
            take_down(w, group, on_teeth, impacts, memory.wanted, state.totals, slot)

    @wp.func
    def evaluate_all(
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
        p = int(0)
        run = int(0)
        while p < drive.sprockets + drive.guides:
            slot = drive.first_sprocket + drive.first_guide + p
            runs = neighbors.count(w, drive, p)
            if run == 0:
                state.totals[slot] = Totals()
            if run < runs:
                evaluate_run(ensemble, state, drive, chain, w, p, run, memory)
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

    return namespace(evaluate_all)
