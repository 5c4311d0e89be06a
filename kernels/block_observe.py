"""What a block's threads take from an evaluated step: sums of the window, the energy balance, and frames.

A thread adds up its own link's tension over `STRAND_LOOK_EVERY` steps in registers, then adds that to the tally of the
strand that the link is on; thread s keeps the sums of sprocket s. `collect` makes one row a variant of it.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .block_forces import block_forces
from .body import body_accelerations, heading_of, load_at
from .exchange import lowest_bit
from .motion import ramp
from .mount import body_energy, holding_force, prescribing_power
from .rollers import STATE_ROWS
from .structs import Drive, SprocketState, types
from .sum_structs import ContactSums, StrandSums, Sums, Tallies, Totals
from .sums import add_displacement, add_mount, add_sprocket, displacement, following

EVENT = wp.constant(1)
"""What can happen at a step, as bits."""
LAST = wp.constant(2)
FRAME = wp.constant(4)
START = wp.constant(8)  # of the window
END = wp.constant(16)
ENDS = wp.constant(24)
CHECK = wp.constant(32)  # whether the variant diverged


@cache
def block_observing(Real: type, threads: int, sprockets: int, guides: int, moving: bool = False) -> SimpleNamespace:
    """The functions that look at one variant on a block of `threads` threads."""
    kinds = types(Real)
    vec2 = kinds.vec2
    part = block_forces(Real, threads, sprockets, guides, moving)
    State = part.State
    follow = following(Real).follow

    @wp.func
    def fresh():
        """Nothing seen yet."""
        recent = kinds.Recent()
        recent.tension_min = Real(3.0e38)
        recent.tension_max = Real(-3.0e38)
        return recent

    @wp.func
    def with_link(recent: kinds.Recent, tension: Real, rate: Real, weight: Real):
        """One step's tension, and rate squared over the time `weight` that the step stands for [s]."""
        recent.samples = recent.samples + 1
        recent.tension_min = wp.min(recent.tension_min, tension)
        recent.tension_max = wp.max(recent.tension_max, tension)
        recent.tension = recent.tension + tension
        recent.tension_square = recent.tension_square + tension * tension
        recent.rate_square = recent.rate_square + weight * (rate * rate)
        return recent

    @wp.func
    def flush(ensemble: kinds.Ensemble, tallies: Tallies, variant: int, recent: kinds.Recent, category: int, i: int):
        """Adds what link i has seen recently to its tally of strand `category`."""
        if recent.samples > 0:
            drive = ensemble.drives[variant]
            at = drive.first_tally + category * drive.rollers + i
            tally = tallies.link[at]
            if tally.samples == wp.int64(0):
                tally.tension_min = wp.float64(recent.tension_min)
                tally.tension_max = wp.float64(recent.tension_max)
            tally.samples = tally.samples + wp.int64(recent.samples)
            tally.tension_min = wp.min(tally.tension_min, wp.float64(recent.tension_min))
            tally.tension_max = wp.max(tally.tension_max, wp.float64(recent.tension_max))
            tally.tension = tally.tension + wp.float64(recent.tension)
            tally.tension_square = tally.tension_square + wp.float64(recent.tension_square)
            tallies.link[at] = tally
            roller = tallies.roller[drive.first_roller + i]
            power = wp.float64(ensemble.chains[variant].damping) * wp.float64(recent.rate_square)
            roller.dissipated = roller.dissipated + power
            tallies.roller[drive.first_roller + i] = roller

    @wp.func
    def look(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, variant: int, s: int):
        """Strand s brought up to date from positions published in the state's rows."""
        drive = ensemble.drives[variant]
        first = STATE_ROWS * drive.first_roller
        shared.strands[s] = follow(state.rollers, first, first + drive.rollers, drive.rollers, shared.strands[s])

    @wp.func
    def category_of(ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, i: int):
        """Strand that link i is on (S: none), and the strands whose middle it passes, as bits."""
        drive = ensemble.drives[variant]
        category = drive.sprockets
        middle = int(0)
        for s in range(drive.sprockets):
            strand = shared.strands[s]
            place = i - strand.first_link
            if place < 0:
                place = place + drive.rollers
            if place < strand.links:
                category = s
            if strand.middle == i:
                middle = middle | (1 << s)
        return category, middle

    @wp.func
    def add_middle(shared: kinds.Shared, own: State, other: State, middle: int):
        """One step's mid-strand displacement of the strands whose middle this link passes."""
        while middle != 0:
            s = lowest_bit(middle)
            middle = middle & (middle - 1)
            value = displacement(
                wp.float64(own[0]), wp.float64(own[1]), wp.float64(other[0]), wp.float64(other[1]), shared.strands[s]
            )
            shared.strand_sums[s] = add_displacement(shared.strand_sums[s], value)

    @wp.func
    def link_energy(ensemble: kinds.Ensemble, variant: int, own: State, tension: Real, rate: Real):
        """Potential energy of a roller and elastic energy of its link [J]."""
        chain = ensemble.chains[variant]
        spring = wp.float64(tension - chain.damping * rate)
        lift = wp.float64(chain.gravity[0]) * wp.float64(own[0]) + wp.float64(chain.gravity[1]) * wp.float64(own[1])
        return wp.float64(0.5) * spring * spring / wp.float64(chain.stiffness) - wp.float64(chain.mass) * lift

    @wp.func
    def motion_energy(ensemble: kinds.Ensemble, variant: int, v: vec2):
        """Kinetic energy of a roller [J]."""
        return wp.float64(0.5) * wp.float64(ensemble.chains[variant].mass) * wp.float64(wp.dot(v, v))

    @wp.func
    def add_energy(ensemble: kinds.Ensemble, tallies: Tallies, variant: int, i: int, start: int, energy: wp.float64):
        """Adds to the energy at the window's start if `start`, else at its end, kept with roller i."""
        at = ensemble.drives[variant].first_roller + i
        roller = tallies.roller[at]
        if start != 0:
            roller.energy_start = roller.energy_start + energy
        else:
            roller.energy_end = roller.energy_end + energy
        tallies.roller[at] = roller

    @wp.func
    def observe_mount(
        ensemble: kinds.Ensemble,
        shared: kinds.Shared,
        s: int,
        time: wp.float64,
        body: SprocketState,
        on: Totals,
        weight: wp.float64,
    ):
        """One step of sprocket s on its active mount for the sums of the window; returns its energy [J]."""
        motion = shared.motions[s]
        mount = shared.mounts[s]
        heading = heading_of(body)
        rates = body_accelerations(time, body, heading, on, motion, mount, ensemble.harmonics, ensemble.tables)
        held = holding_force(body, heading, on, rates, mount)
        power = prescribing_power(body, heading, held, rates, motion.prescribed, mount)
        shared.mount_sums[s] = add_mount(shared.mount_sums[s], body, mount, held, power, weight)
        return body_energy(body, heading, mount)

    @wp.func
    def observe_sprocket(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        variant: int,
        s: int,
        i: int,
        time: wp.float64,
        body: SprocketState,
        on: Totals,
        target: wp.float64,
        half_behind: wp.float64,
        weight: wp.float64,
        flags: int,
    ):
        """One step of sprocket s for the sums of the window, and its energy at their ends, kept with roller i.

        `target` is its load moment at the angular velocity `half_behind`, if it is free.
        """
        motion = shared.motions[s]
        load = wp.float64(0.0)
        energy = wp.float64(0.0)
        if motion.prescribed == 0:
            # the load of the step, but at the speed of its instant
            speed = body.speed
            damped = motion.load[1] * (speed - half_behind) + motion.load[2] * (
                speed * wp.abs(speed) - half_behind * wp.abs(half_behind)
            )
            load = target - damped * ramp(time, motion.load_ramp_time)
            energy = wp.float64(0.5) * body.speed * body.speed / motion.inverse_inertia
        if wp.static(moving):
            if shared.mounts[s].active != 0:
                if motion.prescribed == 0:
                    load = load_at(time, body.angle, body.speed, motion, ensemble.harmonics, ensemble.tables)
                energy = observe_mount(ensemble, shared, s, time, body, on, weight)
        if flags & ENDS != 0:
            add_energy(ensemble, tallies, variant, i, flags & START, energy)
        shared.sprocket_sums[s] = add_sprocket(shared.sprocket_sums[s], body.speed, on.moment, load, weight)

    @wp.func
    def write_link(frames: wp.array(dtype=Real), at: int, n: int, own: State, tension: Real):
        """A roller's place and its link's tension in a frame, as `observe.sample` lays it out."""
        frames[at] = own[0]
        frames[at + n] = own[1]
        frames[at + 4 * n] = tension

    @wp.func
    def write_rest(frames: wp.array(dtype=Real), at: int, n: int, v: vec2, extra: kinds.Extra):
        """A roller's velocity and contact forces in a frame."""
        frames[at + 2 * n] = v[0]
        frames[at + 3 * n] = v[1]
        frames[at + 5 * n] = extra.sprocket_force
        frames[at + 6 * n] = extra.guide_force

    @wp.func
    def write_sprocket(frames: wp.array(dtype=Real), at: int, body: SprocketState, moment: wp.float64):
        """One sprocket's part of a frame."""
        frames[at] = Real(body.angle)
        frames[at + 1] = Real(body.speed)
        frames[at + 2] = Real(moment)
        frames[at + 3] = Real(body.center[0])
        frames[at + 4] = Real(body.center[1])

    return SimpleNamespace(
        **{name: value for name, value in locals().items() if isinstance(value, wp.Function)},
    )


@wp.kernel(enable_backward=False)
def collect(drives: wp.array(dtype=Drive), tallies: Tallies, sums: Sums):
    """Adds up one variant's tallies, roller by roller in order: a thread a variant."""
    variant = wp.tid()
    drive = drives[variant]
    n = drive.rollers
    chain = sums.chain[variant]
    samples = wp.int64(0)
    for c in range(drive.sprockets + 1):
        strand = StrandSums()
        strand.tension_min = wp.float64(1.0e308)
        strand.tension_max = wp.float64(-1.0e308)
        for i in range(n):
            tally = tallies.link[drive.first_tally + c * n + i]
            if tally.samples > wp.int64(0):
                strand.links = strand.links + tally.samples
                strand.tension_min = wp.min(strand.tension_min, tally.tension_min)
                strand.tension_max = wp.max(strand.tension_max, tally.tension_max)
                strand.tension = strand.tension + tally.tension
                strand.tension_square = strand.tension_square + tally.tension_square
        chain.tension_min = wp.min(chain.tension_min, strand.tension_min)
        chain.tension_max = wp.max(chain.tension_max, strand.tension_max)
        chain.tension = chain.tension + strand.tension
        chain.tension_square = chain.tension_square + strand.tension_square
        samples = samples + strand.links
        if c < drive.sprockets:
            mine = sums.strand[drive.first_sprocket + c]
            mine.links = strand.links
            mine.tension_min = strand.tension_min
            mine.tension_max = strand.tension_max
            mine.tension = strand.tension
            mine.tension_square = strand.tension_square
            sums.strand[drive.first_sprocket + c] = mine
    chain.samples = samples / wp.int64(n)
    for i in range(n):
        roller = tallies.roller[drive.first_roller + i]
        chain.dissipated = chain.dissipated + roller.dissipated
        chain.energy_start = chain.energy_start + roller.energy_start
        chain.energy_end = chain.energy_end + roller.energy_end
    sums.chain[variant] = chain
    memory = drive.first_contact
    for p in range(drive.sprockets + drive.guides):
        at = drive.first_sprocket + drive.first_guide + p
        total = ContactSums()
        for i in range(n):
            contact = tallies.contact[memory + i]
            total.force_max = wp.max(total.force_max, contact.force_max)
            total.impacts = total.impacts + contact.impacts
            total.impulse = total.impulse + contact.impulse
            total.dissipated = total.dissipated + contact.dissipated
        sums.contact[at] = total
        memory = memory + n
