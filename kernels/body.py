"""Sprockets as bodies: their prescribed motion, their load and their acceleration, for one variant of an ensemble."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .motion import load_moment, prescribed_motion
from .structs import Drive, Motion, types

Harmonics = wp.array(dtype=wp.types.vector(3, wp.float64))


@wp.func
def prescribed_at(time: wp.float64, motion: Motion, harmonics: Harmonics):
    """Angle and speed of a prescribed sprocket."""
    h = motion.drive_harmonics
    return prescribed_motion(
        time, motion.start_angle, motion.sign, motion.speed, motion.ramp_time, harmonics, h.first, h.count
    )


@wp.func
def load_at(time: wp.float64, angle: wp.float64, speed: wp.float64, motion: Motion, harmonics: Harmonics):
    """Load moment of a free sprocket [N m], counter-clockwise."""
    h = motion.load_harmonics
    turned = angle - motion.start_angle
    return load_moment(
        time, turned, speed, motion.sign, motion.load, motion.load_ramp_time, harmonics, h.first, h.count
    )


@cache
def bodies(Real: type) -> SimpleNamespace:
    """The functions of one variant's sprockets."""
    kinds = types(Real)

    @wp.func
    def sprocket_acceleration(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64):
        """Angular acceleration of free sprocket `s` of the drive, eq. (4)."""
        i = drive.first_sprocket + s
        motion = ensemble.motions[i]
        body = state.sprockets[i]
        load_part = load_at(time, body.angle, body.speed, motion, ensemble.harmonics)
        return (state.totals[drive.first_sprocket + drive.first_guide + s].moment + load_part) * motion.inverse_inertia

    @wp.func
    def true_speed(
        ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64, back: wp.float64
    ):
        """Angular velocity of sprocket `s` of the drive at `time`, `back` after its speed's instant."""
        motion = ensemble.motions[drive.first_sprocket + s]
        if motion.prescribed == 1:
            angle, speed = prescribed_at(time, motion, ensemble.harmonics)
            return speed
        body = state.sprockets[drive.first_sprocket + s]
        return body.speed + back * sprocket_acceleration(ensemble, state, drive, s, time)

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
