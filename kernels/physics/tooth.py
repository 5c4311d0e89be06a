"""Roller in the tooth gap of a sprocket: its seat, penetration and contact normal.

The roller's center may not cross the gap's offset curve (Pedersen et al. 2004, eq. (5)-(8), continued past the arc).
With e the outward direction of seat j, tau = e turned by +90 degrees, q = r - s_j, xi = q . e and eta = q . tau:

    seat arc  |eta| cos(b) <= -xi sin(b):  pen = |q| - Rc,                          n = -q / |q|         (5)-(8)
    flank     else, straight:              pen = |eta| sin(b) - xi cos(b) - Rc,     n = (cos(b), -sign(eta) sin(b))
    tip       where it is the smaller:     pen = R_tip + Rr - |r|,                  n = r / |r|

b is half the seating angle, Rc the roller's clearance in its seat. For a convex flank ("iso606") of radius re, with
c = 1 / (re + Rr), s the straight flank's penetration, t = xi sin(b) + |eta| cos(b) and c h = (1 - c s, c t),

    pen = 1/c - |h| = (2 s - c (s^2 + t^2)) / (1 + c |h|),    n = h / |h|.

At float32, d the seat's direction at angle zero, xi and eta are components of

    q = (r - c) - u,    u = R (cos theta d_x - sin theta d_y, sin theta d_x + cos theta d_y),                 (a)

within 2^-37 R, by grids on which products of high parts are exact.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, load_constant, multiply_add, products, reciprocal, root
from ..number import Pair, PairVector, fused_multiply_add, leading_value, pair
from .contact import rotated_vector


@wp.func
def wrapped_seat(seat: int, teeth: int):
    """Seat number of a sprocket, 0 to `teeth` - 1, from one at most a revolution off."""
    if seat < 0:
        seat = seat + teeth
    if seat >= teeth:
        seat = seat - teeth
    return seat


@wp.func
def nearest_seat(r: Any, cosine: Any, sine: Any, teeth: int):
    """Number of a sprocket's seat nearest by angle to `r` [m]."""
    local = wp.atan2(float(r[1] * cosine - r[0] * sine), float(r[0] * cosine + r[1] * sine))
    if not (wp.abs(local) < 4.0):
        return int(0)
    return wrapped_seat(int(wp.rint(local * float(teeth) * 0.15915494309189535)), teeth)


@wp.func
def seat_step(radial: Any, lateral: Any, half_pitch_tangent: Any):
    """+1 or -1 where a sprocket's next or last seat is nearer by angle, else 0.

    `half_pitch_tangent` is tan(pi / z).
    """
    limit = half_pitch_tangent * radial
    if lateral > limit:
        return int(1)
    if lateral < -limit:
        return int(-1)
    return int(0)


@wp.func
def tipless_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] of a roller in a tooth gap without tips, and normal along e, tau."""
    zero = type(xi)(0.0)
    one = type(xi)(1.0)
    eta = wp.abs(lateral)
    side = wp.where(lateral >= zero, one, -one)
    # penetration and normal, changed in place: only the lanes that take a branch pay for it
    at = wp.vector(
        products(eta, gap.sin_half_seat, -xi, gap.cos_half_seat) - gap.clearance,
        gap.cos_half_seat,
        -side * gap.sin_half_seat,
    )
    if eta * gap.cos_half_seat <= -xi * gap.sin_half_seat:
        square = wp.max(products(xi, xi, lateral, lateral), type(xi)(1.0e-24))
        inverse = inverse_root(square)
        at[0] = root(square) - gap.clearance
        at[1] = -xi * inverse
        at[2] = -lateral * inverse
    elif gap.flank_curvature > zero:
        t = products(xi, gap.sin_half_seat, eta, gap.cos_half_seat)
        along = gap.flank_curvature * t
        across = multiply_add(-gap.flank_curvature, at[0], one)
        square = products(across, across, along, along)
        inverse = inverse_root(square)
        at[0] = products(at[0], one + across, -along, t) * reciprocal(one + root(square))
        at[1] = products(across, gap.cos_half_seat, along, gap.sin_half_seat) * inverse
        at[2] = side * products(along, gap.cos_half_seat, -across, gap.sin_half_seat) * inverse
    return at[0], at[1], at[2]


@wp.func
def straight_flank_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] and normal along e, tau in a straight-flanked tooth gap without tips, and 1 where they hold."""
    zero = type(xi)(0.0)
    eta = wp.abs(lateral)
    side = wp.where(lateral >= zero, type(xi)(1.0), type(xi)(-1.0))
    in_arc = eta * gap.cos_half_seat <= -xi * gap.sin_half_seat
    square = larger(products(xi, xi, lateral, lateral), type(xi)(1.0e-24))
    inverse = inverse_root(square)
    penetration = wp.where(
        in_arc, root(square) - gap.clearance, products(eta, gap.sin_half_seat, -xi, gap.cos_half_seat) - gap.clearance
    )
    along = wp.where(in_arc, -xi * inverse, gap.cos_half_seat)
    across = wp.where(in_arc, -lateral * inverse, -side * gap.sin_half_seat)
    radial = gap.pitch_radius + xi
    limit = larger(gap.tip_reach - penetration, zero)
    farther = products(radial, radial, lateral, lateral) > limit * limit
    applies = wp.where(farther, int(penetration <= -gap.law.ahead), 1)
    applies = wp.where(in_arc, applies, applies * int(gap.flank_curvature <= zero))
    return penetration, along, across, applies


@wp.func
def is_beyond_tip(penetration: Any, xi: Any, lateral: Any, gap: Any):
    """Whether a roller in a tooth gap, `penetration` [m] deep, is less deep in the tip."""
    if penetration > -gap.law.ahead:
        radial = gap.pitch_radius + xi
        limit = wp.max(gap.tip_reach - penetration, type(xi)(0.0))
        return products(radial, radial, lateral, lateral) > limit * limit
    return False


@wp.func
def tip_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] of a roller in a tooth's tip, and its normal along e, tau."""
    radial = gap.pitch_radius + xi
    square = products(radial, radial, lateral, lateral)
    inverse = inverse_root(square)
    return gap.tip_reach - root(square), radial * inverse, lateral * inverse


@wp.func
def tooth_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] of a roller in a tooth gap with tips, and normal along e, tau, eq. (5)-(8)."""
    penetration, along, across = tipless_gap(xi, lateral, gap)
    at = wp.vector(penetration, along, across)
    if is_beyond_tip(penetration, xi, lateral, gap):
        penetration_of_tip, along_of_tip, across_of_tip = tip_gap(xi, lateral, gap)
        at[0] = penetration_of_tip
        at[1] = along_of_tip
        at[2] = across_of_tip
    return at[0], at[1], at[2]


@wp.func
def grid_value(value: wp.float32, magic: wp.float32):
    """Float32 on the grid of `magic`, where a tooth gap's products are exact."""
    return (value + magic) - magic


@wp.func
def grid_product(part: Pair, radius: Pair, magic: wp.float32):
    """R cos theta or R sin theta [m] of a sprocket's tooth gaps, high part on `magic`'s grid."""
    high = grid_value(radius.high * part.high, magic)
    low = fused_multiply_add(radius.high, part.high, -high) + products(radius.high, part.low, radius.low, part.high)
    return pair(high, low)


@wp.func
def grid_magic(radius: wp.float32):
    """`grid_value`'s magic number for a sprocket's pitch radius [m]: a grid of 2^-12 of the power of two above."""
    return 3072.0 * wp.pow(2.0, wp.floor(wp.log2(radius)) + 1.0)


@wp.func
def gap_coordinates(p: wp.vec2d, direction: wp.vec2d, body: Any, sprocket: Any):
    """Direction e of a tooth gap's seat, and r . e, xi, eta [m] of a roller, in float64.

    `p` is r - c [m], `direction` the seat's at angle zero.
    """
    e = rotated_vector(direction, body.cosine, body.sine)
    radial = dot(p, e)
    return e, radial, radial - sprocket.exact_radius, products(p[1], e[0], -p[0], e[1])


@wp.func
def gap_coordinates(p: PairVector, direction: wp.vec4f, body: Any, sprocket: Any):
    """Direction e of a tooth gap's seat, and r . e, xi, eta [m] of a roller, from pairs, (a).

    `direction`: the seat's at angle zero, high parts (x, y), low parts (x, y).
    """
    c = body.reach_cosine
    s = body.reach_sine
    x = direction[0] + direction[2]
    y = direction[1] + direction[3]
    to_x = products(c.high, direction[0], -s.high, direction[1])
    to_y = products(s.high, direction[0], c.high, direction[1])
    rest_x = products(c.high, direction[2], c.low, x) - products(s.high, direction[3], s.low, y)
    rest_y = products(s.high, direction[2], s.low, x) + products(c.high, direction[3], c.low, y)
    q = wp.vec2f((p.high[0] - to_x) + (p.low[0] - rest_x), (p.high[1] - to_y) + (p.low[1] - rest_y))
    e = body.inverse_radius * wp.vec2f(to_x + rest_x, to_y + rest_y)
    xi = dot(q, e)
    return e, sprocket.pitch_radius + xi, xi, products(q[1], e[0], -q[0], e[1])


@wp.func
def tracked_seat_from(p: Any, number: int, direction: Any, body: Any, sprocket: Any, seats: Any):
    """Seat of a roller in a sprocket, at most two from `number`, with direction e, xi and eta [m]."""
    e, radial, xi, lateral = gap_coordinates(p, direction, body, sprocket)
    step = seat_step(radial, lateral, type(radial)(sprocket.half_pitch_tangent))
    tries = int(2)  # a loop, which the GPU's compiler leaves where it is: most rollers have no use for it
    while step != 0 and tries > 0:
        number = wrapped_seat(number + step, sprocket.teeth)
        next_e, radial, next_xi, next_lateral = gap_coordinates(
            p, load_constant(seats, sprocket.first_seat + number), body, sprocket
        )
        e = next_e
        xi = next_xi
        lateral = next_lateral
        step = seat_step(radial, lateral, type(radial)(sprocket.half_pitch_tangent))
        tries = tries - 1
    return number, e, xi, lateral


@wp.func
def tracked_seat(p: Any, kept: int, body: Any, sprocket: Any, seats: Any):
    """Seat of a roller in a sprocket from the step before's, with direction e, xi and eta [m].

    `p` is r - c [m]; `kept` < 0: the seat is found by angle.
    """
    number = kept
    if number < 0:
        number = nearest_seat(leading_value(p), leading_value(body.cosine), leading_value(body.sine), sprocket.teeth)
    return tracked_seat_from(p, number, load_constant(seats, sprocket.first_seat + number), body, sprocket, seats)


@wp.func
def relative_tooth_velocity(omega: Any, arm: Any, v: Any):
    """Velocity [m/s] of a sprocket's tooth, `arm` [m] from its center, less a roller's."""
    return type(arm)(multiply_add(-omega, arm[1], -v[0]), multiply_add(omega, arm[0], -v[1]))


@wp.func
def tooth_contact(arm: Any, v: Any, omega: Any, e: Any, xi: Any, lateral: Any, sprocket: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller in its tooth gap, eq. (5)-(14).

    `arm` [m] and `v` [m/s] are the roller's from the sprocket's center.
    """
    penetration, normal_radial, normal_lateral = tooth_gap(xi, lateral, sprocket)
    return penetration, rotated_vector(e, normal_radial, normal_lateral), relative_tooth_velocity(omega, arm, v)
