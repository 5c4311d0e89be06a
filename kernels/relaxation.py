"""Settling: the static equilibrium of the rollers with all sprockets held, by dynamic relaxation with kinetic damping.

The rollers move from rest under link elasticity, elastic contact, guides and gravity; whenever their kinetic energy has
passed a peak, all velocities are set to zero. A little damping in the links keeps fast axial oscillation from
setting the peaks; it does not change the equilibrium. A restart takes half a kick: a whole one would feed the
fastest oscillations. The state is settled when no roller's net force exceeds a fraction of the largest link force
(or of a roller's weight).
"""

import warp as wp

LOOK_EVERY = wp.constant(4)  # steps between two looks at the kinetic energy


@wp.struct
class Settling:
    """One variant's relaxation: its step, tolerance, and how it stands."""

    step: wp.float64  # h [s]
    tolerance: wp.float64  # residual to reach
    steps: wp.int32  # taken so far
    limit: wp.int32  # most steps to take
    residual: wp.float64  # largest net force over the largest link force or weight
    energy: wp.float64  # kinetic energy at the last look [J]
    settled: wp.int32
