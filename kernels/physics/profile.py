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
"""

from typing import Any

import warp as wp

from ..root import inside, inverse_root
from ..structs import Piece, Pose


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
def near_profile(q: wp.vec2d, guide: Any):
    """1 where a roller at `q`, in the frame of the guide's body, is in the box where it is looked after."""
    p = q - guide.start
    along = wp.dot(p, guide.direction)
    across = p[1] * guide.direction[0] - p[0] * guide.direction[1]
    return inside(along, guide.low[0], guide.high[0]) & inside(across, guide.low[1], guide.high[1])


@wp.func
def piece_beyond(q: wp.vec2d, number: int, first: int, pieces: wp.array[Piece]):
    """+1 where a roller is past piece `number` of a profile whose first is `first`, -1 where it is before, else 0."""
    here = pieces[first + number]
    ahead = pieces[first + number + 1]
    step = wp.where(wp.dot(q - here.start, here.direction) < wp.float64(0.0), -1, 0)
    return wp.where(wp.dot(q - ahead.start, ahead.direction) >= wp.float64(0.0), 1, step)


@wp.func
def nearest_piece(q: wp.vec2d, count: int, first: int, pieces: wp.array[Piece]):
    """The piece of a profile that a roller is over, the one whose face is nearest; if over none, the nearer end's."""
    ending = pieces[first + count].start
    nearest = wp.where(wp.length(q - pieces[first].start) < wp.length(q - ending), 0, count - 1)
    least = wp.float64(1.0e308)
    for number in range(count):
        if piece_beyond(q, number, first, pieces) == 0:
            piece = pieces[first + number]
            p = q - piece.start
            across = p[1] * piece.direction[0] - p[0] * piece.direction[1]
            height, normal_along, normal_across = piece_height(wp.dot(p, piece.direction), across, piece.curvature)
            if wp.abs(height) < least:
                least = wp.abs(height)
                nearest = number
    return nearest


@wp.func
def tracked_piece(q: wp.vec2d, kept: int, guide: Any, pieces: wp.array[Piece]):
    """The piece of a guide that a roller at `q` is over or, beyond the guide's ends, was over last.

    Args:
        q: in the frame of the guide's body [m].
        kept: the piece of the step before, of which this one is a neighbor; negative: all are looked at.
        guide: `structs.Guide`, its `first_piece` counted among all.
        pieces: of all.
    """
    if kept < 0:
        return nearest_piece(q, guide.pieces, guide.first_piece, pieces)
    return wp.clamp(kept + piece_beyond(q, kept, guide.first_piece, pieces), 0, guide.pieces - 1)


@wp.func
def on_profile(q: wp.vec2d, number: int, guide: Any, pieces: wp.array[Piece]):
    """Penetration [m] of a roller on a guide's profile and the normal, in the frame of the guide's body.

    The penetration is not positive where they do not touch, and where the roller is behind the guide.

    Args:
        q: in that frame [m].
        number: of the roller's piece.
        guide: `structs.Guide`, its `first_piece` counted among all; the penetration has the type of its lengths.
        pieces: of all.
    """
    piece = pieces[guide.first_piece + number]
    p = q - piece.start
    t = piece.direction
    u = type(guide.length)(wp.dot(p, t))
    w = type(guide.length)(p[1] * t[0] - p[0] * t[1])
    height, along, across = piece_height(u, w, type(guide.length)(piece.curvature))
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or piece_beyond(q, number, guide.first_piece, pieces) != 0:
        penetration = type(guide.length)(0.0)
    x = wp.float64(along) * t[0] - wp.float64(across) * t[1]
    y = wp.float64(along) * t[1] + wp.float64(across) * t[0]
    return penetration, wp.vec2d(x, y)
