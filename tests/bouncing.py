"""A contact by itself, and one mass that flies into it and out again, for the tests of contact laws."""

import warp as wp
from own_kernels import kernel

from warpchain.kernels.physics.contact import contact_energy, normal_force_vector
from warpchain.kernels.structs import types

KINDS = types(wp.float64)


@kernel
def bounce(
    law: KINDS.ContactLaw,
    mass: wp.float64,
    speed: wp.float64,
    h: wp.float64,
    out: wp.array[wp.float64],
):
    """One mass flies into a contact and out again; out = rebound speed, dissipated energy, peak energy."""
    penetration = wp.float64(0.0)
    v = speed
    penetration = h * v
    impact_speed = speed
    dissipated = wp.float64(0.0)
    peak = wp.float64(0.0)
    normal = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    none = wp.float64(0.0)
    open = int(0)
    while open == 0:
        # midpoint rule (second order): half step, evaluate, full step
        f0, p0, k0, s0, m0, u0 = normal_force_vector(
            penetration, normal, v * normal, wp.vec2d(), impact_speed, none, law
        )
        half_v = v - wp.float64(0.5) * h * s0 / mass
        half_pen = penetration + wp.float64(0.5) * h * v
        f1, p1, k1, s1, m1, u1 = normal_force_vector(
            half_pen, normal, half_v * normal, wp.vec2d(), impact_speed, none, law
        )
        v = v - h * s1 / mass
        penetration = penetration + h * half_v
        dissipated = dissipated + h * (s1 - k1) * half_v
        peak = wp.max(peak, contact_energy(p1, k1, law))
        if penetration <= wp.float64(0.0):
            open = int(1)
    out[0] = -v
    out[1] = dissipated
    out[2] = peak


@kernel
def leap(
    law: KINDS.ContactLaw,
    mass: wp.float64,
    pull: wp.float64,
    begin: wp.vec2d,
    h: wp.float64,
    out: wp.array[wp.vec2d],
):
    """One mass under a steady force `pull`, by leapfrog: penetration and speed after each step of h.

    `begin` has the penetration and speed that it begins with.
    """
    penetration = begin[0]
    v = begin[1]
    impact_speed = wp.float64(0.0)
    speed_before = wp.float64(0.0)
    normal = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    more = wp.vec2d(pull / mass, wp.float64(0.0))
    for i in range(out.shape[0]):
        force, mean, elastic, size, first, speed_before = normal_force_vector(
            penetration, normal, v * normal, more, impact_speed, speed_before, law
        )
        impact_speed = wp.where(mean > wp.float64(0.0), first, wp.float64(0.0))
        v = v + h * (pull - size) / mass
        penetration = penetration + h * v
        out[i] = wp.vec2d(penetration, v)


@kernel
def response(
    law: KINDS.ContactLaw,
    penetration: wp.float64,
    speed: wp.float64,
    impact_speed: wp.float64,
    out: wp.array[wp.float64],
):
    """A contact at a speed along its normal; out = length of the force, its size, damper's part."""
    normal = wp.vec2d(wp.float64(0.6), wp.float64(0.8))
    force, mean, elastic, size, first, damper_speed = normal_force_vector(
        penetration, normal, speed * normal, wp.vec2d(), impact_speed, wp.float64(0.0), law
    )
    out[0] = wp.length(force)
    out[1] = size
    out[2] = size - elastic
