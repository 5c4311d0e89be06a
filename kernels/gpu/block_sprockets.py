"""Sprockets on blocks of threads: what is shared of them, and how the thread that has one turns and moves it."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.body import body_at, leapfrog_body, load_at, prescribed_at
from ..root import reciprocal
from ..structs import SprocketState, Wheel, types, vec2d
from ..sum_structs import Sums, Totals
from ..trigonometry import sine_cosine
from .block_forces import block_forces
from .exchange import COURSE, lanes


@wp.func
def rotated(direction: vec2d, angle: wp.float64):
    """A unit vector turned by a small angle: the series to fifth order, then back to length one."""
    square = angle * angle
    cosine = wp.float64(1.0) - square * (wp.float64(0.5) - square * wp.float64(1.0 / 24.0))
    sine = angle * (wp.float64(1.0) - square * (wp.float64(1.0 / 6.0) - square * wp.float64(1.0 / 120.0)))
    x = direction[0] * cosine - direction[1] * sine
    y = direction[0] * sine + direction[1] * cosine
    scale = wp.float64(1.5) - wp.float64(0.5) * (x * x + y * y)
    return vec2d(x * scale, y * scale)


@cache
def block_sprockets(
    Real: type, threads: int, per: int, sprockets: int, guides: int, moving: bool, measuring: bool
) -> SimpleNamespace:
    """The functions of one variant's sprockets on a block of `threads` threads."""
    kinds = types(Real)
    vec2 = kinds.vec2
    part = block_forces(Real, threads, per, sprockets, guides, moving, measuring)
    share_geometry = part.share_geometry

    @wp.func
    def center_outside(ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, s: int):
        """1 where the center of sprocket s is not finite or has left the drive's box."""
        drive = ensemble.drives[variant]
        c = shared.wheels[s].center
        return int(not (c[0] > drive.low[0] and c[0] < drive.high[0] and c[1] > drive.low[1] and c[1] < drive.high[1]))

    @wp.func
    def set_heading(shared: kinds.Shared, s: int):
        """Cosine and sine of sprocket s from its angle."""
        sine, cosine = sine_cosine(shared.wheels[s].angle)
        shared.wheels[s].cosine = cosine
        shared.wheels[s].sine = sine

    @wp.func
    def start_sprocket(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        shared: kinds.Shared,
        variant: int,
        s: int,
        step: int,
    ):
        """What is shared of sprocket s and, with the first, of the chain."""
        drive = ensemble.drives[variant]
        mine = drive.first_sprocket + s
        body = state.sprockets[mine]
        angle, exact = prescribed_at(
            wp.float64(step) * drive.step, ensemble.motions[mine], ensemble.harmonics, ensemble.tables
        )
        wheel = Wheel()
        wheel.angle = body.angle
        wheel.speed = body.speed
        wheel.center = body.center
        wheel.velocity = body.velocity
        wheel.exact_speed = exact
        shared.wheels[s] = wheel
        set_heading(shared, s)
        share_geometry(ensemble, shared, variant, s, body.center)
        shared.motions[s] = ensemble.motions[mine]
        if wp.static(moving):
            shared.mounts[s] = ensemble.mounts[mine]
            shared.mount_sums[s] = sums.mount[mine]
        shared.sprocket_sums[s] = sums.sprocket[mine]
        shared.strand_sums[s] = sums.strand[mine]
        shared.strands[s] = state.strands[mine]

    @wp.func
    def end_sprocket(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, variant: int, s: int
    ):
        """Sprocket s and its sums back into the state."""
        mine = ensemble.drives[variant].first_sprocket + s
        body = state.sprockets[mine]
        body.angle = shared.wheels[s].angle
        body.speed = shared.wheels[s].speed
        if wp.static(moving):
            body.center = shared.wheels[s].center
            body.velocity = shared.wheels[s].velocity
            sums.mount[mine] = shared.mount_sums[s]
        state.sprockets[mine] = body
        sums.sprocket[mine] = shared.sprocket_sums[s]
        sums.strand[mine] = shared.strand_sums[s]
        state.strands[mine] = shared.strands[s]

    @wp.func
    def plan(ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, i: int, step: int):
        """Prescribed angles and speeds of the next `COURSE` steps: each warp its own sprockets', a step a thread."""
        drive = ensemble.drives[variant]
        s = i // lanes()
        while s < wp.static(sprockets):
            motion = shared.motions[s]
            if motion.prescribed == 1:
                ahead = 1 + i % lanes()
                while ahead <= wp.static(COURSE):
                    time = wp.float64(step + ahead) * drive.step
                    angle, speed = prescribed_at(time, motion, ensemble.harmonics, ensemble.tables)
                    at = course_of(s, step + ahead)
                    shared.course[at] = angle
                    shared.course[at + 1] = speed
                    ahead = ahead + lanes()
            s = s + wp.static(threads) // lanes()

    @wp.func
    def course_of(s: int, step: int):
        """Where the prescribed angle and speed of sprocket s at `step` stand."""
        return 2 * (s * wp.static(COURSE) + step % wp.static(COURSE))

    @wp.func
    def foresee(ensemble: kinds.Ensemble, shared: kinds.Shared, s: int, time: wp.float64):
        """The load on sprocket s, if it is free."""
        motion = shared.motions[s]
        if motion.prescribed == 0:
            wheel = shared.wheels[s]
            shared.wheels[s].load = load_at(time, wheel.angle, wheel.speed, motion, ensemble.harmonics, ensemble.tables)

    @wp.func
    def turn(shared: kinds.Shared, s: int, contacts: Totals, h: wp.float64, step: int, going: bool):
        """Takes sprocket s, which only turns, one step on if `going`; returns how it was at the step's instant."""
        wheel = shared.wheels[s]
        body = SprocketState()
        body.angle = wheel.angle
        body.center = wheel.center
        body.speed = wheel.exact_speed
        angle = wheel.angle
        if shared.motions[s].prescribed == 1:
            at = course_of(s, step + 1)
            angle = shared.course[at]
            wheel.exact_speed = shared.course[at + 1]
            wheel.speed = (angle - wheel.angle) * reciprocal(h)
        else:
            faster = (contacts.moment + wheel.load) * shared.motions[s].inverse_inertia
            kick = h
            lag = wp.float64(0.5) * h
            if step == 0:
                kick = wp.float64(0.5) * h
                lag = wp.float64(0.0)
            body.speed = wheel.speed + lag * faster
            wheel.speed = wheel.speed + kick * faster
            angle = wheel.angle + h * wheel.speed
        if going:
            heading = rotated(vec2d(wheel.cosine, wheel.sine), angle - wheel.angle)
            shared.wheels[s].cosine = heading[0]
            shared.wheels[s].sine = heading[1]
            shared.wheels[s].speed = wheel.speed
            shared.wheels[s].exact_speed = wheel.exact_speed
            shared.wheels[s].angle = angle
        return body

    @wp.func
    def turn_and_move(
        ensemble: kinds.Ensemble,
        shared: kinds.Shared,
        s: int,
        contacts: Totals,
        h: wp.float64,
        step: int,
        going: bool,
    ):
        """Takes sprocket s on an active mount one step on if `going`; returns how it was at the step's instant."""
        wheel = shared.wheels[s]
        motion = shared.motions[s]
        mount = shared.mounts[s]
        time = wp.float64(step) * h
        kick = h
        back = wp.float64(0.5) * h
        if step == 0:
            kick = wp.float64(0.5) * h
            back = wp.float64(0.0)
        body = SprocketState()
        body.angle = wheel.angle
        body.speed = wheel.speed
        body.center = wheel.center
        body.velocity = wheel.velocity
        heading = vec2d(wheel.cosine, wheel.sine)
        now = body_at(time, back, body, heading, contacts, motion, mount, ensemble.harmonics, ensemble.tables)
        if going:
            body = leapfrog_body(
                time, kick, h, body, heading, contacts, motion, mount, ensemble.harmonics, ensemble.tables
            )
            if motion.prescribed == 1:
                body.angle = shared.course[course_of(s, step + 1)]
                body.speed = (body.angle - wheel.angle) * reciprocal(h)
            heading = rotated(heading, body.angle - wheel.angle)
            wheel.cosine = heading[0]
            wheel.sine = heading[1]
            wheel.angle = body.angle
            wheel.speed = body.speed
            wheel.center = body.center
            wheel.velocity = body.velocity
            shared.wheels[s] = wheel
            band = shared.bands[s]
            band.center = vec2(Real(body.center[0]), Real(body.center[1]))
            shared.bands[s] = band
        return now

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
