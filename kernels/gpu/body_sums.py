"""Sums over the window of the body of a block's thread, and its energy."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import leapfrog_lag
from ..number import leading_value
from ..physics.body import (
    arm_dissipation,
    arm_energy,
    arm_own_moment,
    body_accelerations,
    body_energy,
    heading_of,
    holding_force_and_power,
    late_contact_power,
    pivot_power,
    pose_heading,
    speed_as_float64,
)
from ..physics.motion import load_moment_at_speed
from ..physics.mount import CARRIED
from ..physics.train import own_body_energy
from ..physics.valve import cam_energy
from ..structs import Tallies
from ..sums import add_arm, add_energy, add_mount, add_powers
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .bodies import body_functions
from .carried_arms import carried_arm_functions
from .events import START
from .prescribed_motion import prescribed_motion_functions


@dataclass(frozen=True)
class BodySumFunctions:
    """Body sum functions of a block."""

    late_power_on_body: wp.Function
    add_sprocket_step: wp.Function
    power_on_pivot: wp.Function
    add_arm_step: wp.Function
    add_body_energy: wp.Function


@cache
def body_sum_functions(kind: BlockKind) -> BodySumFunctions:
    """Body sum functions of block kernels."""
    Real = kind.Real
    bodies = body_functions(kind)
    carried_arms, prescribed_motion = carried_arm_functions(kind), prescribed_motion_functions(kind)
    kinds, Now = kind.types, kind.types.Now
    Ensemble, Shared, Pose, Wrench = kinds.Ensemble, kinds.Shared, kinds.Pose, kinds.Wrench
    vec2 = kinds.vec2
    of_three = wp.types.vector(3, Real)

    @wp.func
    def exact_heading(pose: Pose, seen: kinds.Instant):
        """Cosine and sine of the angle of a block's body, at float64 computed from it."""
        if wp.static(kind.is_paired):
            return pose_heading(pose)
        else:
            return heading_of(seen)

    @wp.func
    def velocity_lag(mine: ThreadParts, now: Now):
        """Time [s] from velocities to forces of a block's bodies."""
        if wp.static(kind.has_stages):
            return Real(0.0)
        else:
            return leapfrog_lag(now.step, Real(mine.step))

    @wp.func
    def late_power_on_body(
        shared: Shared, mine: ThreadParts, now: Now, before: Pose, seen: kinds.Instant, acting: of_three
    ):
        """Power [W] that contacts on the thread's body miss (`body.late_contact_power`).

        `acting` is as in `add_sprocket_step`.
        """
        wrench = kinds.Wrench()
        wrench.moment = acting[0]
        carried = bool(True)  # or fixed
        if wp.static(kind.moving):
            wrench.force = vec2(acting[1], acting[2])
            carried = shared.mounts[mine.body].moves == CARRIED
        return late_contact_power(wrench, seen, before, velocity_lag(mine, now), carried)

    @wp.func
    def add_sprocket_step(
        ensemble: Ensemble,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
        acting: of_three,
        whole: Wrench,
    ):
        """Adds a step of the thread's sprocket to the window's sums.

        Args:
            before: pose before the step.
            seen: body at the step's instant.
            acting: chain's moment [N m] and force (x, y) [N].
            whole: wrench of chain and tensioners, with the load.
        """
        s = mine.sprocket
        speed, motion = leading_value(before.speed), shared.motions[s]
        rounded = prescribed_motion.rounded_step_time(mine, now)
        whole.load = load_moment_at_speed(rounded, whole.load, speed, seen.speed, motion)
        if wp.static(kind.moving):
            mount = shared.mounts[s]
            if mount.active != 0:
                off, to = bodies.displacement(before, mount), exact_heading(before, seen)
                by = bodies.with_bearing_moment(whole)
                time = prescribed_motion.step_time(mine, now)
                rates = body_accelerations(time, off, seen, to, by, motion, mount, ensemble)
                held, power = holding_force_and_power(off, seen, to, by, rates, motion, mount)
                sums = shared.mount_sums[s]
                shared.mount_sums[s] = add_mount(sums, off, seen.velocity, mount, held, power, now.weight)
        late = late_power_on_body(shared, mine, now, before, seen, acting)
        shared.sprocket_sums[s] = add_powers(
            shared.sprocket_sums[s], seen.speed, acting[0], whole.load, late, now.weight
        )

    @wp.func
    def power_on_pivot(
        ensemble: Ensemble,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
        whole: Wrench,
    ):
        """Power [W] of what moves the pivot of the thread's arm; arguments as in `add_sprocket_step`."""
        led = Real(0.0)
        if wp.static(kind.moving):
            arm, motion = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm], shared.motions[mine.body]
            mount = bodies.body_mount(shared, mine.body)
            if mount.active != 0:
                off, to = bodies.displacement(before, mount), exact_heading(before, seen)
                whole.load = arm_own_moment(seen, to, arm)
                if wp.static(kind.parts.jointed):
                    whole.load = whole.load + shared.carried_arms[mine.arm].moment
                acting, time = bodies.with_bearing_moment(whole), prescribed_motion.step_time(mine, now)
                rates = body_accelerations(time, off, seen, to, acting, motion, mount, ensemble)
                if wp.static(kind.parts.jointed):
                    acting, rates = carried_arms.wrench_with_pivot_forces(ensemble, shared, mine, acting, rates)
                held, power = holding_force_and_power(off, seen, to, acting, rates, motion, mount)
                led = pivot_power(power, seen, arm)
        return led

    @wp.func
    def spring_state(shared: Shared, mine: ThreadParts, seen: kinds.Instant):
        """Angle and speed of the thread's arm `seen`, relative to its spring's other end."""
        if wp.static(kind.parts.jointed):
            seen.angle = shared.carried_arms[mine.arm].angle
            seen.speed = shared.carried_arms[mine.arm].speed
        return seen

    @wp.func
    def add_arm_step(
        ensemble: Ensemble,
        sums: kinds.Sums,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        seen: kinds.Instant,
        moment: Real,
        powers: vec2,
    ):
        """Adds a step of the thread's arm to the window's sums.

        `moment` is the chain's [N m]; `powers` [W] are the pivot's and `late_power_on_body`.
        """
        at = ensemble.drives[mine.variant].first_arm + mine.arm
        power = arm_dissipation(spring_state(shared, mine, seen), ensemble.arms[at])
        sums.arm[at] = add_arm(sums.arm[at], seen, moment, power, powers[0], powers[1], now.weight)

    @wp.func
    def add_body_energy(
        ensemble: Ensemble,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
    ):
        """Adds the energy of the thread's body to its tally, at the window's ends."""
        drive = ensemble.drives[mine.variant]
        motion, mount = shared.motions[mine.body], bodies.body_mount(shared, mine.body)
        to, at = exact_heading(before, seen), ensemble.drives[mine.drive_row].first_body + mine.body_number
        energy = body_energy(bodies.displacement(before, mount), seen, to, motion, mount)
        if wp.static(kind.parts.arms):
            if mine.arm >= 0:
                if wp.static(kind.parts.jointed):
                    energy = energy + wp.float64(shared.carried_arms[mine.arm].energy)
                turned = spring_state(shared, mine, seen)
                energy = arm_energy(energy, turned, to, ensemble.arms[drive.first_arm + mine.arm])
        if wp.static(kind.parts.is_tied):
            if mine.arm < 0:
                energy = own_body_energy(energy, speed_as_float64(seen), motion)
                if wp.static(kind.parts.valves):
                    energy = energy + wp.float64(cam_energy(seen.speed, shared.cams[mine.body], motion))
        tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)

    return BodySumFunctions(
        late_power_on_body=late_power_on_body,
        add_sprocket_step=add_sprocket_step,
        power_on_pivot=power_on_pivot,
        add_arm_step=add_arm_step,
        add_body_energy=add_body_energy,
    )
