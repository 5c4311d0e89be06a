"""Sprockets as bodies: how one is moved over a step, from the chain's force and moment on it.

A sprocket with a fixed center and no balance wheel only turns (`Mount.active` = 0); the others follow `mount`. What is
prescribed takes its mean speed over a leapfrog step, which leads it exactly from place to place.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..root import reciprocal
from ..structs import CenterStages, Drive, Motion, Mount, SprocketState, types, vec2d, vec3d
from ..sum_structs import Totals
from ..trigonometry import sine_cosine
from .motion import load_moment, prescribed_acceleration, prescribed_motion, ramp, ramped
from .mount import PRESCRIBED, accelerations, prescribed_center
from .table import table_at

Harmonics = wp.array(dtype=wp.types.vector(3, wp.float64))
Tables = wp.array(dtype=wp.float64)


@wp.func
def course_at(time: wp.float64, motion: Motion, tables: Tables):
    """phi, phi' and phi'' of a prescribed sprocket, before its harmonics."""
    phi, rate, growth = ramped(time, motion.speed, motion.ramp_time)
    if motion.drive_table.cells > 0:
        rate, phi, growth = table_at(time, motion.drive_table, tables)
    return phi, rate, growth


@wp.func
def prescribed_at(time: wp.float64, motion: Motion, harmonics: Harmonics, tables: Tables):
    """Angle and speed of a prescribed sprocket."""
    h = motion.drive_harmonics
    phi, rate, growth = course_at(time, motion, tables)
    return prescribed_motion(phi, rate, motion.start_angle, motion.sign, harmonics, h.first, h.count)


@wp.func
def load_at(
    time: wp.float64, angle: wp.float64, speed: wp.float64, motion: Motion, harmonics: Harmonics, tables: Tables
):
    """Load moment of a free sprocket [N m], counter-clockwise."""
    h = motion.load_harmonics
    turned = angle - motion.start_angle
    torque = motion.load[0]
    if motion.load_table.cells > 0:
        x = wp.where(motion.load_table.over_angle == 1, motion.sign * turned, time)
        tabulated, integral, slope = table_at(x, motion.load_table, tables)
        torque = torque + tabulated
    load = vec3d(torque, motion.load[1], motion.load[2])
    return load_moment(time, turned, speed, motion.sign, load, motion.load_ramp_time, harmonics, h.first, h.count)


@wp.func
def load_at_speed(time: wp.float64, load: wp.float64, before: wp.float64, speed: wp.float64, motion: Motion):
    """The load moment [N m] at another angular velocity than `before`, where it is `load`."""
    change = motion.load[1] * (speed - before) + motion.load[2] * (speed * wp.abs(speed) - before * wp.abs(before))
    return load - change * ramp(time, motion.load_ramp_time)


@wp.func
def angular_acceleration(
    time: wp.float64, body: SprocketState, moment: wp.float64, motion: Motion, harmonics: Harmonics, tables: Tables
):
    """Angular acceleration of a sprocket that only turns, eq. (4) [rad/s^2]; 0 if its angle is prescribed."""
    if motion.prescribed == 1:
        return wp.float64(0.0)
    return (moment + load_at(time, body.angle, body.speed, motion, harmonics, tables)) * motion.inverse_inertia


@wp.func
def own_motion(
    time: wp.float64,
    back: wp.float64,
    body: SprocketState,
    moment: wp.float64,
    motion: Motion,
    harmonics: Harmonics,
    tables: Tables,
):
    """Angular velocity of a sprocket that only turns, at `time`, `back` after its own instant, and its load moment."""
    if motion.prescribed == 1:
        angle, driven = prescribed_at(time, motion, harmonics, tables)
        return driven, wp.float64(0.0)
    load = load_at(time, body.angle, body.speed, motion, harmonics, tables)
    speed = body.speed + back * ((moment + load) * motion.inverse_inertia)
    return speed, load_at_speed(time, load, body.speed, speed, motion)


@wp.func
def heading_of(body: SprocketState):
    """Cosine and sine of a sprocket's angle."""
    sine, cosine = sine_cosine(body.angle)
    return vec2d(cosine, sine)


@wp.func
def body_accelerations(
    time: wp.float64,
    body: SprocketState,
    heading: vec2d,
    contacts: Totals,
    motion: Motion,
    mount: Mount,
    harmonics: Harmonics,
    tables: Tables,
):
    """Acceleration of an active mount's center (x, y) [m/s^2] and of the sprocket's angle [rad/s^2]."""
    turning = vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    if motion.prescribed == 1:
        h = motion.drive_harmonics
        phi, rate, growth = course_at(time, motion, tables)
        given = prescribed_acceleration(phi, rate, growth, motion.sign, harmonics, h.first, h.count)
        angle, speed = prescribed_at(time, motion, harmonics, tables)
        body.speed = speed
        turning = vec3d(wp.float64(1.0), given, wp.float64(0.0))
    else:
        turning[2] = load_at(time, body.angle, body.speed, motion, harmonics, tables)
    return accelerations(time, body, heading, contacts, turning, mount)


@wp.func
def leapfrog_turn(
    time: wp.float64,
    kick: wp.float64,
    h: wp.float64,
    body: SprocketState,
    moment: wp.float64,
    motion: Motion,
    harmonics: Harmonics,
    tables: Tables,
):
    """A sprocket that only turns a step `h` after `time`; `kick` is h, or h / 2 from the initial state."""
    if motion.prescribed == 1:
        angle, speed = prescribed_at(time + h, motion, harmonics, tables)
        body.speed = (angle - body.angle) * reciprocal(h)
        body.angle = angle
    else:
        load = load_at(time, body.angle, body.speed, motion, harmonics, tables)
        body.speed = body.speed + kick * ((moment + load) * motion.inverse_inertia)
        body.angle = body.angle + h * body.speed
    return body


@wp.func
def leapfrog_body(
    time: wp.float64,
    kick: wp.float64,
    h: wp.float64,
    body: SprocketState,
    heading: vec2d,
    contacts: Totals,
    motion: Motion,
    mount: Mount,
    harmonics: Harmonics,
    tables: Tables,
):
    """A sprocket on an active mount a step `h` after `time`, as `leapfrog_turn`; `heading` is that at `time`."""
    rates = body_accelerations(time, body, heading, contacts, motion, mount, harmonics, tables)
    if motion.prescribed == 1:
        angle, speed = prescribed_at(time + h, motion, harmonics, tables)
        body.speed = (angle - body.angle) * reciprocal(h)
        body.angle = angle
    else:
        body.speed = body.speed + kick * rates[2]
        body.angle = body.angle + h * body.speed
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(time + h, mount)
        body.velocity = (center - body.center) * reciprocal(h)
        body.center = center
    else:
        body.velocity = body.velocity + kick * vec2d(rates[0], rates[1])
        body.center = body.center + h * body.velocity
    return body


@wp.func
def rk4_turn(
    next_time: wp.float64,
    weight: wp.float64,
    reach: wp.float64,
    stage: int,
    body: SprocketState,
    acceleration: wp.float64,
    motion: Motion,
    harmonics: Harmonics,
    tables: Tables,
):
    """The sprocket with its angle and speed after one of the four stages of a step.

    `weight` is the stage's in the sum of slopes [s]; `reach` is how far from the step's start it goes, to `next_time`.
    """
    if motion.prescribed == 1:
        angle, speed = prescribed_at(next_time, motion, harmonics, tables)
        body.angle = angle
        body.speed = speed
    else:
        speed = body.speed
        if stage == 0:
            body.base_angle = body.angle
            body.base_speed = speed
            body.sum_angle = wp.float64(0.0)
            body.sum_speed = wp.float64(0.0)
        body.sum_angle = body.sum_angle + weight * speed
        body.sum_speed = body.sum_speed + weight * acceleration
        if stage == 3:
            body.angle = body.base_angle + body.sum_angle
            body.speed = body.base_speed + body.sum_speed
        else:
            body.angle = body.base_angle + reach * speed
            body.speed = body.base_speed + reach * acceleration
    return body


@wp.func
def rk4_center(
    next_time: wp.float64,
    weight: wp.float64,
    reach: wp.float64,
    stage: int,
    body: SprocketState,
    stages: CenterStages,
    rates: vec3d,
    mount: Mount,
):
    """The sprocket with its center after one of the four stages, as `rk4_turn`, and what the stages have in common."""
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(next_time, mount)
        body.center = center
        body.velocity = velocity
    else:
        straight = vec2d(rates[0], rates[1])
        velocity = body.velocity
        if stage == 0:
            stages = CenterStages()
            stages.base_center = body.center
            stages.base_velocity = velocity
        stages.sum_center = stages.sum_center + weight * velocity
        stages.sum_velocity = stages.sum_velocity + weight * straight
        if stage == 3:
            body.center = stages.base_center + stages.sum_center
            body.velocity = stages.base_velocity + stages.sum_velocity
        else:
            body.center = stages.base_center + reach * velocity
            body.velocity = stages.base_velocity + reach * straight
    return body, stages


@wp.func
def body_at(
    time: wp.float64,
    back: wp.float64,
    body: SprocketState,
    heading: vec2d,
    contacts: Totals,
    motion: Motion,
    mount: Mount,
    harmonics: Harmonics,
    tables: Tables,
):
    """A sprocket on an active mount with its speed and velocity at `time`, `back` after the instant of its own."""
    rates = body_accelerations(time, body, heading, contacts, motion, mount, harmonics, tables)
    body.speed = body.speed + back * rates[2]
    if motion.prescribed == 1:
        angle, speed = prescribed_at(time, motion, harmonics, tables)
        body.speed = speed
    if mount.moves == PRESCRIBED:
        center, velocity, growth = prescribed_center(time, mount)
        body.velocity = velocity
    else:
        body.velocity = body.velocity + back * vec2d(rates[0], rates[1])
    return body


@cache
def bodies(Real: type) -> SimpleNamespace:
    """The functions that move the sprockets of one variant of an ensemble, and look at them."""
    kinds = types(Real)

    @wp.func
    def own_acceleration(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64):
        """Angular acceleration of sprocket `s` of the drive, which only turns."""
        i = drive.first_sprocket + s
        moment = state.totals[drive.first_sprocket + drive.first_guide + s].moment
        return angular_acceleration(
            time, state.sprockets[i], moment, ensemble.motions[i], ensemble.harmonics, ensemble.tables
        )

    @wp.func
    def leapfrog_sprocket(
        ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64, kick: wp.float64
    ):
        """Sprocket `s` of the drive a step after `time`."""
        i = drive.first_sprocket + s
        if ensemble.mounts[i].active == 1:
            contacts = state.totals[drive.first_sprocket + drive.first_guide + s]
            body = state.sprockets[i]
            state.sprockets[i] = leapfrog_body(
                time,
                kick,
                drive.step,
                body,
                heading_of(body),
                contacts,
                ensemble.motions[i],
                ensemble.mounts[i],
                ensemble.harmonics,
                ensemble.tables,
            )
        else:
            state.sprockets[i] = leapfrog_turn(
                time,
                kick,
                drive.step,
                state.sprockets[i],
                state.totals[drive.first_sprocket + drive.first_guide + s].moment,
                ensemble.motions[i],
                ensemble.harmonics,
                ensemble.tables,
            )

    @wp.func
    def rk4_sprocket(
        ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, step_time: wp.float64, stage: int
    ):
        """Sprocket `s` of the drive after one of the four stages of the step that begins at `step_time`."""
        i = drive.first_sprocket + s
        h = drive.step
        weight = wp.where(stage == 1 or stage == 2, h / wp.float64(3.0), h / wp.float64(6.0))
        reach = wp.where(stage < 2, wp.float64(0.5) * h, h)
        time = step_time + wp.where(stage == 0, wp.float64(0.0), wp.where(stage == 3, h, wp.float64(0.5) * h))
        motion = ensemble.motions[i]
        body = state.sprockets[i]
        after = step_time + reach
        if ensemble.mounts[i].active == 1:
            mount = ensemble.mounts[i]
            contacts = state.totals[drive.first_sprocket + drive.first_guide + s]
            rates = body_accelerations(
                time, body, heading_of(body), contacts, motion, mount, ensemble.harmonics, ensemble.tables
            )
            body = rk4_turn(after, weight, reach, stage, body, rates[2], motion, ensemble.harmonics, ensemble.tables)
            moved, stages = rk4_center(after, weight, reach, stage, body, state.centers[i], rates, mount)
            state.centers[i] = stages
            state.sprockets[i] = moved
        else:
            acceleration = own_acceleration(ensemble, state, drive, s, time)
            state.sprockets[i] = rk4_turn(
                after, weight, reach, stage, body, acceleration, motion, ensemble.harmonics, ensemble.tables
            )

    @wp.func
    def true_body(
        ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64, back: wp.float64
    ):
        """Sprocket `s` of the drive, on an active mount, with its speeds at `time`, `back` after their instant."""
        i = drive.first_sprocket + s
        contacts = state.totals[drive.first_sprocket + drive.first_guide + s]
        return body_at(
            time,
            back,
            state.sprockets[i],
            heading_of(state.sprockets[i]),
            contacts,
            ensemble.motions[i],
            ensemble.mounts[i],
            ensemble.harmonics,
            ensemble.tables,
        )

    @wp.func
    def centers_inside(state: kinds.State, drive: Drive):
        """1 while every sprocket's center is finite and within the drive's box, else 0."""
        good = int(1)
        for s in range(drive.sprockets):
            c = state.sprockets[drive.first_sprocket + s].center
            if not (c[0] > drive.low[0] and c[0] < drive.high[0] and c[1] > drive.low[1] and c[1] < drive.high[1]):
                good = int(0)
        return good

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
