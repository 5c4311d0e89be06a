"""Motion of the body of a block's thread, by a step or a stage."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import leapfrog_kick, leapfrog_lag, stage_at
from ..number import (
    add,  # noqa: F401
    difference,
    leading_value,
)
from ..physics.body import (
    aligned_pose,
    body_accelerations,
    body_at_time,
    leapfrog_body,
    move_prescribed_center,
    plain_body,
    pose_heading,
    pose_with_coordinates,
    stage_body,
    turned_pose,
)
from ..physics.mount import displacement_from_home
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .body_states import body_state_functions
from .geometry import geometry_functions
from .loads import finds_loads_ahead, load_functions
from .prescribed_motion import plan_index, prescribed_motion_functions
from .train_moments import train_moment_functions


@dataclass(frozen=True)
class BodyFunctions:
    """Body motion functions of a block."""

    body_mount: wp.Function
    displacement: wp.Function
    with_bearing_moment: wp.Function
    advance_body: wp.Function


@cache
def body_functions(kind: BlockKind) -> BodyFunctions:
    """Body motion functions of block kernels."""
    Real = kind.Real
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose
    Wrench = kinds.Wrench
    prescribed_motion, loads = prescribed_motion_functions(kind), load_functions(kind)
    body_states = body_state_functions(kind)
    train_moments = train_moment_functions(kind)
    geometry = geometry_functions(kind)
    vec2 = kinds.vec2
    of_three = wp.types.vector(3, Real)

    @wp.func
    def body_mount(shared: Shared, b: int):
        """Mount of body b of a block."""
        mount = kinds.Mount()
        if wp.static(kind.moving):
            mount = shared.mounts[b]
            if wp.static(not kind.parts.tabulated):
                mount.x_table.cells = 0  # so that the compiler knows
                mount.y_table.cells = 0
        return mount

    @wp.func
    def displacement(pose: Pose, mount: kinds.Mount):
        """Displacement [m] of a block's body from its home; 0 in kernels without moving bodies."""
        if wp.static(kind.moving):
            return displacement_from_home(pose.center, mount)
        else:
            return vec2()

    @wp.func
    def wrench_in_train(shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench):
        """Wrench that moves the thread's body, with the moments of its train."""
        if wp.static(kind.parts.is_tied):
            if mine.arm < 0:
                wrench.moment = train_moments.moment_on_body(shared, mine, now, mine.body)
                wrench.load = Real(0.0)
        return wrench

    @wp.func
    def rates_beside_arms(shared: Shared, mine: ThreadParts, rates: of_three):
        """Accelerations of the thread's body, an arm's coupled with others' (`carried_arms`)."""
        if wp.static(kind.parts.jointed):
            if mine.arm >= 0:
                rates[2] = shared.carried_arms[mine.arm].acceleration
        return rates

    @wp.func
    def with_bearing_moment(wrench: Wrench):
        """Wrench of a block's body with the bearings' moment in its load."""
        if wp.static(kind.parts.hubs):
            wrench.load = wrench.load + wrench.bearing
        return wrench

    @wp.func
    def take_leapfrog_step(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, pose: Pose, wrench: Wrench):
        """Moves the thread's body by a leapfrog step unless the run ends.

        Returns it at the step's instant, and `wrench` with its load.
        """
        b = mine.body
        h = leading_value(prescribed_motion.exact_time_step(mine))
        motion, mount = shared.motions[b], body_mount(shared, b)
        time = prescribed_motion.step_time(mine, now)
        wrench.load = pose.load
        if wp.static(not finds_loads_ahead(kind) and not kind.parts.is_tied):
            rounded = prescribed_motion.rounded_step_time(mine, now)
            wrench.load = loads.body_load(ensemble, shared, mine, rounded, time, pose)
        body = body_states.body_from_pose(pose)
        plain = plain_body(body)
        if wp.static(kind.moving):
            plain.speed = wp.where(motion.prescribed == 1, pose.exact_speed, plain.speed)
        moved_by = wrench_in_train(shared, mine, now, with_bearing_moment(wrench))
        rates = body_accelerations(
            time, displacement(pose, mount), plain, pose_heading(pose), moved_by, motion, mount, ensemble
        )
        rates = rates_beside_arms(shared, mine, rates)
        lag = leapfrog_lag(now.step, h)
        seen = body_at_time(time, lag, body, rates, pose.exact_speed, motion, mount, ensemble)
        if now.goes_on != 0:
            ahead = plan_index(mine.prescribed_index, now.step + 1)  # not used where the angle is free
            kick, angle = leapfrog_kick(now.step, h), shared.prescribed_angles[ahead]
            moved = leapfrog_body(kick, h, body, rates, angle, motion, mount)
            after = time + prescribed_motion.exact_time_step(mine)
            moved = move_prescribed_center(after, kick, h, moved, mount, ensemble)
            pose.exact_speed = shared.prescribed_speeds[ahead]
            geometry.put_pose(
                shared, b, turned_pose(pose_with_coordinates(pose, moved), difference(moved.angle, body.angle))
            )
        return seen, wrench

    @wp.func
    def take_stage(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now, pose: Pose, wrench: Wrench
    ):
        """Moves the thread's body to its next stage unless the run ends; returns it as before, and its wrench."""
        b = mine.body
        motion, mount = shared.motions[b], body_mount(shared, b)
        time, h = prescribed_motion.step_time(mine, now), prescribed_motion.exact_time_step(mine)
        at = stage_at(wp.static(kind.integrator), now.stage, time, h)
        body = body_states.body_from_pose(pose)
        plain = plain_body(body)
        wrench.load = loads.body_load(ensemble, shared, mine, leading_value(at.time), at.time, pose)
        if now.goes_on != 0:
            place = 2 * (ensemble.drives[mine.drive_row].first_body + mine.body_number)
            by, to = wrench_in_train(shared, mine, now, with_bearing_moment(wrench)), pose_heading(pose)
            rates = body_accelerations(at.time, displacement(pose, mount), plain, to, by, motion, mount, ensemble)
            rates = rates_beside_arms(shared, mine, rates)
            start, summed = state.body_stages[place], state.body_stages[place + 1]
            moved, base, slopes = stage_body(at, body, start, summed, rates, motion, mount, ensemble)
            state.body_stages[place] = base
            state.body_stages[place + 1] = slopes
            geometry.put_pose(shared, b, aligned_pose(pose_with_coordinates(pose, moved)))
        return plain, wrench

    @wp.func
    def advance_body(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now, pose: Pose, wrench: Wrench
    ):
        """Moves the thread's body, now at `pose`, by a step or a stage.

        Returns it at the step's instant, and `wrench` with its load.
        """
        if wp.static(kind.has_stages):
            return take_stage(ensemble, state, shared, mine, now, pose, wrench)
        else:
            return take_leapfrog_step(ensemble, shared, mine, now, pose, wrench)

    return BodyFunctions(
        body_mount=body_mount,
        displacement=displacement,
        with_bearing_moment=with_bearing_moment,
        advance_body=advance_body,
    )
