"""Frames: output of a drive's values, on CPU and GPU alike.

`frame` says which channels frames hold and where (`results.channels.FrameLayout`).
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from .number import rounded_value
from .structs import Drive, types


@dataclass(frozen=True)
class FrameWriterFunctions:
    """Warp functions that write parts of a drive into its frame."""

    drive_width: wp.Function
    write_roller: wp.Function
    write_sprocket: wp.Function
    write_arm: wp.Function
    write_tensioner: wp.Function
    write_shaft: wp.Function
    write_coupling: wp.Function
    write_valve: wp.Function


@cache
def frame_writer_functions(Real: type, frame: Any) -> FrameWriterFunctions:
    """Warp functions that write frames with the channels of `frame`."""
    kinds = types(Real)
    vec2 = kinds.vec2
    place = frame.place

    @wp.func
    def frame_width(n: int, sprockets: int, arms: int, tensioners: int, shafts: int, couplings: int, valves: int):
        """Number of values in a frame of so many parts."""
        of_bodies = wp.static(frame.values("arm")) * arms + wp.static(frame.values("tensioner")) * tensioners
        of_bodies += wp.static(frame.values("shaft")) * shafts + wp.static(frame.values("coupling")) * couplings
        of_bodies += wp.static(frame.values("valve")) * valves
        return wp.static(frame.values("roller")) * n + wp.static(frame.values("sprocket")) * sprockets + of_bodies

    @wp.func
    def drive_width(drive: Drive):
        """Number of values in a drive's frame."""
        return frame_width(drive.rollers, drive.sprockets, drive.arms, drive.tensioners, drive.shafts, drive.couplings,
                     drive.valves)  # fmt: skip

    @wp.func
    def put_vector(frames: wp.array[Real], at: int, n: int, value: vec2):
        """Writes a roller's vector into a frame, y `n` values after x."""
        frames[at] = value[0]
        frames[at + n] = value[1]

    @wp.func
    def write_roller(
        frames: wp.array[Real], at: int, n: int, i: int, position: vec2, velocity: vec2, seen: kinds.Extra
    ):
        """Writes roller `i` and its link into a frame of `n` rollers."""
        mine = at + i
        put_vector(frames, mine + wp.static(place("position")) * n, n, position)
        put_vector(frames, mine + wp.static(place("velocity")) * n, n, velocity)
        frames[mine + wp.static(place("tension")) * n] = seen.tension
        frames[mine + wp.static(place("sprocket_force")) * n] = seen.sprocket_force
        frames[mine + wp.static(place("guide_force")) * n] = seen.guide_force
        if wp.static(frame.holds("joint_friction_power")):
            frames[mine + wp.static(place("joint_friction_power")) * n] = seen.friction_power

    @wp.func
    def write_sprocket(frames: wp.array[Real], at: int, n: int, s: int, body: Any, moment: Any, force: Any):
        """Writes sprocket `s` and its contacts' moment [N m] and force [N] into a frame."""
        mine = at + frame_width(n, s, 0, 0, 0, 0, 0)
        frames[mine + wp.static(place("sprocket_angle"))] = Real(body.angle)
        frames[mine + wp.static(place("sprocket_speed"))] = Real(body.speed)
        frames[mine + wp.static(place("sprocket_moment"))] = Real(moment)
        frames[mine + wp.static(place("sprocket_center"))] = Real(body.center[0])
        frames[mine + wp.static(place("sprocket_center") + 1)] = Real(body.center[1])
        if wp.static(frame.holds("hub_force")):
            frames[mine + wp.static(place("hub_force"))] = Real(force[0])
            frames[mine + wp.static(place("hub_force") + 1)] = Real(force[1])

    @wp.func
    def write_arm(frames: wp.array[Real], at: int, drive: Drive, a: int, body: Any, moment: Any):
        """Writes arm `a` and its contacts' moment [N m] into a frame."""
        mine = at + frame_width(drive.rollers, drive.sprockets, a, 0, 0, 0, 0)
        frames[mine + wp.static(place("arm_angle"))] = Real(body.angle)
        frames[mine + wp.static(place("arm_speed"))] = Real(body.speed)
        frames[mine + wp.static(place("arm_moment"))] = Real(moment)

    @wp.func
    def write_tensioner(frames: wp.array[Real], at: int, drive: Drive, t: int, push: Any):
        """Writes tensioner `t` into a frame."""
        mine = at + frame_width(drive.rollers, drive.sprockets, drive.arms, t, 0, 0, 0)
        frames[mine + wp.static(place("tensioner_extension"))] = Real(rounded_value(push.extension))
        frames[mine + wp.static(place("tensioner_force"))] = Real(push.force)
        frames[mine + wp.static(place("chamber_pressure"))] = Real(push.pressure)

    @wp.func
    def write_shaft(frames: wp.array[Real], at: int, drive: Drive, h: int, body: Any):
        """Writes shaft `h` into a frame."""
        mine = at + frame_width(drive.rollers, drive.sprockets, drive.arms, drive.tensioners, h, 0, 0)
        frames[mine + wp.static(place("shaft_angle"))] = Real(body.angle)
        frames[mine + wp.static(place("shaft_speed"))] = Real(body.speed)

    @wp.func
    def write_coupling(frames: wp.array[Real], at: int, drive: Drive, c: int, twist: Any, moment: Any):
        """Writes coupling `c` into a frame."""
        mine = at + frame_width(drive.rollers, drive.sprockets, drive.arms, drive.tensioners, drive.shafts, c, 0)
        frames[mine + wp.static(place("coupling_twist"))] = Real(twist)
        frames[mine + wp.static(place("coupling_torque"))] = Real(moment)

    @wp.func
    def write_valve(frames: wp.array[Real], at: int, drive: Drive, v: int, torque: Any, force: Any):
        """Writes valve group `v` into a frame."""
        counts = frame_width(
            drive.rollers, drive.sprockets, drive.arms, drive.tensioners, drive.shafts, drive.couplings, v
        )
        frames[at + counts + wp.static(place("valve_torque"))] = Real(torque)
        frames[at + counts + wp.static(place("valve_force"))] = Real(force)

    return FrameWriterFunctions(
        drive_width=drive_width,
        write_roller=write_roller,
        write_sprocket=write_sprocket,
        write_arm=write_arm,
        write_tensioner=write_tensioner,
        write_shaft=write_shaft,
        write_coupling=write_coupling,
        write_valve=write_valve,
    )
