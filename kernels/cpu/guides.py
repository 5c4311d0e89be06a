"""Contacts of rollers with one guide, a straight bar or a profile: who is near, and how deep."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import load_constant, row_access
from ..physics.contact import AWAY, MISSED, UNTOUCHED, has_missed_face, rotated_vector, surface_velocity
from ..physics.guide import bar_contact, frame_vector, is_at_face, is_near_profile, piece_contact, tracked_piece
from ..structs import Piece, Pose, Totals, types
from .contact_rows import contact_row_functions
from .neighbor_list import Group, is_near, lowest_bit, neighbor_list_functions, without_lowest_bit
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class GuideFunctions:
    """CPU functions of rollers' contacts with one guide."""

    mark_over_bar: wp.Function
    forget_bar: wp.Function
    face_penetration: wp.Function
    find_bar_contacts: wp.Function
    count_missed: wp.Function
    mark_over_profile: wp.Function
    find_profile_contacts: wp.Function


@cache
def guide_functions(Real: type, capacity: int) -> GuideFunctions:
    """CPU functions of contacts with one guide, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, Guide = kinds.Memory, kinds.Guide
    vec2 = kinds.vec2
    rollers = roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)
    seat_access = row_access(wp.int32)
    row = rows(capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def mark_over_bar(w: wp.array[Real], first: int, last: int, guide: Guide):
        """Marks rollers from `first` to before `last` that are at a guide-bar's face or ends."""
        reach = wp.float64(guide.end_radius + guide.roller_radius + guide.law.ahead)
        end = wp.float64(guide.length) + reach
        i = first
        while i < last:
            p = rollers.exact_position(w, i) - guide.start
            along = wp.dot(p, guide.direction)
            across = Real(p[1] * guide.direction[0] - p[0] * guide.direction[1])
            near = Real(0.0)
            if along > -reach and along < end and is_at_face(across, guide):
                near = Real(1.0)
            access.store(w, row.near + i, near)
            i = i + 1

    @wp.func
    def forget_bar(first: int, count: int, near: wp.uint64, memory: Memory):
        """Clears the contacts of rollers no longer over a guide-bar."""
        left = access.find_unlike(memory.impact_speed, memory.first + first, count, Real(UNTOUCHED)) & ~near
        while left != wp.uint64(0):
            access.store(memory.impact_speed, memory.first + first + lowest_bit(left), Real(UNTOUCHED))
            left = without_lowest_bit(left)

    @wp.func
    def face_penetration(w: wp.array[Real], i: int, penetration: Real, guide: Guide):
        """Penetration of roller `i` in a guide, `AWAY` if it missed the face; stores which is so."""
        kept = Real(UNTOUCHED)
        if penetration > -guide.law.ahead and has_missed_face(penetration, access.load(w, row.v0_before + i), guide):
            kept = Real(MISSED)
            penetration = Real(AWAY)
        access.store(w, row.v0_open + i, kept)
        return penetration

    @wp.func
    def find_bar_contacts(w: wp.array[Real], group: Group, guide: Guide, body: Pose, memory: Memory):
        """Stores a group's contacts with a guide-bar, eq. (21)-(23)."""
        i = group.low
        while i < group.high:
            arm = rollers.exact_position(w, i) - body.center
            surface = surface_velocity(body, arm)
            v = vec2(access.load(w, row.vx + i), access.load(w, row.vy + i))
            moving = vec2(Real(surface[0]), Real(surface[1]))
            penetration, normal, relative = bar_contact(rollers.exact_position(w, i) - guide.start, v, moving, guide)
            contact_rows.recall_impact_speed(w, i, group, memory)
            depth = wp.where(is_near(group, i), penetration, Real(AWAY))
            contact_rows.store_arm(w, i, Real(arm[0]), Real(arm[1]))
            contact_rows.store_contact(
                w, i, face_penetration(w, i, depth, guide), normal[0], normal[1], relative[0], relative[1]
            )
            i = i + 1

    @wp.func
    def count_missed(w: wp.array[Real], group: Group, totals: Totals):
        """Totals with the number of the group's rollers that missed the guide's face."""
        bits = group.near
        while bits != wp.uint64(0):
            i = group.first + lowest_bit(bits)
            if access.load(w, row.v0_open + i) == Real(MISSED):
                totals.missing += 1
                if access.load(w, row.v0_before + i) == Real(UNTOUCHED):
                    totals.missed += 1
            bits = without_lowest_bit(bits)
        return totals

    @wp.func
    def mark_over_profile(w: wp.array[Real], first: int, end: int, guide: Guide, body: Pose):
        """Marks rollers from `first` to before `end` that are near a guide's profile."""
        i = first
        while i < end:
            near = Real(0.0)
            if is_near_profile(frame_vector(rollers.exact_position(w, i) - body.center, body), guide) != 0:
                near = Real(1.0)
            access.store(w, row.near + i, near)
            i = i + 1

    @wp.func
    def recall_pieces(w: wp.array[Real], group: Group, memory: Memory):
        """Copies v0 of contacts with a profile, and rollers' pieces (-1: none), from memory to rows."""
        i = group.low
        while i < group.high:
            contact_rows.recall_impact_speed(w, i, group, memory)
            number = Real(-1.0)
            if is_near(group, i):
                number = Real(seat_access.load(memory.seat, memory.first + i))
            access.store(w, row.piece + i, number)
            access.store(w, row.penetration + i, Real(AWAY))
            i = i + 1

    @wp.func
    def track_pieces(
        w: wp.array[Real],
        first: int,
        which: wp.uint64,
        guide: Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """Finds the profile's pieces under rollers, bits `which` from `first` on."""
        bits = which
        while bits != wp.uint64(0):
            i = first + lowest_bit(bits)
            q = frame_vector(rollers.exact_position(w, i) - body.center, body)
            number = tracked_piece(q, seat_access.load(memory.seat, memory.first + i), guide, pieces)
            seat_access.store(memory.seat, memory.first + i, number)
            access.store(w, row.piece + i, Real(number))
            bits = without_lowest_bit(bits)

    @wp.func
    def store_piece_contact(w: wp.array[Real], i: int, guide: Guide, body: Pose, piece: Piece, following: Piece):
        """Stores roller i's contact with a profile's piece; returns +1 past the piece, -1 before it, else 0."""
        arm = rollers.exact_position(w, i) - body.center
        penetration, facing, beyond = piece_contact(frame_vector(arm, body), piece, following, guide)
        facing = rotated_vector(facing, body.cosine, body.sine)
        surface = surface_velocity(body, arm)
        speed_x, speed_y = Real(surface[0]) - access.load(w, row.vx + i), Real(surface[1]) - access.load(w, row.vy + i)
        contact_rows.store_arm(w, i, Real(arm[0]), Real(arm[1]))
        depth = face_penetration(w, i, penetration, guide)
        contact_rows.store_contact(w, i, depth, Real(facing[0]), Real(facing[1]), speed_x, speed_y)
        return beyond

    @wp.func
    def store_piece_contacts(w: wp.array[Real], group: Group, guide: Guide, body: Pose, pieces: wp.array[Piece]):
        """Stores a group's contacts with their pieces of a profile; returns 1 if any is over another piece."""
        moved = int(0)
        left = group.near
        while left != wp.uint64(0):
            number = int(access.load(w, row.piece + group.first + lowest_bit(left)))
            others = access.find_unlike(w, row.piece + group.first, group.high - group.first, Real(number))
            some = neighbor_list.near_group(group.first, left & ~others, wp.uint64(0))
            piece = load_constant(pieces, guide.first_piece + number)
            following = load_constant(pieces, guide.first_piece + number + 1)
            i = some.low
            while i < some.high:
                if is_near(some, i):
                    beyond = store_piece_contact(w, i, guide, body, piece, following)
                    to = number + beyond
                    moved = moved | wp.where(beyond != 0 and to >= 0 and to < guide.pieces, 1, 0)
                i = i + 1
            left = left & others
        return moved

    @wp.func
    def find_profile_contacts(
        w: wp.array[Real], group: Group, guide: Guide, body: Pose, pieces: wp.array[Piece], memory: Memory
    ):
        """Stores a group's contacts with a guide's profile."""
        recall_pieces(w, group, memory)
        track_pieces(w, group.first, group.fresh, guide, body, pieces, memory)
        if store_piece_contacts(w, group, guide, body, pieces) != 0:
            track_pieces(w, group.first, group.near, guide, body, pieces, memory)
            store_piece_contacts(w, group, guide, body, pieces)

    return GuideFunctions(
        mark_over_bar=mark_over_bar,
        forget_bar=forget_bar,
        face_penetration=face_penetration,
        find_bar_contacts=find_bar_contacts,
        count_missed=count_missed,
        mark_over_profile=mark_over_profile,
        find_profile_contacts=find_profile_contacts,
    )
