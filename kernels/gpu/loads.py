"""Moments on single bodies of a block: of loads and arms' springs."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..physics.body import arm_own_moment, plain_body, pose_heading
from ..physics.motion import load_moment
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .body_states import body_state_functions
from .prescribed_motion import prescribed_motion_functions


def finds_loads_ahead(kind: BlockKind) -> bool:
    """Whether threads that else would wait for others' contacts compute bodies' loads meanwhile."""
    waiting = kind.shape.body_warp or (not kind.shape.is_one_warp and not kind.is_paired)
    return waiting and not kind.has_stages and not kind.parts.is_tied


@dataclass(frozen=True)
class LoadFunctions:
    """Load functions of a block."""

    body_load: wp.Function
    find_load_ahead: wp.Function


@cache
def load_functions(kind: BlockKind) -> LoadFunctions:
    """Load functions of block kernels."""
    Real = kind.Real
    kinds, Now = kind.types, kind.types.Now
    Ensemble, Shared, Pose = kinds.Ensemble, kinds.Shared, kinds.Pose
    prescribed_motion, body_states = prescribed_motion_functions(kind), body_state_functions(kind)

    @wp.func
    def body_load(ensemble: Ensemble, shared: Shared, mine: ThreadParts, rounded: Real, time: Any, pose: Pose):
        """Load moment [N m] on the thread's body; an arm's by springs and weight."""
        motion = shared.motions[mine.body]
        if wp.static(not kind.parts.tabulated):
            motion.load_table.cells = 0  # so that the compiler knows
        load = load_moment(time, rounded, pose.angle, pose.speed, motion, ensemble)
        if wp.static(kind.parts.arms):
            if mine.arm >= 0:
                arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
                load = arm_own_moment(plain_body(body_states.body_from_pose(pose)), pose_heading(pose), arm)
                if wp.static(kind.parts.jointed):
                    if ensemble.drives[mine.drive_row].jointed != 0:
                        load = pose.load  # as `carried_arms.couple_accelerations` has found it
        return load

    @wp.func
    def find_load_ahead(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now):
        """Stores the load on the thread's body while others compute contacts."""
        if wp.static(finds_loads_ahead(kind)):
            pose = shared.poses[mine.body]
            rounded, time = prescribed_motion.rounded_step_time(mine, now), prescribed_motion.step_time(mine, now)
            shared.poses[mine.body].load = body_load(ensemble, shared, mine, rounded, time, pose)

    return LoadFunctions(body_load=body_load, find_load_ahead=find_load_ahead)
