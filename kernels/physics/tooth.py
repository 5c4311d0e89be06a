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
"""

from typing import Any

import warp as wp

from ..root import inverse_root, larger, reciprocal, root


@wp.func
def wrapped_seat(seat: int, teeth: int):
    """The seat from 0 to teeth - 1 that `seat`, at most a revolution off, is."""
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
def endless_gap(xi: Any, lateral: Any, gap: Any):
    """As `tooth_gap`, of a gap whose flanks have no tips."""
    zero = type(xi)(0.0)
    one = type(xi)(1.0)
    eta = wp.abs(lateral)
    side = wp.where(lateral >= zero, one, -one)
    # penetration and normal, changed in place: only the lanes that take a branch pay for it
    at = wp.vector(
        eta * gap.sin_half_seat - xi * gap.cos_half_seat - gap.clearance, gap.cos_half_seat, -side * gap.sin_half_seat
    )
    if eta * gap.cos_half_seat <= -xi * gap.sin_half_seat:
        square = wp.max(xi * xi + lateral * lateral, type(xi)(1.0e-24))
        inverse = inverse_root(square)
        at[0] = root(square) - gap.clearance
        at[1] = -xi * inverse
        at[2] = -lateral * inverse
    elif gap.flank_curvature > zero:
        t = xi * gap.sin_half_seat + eta * gap.cos_half_seat
        along = gap.flank_curvature * t
        across = one - gap.flank_curvature * at[0]
        square = across * across + along * along
        inverse = inverse_root(square)
        at[0] = (at[0] * (one + across) - along * t) * reciprocal(one + root(square))
        at[1] = (across * gap.cos_half_seat + along * gap.sin_half_seat) * inverse
        at[2] = side * (along * gap.cos_half_seat - across * gap.sin_half_seat) * inverse
    return at[0], at[1], at[2]


@wp.func
def usual_gap(xi: Any, lateral: Any, gap: Any):
    """As `tooth_gap` without branches, of straight flanks and no tip; and whether the roller is there (1, else 0)."""
    zero = type(xi)(0.0)
    eta = wp.abs(lateral)
    side = wp.where(lateral >= zero, type(xi)(1.0), type(xi)(-1.0))
    in_arc = eta * gap.cos_half_seat <= -xi * gap.sin_half_seat
    square = larger(xi * xi + lateral * lateral, type(xi)(1.0e-24))
    inverse = inverse_root(square)
    penetration = wp.where(
        in_arc, root(square) - gap.clearance, eta * gap.sin_half_seat - xi * gap.cos_half_seat - gap.clearance
    )
    along = wp.where(in_arc, -xi * inverse, gap.cos_half_seat)
    across = wp.where(in_arc, -lateral * inverse, -side * gap.sin_half_seat)
    radial = gap.pitch_radius + xi
    limit = larger(gap.tip_reach - penetration, zero)
    usual = wp.where(radial * radial + lateral * lateral > limit * limit, int(penetration <= zero), 1)
    usual = wp.where(in_arc, usual, usual * int(gap.flank_curvature <= zero))
    return penetration, along, across, usual


@wp.func
def beyond_tip(penetration: Any, xi: Any, lateral: Any, gap: Any):
    """Whether a roller, `penetration` deep in a gap without tips, is less deep in the tip."""
    if penetration > type(xi)(0.0):
        radial = gap.pitch_radius + xi
        limit = wp.max(gap.tip_reach - penetration, type(xi)(0.0))
        return radial * radial + lateral * lateral > limit * limit
    return False


@wp.func
def on_tip(xi: Any, lateral: Any, gap: Any):
    """As `tooth_gap`, of a tip."""
    radial = gap.pitch_radius + xi
    square = radial * radial + lateral * lateral
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
    penetration, along, across = endless_gap(xi, lateral, gap)
    at = wp.vector(penetration, along, across)
    if beyond_tip(penetration, xi, lateral, gap):
        penetration_of_tip, along_of_tip, across_of_tip = on_tip(xi, lateral, gap)
        at[0] = penetration_of_tip
        at[1] = along_of_tip
        at[2] = across_of_tip
    return at[0], at[1], at[2]
