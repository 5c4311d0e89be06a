"""Parts of one guide that face the crowns of a silent chain's backs (`physics.back`).

Height, normal and curvature of the guide at a crown's top stay in its contact's rows of penetration, normal and
mobility.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import LANES, load_constant, row_access
from ..physics.back import crown_over_bar, crown_over_piece, wheelward_components
from ..physics.guide import frame_vector, tracked_piece
from ..structs import Piece, Pose, types
from .link_runs import LinkRun
from .neighbor_list import (
    Group,
    highest_bit,
    is_near,
    lowest_bit,
    neighbor_list_functions,
    single_bit,
    without_lowest_bit,
)
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class BackFacingFunctions:
    """CPU functions of what faces backs."""

    find_facings: wp.Function


@cache
def back_facing_functions(Real: type, capacity: int) -> BackFacingFunctions:
    """CPU functions of what faces backs, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Guide, Memory, vec2 = kinds.Guide, kinds.Memory, kinds.vec2
    rollers = roller_functions(Real, capacity)
    access, seat_access = row_access(Real), row_access(wp.int32)
    row = rows(capacity)
    lanes = LANES[Real]
    neighbor_list = neighbor_list_functions(Real, capacity)

    @wp.func
    def exact_vector(x: Real, y: Real):
        """A vector in float64."""
        return wp.vec2d(wp.float64(x), wp.float64(y))

    @wp.func
    def normal_of_link(w: wp.array[Real], i: int, side: Real):
        """Components of w of the link after pin i."""
        # numbers, not vectors, which would keep loops from vectorizing
        return wheelward_components(access.load(w, row.link_ux + i + 1), access.load(w, row.link_uy + i + 1), side)

    @wp.func
    def crown_top(w: wp.array[Real], i: int, across_x: Real, across_y: Real, guide: Guide):
        """Top of the crown of the link after pin i [m], a world vector."""
        half = Real(0.5) * access.load(w, row.link_length + i + 1)
        x = half * access.load(w, row.link_ux + i + 1) - guide.roller_radius * across_x
        y = half * access.load(w, row.link_uy + i + 1) - guide.roller_radius * across_y
        return rollers.exact_position(w, i) + exact_vector(x, y)

    @wp.func
    def crown_center(q: wp.vec2d, across_x: Real, across_y: Real, guide: Guide, body: Pose):
        """Center of a crown [m] of which `q` is the top, both in the frame of the guide's body."""
        return q + wp.float64(guide.back_radius) * frame_vector(exact_vector(across_x, across_y), body)

    @wp.func
    def find_facing(
        w: wp.array[Real],
        i: int,
        run: LinkRun,
        side: Real,
        guide: Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """Tracks the piece of a guide under the crown of the link after pin i; returns whether there is one."""
        x, y = normal_of_link(w, i, side)
        top = crown_top(w, i, x, y, guide)
        if guide.pieces == 0:
            height, facing, curvature, is_over = crown_over_bar(top - guide.start, vec2(x, y), guide)
            facing_x, facing_y = facing[0], facing[1]
        else:
            q = frame_vector(top - body.center, body)
            center = crown_center(q, x, y, guide, body)
            number = tracked_piece(center, seat_access.load(memory.seat, memory.first + i), guide, pieces)
            seat_access.store(memory.seat, memory.first + i, number)
            at = guide.first_piece + number
            piece, following = load_constant(pieces, at), load_constant(pieces, at + 1)
            height, facing_x, facing_y, curvature, is_over = crown_over_piece(q, center, piece, following, guide)
        contacts, c = access.shifted_rows(w, run.rows), i - run.low
        access.store(contacts, row.penetration + c, height)
        access.store(contacts, row.normal_x + c, facing_x)
        access.store(contacts, row.normal_y + c, facing_y)
        access.store(contacts, row.point_mobility + c, curvature)
        return is_over

    @wp.func
    def store_if(contacts: wp.array[Real], i: int, is_wanted: bool, value: Real):
        """Stores a value of a row where it is wanted."""
        access.store(contacts, i, wp.where(is_wanted, value, access.load(contacts, i)))

    @wp.func
    def find_piece_facings(
        w: wp.array[Real],
        run: LinkRun,
        group: Group,
        number: int,
        side: Real,
        guide: Guide,
        body: Pose,
        pieces: wp.array[Piece],
    ):
        """Finds what piece `number` of a guide has under those crowns of a group that it was under before."""
        contacts = access.shifted_rows(w, run.rows - run.low)
        piece = load_constant(pieces, guide.first_piece + number)
        following = load_constant(pieces, guide.first_piece + number + 1)
        i = group.low
        while i < group.high:
            x, y = normal_of_link(w, i, side)
            q = frame_vector(crown_top(w, i, x, y, guide) - body.center, body)
            center = crown_center(q, x, y, guide, body)
            height, facing_x, facing_y, curvature, is_over = crown_over_piece(q, center, piece, following, guide)
            is_its = access.load(w, row.piece + i) == Real(number)
            store_if(contacts, row.penetration + i, is_its, height)
            store_if(contacts, row.normal_x + i, is_its, facing_x)
            store_if(contacts, row.normal_y + i, is_its, facing_y)
            store_if(contacts, row.point_mobility + i, is_its, curvature)
            store_if(contacts, row.exception + i, is_its, wp.where(is_over, Real(1.0), Real(0.0)))
            i = i + 1

    @wp.func
    def recall_pieces(w: wp.array[Real], run: LinkRun, group: Group, memory: Memory):
        """Copies numbers of the pieces under a run's crowns, -1 for none, from memory to their row."""
        contacts = access.shifted_rows(w, run.rows - run.low)
        i = run.low
        while i < run.low + run.pitch:
            number = Real(-1.0)
            if is_near(group, i):
                number = Real(seat_access.load(memory.seat, memory.first + i))
            access.store(w, row.piece + i, number)
            access.store(contacts, row.exception + i, Real(0.0))
            i = i + 1

    @wp.func
    def find_facings(
        w: wp.array[Real],
        run: LinkRun,
        group: Group,
        side: Real,
        guide: Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: Memory,
    ):
        """Finds what of a guide is under the crowns of the links after a group's pins; returns the run's that have it.

        Crowns that are still over their piece are worked out together, the others one by one.
        """
        shift, over = wp.uint64(run.low - group.first), wp.uint64(0)
        alone = group.near >> shift
        if guide.pieces != 0:
            recall_pieces(w, run, group, memory)
            left = (group.near & ~group.fresh) >> shift
            while left != wp.uint64(0):
                number = int(access.load(w, row.piece + run.low + lowest_bit(left)))
                others = access.find_unlike(w, row.piece + run.low, run.count, Real(number))
                low = run.low + (lowest_bit(left) & wp.static(-lanes))
                high = run.low + (highest_bit(left & ~others) & wp.static(-lanes)) + wp.static(lanes)
                find_piece_facings(w, run, neighbor_list.whole_group(low, high), number, side, guide, body, pieces)
                left = left & others
            over = access.find_above(w, row.exception + run.rows, run.count, Real(0.0))
            alone = alone & ~over
        while alone != wp.uint64(0):
            k = lowest_bit(alone)
            if find_facing(w, run.low + k, run, side, guide, body, pieces, memory):
                over = over | single_bit(k)
            alone = without_lowest_bit(alone)
        return over

    return BackFacingFunctions(find_facings=find_facings)
