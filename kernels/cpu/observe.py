"""What is taken from an evaluated step: sums of the window, the energy balance, and frames.

What few steps come to is kept out of the time loop's one piece (`inline=False`), which compiles sooner then.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..integrate import leapfrog_lag
from ..namespace import namespace
from ..physics.arm import arm_dissipation, arm_energy
from ..physics.body import body_energy, heading_of, held_by
from ..physics.motion import load_moment, load_moment_at_speed
from ..physics.tensioner import lost_power, stroke_of, tensioner_energy
from ..rows import accessors
from ..structs import Drive, Wanted, types
from ..sum_structs import Sums
from ..sums import (
    MERGE_EVERY,
    add_arm,
    add_contact,
    add_contact_force,
    add_energy,
    add_hub_force,
    add_meter,
    add_mount,
    add_powers,
    add_speed,
    add_tensioner,
    add_touches,
    is_watched,
    watch_weight,
)
from .chain_sums import chain_sums
from .joints import joint_passes
from .rollers import passes, rows
from .steps import arm_of, moving


@wp.struct
class Instant:
    """At which instant a variant is observed."""

    step: wp.int32
    time: wp.float64  # [s]
    lag: wp.float64  # how far behind it the velocities are [s]
    weight: wp.float64  # time that the step stands for in the window's sums [s]


@wp.func
def instant_of(drive: Drive, step: int):
    """The instant of step `step`."""
    at = Instant()
    at.step = step
    at.time = wp.float64(step) * drive.step
    if drive.integrator == 0:
        at.lag = leapfrog_lag(step, drive.step)
    at.weight = drive.step
    if step == drive.window_start or step == drive.window_end:
        at.weight = wp.float64(0.5) * at.weight
    return at


@wp.func
def wanted_at(drive: Drive, step: int, stage: int):
    """What is wanted of step `step` as it begins, at stage 0."""
    wanted = Wanted()
    if stage != 0:
        return wanted
    if step >= drive.window_start and step <= drive.window_end:
        wanted.measures = 1
        wanted.forces = wp.where(is_watched(drive, step), 1, 0)
        wanted.energy = wp.where(step == drive.window_start or step == drive.window_end, 1, 0)
    if drive.sample_every > 0:
        wanted.sizes = wp.where(step % drive.sample_every == 0, 1, 0)
    return wanted


@cache
def measuring(Real: type, capacity: int, plain: bool) -> SimpleNamespace:
    """The functions that add evaluated steps of one variant to the sums of the window."""
    kinds, sums_of, bodies = types(Real), chain_sums(Real, capacity), moving(Real, plain)
    friction_power, body_now = joint_passes(Real, capacity).friction_power, bodies.body_now

    @wp.func(inline=False)
    def mechanical_energy(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        links: kinds.Links,
        w: wp.array[Real],
        at: Instant,
    ):
        """Energy of chain, contacts, free sprockets and mounts at an evaluated step [J]."""
        total = sums_of.energy(w, drive.rollers, chain, links, Real(at.lag))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = body_now(ensemble, state, b, at.time, at.lag)
            arm = arm_of(drive, b)
            if arm < 0:
                total += body_energy(body, ensemble.motions[b], ensemble.mounts[b])
            elif wp.static(not plain):
                total += arm_energy(body, heading_of(body), ensemble.arms[arm])
        if wp.static(not plain):
            for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
                total += tensioner_energy(state.pushes[t].extension, state.tensioners[t], ensemble.tensioners[t])
        return total

    @wp.func
    def add_body(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        drive: Drive,
        s: int,
        at: Instant,
    ):
        """Adds sprocket s, with its mount, to the sums of the window."""
        i = drive.first_sprocket + s
        b = drive.first_body + s
        motion = ensemble.motions[b]
        mount = ensemble.mounts[b]
        wrench = state.wrenches[b]
        body = body_now(ensemble, state, b, at.time, at.lag)
        before = state.bodies[b].speed
        load_part = load_moment(at.time, body.angle, before, motion, ensemble.curves)
        load_part = load_moment_at_speed(at.time, load_part, before, body.speed, motion)
        if mount.active == 1:
            whole = bodies.wrench_on(ensemble, state, drive, b)
            held, power = held_by(at.time, body, whole, load_part, motion, mount, ensemble.curves)
            sums.mount[i] = add_mount(
                sums.mount[i], body.center - mount.home, body.velocity, mount, held, power, at.weight
            )
        sums.sprocket[i] = add_powers(sums.sprocket[i], body.speed, wrench.moment, load_part, at.weight)
        if is_watched(drive, at.step):
            sums.sprocket[i] = add_speed(sums.sprocket[i], body.speed, watch_weight(drive.step))

    @wp.func
    def add_arm_body(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, drive: Drive, a: int, at: Instant):
        """Adds arm a of the drive to the sums of the window."""
        b = drive.first_body + drive.bodies - drive.arms + a
        i = drive.first_arm + a
        body = body_now(ensemble, state, b, at.time, at.lag)
        power = arm_dissipation(body, ensemble.arms[i])
        sums.arm[i] = add_arm(sums.arm[i], body, state.wrenches[b].moment, power, at.weight)

    @wp.func
    def add_push(ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, drive: Drive, t: int, at: Instant):
        """Adds tensioner t of all to the sums of the window, and at its ends what its meter says."""
        tensioner = ensemble.tensioners[t]
        push = state.pushes[t]
        body = body_now(ensemble, state, drive.first_body + tensioner.body, at.time, at.lag)
        x, rate = stroke_of(body, tensioner)
        power = lost_power(push, rate, state.tensioners[t], tensioner)
        added = add_tensioner(sums.tensioner[t], push, power, at.weight)
        starts, ends = at.step == drive.window_start, at.step == drive.window_end
        sums.tensioner[t] = add_meter(added, state.meters[t], starts, ends)

    @wp.func
    def watch(state: kinds.State, sums: Sums, drive: Drive, w: wp.array[Real]):
        """Holds tensions against their extremes so far, and adds up forces on sprockets and guide-bars."""
        sums_of.widen(w, drive.rollers)
        weight = watch_weight(drive.step)
        for s in range(drive.sprockets):
            i = drive.first_sprocket + s
            sums.sprocket[i] = add_hub_force(sums.sprocket[i], state.wrenches[drive.first_body + s].force, weight)
        first = drive.first_sprocket + drive.first_guide
        for i in range(first, first + drive.sprockets + drive.guides):
            sums.contact[i] = add_contact_force(sums.contact[i], state.totals[i], weight)

    @wp.func
    def measure_contacts(state: kinds.State, sums: Sums, drive: Drive, at: Instant):
        """Adds the contacts of an evaluated step to the sums of the window."""
        first = drive.first_sprocket + drive.first_guide
        for i in range(first, first + drive.sprockets + drive.guides):
            of = state.totals[i]
            sums.contact[i] = add_contact(sums.contact[i], of, at.weight)
            missed = wp.where(at.step == drive.window_start, of.missing, of.missed)
            add_touches(sums.contact, i, of.impacts, of.contacts, missed)

    @wp.func
    def measure(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        variant: int,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        at: Instant,
    ):
        """Adds an evaluated step to the sums of the window."""
        n = drive.rollers
        if at.step % MERGE_EVERY == 0 or at.step == drive.window_start:
            sums_of.gather(ensemble, state, sums, variant, drive, w, at.step)
        if is_watched(drive, at.step):
            watch(state, sums, drive, w)
        sums_of.add_rates(w, n, Real(at.weight / drive.step))
        if ensemble.joints[variant].rubs != 0:
            lost = at.weight * friction_power(w, n, chain, Real(at.lag))
            sums.chain[variant].friction = sums.chain[variant].friction + lost
        if at.step == drive.window_start or at.step == drive.window_end:
            energy = mechanical_energy(ensemble, state, drive, chain, ensemble.links[variant], w, at)
            sums.chain[variant] = add_energy(sums.chain[variant], at.step == drive.window_start, energy)
        measure_contacts(state, sums, drive, at)
        for s in range(drive.sprockets):
            add_body(ensemble, state, sums, drive, s, at)
        if wp.static(not plain):
            for a in range(drive.arms):
                add_arm_body(ensemble, state, sums, drive, a, at)
            for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
                add_push(ensemble, state, sums, drive, t, at)

    return namespace(measure, clear=sums_of.clear, merge=sums_of.merge)


@cache
def sampling(Real: type, capacity: int, frame: Any, plain: bool) -> SimpleNamespace:
    """The functions that write frames of one variant, which lie as `frame` says (`frames.frame_writers`)."""
    kinds = types(Real)
    vec2, load_row, row = kinds.vec2, accessors(Real).load_row, rows(capacity)
    acceleration, joint_power = passes(Real, capacity).acceleration, joint_passes(Real, capacity).joint_power
    body_now, write = moving(Real, plain).body_now, frame_writers(Real, frame)

    @wp.func
    def seen(w: wp.array[Real], i: int):
        """What a frame wants of roller i beside its motion."""
        of = kinds.Extra()
        of.tension = load_row(w, row.tension + i)
        of.rate = load_row(w, row.rate + i)
        of.sprocket_force = load_row(w, row.sprocket_force + i)
        of.guide_force = load_row(w, row.guide_force + i)
        return of

    @wp.func(inline=False)
    def sample(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
        frames: wp.array[Real],
        first: wp.int64,
        at: Instant,
    ):
        """Writes the frame that begins at `first`."""
        n = drive.rollers
        begin = int(first)
        lag = Real(at.lag)
        chain = ensemble.chains[variant]
        inverse_mass = chain.inverse_mass
        for i in range(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            position = vec2(load_row(w, row.x + i), load_row(w, row.y + i))
            velocity = vec2(load_row(w, row.vx + i) + lag * a[0], load_row(w, row.vy + i) + lag * a[1])
            extra = seen(w, i)
            if wp.static(frame.holds("joint_friction_power")):
                if ensemble.joints[variant].rubs != 0:
                    extra.friction_power = joint_power(w, i, n, chain, lag)
            write.write_roller(frames, begin, n, i, position, velocity, extra)
        for s in range(drive.sprockets):
            b = drive.first_body + s
            body = body_now(ensemble, state, b, at.time, at.lag)
            write.write_sprocket(frames, begin, n, s, body, state.wrenches[b].moment)
        if wp.static(not plain):
            for a in range(drive.arms):
                b = drive.first_body + drive.bodies - drive.arms + a
                arm = body_now(ensemble, state, b, at.time, at.lag)
                write.write_arm(frames, begin, drive, a, arm, state.wrenches[b].moment)
            for t in range(drive.tensioners):
                write.write_tensioner(frames, begin, drive, t, state.pushes[drive.first_tensioner + t])

    return namespace(sample, width=write.width)
