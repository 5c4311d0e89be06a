"""Moments of loads and motors on single bodies, on the CPU and blocks alike."""

from typing import Any

import warp as wp

from ..physics.train import motor_moment
from ..structs import Drive


@wp.func
def body_motor_moment(time: Any, ensemble: Any, drive: Drive, number: int, body: Any, motion: Any):
    """Moment [N m] of the motor, if any, on body `number` of a drive at `time` [s]."""
    moment, shaft = type(motion.inverse_inertia)(0.0), number - drive.sprockets
    if shaft >= 0 and shaft < drive.shafts:
        motor = ensemble.motors[drive.first_shaft + shaft]
        moment = motor_moment(time, body.angle, body.speed, motor, motion, ensemble.tables)
    return moment
