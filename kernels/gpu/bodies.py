"""Bodies on blocks of threads: what is shared of them, and how the thread that has one takes it on."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..fast_math import product
from ..integrate import leapfrog_kick, leapfrog_lag, rk4_instant, rk4_reach, rk4_stage, rk4_weight
from ..number import Pair, apart, counted, pair_of, plus, rounded, sine_cosine, times, whole
from ..physics.body import body_at, body_rates, in_box, leapfrog_body, pose_of, rk4_body, turns_soundly
from ..physics.curve import integral_at, slope_at, value_at
from ..physics.hub import hub_moved, hub_of, hub_rates, hub_staged, hub_trimmed, hub_velocity, narrow_wrench, with_hub
from ..physics.motion import free_load, load_moment, prescribed_at, ramp_slope
from ..physics.spin import (
    faced,
    forward_of,
    led_acceleration,
    led_along,
    ramped_course,
    spin_load,
    spin_of,
    spin_staged,
    spun,
    swung,
    wheel_at,
    with_spin,
)
from ..structs import BodyState, Drive, Hub, Mount, Pose, Spin, SpinRates, Wheel, Wrench, types
from ..sum_structs import Sums
from .geometry import contact_geometry
from .kind import BlockKind, Mine, now_struct
from .shared_memory import COURSE
from .sync import lanes
from .wheels import load_wheel, store_load, store_turn, store_wheel, velocity_of, within


@dataclass(frozen=True)
class BodyFunctions:
    """What is done about bodies, as functions of kernels."""

    is_led: wp.Function
    course_of: wp.Function
    body_gone: wp.Function
    set_heading: wp.Function
    start_body: wp.Function
    end_body: wp.Function
    plan: wp.Function
    load_moment_ahead: wp.Function
    spin: wp.Function
    advance: wp.Function


@wp.struct
class Seen:
    """A body at one instant, in float32."""

    angle: wp.float32  # [rad]
    speed: wp.float32  # [rad/s]
    center: wp.vec2f  # [m]
    load: wp.float32  # moment [N m], at the speed that was known then
    velocity: wp.vec2f  # of the center, where sums of a mount want it [m/s]
    turning: wp.vec3f  # of `mount.accelerations`, the same
    pushing: wp.vec3f  # of its tensioners: moment [N m] and force [N], the same


@wp.func
def with_velocity(rows: wp.array[wp.vec4f], s: int, wheel: Wheel):
    """Body s with the velocity of its center."""
    wheel.velocity = velocity_of(rows, s)
    return wheel


@wp.func
def rotated(direction: wp.vec2d, angle: wp.float64):
    """A unit vector turned by a small angle: the series to fifth order, then back to length one."""
    square = angle * angle
    cosine = wp.float64(1.0) - square * (wp.float64(0.5) - square * wp.static(wp.float64(1.0 / 24.0)))
    sine = angle * (
        wp.float64(1.0) - square * (wp.static(wp.float64(1.0 / 6.0)) - square * wp.static(wp.float64(1.0 / 120.0)))
    )
    x = direction[0] * cosine - direction[1] * sine
    y = direction[0] * sine + direction[1] * cosine
    scale = wp.float64(1.5) - wp.float64(0.5) * (x * x + y * y)
    return wp.vec2d(x * scale, y * scale)


@wp.func
def state_of(pose: Pose):
    """The coordinates and rates of a body whose pose is shared."""
    body = BodyState()
    body.angle = pose.angle
    body.speed = pose.speed
    body.center = pose.center
    body.velocity = pose.velocity
    return body


@wp.func
def plan_at(course: int, step: int):
    """Where the prescribed angle and speed of a body at `step` lie, by the body's place among those."""
    return course * wp.static(COURSE) + step % wp.static(COURSE)


@cache
def block_bodies(kind: BlockKind) -> BodyFunctions:
    """The functions of one variant's bodies, its sprockets, on a block."""
    Real, threads, sprockets, moving, rk4 = kind.Real, kind.threads, kind.sprockets, kind.moving, kind.rk4
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    share_geometry = contact_geometry(kind).share_geometry
    # at float32 a load is found ahead by a warp that has no rollers, which waits for the contacts of others
    loading_ahead = kind.paired and kind.body_warp and not rk4

    @wp.func
    def body_gone(drive: Drive, shared: kinds.Shared, s: int):
        """1 where body s does not turn soundly, or its center has left the drive's box."""
        gone = int(0)
        if wp.static(kind.paired):
            wheel = load_wheel(shared.wheels, s)
            gone = int(not (wp.abs(wheel.angle.low + wheel.speed.high) < 1.0e38))
            if wp.static(moving):
                gone = wp.max(gone, int(not within(shared.box[0], wheel.center)))
        else:
            gone = int(not turns_soundly(shared.poses[s].angle, shared.poses[s].speed))
            if wp.static(moving):
                gone = wp.max(gone, int(not in_box(drive, shared.poses[s].center)))
        return gone

    @wp.func
    def set_heading(shared: kinds.Shared, s: int):
        """Cosine and sine of body s from its angle."""
        if wp.static(kind.paired):
            wheel = faced(load_wheel(shared.wheels, s))
            if wp.static(moving):
                if s < wp.static(sprockets):
                    wheel, hub = hub_trimmed(with_velocity(shared.wheels, s, wheel), shared.hubs[s])
                    shared.hubs[s] = hub
                    store_wheel(shared.wheels, s, wheel)
                    return
            store_turn(shared.wheels, s, wheel)
            return
        sine, cosine = sine_cosine(shared.poses[s].angle)
        shared.poses[s].cosine = cosine
        shared.poses[s].sine = sine

    @wp.func
    def course_to(ensemble: kinds.Ensemble, mine: Mine, s: int, time: Pair, spin: Spin):
        """phi [rad] and phi' [rad/s] of a sprocket that is led, at float32."""
        course, rate = ramped_course(time, spin)
        if wp.static(kind.tabulated):
            if spin.tabulated == 1:
                table = ensemble.split_tables[2 * (ensemble.drives[mine.variant].first_body + s)]
                if table.cells > 0:
                    speed, way = integral_at(time, table, ensemble.split_values)
                    course = way
                    rate = rounded(speed)
        return course, rate

    @wp.func
    def led_growth(ensemble: kinds.Ensemble, mine: Mine, s: int, time: Pair, spin: Spin):
        """Angular acceleration of a sprocket that is led [rad/s^2], at float32."""
        course, rate = course_to(ensemble, mine, s, time, spin)
        growth = spin.speed.high * ramp_slope(rounded(time), spin.ramp_time.high)
        if wp.static(kind.tabulated):
            if spin.tabulated == 1:
                table = ensemble.split_tables[2 * (ensemble.drives[mine.variant].first_body + s)]
                if table.cells > 0:
                    growth = slope_at(time, table, ensemble.split_values)
        return led_acceleration(course, rate, growth, spin, ensemble.split_harmonics)

    @wp.func
    def led_at(ensemble: kinds.Ensemble, mine: Mine, s: int, time: Pair, spin: Spin):
        """Where sprocket s is led, at float32."""
        course, rate = course_to(ensemble, mine, s, time, spin)
        return led_along(course, rate, spin, ensemble.split_harmonics)

    @wp.func
    def start_body(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine, step: int
    ):
        """What is shared of the thread's sprocket and, with the first, of the chain."""
        drive = ensemble.drives[mine.variant]
        s = mine.sprocket
        b = drive.first_body + s
        at = drive.first_sprocket + s
        share_geometry(ensemble, shared, drive, mine.variant, s, state.bodies[b].center)
        if wp.static(kind.paired):
            shared.spins[s] = spin_of(ensemble.motions[b])
            wheel = wheel_at(state.bodies[b], ensemble.sprockets[at].exact_radius)
            wheel.exact_speed = led_at(ensemble, mine, s, counted(step, mine.step), shared.spins[s]).speed
            store_wheel(shared.wheels, s, wheel)
            if wp.static(moving):
                shared.hubs[s] = hub_of(ensemble.mounts[b], state.bodies[b])
        else:
            pose = pose_of(state.bodies[b])
            angle, exact = prescribed_at(wp.float64(step) * drive.step, ensemble.motions[b], ensemble.curves)
            pose.exact_speed = exact
            shared.poses[s] = pose
            shared.motions[s] = ensemble.motions[b]
            if wp.static(moving):
                shared.mounts[s] = ensemble.mounts[b]
        if wp.static(kind.measuring):
            if wp.static(moving):
                shared.mount_sums[s] = kinds.narrowed(sums.mount[at])
            shared.sprocket_sums[s] = kinds.narrowed(sums.sprocket[at])

    @wp.func
    def end_body(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine):
        """The thread's sprocket and its sums back into the state."""
        drive = ensemble.drives[mine.variant]
        s = mine.sprocket
        at = drive.first_sprocket + s
        if wp.static(kind.paired):
            b = drive.first_body + s
            wheel = load_wheel(shared.wheels, s)
            state.bodies[b] = with_spin(state.bodies[b], wheel)
            if wp.static(moving):
                wheel = with_velocity(shared.wheels, s, wheel)
                state.bodies[b] = with_hub(state.bodies[b], wheel, shared.hubs[s])
        else:
            state.bodies[drive.first_body + s] = state_of(shared.poses[s])
        if wp.static(kind.measuring):
            if wp.static(moving):
                sums.mount[at] = whole(shared.mount_sums[s])
            sums.sprocket[at] = whole(shared.sprocket_sums[s])

    @wp.func
    def motion_of(shared: kinds.Shared, s: int):
        """The motion of sprocket s, with what is known of it when the kernel is made."""
        motion = shared.motions[s]
        if wp.static(not kind.tabulated):
            motion.drive_table.cells = 0
            motion.load_table.cells = 0
        return motion

    @wp.func
    def is_led(shared: kinds.Shared, s: int):
        """Whether the angle of sprocket s is prescribed."""
        if wp.static(kind.paired):
            return shared.spins[s].prescribed == 1
        else:
            return shared.motions[s].prescribed == 1

    @wp.func
    def course_of(shared: kinds.Shared, s: int):
        """The place of sprocket s among those whose angle is prescribed; of any other a place that there is."""
        place = int(0)
        for other in range(wp.static(sprockets)):
            if other < s and is_led(shared, other):
                place = place + 1
        return wp.min(place, wp.static(kind.prescribed - 1))

    @wp.func
    def tabulate_motion(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, s: int, step: int):
        """Puts where sprocket s is led at a step in its place."""
        at = plan_at(course_of(shared, s), step)
        if wp.static(kind.paired):
            shared.led[at] = led_at(ensemble, mine, s, counted(step, mine.step), shared.spins[s])
        else:
            angle, speed = prescribed_at(wp.float64(step) * mine.h, motion_of(shared, s), ensemble.curves)
            shared.course[2 * at] = angle
            shared.course[2 * at + 1] = speed

    @wp.func
    def plan(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, step: int):
        """Prescribed angles and speeds of the next `COURSE` steps: each warp its own bodies', a step a thread."""
        i = mine.thread
        s = i // lanes()
        while s < wp.static(sprockets):
            if is_led(shared, s):
                ahead = 1 + i % lanes()
                while ahead <= wp.static(COURSE):
                    tabulate_motion(ensemble, shared, mine, s, step + ahead)
                    ahead = ahead + lanes()
            s = s + wp.static(threads) // lanes()

    @wp.func
    def time_of(mine: Mine, now: Now):
        """The instant of a step, or of a stage of it [s], at float32."""
        if wp.static(rk4):
            return plus(counted(now.step, mine.step), times(mine.step, rk4_instant(now.stage, 1.0)))
        else:
            return counted(now.step, mine.step)

    @wp.func
    def load_on(ensemble: kinds.Ensemble, mine: Mine, now: Now, wheel: Wheel, spin: Spin):
        """The load moment on the thread's sprocket [N m], in float32."""
        torque = spin.load[0]
        if wp.static(kind.tabulated):
            if spin.tabulated == 1:
                b = ensemble.drives[mine.variant].first_body + mine.sprocket
                table = ensemble.split_tables[2 * b + 1]
                if table.cells > 0:
                    x = time_of(mine, now)
                    if table.over_angle == 1:
                        x = forward_of(wheel, spin)
                    torque = torque + value_at(x, table, ensemble.split_values)
        time = float(now.step) * mine.step.high
        if wp.static(rk4):
            time = time + rk4_instant(now.stage, mine.step.high)
        return spin_load(time, torque, wheel, spin, ensemble.split_harmonics)

    @wp.func
    def load_moment_ahead(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now):
        """Works out the load on the thread's body ahead, while other threads are at their contacts."""
        s = mine.sprocket
        if wp.static(kind.paired):
            if wp.static(loading_ahead):
                wheel = load_wheel(shared.wheels, s)
                store_load(shared.wheels, s, load_on(ensemble, mine, now, wheel, shared.spins[s]))
        else:
            time = wp.float64(now.step) * mine.h
            pose = shared.poses[s]
            motion = motion_of(shared, s)
            # of a prescribed body too, and thrown away, so that the threads of a warp do not part
            load = free_load(time, pose.angle, pose.speed, motion, ensemble.curves)
            shared.poses[s].load = wp.where(motion.prescribed == 1, wp.float64(0.0), load)

    @wp.func
    def load_now(ensemble: kinds.Ensemble, mine: Mine, now: Now, wheel: Wheel, spin: Spin):
        """The load moment on the thread's sprocket [N m], in float32: from `load_moment_ahead`, or found now."""
        if wp.static(loading_ahead):
            return wheel.load
        else:
            return load_on(ensemble, mine, now, wheel, spin)

    @wp.func
    def settle_at(shared: kinds.Shared, s: int, pose: Pose):
        """Makes a pose that of body s, and its band go with it."""
        if wp.static(moving):
            shared.poses[s] = pose
            band = shared.bands[s]
            band.center = vec2(Real(pose.center[0]), Real(pose.center[1]))
            shared.bands[s] = band
        else:
            shared.poses[s].cosine = pose.cosine
            shared.poses[s].sine = pose.sine
            shared.poses[s].angle = pose.angle
            shared.poses[s].speed = pose.speed
            shared.poses[s].exact_speed = pose.exact_speed

    @wp.func
    def moved_by(
        ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, acting: wp.vec3f, wheel: Wheel, hub: Hub
    ):
        """Accelerations of a sprocket on an active mount, and `turning` of `mount.accelerations`, at float32."""
        spin = shared.spins[mine.sprocket]
        time = time_of(mine, now)
        turning = wp.vec3f()
        body = SpinRates()
        body.speed = wheel.speed.high
        body.velocity = wheel.velocity
        if spin.prescribed == 0:
            turning[2] = load_now(ensemble, mine, now, wheel, spin)
        else:
            turning[0] = 1.0
            turning[1] = led_growth(ensemble, mine, mine.sprocket, time, spin)
            if wp.static(not rk4):  # whose speed is that of its instant
                body.speed = wheel.exact_speed
        return hub_rates(time, wheel, body, hub, narrow_wrench(acting), turning), turning

    @wp.func
    def spin_on_mount(
        ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, acting: wp.vec3f, wheel: Wheel
    ):
        """As `spin`, of a sprocket whose center moves or that has a balance wheel."""
        s = mine.sprocket
        h = mine.step.high
        wheel = with_velocity(shared.wheels, s, wheel)
        hub = shared.hubs[s]
        spin = shared.spins[s]
        rates, turning = moved_by(ensemble, shared, mine, now, acting, wheel, hub)
        lag = leapfrog_lag(now.step, h)
        wheel.load = turning[2]
        seen = Seen()
        seen.angle = rounded(wheel.angle)
        seen.center = wheel.center
        seen.load = wheel.load
        seen.speed = wp.where(spin.prescribed == 1, wheel.exact_speed, wheel.speed.high + lag * rates[2])
        if wp.static(kind.measuring) and now.measured != 0:
            seen.velocity = hub_velocity(time_of(mine, now), lag, wheel, hub, rates)
            seen.turning = turning
        if now.going != 0:
            ahead = shared.led[plan_at(mine.course, now.step + 1)]
            kick = leapfrog_kick(now.step, h)
            wheel, hub = hub_moved(counted(now.step + 1, mine.step), kick, h, wheel, hub, rates)
            store_wheel(shared.wheels, s, spun(wheel, kick * rates[2], h, ahead, spin))
            shared.hubs[s].velocity_low = hub.velocity_low
            shared.bands[s].center = wheel.center
        return seen

    @wp.func
    def stage_wheel(
        ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, acting: wp.vec3f, wheel: Wheel
    ):
        """As `spin`, to where the next stage of rk4 evaluates the sprocket."""
        s = mine.sprocket
        spin = shared.spins[s]
        rates = wp.vec3f()
        turning = wp.vec3f()
        mounted = int(0)
        hub = Hub()
        if wp.static(moving):
            wheel = with_velocity(shared.wheels, s, wheel)
            hub = shared.hubs[s]
            mounted = hub.active
            if mounted != 0:
                rates, turning = moved_by(ensemble, shared, mine, now, acting, wheel, hub)
        if mounted == 0 and spin.prescribed == 0:
            turning[2] = load_on(ensemble, mine, now, wheel, spin)
            rates[2] = (acting[0] + turning[2]) * spin.inverse_inertia
        seen = Seen()
        seen.angle = rounded(wheel.angle)
        seen.speed = wheel.speed.high
        seen.center = wheel.center
        seen.velocity = wheel.velocity
        seen.load = turning[2]
        seen.turning = turning
        wheel.load = turning[2]
        if now.going != 0:
            weight = rk4_weight(now.stage, mine.step.high)
            reach = rk4_reach(now.stage, mine.step.high)
            stages = shared.wheel_stages[s]
            before = wheel.angle
            after = plus(counted(now.step, mine.step), times(mine.step, rk4_reach(now.stage, 1.0)))
            if wp.static(moving):
                wheel, hub, stages = hub_staged(now.stage, weight, reach, after, wheel, hub, stages, rates)
                shared.hubs[s].velocity_low = hub.velocity_low
                shared.bands[s].center = wheel.center
            wheel, stages = spin_staged(now.stage, weight, reach, wheel, stages, rates[2])
            if spin.prescribed == 1:
                ahead = led_at(ensemble, mine, s, after, spin)
                wheel.angle = ahead.angle
                wheel.speed = pair_of(ahead.speed)
                wheel.exact_speed = ahead.speed
            shared.wheel_stages[s] = stages
            store_wheel(shared.wheels, s, swung(wheel, apart(wheel.angle, before)))
        return seen

    @wp.func
    def spin(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, acting: wp.vec3f):
        """Takes the thread's sprocket a step or a stage on if the run goes on; returns it with its rates then.

        In pairs of float32; `acting` are the chain's moment on it [N m] and, if centers move, its force [N].
        """
        s = mine.sprocket
        h = mine.step.high
        moment = acting[0]
        wheel = load_wheel(shared.wheels, s)
        if wp.static(rk4):
            return stage_wheel(ensemble, shared, mine, now, acting, wheel)
        spin = shared.spins[s]
        if wp.static(moving):
            if shared.hubs[s].active != 0:
                return spin_on_mount(ensemble, shared, mine, now, acting, wheel)
        seen = Seen()
        seen.angle = rounded(wheel.angle)
        seen.speed = wheel.exact_speed
        seen.center = wheel.center
        if spin.prescribed == 0:
            wheel.load = load_now(ensemble, mine, now, wheel, spin)
            seen.load = wheel.load
            rate = (moment + wheel.load) * spin.inverse_inertia
            seen.speed = wheel.speed.high + leapfrog_lag(now.step, h) * rate
        if now.going != 0:
            ahead = shared.led[plan_at(mine.course, now.step + 1)]  # not used where the angle is free
            change = product(leapfrog_kick(now.step, h) * (moment + wheel.load), spin.inverse_inertia)
            store_turn(shared.wheels, s, spun(wheel, change, h, ahead, spin))
        return seen

    @wp.func
    def leapfrog(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, wrench: Wrench):
        """Takes the thread's body one step on if the run goes on; returns it with its rates at the step's instant."""
        s = mine.sprocket
        h = mine.h
        pose = shared.poses[s]
        motion = motion_of(shared, s)
        mount = Mount()
        if wp.static(moving):
            mount = shared.mounts[s]
        time = wp.float64(now.step) * h
        body = state_of(pose)
        heading = wp.vec2d(pose.cosine, pose.sine)
        rates = body_rates(time, body, heading, wrench, pose.load, motion, mount, ensemble.curves)
        observed = body_at(time, leapfrog_lag(now.step, h), body, rates, pose.exact_speed, motion, mount)
        if now.going != 0:
            at = plan_at(mine.course, now.step + 1)  # not used where the angle is free
            ahead = shared.course[2 * at]
            pose.exact_speed = shared.course[2 * at + 1]
            body = leapfrog_body(time, leapfrog_kick(now.step, h), h, body, rates, ahead, motion, mount)
            heading = rotated(heading, body.angle - pose.angle)
            pose.cosine = heading[0]
            pose.sine = heading[1]
            pose.angle = body.angle
            pose.speed = body.speed
            pose.center = body.center
            pose.velocity = body.velocity
            settle_at(shared, s, pose)
        return observed

    @wp.func
    def runge_kutta(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        wrench: Wrench,
    ):
        """Takes the thread's body to where the next stage evaluates it, if the run goes on; returns it as it was."""
        s = mine.sprocket
        h = mine.h
        body = state_of(shared.poses[s])
        if now.going != 0:
            b = ensemble.drives[mine.variant].first_body + s
            at = rk4_stage(now.stage, wp.float64(now.step) * h, h)
            motion = motion_of(shared, s)
            mount = Mount()
            if wp.static(moving):
                mount = shared.mounts[s]
            load = load_moment(at.time, body.angle, body.speed, motion, ensemble.curves)
            heading = wp.vec2d(shared.poses[s].cosine, shared.poses[s].sine)
            rates = body_rates(at.time, body, heading, wrench, load, motion, mount, ensemble.curves)
            moved, stages = rk4_body(at, body, state.body_stages[b], rates, motion, mount, ensemble.curves)
            state.body_stages[b] = stages
            settle_at(shared, s, pose_of(moved))
        return body

    @wp.func
    def advance(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        wrench: Wrench,
    ):
        """Takes the thread's body on by a step, or a stage of rk4; returns it with its rates at the step's instant."""
        if wp.static(rk4):
            return runge_kutta(ensemble, state, shared, mine, now, wrench)
        else:
            return leapfrog(ensemble, shared, mine, now, wrench)

    return BodyFunctions(
        is_led=is_led,
        course_of=course_of,
        body_gone=body_gone,
        set_heading=set_heading,
        start_body=start_body,
        end_body=end_body,
        plan=plan,
        load_moment_ahead=load_moment_ahead,
        spin=spin,
        advance=advance,
    )
