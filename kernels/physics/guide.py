r"""Roller on a guide-bar: a flat face with rounded ends, the chain on the left of its direction of travel.

With t the face's direction, n = (-t_y, t_x), q = r - a and Rr the roller's radius (Pedersen et al. 2004, eq. (21)-(23),
conditions A, B, C, all surfaces offset by the roller's radius):

    A  0 <= q.t <= L, -Rg < q.n < Rr:     pen = Rr - q.n,         normal n
    B  q.t < 0,  h = r - (a - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|
    C  q.t > L,  h = r - (b - Rg n), h.n > 0:  pen = Rr + Rg - |h|,  normal h / |h|
"""

from typing import Any

import warp as wp

from ..root import inverse_root, root


@wp.func
def at_face(across: Any, bar: Any):
    """Whether a roller may touch a guide-bar as far as `across` = q . n [m] tells."""
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
