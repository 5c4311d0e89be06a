"""The CPU kernel: one Warp thread takes one variant through a block of steps.

At step n, positions and forces are those of time n h. Leapfrog: v(n + 1/2) = v(n - 1/2) + h a(n), x(n + 1) = x(n) +
h v(n + 1/2), the first kick being half a step; damping reads v(n - 1/2), and what is recorded is v(n) = v(n - 1/2) +
h a(n) / 2. rk4 is the classical scheme; contacts keep their memory from step starts only.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .motion import load_moment, prescribed_motion
from .rollers import RK4_ROWS, ROWS, STATE_ROWS, accessors, passes, rows
from .structs import Drive, Motion, Sums, types
from .sums import STRAND_LOOK_EVERY, add_contact, add_displacement, add_sprocket, tallies

SCRATCH_ROWS = len(ROWS) + len(RK4_ROWS)
DIVERGENCE_CHECK = wp.constant(32)  # steps between two looks at whether a variant has left its box

Harmonics = wp.array(dtype=wp.types.vector(3, wp.float64))


@wp.func
def prescribed_at(time: wp.float64, motion: Motion, harmonics: Harmonics):
    """Angle and speed of a prescribed sprocket."""
    h = motion.drive_harmonics
    return prescribed_motion(
        time, motion.start_angle, motion.sign, motion.speed, motion.ramp_time, harmonics, h.first, h.count
    )


@wp.func
def load_at(time: wp.float64, angle: wp.float64, speed: wp.float64, motion: Motion, harmonics: Harmonics):
    """Load moment of a free sprocket [N m], counter-clockwise."""
    h = motion.load_harmonics
    turned = angle - motion.start_angle
    return load_moment(
        time, turned, speed, motion.sign, motion.load, motion.load_ramp_time, harmonics, h.first, h.count
    )


@cache
def stepping(Real: type, capacity: int):
    """The functions that evaluate and advance one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    part = passes(Real, capacity)
    tally = tallies(Real, capacity)
    load, store = accessors(Real).load, accessors(Real).store
    at = rows(capacity)
    X, Y, VX, VY, X_LOW, Y_LOW = at.x, at.y, at.vx, at.vy, at.x_low, at.y_low
    X0_LOW, Y0_LOW, move = at.x0_low, at.y0_low, part.move
    X0, Y0, VX0, VY0, SUM_X, SUM_Y, SUM_VX, SUM_VY = (
        at.x0,
        at.y0,
        at.vx0,
        at.vy0,
        at.sum_x,
        at.sum_y,
        at.sum_vx,
        at.sum_vy,
    )

    # the functions below see these as their own
    link_pass, sprocket_pass, guide_pass = part.link_pass, part.sprocket_pass, part.guide_pass
    acceleration, kick_drift = part.acceleration, part.kick_drift
    TENSION, SPROCKET_FORCE, GUIDE_FORCE = at.tension, at.sprocket_force, at.guide_force

    @wp.func
    def evaluate(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        stage: int,
    ):
        """Forces on all rollers and sprockets for the state in the scratch and in `state.sprockets`."""
        n = drive.rollers
        link_pass(w, n, chain)
        partner = drive.first_sprocket + drive.first_guide
        memory = drive.first_contact
        for s in range(drive.sprockets):
            body = state.sprockets[drive.first_sprocket + s]
            sprocket = ensemble.sprockets[drive.first_sprocket + s]
            state.totals[partner] = sprocket_pass(
                w,
                n,
                sprocket,
                body,
                wp.cos(body.angle),
                wp.sin(body.angle),
                ensemble.seats,
                state.seat,
                state.impact_speed,
                memory,
                stage,
            )
            partner += 1
            memory += n
        for g in range(drive.guides):
            bar = ensemble.guides[drive.first_guide + g]
            state.totals[partner] = guide_pass(w, n, bar, state.impact_speed, memory, stage)
            partner += 1
            memory += n

    @wp.func
    def sprocket_acceleration(ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64):
        """Angular acceleration of free sprocket `s` of the drive, eq. (4)."""
        i = drive.first_sprocket + s
        motion = ensemble.motions[i]
        body = state.sprockets[i]
        load_part = load_at(time, body.angle, body.speed, motion, ensemble.harmonics)
        return (state.totals[drive.first_sprocket + drive.first_guide + s].moment + load_part) * motion.inverse_inertia

    @wp.func
    def leapfrog(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        time: wp.float64,
        kick: wp.float64,
    ):
        """One step from evaluated forces; `kick` is h, or h / 2 from the initial state."""
        h = drive.step
        for s in range(drive.sprockets):
            i = drive.first_sprocket + s
            motion = ensemble.motions[i]
            body = state.sprockets[i]
            if motion.prescribed == 1:
                angle, speed = prescribed_at(time + h, motion, ensemble.harmonics)
                body.speed = (angle - body.angle) / h
                body.angle = angle
            else:
                body.speed = body.speed + kick * sprocket_acceleration(ensemble, state, drive, s, time)
                body.angle = body.angle + h * body.speed
            state.sprockets[i] = body
        kick_drift(w, drive.rollers, chain, Real(kick), Real(h))

    @wp.func
    def rk4_rollers(w: wp.array(dtype=Real), n: int, chain: kinds.Chain, stage: int, weight: Real, reach: Real):
        """Adds this stage's slopes to the sums with `weight`, and goes `reach` along them from the step's start."""
        inverse_mass = Real(1.0) / chain.mass
        i = int(0)
        while i < n:
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load(w, VX + i)
            vy = load(w, VY + i)
            if stage == 0:
                store(w, X0 + i, load(w, X + i))
                store(w, Y0 + i, load(w, Y + i))
                store(w, X0_LOW + i, load(w, X_LOW + i))
                store(w, Y0_LOW + i, load(w, Y_LOW + i))
                store(w, VX0 + i, vx)
                store(w, VY0 + i, vy)
                store(w, SUM_X + i, Real(0.0))
                store(w, SUM_Y + i, Real(0.0))
                store(w, SUM_VX + i, Real(0.0))
                store(w, SUM_VY + i, Real(0.0))
            store(w, SUM_X + i, load(w, SUM_X + i) + weight * vx)
            store(w, SUM_Y + i, load(w, SUM_Y + i) + weight * vy)
            store(w, SUM_VX + i, load(w, SUM_VX + i) + weight * a[0])
            store(w, SUM_VY + i, load(w, SUM_VY + i) + weight * a[1])
            store(w, X + i, load(w, X0 + i))
            store(w, Y + i, load(w, Y0 + i))
            store(w, X_LOW + i, load(w, X0_LOW + i))
            store(w, Y_LOW + i, load(w, Y0_LOW + i))
            if stage == 3:
                move(w, i, load(w, SUM_X + i), load(w, SUM_Y + i))
                store(w, VX + i, load(w, VX0 + i) + load(w, SUM_VX + i))
                store(w, VY + i, load(w, VY0 + i) + load(w, SUM_VY + i))
            else:
                move(w, i, reach * vx, reach * vy)
                store(w, VX + i, load(w, VX0 + i) + reach * a[0])
                store(w, VY + i, load(w, VY0 + i) + reach * a[1])
            i = i + 1

    @wp.func
    def rk4(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        step_time: wp.float64,
        stage: int,
    ):
        """One of the four stages of the classical scheme, from evaluated forces; the fourth ends the step."""
        h = drive.step
        weight = wp.where(stage == 1 or stage == 2, h / wp.float64(3.0), h / wp.float64(6.0))
        reach = wp.where(stage < 2, wp.float64(0.5) * h, h)
        time = step_time + wp.where(stage == 0, wp.float64(0.0), wp.where(stage == 3, h, wp.float64(0.5) * h))
        for s in range(drive.sprockets):
            i = drive.first_sprocket + s
            motion = ensemble.motions[i]
            body = state.sprockets[i]
            if motion.prescribed == 1:
                angle, speed = prescribed_at(step_time + reach, motion, ensemble.harmonics)
                body.angle = angle
                body.speed = speed
            else:
                slope = sprocket_acceleration(ensemble, state, drive, s, time)
                speed = body.speed
                if stage == 0:
                    body.base_angle = body.angle
                    body.base_speed = speed
                    body.sum_angle = wp.float64(0.0)
                    body.sum_speed = wp.float64(0.0)
                body.sum_angle = body.sum_angle + weight * speed
                body.sum_speed = body.sum_speed + weight * slope
                if stage == 3:
                    body.angle = body.base_angle + body.sum_angle
                    body.speed = body.base_speed + body.sum_speed
                else:
                    body.angle = body.base_angle + reach * speed
                    body.speed = body.base_speed + reach * slope
            state.sprockets[i] = body
        rk4_rollers(w, drive.rollers, chain, stage, Real(weight), Real(reach))

    @wp.func
    def true_speed(
        ensemble: kinds.Ensemble, state: kinds.State, drive: Drive, s: int, time: wp.float64, back: wp.float64
    ):
        """Angular velocity of sprocket `s` of the drive at `time`, `back` after its speed's instant."""
        motion = ensemble.motions[drive.first_sprocket + s]
        if motion.prescribed == 1:
            angle, speed = prescribed_at(time, motion, ensemble.harmonics)
            return speed
        body = state.sprockets[drive.first_sprocket + s]
        return body.speed + back * sprocket_acceleration(ensemble, state, drive, s, time)

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
        """Energy of chain, contacts and free sprockets at an evaluated step [J]."""
        total = tally.roller_energy(w, drive.rollers, chain, Real(back))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for s in range(drive.sprockets):
            motion = ensemble.motions[drive.first_sprocket + s]
            if motion.prescribed == 0:
                speed = true_speed(ensemble, state, drive, s, time, back)
                total += wp.float64(0.5) * speed * speed / motion.inverse_inertia
        return total

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
            chain_sums.energy_start = mechanical_energy(ensemble, state, drive, chain, w, time, back)
        if step == drive.window_end:
            chain_sums.energy_end = mechanical_energy(ensemble, state, drive, chain, w, time, back)
        sums.chain[variant] = chain_sums
        for p in range(drive.sprockets + drive.guides):
            i = drive.first_sprocket + drive.first_guide + p
            sums.contact[i] = add_contact(sums.contact[i], state.totals[i], weight)
        for s in range(drive.sprockets):
            i = drive.first_sprocket + s
            motion = ensemble.motions[i]
            speed = true_speed(ensemble, state, drive, s, time, back)
            moment = state.totals[drive.first_sprocket + drive.first_guide + s].moment
            load_part = wp.float64(0.0)
            if motion.prescribed == 0:
                load_part = load_at(time, state.sprockets[i].angle, speed, motion, ensemble.harmonics)
            sums.sprocket[i] = add_sprocket(sums.sprocket[i], speed, moment, load_part, weight)
            strand = state.strands[i]
            if step % STRAND_LOOK_EVERY == 0 or step == drive.window_start:
                strand = tally.follow(w, n, strand)
                state.strands[i] = strand
            strand_sums = tally.add_strand_links(w, n, strand, sums.strand[i])
            sums.strand[i] = add_displacement(strand_sums, tally.displacement(w, n, strand))

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
        """Writes one frame: rows x, y, vx, vy, tension, sprocket force, guide force; then 5 values a sprocket."""
        n = drive.rollers
        inverse_mass = Real(1.0) / chain.mass
        for i in range(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            at_roller = int(first) + i
            frames[at_roller] = load(w, X + i)
            frames[at_roller + n] = load(w, Y + i)
            frames[at_roller + 2 * n] = load(w, VX + i) + Real(back) * a[0]
            frames[at_roller + 3 * n] = load(w, VY + i) + Real(back) * a[1]
            frames[at_roller + 4 * n] = load(w, TENSION + i)
            frames[at_roller + 5 * n] = load(w, SPROCKET_FORCE + i)
            frames[at_roller + 6 * n] = load(w, GUIDE_FORCE + i)
        for s in range(drive.sprockets):
            body = state.sprockets[drive.first_sprocket + s]
            at_sprocket = int(first) + 7 * n + 5 * s
            frames[at_sprocket] = Real(body.angle)
            frames[at_sprocket + 1] = Real(true_speed(ensemble, state, drive, s, time, back))
            frames[at_sprocket + 2] = Real(state.totals[drive.first_sprocket + drive.first_guide + s].moment)
            frames[at_sprocket + 3] = Real(body.center[0])
            frames[at_sprocket + 4] = Real(body.center[1])

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})


@cache
def advance_kernel(Real: type, capacity: int) -> wp.Kernel:
    """The kernel that takes variants through a block of steps, for up to `capacity` - 1 rollers."""
    kinds = types(Real)
    part = passes(Real, capacity)
    do = stepping(Real, capacity)
    inside = part.inside

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        frames: wp.array(dtype=Real),
        w: wp.array(dtype=Real),
        first: int,
        block: int,
    ):
        """Variants `first` + thread: `block` steps on, sums and frames written on the way."""
        variant = first + wp.tid()
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        progress = state.progress[variant]
        n = drive.rollers
        part.fetch(state.rollers, w, STATE_ROWS * drive.first_roller, n)
        end = wp.min(progress.step + block, drive.steps + 1)
        frame = drive.first_value
        step = progress.step
        while step < end and progress.diverged == 0:
            time = wp.float64(step) * drive.step
            back = wp.float64(0.0)
            kick = drive.step
            if drive.integrator == 0:
                if step == 0:
                    kick = wp.float64(0.5) * drive.step
                else:
                    back = wp.float64(0.5) * drive.step
            stage = int(0)
            while stage < 4:
                do.evaluate(ensemble, state, drive, chain, w, stage)
                if stage == 0:
                    if step >= drive.window_start and step <= drive.window_end:
                        do.measure(ensemble, state, sums, variant, drive, chain, w, step, back)
                    if drive.sample_every > 0:
                        if step % drive.sample_every == 0:
                            do.sample(ensemble, state, drive, chain, w, frames, frame, time, back)
                            frame = frame + wp.int64(7 * n + 5 * drive.sprockets)
                    if step % DIVERGENCE_CHECK == 0 or step == drive.steps:
                        if inside(w, n, drive.low, drive.high) == 0:
                            progress.diverged = 1
                if step == drive.steps or progress.diverged == 1:
                    stage = 4
                elif drive.integrator == 0:
                    do.leapfrog(ensemble, state, drive, chain, w, time, kick)
                    stage = 4
                else:
                    do.rk4(ensemble, state, drive, chain, w, time, stage)
                    stage = stage + 1
            if progress.diverged == 0:
                step = step + 1
        progress.step = step
        state.progress[variant] = progress
        part.put_back(state.rollers, w, STATE_ROWS * drive.first_roller, n)

    return advance
