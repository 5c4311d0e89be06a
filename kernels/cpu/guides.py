"""The CPU kernel's passes over the rollers of one variant for its guides: straight bars, and profiles."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import MISSED, UNTOUCHED, misses, on_guide, surface_velocity, turned
from ..physics.profile import in_frame, near_profile, on_profile, tracked_piece
from ..rows import accessors
from ..structs import Piece, Pose, types
from ..sum_structs import Totals
from .contacts import GROUP, Group, bit_of, contacts, group_of, is_near, lowest_bit, next_bits
from .rollers import passes, rows


@dataclass(frozen=True)
class GuidePasses:
    """The passes over the rollers of one variant for its guides."""

    guide_pass: wp.Function
    profile_pass: wp.Function


@cache
def guide_passes(Real: type, capacity: int) -> GuidePasses:
    """The passes for guides over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2, place, contact = kinds.vec2, passes(Real, capacity).place, contacts(Real, capacity)
    kept_from, touch, answer = contact.kept_from, contact.touch, contact.answer
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_piece, store_piece = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    at = rows(capacity)
    VX, VY, GUIDE_FORCE, BEFORE, OPEN, PENETRATION = at.vx, at.vy, at.guide_force, at.before, at.open, at.penetration

    @wp.func
    def over_bar(w: wp.array[Real], first: int, count: int, bar: kinds.Guide):
        """Which of `count` rollers from `first` on are over a guide-bar, as bits."""
        reach = wp.float64(bar.end_radius + bar.roller_radius)
        end = wp.float64(bar.length) + reach
        near = wp.uint64(0)
        k = int(0)
        while k < count:
            along = wp.dot(place(w, first + k) - bar.start, bar.direction)
            if along > -reach and along < end:
                near = near | bit_of(k)
            k = k + 1
        return near

    @wp.func
    def leave_bar(first: int, count: int, near: wp.uint64, memory: kinds.Memory):
        """Forgets the contacts of rollers that are no longer over it."""
        kept = wp.uint64(0)
        k = int(0)
        while k < count:
            if load_row(memory.impact_speed, memory.first + first + k) != Real(UNTOUCHED):
                kept = kept | bit_of(k)
            k = k + 1
        left = kept & ~near
        while left != wp.uint64(0):
            store_row(memory.impact_speed, memory.first + first + lowest_bit(left), Real(UNTOUCHED))
            left = next_bits(left)

    @wp.func
    def touch_face(
        w: wp.array[Real], i: int, arm: vec2, penetration: Real, normal: vec2, relative: vec2, guide: kinds.Guide
    ):
        """How roller i stands on a guide; one that did not come in through the face does not touch it."""
        kept = Real(UNTOUCHED)
        if penetration > Real(0.0) and misses(penetration, load_row(w, BEFORE + i), guide):
            kept = Real(MISSED)
            penetration = Real(0.0)
        touch(w, i, arm, penetration, normal, relative)
        store_row(w, OPEN + i, kept)

    @wp.func
    def touch_bar(w: wp.array[Real], group: Group, bar: kinds.Guide, body: Pose):
        """How the rollers stand on a guide-bar, eq. (21)-(23)."""
        i = group.low
        while i < group.high:
            arm = place(w, i) - body.center
            surface = surface_velocity(body, arm)
            v = vec2(load_row(w, VX + i), load_row(w, VY + i))
            moving = vec2(Real(surface[0]), Real(surface[1]))
            penetration, normal, relative = on_guide(place(w, i) - bar.start, v, moving, bar)
            depth = wp.where(is_near(group, i), penetration, Real(0.0))
            touch_face(w, i, vec2(Real(arm[0]), Real(arm[1])), depth, normal, relative, bar)
            i = i + 1

    @wp.func
    def count_missed(w: wp.array[Real], group: Group, totals: Totals):
        """`totals` with the rollers that did not come in through the face."""
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            if load_row(w, OPEN + i) == Real(MISSED):
                totals.missing += 1
                if load_row(w, BEFORE + i) == Real(UNTOUCHED):
                    totals.missed += 1
            bits = next_bits(bits)
        return totals

    @wp.func
    def guide_pass(
        w: wp.array[Real],
        n: int,
        bar: kinds.Guide,
        body: Pose,
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
    ):
        """Contacts of all rollers with one guide-bar on a body, eq. (21)-(23); returns their `Totals`."""
        totals = Totals()
        first = int(0)
        while first < n:
            count = wp.min(n - first, GROUP)
            near = over_bar(w, first, count, bar)
            if memory.stage == 0:
                leave_bar(first, count, near, memory)
            if near != wp.uint64(0):
                group = group_of(first, near)
                kept_from(w, group, memory)
                touch_bar(w, group, bar, body)
                totals = answer(w, group, GUIDE_FORCE, bar.law, sliding, memory, chain, totals)
                if memory.measured != 0:
                    totals = count_missed(w, group, totals)
            first = first + GROUP
        return totals

    @wp.func
    def touch_profile(
        w: wp.array[Real], i: int, guide: kinds.Guide, body: Pose, pieces: wp.array[Piece], memory: kinds.Memory
    ):
        """How roller i, which is near, stands on a profile."""
        arm = place(w, i) - body.center
        q = in_frame(arm, body)
        number = tracked_piece(q, load_piece(memory.seat, memory.first + i), guide, pieces)
        store_piece(memory.seat, memory.first + i, number)
        penetration, facing = on_profile(q, number, guide, pieces)
        facing = turned(facing, body.cosine, body.sine)
        surface = surface_velocity(body, arm)
        relative = vec2(Real(surface[0]), Real(surface[1])) - vec2(load_row(w, VX + i), load_row(w, VY + i))
        normal = vec2(Real(facing[0]), Real(facing[1]))
        touch_face(w, i, vec2(Real(arm[0]), Real(arm[1])), penetration, normal, relative, guide)

    @wp.func
    def over_profile(w: wp.array[Real], group: Group, guide: kinds.Guide, body: Pose, memory: kinds.Memory):
        """Which of a group's rollers are near a profile, as bits; forgets the contacts of those that are not."""
        near = wp.uint64(0)
        i = group.low
        while i < group.high:
            if near_profile(in_frame(place(w, i) - body.center, body), guide):
                near = near | bit_of(i - group.first)
            elif load_piece(memory.seat, memory.first + i) >= 0:
                store_piece(memory.seat, memory.first + i, -1)
                store_row(memory.impact_speed, memory.first + i, Real(0.0))
            i = i + 1
        return near

    @wp.func
    def profile_pass(
        w: wp.array[Real],
        n: int,
        guide: kinds.Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
    ):
        """Contacts of all rollers with one guide's profile on a body; returns their `Totals`.

        The guide's `first_piece` is its first among all `pieces`.
        """
        totals = Totals()
        group = Group()
        while group.first < n:
            group.low = group.first
            group.high = wp.min(group.first + GROUP, n)
            near = over_profile(w, group, guide, body, memory)
            if near != wp.uint64(0):
                group = group_of(group.first, near)
                i = group.low
                while i < group.high:
                    store_row(w, PENETRATION + i, Real(0.0))
                    i = i + 1
                kept_from(w, group, memory)
                bits = near
                while bits != wp.uint64(0):
                    touch_profile(w, group.first + lowest_bit(bits), guide, body, pieces, memory)
                    bits = next_bits(bits)
                totals = answer(w, group, GUIDE_FORCE, guide.law, sliding, memory, chain, totals)
                if memory.measured != 0:
                    totals = count_missed(w, group, totals)
            group.first = group.first + GROUP
        return totals

    return GuidePasses(guide_pass=guide_pass, profile_pass=profile_pass)
