"""Forces of one variant at one instant, and a step of each integrator, over its rollers and its bodies."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import Rk4Stage
from ..namespace import namespace
from ..physics.arm import arm_rates
from ..physics.body import body_at, body_rates, heading_of, in_box, leapfrog_body, rk4_body, turns_soundly
from ..physics.motion import load_moment, prescribed_at
from ..physics.tensioner import push_by, stroke_of, tensioner_step
from ..rows import accessors
from ..structs import Drive, Wrench, types
from ..sums import metered
from .contact_pairs import contact_pairs, with_reaction
from .contacts import contact_rows
from .joints import joint_passes
from .neighbor_list import neighbor_list
from .partners import nearness
from .rollers import passes, rows


@wp.func
def arm_of(drive: Drive, b: int):
    """Which arm of all body `b` of all is; negative for other bodies."""
    place = b - drive.first_body - (drive.bodies - drive.arms)
    return wp.where(place >= 0, drive.first_arm + place, -1)


@cache
def evaluating(Real: type, capacity: int, plain: bool) -> SimpleNamespace:
    """The function that evaluates the forces of one variant, for rows of `capacity` values of type `Real`.

    For `plain` see `serial.advance_kernel`, as everywhere here.
    """
    kinds = types(Real)
    link_pass, see_bodies = passes(Real, capacity).link_pass, nearness(Real, capacity, plain).see_bodies
    evaluate_all = contact_pairs(Real, capacity, plain).evaluate_all
    clear_sizes = contact_rows(Real, capacity).clear_sizes
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
        if links.varied_links != 0:
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
        evaluate_all(ensemble, state, drive, chain, w, memory)
        if wp.static(not plain):
            for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
                tensioner = ensemble.tensioners[t]
                plunger = state.bodies[drive.first_body + tensioner.body]
                state.pushes[t] = push_by(plunger, state.tensioners[t], tensioner)

    return namespace(evaluate)


@cache
def moving(Real: type, plain: bool) -> SimpleNamespace:
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

    return namespace(rates_of, find_rates, leapfrog_bodies, rk4_bodies, wrench_on, body_now, bodies_sound)


@cache
def stepping(Real: type, capacity: int, plain: bool) -> SimpleNamespace:
    """The functions that take one variant a step on, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    part = passes(Real, capacity)
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    leapfrog_bodies, rk4_bodies = moving(Real, plain).leapfrog_bodies, moving(Real, plain).rk4_bodies
    invalidate = neighbor_list(Real, capacity).invalidate
    acceleration, kick_drift, move = part.acceleration, part.kick_drift, part.move
    row = rows(capacity)

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
                invalidate(w, state.bodies[b].velocity)

    @wp.func
    def rk4_rollers(w: wp.array[Real], n: int, chain: kinds.Chain, stage: int, weight: Real, reach: Real):
        """Adds this stage's slopes to the sums with `weight`, and goes `reach` along them from the step's start."""
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load_row(w, row.vx + i)
            vy = load_row(w, row.vy + i)
            if stage == 0:
                store_row(w, row.x0 + i, load_row(w, row.x + i))
                store_row(w, row.y0 + i, load_row(w, row.y + i))
                store_row(w, row.x0_low + i, load_row(w, row.x_low + i))
                store_row(w, row.y0_low + i, load_row(w, row.y_low + i))
                store_row(w, row.vx0 + i, vx)
                store_row(w, row.vy0 + i, vy)
                store_row(w, row.sum_x + i, Real(0.0))
                store_row(w, row.sum_y + i, Real(0.0))
                store_row(w, row.sum_vx + i, Real(0.0))
                store_row(w, row.sum_vy + i, Real(0.0))
            store_row(w, row.sum_x + i, load_row(w, row.sum_x + i) + weight * vx)
            store_row(w, row.sum_y + i, load_row(w, row.sum_y + i) + weight * vy)
            store_row(w, row.sum_vx + i, load_row(w, row.sum_vx + i) + weight * a[0])
            store_row(w, row.sum_vy + i, load_row(w, row.sum_vy + i) + weight * a[1])
            store_row(w, row.x + i, load_row(w, row.x0 + i))
            store_row(w, row.y + i, load_row(w, row.y0 + i))
            store_row(w, row.x_low + i, load_row(w, row.x0_low + i))
            store_row(w, row.y_low + i, load_row(w, row.y0_low + i))
            if stage == 3:
                move(w, i, load_row(w, row.sum_x + i), load_row(w, row.sum_y + i))
                store_row(w, row.vx + i, load_row(w, row.vx0 + i) + load_row(w, row.sum_vx + i))
                store_row(w, row.vy + i, load_row(w, row.vy0 + i) + load_row(w, row.sum_vy + i))
            else:
                move(w, i, reach * vx, reach * vy)
                store_row(w, row.vx + i, load_row(w, row.vx0 + i) + reach * a[0])
                store_row(w, row.vy + i, load_row(w, row.vy0 + i) + reach * a[1])
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

    return namespace(leapfrog, rk4)
