"""What is taken from an evaluated step: sums of the window, the energy balance, and frames."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..physics.body import body_energy, held_by
from ..physics.motion import load_at, load_at_speed
from ..rows import accessors
from ..structs import Drive, types
from ..sum_structs import Sums
from ..sums import STRAND_LOOK_EVERY, add_contact, add_displacement, add_energy, add_mount, add_sprocket, following
from .rollers import passes, rows
from .steps import moving
from .tallies import tallies


@cache
def observing(Real: type, capacity: int, frame: Any) -> SimpleNamespace:
    """The functions that look at one variant, for rows of `capacity` values of type `Real`; `frame` as in `frames`."""
    kinds = types(Real)
    vec2 = kinds.vec2
    tally = tallies(Real, capacity)
    follow = following(Real).follow
    load = accessors(Real).load
    acceleration = passes(Real, capacity).acceleration
    body_now = moving(Real).body_now
    row = rows(capacity)
    X, Y, VX, VY = row.x, row.y, row.vx, row.vy
    TENSION, RATE, SPROCKET_FORCE, GUIDE_FORCE = row.tension, row.rate, row.sprocket_force, row.guide_force
    write = frame_writers(Real, frame)
    write_roller, write_sprocket, width = write.write_roller, write.write_sprocket, write.width

    @wp.func
    def mechanical_energy(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        time: wp.float64,
        back: wp.float64,
    ):
        """Energy of chain, contacts, free sprockets and mounts at an evaluated step [J]."""
        total = tally.roller_energy(w, drive.rollers, chain, Real(back))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = body_now(ensemble, state, b, time, back)
            total += body_energy(body, ensemble.motions[b], ensemble.mounts[b])
        return total

    @wp.func
    def add_body(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        drive: Drive,
        s: int,
        time: wp.float64,
        back: wp.float64,
        weight: wp.float64,
    ):
        """Adds sprocket s, with its mount, to the sums of the window."""
        i = drive.first_sprocket + s
        b = drive.first_body + s
        motion = ensemble.motions[b]
        mount = ensemble.mounts[b]
        wrench = state.wrenches[b]
        body = body_now(ensemble, state, b, time, back)
        before = state.bodies[b].speed
        load_part = load_at(time, body.angle, before, motion, ensemble.curves)
        load_part = load_at_speed(time, load_part, before, body.speed, motion)
        if mount.active == 1:
            held, power = held_by(time, body, wrench, load_part, motion, mount, ensemble.curves)
            sums.mount[i] = add_mount(sums.mount[i], body, mount, held, power, weight)
        sums.sprocket[i] = add_sprocket(sums.sprocket[i], body.speed, wrench.moment, load_part, weight)

    @wp.func
    def measure(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        variant: int,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        step: int,
        back: wp.float64,
    ):
        """Adds an evaluated step to the sums of the window."""
        n = drive.rollers
        time = wp.float64(step) * drive.step
        weight = drive.step
        if step == drive.window_start or step == drive.window_end:
            weight = wp.float64(0.5) * weight
        chain_sums = tally.add_links(w, n, chain, sums.chain[variant], weight)
        if step == drive.window_start:
            chain_sums = add_energy(chain_sums, True, mechanical_energy(ensemble, state, drive, chain, w, time, back))
        if step == drive.window_end:
            chain_sums = add_energy(chain_sums, False, mechanical_energy(ensemble, state, drive, chain, w, time, back))
        sums.chain[variant] = chain_sums
        for p in range(drive.sprockets + drive.guides):
            i = drive.first_sprocket + drive.first_guide + p
            of = state.totals[i]
            add_contact(sums.contact, i, of.force, of.force_max, of.dissipated, of.impacts, weight)
        for s in range(drive.sprockets):
            add_body(ensemble, state, sums, drive, s, time, back, weight)
        for s in range(drive.sprockets):
            i = drive.first_sprocket + s
            strand = state.strands[i]
            if step % STRAND_LOOK_EVERY == 0 or step == drive.window_start:
                strand = follow(w, X, Y, n, strand)
                state.strands[i] = strand
            strand_sums = tally.add_strand_links(w, n, strand, sums.strand[i])
            sums.strand[i] = add_displacement(strand_sums, tally.mid_displacement(w, n, strand))

    @wp.func
    def seen(w: wp.array(dtype=Real), i: int):
        """What a frame wants of roller i beside its motion."""
        of = kinds.Extra()
        of.tension = load(w, TENSION + i)
        of.rate = load(w, RATE + i)
        of.sprocket_force = load(w, SPROCKET_FORCE + i)
        of.guide_force = load(w, GUIDE_FORCE + i)
        return of

    @wp.func
    def sample(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        frames: wp.array(dtype=Real),
        first: wp.int64,
        time: wp.float64,
        back: wp.float64,
    ):
        """Writes the frame that begins at `first`; the velocities are those of a time `back` before it [s]."""
        n = drive.rollers
        at = int(first)
        inverse_mass = chain.inverse_mass
        for i in range(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            position = vec2(load(w, X + i), load(w, Y + i))
            velocity = vec2(load(w, VX + i) + Real(back) * a[0], load(w, VY + i) + Real(back) * a[1])
            write_roller(frames, at, n, i, position, velocity, seen(w, i))
        for s in range(drive.sprockets):
            b = drive.first_body + s
            body = body_now(ensemble, state, b, time, back)
            write_sprocket(frames, at, n, s, body, state.wrenches[b].moment)

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
