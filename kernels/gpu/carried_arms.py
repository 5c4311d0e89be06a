"""Arms that carry arms, on blocks: their moments and coupled accelerations (`physics.hub`, (b))."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..bodies.carried_arms import carried_spring_moment, coupled_acceleration, joint_terms, spring_state
from ..integrate import leapfrog_lag, stage_at
from ..number import difference, leading_value
from ..physics.body import (
    arm_mass_moment,
    arm_own_moment,
    body_accelerations,
    body_at_time,
    plain_body,
    pose_heading,
)
from ..physics.guide import world_vector
from ..physics.hub import (
    carried_arm_acceleration,
    carried_arm_energy,
    carried_body,
    moment_about_pivot,
    pivot_force,
)
from ..structs import Drive
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .bodies import body_functions
from .body_states import body_state_functions
from .geometry import geometry_functions
from .prescribed_motion import prescribed_motion_functions
from .sync import sync_functions


@wp.func
def first_arm_body(drive: Drive, mine: ThreadParts):
    """Body of the first arm of the chain of a block's arm."""
    return mine.body - (mine.body_number - (drive.bodies - drive.arms))


@wp.func
def carrier_body(ensemble: Any, mine: ThreadParts):
    """Body that carries the arm of a block's thread; -1 for none."""
    drive = ensemble.drives[mine.drive_row]
    first = first_arm_body(drive, mine)
    on = ensemble.arms[drive.first_arm + mine.body - first].on
    return wp.where(on > 0, first + on - 1, -1)


@dataclass(frozen=True)
class CarriedArmFunctions:
    """Carried arm functions of a block."""

    add_carried_wrenches: wp.Function
    wrench_with_pivot_forces: wp.Function
    spring_moment_of_carried: wp.Function
    own_moment: wp.Function
    couple_accelerations: wp.Function
    place_carried_arm: wp.Function


@cache
def carried_arm_functions(kind: BlockKind) -> CarriedArmFunctions:
    """Carried arm functions of block kernels."""
    Real, rotors, kinds, Now = kind.Real, kind.parts.rotors, kind.types, kind.types.Now
    Ensemble, Shared, Wrench = kinds.Ensemble, kinds.Shared, kinds.Wrench
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    body_states, bodies = body_state_functions(kind), body_functions(kind)
    sync = sync_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    geometry = geometry_functions(kind)

    @wp.func
    def plus_carried_wrenches(ensemble: Ensemble, shared: Shared, mine: ThreadParts, acting: of_three):
        """Moment and force on the thread's arm, with those of arms that it carries."""
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                force = shared.carried_arms[first + k - rotors].force
                lever = leading_value(difference(shared.poses[first + k].center, shared.poses[mine.body].center))
                acting = acting + of_three(moment_about_pivot(lever, force), force[0], force[1])
        return acting

    @wp.func
    def add_carried_wrenches(ensemble: Ensemble, shared: Shared, mine: ThreadParts, acting: of_three):
        """Chain's moment and force on the thread's body and on arms that it carries; all threads together."""
        if wp.static(kind.parts.jointed):
            if mine.arm >= 0:
                shared.carried_arms[mine.arm].force = vec2(acting[1], acting[2])
            sync.barrier()
            if mine.arm >= 0:
                acting = plus_carried_wrenches(ensemble, shared, mine, acting)
        return acting

    @wp.func
    def wrench_with_pivot_forces(
        ensemble: Ensemble, shared: Shared, mine: ThreadParts, wrench: Wrench, rates: of_three
    ):
        """Wrench on the thread's arm with carried arms' pivot forces (`physics.hub`, (c)), and accelerations (b).

        Called after `couple_accelerations`.
        """
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                wrench.force = wrench.force + shared.carried_arms[first + k - rotors].force
                rates[2] = shared.carried_arms[mine.arm].acceleration
        return wrench, rates

    @wp.func
    def own_spring_state(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Angle and speed of the thread's arm, relative to its spring's other end."""
        drive, pose = ensemble.drives[mine.drive_row], shared.poses[mine.body]
        first = first_arm_body(drive, mine)
        return spring_state(drive, ensemble.arms, shared.poses, first, mine.body - first, pose)

    @wp.func
    def spring_moment_of_carried(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Moment [N m] on the thread's arm of springs, dampers and stops of arms that it carries."""
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        return carried_spring_moment(drive, ensemble.arms, shared.poses, first, mine.body - first)

    @wp.func
    def own_moment(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Moment [N m] on the thread's arm of its own spring and weight."""
        arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
        return arm_own_moment(own_spring_state(ensemble, shared, mine), pose_heading(shared.poses[mine.body]), arm)

    @wp.func
    def arm_now(ensemble: Ensemble, shared: Shared, b: int, angular: Real, time: Any, lag: Real):
        """State of a block's arm b of acceleration `angular`, with rates at `time`, `lag` after their instant [s]."""
        others, body = shared.arm_rates[b], body_states.body_from_pose(shared.poses[b])
        rates, mount = of_three(others[0], others[1], angular), bodies.body_mount(shared, b)
        return body_at_time(time, lag, body, rates, Real(0.0), shared.motions[b], mount, ensemble)

    @wp.func
    def find_acceleration(ensemble: Ensemble, shared: Shared, mine: ThreadParts, time: Any, lag: Real):
        """Shares the thread's arm's acceleration, and the observed state of its joint."""
        drive, on = ensemble.drives[mine.drive_row], carrier_body(ensemble, mine)
        first, arms, motions = first_arm_body(drive, mine), ensemble.arms, shared.motions
        poses, rates = shared.poses, shared.arm_rates
        a = wp.where(on >= 0, on, mine.body) - first
        angular = coupled_acceleration(drive, arms, motions, poses, rates, first, a, lag)
        energy = Real(0.0)
        if on >= 0:
            carrier = arm_now(ensemble, shared, on, angular, time, lag)
            terms, inverse = joint_terms(drive, arms, motions, poses, rates, first, mine.body - first, lag)
            angular = carried_arm_acceleration(angular, terms, inverse)
            seen = arm_now(ensemble, shared, mine.body, angular, time, lag)
            arm = arms[drive.first_arm + mine.body - first]
            lever = leading_value(world_vector(arm.lever, poses[on]))
            s = arm_mass_moment(pose_heading(poses[mine.body]), arm)
            energy = carried_arm_energy(seen.speed, s, lever, carrier)
            shared.carried_arms[mine.arm].force = pivot_force(seen.speed, angular, s)
            shared.carried_arms[mine.arm].speed = seen.speed - carrier.speed
        else:
            shared.carried_arms[mine.arm].speed = arm_now(ensemble, shared, mine.body, angular, time, lag).speed
        shared.carried_arms[mine.arm].angle = own_spring_state(ensemble, shared, mine).angle
        shared.carried_arms[mine.arm].acceleration = angular
        shared.carried_arms[mine.arm].energy = energy

    @wp.func
    def couple_accelerations(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench):
        """Shares load and coupled acceleration of the thread's arm; all threads together."""
        time, lag = prescribed_motion.step_time(mine, now), Real(0.0)
        if wp.static(kind.has_stages):
            time = stage_at(wp.static(kind.integrator), now.stage, time, prescribed_motion.exact_time_step(mine)).time
        else:
            lag = leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
        if mine.arm >= 0:
            pose, mount = shared.poses[mine.body], bodies.body_mount(shared, mine.body)
            others = spring_moment_of_carried(ensemble, shared, mine)
            load = own_moment(ensemble, shared, mine) + others
            shared.poses[mine.body].load = load
            wrench.load = load
            by, body, off = (
                bodies.with_bearing_moment(wrench),
                plain_body(body_states.body_from_pose(pose)),
                bodies.displacement(pose, mount),
            )
            rates = body_accelerations(
                time, off, body, pose_heading(pose), by, shared.motions[mine.body], mount, ensemble
            )
            shared.arm_rates[mine.body] = rates
            shared.carried_arms[mine.arm].moment = others
        sync.barrier()
        if mine.arm >= 0:
            find_acceleration(ensemble, shared, mine, time, lag)
        sync.barrier()

    @wp.func
    def place_carried_arm(ensemble: Ensemble, shared: Shared, mine: ThreadParts, going: int):
        """Moves the thread's arm with the one that carries it, unless the run ends; after a barrier."""
        if mine.arm >= 0 and going != 0:
            on = carrier_body(ensemble, mine)
            if on >= 0:
                arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
                geometry.put_pose(shared, mine.body, carried_body(shared.poses[mine.body], shared.poses[on], arm))

    return CarriedArmFunctions(
        add_carried_wrenches=add_carried_wrenches,
        wrench_with_pivot_forces=wrench_with_pivot_forces,
        spring_moment_of_carried=spring_moment_of_carried,
        own_moment=own_moment,
        couple_accelerations=couple_accelerations,
        place_carried_arm=place_carried_arm,
    )
