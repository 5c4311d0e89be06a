"""Roller on a guide-bar: a flat face with rounded ends, the chain on the left of its direction of travel.

With t the face's direction, n = (-t_y, t_x), q = r - a and Rr the roller's radius (Pedersen et al. 2004, eq. (21)-(23),
conditions A, B, C, all surfaces offset by the roller's radius):

    A  0 <= q.t <= L, -Rg < q.n < Rr:     pen = Rr - q.n,         normal n
    B  q.t < 0,  h = r - (a - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|
    C  q.t > L,  h = r - (b - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|

q.t and q.n are taken in float64, or on blocks at float32 from pairs: q.n = q_y t_x - q_x t_y is a difference of
products of some meters (`number.cross`).
"""

from typing import Any

import warp as wp

from ..native import dot, inside, inverse_root, load_constant, multiply_add, products, root
from ..number import PairVector, add, component, cross, difference, fused, leading, mul, sub, vector  # noqa: F401
from .contact import AWAY, turned


@wp.func
def at_face(across: Any, bar: Any):
    """Whether `across` = q . n [m] is where a roller may touch a guide-bar."""
    return across > -bar.end_radius and across < bar.roller_radius + bar.law.ahead


@wp.func
def guide_gap(along: Any, across: Any, bar: Any):
    """Penetration [m] (negative: no contact) and the normal's components along t and n, eq. (21)-(23).

    Args:
        along: q . t [m].
        across: q . n [m].
        bar: the guide-bar (`structs.Guide`).
    """
    zero = type(along)(0.0)
    penetration = type(along)(AWAY)
    normal_along = zero
    normal_across = type(along)(1.0)
    if at_face(across, bar):
        beyond = wp.min(along, zero) + wp.max(along - bar.length, zero)
        if beyond == zero:
            penetration = bar.roller_radius - across
        else:
            height = across + bar.end_radius
            square = products(beyond, beyond, height, height)
            inverse = inverse_root(square)
            penetration = bar.roller_radius + bar.end_radius - root(square)
            normal_along = beyond * inverse
            normal_across = height * inverse
    return penetration, normal_along, normal_across


@wp.func
def line_coordinates(p: wp.vec2d, t: wp.vec2d):
    """Components of `p` along the direction `t` and across it [m]."""
    return dot(p, t), products(p[1], t[0], -p[0], t[1])


@wp.func
def line_coordinates(p: PairVector, t: PairVector):
    """The same at float32."""
    along = dot(p.high, t.high) + (dot(p.low, t.high) + dot(p.high, t.low))
    rest = products(p.low[1], t.high[0], p.high[1], t.low[0]) - products(p.low[0], t.high[1], p.high[0], t.low[1])
    return along, cross(p.high[1], p.high[0], t.high[1], t.high[0]) + rest


@wp.func
def line_coordinates(p: wp.vec2f, t: wp.vec2f):
    """The same of rounded numbers."""
    return products(p[0], t[0], p[1], t[1]), products(p[1], t[0], -p[0], t[1])


@wp.func
def near_coordinates(p: wp.vec2d, bar: Any):
    """Where `p` is along a bar, or a profile's chord, and across it [m]."""
    return line_coordinates(p - bar.start, bar.direction)


@wp.func
def near_coordinates(p: PairVector, bar: Any):
    """The same by float32 alone, which is off by less than the bar's `slack`."""
    return line_coordinates((p.high - bar.start.high) + (p.low - bar.start.low), leading(bar.direction))


@wp.func
def near_coordinates(p: wp.vec2f, bar: Any):
    """The same of a place that is rounded already."""
    return line_coordinates(p - leading(bar.start), leading(bar.direction))


@wp.func
def near_bar(p: Any, bar: Any):
    """1 where a roller at `p` [m] may touch a straight guide-bar, else 0."""
    along, across = near_coordinates(p, bar)
    reach = bar.end_radius + bar.roller_radius + bar.law.ahead + bar.slack
    near = inside(across, -bar.end_radius - bar.slack, bar.roller_radius + bar.law.ahead + bar.slack)
    return near & inside(along, -reach, bar.length + reach)


@wp.func
def from_frame(q: wp.vec2d, body: Any):
    """`q`, in a body's own frame, turned as the body is [m]."""
    return turned(q, body.cosine, body.sine)


@wp.func
def from_frame(q: PairVector, body: Any):
    """The same in pairs."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine - y * body.sine, x * body.sine + y * body.cosine)


@wp.func
def carried(bar: Any, body: Any):
    """A guide-bar, given in the frame of the body that carries it, where the body is now."""
    bar.start = body.center + from_frame(bar.start, body)
    bar.direction = from_frame(bar.direction, body)
    return bar


@wp.func
def on_guide(p: Any, v: Any, surface: Any, bar: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar, eq. (21)-(23).

    Args:
        p: roller from the bar's start [m].
        v: roller's velocity [m/s].
        surface: velocity of the body that carries the bar, where the roller is [m/s]; zero on the ground.
        bar: the guide-bar (`structs.Guide`).
    """
    t = leading(bar.direction)
    length = bar.length
    along, across = line_coordinates(p, bar.direction)
    penetration, normal_along, normal_across = guide_gap(type(length)(along), type(length)(across), bar)
    face = type(v)(type(length)(t[0]), type(length)(t[1]))
    return penetration, turned(face, normal_along, normal_across), surface - v


@wp.func
def piece_height(u: Any, w: Any, curvature: Any):
    """Height over a piece's face [m] and the normal's components along its tangent and normal, (a) and (b).

    Args:
        u, w: the roller's center from the piece's start, along its tangent and normal [m].
        curvature: k [1/m].
    """
    one = type(u)(1.0)
    g = multiply_add(-curvature, products(u, u, w, w), type(u)(2.0) * w)
    square = wp.max(multiply_add(-curvature, g, one), type(u)(1.0e-12))  # 0 in an arc's center only
    inverse = inverse_root(square)
    height = g / multiply_add(square, inverse, one)
    return height, -curvature * u * inverse, multiply_add(-curvature, w, one) * inverse


@wp.func
def in_frame(q: Any, body: Any):
    """`q`, from a body's center, in that body's own frame [m]."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine + y * body.sine, y * body.cosine - x * body.sine)


@wp.func
def near_frame(arm: Any, body: Any):
    """As `in_frame`, at float32 of rounded numbers, which suffice to see whether a roller is near."""
    cosine, sine = leading(body.cosine), leading(body.sine)
    return type(arm)(products(arm[0], cosine, arm[1], sine), products(arm[1], cosine, -arm[0], sine))


@wp.func
def near_profile(q: Any, guide: Any):
    """1 where a roller at `q`, in the frame of the guide's body, is in the box about the guide's chord, else 0."""
    along, across = near_coordinates(q, guide)
    return inside(along, guide.low[0], guide.high[0]) & inside(across, guide.low[1], guide.high[1])


@wp.func
def ahead_of(p: wp.vec2d, t: wp.vec2d):
    """Whether a point has come past where a direction `t` begins."""
    return dot(p, t) >= wp.float64(0.0)


@wp.func
def ahead_of(p: PairVector, t: PairVector):
    """The same in pairs."""
    rest = fused(p.high[0], t.low[0], p.high[1] * t.low[1])
    rest = fused(p.low[0], t.high[0], fused(p.low[1], t.high[1], rest))
    return fused(p.high[0], t.high[0], fused(p.high[1], t.high[1], rest)) >= 0.0


@wp.func
def is_past(q: Any, i: int, pieces: Any):
    """Whether a roller is past the start of piece `i` of all."""
    piece = load_constant(pieces, i)
    return ahead_of(difference(q, piece.start), piece.direction)


@wp.func
def piece_coordinates(q: Any, i: int, pieces: Any):
    """u, w [m] and curvature [1/m] of a roller over piece `i` of all, see (a)."""
    piece = load_constant(pieces, i)
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    return u, w, piece.curvature


@wp.func
def piece_beyond(q: Any, number: int, first: int, pieces: Any):
    """+1 where a roller is past piece `number` of a profile whose first is `first`, -1 where it is before, else 0."""
    step = wp.where(is_past(q, first + number, pieces), 0, -1)
    return wp.where(is_past(q, first + number + 1, pieces), 1, step)


@wp.func
def nearest_piece(q: Any, count: int, first: int, pieces: Any):
    """The piece of a profile that a roller is over, the one whose face is nearest; if over none, the nearer end's."""
    begun = wp.length(leading(difference(q, load_constant(pieces, first).start)))
    ending = wp.length(leading(difference(q, load_constant(pieces, first + count).start)))
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
    """As `on_piece`, of piece `number` of a guide's profile.

    Args:
        q: in the frame of the guide's body [m].
        number: of the piece.
        guide: `structs.Guide`, its `first_piece` counted among all.
        pieces: of all.
    """
    first = guide.first_piece + number
    penetration, facing, beyond = on_piece(q, load_constant(pieces, first), load_constant(pieces, first + 1), guide)
    return penetration, facing, beyond


@wp.func
def on_piece(q: Any, piece: Any, following: Any, guide: Any):
    """Penetration [m] of a roller on a piece of a guide's profile and the normal, in the frame of the guide's body; and
    +1 where the roller is past the piece, -1 where it is before, else 0.

    The penetration is negative where they do not touch, and where the roller is behind the guide.

    Args:
        q: in that frame [m].
        piece, following: of the profile (`structs.Piece`).
        guide: `structs.Guide`; the penetration has the type of its lengths.
    """
    length = guide.length
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    height, along, across = piece_height(type(length)(u), type(length)(w), type(length)(piece.curvature))
    beyond = wp.where(ahead_of(difference(q, piece.start), piece.direction), 0, -1)
    beyond = wp.where(ahead_of(difference(q, following.start), following.direction), 1, beyond)
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or beyond != 0:
        penetration = type(length)(AWAY)
    t = leading(piece.direction)
    x = products(type(u)(along), t[0], -type(u)(across), t[1])
    y = products(type(u)(along), t[1], type(u)(across), t[0])
    return penetration, type(t)(x, y), beyond
