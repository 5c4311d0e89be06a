"""Arms that hang on arms, on blocks: what acts between them, and how each accelerates the other (`physics.hub`, (b)).

Before any body moves each arm's thread shares what it finds of its own arm, and reads that of those beside it.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..integrate import leapfrog_lag, stage_at
from ..native import row_access
from ..number import difference, leading
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
from .bodies import body_access, body_steps, prescribed_motion
from .geometry import contact_geometry
from .kind import BlockKind, Mine
from .shared_memory import ANGULAR, ENERGY, FORCE, MOMENT, OF_AN_ARM, RATES, TURNED
from .sync import sync


@cache
def block_jointed(kind: BlockKind) -> SimpleNamespace:
    """The functions of one variant's arms on arms on a block."""
    Real, mounted, staged = kind.Real, kind.parts.mounted, kind.staged
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Wrench = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Wrench
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    access, steps = body_access(kind), body_steps(kind)
    state_of, heading, step_number = access.state_of, access.heading, prescribed_motion(kind).step_number
    store_row, put_pose, of_joints = row_access(Real).store, contact_geometry(kind).put_pose, access.of_joints
    barrier = sync(kind).barrier

    @wp.func
    def put(shared: Shared, b: int, k: int, value: Real):
        """Shares value k of body b, an arm."""
        store_row(shared.joints, (b - wp.static(mounted)) * wp.static(OF_AN_ARM) + k, value)

    @wp.func
    def got(shared: Shared, b: int, k: int):
        """Value k that body b, an arm, shares."""
        return of_joints(shared, b - wp.static(mounted), k)

    @wp.func
    def put_force(shared: Shared, b: int, force: vec2):
        """Shares a force [N] that body b, an arm, passes on to the one that carries it."""
        put(shared, b, FORCE, force[0])
        put(shared, b, FORCE + 1, force[1])

    @wp.func
    def first_arm(drive: Drive, mine: Mine):
        """The body of the first arm of the chain of the thread's arm; the others come after it."""
        return mine.body - (mine.number - (drive.bodies - drive.arms))

    @wp.func
    def carrier_of(ensemble: Ensemble, mine: Mine):
        """The body that carries the thread's arm; negative for none."""
        drive = ensemble.drives[mine.row]
        first = first_arm(drive, mine)
        on = ensemble.arms[drive.first_arm + mine.body - first].on
        return wp.where(on > 0, first + on - 1, -1)

    @wp.func
    def with_hanging(ensemble: Ensemble, shared: Shared, mine: Mine, acting: of_three):
        """Those on the thread's arm, with what the arms on it have shared."""
        drive = ensemble.drives[mine.row]
        first = first_arm(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                force = vec2(got(shared, first + k, FORCE), got(shared, first + k, FORCE + 1))
                lever = leading(difference(shared.poses[first + k].center, shared.poses[mine.body].center))
                acting = acting + of_three(moment_about_pivot(lever, force), force[0], force[1])
        return acting

    @wp.func
    def hang(ensemble: Ensemble, shared: Shared, mine: Mine, acting: of_three):
        """The chain's moment and force on the thread's body with those on arms on it; all threads together."""
        if wp.static(kind.parts.jointed):
            if mine.arm >= 0:
                put_force(shared, mine.body, vec2(acting[1], acting[2]))
            barrier()
            if mine.arm >= 0:
                acting = with_hanging(ensemble, shared, mine, acting)
        return acting

    @wp.func
    def with_turning(ensemble: Ensemble, shared: Shared, mine: Mine, wrench: Wrench, rates: of_three):
        """The wrench on the thread's arm with what arms on it leave on their pivots, and its accelerations with them
        (`physics.hub`, (b) and (c)); once `couple` has found these.
        """
        drive = ensemble.drives[mine.row]
        first = first_arm(drive, mine)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == mine.body - first + 1:
                wrench.force = wrench.force + vec2(got(shared, first + k, FORCE), got(shared, first + k, FORCE + 1))
                rates[2] = got(shared, mine.body, ANGULAR)
        return wrench, rates

    @wp.func
    def turned(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, k: int):
        """Arm `k` of a chain, whose first is body `first`, as its spring sees it turn."""
        body, on = state_of(shared.poses[first + k]), ensemble.arms[drive.first_arm + k].on
        if on > 0:
            body = relative_body(body, shared.poses[first + on - 1])
        return plain_body(body)

    @wp.func
    def joints_on(ensemble: Ensemble, shared: Shared, mine: Mine):
        """Moment [N m] on the thread's arm of the springs, dampers and stops of arms on it."""
        drive = ensemble.drives[mine.row]
        first, moment = first_arm(drive, mine), Real(0.0)
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == mine.body - first + 1:
                moment = moment - arm_spring_moment(turned(ensemble, shared, drive, first, k), arm)
        return moment

    @wp.func
    def own_on(ensemble: Ensemble, shared: Shared, mine: Mine):
        """Moment [N m] on the thread's arm of its own spring and weight."""
        drive = ensemble.drives[mine.row]
        first = first_arm(drive, mine)
        seen, to = turned(ensemble, shared, drive, first, mine.body - first), heading(shared.poses[mine.body])
        return arm_own_moment(seen, to, ensemble.arms[drive.first_arm + mine.body - first])

    @wp.func
    def of_joint(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, k: int, lag: Real):
        """The terms of arm `k` of a chain, whose first is body `first`, in (b), and 1 / I_2."""
        arm = ensemble.arms[drive.first_arm + k]
        b, on = first + k, first + arm.on - 1
        own, carrier = shared.poses[b], shared.poses[on]
        lever, s = leading(world_vector(arm.lever, carrier)), arm_mass_moment(heading(own), arm)
        w1, w2 = leading(carrier.speed) + lag * carrier.angular, leading(own.speed) + lag * own.angular
        led = vec2(got(shared, on, RATES), got(shared, on, RATES + 1))
        inverse = Real(shared.motions[b].inverse_inertia)
        return carried_arm_terms(lever, s, w1, w2, led, got(shared, b, RATES + 2) / inverse), inverse

    @wp.func
    def together(ensemble: Ensemble, shared: Shared, drive: Drive, first: int, a: int, lag: Real):
        """Acceleration [rad/s^2] of arm `a` of a chain, whose first is body `first`, with what hangs on it."""
        inertia = Real(1.0) / shared.motions[first + a].inverse_inertia
        moment = inertia * got(shared, first + a, RATES + 2)
        for k in range(drive.arms):
            if ensemble.arms[drive.first_arm + k].on == a + 1:
                terms, inverse = of_joint(ensemble, shared, drive, first, k, lag)
                moment, inertia = eliminate_carried_arm(moment, inertia, terms, inverse)
        return moment / inertia

    @wp.func
    def now_of(ensemble: Ensemble, shared: Shared, b: int, angular: Real, time: Any, lag: Real):
        """Body b, an arm that has this acceleration, with its rates at `time`, `lag` after their instant."""
        rates = of_three(got(shared, b, RATES), got(shared, b, RATES + 1), angular)
        body, mount = state_of(shared.poses[b]), steps.mount_of(shared, b)
        return body_at_time(time, lag, body, rates, Real(0.0), shared.motions[b], mount, ensemble)

    @wp.func
    def accelerate(ensemble: Ensemble, shared: Shared, mine: Mine, time: Any, lag: Real):
        """Shares the acceleration of the thread's arm, and what is observed of its joint."""
        drive, on = ensemble.drives[mine.row], carrier_of(ensemble, mine)
        first = first_arm(drive, mine)
        arm = ensemble.arms[drive.first_arm + mine.body - first]
        angular = Real(0.0)
        energy = Real(0.0)
        if on >= 0:
            led = together(ensemble, shared, drive, first, on - first, lag)
            terms, inverse = of_joint(ensemble, shared, drive, first, mine.body - first, lag)
            angular = carried_arm_acceleration(led, terms, inverse)
            seen = now_of(ensemble, shared, mine.body, angular, time, lag)
            carrier = now_of(ensemble, shared, on, led, time, lag)
            lever = leading(world_vector(arm.lever, shared.poses[on]))
            s = arm_mass_moment(heading(shared.poses[mine.body]), arm)
            energy = carried_arm_energy(seen.speed, s, lever, carrier)
            put_force(shared, mine.body, pivot_force(seen.speed, angular, s))
            put(shared, mine.body, TURNED + 1, seen.speed - carrier.speed)
        else:
            angular = together(ensemble, shared, drive, first, mine.body - first, lag)
            put(shared, mine.body, TURNED + 1, now_of(ensemble, shared, mine.body, angular, time, lag).speed)
        put(shared, mine.body, TURNED, turned(ensemble, shared, drive, first, mine.body - first).angle)
        put(shared, mine.body, ANGULAR, angular)
        put(shared, mine.body, ENERGY, energy)

    @wp.func
    def couple(ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, wrench: Wrench):
        """Finds load and acceleration of the thread's arm; all threads together, before any body moves.

        Args:
            wrench: of the chain on the thread's body, of bearings and of tensioners.
        """
        time, lag = steps.time_of(mine, now), Real(0.0)
        if wp.static(staged):
            time = stage_at(wp.static(kind.integrator), now.stage, time, step_number(mine)).time
        else:
            lag = leapfrog_lag(now.step, leading(step_number(mine)))
        if mine.arm >= 0:
            pose, mount = shared.poses[mine.body], steps.mount_of(shared, mine.body)
            others = joints_on(ensemble, shared, mine)
            load = own_on(ensemble, shared, mine) + others
            shared.poses[mine.body].load = load
            wrench.load = load
            by, body, off = steps.with_bearing(wrench), plain_body(state_of(pose)), steps.off(pose, mount)
            rates = body_accelerations(time, off, body, heading(pose), by, shared.motions[mine.body], mount, ensemble)
            for k in range(3):
                put(shared, mine.body, RATES + k, rates[k])
            put(shared, mine.body, MOMENT, others)
        barrier()
        if mine.arm >= 0:
            accelerate(ensemble, shared, mine, time, lag)
        barrier()

    @wp.func
    def carry(ensemble: Ensemble, shared: Shared, mine: Mine, going: int):
        """Takes the thread's arm along with one that carries it, if the run goes on; after a barrier."""
        if mine.arm >= 0 and going != 0:
            on = carrier_of(ensemble, mine)
            if on >= 0:
                arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
                put_pose(shared, mine.body, carried_body(shared.poses[mine.body], shared.poses[on], arm))

    return SimpleNamespace(**locals())
