"""Trains on a block: moments of shafts, gears, couplings and motors before bodies move."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..bodies.loads import body_motor_moment
from ..integrate import stage_at
from ..number import leading_value
from ..physics.train import coupling_moment, coupling_twist
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .couplings import coupling_functions
from .events import FRAME
from .loads import load_functions
from .prescribed_motion import prescribed_motion_functions
from .sync import sync_functions
from .train_sums import train_sum_functions
from .valves import valve_functions


@dataclass(frozen=True)
class TrainFunctions:
    """Train functions of a block."""

    find_train_moments: wp.Function


@cache
def train_functions(kind: BlockKind, frame: Any) -> TrainFunctions:
    """Train functions of block kernels, and frames of layout `frame`."""
    kinds, Now, Out = kind.types, kind.types.Now, kind.types.Out
    sprockets, rotors = kind.parts.sprockets, kind.parts.rotors
    Ensemble, State, Shared, Wrench = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Wrench
    loads, prescribed_motion = load_functions(kind), prescribed_motion_functions(kind)
    couplings, train_sums = coupling_functions(kind), train_sum_functions(kind, frame)
    valves, sync = valve_functions(kind, frame), sync_functions(kind)

    @wp.func
    def share_train_moment(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench
    ):
        """Shares the moment on the thread's body of load, motor, couplings and `wrench`."""
        time = prescribed_motion.step_time(mine, now)
        if wp.static(kind.has_stages):
            time = stage_at(wp.static(kind.integrator), now.stage, time, prescribed_motion.exact_time_step(mine)).time
        pose = shared.poses[mine.body]
        load = loads.body_load(ensemble, shared, mine, leading_value(time), time, pose)
        shared.poses[mine.body].load = load
        drive = ensemble.drives[mine.drive_row]
        moment = wrench.moment + load
        if mine.body >= sprockets and mine.body < rotors:
            motion = shared.motions[mine.body]
            moment = moment + body_motor_moment(time, ensemble, drive, mine.body_number, pose, motion)
        if wp.static(kind.parts.hubs):
            moment = moment + wrench.bearing
        for c in range(drive.first_coupling, drive.first_coupling + couplings.coupling_count(drive)):
            coupling, one, other = couplings.coupling_and_bodies(ensemble, shared, mine, c)
            if one == mine.body or other == mine.body:
                engaged = state.couplings[c]
                if now.stage == 0:
                    engaged = couplings.coupling_state_now(ensemble, state, shared, mine, c, time)
                twist, rate = coupling_twist(shared.poses[wp.max(one, 0)], shared.poses[other], coupling, engaged)
                passed = coupling_moment(twist, rate, coupling, engaged)
                moment = moment + wp.where(other == mine.body, engaged.ratio * passed, -passed)
        shared.train_moments[mine.body] = moment
        if wp.static(kind.parts.valves):
            valves.share_valve_cam(ensemble, shared, mine)

    @inlined
    def find_train_moments(
        ensemble: Ensemble, state: State, out: Out, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench
    ):
        """Shares the moments on a train's bodies, and observes trains; all threads together."""
        if mine.body >= 0:
            share_train_moment(ensemble, state, shared, mine, now, wrench)
        sync.barrier()
        count = couplings.coupling_count(ensemble.drives[mine.variant])
        for r in range(1, wp.static(kind.parts.chains)):
            count = count + couplings.coupling_count(ensemble.drives[mine.variant + r])
        if now.measures != 0 or now.flags & FRAME != 0 or count > 0:
            if mine.body >= 0:
                train_sums.add_train_step(ensemble, state, shared, out, mine, now)
            sync.barrier()

    return TrainFunctions(find_train_moments=find_train_moments)
