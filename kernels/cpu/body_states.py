"""Bodies of one variant on the CPU at the forces' instant."""

from typing import Any

import warp as wp

from ..physics.body import body_at_time, has_finite_rotation, is_in_box
from ..physics.motion import prescribed_acceleration, prescribed_rotation
from ..structs import Drive


@wp.func
def arm_of(drive: Drive, b: int):
    """Number among arms of body `b` of all; -1 for others."""
    place = b - drive.first_body - (drive.bodies - drive.arms)
    return wp.where(place >= 0, drive.first_arm + place, -1)


@wp.func
def leapfrog_interval(drive: Drive, time: wp.float64):
    """Leapfrog's step [s] to the speeds of `time` [s]; 0 where speeds are the instant's."""
    return wp.where(drive.integrator == 0 and time > wp.float64(0.0), drive.step, wp.float64(0.0))


@wp.func
def body_now(ensemble: Any, state: Any, b: int, time: wp.float64, lag: wp.float64):
    """State of body `b` of all with rates at `time` [s], `lag` after their instant.

    Needs accelerations.
    """
    motion = ensemble.motions[b]
    driven = wp.float64(0.0)
    if motion.prescribed == 1:
        angle, driven = prescribed_rotation(time, motion, ensemble)
    body, rates, mount = state.bodies[b], state.rates[b], ensemble.mounts[b]
    return body_at_time(time, lag, body, rates, driven, motion, mount, ensemble)


@wp.func
def angular_acceleration_now(ensemble: Any, state: Any, b: int, time: wp.float64):
    """Angular acceleration [rad/s^2] of body `b` of all at `time` [s], once accelerations are found."""
    angular = state.rates[b][2]
    if ensemble.motions[b].prescribed == 1:
        angular = prescribed_acceleration(time, ensemble.motions[b], ensemble)
    return angular


@wp.func
def has_sound_bodies(state: Any, drive: Drive):
    """1 while all bodies' rotations are finite and centers in the drive's box, else 0."""
    good = int(1)
    for b in range(drive.first_body, drive.first_body + drive.bodies):
        body = state.bodies[b]
        if not (is_in_box(drive.low, drive.high, body.center) and has_finite_rotation(body.angle, body.speed)):
            good = int(0)
    return good
