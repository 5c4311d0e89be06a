"""What a block's threads take from an evaluated step: sums of the window, and the energy balance.

A thread adds up its own links' tension over `STRAND_EVERY` steps, then adds that to the tally of the strand that
the link is on; one thread keeps the sums of a sprocket and its strand. `collect` makes one row a variant of it.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..batches import NOTES
from ..physics.body import body_energy, held_by
from ..physics.link import link_chain
from ..physics.motion import load_moment_at_speed
from ..physics.roller import roller_energy
from ..rows import accessors
from ..structs import BodyState, Drive, Mount, Pose, Wheel, Wrench, types
from ..sum_structs import ChainNote, ContactSums, LinkTally, Sums, Tallies
from ..sums import (
    add_displacement,
    add_energy,
    add_hub_force,
    add_mount,
    add_sprocket,
    displacement,
    following,
    merge_contact,
    merge_roller,
    merge_tension,
    unseen,
)
from .block_bodies import Seen
from .block_events import ENDS, START
from .block_kind import BlockKind, Mine, now_struct
from .block_rows import block_rows
from .exchange import SEEN


@dataclass(frozen=True)
class ObserveFunctions:
    """What observes one variant on a block."""

    reset_link: wp.Function
    add_link: wp.Function
    flush: wp.Function
    category_of: wp.Function
    update_strand: wp.Function
    add_middle: wp.Function
    energy_of_roller: wp.Function
    observe_spin: wp.Function
    observe_sprocket: wp.Function


@cache
def block_observing(kind: BlockKind) -> ObserveFunctions:
    """The functions that observe one variant on a block."""
    Real, sprockets, moving, slots = kind.Real, kind.sprockets, kind.moving, kind.slots
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    row = block_rows(kind)
    X, Y = row.X, row.Y
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    LOWEST, HIGHEST, TENSION, SQUARE, RATE = (wp.constant(k * slots) for k in range(5))
    FRICTION = wp.constant(SEEN * slots)
    follow = following(Real).follow

    @wp.func
    def reset_link(shared: kinds.Shared, j: int):
        """Nothing has been seen of link j."""
        store_row(shared.seen, LOWEST + j, Real(3.0e38))
        store_row(shared.seen, HIGHEST + j, -Real(3.0e38))
        store_row(shared.seen, TENSION + j, Real(0.0))
        store_row(shared.seen, SQUARE + j, Real(0.0))
        store_row(shared.seen, RATE + j, Real(0.0))
        if wp.static(kind.bending):
            store_row(shared.seen, FRICTION + j, Real(0.0))

    @wp.func
    def add_link(shared: kinds.Shared, j: int, tension: Real, rate: Real, weight: Real):
        """One step's tension of link j, and its rate squared over the time `weight` that the step stands for [s]."""
        if tension < load_row(shared.seen, LOWEST + j):
            store_row(shared.seen, LOWEST + j, tension)
        if tension > load_row(shared.seen, HIGHEST + j):
            store_row(shared.seen, HIGHEST + j, tension)
        store_row(shared.seen, TENSION + j, load_row(shared.seen, TENSION + j) + tension)
        store_row(shared.seen, SQUARE + j, load_row(shared.seen, SQUARE + j) + tension * tension)
        store_row(shared.seen, RATE + j, load_row(shared.seen, RATE + j) + weight * (rate * rate))

    @wp.func
    def category_of(shared: kinds.Shared, j: int, n: int):
        """Strand that link j is on, S where it is on none."""
        category = int(wp.static(sprockets))
        for s in range(wp.static(sprockets)):
            place = j - shared.strands[s].first_link
            if place < 0:
                place = place + n
            if place < shared.strands[s].links:
                category = s
        return category

    @wp.func
    def chain_of(ensemble: kinds.Ensemble, variant: int, j: int):
        """The chain, with the stiffness and damping of its link j."""
        if wp.static(kind.uneven):
            return link_chain(j, ensemble.chains[variant], ensemble.links[variant])
        else:
            return ensemble.chains[variant]

    @wp.func
    def flush(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        variant: int,
        j: int,
        n: int,
        samples: int,
    ):
        """Adds what has been seen of link j at `samples` steps to its tally of the strand it is on."""
        drive = ensemble.drives[variant]
        at = drive.first_tally + category_of(shared, j, n) * n + j
        seen = LinkTally()
        seen.tension_min = wp.float64(load_row(shared.seen, LOWEST + j))
        seen.tension_max = wp.float64(load_row(shared.seen, HIGHEST + j))
        seen.tension = wp.float64(load_row(shared.seen, TENSION + j))
        seen.tension_square = wp.float64(load_row(shared.seen, SQUARE + j))
        tally = merge_tension(tallies.link[at], seen)
        tally.samples = tally.samples + wp.int64(samples)
        tallies.link[at] = tally
        roller = tallies.roller[drive.first_roller + j]
        power = wp.float64(chain_of(ensemble, variant, j).damping) * wp.float64(load_row(shared.seen, RATE + j))
        roller.dissipated = roller.dissipated + power
        if wp.static(kind.bending):
            roller.friction = roller.friction + wp.float64(load_row(shared.seen, FRICTION + j))
        tallies.roller[drive.first_roller + j] = roller

    @wp.func
    def update_strand(shared: kinds.Shared, n: int, s: int):
        """Strand s brought up to date."""
        shared.strands[s] = follow(shared.rows, X, Y, n, shared.strands[s])

    @wp.func
    def add_middle(shared: kinds.Shared, n: int, s: int):
        """One step's mid-strand displacement of strand s."""
        rows = shared.rows
        a = shared.strands[s].middle
        b = wp.where(a + 1 < n, a + 1, 0)
        ax = wp.float64(load_row(rows, X + a))
        ay = wp.float64(load_row(rows, Y + a))
        value = displacement(
            ax, ay, wp.float64(load_row(rows, X + b)), wp.float64(load_row(rows, Y + b)), shared.strands[s]
        )
        shared.strand_sums[s] = add_displacement(shared.strand_sums[s], value)

    @wp.func
    def energy_of_roller(
        ensemble: kinds.Ensemble, shared: kinds.Shared, variant: int, j: int, v: vec2, extra: kinds.Extra
    ):
        """Kinetic and potential energy of roller j, elastic energy of the link after it and of its contacts [J]."""
        position = vec2(load_row(shared.rows, X + j), load_row(shared.rows, Y + j))
        held, weight = roller_energy(position, v, extra.tension, extra.rate, chain_of(ensemble, variant, j))
        return held - weight + wp.float64(extra.energy)

    @wp.func
    def observe_spin(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        seen: Seen,
        acting: wp.vec3f,
        before: Wheel,
    ):
        """As `observe_sprocket`, and the hub's force, of a sprocket that is moved in pairs of float32."""
        s = mine.sprocket
        spin = shared.spins[s]
        time = float(now.step) * mine.step.high
        weight = wp.float64(now.weight)
        load = load_moment_at_speed(time, seen.load, before.speed.high, seen.speed, spin)
        if now.flags & ENDS != 0 and spin.prescribed == 0:
            at = ensemble.drives[mine.variant].first_body + s
            energy = wp.float64(0.5 * seen.speed * seen.speed / spin.inverse_inertia)
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)
        sums = add_sprocket(
            shared.sprocket_sums[s], wp.float64(seen.speed), wp.float64(acting[0]), wp.float64(load), weight
        )
        hub = wp.vec2d(wp.float64(acting[1]), wp.float64(acting[2]))
        shared.sprocket_sums[s] = add_hub_force(sums, hub, weight)

    @wp.func
    def observe_sprocket(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        body: BodyState,
        wrench: Wrench,
        before: Pose,
    ):
        """One step of the thread's sprocket for the sums of the window, and its energy at their ends.

        `body` has the sprocket's rates at the step's instant, `before` is its pose, with the load at the rates there.
        """
        s = mine.sprocket
        time = wp.float64(now.step) * mine.h
        weight = wp.float64(now.weight)
        motion = shared.motions[s]
        mount = Mount()
        if wp.static(moving):
            mount = shared.mounts[s]
        load = load_moment_at_speed(time, before.load, before.speed, body.speed, motion)
        if wp.static(moving):
            if mount.active != 0:
                held, power = held_by(time, body, wrench, load, motion, mount, ensemble.curves)
                shared.mount_sums[s] = add_mount(shared.mount_sums[s], body, mount, held, power, weight)
        if now.flags & ENDS != 0:
            at = ensemble.drives[mine.variant].first_body + s
            energy = body_energy(body, motion, mount)
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)
        shared.sprocket_sums[s] = add_sprocket(shared.sprocket_sums[s], body.speed, wrench.moment, load, weight)

    return ObserveFunctions(
        reset_link=reset_link,
        add_link=add_link,
        flush=flush,
        category_of=category_of,
        update_strand=update_strand,
        add_middle=add_middle,
        energy_of_roller=energy_of_roller,
        observe_spin=observe_spin,
        observe_sprocket=observe_sprocket,
    )


@wp.func
def whole_note(sums: Sums, drive: Drive, k: int, note: ChainNote):
    """Note k of a chain from that of its links on no strand, counted one by one, and those of its strands."""
    for s in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
        note.tension = note.tension + sums.strand_notes[s * NOTES + k].tension
        note.samples = note.samples + sums.strand_notes[s * NOTES + k].links
    note.samples = note.samples / wp.int64(drive.rollers)
    return note


@wp.kernel(enable_backward=False)
def collect(drives: wp.array[Drive], tallies: Tallies, sums: Sums):
    """Adds up one variant's tallies, roller by roller in order: a thread a variant."""
    variant = wp.tid()
    drive = drives[variant]
    n = drive.rollers
    chain = sums.chain[variant]
    samples = wp.int64(0)
    for c in range(drive.sprockets + 1):
        strand = unseen()
        for i in range(n):
            tally = tallies.link[drive.first_tally + c * n + i]
            if tally.samples > wp.int64(0):
                strand = merge_tension(strand, tally)
                strand.samples = strand.samples + tally.samples
        chain = merge_tension(chain, strand)
        samples = samples + strand.samples
        if c < drive.sprockets:
            mine = merge_tension(sums.strand[drive.first_sprocket + c], strand)
            mine.links = mine.links + strand.samples
            sums.strand[drive.first_sprocket + c] = mine
    chain.samples = samples / wp.int64(n)
    for k in range(variant * NOTES, (variant + 1) * NOTES):
        sums.chain_notes[k] = whole_note(sums, drive, k - variant * NOTES, sums.chain_notes[k])
    for i in range(n):
        chain = merge_roller(chain, tallies.roller[drive.first_roller + i])
    for b in range(drive.bodies):
        chain = merge_roller(chain, tallies.body[drive.first_body + b])
    sums.chain[variant] = chain
    memory = drive.first_contact
    for p in range(drive.sprockets + drive.guides):
        at = drive.first_sprocket + drive.first_guide + p
        total = ContactSums()
        for i in range(n):
            total = merge_contact(total, tallies.contact[memory + i])
        sums.contact[at] = total
        memory = memory + n
