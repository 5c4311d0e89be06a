"""Arms and tensioners on blocks at float32 without float64, as `block_arms` has them; sums too are pairs.

What a tensioner remembers, and what is added up of it, the thread that has its body keeps in shared memory.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import leapfrog_kick, leapfrog_lag, rk4_reach, rk4_weight
from ..pairs import apart, rounded
from ..physics.arm import arm_dissipation, arm_energy, arm_turning
from ..physics.plunger import lever_of, plunger_push, reached, stroke_rate
from ..physics.spin import spin_staged, spun, swung, wheel_at, with_spin
from ..physics.tensioner import lost_power, tensioner_energy, tensioner_step
from ..structs import Led, Spin, Wheel, types
from ..sum_structs import Sums, Tallies
from ..sums import add_arm, add_energy, add_meter, add_tensioner, metered
from .block_bodies import Seen, with_velocity
from .block_events import END, ENDS, START
from .block_kind import BlockKind, Mine, now_struct
from .block_lever_sums import (
    arm_sums_of,
    flows_of,
    lever_sums_of,
    meter_of,
    plunger_of,
    plunger_sums_of,
    tensioner_of,
    with_plunger_sums,
)
from .block_wheels import load_wheel, store_turn, store_wheel


@dataclass(frozen=True)
class LeverFunctions:
    """What is done about arms and tensioners, as functions of kernels."""

    start_arm: wp.Function
    end_arm: wp.Function
    start_plungers: wp.Function
    end_plungers: wp.Function
    pushed: wp.Function
    observe_pushes: wp.Function
    flow: wp.Function
    advance_arm: wp.Function
    observe_arm: wp.Function


@cache
def block_levers(kind: BlockKind) -> LeverFunctions:
    """The functions of one variant's arms and tensioners on a block; body b is that of the drive."""
    sprockets, tensioners, rk4, measuring = kind.sprockets, kind.tensioners, kind.rk4, kind.measuring
    kinds, Now = types(kind.Real), now_struct(kind.Real)

    @wp.func
    def start_plungers(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine, b: int
    ):
        """What is shared of the tensioners of body b."""
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            if ensemble.plungers[first + t].body == b:
                shared.plungers[t] = plunger_of(state.tensioners[first + t])
                if wp.static(measuring):
                    shared.plunger_meters[t] = meter_of(state.meters[first + t])
                    shared.plunger_sums[t] = plunger_sums_of(sums.tensioner[first + t])

    @wp.func
    def end_plungers(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine, b: int
    ):
        """The tensioners of body b and their sums back into the state."""
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            if ensemble.plungers[first + t].body == b:
                state.tensioners[first + t] = tensioner_of(shared.plungers[t])
                if wp.static(measuring):
                    state.meters[first + t] = flows_of(shared.plunger_meters[t])
                    kept = sums.tensioner[first + t]
                    sums.tensioner[first + t] = with_plunger_sums(kept, shared.plunger_sums[t])

    @wp.func
    def start_arm(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine):
        """What is shared of the thread's arm and its tensioners."""
        drive = ensemble.drives[mine.variant]
        b = wp.static(sprockets) + mine.arm
        store_wheel(shared.wheels, b, wheel_at(state.bodies[drive.first_body + b], wp.float64(0.0)))
        if wp.static(measuring):
            shared.lever_sums[mine.arm] = lever_sums_of(sums.arm[drive.first_arm + mine.arm])
        start_plungers(ensemble, state, sums, shared, mine, b)

    @wp.func
    def end_arm(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, shared: kinds.Shared, mine: Mine):
        """The thread's arm, its tensioners and their sums back into the state."""
        drive = ensemble.drives[mine.variant]
        b = wp.static(sprockets) + mine.arm
        at = drive.first_body + b
        state.bodies[at] = with_spin(state.bodies[at], load_wheel(shared.wheels, b))
        if wp.static(measuring):
            sums.arm[drive.first_arm + mine.arm] = arm_sums_of(shared.lever_sums[mine.arm])
        end_plungers(ensemble, state, sums, shared, mine, b)

    @wp.func
    def pushed(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, b: int):
        """What its tensioners do to body b: moment [N m], force (x, y) [N]."""
        acting = wp.vec3f()
        first = ensemble.drives[mine.variant].first_tensioner
        for t in range(wp.static(tensioners)):
            plunger = ensemble.plungers[first + t]
            if plunger.body == b:
                body = with_velocity(shared.wheels, b, load_wheel(shared.wheels, b))
                push, wrench = plunger_push(body, shared.plungers[t], ensemble.strokes[first + t], plunger)
                shared.plunger_pushes[t] = push
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
            plunger = ensemble.plungers[at]
            if plunger.body == b:
                push = shared.plunger_pushes[t]
                kept = shared.plungers[t]
                rate = stroke_rate(lever_of(before, ensemble.strokes[at]), seen.speed, seen.velocity, plunger)
                power = lost_power(push, rate, kept, plunger)
                shared.plunger_sums[t] = add_tensioner(shared.plunger_sums[t], push, power, now.weight)
                if now.flags & ENDS != 0:
                    starts = now.flags & START != 0
                    meter = flows_of(shared.plunger_meters[t])
                    sums.tensioner[at] = add_meter(sums.tensioner[at], meter, starts, now.flags & END != 0)
                    energy = wp.float64(tensioner_energy(push.extension, kept, plunger))
                    of = drive.first_body + b
                    tallies.body[of] = add_energy(tallies.body[of], starts, energy)

    @wp.func
    def flow(ensemble: kinds.Ensemble, shared: kinds.Shared, mine: Mine, now: Now, b: int):
        """What flows in a step through the tensioners of body b, once it has moved."""
        if now.going != 0 and (not wp.static(rk4) or now.stage == 3):
            first = ensemble.drives[mine.variant].first_tensioner
            for t in range(wp.static(tensioners)):
                plunger = ensemble.plungers[first + t]
                if plunger.body == b:
                    body = with_velocity(shared.wheels, b, load_wheel(shared.wheels, b))
                    stroke = ensemble.strokes[first + t]
                    rate = stroke_rate(lever_of(body, stroke), body.speed.high, body.velocity, plunger)
                    x = reached(body, stroke)
                    after, flows = tensioner_step(x, rate, mine.step.high, shared.plungers[t], plunger)
                    shared.plungers[t] = after
                    if wp.static(measuring):
                        shared.plunger_meters[t] = metered(shared.plunger_meters[t], flows)

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
        lever = ensemble.levers[ensemble.drives[mine.variant].first_arm + mine.arm]
        wheel = load_wheel(shared.wheels, b)
        seen = Seen()
        seen.angle = rounded(wheel.angle)
        seen.speed = wheel.speed.high
        angular = arm_turning(seen, wp.vec2f(wheel.cosine.high, wheel.sine.high), moment, lever)
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
        lever = ensemble.levers[drive.first_arm + mine.arm]
        power = arm_dissipation(seen, lever)
        shared.lever_sums[mine.arm] = add_arm(shared.lever_sums[mine.arm], seen, moment, power, now.weight)
        if now.flags & ENDS != 0:
            at = drive.first_body + wp.static(sprockets) + mine.arm
            heading = wp.vec2f(before.cosine.high, before.sine.high)
            energy = wp.float64(arm_energy(seen, heading, lever))
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)

    return LeverFunctions(
        start_arm=start_arm,
        end_arm=end_arm,
        start_plungers=start_plungers,
        end_plungers=end_plungers,
        pushed=pushed,
        observe_pushes=observe_pushes,
        flow=flow,
        advance_arm=advance_arm,
        observe_arm=observe_arm,
    )
