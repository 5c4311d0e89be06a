r"""A roller on a guide's profile at float32 without float64: `profile`, from pairs.

The roller in the frame of the guide's body, and so from a piece's start, is a pair; along and across the piece it is
the difference of products that are small there, and float32 (`seat.line_coordinates`). A piece is three rows of four:

    0  start, high parts (x, y) and low parts      1  direction, the same      2  curvature, 0, 0, 0
"""

from typing import Any

import warp as wp

from ..pairs import fused, minus, pair, plus, times
from ..root import inside
from ..structs import Line, Wheel
from .profile import piece_height
from .seat import Away, away, line_coordinates, load_split

PIECE_ROWS = wp.constant(3)


@wp.func
def in_body(p: Away, body: Wheel):
    """`p`, from a body's center, in that body's own frame [m]."""
    x = pair(p.high[0], p.low[0])
    y = pair(p.high[1], p.low[1])
    along = plus(times(x, body.cosine), times(y, body.sine))
    across = plus(times(y, body.cosine), minus(times(x, body.sine)))
    q = Away()
    q.high = wp.vec2f(along.high, across.high)
    q.low = wp.vec2f(along.low, across.low)
    return q


@wp.func
def from_piece(q: Away, row: int, pieces: wp.array[wp.vec4f]):
    """`q` from the start of the piece whose rows begin at `row` [m]."""
    start = load_split(pieces, row)
    return away(q.high, q.low, wp.vec2f(start[0], start[1]), wp.vec2f(start[2], start[3]))


@wp.func
def is_past(q: Away, row: int, pieces: wp.array[wp.vec4f]):
    """Whether a roller is past the start of a piece: the same wherever it is asked, whatever is fused there."""
    p = from_piece(q, row, pieces)
    t = load_split(pieces, row + 1)
    rest = fused(p.low[0], t[0], fused(p.low[1], t[1], fused(p.high[0], t[2], p.high[1] * t[3])))
    return fused(p.high[0], t[0], fused(p.high[1], t[1], rest)) >= 0.0


@wp.func
def beyond_piece(q: Away, number: int, first: int, pieces: wp.array[wp.vec4f]):
    """As `profile.piece_beyond`."""
    row = PIECE_ROWS * (first + number)
    step = wp.where(is_past(q, row, pieces), 0, -1)
    return wp.where(is_past(q, row + PIECE_ROWS, pieces), 1, step)


@wp.func
def over_piece(q: Away, row: int, pieces: wp.array[wp.vec4f]):
    """Height over a piece's face [m] and the normal's components along its tangent and normal."""
    t = load_split(pieces, row + 1)
    u, w = line_coordinates(from_piece(q, row, pieces), wp.vec2f(t[0], t[1]), wp.vec2f(t[2], t[3]))
    return piece_height(u, w, load_split(pieces, row + 2)[0])


@wp.func
def nearest_face(q: Away, count: int, first: int, pieces: wp.array[wp.vec4f]):
    """As `profile.nearest_piece`."""
    row = PIECE_ROWS * first
    begun = from_piece(q, row, pieces)
    ending = from_piece(q, row + PIECE_ROWS * count, pieces)
    nearest = wp.where(wp.length(begun.high) < wp.length(ending.high), 0, count - 1)
    least = float(1.0e38)
    for number in range(count):
        if beyond_piece(q, number, first, pieces) == 0:
            height, along, across = over_piece(q, row + PIECE_ROWS * number, pieces)
            if wp.abs(height) < least:
                least = wp.abs(height)
                nearest = number
    return nearest


@wp.func
def tracked_face(q: Away, kept: int, guide: Any, pieces: wp.array[wp.vec4f]):
    """As `profile.tracked_piece`."""
    if kept < 0:
        return nearest_face(q, guide.pieces, guide.first_piece, pieces)
    return wp.clamp(kept + beyond_piece(q, kept, guide.first_piece, pieces), 0, guide.pieces - 1)


@wp.func
def on_face(q: Away, number: int, guide: Any, pieces: wp.array[wp.vec4f]):
    """As `profile.on_profile`."""
    row = PIECE_ROWS * (guide.first_piece + number)
    height, along, across = over_piece(q, row, pieces)
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or beyond_piece(q, number, guide.first_piece, pieces) != 0:
        penetration = 0.0
    t = load_split(pieces, row + 1)
    return penetration, wp.vec2f(along * t[0] - across * t[1], along * t[1] + across * t[0])


@wp.func
def near_face(q: Away, line: Line, box: wp.vec4f):
    """1 where a roller at `q`, in the frame of the guide's body, is in the box (low, high) about its chord."""
    x = (q.high[0] - line.start[0]) + (q.low[0] - line.start_low[0])
    y = (q.high[1] - line.start[1]) + (q.low[1] - line.start_low[1])
    along = x * line.direction[0] + y * line.direction[1]
    across = y * line.direction[0] - x * line.direction[1]
    return inside(along, box[0], box[2]) & inside(across, box[1], box[3])
