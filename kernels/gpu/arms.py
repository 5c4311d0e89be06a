"""Arms and tensioners on blocks of threads: how the thread that has a body takes on its arm, and what pushes it.

At float32 what a tensioner remembers, and what is added up of it, the thread that has its body keeps in shared memory.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import leapfrog_kick, leapfrog_lag, rk4_reach, rk4_stage, rk4_weight
from ..number import apart, rounded, whole
from ..physics.arm import arm_dissipation, arm_energy, arm_rates, arm_turning
from ..physics.body import body_at, heading_of, leapfrog_body, pose_of, rk4_body
from ..physics.spin import spin_staged, spun, swung, wheel_at, with_spin
from ..physics.tensioner import (
    extension,
    lever_of,
    lost_power,
    push_by,
    stroke_of,
    stroke_rate,
    tensioner_energy,
    tensioner_step,
)
from ..structs import BodyState, Led, Motion, Mount, Spin, Wheel, Wrench, types
from ..sum_structs import Sums, Tallies
from ..sums import add_arm, add_energy, add_meter, add_tensioner, metered
from .bodies import Seen, state_of, with_velocity
from .events import END, ENDS, START
from .kind import BlockKind, Mine, now_struct
from .wheels import load_wheel, store_turn, store_wheel


@cache
def block_arms(kind: BlockKind) -> SimpleNamespace:
    """The functions of one variant's arms and tensioners on a block; body b is that of the drive."""
    return _at_float32(kind) if kind.paired else _at_float64(kind)


def _at_float64(kind: BlockKind) -> SimpleNamespace:
    """The functions at float64, and while settling."""
    sprockets, tensioners, rk4 = kind.sprockets, kind.tensioners, kind.rk4
    kinds, Now = types(kind.Real), now_struct(kind.Real)

    @wp.func
    def start_arm(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine):
        """What is shared of the thread's arm."""
        b = wp.static(sprockets) + mine.arm
        shared.poses[b] = pose_of(state.bodies[ensemble.drives[mine.variant].first_body + b])

    @wp.func
    def end_arm(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine):
        """The thread's arm back into the state."""
        b = wp.static(sprockets) + mine.arm
        state.bodies[ensemble.drives[mine.variant].first_body + b] = state_of(shared.poses[b])

    @wp.func
    def pushed(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, b: int, wrench: Wrench):
        """The wrench on body b with what its tensioners do to it."""
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(first, first + wp.static(tensioners)):
            tensioner = ensemble.tensioners[t]
            if tensioner.body == b:
                push = push_by(state_of(shared.poses[b]), state.tensioners[t], tensioner)
                state.pushes[t] = push
                wrench.force = wrench.force + push.wrench.force
                wrench.moment = wrench.moment + push.wrench.moment
        return wrench

    @wp.func
    def observe_pushes(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        mine: Mine,
        now: Now,
        b: int,
        body: BodyState,
    ):
        """One step of the tensioners of body b, which has its rates at the step's instant, for the window's sums."""
        drive = ensemble.drives[mine.variant]
        for t in range(drive.first_tensioner, drive.first_tensioner + wp.static(tensioners)):
            tensioner = ensemble.tensioners[t]
            if tensioner.body == b:
                push = state.pushes[t]
                x, rate = stroke_of(body, tensioner)
                power = lost_power(push, rate, state.tensioners[t], tensioner)
                added = add_tensioner(sums.tensioner[t], push, power, wp.float64(now.weight))
                sums.tensioner[t] = add_meter(added, state.meters[t], now.flags & START != 0, now.flags & END != 0)
                if now.flags & ENDS != 0:
                    energy = tensioner_energy(push.extension, state.tensioners[t], tensioner)
                    at = drive.first_body + b
                    tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)

    @wp.func
    def flow(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, b: int):
        """What flows in a step through the tensioners of body b, once it has moved."""
        if now.going != 0 and (not wp.static(rk4) or now.stage == 3):
            first = ensemble.drives[mine.variant].first_tensioner
            for t in range(first, first + wp.static(tensioners)):
                tensioner = ensemble.tensioners[t]
                if tensioner.body == b:
                    x, rate = stroke_of(state_of(shared.poses[b]), tensioner)
                    after, flows = tensioner_step(x, rate, mine.h, state.tensioners[t], tensioner)
                    state.tensioners[t] = after
                    state.meters[t] = metered(state.meters[t], flows)

    @wp.func
    def move_arm(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, now: Now, rates: wp.vec3d
    ):
        """Takes the thread's arm on by a step, or a stage of rk4."""
        b = wp.static(sprockets) + mine.arm
        body = state_of(shared.poses[b])
        free = Motion()
        pivot = Mount()
        if wp.static(rk4):
            at = rk4_stage(now.stage, wp.float64(now.step) * mine.h, mine.h)
            place = ensemble.drives[mine.variant].first_body + b
            body, stages = rk4_body(at, body, state.body_stages[place], rates, free, pivot, ensemble.curves)
            state.body_stages[place] = stages
        else:
            kick = leapfrog_kick(now.step, mine.h)
            body = leapfrog_body(wp.float64(0.0), kick, mine.h, body, rates, wp.float64(0.0), free, pivot)
        shared.poses[b] = pose_of(body)

    @wp.func
    def advance_arm(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        wrench: Wrench,
    ):
        """Takes the thread's arm, on which the chain's `wrench` acts, on by a step or a stage, and observes it.

        Returns it with its rates at the step's instant.
        """
        b = wp.static(sprockets) + mine.arm
        drive = ensemble.drives[mine.variant]
        arm = ensemble.arms[drive.first_arm + mine.arm]
        body = state_of(shared.poses[b])
        heading = heading_of(body)
        rates = arm_rates(body, heading, pushed(ensemble, state, shared, mine, b, wrench).moment, arm)
        lag = wp.float64(0.0)
        if wp.static(not rk4):
            lag = leapfrog_lag(now.step, mine.h)
        observed = body_at(wp.float64(0.0), lag, body, rates, wp.float64(0.0), Motion(), Mount())
        if wp.static(kind.measuring) and now.measured != 0:
            a = drive.first_arm + mine.arm
            power = arm_dissipation(observed, arm)
            sums.arm[a] = add_arm(sums.arm[a], observed, wrench.moment, power, wp.float64(now.weight))
            if now.flags & ENDS != 0:
                energy = arm_energy(observed, heading, arm)
                at = drive.first_body + b
                tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)
            observe_pushes(ensemble, state, sums, tallies, mine, now, b, observed)
        if now.going != 0:
            move_arm(ensemble, state, shared, mine, now, rates)
        flow(ensemble, state, shared, mine, now, b)
        return observed

    @wp.func
    def rest_arm(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, wrench: Wrench):
        """Angular acceleration of the thread's arm while settling [rad/s^2]."""
        b = wp.static(sprockets) + mine.arm
        body = state_of(shared.poses[b])
        moment = pushed(ensemble, state, shared, mine, b, wrench).moment
        arm = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm]
        return arm_rates(body, heading_of(body), moment, arm)[2]

    return SimpleNamespace(
        start_arm=start_arm,
        end_arm=end_arm,
        pushed=pushed,
        observe_pushes=observe_pushes,
        flow=flow,
        advance_arm=advance_arm,
        rest_arm=rest_arm,
    )


def _at_float32(kind: BlockKind) -> SimpleNamespace:
    """The functions at float32, which share what tensioners remember, and sums, in pairs."""
    sprockets, tensioners, rk4, measuring = kind.sprockets, kind.tensioners, kind.rk4, kind.measuring
    kinds, Now = types(kind.Real), now_struct(kind.Real)

    @wp.func
    def start_tensioners(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine, b: int
    ):
        """What is shared of the tensioners of body b."""
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            if ensemble.block_tensioners[first + t].body == b:
                shared.tensioners[t] = kinds.narrowed(state.tensioners[first + t])
                if wp.static(measuring):
                    shared.meters[t] = kinds.narrowed(state.meters[first + t])
                    shared.tensioner_sums[t] = kinds.narrowed(sums.tensioner[first + t])

    @wp.func
    def end_tensioners(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine, b: int
    ):
        """The tensioners of body b and their sums back into the state."""
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            if ensemble.block_tensioners[first + t].body == b:
                state.tensioners[first + t] = whole(shared.tensioners[t])
                if wp.static(measuring):
                    state.meters[first + t] = whole(shared.meters[t])
                    sums.tensioner[first + t] = whole(shared.tensioner_sums[t])

    @wp.func
    def start_arm(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine):
        """What is shared of the thread's arm and its tensioners."""
        drive = ensemble.drives[mine.variant]
        b = wp.static(sprockets) + mine.arm
        store_wheel(shared.wheels, b, wheel_at(state.bodies[drive.first_body + b], wp.float64(0.0)))
        if wp.static(measuring):
            shared.arm_sums[mine.arm] = kinds.narrowed(sums.arm[drive.first_arm + mine.arm])
        start_tensioners(ensemble, state, sums, shared, mine, b)

    @wp.func
    def end_arm(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine):
        """The thread's arm, its tensioners and their sums back into the state."""
        drive = ensemble.drives[mine.variant]
        b = wp.static(sprockets) + mine.arm
        at = drive.first_body + b
        state.bodies[at] = with_spin(state.bodies[at], load_wheel(shared.wheels, b))
        if wp.static(measuring):
            sums.arm[drive.first_arm + mine.arm] = whole(shared.arm_sums[mine.arm])
        end_tensioners(ensemble, state, sums, shared, mine, b)

    @wp.func
    def pushed(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, b: int):
        """What its tensioners do to body b: moment [N m], force (x, y) [N]."""
        acting = wp.vec3f()
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            tensioner = ensemble.block_tensioners[first + t]
            if tensioner.body == b:
                body = with_velocity(shared.wheels, b, load_wheel(shared.wheels, b))
                push, wrench = push_by(body, shared.tensioners[t], ensemble.strokes[first + t], tensioner)
                shared.pushes[t] = push
                acting = acting + wrench
        return acting

    @wp.func
    def observe_pushes(
        ensemble: kinds.Ensemble,
        sums: Sums,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        before: Wheel,
        seen: Seen,
    ):
        """One step of the tensioners of the thread's body for the window's sums.

        `before` is where the body was, `seen` has its rates at the step's instant.
        """
        drive = ensemble.drives[mine.variant]
        b = wp.where(mine.arm >= 0, wp.static(sprockets) + mine.arm, mine.sprocket)
        for t in range(wp.static(tensioners)):
            at = drive.first_tensioner + t
            tensioner = ensemble.block_tensioners[at]
            if tensioner.body == b:
                push = shared.pushes[t]
                kept = shared.tensioners[t]
                rate = stroke_rate(lever_of(before, ensemble.strokes[at]), seen.speed, seen.velocity, tensioner)
                power = lost_power(push, rate, kept, tensioner)
                shared.tensioner_sums[t] = add_tensioner(shared.tensioner_sums[t], push, power, now.weight)
                if now.flags & ENDS != 0:
                    starts, ends = now.flags & START != 0, now.flags & END != 0
                    meter = whole(shared.meters[t])
                    shared.tensioner_sums[t] = add_meter(shared.tensioner_sums[t], meter, starts, ends)
                    energy = wp.float64(tensioner_energy(push.extension, kept, tensioner))
                    of = drive.first_body + b
                    tallies.body[of] = add_energy(tallies.body[of], starts, energy)

    @wp.func
    def flow(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, b: int):
        """What flows in a step through the tensioners of body b, once it has moved."""
        if now.going != 0 and (not wp.static(rk4) or now.stage == 3):
            first = ensemble.drives[mine.variant].first_tensioner
            for t in range(wp.static(tensioners)):
                tensioner = ensemble.block_tensioners[first + t]
                if tensioner.body == b:
                    body = with_velocity(shared.wheels, b, load_wheel(shared.wheels, b))
                    stroke = ensemble.strokes[first + t]
                    rate = stroke_rate(lever_of(body, stroke), body.speed.high, body.velocity, tensioner)
                    x = extension(body, stroke)
                    after, flows = tensioner_step(x, rate, mine.step.high, shared.tensioners[t], tensioner)
                    shared.tensioners[t] = after
                    if wp.static(measuring):
                        shared.meters[t] = metered(shared.meters[t], flows)

    @wp.func
    def move_arm(shared: kinds.Shared, mine: Mine, now: Now, wheel: Wheel, angular: wp.float32):
        """Takes the thread's arm on by a step, or a stage of rk4."""
        b = wp.static(sprockets) + mine.arm
        h = mine.step.high
        if wp.static(rk4):
            before = wheel.angle
            stages = shared.wheel_stages[b]
            weight = rk4_weight(now.stage, h)
            wheel, stages = spin_staged(now.stage, weight, rk4_reach(now.stage, h), wheel, stages, angular)
            shared.wheel_stages[b] = stages
            store_turn(shared.wheels, b, swung(wheel, apart(wheel.angle, before)))
        else:
            store_turn(shared.wheels, b, spun(wheel, leapfrog_kick(now.step, h) * angular, h, Led(), Spin()))

    @wp.func
    def advance_arm(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, moment: wp.float32):
        """Takes the thread's arm on by a step or a stage; `moment` is of the chain and of tensioners [N m].

        Returns it with its rates at the step's instant.
        """
        b = wp.static(sprockets) + mine.arm
        arm = ensemble.block_arms[ensemble.drives[mine.variant].first_arm + mine.arm]
        wheel = load_wheel(shared.wheels, b)
        seen = Seen()
        seen.angle = rounded(wheel.angle)
        seen.speed = wheel.speed.high
        angular = arm_turning(seen, wp.vec2f(wheel.cosine.high, wheel.sine.high), moment, arm)
        if wp.static(not rk4):
            seen.speed = seen.speed + leapfrog_lag(now.step, mine.step.high) * angular
        if now.going != 0:
            move_arm(shared, mine, now, wheel, angular)
        return seen

    @wp.func
    def observe_arm(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        seen: Seen,
        moment: wp.float32,
        before: Wheel,
    ):
        """One step of the thread's arm, on which the chain's `moment` [N m] acts, for the window's sums.

        `before` is where it was, `seen` has its rates at the step's instant.
        """
        drive = ensemble.drives[mine.variant]
        arm = ensemble.block_arms[drive.first_arm + mine.arm]
        power = arm_dissipation(seen, arm)
        shared.arm_sums[mine.arm] = add_arm(shared.arm_sums[mine.arm], seen, moment, power, now.weight)
        if now.flags & ENDS != 0:
            at = drive.first_body + wp.static(sprockets) + mine.arm
            heading = wp.vec2f(before.cosine.high, before.sine.high)
            energy = wp.float64(arm_energy(seen, heading, arm))
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)

    return SimpleNamespace(
        start_arm=start_arm,
        end_arm=end_arm,
        start_tensioners=start_tensioners,
        end_tensioners=end_tensioners,
        pushed=pushed,
        observe_pushes=observe_pushes,
        flow=flow,
        advance_arm=advance_arm,
        observe_arm=observe_arm,
    )
