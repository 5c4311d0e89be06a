"""One mass that flies into a contact and out again, for the tests of contact laws."""

import warp as wp

from warpchain.kernels.physics.contact import penalty
from warpchain.kernels.structs import types

KINDS = types(wp.float64)


@wp.kernel(enable_backward=False)
def bounce(
    law: KINDS.ContactLaw,
    mass: wp.float64,
    speed: wp.float64,
    h: wp.float64,
    out: wp.array(dtype=wp.float64),
):
    """One mass flies into a contact and out again; out = rebound speed, dissipated energy, peak energy."""
    penetration = wp.float64(0.0)
    v = speed
    penetration = h * v
    impact_speed = speed
    dissipated = wp.float64(0.0)
    peak = wp.float64(0.0)
    open = int(0)
    while open == 0:
        # midpoint rule (second order): half step, evaluate, full step
        f0, m0, d0, e0 = penalty(penetration, v, impact_speed, law)
        half_v = v - wp.float64(0.5) * h * f0 / mass
        half_pen = penetration + wp.float64(0.5) * h * v
        f1, m1, d1, e1 = penalty(half_pen, half_v, impact_speed, law)
        v = v - h * f1 / mass
        penetration = penetration + h * half_v
        dissipated = dissipated + h * d1
        peak = wp.max(peak, e1)
        if penetration <= wp.float64(0.0):
            open = int(1)
    out[0] = -v
    out[1] = dissipated
    out[2] = peak
