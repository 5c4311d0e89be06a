"""The board: the numbers that a block's threads share, and where each stands.

Thread s writes what concerns sprocket s; lane 0 of each warp writes the warp's part of the moments. Where a roller
meets a sprocket's band is tested in the kernel's own precision, on a board of its own, the slate.
"""

import warp as wp

COSINE = wp.constant(0)  # of the sprocket's angle
SINE = wp.constant(1)
SPEED = wp.constant(2)  # angular velocity, leapfrog: half a step behind [rad/s]
CENTER_X = wp.constant(3)  # [m]
CENTER_Y = wp.constant(4)
ANGLE = wp.constant(5)  # [rad]
EXACT_SPEED = wp.constant(6)  # angular velocity of a prescribed sprocket at the step's instant [rad/s]
TARGET = wp.constant(7)  # prescribed: angle at the step's end [rad]; free: load moment [N m]
NEXT_SPEED = wp.constant(8)  # of a prescribed sprocket at the step's end [rad/s]
SUMS = wp.constant(9)  # the fields of `structs.SprocketSums`
DISPLACEMENT = wp.constant(16)  # smallest, largest, sum and sum of squares of mid-strand displacement [m]
STRIDE = wp.constant(20)
"""Numbers of one sprocket on the board; then each warp's part of each sprocket's moment."""

SLATE_X = wp.constant(0)  # center [m]
SLATE_Y = wp.constant(1)
NEAR = wp.constant(2)  # square of the distance from the center beyond which a roller is engaged [m^2]
FAR = wp.constant(3)  # and up to which
SLATE_STRIDE = wp.constant(4)
