"""The CPU kernel's passes over a group of rollers for one guide, a straight bar or a profile: who is near, how deep."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import accessors, load_constant
from ..physics.contact import AWAY, MISSED, UNTOUCHED, has_missed_face, rotated_vector, surface_velocity
from ..physics.guide import bar_contact, frame_vector, is_at_face, is_near_profile, piece_contact, tracked_piece
from ..structs import Piece, Pose, Totals, types
from .contacts import contact_rows
from .neighbor_list import Group, is_near, lowest_bit, neighbor_list, next_bits
from .rollers import passes, rows


@cache
def guide_passes(Real: type, capacity: int) -> SimpleNamespace:
    """The passes for one guide, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, Guide = kinds.Memory, kinds.Guide
    vec2, place, contact = kinds.vec2, passes(Real, capacity).place, contact_rows(Real, capacity)
    recall, place_arm, touch = contact.recall, contact.place_arm, contact.touch
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    load_piece, store_piece = accessors(wp.int32).load_row, accessors(wp.int32).store_row
    row = rows(capacity)
    unlike, neighbors = accessors(Real).unlike, neighbor_list(Real, capacity)

    @wp.func
    def find_over_bar(w: wp.array[Real], first: int, last: int, bar: Guide):
        """Which rollers from `first` on, before `last`, are at a guide-bar's face or ends; only those touch it."""
        reach = wp.float64(bar.end_radius + bar.roller_radius + bar.law.ahead)
        end = wp.float64(bar.length) + reach
        i = first
        while i < last:
            p = place(w, i) - bar.start
            along = wp.dot(p, bar.direction)
            across = Real(p[1] * bar.direction[0] - p[0] * bar.direction[1])
            near = Real(0.0)
            if along > -reach and along < end and is_at_face(across, bar):
                near = Real(1.0)
            store_row(w, row.near + i, near)
            i = i + 1

    @wp.func
    def leave_bar(first: int, count: int, near: wp.uint64, memory: Memory):
        """Forgets the contacts of rollers that are no longer over it."""
        left = unlike(memory.impact_speed, memory.first + first, count, Real(UNTOUCHED)) & ~near
        while left != wp.uint64(0):
            store_row(memory.impact_speed, memory.first + first + lowest_bit(left), Real(UNTOUCHED))
            left = next_bits(left)

    @wp.func
    def came_in(w: wp.array[Real], i: int, penetration: Real, guide: Guide):
        """Penetration of roller i in a guide, away if it did not come in through the face; notes which is so."""
        kept = Real(UNTOUCHED)
        if penetration > -guide.law.ahead and has_missed_face(penetration, load_row(w, row.before + i), guide):
            kept = Real(MISSED)
            penetration = Real(AWAY)
        store_row(w, row.open + i, kept)
        return penetration

    @wp.func
    def touch_bar(w: wp.array[Real], group: Group, bar: Guide, body: Pose, memory: Memory):
        """Stores the rollers' contacts with a guide-bar, eq. (21)-(23)."""
        i = group.low
        while i < group.high:
            arm = place(w, i) - body.center
            surface = surface_velocity(body, arm)
            v = vec2(load_row(w, row.vx + i), load_row(w, row.vy + i))
            moving = vec2(Real(surface[0]), Real(surface[1]))
            penetration, normal, relative = bar_contact(place(w, i) - bar.start, v, moving, bar)
            recall(w, i, group, memory)
            depth = wp.where(is_near(group, i), penetration, Real(AWAY))
            place_arm(w, i, Real(arm[0]), Real(arm[1]))
            touch(w, i, came_in(w, i, depth, bar), normal[0], normal[1], relative[0], relative[1])
            i = i + 1

    @wp.func
    def count_missed(w: wp.array[Real], group: Group, totals: Totals):
        """`totals` with the rollers that did not come in through the face."""
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            if load_row(w, row.open + i) == Real(MISSED):
                totals.missing += 1
                if load_row(w, row.before + i) == Real(UNTOUCHED):
                    totals.missed += 1
            bits = next_bits(bits)
        return totals

    @wp.func
    def find_over_profile(w: wp.array[Real], first: int, end: int, guide: Guide, body: Pose):
        """Which rollers from `first` on, before `end`, are near a profile."""
        i = first
        while i < end:
            near = Real(0.0)
            if is_near_profile(frame_vector(place(w, i) - body.center, body), guide) != 0:
                near = Real(1.0)
            store_row(w, row.near + i, near)
            i = i + 1

    @wp.func
    def recall_pieces(w: wp.array[Real], group: Group, memory: Memory):
        """Puts the v0 of contacts with a profile, and the pieces that rollers were over (-1: none), into their rows."""
        i = group.low
        while i < group.high:
            recall(w, i, group, memory)
            number = Real(-1.0)
            if is_near(group, i):
                number = Real(load_piece(memory.seat, memory.first + i))
            store_row(w, row.piece + i, number)
            store_row(w, row.penetration + i, Real(AWAY))
            i = i + 1

    @wp.func
    def track_pieces(
        w: wp.array[Real],
        first: int,
        rollers: wp.uint64,
        guide: Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """The pieces that some rollers from `first` on are over now."""
        bits = rollers
        while bits != wp.uint64(0):
            i = first + lowest_bit(bits)
            q = frame_vector(place(w, i) - body.center, body)
            number = tracked_piece(q, load_piece(memory.seat, memory.first + i), guide, pieces)
            store_piece(memory.seat, memory.first + i, number)
            store_row(w, row.piece + i, Real(number))
            bits = next_bits(bits)

    @wp.func
    def touch_piece(w: wp.array[Real], i: int, guide: Guide, body: Pose, piece: Piece, following: Piece):
        """Stores the contact of roller i with a piece of a profile; +1 where it is past that, -1 before, else 0."""
        arm = place(w, i) - body.center
        penetration, facing, beyond = piece_contact(frame_vector(arm, body), piece, following, guide)
        facing = rotated_vector(facing, body.cosine, body.sine)
        surface = surface_velocity(body, arm)
        speed_x, speed_y = Real(surface[0]) - load_row(w, row.vx + i), Real(surface[1]) - load_row(w, row.vy + i)
        place_arm(w, i, Real(arm[0]), Real(arm[1]))
        depth = came_in(w, i, penetration, guide)
        touch(w, i, depth, Real(facing[0]), Real(facing[1]), speed_x, speed_y)
        return beyond

    @wp.func
    def touch_pieces(w: wp.array[Real], group: Group, guide: Guide, body: Pose, pieces: wp.array[Piece]):
        """Stores the rollers' contacts with the pieces that they are over; 1 if any is over another one by now."""
        moved = int(0)
        left = group.near
        while left != wp.uint64(0):
            number = int(load_row(w, row.piece + group.first + lowest_bit(left)))
            others = unlike(w, row.piece + group.first, group.high - group.first, Real(number))
            some = neighbors.group_of(group.first, left & ~others, wp.uint64(0))
            piece = load_constant(pieces, guide.first_piece + number)
            following = load_constant(pieces, guide.first_piece + number + 1)
            i = some.low
            while i < some.high:
                if is_near(some, i):
                    beyond = touch_piece(w, i, guide, body, piece, following)
                    to = number + beyond
                    moved = moved | wp.where(beyond != 0 and to >= 0 and to < guide.pieces, 1, 0)
                i = i + 1
            left = left & others
        return moved

    @wp.func
    def touch_profile(
        w: wp.array[Real], group: Group, guide: Guide, body: Pose, pieces: wp.array[Piece], memory: Memory
    ):
        """Stores the rollers' contacts with a profile; the guide's `first_piece` is its first among all `pieces`.

        In most steps none of them comes to another piece.
        """
        recall_pieces(w, group, memory)
        track_pieces(w, group.first, group.fresh, guide, body, pieces, memory)
        if touch_pieces(w, group, guide, body, pieces) != 0:
            track_pieces(w, group.first, group.near, guide, body, pieces, memory)
            touch_pieces(w, group, guide, body, pieces)

    return SimpleNamespace(**locals())
