"""Bodies on blocks of threads: what is shared of them, and how the thread that has one takes it on."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..integrate import leapfrog_kick, leapfrog_lag, stage_at
from ..native import quotient, row_access
from ..number import add, counted, difference, leading, rounded, trimmed  # noqa: F401
from ..physics.body import (
    aligned_pose,
    arm_own_moment,
    body_accelerations,
    body_at_time,
    body_with_accelerations,
    has_finite_rotation,
    is_in_box,
    leapfrog_body,
    move_prescribed_center,
    plain_body,
    pose_with_coordinates,
    stage_body,
    turned_pose,
)
from ..physics.hub import bearing_moment, carried_body
from ..physics.motion import (
    free_load_moment,
    load_table_argument,
    prescribed_acceleration,
    prescribed_rotation,
    table_value,
)
from ..physics.mount import displacement_from_home
from ..physics.tooth import grid_magic
from ..physics.valve import add_geared_cam, constant_inertia_moment
from ..structs import GROUND, Drive
from ..sums import add_bearing, gathered_powers
from .geometry import contact_geometry
from .kind import WARP, BlockKind, Mine, inlined
from .rings import block_rings
from .rollers import roller_rows
from .shared_memory import ANGULAR, COURSE, OF_AN_ARM
from .sync import lanes, sync


@wp.func
def plan_at(course: int, step: int):
    """Where the prescribed angle and speed of a body at `step` lie, by the body's place among those."""
    return course * wp.static(COURSE) + step % wp.static(COURSE)


@cache
def prescribed_motion(kind: BlockKind) -> SimpleNamespace:
    """The functions that work out prescribed angles and speeds of bodies for some steps ahead."""
    mounted, threads = kind.parts.mounted, kind.shape.threads
    kinds = kind.types
    Ensemble, Shared = kinds.Ensemble, kinds.Shared

    @wp.func
    def is_led(shared: Shared, b: int):
        """Whether the angle of body b is prescribed."""
        return shared.motions[b].prescribed == 1

    @wp.func
    def course_of(shared: Shared, b: int):
        """The place of body b among those whose angle is prescribed; of any other body a place that there is."""
        place = int(0)
        for other in range(wp.static(mounted)):
            if other < b and is_led(shared, other):
                place = place + 1
        return wp.min(place, wp.static(kind.parts.prescribed - 1))

    @wp.func
    def led_at(ensemble: Ensemble, shared: Shared, mine: Mine, b: int, step: int):
        """Where body b is led at a step."""
        motion = shared.motions[b]
        if wp.static(kind.parts.tabulated == 0):
            motion.drive_table.cells = 0  # so that the compiler knows
        return prescribed_rotation(counted(step, step_number(mine)), motion, ensemble)

    @wp.func
    def step_number(mine: Mine):
        """The time step as a number [s]."""
        if wp.static(kind.paired):
            return mine.step
        else:
            return mine.h

    @wp.func
    def plan(ensemble: Ensemble, shared: Shared, mine: Mine, step: int):
        """Prescribed angles and speeds of the next `COURSE` steps: each warp its own bodies', a step a thread."""
        i = mine.thread
        b = i // lanes()
        while b < wp.static(mounted):
            if is_led(shared, b):
                ahead = 1 + i % lanes()
                while ahead <= wp.static(COURSE):
                    at = plan_at(course_of(shared, b), step + ahead)
                    angle, speed = led_at(ensemble, shared, mine, b, step + ahead)
                    shared.led_angle[at] = angle
                    shared.led_speed[at] = speed
                    ahead = ahead + lanes()
            b = b + wp.static(threads) // lanes()

    return SimpleNamespace(**locals())


@cache
def body_access(kind: BlockKind) -> SimpleNamespace:
    """The functions that share bodies and their sums, and put them back into the state."""
    sprockets, mounted, moving, measuring = kind.parts.sprockets, kind.parts.mounted, kind.moving, kind.measuring
    kinds = kind.types
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose
    Sums = kinds.Sums
    load_row = row_access(kind.Real).load
    of, led_at, body_of = contact_geometry(kind), prescribed_motion(kind).led_at, block_rings(kind).body_of

    @wp.func
    def state_of(pose: Pose):
        """The coordinates and rates of a body."""
        body = kinds.BodyState()
        body.angle = pose.angle
        body.speed = pose.speed
        body.center = pose.center
        body.velocity = pose.velocity
        body.straight = pose.straight
        body.angular = pose.angular
        return body

    @wp.func
    def heading(pose: Pose):
        """Cosine and sine of a body's angle."""
        return wp.vector(leading(pose.cosine), leading(pose.sine))

    @wp.func
    def pose_from(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """Body b of a chain where the state has it."""
        pose = Pose()
        if wp.static(kind.paired):
            if b < drive.sprockets:
                pose.radius = ensemble.sprockets[drive.first_sprocket + b].exact_radius
                pose.inverse_radius = 1.0 / pose.radius.high
                pose.grid = grid_magic(pose.radius.high)
        return aligned_pose(pose_with_coordinates(pose, state.bodies[drive.first_body + b]))

    @wp.func
    def share_hub(ensemble: Ensemble, shared: Shared, variant: int, row: int, b: int):
        """Shares what body b's hub is on, if it is a sprocket, of a chain in a row of the drives."""
        if wp.static(kind.parts.hubs > 0):
            if b < wp.static(sprockets):
                hub = ensemble.hubs[ensemble.drives[variant].first_sprocket + b]
                hub.arm = body_of(ensemble, shared, row, row - variant, hub.arm)
                shared.hubs[b] = hub

    @wp.func
    def carry(shared: Shared, b: int):
        """Takes body b along with the arm that carries it, where one does; after a barrier, as that may have moved."""
        if wp.static(kind.parts.hubs > 0):
            if b >= 0 and b < wp.static(sprockets):
                hub = shared.hubs[b]
                if hub.arm != GROUND:
                    of.put_pose(shared, b, carried_body(shared.poses[b], shared.poses[hub.arm], hub))

    @wp.func
    def of_joints(shared: Shared, a: int, k: int):
        """Value k that arm `a` shares where arms carry arms."""
        return load_row(shared.joints, a * wp.static(OF_AN_ARM) + k)

    @inlined
    def start_body(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: Mine, step: int):
        """Shares the thread's body at `step`, its sums and, with the first, the chain and guides."""
        drive = ensemble.drives[mine.variant]
        own = ensemble.drives[mine.row]
        b = mine.body
        if b == 0:
            of.share_chain(ensemble, shared, drive, mine.variant)
        pose = pose_from(ensemble, state, own, mine.number)
        shared.motions[b] = ensemble.motions[own.first_body + mine.number]
        if b < wp.static(mounted):
            angle, speed = led_at(ensemble, shared, mine, b, step)
            pose.exact_speed = speed
        if wp.static(moving):
            shared.mounts[b] = ensemble.mounts[own.first_body + mine.number]
        share_hub(ensemble, shared, mine.variant, mine.row, b)
        if b < wp.static(sprockets):
            at = drive.first_sprocket + b
            of.share_sprocket(ensemble, shared, drive, b, leading(pose.center))
            if wp.static(measuring):
                shared.sprocket_sums[b] = sums.sprocket[at]
                if wp.static(moving):
                    shared.mount_sums[b] = sums.mount[at]
        of.put_pose(shared, b, pose)

    @wp.func
    def end_body(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: Mine):
        """Puts the thread's body and its sums back into the state."""
        drive = ensemble.drives[mine.variant]
        b = mine.body
        body = state_of(shared.poses[b])
        body.angle = trimmed(body.angle)
        body.speed = trimmed(body.speed)
        body.center = trimmed(body.center)
        body.velocity = trimmed(body.velocity)
        state.bodies[ensemble.drives[mine.row].first_body + mine.number] = body
        if wp.static(measuring):
            if b < wp.static(sprockets):
                at = drive.first_sprocket + b
                sums.sprocket[at] = gathered_powers(shared.sprocket_sums[b])
                if wp.static(moving):
                    sums.mount[at] = shared.mount_sums[b]

    @wp.func
    def body_gone(shared: Shared, mine: Mine):
        """1 where the thread's body does not turn soundly, or its center has left the drive's box."""
        pose, box = shared.poses[mine.body], 2 * (mine.row - mine.variant)
        gone = int(not has_finite_rotation(pose.angle, pose.speed))
        if wp.static(moving):
            gone = wp.max(gone, int(not is_in_box(shared.box[box], shared.box[box + 1], leading(pose.center))))
        return gone

    @wp.func
    def align(shared: Shared, b: int):
        """Makes body b head where its angle says."""
        of.put_pose(shared, b, aligned_pose(shared.poses[b]))

    return SimpleNamespace(**locals())


@cache
def gathering(kind: BlockKind) -> SimpleNamespace:
    """The functions that gather moments on the bodies of a train (`physics.train`)."""
    Real, kinds = kind.Real, kind.types
    Ensemble, Shared, Now = kinds.Ensemble, kinds.Shared, kinds.Now
    step_number = prescribed_motion(kind).step_number

    @wp.func
    def against_valves(shared: Shared, mine: Mine, now: Now, b: int, moment: Real):
        """The moment [N m] that turns body b, of its constant inertia, from that of all but valves."""
        cam, kick, own = kinds.Cam(), Real(0.0), shared.motions[b]
        for other in range(wp.static(kind.parts.mounted)):
            motion = shared.motions[other]
            if motion.train == own.train:
                cam = add_geared_cam(cam, shared.cams[other], quotient(motion.ratio, own.ratio))
        if wp.static(not kind.staged):
            kick = Real(2.0) * leapfrog_lag(now.step, leading(step_number(mine)))
        return constant_inertia_moment(moment, leading(shared.poses[b].speed), kick, cam, own)

    @wp.func
    def gathered(shared: Shared, mine: Mine, now: Now, b: int):
        """The moment [N m] that turns body b of a tied drive as if it turned alone (`physics.train`)."""
        own, total = shared.motions[b], Real(0.0)
        for other in range(wp.static(kind.parts.mounted)):
            motion = shared.motions[other]
            if motion.train == own.train:
                total = total + motion.ratio * shared.passed[other]
        moment = quotient(total, own.ratio)
        if wp.static(kind.parts.valves > 0):
            moment = against_valves(shared, mine, now, b, moment)
        return moment

    @wp.func
    def rates_now(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, b: int):
        """Angular velocity [rad/s] and acceleration [rad/s^2] of body b at the step's instant."""
        pose, motion = shared.poses[b], shared.motions[b]
        speed, angular = leading(pose.speed), gathered(shared, mine, now, b) * motion.inverse_inertia
        if wp.static(kind.integrator == 0):
            lag = leapfrog_lag(now.step, leading(step_number(mine)))
            speed = wp.where(motion.prescribed == 1, pose.exact_speed, speed + lag * angular)
        if motion.prescribed == 1:
            angular = prescribed_acceleration(counted(now.step, step_number(mine)), motion, ensemble)
        return speed, angular

    return SimpleNamespace(**locals())


@cache
def body_steps(kind: BlockKind) -> SimpleNamespace:
    """The functions that take the thread's body a step, or a stage, on."""
    Real, moving, staged = kind.Real, kind.moving, kind.staged
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose
    Wrench = kinds.Wrench
    of, access, motions = contact_geometry(kind), body_access(kind), prescribed_motion(kind)
    vec2, gathered = kinds.vec2, gathering(kind).gathered
    state_of, heading, step_number = access.state_of, access.heading, motions.step_number
    of_joints, of_three = access.of_joints, wp.types.vector(3, Real)
    # a load is found ahead by threads that else would wait for the contacts of others
    loading_ahead = (
        not staged and not kind.parts.tied and (kind.shape.body_warp or (kind.shape.threads > WARP and not kind.paired))
    )

    @wp.func
    def mount_of(shared: Shared, b: int):
        """The mount of body b."""
        mount = kinds.Mount()
        if wp.static(moving):
            mount = shared.mounts[b]
            if wp.static(kind.parts.tabulated == 0):
                mount.x_table.cells = 0  # so that the compiler knows
                mount.y_table.cells = 0
        return mount

    @wp.func
    def off(pose: Pose, mount: kinds.Mount):
        """A body's center from where it is at home [m], where that is asked."""
        if wp.static(moving):
            return displacement_from_home(pose.center, mount)
        else:
            return vec2()

    @wp.func
    def time_of(mine: Mine, now: Now):
        """The instant of a step [s]."""
        return counted(now.step, step_number(mine))

    @wp.func
    def rounded_time(mine: Mine, now: Now):
        """The same, rounded: without the work that it takes exactly."""
        return Real(now.step) * leading(step_number(mine))

    @wp.func
    def load_on(ensemble: Ensemble, shared: Shared, mine: Mine, rounded: Real, time: Any, pose: Pose):
        """Moment on the thread's body [N m] of its load, or of an arm's own springs and weight.

        Of a prescribed body too, and thrown away, so that the threads of a warp do not part.
        """
        motion = shared.motions[mine.body]
        tabulated = Real(0.0)
        if wp.static(kind.parts.tabulated > 0):
            if motion.load_table.cells > 0:
                x = load_table_argument(time, pose.angle, motion)
                tabulated = table_value(x, motion.load_table, ensemble.tables)
        load = free_load_moment(rounded, tabulated, pose.angle, pose.speed, motion, ensemble)
        if wp.static(kind.parts.arms > 0):
            if mine.arm >= 0:
                arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
                load = arm_own_moment(plain_body(state_of(pose)), heading(pose), arm)
                if wp.static(kind.parts.jointed):
                    if ensemble.drives[mine.row].jointed != 0:
                        load = pose.load  # as `jointed.couple` has found it
        return wp.where(motion.prescribed == 1, Real(0.0), load)

    @wp.func
    def turning(shared: Shared, mine: Mine, now: Now, wrench: Wrench):
        """The wrench that moves the thread's body, with what others pass on to it."""
        if wp.static(kind.parts.tied > 0):
            if mine.arm < 0:
                wrench.moment = gathered(shared, mine, now, mine.body)
                wrench.load = Real(0.0)
        return wrench

    @wp.func
    def load_moment_ahead(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now):
        """Works out the load on the thread's body, while other threads are at their contacts."""
        if wp.static(loading_ahead):
            pose = shared.poses[mine.body]
            rounded, time = rounded_time(mine, now), time_of(mine, now)
            shared.poses[mine.body].load = load_on(ensemble, shared, mine, rounded, time, pose)

    @wp.func
    def joined(shared: Shared, mine: Mine, rates: of_three):
        """Accelerations of the thread's body, those of an arm with the arms beside it (`jointed.couple`)."""
        if wp.static(kind.parts.jointed):
            if mine.arm >= 0:
                rates[2] = of_joints(shared, mine.arm, ANGULAR)
        return rates

    @wp.func
    def with_bearing(wrench: Wrench):
        """A wrench whose load has the bearings' moment."""
        if wp.static(kind.parts.hubs > 0):
            wrench.load = wrench.load + wrench.bearing
        return wrench

    @wp.func
    def leapfrog(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, pose: Pose, wrench: Wrench):
        """Takes the thread's body one step on if the run goes on; returns it with its rates at the step's instant, and
        `wrench` with its load.
        """
        b = mine.body
        h = leading(step_number(mine))
        motion, mount = shared.motions[b], mount_of(shared, b)
        time = time_of(mine, now)
        wrench.load = pose.load
        if wp.static(not loading_ahead and not kind.parts.tied):
            wrench.load = load_on(ensemble, shared, mine, rounded_time(mine, now), time, pose)
        body = state_of(pose)
        plain = plain_body(body)
        if wp.static(moving):
            plain.speed = wp.where(motion.prescribed == 1, pose.exact_speed, plain.speed)
        moved_by = turning(shared, mine, now, with_bearing(wrench))
        rates = body_accelerations(time, off(pose, mount), plain, heading(pose), moved_by, motion, mount, ensemble)
        rates = joined(shared, mine, rates)
        lag = leapfrog_lag(now.step, h)
        seen = body_at_time(time, lag, body, rates, pose.exact_speed, motion, mount, ensemble)
        if now.going != 0:
            ahead = plan_at(mine.course, now.step + 1)  # not used where the angle is free
            kick, angle = leapfrog_kick(now.step, h), shared.led_angle[ahead]
            moved = leapfrog_body(kick, h, body, rates, angle, motion, mount)
            moved = move_prescribed_center(time + step_number(mine), h, moved, mount, ensemble)
            moved = body_with_accelerations(body, moved, rates, kick, motion, mount)
            pose.exact_speed = shared.led_speed[ahead]
            of.put_pose(shared, b, turned_pose(pose_with_coordinates(pose, moved), difference(moved.angle, body.angle)))
        return seen, wrench

    @wp.func
    def runge_kutta(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now, pose: Pose, wrench: Wrench):
        """Takes the thread's body to where the next stage evaluates it, if the run goes on; returns it as it was, and
        `wrench` with its load.
        """
        b = mine.body
        motion, mount = shared.motions[b], mount_of(shared, b)
        at = stage_at(wp.static(kind.integrator), now.stage, time_of(mine, now), step_number(mine))
        body = state_of(pose)
        plain = plain_body(body)
        wrench.load = load_on(ensemble, shared, mine, leading(at.time), at.time, pose)
        if now.going != 0:
            place = 2 * (ensemble.drives[mine.row].first_body + mine.number)
            by, to = turning(shared, mine, now, with_bearing(wrench)), heading(pose)
            rates = body_accelerations(at.time, off(pose, mount), plain, to, by, motion, mount, ensemble)
            rates = joined(shared, mine, rates)
            start, summed = state.body_stages[place], state.body_stages[place + 1]
            moved, base, slopes = stage_body(at, body, start, summed, rates, motion, mount, ensemble)
            state.body_stages[place] = base
            state.body_stages[place + 1] = slopes
            of.put_pose(shared, b, aligned_pose(pose_with_coordinates(pose, moved)))
        return plain, wrench

    @wp.func
    def advance(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now, pose: Pose, wrench: Wrench):
        """Takes the thread's body, now at `pose`, on by a step, or a stage.

        Returns it with its rates at the step's instant, and `wrench` with its load.
        """
        if wp.static(staged):
            return runge_kutta(ensemble, state, shared, mine, now, pose, wrench)
        else:
            return leapfrog(ensemble, shared, mine, now, pose, wrench)

    return SimpleNamespace(**locals())


@cache
def block_bearings(kind: BlockKind) -> SimpleNamespace:
    """The functions of the bearings of one variant's sprockets on a block; nothing where none rubs or is on an arm."""
    Real, sprockets, hubs = kind.Real, kind.parts.sprockets, kind.parts.hubs
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Wrench = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Wrench
    barrier, carry = sync(kind).barrier, body_access(kind).carry
    stretched_now = roller_rows(kind).stretched

    @wp.func
    def rub(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now, wrench: Wrench):
        """`wrench`, of the chain on the thread's body, with the moment of bearings on it; all threads together."""
        if wp.static(hubs > 0):
            s = mine.body
            if s >= 0 and s < wp.static(sprockets):
                hub = shared.hubs[s]
                at = ensemble.drives[mine.variant].first_sprocket + s
                turning = leading(shared.poses[s].speed)
                if hub.arm != GROUND:
                    turning = rounded(difference(shared.poses[s].speed, shared.poses[hub.arm].speed))
                stretched = stretched_now(now)
                moment, holds = bearing_moment(wrench.force, turning, Real(state.hub_hold[at]), hub, stretched)
                shared.bearings[s] = moment
                if now.stage == 0:
                    state.hub_hold[at] = wp.float64(holds)
            barrier()
            wrench.bearing = bearing_on(shared, mine)
        return wrench

    @wp.func
    def bearing_on(shared: Shared, mine: Mine):
        """Moment of bearings on the thread's body [N m]: on an arm, of all sprockets that it carries."""
        moment = Real(0.0)
        for s in range(wp.static(sprockets)):
            if s == mine.body:
                moment = moment + shared.bearings[s]
            if shared.hubs[s].arm == mine.body and mine.body >= 0:
                moment = moment - shared.bearings[s]
        return moment

    @wp.func
    def go_along(shared: Shared, mine: Mine, now: Now):
        """Adds up what the bearing of the thread's sprocket takes, and takes that along with its arm; all threads
        together, once all bodies are a step or a stage on.
        """
        if wp.static(hubs > 0):
            barrier()
            s = mine.sprocket
            if wp.static(kind.measuring):
                if s >= 0 and now.measured != 0:
                    turning = shared.turning[s]
                    if shared.hubs[s].arm != GROUND:
                        turning = turning - shared.turning[shared.hubs[s].arm]
                    power = -shared.bearings[s] * turning
                    shared.mount_sums[s] = add_bearing(shared.mount_sums[s], power, now.weight)
            if now.going != 0:
                carry(shared, s)

    return SimpleNamespace(**locals())
