"""Frames of one variant, written on the CPU from an evaluated step."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writer_functions
from ..native import row_access
from ..structs import Drive, Now, types
from . import body_states, couplings, valves
from .joints import joint_functions
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class FrameOutputFunctions:
    """CPU frame output function."""

    write_frame: wp.Function


@cache
def frame_output_functions(Real: type, capacity: int, frame: Any) -> FrameOutputFunctions:
    """CPU frame output function of the channels of `frame`."""
    kinds = types(Real)
    vec2 = kinds.vec2
    frame_writers = frame_writer_functions(Real, frame)
    access = row_access(Real)
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)
    joints = joint_functions(Real, capacity)

    @wp.func
    def roller_extra(w: wp.array[Real], i: int):
        """`Extra` of roller `i` and its next link, for a CPU frame."""
        of = kinds.Extra()
        of.tension = access.load(w, row.tension + i)
        of.rate = access.load(w, row.rate + i)
        of.sprocket_force = access.load(w, row.sprocket_force + i)
        of.guide_force = access.load(w, row.guide_force + i)
        return of

    @wp.func(inline=False)
    def write_frame(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
        frames: wp.array[Real],
        number: int,
        now: Now,
    ):
        """Writes the frame of one chain on the CPU, number `number` of the launch."""
        n = drive.rollers
        begin = int(drive.first_value + wp.int64(number) * wp.int64(frame_writers.drive_width(drive)))
        lag = Real(now.lag)
        chain = ensemble.chains[variant]
        inverse_mass = chain.inverse_mass
        for i in range(n):
            a = rollers.acceleration(w, i, inverse_mass, chain.gravity)
            position = vec2(access.load(w, row.x + i), access.load(w, row.y + i))
            velocity = vec2(access.load(w, row.vx + i) + lag * a[0], access.load(w, row.vy + i) + lag * a[1])
            extra = roller_extra(w, i)
            if wp.static(frame.holds("joint_friction_power")):
                if chain.joint.inertia > Real(0.0):
                    extra.friction_power = joints.friction_power(w, i, n, chain, lag)
            frame_writers.write_roller(frames, begin, n, i, position, velocity, extra)
        for s in range(drive.sprockets):
            b = drive.first_body + s
            body = body_states.body_now(ensemble, state, b, now.time, now.lag)
            frame_writers.write_sprocket(frames, begin, n, s, body, state.wrenches[b].moment, state.wrenches[b].force)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            arm = body_states.body_now(ensemble, state, b, now.time, now.lag)
            frame_writers.write_arm(frames, begin, drive, a, arm, state.wrenches[b].moment)
        for t in range(drive.tensioners):
            frame_writers.write_tensioner(frames, begin, drive, t, state.pushes[drive.first_tensioner + t])
        for h in range(drive.shafts):
            shaft = body_states.body_now(ensemble, state, drive.first_body + drive.sprockets + h, now.time, now.lag)
            frame_writers.write_shaft(frames, begin, drive, h, shaft)
        for c in range(drive.couplings):
            twist, rate, moment = couplings.twist_and_moment_now(
                ensemble, state, drive, drive.first_coupling + c, now.time, now.lag
            )
            frame_writers.write_coupling(frames, begin, drive, c, twist, moment)
        for v in range(drive.valves):
            torque, force = valves.valve_load_now(ensemble, state, drive, drive.first_valve + v, now.time, now.lag)
            frame_writers.write_valve(frames, begin, drive, v, torque, force)

    return FrameOutputFunctions(write_frame=write_frame)
