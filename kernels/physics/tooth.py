r"""Roller in the tooth gap of a sprocket: which seat, how deep, and along which normal.

The roller's center may not cross the gap's offset curve (Pedersen et al. 2004, eq. (5)-(8), continued past the arc).
In the gap's own frame, e the outward direction of seat j, tau = e turned by +90 degrees, q = r - s_j,
xi = q . e and eta = q . tau; the gap is symmetric, so |eta| is used and the normal mirrored back:

    seat arc  |eta| cos(b) <= -xi sin(b):  pen = |q| - Rc,                          n = -q / |q|         (5)-(8)
    flank     else, straight:              pen = |eta| sin(b) - xi cos(b) - Rc,     n = (cos(b), -sign(eta) sin(b))
    tip       where it is the smaller:     pen = R_tip + Rr - |r|,                  n = r / |r|

with b half the seating angle and Rc the clearance of the roller in its seat. Curve and normal are continuous from arc
to flank: a gap that ended where pen > 0 would pump energy into every roller that passes.

A convex flank ("iso606") is an arc of radius re tangent to the seat arc, so its offset curve has the curvature
c = 1 / (re + Rr) there. With s the straight flank's penetration and t = xi sin(b) + |eta| cos(b) the distance along it,
the roller stands off the arc's center by h with c h = (1 - c s, c t) across and along the straight flank, and

    pen = 1/c - |h| = (2 s - c (s^2 + t^2)) / (1 + c |h|),    n = h / |h|,

which loses no digits however large the flank's radius is.

xi and eta are small, some micrometers where it matters, and differences of lengths of a meter. They are taken in
float64, or on blocks at float32 without it, from the vector from the seat to the roller,

    q = (r - c) - u,    u = R (cos theta d_x - sin theta d_y, sin theta d_x + cos theta d_y),                 (a)

d the seat's direction at angle zero. R cos theta and R sin theta are kept with a high part that is a multiple of
2^-12 of a power of two above R, d with one that is a multiple of 2^-12: products and sums of these are exact in
float32, and what has low parts in it is small, so that plain float32 is off by 2^-37 of R.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, larger, load_constant, multiply_add, products, reciprocal, root
from ..number import Pair, PairVector, fused_multiply_add, leading_value, pair
from .contact import rotated_vector


@wp.func
def wrapped_seat(seat: int, teeth: int):
    """A seat's number, at most a revolution off, brought to the range from 0 to teeth - 1."""
    if seat < 0:
        seat = seat + teeth
    if seat >= teeth:
        seat = seat - teeth
    return seat


@wp.func
def nearest_seat(r: Any, cosine: Any, sine: Any, teeth: int):
    """Seat nearest by angle to `r` (from the sprocket's center) on a sprocket turned by (cosine, sine).

    Used once, as a roller comes near a sprocket; from then on `seat_step` follows it. Where there is no angle, since
    the variant is diverging, it is seat 0: whatever comes in, what goes out is a seat.
    """
    local = wp.atan2(float(r[1] * cosine - r[0] * sine), float(r[0] * cosine + r[1] * sine))
    if not (wp.abs(local) < 4.0):
        return int(0)
    return wrapped_seat(int(wp.rint(local * float(teeth) * 0.15915494309189535)), teeth)


@wp.func
def seat_step(radial: Any, lateral: Any, half_pitch_tangent: Any):
    """+1 or -1 where the neighboring seat is nearer by angle, else 0.

    `radial` = r . e and `lateral` = r . tau of the seat kept so far; `half_pitch_tangent` = tan(pi / z).
    """
    limit = half_pitch_tangent * radial
    if lateral > limit:
        return int(1)
    if lateral < -limit:
        return int(-1)
    return int(0)


@wp.func
def tipless_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] and the normal's components along e and tau in a gap whose flanks have no tips.

    Arguments as of `tooth_gap`.
    """
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
    """Penetration [m] and normal in a gap of straight flanks without tips, without branches.

    Returned with 1 where that applies to the roller, else 0. Arguments as of `tooth_gap`.
    """
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
    """Whether a roller, `penetration` deep in a gap without tips or about to touch it, is less deep in the tip."""
    if penetration > -gap.law.ahead:
        radial = gap.pitch_radius + xi
        limit = wp.max(gap.tip_reach - penetration, type(xi)(0.0))
        return products(radial, radial, lateral, lateral) > limit * limit
    return False


@wp.func
def tip_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] in a tip and the normal's components along e and tau.

    Arguments as of `tooth_gap`.
    """
    radial = gap.pitch_radius + xi
    square = products(radial, radial, lateral, lateral)
    inverse = inverse_root(square)
    return gap.tip_reach - root(square), radial * inverse, lateral * inverse


@wp.func
def tooth_gap(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] and the normal's components along e and tau, of a roller in a tooth gap.

    Args:
        xi: q . e [m], q from the seat to the roller's center.
        lateral: q . tau [m].
        gap: the sprocket's tooth gap (`structs.Sprocket`).
    """
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
    """`value` rounded to the grid of spacing `magic` / 1.5 / 2^23."""
    return (value + magic) - magic


@wp.func
def grid_product(part: Pair, radius: Pair, magic: wp.float32):
    """R times a cosine or sine, its high part on the grid that `magic` stands for (`grid_magic`) [m]."""
    high = grid_value(radius.high * part.high, magic)
    low = fused_multiply_add(radius.high, part.high, -high) + products(radius.high, part.low, radius.low, part.high)
    return pair(high, low)


@wp.func
def grid_magic(radius: wp.float32):
    """The `magic` of `grid_value` for a grid of 2^-12 of the power of two above `radius`."""
    return 3072.0 * wp.pow(2.0, wp.floor(wp.log2(radius)) + 1.0)


@wp.func
def gap_coordinates(p: wp.vec2d, direction: wp.vec2d, body: Any, sprocket: Any):
    """Where a roller is in the gap of a seat, in float64.

    Args:
        p: roller from the sprocket's center [m].
        direction: of the seat, at angle zero.
        body: where the sprocket is.
        sprocket: its teeth (`structs.Sprocket`).

    Returns:
        Direction e in which the seat is now, the roller's place along e from the center, xi and eta [m].
    """
    e = rotated_vector(direction, body.cosine, body.sine)
    radial = dot(p, e)
    return e, radial, radial - sprocket.exact_radius, products(p[1], e[0], -p[0], e[1])


@wp.func
def gap_coordinates(p: PairVector, direction: wp.vec4f, body: Any, sprocket: Any):
    """Where a roller is in the gap of a seat, from pairs, (a): e, its place along e, xi and eta [m].

    `direction` has high parts (x, y) and low parts (x, y).
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
    """The seat of a roller and its place there: its number, direction e, xi and eta [m].

    Args:
        p: roller from the sprocket's center [m].
        number: a seat at most two from the roller's.
        direction: of that seat, at angle zero.
        body: where the sprocket is.
        sprocket: its teeth (`structs.Sprocket`).
        seats: directions of the seats at angle zero.
    """
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
    """The seat of a roller in a sprocket, and the roller's place in that seat's gap.

    Args:
        p: roller from the sprocket's center [m].
        kept: its seat at the step before, of which this one is a neighbor; negative: found by angle.
        body: where the sprocket is.
        sprocket: its teeth (`structs.Sprocket`).
        seats: directions of the seats at angle zero.

    Returns:
        The seat's number, its direction e, xi and eta [m].
    """
    number = kept
    if number < 0:
        number = nearest_seat(leading_value(p), leading_value(body.cosine), leading_value(body.sine), sprocket.teeth)
    return tracked_seat_from(p, number, load_constant(seats, sprocket.first_seat + number), body, sprocket, seats)


@wp.func
def relative_tooth_velocity(omega: Any, arm: Any, v: Any):
    """Velocity [m/s] of a sprocket's point, `arm` [m] from its center, less that of a roller.

    Args:
        omega: the sprocket's angular velocity [rad/s].
        arm: [m].
        v: the roller's velocity less the center's [m/s].
    """
    return type(arm)(multiply_add(-omega, arm[1], -v[0]), multiply_add(omega, arm[0], -v[1]))


@wp.func
def tooth_contact(arm: Any, v: Any, omega: Any, e: Any, xi: Any, lateral: Any, sprocket: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller in its tooth gap, eq. (5)-(14).

    Args:
        arm: roller from the sprocket's center [m].
        v: roller's velocity relative to the center's [m/s].
        omega: sprocket's angular velocity [rad/s].
        e, xi, lateral: of the roller in its gap (`gap_coordinates`) [m].
        sprocket: its teeth (`structs.Sprocket`).
    """
    penetration, normal_radial, normal_lateral = tooth_gap(xi, lateral, sprocket)
    return penetration, rotated_vector(e, normal_radial, normal_lateral), relative_tooth_velocity(omega, arm, v)
