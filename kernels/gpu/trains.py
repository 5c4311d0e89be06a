"""Shafts, gears, couplings and motors on a block: moments that bodies share before any of them moves."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..integrate import stage_at
from ..number import (
    add,  # noqa: F401
    leading_value,
)
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
from ..structs import GROUND, Drive
from ..sums import add_coupling, add_energy, add_gear, add_shaft
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .bodies import body_functions
from .chains import chain_functions
from .events import ENDS, FRAME, START
from .frame_output import frame_output_functions
from .prescribed_motion import prescribed_motion_functions
from .sync import sync_functions
from .train_moments import train_moment_functions
from .valves import valve_functions


@dataclass(frozen=True)
class TrainFunctions:
    """Trains of one variant on a block."""

    find_train_moments: wp.Function


@cache
def train_functions(kind: BlockKind, frame: Any) -> TrainFunctions:
    """The functions of one variant's trains on a block; frames lie as `frame` says (`kernels.frames`)."""
    Real, sprockets, rotors = kind.Real, kind.parts.sprockets, kind.parts.rotors
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    Wrench = kinds.Wrench
    chains = chain_functions(kind)
    bodies = body_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    valves = valve_functions(kind, frame)
    train_moments = train_moment_functions(kind)
    frame_output = frame_output_functions(kind, frame)
    sync = sync_functions(kind)

    @wp.func
    def body_motor_moment(ensemble: Ensemble, mine: ThreadParts, time: Any, shared: Shared):
        """Moment [N m] of the motor on the thread's body."""
        moment = Real(0.0)
        if mine.body >= sprockets and mine.body < rotors:
            drive = ensemble.drives[mine.drive_row]
            at = drive.first_shaft + mine.body_number - drive.sprockets
            pose, motion = shared.poses[mine.body], shared.motions[mine.body]
            moment = motor_moment(time, pose.angle, pose.speed, ensemble.motors[at], motion, ensemble.tables)
        return moment

    @wp.func
    def couplings_of(drive: Drive):
        """The number of couplings of a drive, 0 as the compiler knows where no drive of the kind has any."""
        if wp.static(kind.parts.geared):
            return drive.couplings
        else:
            return int(0)

    @wp.func
    def coupling_and_bodies(ensemble: Ensemble, shared: Shared, mine: ThreadParts, c: int):
        """Coupling c of all, which is of the chain of the thread's body, and its bodies on the block, or the ground."""
        coupling, row, chain = ensemble.couplings[c], mine.drive_row, mine.drive_row - mine.variant
        first = chains.body_on_block(ensemble, shared, row, chain, coupling.first)
        return coupling, first, chains.body_on_block(ensemble, shared, row, chain, coupling.second)

    @wp.func
    def coupling_state_now(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, c: int, time: Any):
        """State of coupling c of all from the step's start on; both bodies' threads find it, before either moves."""
        coupling, one, other = coupling_and_bodies(ensemble, shared, mine, c)
        first, second = shared.poses[wp.max(one, 0)], shared.poses[other]
        return coupling_state(time, first, second, state.couplings[c], coupling, ensemble.tables)

    @wp.func
    def share_train_moment(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench
    ):
        """Shares the moment on the thread's body, with that of load, motor and couplings; bodies stand still.

        `wrench` has the tensioners'; nobody reads what arms share.
        """
        time = bodies.step_time(mine, now)
        if wp.static(kind.has_stages):
            time = stage_at(wp.static(kind.integrator), now.stage, time, prescribed_motion.exact_time_step(mine)).time
        pose = shared.poses[mine.body]
        load = bodies.body_load(ensemble, shared, mine, leading_value(time), time, pose)
        shared.poses[mine.body].load = load
        moment = wrench.moment + load + body_motor_moment(ensemble, mine, time, shared)
        if wp.static(kind.parts.hubs):
            moment = moment + wrench.bearing
        drive = ensemble.drives[mine.drive_row]
        for c in range(drive.first_coupling, drive.first_coupling + couplings_of(drive)):
            coupling, one, other = coupling_and_bodies(ensemble, shared, mine, c)
            if one == mine.body or other == mine.body:
                engaged = state.couplings[c]
                if now.stage == 0:
                    engaged = coupling_state_now(ensemble, state, shared, mine, c, time)
                twist, rate = coupling_twist(shared.poses[wp.max(one, 0)], shared.poses[other], coupling, engaged)
                passed = coupling_moment(twist, rate, coupling, engaged)
                moment = moment + wp.where(other == mine.body, engaged.ratio * passed, -passed)
        shared.train_moments[mine.body] = moment
        if wp.static(kind.parts.valves):
            valves.share_valve_cam(ensemble, shared, mine)

    @wp.func
    def add_shaft_step(ensemble: Ensemble, shared: Shared, out: Out, mine: ThreadParts, now: Now):
        """Adds a step of the thread's shaft to the sums of the window."""
        drive = ensemble.drives[mine.drive_row]
        at = drive.first_shaft + mine.body_number - drive.sprockets
        pose, time = shared.poses[mine.body], bodies.step_time(mine, now)
        speed, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, mine.body)
        before, motion = leading_value(pose.speed), shared.motions[mine.body]
        load = load_moment_at_speed(bodies.rounded_step_time(mine, now), pose.load, before, speed, motion)
        motor = body_motor_moment(ensemble, mine, time, shared)
        out.sums.shaft[at] = add_shaft(out.sums.shaft[at], speed, motor, load, now.weight)

    @wp.func
    def add_coupling_step(
        ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: ThreadParts, now: Now, c: int
    ):
        """Adds a step of a coupling, whose second body is the thread's, to the sums of the window and the frame."""
        drive, engaged = ensemble.drives[mine.drive_row], state.couplings[c]
        coupling, one, other = coupling_and_bodies(ensemble, shared, mine, c)
        twist, before = coupling_twist(shared.poses[wp.max(one, 0)], shared.poses[other], coupling, engaged)
        second, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, other)
        first = Real(0.0)
        led = Real(0.0)
        if one != GROUND:
            first, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, one)
        rate = wp.where(engaged.ratio == Real(0.0), Real(0.0), first - engaged.ratio * second)
        moment = coupling_moment(twist, rate, coupling, engaged)
        if now.flags & FRAME != 0:
            frame_output.write_coupling(ensemble, out.frames, mine, now, c, twist, moment)
        if wp.static(kind.measuring) and now.measures != 0:
            if one != GROUND and shared.motions[one].prescribed == 1:
                led = led - moment * first
            if shared.motions[other].prescribed == 1:
                led = led + engaged.ratio * moment * second
            power = coupling_loss(twist, rate, coupling, engaged)
            lost = wp.where(now.flags & START != 0, Real(0.0), engaged.lost)
            out.sums.coupling[c] = add_coupling(out.sums.coupling[c], twist, moment, power, led, lost, now.weight)
            if now.flags & ENDS != 0:
                at = drive.first_body + mine.body_number
                energy = wp.float64(coupling_energy(twist, coupling))
                out.tallies.body[at] = add_energy(out.tallies.body[at], now.flags & START != 0, energy)

    @wp.func
    def add_gear_step(ensemble: Ensemble, shared: Shared, out: Out, mine: ThreadParts, now: Now, g: int):
        """Adds a step of a pair of gears, whose second body is the thread's, to the sums of the window."""
        drive, first = ensemble.drives[mine.drive_row], ensemble.drives[mine.variant].first_body
        gear = ensemble.gears[g]
        own = shared.motions[mine.body]
        speed, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, mine.body)
        moment = gear.inertia * angular
        for b in range(rotors):
            other = shared.motions[b]
            # of the body that it turns as, of this chain or another
            number = chains.body_index(shared, first, b) + other.shaft_offset - drive.first_body
            if number >= 0 and number < drive.bodies:
                if is_on_gear_side(gear, number):
                    moment = moment - other.ratio / own.ratio * shared.train_moments[b]
        if wp.static(kind.parts.valves):
            for v in range(drive.first_valve, drive.first_valve + drive.valves):
                valve = ensemble.valves[v]
                if is_on_gear_side(gear, valve.body):
                    torque, force = valves.valve_load_now(ensemble, shared, mine, now, v)
                    beside = ensemble.motions[drive.first_body + valve.body].ratio / own.ratio
                    moment = moment + beside * valve.sign * torque
        out.sums.gear[g] = add_gear(out.sums.gear[g], moment, wp.abs(moment) / gear.lever, now.weight)

    @wp.func
    def add_train_step(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: ThreadParts, now: Now):
        """Adds a step of the thread's shaft, couplings and gears whose second body it is; updates couplings."""
        drive = ensemble.drives[mine.drive_row]
        for c in range(drive.first_coupling, drive.first_coupling + couplings_of(drive)):
            if ensemble.couplings[c].second == mine.body_number:
                if now.stage == 0:
                    state.couplings[c] = coupling_state_now(
                        ensemble, state, shared, mine, c, bodies.step_time(mine, now)
                    )
                if now.measures != 0 or now.flags & FRAME != 0:
                    add_coupling_step(ensemble, state, shared, out, mine, now, c)
        if wp.static(kind.parts.valves):
            if now.measures != 0 or now.flags & FRAME != 0:
                valves.add_valve_step(ensemble, state, shared, out, mine, now)
        if wp.static(kind.measuring) and now.measures != 0:
            if mine.body >= sprockets and mine.body < rotors:
                add_shaft_step(ensemble, shared, out, mine, now)
            if wp.static(kind.parts.geared):
                for g in range(drive.first_gear, drive.first_gear + drive.gears):
                    if ensemble.gears[g].body == mine.body_number:
                        add_gear_step(ensemble, shared, out, mine, now, g)

    @inlined
    def find_train_moments(
        ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench
    ):
        """Shares the moments on bodies, and observes trains; all threads together, before any body moves."""
        if mine.body >= 0:
            share_train_moment(ensemble, state, shared, mine, now, wrench)
        sync.barrier()
        couplings = couplings_of(ensemble.drives[mine.variant])
        for r in range(1, wp.static(kind.parts.chains)):
            couplings = couplings + couplings_of(ensemble.drives[mine.variant + r])
        if now.measures != 0 or now.flags & FRAME != 0 or couplings > 0:
            if mine.body >= 0:
                add_train_step(ensemble, state, shared, out, mine, now)
            sync.barrier()

    return TrainFunctions(find_train_moments=find_train_moments)
