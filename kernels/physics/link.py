r"""Link force: a spring and a damper along the line of two neighboring rollers.

With d = r_{i+1} - r_i, L = |d|, u = d / L and w = v_{i+1} - v_i (Pedersen et al. 2004, eq. (1)-(3), damping added):

    T = k (L - p) + c L',    L' = w . u,    F = T u   on roller i, -F on roller i + 1.

p is the link's own unloaded length: the pitch, or more where it is worn.
"""

from typing import Any

import warp as wp

from ..root import inverse_root, root


@wp.func
def link_force(d: Any, w: Any, length: Any, stiffness: Any, damping: Any):
    """Tension [N], rate of elongation [m/s] and direction of one link, eq. (2), (3).

    Args:
        d: vector from roller i to roller i + 1 [m].
        w: velocity of roller i + 1 relative to roller i [m/s].
        length: unloaded length p [m].
        stiffness: k [N/m].
        damping: c [N s/m].
    """
    square = wp.dot(d, d)
    u = d * inverse_root(square)
    rate = wp.dot(w, u)
    tension = stiffness * (root(square) - length) + damping * rate
    return tension, rate, u
