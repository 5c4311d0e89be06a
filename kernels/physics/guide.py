r"""Roller on a guide-bar: a flat face with rounded ends, the chain on the left of its direction of travel.

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

from ..fast_math import inside, inverse_root, root
from ..number import PairVector, cross, pair_of, pair_vector
from ..structs import Line, Pose
from .contact import turned


@wp.func
def at_face(across: Any, bar: Any):
    """Whether `across` = q . n [m] is where a roller may touch a guide-bar."""
    return across > -bar.end_radius and across < bar.roller_radius


@wp.func
def guide_gap(along: Any, across: Any, bar: Any):
    """Penetration [m] (not positive: no contact) and the normal's components along t and n, eq. (21)-(23).

    Args:
        along: q . t [m].
        across: q . n [m].
        bar: the guide-bar (`structs.Guide`).
    """
    zero = type(along)(0.0)
    penetration = zero
    normal_along = zero
    normal_across = type(along)(1.0)
    if at_face(across, bar):
        beyond = wp.min(along, zero) + wp.max(along - bar.length, zero)
        if beyond == zero:
            penetration = bar.roller_radius - across
        else:
            height = across + bar.end_radius
            square = beyond * beyond + height * height
            inverse = inverse_root(square)
            penetration = bar.roller_radius + bar.end_radius - root(square)
            normal_along = beyond * inverse
            normal_across = height * inverse
    return penetration, normal_along, normal_across


@wp.func
def line_of(bar: Any):
    """A straight guide-bar's line, in pairs."""
    x = pair_of(bar.start[0])
    y = pair_of(bar.start[1])
    along = pair_of(bar.direction[0])
    across = pair_of(bar.direction[1])
    line = Line()
    line.start = wp.vec2f(x.high, y.high)
    line.start_low = wp.vec2f(x.low, y.low)
    line.direction = wp.vec2f(along.high, across.high)
    line.direction_low = wp.vec2f(along.low, across.low)
    line.slack = 1.0e-6 * (bar.length + 2.0 * (bar.end_radius + bar.roller_radius))
    return line


@wp.func
def start_of(line: Line):
    """Start of a guide's line [m]."""
    return pair_vector(line.start, line.start_low)


@wp.func
def line_coordinates(p: wp.vec2d, t: wp.vec2d):
    """Components of `p` along the direction `t` and across it [m]."""
    return wp.dot(p, t), p[1] * t[0] - p[0] * t[1]


@wp.func
def line_coordinates(p: PairVector, t: wp.vec2f, low: wp.vec2f):
    """The same at float32, `t` + `low` the high and low parts of the direction."""
    along = wp.dot(p.high, t) + (wp.dot(p.low, t) + wp.dot(p.high, low))
    rest = (p.low[1] * t[0] + p.high[1] * low[0]) - (p.low[0] * t[1] + p.high[0] * low[1])
    return along, cross(p.high[1], p.high[0], t[1], t[0]) + rest


@wp.func
def line_coordinates(p: PairVector, line: Line):
    """The same of a point `p` from the start of a line, by float32 alone."""
    x = (p.high[0] - line.start[0]) + (p.low[0] - line.start_low[0])
    y = (p.high[1] - line.start[1]) + (p.low[1] - line.start_low[1])
    return x * line.direction[0] + y * line.direction[1], y * line.direction[0] - x * line.direction[1]


@wp.func
def near_bar(p: wp.vec2d, bar: Any):
    """1 where a roller at `p` [m] may touch a straight guide-bar, else 0."""
    along, across = line_coordinates(p - bar.start, bar.direction)
    reach = bar.end_radius + bar.roller_radius
    return inside(across, -bar.end_radius, bar.roller_radius) & inside(along, -reach, bar.length + reach)


@wp.func
def near_bar(p: PairVector, line: Line, bar: Any):
    """The same at float32, which is off by less than the line's `slack`."""
    along, across = line_coordinates(p, line)
    reach = bar.end_radius + bar.roller_radius + line.slack
    near = inside(across, -bar.end_radius - line.slack, bar.roller_radius + line.slack)
    return near & inside(along, -reach, bar.length + reach)


@wp.func
def carried(bar: Any, body: Pose):
    """A guide-bar, given in the frame of the body that carries it, where the body is now."""
    start = turned(bar.start, body.cosine, body.sine)
    bar.start = body.center + start
    bar.direction = turned(bar.direction, body.cosine, body.sine)
    return bar


@wp.func
def on_guide(p: wp.vec2d, v: Any, surface: Any, bar: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar, eq. (21)-(23).

    Args:
        p: roller from the bar's start [m].
        v: roller's velocity [m/s].
        surface: velocity of the body that carries the bar, where the roller is [m/s]; zero on the ground.
        bar: the guide-bar (`structs.Guide`).
    """
    t = bar.direction
    length = bar.length
    x, y = line_coordinates(p, t)
    penetration, normal_along, normal_across = guide_gap(type(length)(x), type(length)(y), bar)
    face = type(v)(type(length)(t[0]), type(length)(t[1]))
    return penetration, turned(face, normal_along, normal_across), surface - v


@wp.func
def on_guide(p: PairVector, v: wp.vec2f, line: Line, bar: Any):
    """The same on a guide-bar that does not move, `line` saying where it is."""
    t = line.direction
    along, across = line_coordinates(p, t, line.direction_low)
    penetration, normal_along, normal_across = guide_gap(along, across, bar)
    return penetration, turned(t, normal_along, normal_across), -v
