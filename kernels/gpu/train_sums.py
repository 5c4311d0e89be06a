"""Sums over the window of a block's shafts, couplings, gears and valves; frames of couplings and valves."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..bodies.loads import body_motor_moment
from ..number import leading_value
from ..physics.motion import load_moment_at_speed
from ..physics.train import coupling_energy, coupling_loss, coupling_moment, coupling_twist, is_on_gear_side
from ..structs import GROUND
from ..sums import add_coupling, add_energy, add_gear, add_shaft
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .couplings import coupling_functions
from .events import ENDS, FRAME, START
from .frame_output import frame_output_functions
from .prescribed_motion import prescribed_motion_functions
from .train_moments import train_moment_functions
from .valves import valve_functions


@dataclass(frozen=True)
class TrainSumFunctions:
    """Train sum functions of a block."""

    add_train_step: wp.Function


@cache
def train_sum_functions(kind: BlockKind, frame: Any) -> TrainSumFunctions:
    """Train sum functions of block kernels, and frames of layout `frame`."""
    Real, sprockets, rotors = kind.Real, kind.parts.sprockets, kind.parts.rotors
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    chains, couplings = chain_functions(kind), coupling_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    train_moments, valves = train_moment_functions(kind), valve_functions(kind, frame)
    frame_output = frame_output_functions(kind, frame)

    @wp.func
    def add_shaft_step(ensemble: Ensemble, shared: Shared, out: Out, mine: ThreadParts, now: Now):
        """Adds a step of the thread's shaft to the window's sums."""
        drive = ensemble.drives[mine.drive_row]
        at = drive.first_shaft + mine.body_number - drive.sprockets
        pose, time = shared.poses[mine.body], prescribed_motion.step_time(mine, now)
        speed, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, mine.body)
        before, motion = leading_value(pose.speed), shared.motions[mine.body]
        load = load_moment_at_speed(prescribed_motion.rounded_step_time(mine, now), pose.load, before, speed, motion)
        motor = body_motor_moment(time, ensemble, drive, mine.body_number, pose, motion)
        out.sums.shaft[at] = add_shaft(out.sums.shaft[at], speed, motor, load, now.weight)

    @wp.func
    def add_coupling_step(
        ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: ThreadParts, now: Now, c: int
    ):
        """Adds a step of a coupling on the thread's body to the window's sums and frame."""
        drive, engaged = ensemble.drives[mine.drive_row], state.couplings[c]
        coupling, one, other = couplings.coupling_and_bodies(ensemble, shared, mine, c)
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
        """Adds a step of a gear pair on the thread's body to the window's sums."""
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
        """Adds a step of the thread's shaft, couplings and gears to the window's sums; updates couplings."""
        drive = ensemble.drives[mine.drive_row]
        for c in range(drive.first_coupling, drive.first_coupling + couplings.coupling_count(drive)):
            if ensemble.couplings[c].second == mine.body_number:
                if now.stage == 0:
                    state.couplings[c] = couplings.coupling_state_now(
                        ensemble, state, shared, mine, c, prescribed_motion.step_time(mine, now)
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

    return TrainSumFunctions(add_train_step=add_train_step)
