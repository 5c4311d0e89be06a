"""Toe of a silent chain's link on wheel teeth: its two flank ends, their penetration, normal and place.

A flank is a line between two centers of arcs of radius r, which move with the link: with m the middle between its pins,
u from the nearer of them into the link and w at right angles towards the wheel, they are at m + x u + y w. A tooth gap
has straight flanks at the distance f of the seated pin, and tips on a circle. In the seat's coordinates (`tooth`),
g the flanks' angle to e, an arc's center at (xi, eta) is

    pen = min(|eta| cos(g) - xi sin(g) - (f - r),  R_tip + r - |center|)                                          (a)

deep. The common part of flank and tooth ends at the toe's tip, and at the flank's beginning or, where this is beyond
the tooth, at the tooth's tip, which is then a point on the link's flank. Each of the two bears half the stiffness.

A force F at a place z from m acts on the pins as F/2 -+ (z x F) n / l, n = u turned by +90 degrees and l the link's
length: momentum and angular momentum are exact. The inverse mass along a unit vector N is that of a roller times

    1/2 + 2 ((z x N) / l)^2.                                                                                      (b)

A contact's closing acceleration by all else (`impact`) is that of the pins by their links now and by all contacts in
the step before, less the contact's own force then. So forces do not hang on the order in which they are worked out.
"""

from typing import Any

import warp as wp

from ..native import inverse_root, larger, products, quotient, root, smaller
from .contact import AWAY

LINK_ENDS = wp.constant(2)
"""Flank ends of a link at a pin: tip and beginning."""
ENDS = wp.constant(2 * int(LINK_ENDS))
"""Flank ends at a pin: those of the link after it, then those of the link before it."""
LINK_ANSWER = 6.0
"""G of a flank end by the others on its two pins: twice their mobilities, three times its own (`impact`)."""


@wp.func
def rotated_to_gap(radial: Any, lateral: Any, cosine: Any, sine: Any):
    """Components along e, tau of a vector, in a gap turned by the angle of (cosine, sine)."""
    return products(radial, cosine, lateral, sine), products(lateral, cosine, -radial, sine)


@wp.func
def arc_penetration(xi: Any, lateral: Any, gap: Any):
    """Penetration [m] of an arc's center in a wheel's teeth, and normal along e, tau, (a)."""
    one = type(xi)(1.0)
    side = wp.where(lateral >= type(xi)(0.0), one, -one)
    flank = products(wp.abs(lateral), gap.sin_half_seat, -xi, gap.cos_half_seat) - gap.clearance
    radial = gap.pitch_radius + xi
    square = wp.max(products(radial, radial, lateral, lateral), type(xi)(1.0e-24))
    inverse = inverse_root(square)
    tip = gap.tip_reach - root(square)
    on_flank = flank <= tip
    return (
        wp.where(on_flank, flank, tip),
        wp.where(on_flank, gap.cos_half_seat, radial * inverse),
        wp.where(on_flank, -side * gap.sin_half_seat, lateral * inverse),
    )


@wp.func
def toe_arcs(xi: Any, lateral: Any, u: Any, length: Any, after: bool, plate: Any):
    """Centers of a toe's arcs, at its tip and its flank's beginning, and its link's middle [m] (`toe_contact`)."""
    turn = wp.where(after, plate.side, -plate.side)
    half = type(xi)(0.5) * length
    middle_e, middle_t = xi + half * u[0], lateral + half * u[1]
    w_e, w_t = -turn * u[1], turn * u[0]
    tip_e = middle_e + products(plate.tip[0], u[0], plate.tip[1], w_e)
    tip_t = middle_t + products(plate.tip[0], u[1], plate.tip[1], w_t)
    begin_e = middle_e + products(plate.begin[0], u[0], plate.begin[1], w_e)
    begin_t = middle_t + products(plate.begin[0], u[1], plate.begin[1], w_t)
    return type(u)(tip_e, tip_t), type(u)(begin_e, begin_t), type(u)(middle_e, middle_t)


@wp.func
def toe_contact(xi: Any, lateral: Any, u: Any, length: Any, end: int, after: bool, plate: Any, gap: Any):
    """Penetration [m] of a flank's end in its tooth gap, normal, and the contact's place from the link's middle [m].

    Vectors have components along e, tau.

    Args:
        xi, lateral: of the pin from its seat [m].
        u: unit vector from the pin into the link.
        length: of the link [m].
        end: 0 the tip, 1 the flank's beginning.
        after: whether the link is the one after the pin.
        plate: `structs.Plate`.
        gap: `structs.Sprocket`.
    """
    one, zero = type(xi)(1.0), type(xi)(0.0)
    turn = wp.where(after, plate.side, -plate.side)
    tip, begin, middle = toe_arcs(xi, lateral, u, length, after, plate)
    tip_e, tip_t = type(xi)(tip[0]), type(xi)(tip[1])
    begin_e, begin_t = type(xi)(begin[0]), type(xi)(begin[1])
    middle_e, middle_t = type(xi)(middle[0]), type(xi)(middle[1])
    w_e, w_t = -turn * u[1], turn * u[0]
    # a toe may be in the gap beside its pin's
    t = gap.half_pitch_tangent
    reach = t * (gap.pitch_radius + tip_e)
    away = wp.where(tip_t > reach, one, wp.where(tip_t < -reach, -one, zero))
    cosine, sine = (one - t * t) / (one + t * t), away * (type(xi)(2.0) * t / (one + t * t))
    u_e, u_t = type(xi)(u[0]), type(xi)(u[1])
    if away != zero:
        radius = gap.pitch_radius
        tip_e, tip_t = rotated_to_gap(radius + tip_e, tip_t, cosine, sine)
        begin_e, begin_t = rotated_to_gap(radius + begin_e, begin_t, cosine, sine)
        middle_e, middle_t = rotated_to_gap(radius + middle_e, middle_t, cosine, sine)
        u_e, u_t = rotated_to_gap(u[0], u[1], cosine, sine)
        tip_e, begin_e, middle_e = tip_e - radius, begin_e - radius, middle_e - radius
        w_e, w_t = -turn * u_t, turn * u_e
    # places along the tooth's flank, outward from the foot of the seated pin's perpendicular
    tip_along = products(tip_e, gap.sin_half_seat, -turn * tip_t, gap.cos_half_seat)
    begin_along = products(begin_e, gap.sin_half_seat, -turn * begin_t, gap.cos_half_seat)
    at_tip = end == 0 or tip_along > gap.corner
    at_e, at_t = wp.where(at_tip, tip_e, begin_e), wp.where(at_tip, tip_t, begin_t)
    penetration, n_e, n_t = arc_penetration(at_e, at_t, gap)
    x_e, x_t = at_e - plate.radius * n_e, at_t - plate.radius * n_t
    # the tooth's tip on the link's flank
    distance = gap.clearance + plate.radius
    corner_e = products(gap.corner, gap.sin_half_seat, -distance, gap.cos_half_seat)
    corner_t = -turn * products(gap.corner, gap.cos_half_seat, distance, gap.sin_half_seat)
    m_e = products(plate.cos_flank, u_e, -plate.sin_flank, w_e)
    m_t = products(plate.cos_flank, u_t, -plate.sin_flank, w_t)
    depth = plate.radius + products(corner_e - tip_e, m_e, corner_t - tip_t, m_t)
    on_corner = not at_tip and begin_along > gap.corner
    penetration = wp.where(on_corner, depth, penetration)
    n_e, n_t = wp.where(on_corner, m_e, n_e), wp.where(on_corner, m_t, n_t)
    x_e, x_t = wp.where(on_corner, corner_e, x_e), wp.where(on_corner, corner_t, x_t)
    x_e, x_t = x_e - middle_e, x_t - middle_t
    if away != zero:
        n_e, n_t = rotated_to_gap(n_e, n_t, cosine, -sine)
        x_e, x_t = rotated_to_gap(x_e, x_t, cosine, -sine)
    return penetration, type(u)(n_e, n_t), type(u)(x_e, x_t)


@wp.func
def is_in_gap(tip: Any, gap: Any):
    """Whether a toe's tip is between the middles of the teeth beside its gap."""
    return wp.abs(tip[1]) <= gap.half_pitch_tangent * (gap.pitch_radius + tip[0])


@wp.func
def is_off_flanks(tip: Any, at: Any, ahead: Any, gap: Any):
    """Whether both of a toe's arcs, at `tip` and `at`, are in the gap and off both of its flanks by `ahead` [m]."""
    deepest = larger(
        products(wp.abs(at[1]), gap.sin_half_seat, -at[0], gap.cos_half_seat),
        products(wp.abs(tip[1]), gap.sin_half_seat, -tip[0], gap.cos_half_seat),
    )
    return is_in_gap(tip, gap) and deepest - gap.clearance <= -ahead


@wp.func
def is_open_toe(tip: Any, at: Any, gap: Any):
    """Whether both of a toe's arcs, at `tip` and `at`, are outside the teeth's tips or off both of the gap's flanks."""
    radius, reach = gap.pitch_radius, gap.tip_reach + gap.law.ahead
    nearer = smaller(
        products(radius + at[0], radius + at[0], at[1], at[1]),
        products(radius + tip[0], radius + tip[0], tip[1], tip[1]),
    )
    return nearer > reach * reach or is_off_flanks(tip, at, gap.law.ahead, gap)


@wp.func
def approach_bound(relative: Any, more: Any, turn: Any, angular: Any, reach: Any, lag: Any):
    """No less than the speed [m/s] at which a link's point nears a wheel at the forces' instant.

    Args:
        relative, more: velocity [m/s] and acceleration [m/s^2] of the wheel at the link's middle less the link's.
        turn, angular: angular velocity [rad/s] and acceleration [rad/s^2] of the wheel less the link's.
        reach: how far from the link's middle the point may be [m].
        lag: of the velocities behind the forces [s].
    """
    straight = wp.abs(relative[0]) + wp.abs(relative[1]) + lag * (wp.abs(more[0]) + wp.abs(more[1]))
    return straight + reach * (wp.abs(turn) + lag * wp.abs(angular))


@wp.func
def flank_reach(plate: Any):
    """No less than the distance [m] of a flank's points from the link's middle."""
    tip, begin = wp.abs(plate.tip[0]) + wp.abs(plate.tip[1]), wp.abs(plate.begin[0]) + wp.abs(plate.begin[1])
    return larger(tip, begin) + plate.radius


@wp.func(inline=True)
def seated_toe_contact(xi: Any, lateral: Any, u: Any, length: Any, end: int, after: bool, plate: Any, gap: Any):
    """`toe_contact` of an arc on the flank that it faces, or of an open one; 1 where it is either, else 0."""
    turn = wp.where(after, plate.side, -plate.side)
    tip, begin, middle = toe_arcs(xi, lateral, u, length, after, plate)
    at = tip
    if end != 0:
        at = begin
    zero, radius = type(xi)(0.0), gap.pitch_radius
    penetration = products(-turn * at[1], gap.sin_half_seat, -at[0], gap.cos_half_seat) - gap.clearance
    is_open = is_open_toe(tip, at, gap)
    # on the flank that it faces, below the tooth's tip
    limit = larger(gap.tip_reach - penetration, zero)
    below = products(radius + at[0], radius + at[0], at[1], at[1]) <= limit * limit
    if end != 0:
        along = larger(
            products(at[0], gap.sin_half_seat, -turn * at[1], gap.cos_half_seat),
            products(tip[0], gap.sin_half_seat, -turn * tip[1], gap.cos_half_seat),
        )
        below = below and along <= gap.corner
    on_flank = is_in_gap(tip, gap) and below and turn * at[1] <= zero
    n = type(u)(gap.cos_half_seat, turn * gap.sin_half_seat)
    z = type(u)(at[0] - middle[0] - plate.radius * n[0], at[1] - middle[1] - plate.radius * n[1])
    return wp.where(is_open, type(xi)(AWAY), penetration), n, z, wp.where(is_open or on_flank, 1, 0)


@wp.func
def link_lever(z: Any, direction: Any, length: Any):
    """(z x N) / l: what a force along `direction` N at `z` [m] from a link's middle turns with, over its length [m]."""
    return quotient(products(z[0], direction[1], -z[1], direction[0]), length)


@wp.func
def point_mobility(z: Any, direction: Any, length: Any):
    """Inverse mass of a link's place over a roller's, (b)."""
    lever = link_lever(z, direction, length)
    return type(length)(0.5) + type(length)(2.0) * lever * lever


@wp.func
def force_on_far_pin(force: Any, z: Any, u: Any, length: Any):
    """Part [N] of a force at `z` [m] from a link's middle that its far pin bears, `u` pointing there."""
    lever = link_lever(z, force, length)
    half = type(length)(0.5)
    return type(force)(half * force[0] - lever * u[1], half * force[1] + lever * u[0])
