"""Roller on a guide: a straight bar or a curved profile, the chain on the left of its direction of travel.

With t the direction of a bar's flat face, n = (-t_y, t_x), q = r - a, Rr the roller's radius and Rg that of the bar's
ends (Pedersen et al. 2004, eq. (21)-(23), conditions A, B, C, surfaces offset by Rr):

    A  0 <= q.t <= L, -Rg < q.n < Rr:     pen = Rr - q.n,         normal n
    B  q.t < 0,  h = r - (a - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|
    C  q.t > L,  h = r - (b - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|

A profile is a row of arcs of curvature k. With u, w the roller from a piece's start, along the piece's tangent and
normal there, and g = 2 w - k (u^2 + w^2), its height over the face and the normal are

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
    """Whether a roller `across` = q . n [m] from a guide-bar may touch its face."""
    return across > -guide.end_radius and across < guide.roller_radius + guide.law.ahead


@wp.func
def guide_gap(along: Any, across: Any, guide: Any):
    """Penetration [m] of a roller on a guide-bar, and normal along t and n, eq. (21)-(23).

    `along` = q . t and `across` = q . n [m].
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
    """Components [m] of float64 point `p` along a guide's `t` and across it."""
    return dot(p, t), products(p[1], t[0], -p[0], t[1])


@wp.func
def line_coordinates(p: PairVector, t: PairVector):
    """Components [m] of point `p` in pairs along a guide's `t` and across it."""
    along = dot(p.high, t.high) + (dot(p.low, t.high) + dot(p.high, t.low))
    rest = products(p.low[1], t.high[0], p.high[1], t.low[0]) - products(p.low[0], t.high[1], p.high[0], t.low[1])
    return along, cross_product(p.high[1], p.high[0], t.high[1], t.high[0]) + rest


@wp.func
def line_coordinates(p: wp.vec2f, t: wp.vec2f):
    """Components [m] of float32 point `p` along a guide's `t` and across it."""
    return products(p[0], t[0], p[1], t[1]), products(p[1], t[0], -p[0], t[1])


@wp.func
def coarse_coordinates(p: wp.vec2d, guide: Any):
    """Coordinates [m] of float64 point `p` along a guide's chord and across it."""
    return line_coordinates(p - guide.start, guide.direction)


@wp.func
def coarse_coordinates(p: PairVector, guide: Any):
    """Coordinates [m] of point `p` in pairs along a guide's chord and across it, within `slack`."""
    return line_coordinates((p.high - guide.start.high) + (p.low - guide.start.low), leading_value(guide.direction))


@wp.func
def coarse_coordinates(p: wp.vec2f, guide: Any):
    """Coordinates [m] of float32 point `p` along a guide's chord and across it."""
    return line_coordinates(p - leading_value(guide.start), leading_value(guide.direction))


@wp.func
def is_near_bar(p: Any, guide: Any):
    """1 where a roller at `p` [m] may touch a guide-bar, else 0."""
    along, across = coarse_coordinates(p, guide)
    reach = guide.end_radius + guide.roller_radius + guide.law.ahead + guide.slack
    near = is_between(across, -guide.end_radius - guide.slack, guide.roller_radius + guide.law.ahead + guide.slack)
    return near & is_between(along, -reach, guide.length + reach)


@wp.func
def world_vector(q: wp.vec2d, body: Any):
    """Float64 vector of a guide's body turned to the world's frame."""
    return rotated_vector(q, body.cosine, body.sine)


@wp.func
def world_vector(q: PairVector, body: Any):
    """Vector in pairs of a guide's body turned to the world's frame."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine - y * body.sine, x * body.sine + y * body.cosine)


@wp.func
def carried_guide(guide: Any, body: Any):
    """Guide-bar given in its body's frame, moved to where the body is."""
    guide.start = body.center + world_vector(guide.start, body)
    guide.direction = world_vector(guide.direction, body)
    return guide


@wp.func
def bar_contact(p: Any, v: Any, surface: Any, guide: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar, eq. (21)-(23).

    `p` is the roller from the bar's start [m], `surface` the velocity of the bar's body there [m/s].
    """
    t = leading_value(guide.direction)
    length = guide.length
    along, across = line_coordinates(p, guide.direction)
    penetration, normal_along, normal_across = guide_gap(type(length)(along), type(length)(across), guide)
    face = type(v)(type(length)(t[0]), type(length)(t[1]))
    return penetration, rotated_vector(face, normal_along, normal_across), surface - v


@wp.func
def piece_height(u: Any, w: Any, curvature: Any):
    """Height [m] of a roller over a guide profile's piece, and normal along tangent and normal, (a)."""
    one = type(u)(1.0)
    g = multiply_add(-curvature, products(u, u, w, w), type(u)(2.0) * w)
    square = wp.max(multiply_add(-curvature, g, one), type(u)(1.0e-12))  # 0 in an arc's center only
    inverse = inverse_root(square)
    height = g / multiply_add(square, inverse, one)
    return height, -curvature * u * inverse, multiply_add(-curvature, w, one) * inverse


@wp.func
def frame_vector(q: Any, body: Any):
    """World vector turned into the frame of a guide's body."""
    x = component(q, 0)
    y = component(q, 1)
    return vector(x * body.cosine + y * body.sine, y * body.cosine - x * body.sine)


@wp.func
def coarse_frame_vector(arm: Any, body: Any):
    """Rounded world vector turned into a guide's body's frame, for coarse checks."""
    cosine, sine = leading_value(body.cosine), leading_value(body.sine)
    return type(arm)(products(arm[0], cosine, arm[1], sine), products(arm[1], cosine, -arm[0], sine))


@wp.func
def is_near_profile(q: Any, guide: Any):
    """1 where a roller at `q` [m] is in the box about a guide profile, else 0."""
    along, across = coarse_coordinates(q, guide)
    return is_between(along, guide.low[0], guide.high[0]) & is_between(across, guide.low[1], guide.high[1])


@wp.func
def is_ahead(p: wp.vec2d, t: wp.vec2d):
    """Whether float64 point `p` is ahead of a guide piece's start along `t`."""
    return dot(p, t) >= wp.float64(0.0)


@wp.func
def is_ahead(p: PairVector, t: PairVector):
    """Whether point `p` in pairs is ahead of a guide piece's start along `t`."""
    rest = fused_multiply_add(p.high[0], t.low[0], p.high[1] * t.low[1])
    rest = fused_multiply_add(p.low[0], t.high[0], fused_multiply_add(p.low[1], t.high[1], rest))
    return fused_multiply_add(p.high[0], t.high[0], fused_multiply_add(p.high[1], t.high[1], rest)) >= 0.0


@wp.func
def step_from_piece(q: Any, piece: Any, following: Any):
    """+1 where a roller at `q` is past a guide's piece, `following` the next, -1 before it, else 0."""
    step = wp.where(is_ahead(difference(q, piece.start), piece.direction), 0, -1)
    return wp.where(is_ahead(difference(q, following.start), following.direction), 1, step)


@wp.func
def piece_coordinates(q: Any, i: int, pieces: Any):
    """u, w [m] and curvature [1/m] of a roller over guide piece `i`, (a)."""
    piece = load_constant(pieces, i)
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    return u, w, piece.curvature


@wp.func
def piece_step(q: Any, number: int, first: int, pieces: Any):
    """+1 where a roller at `q` is past piece `number` of a guide profile, -1 before, else 0."""
    return step_from_piece(q, load_constant(pieces, first + number), load_constant(pieces, first + number + 1))


@wp.func
def nearest_piece(q: Any, count: int, first: int, pieces: Any):
    """Number of the guide profile's piece, or nearer end, under a roller at `q`."""
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
    """Number of the guide profile's piece under a roller, from the step before's, `kept`; < 0: all are searched.

    `q` [m] is in the guide's body's frame.
    """
    if kept < 0:
        return nearest_piece(q, guide.pieces, guide.first_piece, pieces)
    return wp.clamp(kept + piece_step(q, kept, guide.first_piece, pieces), 0, guide.pieces - 1)


@wp.func
def profile_contact(q: Any, number: int, guide: Any, pieces: Any):
    """Penetration [m], normal and +1, 0 or -1 of a roller on a guide profile; see `piece_contact`."""
    first = guide.first_piece + number
    penetration, facing, beyond = piece_contact(
        q, load_constant(pieces, first), load_constant(pieces, first + 1), guide
    )
    return penetration, facing, beyond


@wp.func
def piece_contact(q: Any, piece: Any, following: Any, guide: Any):
    """Penetration [m] and normal of a roller on a guide piece, and +1 past it, -1 before, or 0.

    `q` [m] and the normal are in the guide's body's frame. Penetration is negative where apart or behind the guide.
    """
    length = guide.length
    u, w = line_coordinates(difference(q, piece.start), piece.direction)
    height, along, across = piece_height(type(length)(u), type(length)(w), type(length)(piece.curvature))
    beyond = step_from_piece(q, piece, following)
    penetration = guide.roller_radius - height
    if height <= -guide.end_radius or beyond != 0:
        penetration = type(length)(AWAY)
    t = leading_value(piece.direction)
    x = products(type(u)(along), t[0], -type(u)(across), t[1])
    y = products(type(u)(along), t[1], type(u)(across), t[0])
    return penetration, type(t)(x, y), beyond
