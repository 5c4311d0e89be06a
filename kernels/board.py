"""The board: the numbers that a block's threads share, and where each stands.

Thread s writes what concerns sprocket s; lane 0 of each warp writes the warp's part of the moments.
"""

import warp as wp

COSINE = wp.constant(0)  # of the sprocket's angle
SINE = wp.constant(1)
SPEED = wp.constant(2)  # angular velocity, leapfrog: half a step behind [rad/s]
CENTER_X = wp.constant(3)  # [m]
CENTER_Y = wp.constant(4)
NEAR = wp.constant(5)  # square of the distance from the center beyond which a roller is engaged [m^2]
FAR = wp.constant(6)  # and up to which
ANGLE = wp.constant(7)  # [rad]
EXACT_SPEED = wp.constant(8)  # angular velocity of a prescribed sprocket at the step's instant [rad/s]
SUMS = wp.constant(9)  # the fields of `structs.SprocketSums`
DISPLACEMENT = wp.constant(16)  # smallest, largest, sum and sum of squares of mid-strand displacement [m]
STRIDE = wp.constant(20)
"""Numbers of one sprocket."""


def size(sprockets: int, warps: int) -> int:
    """Length of a board for that many sprockets: their numbers, then each warp's part of each sprocket's moment."""
    return sprockets * (int(STRIDE) + warps)
