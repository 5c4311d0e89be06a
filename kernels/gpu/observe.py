"""What a block's threads take from an evaluated step: sums of the window, and the energy balance.

Every step a thread adds up the squared rates of its own links; at watched ones it holds their tensions
against the extremes of the strands that they are on, which hardly ever change. Looks add tensions to tallies of each
link and strand. One thread keeps the sums of a sprocket and its strand. `collect` makes one row a variant of it.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..batches import NOTES
from ..number import counted
from ..physics.body import body_energy, held_by
from ..physics.hub import hub_held, narrow_wrench, off_home, with_hub
from ..physics.link import link_chain
from ..physics.motion import load_moment_at_speed
from ..physics.mount import mounted_energy
from ..physics.roller import roller_energy
from ..rows import accessors
from ..structs import BodyState, Drive, Mount, Pose, Strand, Wheel, Wrench, types
from ..sum_structs import ChainNote, ContactSums, LinkTally, RollerTally, Sums, Tallies
from ..sums import (
    add_displacement,
    add_energy,
    add_mount,
    add_powers,
    add_speed,
    add_tension,
    displacement,
    following,
    merge_contact,
    merge_extremes,
    merge_roller,
    merge_tension,
)
from .bodies import Seen
from .events import ENDS, START
from .kind import WARP, BlockKind, Mine, now_struct
from .roller_rows import roller_rows
from .shared_memory import extremes, seen_rows
from .strands import block_strands
from .sync import add_to_link, add_to_roller, after_turn, lanes, lanes_where, lowest_bit

SIGN_BITS = """
#if defined(__CUDA_ARCH__)
    return __double2hiint(value);
#else
    return value < 0 ? -1 : 0;
#endif
"""


@dataclass(frozen=True)
class ObserveFunctions:
    """What observes one variant on a block."""

    start_extremes: wp.Function
    end_extremes: wp.Function
    watch: wp.Function
    rates_of: wp.Function
    set_rates: wp.Function
    with_rates: wp.Function
    flush: wp.Function
    add_link: wp.Function
    update_strand: wp.Function
    add_middle: wp.Function
    energy_of_roller: wp.Function
    observe_spin: wp.Function
    observe_sprocket: wp.Function


@cache
def block_observing(kind: BlockKind) -> ObserveFunctions:
    """The functions that observe one variant on a block."""
    Real, threads, rollers_per_thread, sprockets, moving = (
        kind.Real,
        kind.threads,
        kind.rollers_per_thread,
        kind.sprockets,
        kind.moving,
    )
    kinds, Now = types(Real), now_struct(Real)
    vec2, of_each = kinds.vec2, wp.types.vector(rollers_per_thread, Real)
    row = roller_rows(kind)
    X, Y = row.X, row.Y
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    RATES, FRICTION = (wp.constant(at) for at in seen_rows(kind)[:2])
    follow, strand_at = following(Real).follow, block_strands(kind).strand_at

    @wp.func_native(SIGN_BITS if Real == wp.float64 else SIGN_BITS.replace("__double2hiint", "__float_as_int"))
    def sign_bits(value: Real) -> int:
        """A negative number where `value` is negative: many are tested at once, none waits for another."""
        ...

    @wp.func
    def extremes_at(i: int, of: int):
        """Where the lowest tension on strand `of` stands for thread i's warp; the highest is the next value."""
        return i // wp.static(WARP) * wp.static(extremes(kind)) + 2 * of

    @wp.func
    def set_extremes(shared: kinds.Shared, at: int, lowest: wp.float64, highest: wp.float64):
        """Makes a pair of extremes stand at `at`."""
        store_row(shared.seen, at, Real(lowest))
        store_row(shared.seen, at + 1, Real(highest))

    @wp.func
    def start_extremes(ensemble: kinds.Ensemble, sums: Sums, shared: kinds.Shared, mine: Mine):
        """The extremes of tension so far, which one thread of each warp sets; no rates and no friction yet."""
        i = mine.thread
        none = int(wp.static(sprockets))
        if i % wp.static(WARP) == 0:
            first = ensemble.drives[mine.variant].first_sprocket
            for s in range(wp.static(sprockets)):
                strand = sums.strand[first + s]
                set_extremes(shared, extremes_at(i, s), strand.tension_min, strand.tension_max)
            chain = sums.chain[mine.variant]
            set_extremes(shared, extremes_at(i, none), chain.tension_min, chain.tension_max)
            set_extremes(shared, extremes_at(i, none + 1), wp.float64(-3.0e38), wp.float64(3.0e38))
        j = int(i)
        while j < wp.static(kind.slots + kind.joint_friction * threads):
            store_row(shared.seen, RATES + j, Real(0.0))
            j = j + wp.static(threads)

    @wp.func
    def extremes_of(shared: kinds.Shared, of: int):
        """Lowest and highest tension on strand `of` that any warp has seen [N]."""
        lowest = Real(3.0e38)
        highest = -Real(3.0e38)
        for w in range(wp.static(threads // WARP)):
            at = extremes_at(w * wp.static(WARP), of)
            lowest = wp.min(lowest, load_row(shared.seen, at))
            highest = wp.max(highest, load_row(shared.seen, at + 1))
        return wp.float64(lowest), wp.float64(highest)

    @wp.func
    def end_extremes(ensemble: kinds.Ensemble, sums: Sums, shared: kinds.Shared, mine: Mine):
        """The extremes of tension into the sums, by the threads that have the strands' other sums, and the first."""
        s = mine.sprocket
        if s >= 0:
            at = ensemble.drives[mine.variant].first_sprocket + s
            lowest, highest = extremes_of(shared, s)
            sums.strand[at] = merge_extremes(sums.strand[at], lowest, highest)
        if mine.thread == 0:
            lowest, highest = extremes_of(shared, wp.static(sprockets))
            sums.chain[mine.variant] = merge_extremes(sums.chain[mine.variant], lowest, highest)

    @wp.func
    def widen(shared: kinds.Shared, i: int, tension: of_each):
        """Holds the tensions of thread i's links against its warp's extremes, which no other thread does just now."""
        for k in range(wp.static(rollers_per_thread)):
            at = extremes_at(i, strand_at(shared, i, k))
            if tension[k] < load_row(shared.seen, at):
                store_row(shared.seen, at, tension[k])
            if tension[k] > load_row(shared.seen, at + 1):
                store_row(shared.seen, at + 1, tension[k])

    @wp.func
    def watch(shared: kinds.Shared, i: int, tension: of_each):
        """Holds the tensions of the links of thread i's warp against the extremes so far: rarely one is beyond.

        Those threads that have such a link then take turns.
        """
        beyond = int(0)
        for k in range(wp.static(rollers_per_thread)):
            at = extremes_at(i, strand_at(shared, i, k))
            beyond = beyond | sign_bits(tension[k] - load_row(shared.seen, at))
            beyond = beyond | sign_bits(load_row(shared.seen, at + 1) - tension[k])
        waiting = lanes_where(wp.where(beyond < 0, 1, 0))
        while waiting != 0:
            if i % lanes() == lowest_bit(waiting):
                widen(shared, i, tension)
            waiting = waiting & (waiting - 1)
            after_turn()

    @wp.func
    def chain_of(shared: kinds.Shared, j: int):
        """The chain, with the stiffness and damping of its link j."""
        if wp.static(kind.varied_links):
            return link_chain(j, shared.chain[0], shared.links[0])
        else:
            return shared.chain[0]

    @wp.func
    def rates_of(shared: kinds.Shared, i: int):
        """The sums of squared rates of thread i's links since they were last flushed.

        Each link has a sum of its own, so that what comes out is the same however many links a thread has.
        """
        sums = of_each()
        for k in range(wp.static(rollers_per_thread)):
            sums[k] = load_row(shared.seen, RATES + k * wp.static(threads) + i)
        return sums

    @wp.func
    def set_rates(shared: kinds.Shared, i: int, sums: of_each):
        """Makes these the sums of squared rates of thread i's links."""
        for k in range(wp.static(rollers_per_thread)):
            store_row(shared.seen, RATES + k * wp.static(threads) + i, sums[k])

    @wp.func
    def with_rates(sums: of_each, rate: of_each, weight: Real):
        """Sums with one step's squared rates, over the time `weight` that it stands for [s]."""
        for k in range(wp.static(rollers_per_thread)):
            sums[k] = sums[k] + (weight * rate[k]) * rate[k]
        return sums

    @wp.func
    def flush(tallies: Tallies, shared: kinds.Shared, mine: Mine):
        """Adds what the thread's links and joints have taken to their tallies."""
        j = int(mine.thread)
        while j < mine.rollers:
            taken = RollerTally()
            taken.dissipated = wp.float64(chain_of(shared, j).damping * load_row(shared.seen, RATES + j))
            store_row(shared.seen, RATES + j, Real(0.0))
            if wp.static(kind.joint_friction):
                if j < wp.static(threads):  # with its first roller goes what a thread has of all
                    taken.friction = wp.float64(load_row(shared.seen, FRICTION + j))
                    store_row(shared.seen, FRICTION + j, Real(0.0))
            add_to_roller(tallies.roller, mine.first + j, taken)
            j = j + wp.static(threads)

    @wp.func
    def add_link(tallies: Tallies, drive: Drive, shared: kinds.Shared, j: int, tension: Real):
        """A look at link j, whose tension goes to its tally of the strand it is on; returns that strand."""
        of = strand_at(shared, j % wp.static(threads), j // wp.static(threads))
        seen = add_tension(LinkTally(), tension)
        seen.samples = wp.int64(1)
        add_to_link(tallies.link, drive.first_tally + of * drive.rollers + j, seen)
        return of

    @wp.func
    def update_strand(state: kinds.State, shared: kinds.Shared, n: int, at: int):
        """Strand `at` of all brought up to date."""
        state.strands[at] = follow(shared.rows, X, Y, n, state.strands[at])

    @wp.func
    def add_middle(sums: Sums, shared: kinds.Shared, n: int, at: int, strand: Strand):
        """A look at the mid-strand displacement of `strand`, whose sums are at `at`."""
        rows = shared.rows
        a = strand.middle
        b = wp.where(a + 1 < n, a + 1, 0)
        ax = wp.float64(load_row(rows, X + a))
        ay = wp.float64(load_row(rows, Y + a))
        value = displacement(ax, ay, wp.float64(load_row(rows, X + b)), wp.float64(load_row(rows, Y + b)), strand)
        sums.strand[at] = add_displacement(sums.strand[at], value)

    @wp.func
    def energy_of_roller(shared: kinds.Shared, j: int, v: vec2, extra: kinds.Extra):
        """Kinetic and potential energy of roller j, elastic energy of the link after it and of its contacts [J]."""
        held, weight = roller_energy(row.position(shared.rows, j), v, extra.tension, extra.rate, chain_of(shared, j))
        return held - weight + wp.float64(extra.energy)

    @wp.func
    def observe_hub(
        ensemble: kinds.Ensemble,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        seen: Seen,
        acting: wp.vec3f,
        before: Wheel,
    ):
        """One step of the mount of the thread's sprocket, and its energy at the window's ends.

        The load is in `seen.turning`; `before` is where the sprocket is.
        """
        s = mine.sprocket
        hub = shared.hubs[s]
        wrench = narrow_wrench(acting + seen.pushing)
        held, power = hub_held(counted(now.step, mine.step), before, seen, hub, wrench, seen.turning)
        off = off_home(before, hub)
        shared.mount_sums[s] = add_mount(shared.mount_sums[s], off, seen.velocity, hub, held, power, now.weight)
        if now.flags & ENDS != 0:
            b = ensemble.drives[mine.variant].first_body + s
            whole_body = with_hub(BodyState(), before, hub)
            whole_body.speed = wp.float64(seen.speed)
            whole_body.velocity = wp.vec2d(wp.float64(seen.velocity[0]), wp.float64(seen.velocity[1]))
            heading = wp.vec2d(wp.float64(before.cosine.high), wp.float64(before.sine.high))
            energy = mounted_energy(whole_body, heading, ensemble.mounts[b])
            tallies.body[b] = add_energy(tallies.body[b], now.flags & START != 0, energy)

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
        """As `observe_sprocket`, of a sprocket that is moved in pairs of float32."""
        s = mine.sprocket
        spin = shared.spins[s]
        time = float(now.step) * mine.step.high
        load = load_moment_at_speed(time, seen.load, before.speed.high, seen.speed, spin)
        mounted = int(0)
        if wp.static(moving):
            mounted = shared.hubs[s].active
            if mounted != 0:
                seen.turning[2] = load
                observe_hub(ensemble, tallies, shared, mine, now, seen, acting, before)
        if now.flags & ENDS != 0 and spin.prescribed == 0 and mounted == 0:
            at = ensemble.drives[mine.variant].first_body + s
            energy = wp.float64(0.5 * seen.speed * seen.speed / spin.inverse_inertia)
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)
        shared.sprocket_sums[s] = add_powers(shared.sprocket_sums[s], seen.speed, acting[0], load, now.weight)
        if now.watched != 0:
            shared.sprocket_sums[s] = add_speed(shared.sprocket_sums[s], seen.speed, now.watch_weight)

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
                off = body.center - mount.home
                shared.mount_sums[s] = add_mount(shared.mount_sums[s], off, body.velocity, mount, held, power, weight)
        if now.flags & ENDS != 0:
            at = ensemble.drives[mine.variant].first_body + s
            energy = body_energy(body, motion, mount)
            tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)
        shared.sprocket_sums[s] = add_powers(shared.sprocket_sums[s], body.speed, wrench.moment, load, weight)
        if now.watched != 0:
            weight = wp.float64(now.watch_weight)
            shared.sprocket_sums[s] = add_speed(shared.sprocket_sums[s], body.speed, weight)

    return ObserveFunctions(
        start_extremes=start_extremes,
        end_extremes=end_extremes,
        watch=watch,
        rates_of=rates_of,
        set_rates=set_rates,
        with_rates=with_rates,
        flush=flush,
        add_link=add_link,
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


@wp.func
def contact_sums(tallies: Tallies, at: int):
    """The sums of one roller's contacts with one partner."""
    found = ContactSums()
    found.force_max = tallies.force_max[at]
    found.impacts = tallies.impacts[at]
    found.contacts = tallies.contacts[at]
    found.missed = tallies.missed[at]
    found.impulse = tallies.impulse[at]
    found.dissipated = tallies.dissipated[at]
    found.friction = tallies.friction[at]
    return found


@wp.kernel(enable_backward=False)
def collect(drives: wp.array[Drive], tallies: Tallies, sums: Sums):
    """Adds up one variant's tallies, roller by roller in order: a thread a variant."""
    variant = wp.tid()
    drive = drives[variant]
    n = drive.rollers
    chain = sums.chain[variant]
    samples = wp.int64(0)
    for c in range(drive.sprockets + 1):
        strand = LinkTally()
        for i in range(n):
            tally = tallies.link[drive.first_tally + c * n + i]
            strand = merge_tension(strand, tally)
            strand.samples = strand.samples + tally.samples
        chain = merge_tension(chain, strand)
        samples = samples + strand.samples
        if c < drive.sprockets:
            mine = merge_tension(sums.strand[drive.first_sprocket + c], strand)
            mine.links = mine.links + strand.samples
            chain = merge_extremes(chain, mine.tension_min, mine.tension_max)
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
            total = merge_contact(total, contact_sums(tallies, memory + i))
        sums.contact[at] = total
        memory = memory + n
