"""Back of a silent chain's link on a guide: a crown between the rollers of the pins.

The back is an arc of radius R_c = 25 p whose top t, in mid-link, is as high over the pins' line as their rollers, o. So
it touches wherever the link leans, and at the pins, where it is p / 200 lower, their rollers have taken over before its
contact ends. With h and n_t the height and the guide's normal at t, w towards the wheels, a the angle from n_t to w and
k the curvature of the guide (positive: concave), e = 1 - k h,

    q = 2 e R_c (1 - cos a),    s = sqrt((e - k R_c)^2 + k q),    pen = q / (e - k R_c + s) - h,                  (a)
    n = (e n_t - k R_c w) / s,    z = R_c (w - n) - o w,    |z . u| <= l / 2,                                     (b)

z the place of the contact from the middle between the pins, u along the link and l its length. Where k R_c > e the
guide is hollower than the crown, and the pins alone touch. A link pressed by N in the middle of a guide's arc of radius
R stands with its pins

    sqrt((R + o - N / K)^2 + l^2 / 4),  about  R + o - N / K + l^2 / (8 (R + o)),                                 (c)

from the arc's center. Forces act as those on toes (`toe`).
"""

from typing import Any

import warp as wp

from ..native import larger, load_constant, multiply_add, products, root
from ..number import difference, leading_value
from .contact import AWAY, rotated_components, rotated_vector
from .guide import line_coordinates, piece_height, step_from_piece

ROW_MARGIN = 0.05
"""Length over R_c, above a pitch, by which a guide's row of backs is wider than it, so that pins of links are near."""
BACK_ANSWER = 1.0
"""G of a back by those of the two links beside it: twice a quarter of a roller's mobility each (`impact`)."""


@wp.func
def back_count(points: int, guides: int):
    """Number of rows of a chain's guides that backs touch, before as many that its rollers do."""
    return wp.where(points > 1, guides // 2, 0)


@wp.func
def back_guide(guide: Any):
    """A guide's row of backs as narrow as the guide itself."""
    margin = type(guide.back_radius)(ROW_MARGIN) * guide.back_radius
    guide.end_radius = guide.end_radius - margin
    guide.roller_radius = guide.roller_radius - margin
    return guide


@wp.func
def wheelward_components(x: Any, y: Any, side: Any):
    """Components of w of a link along the unit vector (x, y); `side` as of `structs.Plate`."""
    return -side * y, side * x


@wp.func
def wheelward_normal(u: Any, side: Any):
    """w of a link along unit vector u; `side` as of `structs.Plate`."""
    x, y = wheelward_components(u[0], u[1], side)
    return type(u)(x, y)


@wp.func
def crown_gap(height: Any, facing: Any, w: Any, curvature: Any, radius: Any):
    """Penetration [m] and normal of a crown of `radius` R_c on a guide of a curvature, (a), (b).

    `height` h and normal `facing` n_t are those of the guide at the crown's top.
    """
    one, zero = type(height)(1.0), type(height)(0.0)
    cosine, sine = products(facing[0], w[0], facing[1], w[1]), products(facing[0], w[1], -facing[1], w[0])
    e, bend = multiply_add(-curvature, height, one), curvature * radius
    q = type(height)(2.0) * e * radius * sine * sine / (one + larger(cosine, zero))
    s = root(larger(multiply_add(curvature, q, (e - bend) * (e - bend)), type(height)(1.0e-12)))
    is_facing = cosine > zero and e > bend
    penetration = wp.where(is_facing, q / (larger(e - bend, zero) + s) - height, type(height)(AWAY))
    return penetration, type(w)((e * facing[0] - bend * w[0]) / s, (e * facing[1] - bend * w[1]) / s)


@wp.func
def crown_over_bar(p: Any, w: Any, guide: Any):
    """Height [m], normal and curvature [1/m] of a guide-bar at a crown's top, and whether the bar is under it.

    `p` is the top from the bar's start [m].
    """
    length, radius, zero = guide.length, guide.back_radius, type(guide.length)(0.0)
    t = leading_value(guide.direction)
    face = type(w)(type(length)(t[0]), type(length)(t[1]))
    x, y = line_coordinates(p, guide.direction)
    along, height, curvature = type(length)(x), type(length)(y), zero
    center = multiply_add(radius, products(w[0], face[0], w[1], face[1]), along)  # of the crown
    facing = type(w)(zero, type(length)(1.0))
    if center < zero or center > length:
        beyond, above = along - wp.where(center < zero, zero, length), height + guide.end_radius
        distance = root(larger(products(beyond, beyond, above, above), type(length)(1.0e-24)))
        facing = type(w)(beyond / distance, above / distance)
        height = distance - guide.end_radius
        curvature = type(length)(-1.0) / guide.end_radius
    return height, rotated_vector(face, facing[0], facing[1]), curvature, type(length)(y) > -guide.end_radius


@wp.func
def crown_bar_contact(p: Any, w: Any, guide: Any):
    """Penetration [m] and normal of a crown on a guide-bar; `p` is its top from the bar's start [m]."""
    height, facing, curvature, is_over = crown_over_bar(p, w, guide)
    penetration, normal = crown_gap(height, facing, w, curvature, guide.back_radius)
    return wp.where(is_over, penetration, type(guide.length)(AWAY)), normal


@wp.func
def crown_over_piece(q: Any, center: Any, piece: Any, following: Any, guide: Any):
    """Height [m], two of the normal and curvature [1/m] of a guide's piece at a crown's top, and whether it is there.

    All is in the frame of the guide's body; `q` is the crown's top and `center` its center [m].
    """
    length = guide.length
    x, y = line_coordinates(difference(q, piece.start), piece.direction)
    bend = type(length)(piece.curvature)
    height, along, across = piece_height(type(length)(x), type(length)(y), bend)
    t = leading_value(piece.direction)
    facing_x, facing_y = rotated_components(type(length)(t[0]), type(length)(t[1]), along, across)
    is_over = step_from_piece(center, piece, following) == 0 and height > -guide.end_radius
    return height, facing_x, facing_y, bend, is_over


@wp.func
def crown_piece_contact(q: Any, center: Any, w: Any, number: int, guide: Any, pieces: Any):
    """Penetration [m] and normal of a crown on a guide's piece, `AWAY` where its `center` [m] is beyond that.

    All is in the frame of the guide's body; `q` is the crown's top [m].
    """
    first = guide.first_piece + number
    piece, following = load_constant(pieces, first), load_constant(pieces, first + 1)
    height, x, y, curvature, is_over = crown_over_piece(q, center, piece, following, guide)
    penetration, normal = crown_gap(height, type(w)(x, y), w, curvature, guide.back_radius)
    return wp.where(is_over, penetration, type(guide.length)(AWAY)), normal


@wp.func
def back_contact(penetration: Any, normal: Any, u: Any, w: Any, length: Any, guide: Any):
    """Penetration [m] of a link's back, `AWAY` where the guide is not under it, and its place z [m], (b)."""
    radius, o = guide.back_radius, guide.roller_radius
    z = type(u)(radius * (w[0] - normal[0]) - o * w[0], radius * (w[1] - normal[1]) - o * w[1])
    is_under = wp.abs(products(z[0], u[0], z[1], u[1])) <= type(length)(0.5) * length
    return wp.where(is_under, penetration, type(length)(AWAY)), z
