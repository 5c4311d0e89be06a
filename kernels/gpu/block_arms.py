"""Arms and tensioners on blocks of threads: how the thread that has a body takes on its arm, and what pushes it.

At float64, and while settling; `block_levers` is the same at float32.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import leapfrog_kick, leapfrog_lag, rk4_stage
from ..physics.arm import arm_dissipation, arm_energy, arm_rates
from ..physics.body import body_at, heading_of, leapfrog_body, pose_of, rk4_body
from ..physics.tensioner import lost_power, push_by, stroke_of, tensioner_energy, tensioner_step
from ..structs import BodyState, Motion, Mount, Wrench, types
from ..sum_structs import Sums, Tallies
from ..sums import add_arm, add_energy, add_meter, add_tensioner, metered
from .block_bodies import state_of
from .block_events import END, ENDS, START
from .block_kind import BlockKind, Mine, now_struct


@dataclass(frozen=True)
class ArmFunctions:
    """What is done about arms and tensioners, as functions of kernels."""

    start_arm: wp.Function
    end_arm: wp.Function
    pushed: wp.Function
    observe_pushes: wp.Function
    flow: wp.Function
    advance_arm: wp.Function
    rest_arm: wp.Function


@cache
def block_arms(kind: BlockKind) -> ArmFunctions:
    """The functions of one variant's arms and tensioners on a block; body b is that of the drive."""
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

    return ArmFunctions(
        start_arm=start_arm,
        end_arm=end_arm,
        pushed=pushed,
        observe_pushes=observe_pushes,
        flow=flow,
        advance_arm=advance_arm,
        rest_arm=rest_arm,
    )
