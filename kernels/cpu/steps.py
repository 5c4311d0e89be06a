"""Forces of one variant at one instant, and a step of each integrator, over its rollers and its bodies."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..integrate import Rk4Stage
from ..physics.arm import arm_rates
from ..physics.body import body_at, body_rates, heading_of, in_box, leapfrog_body, rk4_body, turns_soundly
from ..physics.motion import load_moment, prescribed_at
from ..physics.tensioner import push_by, stroke_of, tensioner_step
from ..rows import accessors
from ..structs import Drive, Wrench, types
from ..sums import metered
from .contacts import contacts
from .joints import joint_passes
from .partners import partners, with_reaction
from .rollers import passes, rows
from .runs import runs


@wp.func
def arm_of(drive: Drive, b: int):
    """Which arm of all body `b` of all is; negative for other bodies."""
    place = b - drive.first_body - (drive.bodies - drive.arms)
    return wp.where(place >= 0, drive.first_arm + place, -1)


@dataclass(frozen=True)
class Evaluating:
    """What evaluates the forces of one variant."""

    evaluate: wp.Function


@cache
def evaluating(Real: type, capacity: int, plain: bool) -> Evaluating:
    """The function that evaluates the forces of one variant, for rows of `capacity` values of type `Real`.

    For `plain` see `serial.advance_kernel`, as everywhere here.
    """
    kinds = types(Real)
    link_pass, meet = passes(Real, capacity).link_pass, partners(Real, capacity, plain)
    see_bodies, meet_all = meet.see_bodies, meet.meet_all
    clear_sizes = contacts(Real, capacity).clear_sizes
    joints = joint_passes(Real, capacity)

    @wp.func
    def evaluate(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        links: kinds.Links,
        joint: kinds.Joint,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Forces on all rollers and wrenches on all bodies for the state in the scratch and in `state.bodies`.

        Totals have what only metrics want as far as `memory` wants it.
        """
        n = drive.rollers
        see_bodies(state, drive)
        if links.uneven != 0:
            joints.pull_uneven(w, n, chain, links)
        elif joint.rubs != 0:
            joints.pull_links(w, n, chain)
        else:
            link_pass(w, n, chain)
        if joint.rubs != 0:
            joints.rub_joints(w, n, joint)
            joints.bend_links(w, n)
        if memory.wanted.sizes != 0:
            clear_sizes(w, n)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.wrenches[b] = Wrench()
        meet_all(ensemble, state, drive, chain, w, memory)
        if wp.static(not plain):
            for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
                tensioner = ensemble.tensioners[t]
                plunger = state.bodies[drive.first_body + tensioner.body]
                state.pushes[t] = push_by(plunger, state.tensioners[t], tensioner)

    return Evaluating(evaluate=evaluate)


@dataclass(frozen=True)
class BodyFunctions:
    """What moves the bodies of one variant, and observes them."""

    rates_of: wp.Function
    find_rates: wp.Function
    leapfrog_bodies: wp.Function
    rk4_bodies: wp.Function
    wrench_on: wp.Function
    body_now: wp.Function
    bodies_sound: wp.Function


@cache
def moving(Real: type, plain: bool) -> BodyFunctions:
    """The functions that move the bodies of one variant of an ensemble, and observe them."""
    kinds = types(Real)

    @wp.func
    def wrench_on(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, b: int):
        """What contacts and tensioners do to body `b` of all."""
        wrench = state.wrenches[b]
        if wp.static(not plain):
            for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
                if drive.first_body + ensemble.tensioners[t].body == b:
                    push = state.pushes[t].wrench
                    wrench = with_reaction(wrench, push.force, push.moment)
        return wrench

    @wp.func
    def rates_of(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, b: int, time: wp.float64):
        """Accelerations of body `b` of all, from what contacts and tensioners do to it."""
        body = state.bodies[b]
        wrench = wrench_on(ensemble, state, drive, b)
        if wp.static(not plain):
            arm = arm_of(drive, b)
            if arm >= 0:
                return arm_rates(body, heading_of(body), wrench.moment, ensemble.arms[arm])
        motion = ensemble.motions[b]
        load = load_moment(time, body.angle, body.speed, motion, ensemble.curves)
        return body_rates(time, body, heading_of(body), wrench, load, motion, ensemble.mounts[b], ensemble.curves)

    @wp.func
    def find_rates(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, time: wp.float64):
        """Accelerations of all bodies at `time`, for whatever moves or observes them."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.rates[b] = rates_of(ensemble, state, drive, b, time)

    @wp.func
    def flow(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive):
        """What flows through all tensioners in a step, once the bodies have moved; the meters count it."""
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            body = state.bodies[drive.first_body + tensioner.body]
            x, rate = stroke_of(body, tensioner)
            after, flows = tensioner_step(x, rate, drive.step, state.tensioners[t], tensioner)
            state.tensioners[t] = after
            state.meters[t] = metered(state.meters[t], flows)

    @wp.func
    def leapfrog_bodies(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, time: wp.float64, kick: wp.float64):
        """All bodies a step after `time`."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            motion = ensemble.motions[b]
            ahead = wp.float64(0.0)
            if motion.prescribed == 1:
                ahead, speed = prescribed_at(time + drive.step, motion, ensemble.curves)
            state.bodies[b] = leapfrog_body(
                time, kick, drive.step, state.bodies[b], state.rates[b], ahead, motion, ensemble.mounts[b]
            )
        if wp.static(not plain):
            flow(ensemble, state, drive)

    @wp.func
    def rk4_bodies(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, at: Rk4Stage):
        """All bodies after one of the four stages."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body, stages = rk4_body(
                at,
                state.bodies[b],
                state.body_stages[b],
                state.rates[b],
                ensemble.motions[b],
                ensemble.mounts[b],
                ensemble.curves,
            )
            state.bodies[b] = body
            state.body_stages[b] = stages
        if wp.static(not plain):
            if at.number == 3:
                flow(ensemble, state, drive)

    @wp.func
    def body_now(ensemble: kinds.Ensemble, state: kinds.State, b: int, time: wp.float64, lag: wp.float64):
        """Body `b` of all with its rates at `time`, `lag` after their own instant; its accelerations are found."""
        motion = ensemble.motions[b]
        driven = wp.float64(0.0)
        if motion.prescribed == 1:
            angle, driven = prescribed_at(time, motion, ensemble.curves)
        return body_at(time, lag, state.bodies[b], state.rates[b], driven, motion, ensemble.mounts[b])

    @wp.func
    def bodies_sound(state: kinds.State, drive: Drive):
        """1 while every body turns soundly and its center is within the drive's box, else 0."""
        good = int(1)
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = state.bodies[b]
            if not (in_box(drive, body.center) and turns_soundly(body.angle, body.speed)):
                good = int(0)
        return good

    return BodyFunctions(
        rates_of=rates_of,
        find_rates=find_rates,
        leapfrog_bodies=leapfrog_bodies,
        rk4_bodies=rk4_bodies,
        wrench_on=wrench_on,
        body_now=body_now,
        bodies_sound=bodies_sound,
    )


@dataclass(frozen=True)
class Stepping:
    """What takes one variant a step on."""

    leapfrog: wp.Function
    rk4: wp.Function


@cache
def stepping(Real: type, capacity: int, plain: bool) -> Stepping:
    """The functions that take one variant a step on, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    part = passes(Real, capacity)
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    leapfrog_bodies, rk4_bodies = moving(Real, plain).leapfrog_bodies, moving(Real, plain).rk4_bodies
    hurry = runs(Real, capacity).hurry
    acceleration, kick_drift, move = part.acceleration, part.kick_drift, part.move
    row = rows(capacity)
    X, Y, VX, VY, X_LOW, Y_LOW, X0_LOW, Y0_LOW = (
        row.x,
        row.y,
        row.vx,
        row.vy,
        row.x_low,
        row.y_low,
        row.x0_low,
        row.y0_low,
    )
    X0, Y0, VX0, VY0, SUM_X, SUM_Y, SUM_VX, SUM_VY = (
        row.x0,
        row.y0,
        row.vx0,
        row.vy0,
        row.sum_x,
        row.sum_y,
        row.sum_vx,
        row.sum_vy,
    )

    @wp.func
    def leapfrog(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        time: wp.float64,
        kick: wp.float64,
    ):
        """One step from evaluated forces; `kick` is h, or h / 2 from the initial state."""
        leapfrog_bodies(ensemble, state, drive, time, kick)
        kick_drift(w, drive.rollers, chain, Real(kick), Real(drive.step))
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            if ensemble.mounts[b].active != 0:
                hurry(w, state.bodies[b].velocity)

    @wp.func
    def rk4_rollers(w: wp.array[Real], n: int, chain: kinds.Chain, stage: int, weight: Real, reach: Real):
        """Adds this stage's slopes to the sums with `weight`, and goes `reach` along them from the step's start."""
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load_row(w, VX + i)
            vy = load_row(w, VY + i)
            if stage == 0:
                store_row(w, X0 + i, load_row(w, X + i))
                store_row(w, Y0 + i, load_row(w, Y + i))
                store_row(w, X0_LOW + i, load_row(w, X_LOW + i))
                store_row(w, Y0_LOW + i, load_row(w, Y_LOW + i))
                store_row(w, VX0 + i, vx)
                store_row(w, VY0 + i, vy)
                store_row(w, SUM_X + i, Real(0.0))
                store_row(w, SUM_Y + i, Real(0.0))
                store_row(w, SUM_VX + i, Real(0.0))
                store_row(w, SUM_VY + i, Real(0.0))
            store_row(w, SUM_X + i, load_row(w, SUM_X + i) + weight * vx)
            store_row(w, SUM_Y + i, load_row(w, SUM_Y + i) + weight * vy)
            store_row(w, SUM_VX + i, load_row(w, SUM_VX + i) + weight * a[0])
            store_row(w, SUM_VY + i, load_row(w, SUM_VY + i) + weight * a[1])
            store_row(w, X + i, load_row(w, X0 + i))
            store_row(w, Y + i, load_row(w, Y0 + i))
            store_row(w, X_LOW + i, load_row(w, X0_LOW + i))
            store_row(w, Y_LOW + i, load_row(w, Y0_LOW + i))
            if stage == 3:
                move(w, i, load_row(w, SUM_X + i), load_row(w, SUM_Y + i))
                store_row(w, VX + i, load_row(w, VX0 + i) + load_row(w, SUM_VX + i))
                store_row(w, VY + i, load_row(w, VY0 + i) + load_row(w, SUM_VY + i))
            else:
                move(w, i, reach * vx, reach * vy)
                store_row(w, VX + i, load_row(w, VX0 + i) + reach * a[0])
                store_row(w, VY + i, load_row(w, VY0 + i) + reach * a[1])
            i = i + 1

    @wp.func
    def rk4(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        at: Rk4Stage,
    ):
        """One of the four stages of the classical scheme, from evaluated forces; the fourth ends the step."""
        rk4_bodies(ensemble, state, drive, at)
        rk4_rollers(w, drive.rollers, chain, at.number, Real(at.weight), Real(at.reach))

    return Stepping(leapfrog=leapfrog, rk4=rk4)
