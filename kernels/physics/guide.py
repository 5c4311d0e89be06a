"""Roller on a guide: a straight bar or a profile, the chain on the left of its direction of travel.

A bar has a flat face with rounded ends.

With t the face's direction, n = (-t_y, t_x), q = r - a and Rr the roller's radius (Pedersen et al. 2004, eq. (21)-(23),
conditions A, B, C, all surfaces offset by the roller's radius):

    A  0 <= q.t <= L, -Rg < q.n < Rr:     pen = Rr - q.n,         normal n
    B  q.t < 0,  h = r - (a - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|
    C  q.t > L,  h = r - (b - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|

q.t and q.n are taken in float64, or on blocks at float32 from pairs: q.n = q_y t_x - q_x t_y is a difference of
products of some meters (`number.cross_product`).

A profile is a row of pieces, arcs of curvature k or straight. With u, w the roller's center from a piece's start, along
the piece's tangent and normal there, and g = 2 w - k (u^2 + w^2), its height over the face and the normal are

    h = g / (1 + sqrt(1 - k g)),    n = (-k u, 1 - k w) / sqrt(1 - k g).                                          (a)
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, is_between, load_constant, multiply_add, products, root
from ..number import (  # noqa: F401
    PairVector,
    add,
    component,
    cross_product,
    difference,
    fused_multiply_add,
    leading_value,
    mul,
    sub,
    vector,
)
from .contact import AWAY, rotated_vector


@wp.func
def is_at_face(across: Any, guide: Any):
    """Whether a roller `across` = q . n [m] from a guide-bar's line may touch its face."""
    return across > -guide.end_radius and across < guide.roller_radius + guide.law.ahead


@wp.func
def guide_gap(along: Any, across: Any, guide: Any):
    """Penetration [m] (negative: no contact) and the normal's components along t and n, eq. (21)-(23).

    Args:
        along: q . t [m].
        across: q . n [m].
        guide: the guide-bar (`structs.Guide`).
    """
    zero = type(along)(0.0)
    penetration = type(along)(AWAY)
    normal_along = zero
    normal_across = type(along)(1.0)
    if is_at_face(across, guide):
        beyond = wp.min(along, zero) + wp.max(along - guide.length, zero)
        if beyond == zero:
            penetration = guide.roller_radius - across
        else:
            height = across + guide.end_radius
            square = products(beyond, beyond, height, height)
            inverse = inverse_root(square)
            penetration = guide.roller_radius + guide.end_radius - root(square)
            normal_along = beyond * inverse
            normal_across = height * inverse
    return penetration, normal_along, normal_across


@wp.func
def line_coordinates(p: wp.vec2d, t: wp.vec2d):
    """Components of `p` along the direction `t` and across it [m], in float64."""
    return dot(p, t), products(p[1], t[0], -p[0], t[1])


@wp.func
def line_coordinates(p: PairVector, t: PairVector):
    """Components of `p` along the direction `t` and across it [m], of pairs as float32."""
    along = dot(p.high, t.high) + (dot(p.low, t.high) + dot(p.high, t.low))
    rest = products(p.low[1], t.high[0], p.high[1], t.low[0]) - products(p.low[0], t.high[1], p.high[0], t.low[1])
    return along, cross_product(p.high[1], p.high[0], t.high[1], t.high[0]) + rest


@wp.func
def line_coordinates(p: wp.vec2f, t: wp.vec2f):
    """Components of `p` along the direction `t` and across it [m], of rounded numbers."""
    return products(p[0], t[0], p[1], t[1]), products(p[1], t[0], -p[0], t[1])


@wp.func
def coarse_coordinates(p: wp.vec2d, guide: Any):
    """Where `p` is along a guide's bar or chord and across it [m], in float64."""
    return line_coordinates(p - guide.start, guide.direction)


@wp.func
def coarse_coordinates(p: PairVector, guide: Any):
    """Where `p`, in pairs, is along a guide's bar or chord and across it [m], within the guide's `slack`."""
    return line_coordinates((p.high - guide.start.high) + (p.low - guide.start.low), leading_value(guide.direction))


@wp.func
def coarse_coordinates(p: wp.vec2f, guide: Any):
    """Where `p`, rounded to float32, is along a guide's bar or chord and across it [m]."""
    return line_coordinates(p - leading_value(guide.start), leading_value(guide.direction))


@wp.func
def is_near_bar(p: Any, guide: Any):
    """1 where a roller at `p` [m] may touch a straight guide-bar, else 0."""
    along, across = coarse_coordinates(p, guide)
    reach = guide.end_radius + guide.roller_radius + guide.law.ahead + guide.slack
    near = is_between(across, -guide.end_radius - guide.slack, guide.roller_radius + guide.law.ahead + guide.slack)
    return near & is_between(along, -reach, guide.length + reach)


@wp.func
def world_vector(q: wp.vec2d, body: Any):
    """A float64 vector of a body's own frame, turned as the body is."""
    return rotated_vector(q, body.cosine, body.sine)


@wp.func
def world_vector(q: PairVector, body: Any):
    """A vector in pairs of a body's own frame, turned as the body is."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine - y * body.sine, x * body.sine + y * body.cosine)


@wp.func
def carried_guide(guide: Any, body: Any):
    """A guide-bar, given in the frame of the body that carries it, where that body is now."""
    guide.start = body.center + world_vector(guide.start, body)
    guide.direction = world_vector(guide.direction, body)
    return guide


@wp.func
def bar_contact(p: Any, v: Any, surface: Any, guide: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar, eq. (21)-(23).

    Args:
        p: roller from the bar's start [m].
        v: roller's velocity [m/s].
        surface: velocity of the body that carries the bar, where the roller is [m/s]; zero on the ground.
        guide: the guide-bar (`structs.Guide`).
    """
    t = leading_value(guide.direction)
    length = guide.length
    along, across = line_coordinates(p, guide.direction)
    penetration, normal_along, normal_across = guide_gap(type(length)(along), type(length)(across), guide)
    face = type(v)(type(length)(t[0]), type(length)(t[1]))
    return penetration, rotated_vector(face, normal_along, normal_across), surface - v


@wp.func
def piece_height(u: Any, w: Any, curvature: Any):
    """Height over a piece's face [m] and the normal's components along its tangent and normal, (a).

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
def frame_vector(q: Any, body: Any):
    """A vector turned into a body's own frame."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine + y * body.sine, y * body.cosine - x * body.sine)


@wp.func
def coarse_frame_vector(arm: Any, body: Any):
    """A rounded vector turned into a body's own frame, exact enough to see whether a roller is near."""
    cosine, sine = leading_value(body.cosine), leading_value(body.sine)
    return type(arm)(products(arm[0], cosine, arm[1], sine), products(arm[1], cosine, -arm[0], sine))


@wp.func
def is_near_profile(q: Any, guide: Any):
    """1 where a roller at `q`, in the frame of the guide's body [m], is in the box about the guide's chord, else 0."""
    along, across = coarse_coordinates(q, guide)
    return is_between(along, guide.low[0], guide.high[0]) & is_between(across, guide.low[1], guide.high[1])


@wp.func
def is_ahead(p: wp.vec2d, t: wp.vec2d):
    """Whether a float64 point `p` is ahead of the line through the origin across the direction `t`."""
    return dot(p, t) >= wp.float64(0.0)


@wp.func
def is_ahead(p: PairVector, t: PairVector):
    """Whether a point `p` in pairs is ahead of the line through the origin across the direction `t`."""
    rest = fused_multiply_add(p.high[0], t.low[0], p.high[1] * t.low[1])
    rest = fused_multiply_add(p.low[0], t.high[0], fused_multiply_add(p.low[1], t.high[1], rest))
    return fused_multiply_add(p.high[0], t.high[0], fused_multiply_add(p.high[1], t.high[1], rest)) >= 0.0


@wp.func
def is_past_piece(q: Any, i: int, pieces: Any):
    """Whether a roller at `q`, in the frame of the guide's body [m], is past the start of piece `i` of all."""
    piece = load_constant(pieces, i)
    return is_ahead(difference(q, piece.start), piece.direction)


@wp.func
def piece_coordinates(q: Any, i: int, pieces: Any):
    """u, w [m] and curvature [1/m] of a roller at `q` over piece `i` of all, see (a)."""
    piece = load_constant(pieces, i)
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    return u, w, piece.curvature


@wp.func
def piece_step(q: Any, number: int, first: int, pieces: Any):
    """+1 where a roller at `q` is past piece `number` of a profile whose first is `first`, -1 before it, else 0."""
    step = wp.where(is_past_piece(q, first + number, pieces), 0, -1)
    return wp.where(is_past_piece(q, first + number + 1, pieces), 1, step)


@wp.func
def nearest_piece(q: Any, count: int, first: int, pieces: Any):
    """The piece of a profile that a roller at `q` is over, of the nearest face; over none, that of the nearer end."""
    begun = wp.length(leading_value(difference(q, load_constant(pieces, first).start)))
    ending = wp.length(leading_value(difference(q, load_constant(pieces, first + count).start)))
    nearest = wp.where(begun < ending, 0, count - 1)
    least = type(begun)(1.0e38)
    for number in range(count):
        if piece_step(q, number, first, pieces) == 0:
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
    return wp.clamp(kept + piece_step(q, kept, guide.first_piece, pieces), 0, guide.pieces - 1)


@wp.func
def profile_contact(q: Any, number: int, guide: Any, pieces: Any):
    """Penetration, normal and position of a roller over piece `number` of a guide's profile, as `piece_contact`
    returns.

    Args:
        q: in the frame of the guide's body [m].
        number: of the piece.
        guide: `structs.Guide`, its `first_piece` counted among all.
        pieces: of all.
    """
    first = guide.first_piece + number
    penetration, facing, beyond = piece_contact(
        q, load_constant(pieces, first), load_constant(pieces, first + 1), guide
    )
    return penetration, facing, beyond


@wp.func
def piece_contact(q: Any, piece: Any, following: Any, guide: Any):
    """Penetration [m] and normal, in the frame of the guide's body, of a roller on a piece of a profile.

    Returned with +1 where the roller is past the piece, -1 where it is before it, else 0. The penetration is negative
    where they do not touch, and where the roller is behind the guide.

    Args:
        q: in that frame [m].
        piece, following: of the profile (`structs.Piece`).
        guide: `structs.Guide`; the penetration has the type of its lengths.
    """
    length = guide.length
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    height, along, across = piece_height(type(length)(u), type(length)(w), type(length)(piece.curvature))
    beyond = wp.where(is_ahead(difference(q, piece.start), piece.direction), 0, -1)
    beyond = wp.where(is_ahead(difference(q, following.start), following.direction), 1, beyond)
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or beyond != 0:
        penetration = type(length)(AWAY)
    t = leading_value(piece.direction)
    x = products(type(u)(along), t[0], -type(u)(across), t[1])
    y = products(type(u)(along), t[1], type(u)(across), t[0])
    return penetration, type(t)(x, y), beyond
