"""Arms that hang on arms, on blocks: what acts between them, and how each accelerates the other (`physics.hub`, (b)).

Before any body moves each arm's thread shares what it finds of its own arm, and reads that of those beside it.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..integrate import leapfrog_lag, stage_at
from ..number import difference, leading_value
from ..physics.body import (
    arm_mass_moment,
    arm_own_moment,
    arm_spring_moment,
    body_accelerations,
    body_at_time,
    plain_body,
)
from ..physics.guide import world_vector
from ..physics.hub import (
    carried_arm_acceleration,
    carried_arm_energy,
    carried_arm_terms,
    carried_body,
    eliminate_carried_arm,
    moment_about_pivot,
    pivot_force,
    relative_body,
)
from ..structs import Drive
from .arm_values import arm_value_functions
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .bodies import body_functions
from .body_states import body_state_functions
from .geometry import geometry_functions
from .prescribed_motion import prescribed_motion_functions
from .shared_memory import ARM_ACCELERATION, ARM_ENERGY, ARM_FORCE, ARM_MOMENT, ARM_RATES, ARM_TURN
from .sync import sync_functions


@wp.func
def first_arm_body(drive: Drive, mine: ThreadParts):
    """The body of the first arm of the chain of the thread's arm; the others come after it."""
    return mine.body - (mine.body_number - (drive.bodies - drive.arms))


@wp.func
def carrier_body(ensemble: Any, mine: ThreadParts):
    """The body that carries the thread's arm; negative for none."""
    drive = ensemble.drives[mine.drive_row]
    first = first_arm_body(drive, mine)
    on = ensemble.arms[drive.first_arm + mine.body - first].on
    return wp.where(on > 0, first + on - 1, -1)


@dataclass(frozen=True)
class CarriedArmFunctions:
    """Moments and accelerations of arms that carry arms (`physics.hub`, (b))."""

    add_carried_wrenches: wp.Function
    wrench_with_pivot_forces: wp.Function
    carried_spring_moment: wp.Function
    own_moment: wp.Function
    couple_accelerations: wp.Function
    place_carried_arm: wp.Function


@cache
def carried_arm_functions(kind: BlockKind) -> CarriedArmFunctions:
    """The functions of one variant's arms on arms on a block."""
    Real, kinds, Now = kind.Real, kind.types, kind.types.Now
    Ensemble, Shared, Wrench = kinds.Ensemble, kinds.Shared, kinds.Wrench
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    body_states, bodies = body_state_functions(kind), body_functions(kind)
    sync = sync_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)
    geometry, arm_values = geometry_functions(kind), arm_value_functions(kind)

    @wp.func
    def plus_carried_wrenches(ensemble: Ensemble, shared: Shared, mine: ThreadParts, acting: of_three):
        """Moment and force on the thread's arm, with what the arms on it have shared."""
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                force = vec2(
                    arm_values.shared_value(shared, first + k, ARM_FORCE),
                    arm_values.shared_value(shared, first + k, ARM_FORCE + 1),
                )
                lever = leading_value(difference(shared.poses[first + k].center, shared.poses[mine.body].center))
                acting = acting + of_three(moment_about_pivot(lever, force), force[0], force[1])
        return acting

    @wp.func
    def add_carried_wrenches(ensemble: Ensemble, shared: Shared, mine: ThreadParts, acting: of_three):
        """The chain's moment and force on the thread's body with those on arms on it; all threads together."""
        if wp.static(kind.parts.jointed):
            if mine.arm >= 0:
                arm_values.share_force(shared, mine.body, vec2(acting[1], acting[2]))
            sync.barrier()
            if mine.arm >= 0:
                acting = plus_carried_wrenches(ensemble, shared, mine, acting)
        return acting

    @wp.func
    def wrench_with_pivot_forces(
        ensemble: Ensemble, shared: Shared, mine: ThreadParts, wrench: Wrench, rates: of_three
    ):
        """The wrench on the thread's arm with what arms on it leave on their pivots, and its accelerations with them
        (`physics.hub`, (b) and (c)); once `couple_accelerations` has found these.
        """
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                wrench.force = wrench.force + vec2(
                    arm_values.shared_value(shared, first + k, ARM_FORCE),
                    arm_values.shared_value(shared, first + k, ARM_FORCE + 1),
                )
                rates[2] = arm_values.shared_value(shared, mine.body, ARM_ACCELERATION)
        return wrench, rates

    @wp.func
    def spring_state(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, k: int):
        """Arm `k` of a chain, whose first is body `first`, as its spring sees it turn."""
        body, on = body_states.body_from_pose(shared.poses[first + k]), ensemble.arms[drive.first_arm + k].on
        if on > 0:
            body = relative_body(body, shared.poses[first + on - 1])
        return plain_body(body)

    @wp.func
    def carried_spring_moment(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Moment [N m] on the thread's arm of the springs, dampers and stops of arms on it."""
        drive = ensemble.drives[mine.drive_row]
        first, moment = first_arm_body(drive, mine), Real(0.0)
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == mine.body - first + 1:
                moment = moment - arm_spring_moment(spring_state(ensemble, shared, drive, first, k), arm)
        return moment

    @wp.func
    def own_moment(ensemble: Ensemble, shared: Shared, mine: ThreadParts):
        """Moment [N m] on the thread's arm of its own spring and weight."""
        drive = ensemble.drives[mine.drive_row]
        first = first_arm_body(drive, mine)
        seen, to = (
            spring_state(ensemble, shared, drive, first, mine.body - first),
            body_states.heading(shared.poses[mine.body]),
        )
        return arm_own_moment(seen, to, ensemble.arms[drive.first_arm + mine.body - first])

    @wp.func
    def joint_terms(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, k: int, lag: Real):
        """The terms of arm `k` of a chain, whose first is body `first`, in (b), and 1 / I_2."""
        arm = ensemble.arms[drive.first_arm + k]
        b, on = first + k, first + arm.on - 1
        own, carrier = shared.poses[b], shared.poses[on]
        lever, s = leading_value(world_vector(arm.lever, carrier)), arm_mass_moment(body_states.heading(own), arm)
        w1, w2 = leading_value(carrier.speed) + lag * carrier.angular, leading_value(own.speed) + lag * own.angular
        led = vec2(arm_values.shared_value(shared, on, ARM_RATES), arm_values.shared_value(shared, on, ARM_RATES + 1))
        inverse = Real(shared.motions[b].inverse_inertia)
        return carried_arm_terms(
            lever, s, w1, w2, led, arm_values.shared_value(shared, b, ARM_RATES + 2) / inverse
        ), inverse

    @wp.func
    def coupled_acceleration(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, a: int, lag: Real):
        """Acceleration [rad/s^2] of arm `a` of a chain, whose first is body `first`, with what hangs on it."""
        inertia = Real(1.0) / shared.motions[first + a].inverse_inertia
        moment = inertia * arm_values.shared_value(shared, first + a, ARM_RATES + 2)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == a + 1:
                terms, inverse = joint_terms(ensemble, shared, drive, first, k, lag)
                moment, inertia = eliminate_carried_arm(moment, inertia, terms, inverse)
        return moment / inertia

    @wp.func
    def arm_now(ensemble: Ensemble, shared: Shared, b: int, angular: Real, time: Any, lag: Real):
        """Body b, an arm that has this acceleration, with its rates at `time`, `lag` after their instant."""
        rates = of_three(
            arm_values.shared_value(shared, b, ARM_RATES), arm_values.shared_value(shared, b, ARM_RATES + 1), angular
        )
        body, mount = body_states.body_from_pose(shared.poses[b]), bodies.body_mount(shared, b)
        return body_at_time(time, lag, body, rates, Real(0.0), shared.motions[b], mount, ensemble)

    @wp.func
    def find_acceleration(ensemble: Ensemble, shared: Shared, mine: ThreadParts, time: Any, lag: Real):
        """Shares the acceleration of the thread's arm, and what is observed of its joint."""
        drive, on = ensemble.drives[mine.drive_row], carrier_body(ensemble, mine)
        first = first_arm_body(drive, mine)
        arm = ensemble.arms[drive.first_arm + mine.body - first]
        angular = Real(0.0)
        energy = Real(0.0)
        if on >= 0:
            led = coupled_acceleration(ensemble, shared, drive, first, on - first, lag)
            terms, inverse = joint_terms(ensemble, shared, drive, first, mine.body - first, lag)
            angular = carried_arm_acceleration(led, terms, inverse)
            seen = arm_now(ensemble, shared, mine.body, angular, time, lag)
            carrier = arm_now(ensemble, shared, on, led, time, lag)
            lever = leading_value(world_vector(arm.lever, shared.poses[on]))
            s = arm_mass_moment(body_states.heading(shared.poses[mine.body]), arm)
            energy = carried_arm_energy(seen.speed, s, lever, carrier)
            arm_values.share_force(shared, mine.body, pivot_force(seen.speed, angular, s))
            arm_values.share_value(shared, mine.body, ARM_TURN + 1, seen.speed - carrier.speed)
        else:
            angular = coupled_acceleration(ensemble, shared, drive, first, mine.body - first, lag)
            arm_values.share_value(
                shared, mine.body, ARM_TURN + 1, arm_now(ensemble, shared, mine.body, angular, time, lag).speed
            )
        arm_values.share_value(
            shared, mine.body, ARM_TURN, spring_state(ensemble, shared, drive, first, mine.body - first).angle
        )
        arm_values.share_value(shared, mine.body, ARM_ACCELERATION, angular)
        arm_values.share_value(shared, mine.body, ARM_ENERGY, energy)

    @wp.func
    def couple_accelerations(ensemble: Ensemble, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench):
        """Finds load and acceleration of the thread's arm; all threads together, before any body moves.

        Args:
            wrench: of the chain on the thread's body, of bearings and of tensioners.
        """
        time, lag = bodies.step_time(mine, now), Real(0.0)
        if wp.static(kind.has_stages):
            time = stage_at(wp.static(kind.integrator), now.stage, time, prescribed_motion.exact_time_step(mine)).time
        else:
            lag = leapfrog_lag(now.step, leading_value(prescribed_motion.exact_time_step(mine)))
        if mine.arm >= 0:
            pose, mount = shared.poses[mine.body], bodies.body_mount(shared, mine.body)
            others = carried_spring_moment(ensemble, shared, mine)
            load = own_moment(ensemble, shared, mine) + others
            shared.poses[mine.body].load = load
            wrench.load = load
            by, body, off = (
                bodies.with_bearing_moment(wrench),
                plain_body(body_states.body_from_pose(pose)),
                bodies.displacement(pose, mount),
            )
            rates = body_accelerations(
                time, off, body, body_states.heading(pose), by, shared.motions[mine.body], mount, ensemble
            )
            for k in range(3):
                arm_values.share_value(shared, mine.body, ARM_RATES + k, rates[k])
            arm_values.share_value(shared, mine.body, ARM_MOMENT, others)
        sync.barrier()
        if mine.arm >= 0:
            find_acceleration(ensemble, shared, mine, time, lag)
        sync.barrier()

    @wp.func
    def place_carried_arm(ensemble: Ensemble, shared: Shared, mine: ThreadParts, going: int):
        """Takes the thread's arm along with one that carries it, if the run goes on; after a barrier."""
        if mine.arm >= 0 and going != 0:
            on = carrier_body(ensemble, mine)
            if on >= 0:
                arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
                geometry.put_pose(shared, mine.body, carried_body(shared.poses[mine.body], shared.poses[on], arm))

    return CarriedArmFunctions(
        add_carried_wrenches=add_carried_wrenches,
        wrench_with_pivot_forces=wrench_with_pivot_forces,
        carried_spring_moment=carried_spring_moment,
        own_moment=own_moment,
        couple_accelerations=couple_accelerations,
        place_carried_arm=place_carried_arm,
    )
