"""Valve trains on blocks: lifts of all cams, a thread each, and what they do to the bodies that they are on."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..physics.valve import lift_at, unloaded, with_load, with_valves
from ..structs import Drive
from ..sums import add_valve
from .bodies import gathering
from .events import block_sampling
from .kind import FRAME, BlockKind, Mine
from .rings import block_rings


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
                at = lift_at(shared.poses[b].angle, k, valve, shared.motions[b], ensemble.curves.tables)
                shared.lifts[cam] = at
            cam = cam + wp.static(kind.shape.threads)

    @wp.func
    def first_cam(ensemble: Ensemble, mine: Mine, v: int):
        """The number of the first cam of group v of all valves among those of the variant."""
        first = int(0)
        for other in range(ensemble.drives[mine.variant].first_valve, v):
            first = first + ensemble.valves[other].phases
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
                cam = with_valves(cam, shared.lifts[first + k], valve)
            v = group_on(ensemble, drive, mine.number, v + 1)
        shared.cams[mine.body] = cam

    @wp.func
    def lifted(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, v: int):
        """Torque [N m] of group v of all valves against forward rotation, and the least force [N] on a follower."""
        valve, first = ensemble.valves[v], first_cam(ensemble, mine, v)
        b = body_of(ensemble, shared, mine.row, mine.row - mine.variant, valve.body)
        speed, angular = rates_now(ensemble, shared, mine, now, b)
        load = unloaded(valve)
        for k in range(valve.phases):
            load = with_load(load, shared.lifts[first + k], speed, angular, valve)
        return load[0], load[1]

    @wp.func
    def observe_valves(ensemble: Ensemble, state: State, shared: Shared, out: Out, mine: Mine, now: Now):
        """One step of all groups of valves on the thread's body, for the sums of the window and the frame."""
        drive = ensemble.drives[mine.row]
        v = group_on(ensemble, drive, mine.number, drive.first_valve)
        while v < drive.first_valve + drive.valves:
            torque, force = lifted(ensemble, shared, mine, now, v)
            if now.flags & FRAME != 0:
                write_valve(out.frames, frame_at(drive, state, mine, now), drive, v - drive.first_valve, torque, force)
            if wp.static(kind.measuring) and now.measured != 0:
                out.sums.valve[v] = add_valve(out.sums.valve[v], torque, force, now.weight)
            v = group_on(ensemble, drive, mine.number, v + 1)

    return SimpleNamespace(**locals())
