"""Shafts, gears, couplings and motors on blocks: what bodies pass on to each other before any of them moves.

Lifts of the cams of valves are worked out a thread each; what valves do goes to the bodies that they are on.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..integrate import stage_at
from ..number import add, difference, leading, rounded  # noqa: F401
from ..physics.motion import load_moment_at_speed
from ..physics.train import (
    coupling_energy,
    coupling_loss,
    coupling_moment,
    coupling_state,
    coupling_twist,
    is_on_gear_side,
    motor_moment,
)
from ..physics.valve import add_cam, add_cam_load, cam_lift, zero_valve_load
from ..structs import GROUND, Drive
from ..sums import add_coupling, add_energy, add_gear, add_shaft, add_valve
from .bodies import body_steps, gathering
from .events import block_sampling
from .kind import ENDS, FRAME, START, BlockKind, Mine, inlined
from .rings import block_rings
from .sync import sync


@cache
def block_trains(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The functions of one variant's trains on a block; frames lie as `frame` says (`frames.frame_writers`)."""
    Real, sprockets, mounted, measuring = kind.Real, kind.parts.sprockets, kind.parts.mounted, kind.measuring
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    Wrench = kinds.Wrench
    steps, sampling = body_steps(kind), block_sampling(kind, frame)
    rates_now, cams, barrier = gathering(kind).rates_now, block_cams(kind, frame), sync(kind).barrier
    body_of, place_of = block_rings(kind).body_of, block_rings(kind).place_of

    @wp.func
    def moment_of(ensemble: Ensemble, mine: Mine, time: Any, shared: Shared):
        """Moment [N m] of the motor on the thread's body."""
        moment = Real(0.0)
        if mine.body >= wp.static(sprockets) and mine.body < wp.static(mounted):
            drive = ensemble.drives[mine.row]
            at = drive.first_shaft + mine.number - drive.sprockets
            pose, motion = shared.poses[mine.body], shared.motions[mine.body]
            moment = motor_moment(time, pose.angle, pose.speed, ensemble.motors[at], motion, ensemble.tables)
        return moment

    @wp.func
    def coupled(ensemble: Ensemble, shared: Shared, mine: Mine, c: int):
        """Coupling c of all, which is of the chain of the thread's body, and its bodies on the block, or the ground."""
        coupling, row, ring = ensemble.couplings[c], mine.row, mine.row - mine.variant
        first = body_of(ensemble, shared, row, ring, coupling.first)
        return coupling, first, body_of(ensemble, shared, row, ring, coupling.second)

    @wp.func
    def engage(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, c: int, time: Any):
        """State of coupling c of all from the step's start on; both bodies' threads find it, before either moves."""
        coupling, one, other = coupled(ensemble, shared, mine, c)
        first, second = shared.poses[wp.max(one, 0)], shared.poses[other]
        return coupling_state(time, first, second, state.couplings[c], coupling, ensemble.tables)

    @wp.func
    def pass_on(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, now: Now, wrench: Wrench):
        """Shares the moment on the thread's body, with that of load, motor and couplings; bodies stand still.

        `wrench` has the tensioners'; what arms share nobody takes.
        """
        time = steps.time_of(mine, now)
        if wp.static(kind.staged):
            time = stage_at(wp.static(kind.integrator), now.stage, time, steps.step_number(mine)).time
        pose = shared.poses[mine.body]
        load = steps.load_on(ensemble, shared, mine, leading(time), time, pose)
        shared.poses[mine.body].load = load
        moment = wrench.moment + load + moment_of(ensemble, mine, time, shared)
        if wp.static(kind.parts.hubs > 0):
            moment = moment + wrench.bearing
        drive = ensemble.drives[mine.row]
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling, one, other = coupled(ensemble, shared, mine, c)
            if one == mine.body or other == mine.body:
                engaged = state.couplings[c]
                if now.stage == 0:
                    engaged = engage(ensemble, state, shared, mine, c, time)
                twist, rate = coupling_twist(shared.poses[wp.max(one, 0)], shared.poses[other], coupling, engaged)
                passed = coupling_moment(twist, rate, coupling, engaged)
                moment = moment + wp.where(other == mine.body, engaged.ratio * passed, -passed)
        shared.passed[mine.body] = moment
        if wp.static(kind.parts.valves > 0):
            cams.lift_valves(ensemble, shared, mine)

    @wp.func
    def observe_shaft(ensemble: Ensemble, shared: Shared, out: Out, mine: Mine, now: Now):
        """One step of the thread's shaft for the sums of the window."""
        drive = ensemble.drives[mine.row]
        at = drive.first_shaft + mine.number - drive.sprockets
        pose, time = shared.poses[mine.body], steps.time_of(mine, now)
        speed, angular = rates_now(ensemble, shared, mine, now, mine.body)
        before, motion = leading(pose.speed), shared.motions[mine.body]
        load = load_moment_at_speed(steps.rounded_time(mine, now), pose.load, before, speed, motion)
        motor = moment_of(ensemble, mine, time, shared)
        out.sums.shaft[at] = add_shaft(out.sums.shaft[at], speed, motor, load, now.weight)

    @wp.func
    def observe_coupling(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: Mine, now: Now, c: int):
        """One step of a coupling, whose second body is the thread's, for the sums of the window and the frame."""
        drive, engaged = ensemble.drives[mine.row], state.couplings[c]
        coupling, one, other = coupled(ensemble, shared, mine, c)
        twist, before = coupling_twist(shared.poses[wp.max(one, 0)], shared.poses[other], coupling, engaged)
        second, angular = rates_now(ensemble, shared, mine, now, other)
        first = Real(0.0)
        led = Real(0.0)
        if one != GROUND:
            first, angular = rates_now(ensemble, shared, mine, now, one)
        rate = wp.where(engaged.ratio == Real(0.0), Real(0.0), first - engaged.ratio * second)
        moment = coupling_moment(twist, rate, coupling, engaged)
        if now.flags & FRAME != 0:
            sampling.write_coupling(ensemble, out.frames, mine, now, c, twist, moment)
        if wp.static(measuring) and now.measured != 0:
            if one != GROUND and shared.motions[one].prescribed == 1:
                led = led - moment * first
            if shared.motions[other].prescribed == 1:
                led = led + engaged.ratio * moment * second
            power = coupling_loss(twist, rate, coupling, engaged)
            lost = wp.where(now.flags & START != 0, Real(0.0), engaged.lost)
            out.sums.coupling[c] = add_coupling(out.sums.coupling[c], twist, moment, power, led, lost, now.weight)
            if now.flags & ENDS != 0:
                at = drive.first_body + mine.number
                energy = wp.float64(coupling_energy(twist, coupling))
                out.tallies.body[at] = add_energy(out.tallies.body[at], now.flags & START != 0, energy)

    @wp.func
    def observe_gear(ensemble: Ensemble, shared: Shared, out: Out, mine: Mine, now: Now, g: int):
        """One step of a pair of gears, whose second body is the thread's, for the sums of the window."""
        drive, first = ensemble.drives[mine.row], ensemble.drives[mine.variant].first_body
        gear = ensemble.gears[g]
        own = shared.motions[mine.body]
        speed, angular = rates_now(ensemble, shared, mine, now, mine.body)
        moment = gear.inertia * angular
        for b in range(wp.static(mounted)):
            other = shared.motions[b]
            # of the body that it turns as, of this chain or another
            number = place_of(shared, first, b) + other.apart - drive.first_body
            if number >= 0 and number < drive.bodies:
                if is_on_gear_side(gear, number):
                    moment = moment - other.ratio / own.ratio * shared.passed[b]
        if wp.static(kind.parts.valves > 0):
            for v in range(drive.first_valve, drive.first_valve + drive.valves):
                valve = ensemble.valves[v]
                if is_on_gear_side(gear, valve.body):
                    torque, force = cams.lifted(ensemble, shared, mine, now, v)
                    beside = ensemble.motions[drive.first_body + valve.body].ratio / own.ratio
                    moment = moment + beside * valve.sign * torque
        out.sums.gear[g] = add_gear(out.sums.gear[g], moment, wp.abs(moment) / gear.lever, now.weight)

    @wp.func
    def observe_trains(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: Mine, now: Now):
        """One step of what the thread's body is, or is the second of, once all moments are shared; couplings go on."""
        drive = ensemble.drives[mine.row]
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            if ensemble.couplings[c].second == mine.number:
                if now.stage == 0:
                    state.couplings[c] = engage(ensemble, state, shared, mine, c, steps.time_of(mine, now))
                if now.measured != 0 or now.flags & FRAME != 0:
                    observe_coupling(ensemble, state, shared, out, mine, now, c)
        if wp.static(kind.parts.valves > 0) and (now.measured != 0 or now.flags & FRAME != 0):
            cams.observe_valves(ensemble, state, shared, out, mine, now)
        if wp.static(measuring) and now.measured != 0:
            if mine.body >= wp.static(sprockets) and mine.body < wp.static(mounted):
                observe_shaft(ensemble, shared, out, mine, now)
            for g in range(drive.first_gear, drive.first_gear + drive.gears):
                if ensemble.gears[g].body == mine.number:
                    observe_gear(ensemble, shared, out, mine, now, g)

    @inlined
    def tie(ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: Mine, now: Now, wrench: Wrench):
        """Lets bodies pass on moments to each other, and observes it; all threads together, before any body moves."""
        if mine.body >= 0:
            pass_on(ensemble, state, shared, mine, now, wrench)
        barrier()
        couplings = ensemble.drives[mine.variant].couplings
        for r in range(1, wp.static(kind.parts.rings)):
            couplings = couplings + ensemble.drives[mine.variant + r].couplings
        if now.measured != 0 or now.flags & FRAME != 0 or couplings > 0:
            if mine.body >= 0:
                observe_trains(ensemble, state, shared, out, mine, now)
            barrier()

    return SimpleNamespace(**locals())


@cache
def block_cams(kind: BlockKind, frame: Any) -> SimpleNamespace:
    """The functions of one variant's valves on a block; frames lie as `frame` says (`frames.frame_writers`)."""
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    rates_now, body_of, sampling = gathering(kind).rates_now, block_rings(kind).body_of, block_sampling(kind, frame)
    write_valve, frame_at = sampling.write.write_valve, sampling.frame_at

    @wp.func
    def share_lifts(ensemble: Ensemble, shared: Shared, mine: Mine):
        """Shares the lifts of all cams: a thread each, from the last on, which may have no rollers."""
        last = ensemble.drives[mine.variant + wp.static(kind.parts.rings - 1)]
        end = last.first_valve + last.valves
        cam = wp.static(kind.shape.threads - 1) - mine.thread
        while cam < wp.static(kind.parts.valves):
            v, k = int(ensemble.drives[mine.variant].first_valve), int(cam)
            while v < end and k >= ensemble.valves[v].phases:
                k = k - ensemble.valves[v].phases
                v = v + 1
            if v < end:
                valve, ring = ensemble.valves[v], int(0)
                for r in range(1, wp.static(kind.parts.rings)):
                    if v >= ensemble.drives[mine.variant + r].first_valve:
                        ring = r
                b = body_of(ensemble, shared, mine.variant + ring, ring, valve.body)
                at = cam_lift(shared.poses[b].angle, k, valve, shared.motions[b], ensemble.tables)
                shared.lifts[cam] = at
            cam = cam + wp.static(kind.shape.threads)

    @wp.func
    def first_cam(ensemble: Ensemble, mine: Mine, v: int):
        """The number of the first cam of group v of all valves among those of the variant."""
        first = int(ensemble.valves[v].first_cam)
        for r in range(wp.static(kind.parts.rings - 1)):  # and those of the chains before
            before = ensemble.drives[mine.variant + r]
            last = before.first_valve + before.valves - 1
            if before.valves > 0 and v > last:
                first = first + ensemble.valves[last].first_cam + ensemble.valves[last].phases
        return first

    @wp.func
    def group_on(ensemble: Ensemble, drive: Drive, b: int, v: int):
        """The first group of valves from `v` on that is on body b of a drive, or where they end.

        So threads whose bodies have valves go through their groups together, the first, the second, and so on.
        """
        at = int(v)
        while at < drive.first_valve + drive.valves and ensemble.valves[at].body != b:
            at = at + 1
        return at

    @wp.func
    def lift_valves(ensemble: Ensemble, shared: Shared, mine: Mine):
        """Shares what the valves on the thread's body do to it, once all lifts are shared."""
        cam, drive = kinds.Cam(), ensemble.drives[mine.row]
        v = group_on(ensemble, drive, mine.number, drive.first_valve)
        while v < drive.first_valve + drive.valves:
            valve, first = ensemble.valves[v], first_cam(ensemble, mine, v)
            for k in range(valve.phases):
                cam = add_cam(cam, shared.lifts[first + k], valve)
            v = group_on(ensemble, drive, mine.number, v + 1)
        shared.cams[mine.body] = cam

    @wp.func
    def lifted(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, v: int):
        """Torque [N m] of group v of all valves against forward rotation, and the least force [N] on a follower."""
        valve, first = ensemble.valves[v], first_cam(ensemble, mine, v)
        b = body_of(ensemble, shared, mine.row, mine.row - mine.variant, valve.body)
        speed, angular = rates_now(ensemble, shared, mine, now, b)
        load = zero_valve_load(valve)
        for k in range(valve.phases):
            load = add_cam_load(load, shared.lifts[first + k], speed, angular, valve)
        return load[0], load[1]

    @wp.func
    def observe_valves(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: Mine, now: Now):
        """One step of all groups of valves on the thread's body, for the sums of the window and the frame."""
        drive = ensemble.drives[mine.row]
        v = group_on(ensemble, drive, mine.number, drive.first_valve)
        while v < drive.first_valve + drive.valves:
            torque, force = lifted(ensemble, shared, mine, now, v)
            if now.flags & FRAME != 0:
                write_valve(out.frames, frame_at(drive, now), drive, v - drive.first_valve, torque, force)
            if wp.static(kind.measuring) and now.measured != 0:
                out.sums.valve[v] = add_valve(out.sums.valve[v], torque, force, now.weight)
            v = group_on(ensemble, drive, mine.number, v + 1)

    return SimpleNamespace(**locals())
