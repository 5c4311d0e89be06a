"""Valves on a block: lifts of cams, a thread each, and their moments on bodies."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writer_functions
from ..physics.valve import add_cam, add_cam_load, cam_lift, zero_valve_load
from ..structs import Drive
from ..sums import add_valve
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .events import FRAME
from .frame_output import frame_output_functions
from .train_moments import train_moment_functions


@dataclass(frozen=True)
class ValveFunctions:
    """Valve functions of a block."""

    share_lifts: wp.Function
    share_valve_cam: wp.Function
    valve_load_now: wp.Function
    add_valve_step: wp.Function


@cache
def valve_functions(kind: BlockKind, frame: Any) -> ValveFunctions:
    """Valve functions of block kernels, and frames of layout `frame`."""
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    chains = chain_functions(kind)
    train_moments = train_moment_functions(kind)
    frame_writers = frame_writer_functions(kind.Real, frame)
    frame_output = frame_output_functions(kind, frame)

    @wp.func
    def share_lifts(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Shares the lifts of all cams, a thread each, from the last thread on."""
        last = ensemble.drives[mine.variant + wp.static(kind.parts.chains - 1)]
        end = last.first_valve + last.valves
        cam = wp.static(kind.shape.threads - 1) - mine.thread
        while cam < wp.static(kind.parts.valves):
            v, k = int(ensemble.drives[mine.variant].first_valve), int(cam)
            while v < end and k >= ensemble.valves[v].phases:
                k = k - ensemble.valves[v].phases
                v = v + 1
            if v < end:
                valve, chain = ensemble.valves[v], int(0)
                for r in range(1, wp.static(kind.parts.chains)):
                    if v >= ensemble.drives[mine.variant + r].first_valve:
                        chain = r
                b = chains.body_on_block(ensemble, shared, mine.variant + chain, chain, valve.body)
                at = cam_lift(shared.poses[b].angle, k, valve, shared.motions[b], ensemble.tables)
                shared.lifts[cam] = at
            cam = cam + wp.static(kind.shape.threads)

    @wp.func
    def first_cam(ensemble: Ensemble, mine: ThreadParts, v: int):
        """Number of the first cam of valve group v of all among the block's."""
        first = int(ensemble.valves[v].first_cam)
        for r in range(wp.static(kind.parts.chains - 1)):  # and those of the chains before
            before = ensemble.drives[mine.variant + r]
            last = before.first_valve + before.valves - 1
            if before.valves > 0 and v > last:
                first = first + ensemble.valves[last].first_cam + ensemble.valves[last].phases
        return first

    @wp.func
    def next_group_on_body(ensemble: Ensemble, drive: Drive, b: int, v: int):
        """First group of a block's valves from `v` on that is on body b, or their end."""
        at = int(v)
        while at < drive.first_valve + drive.valves and ensemble.valves[at].body != b:
            at = at + 1
        return at

    @wp.func
    def share_valve_cam(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Shares inertia and moment of valves on the thread's body, after lifts."""
        cam, drive = kinds.Cam(), ensemble.drives[mine.drive_row]
        v = next_group_on_body(ensemble, drive, mine.body_number, drive.first_valve)
        while v < drive.first_valve + drive.valves:
            valve, first = ensemble.valves[v], first_cam(ensemble, mine, v)
            for k in range(valve.phases):
                cam = add_cam(cam, shared.lifts[first + k], valve)
            v = next_group_on_body(ensemble, drive, mine.body_number, v + 1)
        shared.cams[mine.body] = cam

    @wp.func
    def valve_load_now(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, v: int):
        """Torque [N m] of a block's valve group v of all against rotation, and least force [N] on a follower."""
        valve, first = ensemble.valves[v], first_cam(ensemble, mine, v)
        b = chains.body_on_block(ensemble, shared, mine.drive_row, mine.drive_row - mine.variant, valve.body)
        speed, angular = train_moments.speed_and_acceleration_now(ensemble, shared, mine, now, b)
        load = zero_valve_load(valve)
        for k in range(valve.phases):
            load = add_cam_load(load, shared.lifts[first + k], speed, angular, valve)
        return load[0], load[1]

    @wp.func
    def add_valve_step(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: ThreadParts, now: Now):
        """Adds a step of valve groups on the thread's body to the window's sums and frame."""
        drive = ensemble.drives[mine.drive_row]
        v = next_group_on_body(ensemble, drive, mine.body_number, drive.first_valve)
        while v < drive.first_valve + drive.valves:
            torque, force = valve_load_now(ensemble, shared, mine, now, v)
            if now.flags & FRAME != 0:
                frame_writers.write_valve(
                    out.frames, frame_output.frame_begin(drive, now), drive, v - drive.first_valve, torque, force
                )
            if wp.static(kind.measuring) and now.measures != 0:
                out.sums.valve[v] = add_valve(out.sums.valve[v], torque, force, now.weight)
            v = next_group_on_body(ensemble, drive, mine.body_number, v + 1)

    return ValveFunctions(
        share_lifts=share_lifts,
        share_valve_cam=share_valve_cam,
        valve_load_now=valve_load_now,
        add_valve_step=add_valve_step,
    )
