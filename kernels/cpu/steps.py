"""Forces of one variant at one instant, and a step of each integrator, over its rollers and its bodies."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import Stage
from ..native import accessors
from ..physics.body import (
    arm_own_moment,
    body_accelerations,
    body_at_time,
    body_with_accelerations,
    has_finite_rotation,
    heading_of,
    is_in_box,
    leapfrog_body,
    move_prescribed_center,
    pose_of,
    stage_body,
)
from ..physics.hub import bearing_moment, carried_body, moment_about_pivot
from ..physics.link import has_uneven_links
from ..physics.motion import load_moment, prescribed_acceleration, prescribed_rotation
from ..physics.mount import displacement_from_home
from ..physics.tensioner import advance_tensioner, extension_and_rate, supply_pressure, tensioner_push
from ..physics.train import coupling_moment, coupling_state, coupling_twist, motor_moment
from ..physics.valve import add_cam, add_cam_load, add_geared_cam, cam_lift, constant_inertia_moment, zero_valve_load
from ..structs import GROUND, BodyState, Cam, Drive, Wrench, types
from ..sums import add_flows
from .contact_pairs import contact_pairs, nearness, with_reaction
from .jointed import carrier_of, jointed
from .joints import joint_passes
from .neighbor_list import neighbor_list
from .rollers import passes, rows


@wp.func
def arm_of(drive: Drive, b: int):
    """Which arm of all body `b` of all is; negative for other bodies."""
    place = b - drive.first_body - (drive.bodies - drive.arms)
    return wp.where(place >= 0, drive.first_arm + place, -1)


@cache
def hanging(Real: type) -> SimpleNamespace:
    """The functions of sprockets on arms, and of their bearings (`physics.hub`)."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def hang(ensemble: Ensemble, state: State, drive: Drive, stage: int, stretched: wp.float64):
        """Adds to the wrenches on arms what sprockets on them pass on, and to all what their bearings do."""
        for s in range(drive.sprockets):
            hub = ensemble.hubs[drive.first_sprocket + s]
            b = drive.first_body + s
            arm = drive.first_body + hub.arm
            turning = state.poses[b].speed
            force = state.wrenches[b].force
            if hub.arm != GROUND:
                lever = state.poses[b].center - state.poses[arm].center
                state.wrenches[arm] = with_reaction(state.wrenches[arm], force, moment_about_pivot(lever, force))
                turning = turning - state.poses[arm].speed
            if hub.bearing > wp.float64(0.0):
                held = state.hub_hold[drive.first_sprocket + s]
                moment, holds = bearing_moment(force, turning, held, hub, stretched)
                state.wrenches[b].bearing = moment
                if hub.arm != GROUND:
                    state.wrenches[arm].bearing = state.wrenches[arm].bearing - moment
                if stage == 0:
                    state.hub_hold[drive.first_sprocket + s] = holds
        if drive.jointed != 0:
            for a in range(drive.arms):
                b = drive.first_body + drive.bodies - drive.arms + a
                on = carrier_of(drive, ensemble.arms[drive.first_arm + a].on)
                if on >= 0:
                    force = state.wrenches[b].force
                    moment = moment_about_pivot(state.poses[b].center - state.poses[on].center, force)
                    state.wrenches[on] = with_reaction(state.wrenches[on], force, moment)

    @wp.func
    def carry(ensemble: Ensemble, state: State, drive: Drive):
        """Takes the arms and the sprockets on arms along, once these have moved."""
        if drive.jointed != 0:
            for a in range(drive.arms):
                joint = ensemble.arms[drive.first_arm + a]
                on = carrier_of(drive, joint.on)
                if on >= 0:
                    mine = drive.first_body + drive.bodies - drive.arms + a
                    state.bodies[mine] = carried_body(state.bodies[mine], pose_of(state.bodies[on]), joint)
        for s in range(drive.sprockets):
            hub = ensemble.hubs[drive.first_sprocket + s]
            if hub.arm != GROUND:
                b = drive.first_body + s
                arm = pose_of(state.bodies[drive.first_body + hub.arm])
                state.bodies[b] = carried_body(state.bodies[b], arm, hub)

    return SimpleNamespace(**locals())


@cache
def loading(Real: type) -> SimpleNamespace:
    """The functions that find the moments on the bodies of one variant of an ensemble."""
    kinds, joints = types(Real), jointed(Real)
    turned, joints_on = joints.turned, joints.joints_on
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def wrench_on(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """The wrench of contacts and tensioners on body `b` of all."""
        wrench = state.wrenches[b]
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            if drive.first_body + ensemble.tensioners[t].body == b:
                wrench = with_reaction(wrench, state.pushes[t].thrust, state.pushes[t].moment)
        return wrench

    @wp.func
    def load_on(ensemble: Ensemble, state: State, drive: Drive, body: BodyState, b: int, time: wp.float64):
        """Moment [N m] of what loads body `b` of all, or of an arm's own spring and weight."""
        load = load_moment(time, body.angle, body.speed, ensemble.motions[b], ensemble)
        arm = arm_of(drive, b)
        if arm >= 0:
            load = arm_own_moment(body, heading_of(body), ensemble.arms[arm])
            if drive.jointed != 0:
                a = arm - drive.first_arm
                seen = turned(ensemble, state, drive, a, body)
                load = arm_own_moment(seen, heading_of(body), ensemble.arms[arm])
                load = load + joints_on(ensemble, state, drive, a)
        return load

    @wp.func
    def motor_on(ensemble: Ensemble, state: State, drive: Drive, b: int, time: wp.float64):
        """Moment [N m] of the motor on body `b` of all."""
        moment = wp.float64(0.0)
        shaft = b - drive.first_body - drive.sprockets
        if shaft >= 0 and shaft < drive.shafts:
            body, motion, motor = state.bodies[b], ensemble.motions[b], ensemble.motors[drive.first_shaft + shaft]
            moment = motor_moment(time, body.angle, body.speed, motor, motion, ensemble.tables)
        return moment

    @wp.func
    def coupled(ensemble: Ensemble, state: State, drive: Drive, c: int):
        """Twist [rad] of coupling `c` of all, and the moment [N m] that it takes from its first body."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first, second = (
            state.bodies[drive.first_body + coupling.first],
            state.bodies[drive.first_body + coupling.second],
        )
        twist, rate = coupling_twist(first, second, engaged)
        return twist, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def engage(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64):
        """Takes all couplings on to a step's start."""
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling = ensemble.couplings[c]
            first = state.bodies[drive.first_body + coupling.first]
            second = state.bodies[drive.first_body + coupling.second]
            tables = ensemble.tables
            state.couplings[c] = coupling_state(time, first, second, state.couplings[c], coupling, tables)

    @wp.func
    def pass_on(ensemble: Ensemble, state: State, drive: Drive, stage: int, time: wp.float64):
        """The moments on all bodies but arms, with those of motors and couplings."""
        if stage == 0:
            engage(ensemble, state, drive, time)
        for b in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
            wrench = wrench_on(ensemble, state, drive, b)
            moment = wrench.moment + wrench.bearing + load_on(ensemble, state, drive, state.bodies[b], b, time)
            state.passed[b] = moment + motor_on(ensemble, state, drive, b, time)
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling = ensemble.couplings[c]
            first, second = drive.first_body + coupling.first, drive.first_body + coupling.second
            twist, moment = coupled(ensemble, state, drive, c)
            state.passed[first] = state.passed[first] - moment
            state.passed[second] = state.passed[second] + state.couplings[c].ratio * moment
        if drive.valves > 0:
            lift_valves(ensemble, state, drive)

    @wp.func
    def lift_valves(ensemble: Ensemble, state: State, drive: Drive):
        """Finds inertias and moments of the valves on all bodies."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.cams[b] = Cam()
        for v in range(drive.first_valve, drive.first_valve + drive.valves):
            valve = ensemble.valves[v]
            b = drive.first_body + valve.body
            for k in range(valve.phases):
                at = cam_lift(state.bodies[b].angle, k, valve, ensemble.motions[b], ensemble.tables)
                state.cams[b] = add_cam(state.cams[b], at, valve)

    @wp.func
    def cam_on(ensemble: Ensemble, state: State, begin: int, count: int, b: int):
        """Inertia and moment of a train's valves, as its body `b` has them; it is among `count` bodies from `begin`."""
        cam, mine = Cam(), ensemble.motions[b]
        for other in range(begin, begin + count):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                cam = add_geared_cam(cam, state.cams[other], motion.ratio / mine.ratio)
        return cam

    @wp.func
    def kick_of(drive: Drive, time: wp.float64):
        """Step that leapfrog takes from the speed before `time`, 0 where the speed is that of the instant [s]."""
        return wp.where(drive.integrator == 0 and time > wp.float64(0.0), drive.step, wp.float64(0.0))

    @wp.func
    def against_valves(ensemble: Ensemble, state: State, drive: Drive, b: int, moment: wp.float64, time: wp.float64):
        """The moment that turns body `b` of all, of its constant inertia, from that of all but valves."""
        cam = cam_on(ensemble, state, drive.first_body, drive.sprockets + drive.shafts, b)
        return constant_inertia_moment(moment, state.bodies[b].speed, kick_of(drive, time), cam, ensemble.motions[b])

    @wp.func
    def gathered(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """The moment that turns body `b` of all as if it turned alone (a)."""
        total = wp.float64(0.0)
        mine = ensemble.motions[b]
        for other in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
            motion = ensemble.motions[other]
            if motion.train == mine.train:
                total = total + motion.ratio * state.passed[other]
        return total / mine.ratio

    return SimpleNamespace(**locals())


@cache
def moving(Real: type) -> SimpleNamespace:
    """The functions that move the bodies of one variant of an ensemble, and observe them."""
    kinds, carry, couple = types(Real), hanging(Real).carry, jointed(Real).couple
    loads = loading(Real)
    wrench_on, load_on, motor_on, gathered = loads.wrench_on, loads.load_on, loads.motor_on, loads.gathered
    coupled, pass_on, against_valves = loads.coupled, loads.pass_on, loads.against_valves
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def rates_of(ensemble: Ensemble, state: State, drive: Drive, b: int, time: wp.float64):
        """Accelerations of body `b` of all, from what contacts and tensioners do to it."""
        body = state.bodies[b]
        heading = wp.vec2d(state.poses[b].cosine, state.poses[b].sine)
        wrench = wrench_on(ensemble, state, drive, b)
        motion = ensemble.motions[b]
        mount = ensemble.mounts[b]
        wrench.load = load_on(ensemble, state, drive, body, b, time)
        state.wrenches[b].load = wrench.load
        wrench.load = wrench.load + wrench.bearing
        if drive.tied != 0 and motion.train >= 0 and motion.apart == 0:
            wrench.moment = gathered(ensemble, state, drive, b)
            wrench.load = wp.float64(0.0)
            if drive.valves > 0:
                wrench.moment = against_valves(ensemble, state, drive, b, wrench.moment, time)
        off = displacement_from_home(body.center, mount)
        return body_accelerations(time, off, body, heading, wrench, motion, mount, ensemble)

    @wp.func
    def find_rates(ensemble: Ensemble, state: State, drive: Drive, stage: int, time: wp.float64):
        """Accelerations of all bodies at a stage and its `time`, for whatever moves or observes them."""
        if drive.tied != 0:
            pass_on(ensemble, state, drive, stage, time)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.rates[b] = rates_of(ensemble, state, drive, b, time)
        if drive.jointed != 0:
            lag = wp.float64(0.0)
            if drive.integrator == 0 and time > lag:
                lag = wp.float64(0.5) * drive.step
            for a in range(drive.arms):
                couple(ensemble, state, drive, a, lag)

    @wp.func
    def bearing_power(ensemble: Ensemble, state: State, drive: Drive, s: int, time: wp.float64, lag: wp.float64):
        """Power [W] that the bearing of sprocket s takes."""
        hub = ensemble.hubs[drive.first_sprocket + s]
        turning = body_now(ensemble, state, drive.first_body + s, time, lag).speed
        if hub.arm != GROUND:
            turning = turning - body_now(ensemble, state, drive.first_body + hub.arm, time, lag).speed
        return -state.wrenches[drive.first_body + s].bearing * turning

    @wp.func
    def feed(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64):
        """Finds what tabulated supplies of tensioners have at a step's start, before bodies move."""
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            if tensioner.supply_table.cells > 0:
                pump = drive.first_body + tensioner.pump
                forward = ensemble.motions[pump].sign * state.poses[pump].speed
                state.tensioners[t].supply = supply_pressure(time, forward, tensioner, ensemble.tables)

    @wp.func
    def flow(ensemble: Ensemble, state: State, drive: Drive):
        """Takes all tensioners a step on, once the bodies have moved; the meters count their flows."""
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            x, rate = extension_and_rate(pose_of(state.bodies[drive.first_body + tensioner.body]), tensioner)
            if tensioner.supply_table.cells > 0:
                tensioner.supply = state.tensioners[t].supply
            after, flows = advance_tensioner(x, rate, drive.step, True, state.tensioners[t], tensioner)
            state.tensioners[t] = after
            state.meters[t] = add_flows(state.meters[t], flows)

    @wp.func
    def leapfrog_bodies(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64, kick: wp.float64):
        """All bodies a step after `time`."""
        feed(ensemble, state, drive, time)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            motion, mount, rates, body = ensemble.motions[b], ensemble.mounts[b], state.rates[b], state.bodies[b]
            ahead = wp.float64(0.0)
            if motion.prescribed == 1:
                ahead, speed = prescribed_rotation(time + drive.step, motion, ensemble)
            moved = leapfrog_body(kick, drive.step, body, rates, ahead, motion, mount)
            moved = move_prescribed_center(time + drive.step, drive.step, moved, mount, ensemble)
            state.bodies[b] = body_with_accelerations(body, moved, rates, kick, motion, mount)
        if drive.hubs != 0:
            carry(ensemble, state, drive)
        flow(ensemble, state, drive)

    @wp.func
    def stage_bodies(ensemble: Ensemble, state: State, drive: Drive, at: Stage):
        """All bodies after a stage."""
        if at.number == 0:
            feed(ensemble, state, drive, at.time)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body, base, slopes = stage_body(
                at,
                state.bodies[b],
                state.body_stages[2 * b],
                state.body_stages[2 * b + 1],
                state.rates[b],
                ensemble.motions[b],
                ensemble.mounts[b],
                ensemble,
            )
            state.bodies[b] = body
            state.body_stages[2 * b] = base
            state.body_stages[2 * b + 1] = slopes
        if drive.hubs != 0:
            carry(ensemble, state, drive)
        if at.last == 1:
            flow(ensemble, state, drive)

    @wp.func
    def body_now(ensemble: Ensemble, state: State, b: int, time: wp.float64, lag: wp.float64):
        """Body `b` of all with its rates at `time`, `lag` after their own instant; its accelerations are found."""
        motion = ensemble.motions[b]
        driven = wp.float64(0.0)
        if motion.prescribed == 1:
            angle, driven = prescribed_rotation(time, motion, ensemble)
        body, rates, mount = state.bodies[b], state.rates[b], ensemble.mounts[b]
        return body_at_time(time, lag, body, rates, driven, motion, mount, ensemble)

    @wp.func
    def coupled_now(ensemble: Ensemble, state: State, drive: Drive, c: int, time: wp.float64, lag: wp.float64):
        """Twist [rad] of coupling `c` of all, its rate [rad/s] and its moment [N m] with the rates of `time`."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first = body_now(ensemble, state, drive.first_body + coupling.first, time, lag)
        second = body_now(ensemble, state, drive.first_body + coupling.second, time, lag)
        twist, rate = coupling_twist(first, second, engaged)
        return twist, rate, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def angular_now(ensemble: Ensemble, state: State, b: int, time: wp.float64):
        """Angular acceleration of body `b` of all at `time` [rad/s^2], once rates are found."""
        angular = state.rates[b][2]
        if ensemble.motions[b].prescribed == 1:
            angular = prescribed_acceleration(time, ensemble.motions[b], ensemble)
        return angular

    @wp.func
    def lifted(ensemble: Ensemble, state: State, drive: Drive, v: int, time: wp.float64, lag: wp.float64):
        """Torque [N m] of group `v` of all valves against forward rotation, and the least force [N] on a follower."""
        valve = ensemble.valves[v]
        b = drive.first_body + valve.body
        body, angular = body_now(ensemble, state, b, time, lag), angular_now(ensemble, state, b, time)
        load = zero_valve_load(valve)
        for k in range(valve.phases):
            at = cam_lift(body.angle, k, valve, ensemble.motions[b], ensemble.tables)
            load = add_cam_load(load, at, body.speed, angular, valve)
        return load[0], load[1]

    @wp.func
    def bodies_sound(state: State, drive: Drive):
        """1 while every body turns soundly and its center is within the drive's box, else 0."""
        good = int(1)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = state.bodies[b]
            if not (is_in_box(drive.low, drive.high, body.center) and has_finite_rotation(body.angle, body.speed)):
                good = int(0)
        return good

    return SimpleNamespace(**locals())


@cache
def evaluating(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that evaluate the forces of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    link_pass, see_bodies = passes(Real, capacity).link_pass, nearness(Real, capacity).see_bodies
    evaluate_all = contact_pairs(Real, capacity).evaluate_all
    clear, row = passes(Real, capacity).clear, rows(capacity)
    hang = hanging(Real).hang
    joints = joint_passes(Real, capacity)

    @wp.func
    def pull(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Forces of links and joints on rollers, and of tensioners, after poses of bodies."""
        n = drive.rollers
        see_bodies(state, drive)
        rubs = chain.joint.inertia > Real(0.0)
        if has_uneven_links(chain) or rubs:
            joints.pull_links(w, n, chain)
        else:
            link_pass(w, n, chain)
        if rubs:
            joints.rub_joints(w, n, chain, memory)
            joints.bend_links(w, n)
        if memory.wanted.sizes != 0:
            clear(w, row.sprocket_force, row.guide_force, n)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            pushed = state.poses[drive.first_body + tensioner.body]
            state.pushes[t] = tensioner_push(pushed, memory.stage == 0, state.tensioners[t], tensioner)

    @wp.func
    def push(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Forces of contacts on rollers, and their wrenches on bodies."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.wrenches[b] = Wrench()
        evaluate_all(ensemble, state, drive, w, memory)
        if drive.hubs != 0:
            hang(ensemble, state, drive, memory.stage, wp.float64(memory.stretched))

    return SimpleNamespace(**locals())


@cache
def stepping(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that take one variant a step on, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    part = passes(Real, capacity)
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    leapfrog_bodies, stage_bodies = moving(Real).leapfrog_bodies, moving(Real).stage_bodies
    invalidate = neighbor_list(Real, capacity).invalidate
    acceleration, kick_drift, move = part.acceleration, part.kick_drift, part.move
    row = rows(capacity)

    @wp.func
    def leapfrog(
        ensemble: Ensemble,
        state: State,
        drive: Drive,
        chain: Chain,
        w: wp.array[Real],
        time: wp.float64,
        kick: wp.float64,
    ):
        """One step from evaluated forces; `kick` is h, or h / 2 from the initial state."""
        leapfrog_bodies(ensemble, state, drive, time, kick)
        kick_drift(w, drive.rollers, chain, Real(kick), Real(drive.step))
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            if ensemble.mounts[b].active != 0 or ensemble.mounts[b].moves != 0:
                invalidate(w, state.bodies[b].velocity)

    @wp.func
    def stage_rollers(w: wp.array[Real], n: int, chain: Chain, at: Stage):
        """Adds this stage's slopes to the sums, and goes along them from the step's start, or along the sums."""
        weight = Real(at.weight)
        reach = Real(at.reach)
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load_row(w, row.vx + i)
            vy = load_row(w, row.vy + i)
            if at.number == 0:
                for k in range(6):
                    store_row(w, row.x0 + k * wp.static(capacity) + i, load_row(w, row.x + k * wp.static(capacity) + i))
                for k in range(4):
                    store_row(w, row.sum_x + k * wp.static(capacity) + i, Real(0.0))
            store_row(w, row.sum_x + i, load_row(w, row.sum_x + i) + weight * vx)
            store_row(w, row.sum_y + i, load_row(w, row.sum_y + i) + weight * vy)
            store_row(w, row.sum_vx + i, load_row(w, row.sum_vx + i) + weight * a[0])
            store_row(w, row.sum_vy + i, load_row(w, row.sum_vy + i) + weight * a[1])
            for k in range(6):
                store_row(w, row.x + k * wp.static(capacity) + i, load_row(w, row.x0 + k * wp.static(capacity) + i))
            if at.last == 1:
                move(w, i, load_row(w, row.sum_x + i), load_row(w, row.sum_y + i))
                store_row(w, row.vx + i, load_row(w, row.vx + i) + load_row(w, row.sum_vx + i))
                store_row(w, row.vy + i, load_row(w, row.vy + i) + load_row(w, row.sum_vy + i))
            else:
                move(w, i, reach * vx, reach * vy)
                store_row(w, row.vx + i, load_row(w, row.vx + i) + reach * a[0])
                store_row(w, row.vy + i, load_row(w, row.vy + i) + reach * a[1])
            i = i + 1

    @wp.func
    def take_stage(ensemble: Ensemble, state: State, drive: Drive, chain: Chain, w: wp.array[Real], at: Stage):
        """A stage of a step, from evaluated forces; the last ends the step."""
        stage_bodies(ensemble, state, drive, at)
        stage_rollers(w, drive.rollers, chain, at)

    return SimpleNamespace(**locals())
