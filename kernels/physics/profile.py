r"""Roller on a guide's profile: arcs and straight pieces joined with a continuous normal, the chain on their left.

A piece starts at a with the unit tangent t, its normal n = (-t_y, t_x) points to the chain, and k is its curvature,
positive where its center lies on the chain's side (a hollow face), 0 on a straight piece. With u = (r - a).t and
w = (r - a).n the center of the piece is at u = 0, w = 1/k, and a roller's center is over the face by

    d = (1 - k sqrt(u^2 + (w - 1/k)^2)) / k = g / (1 + sqrt(1 - k g)),   g = 2 w - k (u^2 + w^2)        (a)

whichever the sign of k, without the difference of large lengths, and for k = 0 too. The normal is the gradient of d,

    (-k u, 1 - k w) / sqrt(1 - k g)   along t and n,                                                    (b)

and the place under the roller is s = atan2(k u, 1 - k w) / k from the piece's start. A roller is over piece i where
(r - a_i).t_i >= 0 and (r - a_{i+1}).t_{i+1} < 0. It keeps its piece and looks at the next and the one before, so that
the time does not grow with the pieces (Pedersen et al. 2004, eq. (21)-(23), are the case of one straight piece).

On blocks at float32 without float64, the roller in the frame of the guide's body, and so from a piece's start, is a
pair; along and across the piece it is the difference of products that are small there, and float32
(`guide.line_coordinates`). A piece is three rows of four then:

    0  start, high parts (x, y) and low parts      1  direction, the same      2  curvature, 0, 0, 0
"""

from typing import Any

import warp as wp

from ..fast_math import inside, inverse_root
from ..number import PairVector, difference, fused, leading, minus, pair, pair_vector, plus, times
from ..rows import load_constant
from ..structs import Line, Piece, Pose, Wheel
from .guide import line_coordinates

PIECE_ROWS = wp.constant(3)
"""Rows of four a piece at float32."""


@wp.func
def piece_height(u: Any, w: Any, curvature: Any):
    """Height over a piece's face [m] and the normal's components along its tangent and normal, (a) and (b).

    Args:
        u, w: the roller's center from the piece's start, along its tangent and normal [m].
        curvature: k [1/m].
    """
    one = type(u)(1.0)
    g = type(u)(2.0) * w - curvature * (u * u + w * w)
    square = wp.max(one - curvature * g, type(u)(1.0e-12))  # 0 in an arc's center only
    inverse = inverse_root(square)
    return g / (one + square * inverse), -curvature * u * inverse, (one - curvature * w) * inverse


@wp.func
def place_along(u: wp.float64, w: wp.float64, curvature: wp.float64):
    """How far from a piece's start its face is nearest [m]."""
    place = u
    if curvature != wp.float64(0.0):
        place = wp.atan2(curvature * u, wp.float64(1.0) - curvature * w) / curvature
    return place


@wp.func
def in_frame(q: wp.vec2d, body: Pose):
    """`q`, from a body's center, in that body's own frame [m]."""
    return wp.vec2d(q[0] * body.cosine + q[1] * body.sine, q[1] * body.cosine - q[0] * body.sine)


@wp.func
def in_frame(q: PairVector, body: Wheel):
    """The same in pairs."""
    x = pair(q.high[0], q.low[0])
    y = pair(q.high[1], q.low[1])
    along = plus(times(x, body.cosine), times(y, body.sine))
    across = plus(times(y, body.cosine), minus(times(x, body.sine)))
    return pair_vector(wp.vec2f(along.high, across.high), wp.vec2f(along.low, across.low))


@wp.func
def near_profile(q: wp.vec2d, guide: Any):
    """1 where a roller at `q`, in the frame of the guide's body, is in the box about the guide's chord, else 0."""
    along, across = line_coordinates(q - guide.start, guide.direction)
    return inside(along, guide.low[0], guide.high[0]) & inside(across, guide.low[1], guide.high[1])


@wp.func
def near_profile(q: PairVector, line: Line, box: wp.vec4f):
    """The same at float32; `line` is the chord, `box` has the low and the high corner along and across it [m]."""
    along, across = line_coordinates(q, line)
    return inside(along, box[0], box[2]) & inside(across, box[1], box[3])


@wp.func
def from_piece(q: wp.vec2d, i: int, pieces: wp.array[Piece]):
    """`q` from the start of piece `i` of all [m]."""
    return q - pieces[i].start


@wp.func
def from_piece(q: PairVector, i: int, pieces: wp.array[wp.vec4f]):
    """The same in pairs."""
    start = load_constant(pieces, PIECE_ROWS * i)
    return difference(q, pair_vector(wp.vec2f(start[0], start[1]), wp.vec2f(start[2], start[3])))


@wp.func
def is_past(q: wp.vec2d, i: int, pieces: wp.array[Piece]):
    """Whether a roller is past the start of piece `i` of all."""
    return wp.dot(from_piece(q, i, pieces), pieces[i].direction) >= wp.float64(0.0)


@wp.func
def is_past(q: PairVector, i: int, pieces: wp.array[wp.vec4f]):
    """The same in pairs, wherever it is asked and whatever is fused there."""
    p = from_piece(q, i, pieces)
    t = load_constant(pieces, PIECE_ROWS * i + 1)
    rest = fused(p.low[0], t[0], fused(p.low[1], t[1], fused(p.high[0], t[2], p.high[1] * t[3])))
    return fused(p.high[0], t[0], fused(p.high[1], t[1], rest)) >= 0.0


@wp.func
def tangent_of(i: int, pieces: wp.array[Piece]):
    """Direction of piece `i` of all at its start."""
    return pieces[i].direction


@wp.func
def tangent_of(i: int, pieces: wp.array[wp.vec4f]):
    """The same at float32."""
    t = load_constant(pieces, PIECE_ROWS * i + 1)
    return wp.vec2f(t[0], t[1])


@wp.func
def piece_coordinates(q: wp.vec2d, i: int, pieces: wp.array[Piece]):
    """u, w [m] and curvature [1/m] of a roller over piece `i` of all, see (a)."""
    u, w = line_coordinates(from_piece(q, i, pieces), pieces[i].direction)
    return u, w, pieces[i].curvature


@wp.func
def piece_coordinates(q: PairVector, i: int, pieces: wp.array[wp.vec4f]):
    """The same at float32."""
    t = load_constant(pieces, PIECE_ROWS * i + 1)
    u, w = line_coordinates(from_piece(q, i, pieces), wp.vec2f(t[0], t[1]), wp.vec2f(t[2], t[3]))
    return u, w, load_constant(pieces, PIECE_ROWS * i + 2)[0]


@wp.func
def piece_beyond(q: Any, number: int, first: int, pieces: Any):
    """+1 where a roller is past piece `number` of a profile whose first is `first`, -1 where it is before, else 0."""
    step = wp.where(is_past(q, first + number, pieces), 0, -1)
    return wp.where(is_past(q, first + number + 1, pieces), 1, step)


@wp.func
def nearest_piece(q: Any, count: int, first: int, pieces: Any):
    """The piece of a profile that a roller is over, the one whose face is nearest; if over none, the nearer end's."""
    begun = wp.length(leading(from_piece(q, first, pieces)))
    ending = wp.length(leading(from_piece(q, first + count, pieces)))
    nearest = wp.where(begun < ending, 0, count - 1)
    least = type(begun)(1.0e38)
    for number in range(count):
        if piece_beyond(q, number, first, pieces) == 0:
            u, w, curvature = piece_coordinates(q, first + number, pieces)
            height, along, across = piece_height(u, w, curvature)
            if wp.abs(height) < least:
                least = wp.abs(height)
                nearest = number
    return nearest


@wp.func
def tracked_piece(q: Any, kept: int, guide: Any, pieces: Any):
    """The piece of a guide that a roller at `q` is over or, beyond the guide's ends, was over last.

    Args:
        q: in the frame of the guide's body [m].
        kept: the piece of the step before, of which this one is a neighbor; negative: all are searched.
        guide: `structs.Guide`, its `first_piece` counted among all.
        pieces: of all.
    """
    if kept < 0:
        return nearest_piece(q, guide.pieces, guide.first_piece, pieces)
    return wp.clamp(kept + piece_beyond(q, kept, guide.first_piece, pieces), 0, guide.pieces - 1)


@wp.func
def on_profile(q: Any, number: int, guide: Any, pieces: Any):
    """Penetration [m] of a roller on a guide's profile and the normal, in the frame of the guide's body.

    The penetration is not positive where they do not touch, and where the roller is behind the guide.

    Args:
        q: in that frame [m].
        number: of the roller's piece.
        guide: `structs.Guide`, its `first_piece` counted among all; the penetration has the type of its lengths.
        pieces: of all.
    """
    u, w, curvature = piece_coordinates(q, guide.first_piece + number, pieces)
    length = guide.length
    height, along, across = piece_height(type(length)(u), type(length)(w), type(length)(curvature))
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or piece_beyond(q, number, guide.first_piece, pieces) != 0:
        penetration = type(length)(0.0)
    t = tangent_of(guide.first_piece + number, pieces)
    x = type(u)(along) * t[0] - type(u)(across) * t[1]
    y = type(u)(along) * t[1] + type(u)(across) * t[0]
    return penetration, type(t)(x, y)
