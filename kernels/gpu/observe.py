"""Observation of an evaluated step by a block's threads: sums of the window, and the energy balance.

Every step a thread adds up the squared rates of its own links and holds their tensions
against the extremes of the strands that they are on, which hardly ever change. Looks add tensions to tallies of each
link and strand. One thread keeps the sums of a sprocket and its strand. `collect` makes one row a variant of it.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..integrate import leapfrog_lag
from ..native import by_device, row_access
from ..number import leading
from ..physics.body import (
    arm_dissipation,
    arm_energy,
    arm_own_moment,
    body_accelerations,
    body_energy,
    heading_of,
    holding_force_and_power,
    late_power,
    pivot_power,
    speed_as_float64,
)
from ..physics.link import link_spring, roller_energy
from ..physics.motion import load_moment_at_speed
from ..physics.mount import CARRIED
from ..physics.train import own_body_energy
from ..physics.valve import cam_energy
from ..structs import Drive, LinkTally, RollerTally, Strand, Tallies
from ..sums import (
    add_arm,
    add_displacement,
    add_energy,
    add_mount,
    add_powers,
    add_tension,
    after,
    displacement,
    following,
    merge_extremes,
)
from .bodies import body_access, body_steps
from .jointed import block_jointed
from .kind import START, WARP, BlockKind, Mine
from .rings import block_rings
from .rollers import roller_rows
from .shared_memory import ENERGY, MOMENT, STRAND_WORD, TURNED, extremes, rubbed, seen_rows, strand_bits, strand_words
from .sync import add_to_link, add_to_roller, after_turn, lanes, lanes_where, lowest_bit


@cache
def block_strands(kind: BlockKind) -> SimpleNamespace:
    """The functions that find the strand that each link of one variant on a block is on."""
    threads, rollers_per_thread, sprockets = kind.shape.threads, kind.shape.rollers_per_thread, kind.parts.sprockets
    kinds = kind.types
    Shared = kinds.Shared
    bits = strand_bits(kind)
    together = STRAND_WORD // bits
    rings, several = block_rings(kind), kind.parts.rings > 1
    ring_of, span_of, partners_of = rings.ring_of, rings.span_of, rings.partners_of

    @wp.func
    def strand_under(shared: Shared, strands: wp.array[Strand], first: int, j: int, n: int):
        """Strand that link j is on; S where it is on none, or S + r of chain r, and beyond these where there is no such
        link. `first` is strand 0.
        """
        found = int(wp.static(sprockets) + ring_of(shared, j))
        begin, count = span_of(shared, j, n)
        for s in range(wp.static(sprockets)):
            place = j - begin - strands[first + s].first_link
            if place < 0:
                place = place + count
            if place < strands[first + s].links:
                if wp.static(not several) or partners_of(shared, j, 1 << s) != 0:
                    found = s
        return wp.where(j < n, found, wp.static(sprockets + kind.parts.rings))

    @wp.func
    def find_strands(ensemble: kinds.Ensemble, state: kinds.State, shared: Shared, mine: Mine):
        """Brings up to date which strands the thread's links are on."""
        first = ensemble.drives[mine.variant].first_sprocket
        k = int(0)
        for q in range(wp.static(strand_words(kind))):
            word = wp.uint32(0)
            shift = int(0)
            while shift < wp.static(together * bits) and k < wp.static(rollers_per_thread):
                of = strand_under(shared, state.strands, first, k * wp.static(threads) + mine.thread, mine.rollers)
                word = word | (wp.uint32(of) << wp.uint32(shift))
                shift = shift + wp.static(bits)
                k = k + 1
            shared.strand_of[q * wp.static(threads) + mine.thread] = word

    @wp.func
    def strand_at(shared: Shared, i: int, k: int):
        """The strand that thread i's link k is on, as `strand_under`."""
        word = shared.strand_of[k // wp.static(together) * wp.static(threads) + i]
        shift = wp.uint32(k % wp.static(together) * wp.static(bits))
        return int((word >> shift) & wp.uint32(wp.static((1 << bits) - 1)))

    return SimpleNamespace(**locals())


@cache
def block_observing(kind: BlockKind) -> SimpleNamespace:
    """The functions that observe one variant on a block."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets, rings = kind.parts.sprockets, kind.parts.rings
    kinds, Now = kind.types, kind.types.Now
    Ensemble, Shared, Sums = kinds.Ensemble, kinds.Shared, kinds.Sums
    chain_at, span_of, strand_in = block_rings(kind).chain_at, block_rings(kind).span_of, block_rings(kind).strand_in
    vec2, of_each = kinds.vec2, wp.types.vector(rollers_per_thread, Real)
    row = roller_rows(kind)
    X, Y = row.X, row.Y
    load_row, store_row = row_access(Real).load, row_access(Real).store
    RATES, FRICTION = (wp.constant(at) for at in seen_rows(kind)[:2])
    follow, strand_at = following(Real), block_strands(kind).strand_at
    high_bits = "__double2hiint" if Real == wp.float64 else "__float_as_int"

    @wp.func_native(by_device(f"return {high_bits}(value);", "return value < 0 ? -1 : 0;"))
    def sign_bits(value: Real) -> int:
        """A negative number where `value` is negative: many are tested at once, none waits for another."""

    @wp.func
    def extremes_at(i: int, of: int):
        """Where the lowest tension on strand `of` stands for thread i's warp; the highest is the next value."""
        return i // wp.static(WARP) * wp.static(extremes(kind)) + 2 * of

    @wp.func
    def set_extremes(shared: Shared, at: int, lowest: wp.float64, highest: wp.float64):
        """Makes a pair of extremes stand at `at`."""
        store_row(shared.seen, at, Real(lowest))
        store_row(shared.seen, at + 1, Real(highest))

    @wp.func
    def start_extremes(ensemble: Ensemble, sums: Sums, shared: Shared, mine: Mine):
        """The extremes of tension so far, which one thread of each warp sets; no rates and no friction yet."""
        i = mine.thread
        none = int(wp.static(sprockets))
        if i % wp.static(WARP) == 0:
            first = ensemble.drives[mine.variant].first_sprocket
            for s in range(wp.static(sprockets)):
                strand = sums.strand[first + s]
                set_extremes(shared, extremes_at(i, s), strand.tension_min, strand.tension_max)
            for r in range(wp.static(rings)):
                chain = sums.chain[mine.variant + r]
                set_extremes(shared, extremes_at(i, none + r), chain.tension_min, chain.tension_max)
            set_extremes(shared, extremes_at(i, none + wp.static(rings)), wp.float64(-3.0e38), wp.float64(3.0e38))
        j = int(i)
        while j < wp.static(kind.shape.slots + rubbed(kind)):
            store_row(shared.seen, RATES + j, Real(0.0))
            j = j + wp.static(threads)

    @wp.func
    def extremes_of(shared: Shared, of: int):
        """Lowest and highest tension on strand `of` that any warp has seen [N]."""
        lowest = Real(3.0e38)
        highest = -Real(3.0e38)
        for w in range(wp.static(threads // WARP)):
            at = extremes_at(w * wp.static(WARP), of)
            lowest = wp.min(lowest, load_row(shared.seen, at))
            highest = wp.max(highest, load_row(shared.seen, at + 1))
        return wp.float64(lowest), wp.float64(highest)

    @wp.func
    def end_extremes(ensemble: Ensemble, sums: Sums, shared: Shared, mine: Mine):
        """The extremes of tension into the sums, by the threads that have the strands' other sums, and the first."""
        s = mine.sprocket
        if s >= 0:
            at = ensemble.drives[mine.variant].first_sprocket + s
            lowest, highest = extremes_of(shared, s)
            sums.strand[at] = merge_extremes(sums.strand[at], lowest, highest)
        if mine.thread == 0:
            for r in range(wp.static(rings)):
                lowest, highest = extremes_of(shared, wp.static(sprockets) + r)
                sums.chain[mine.variant + r] = merge_extremes(sums.chain[mine.variant + r], lowest, highest)

    @wp.func
    def widen(shared: Shared, i: int, tension: of_each):
        """Holds the tensions of thread i's links against its warp's extremes, which no other thread does just now."""
        for k in range(wp.static(rollers_per_thread)):
            at = extremes_at(i, strand_at(shared, i, k))
            if tension[k] < load_row(shared.seen, at):
                store_row(shared.seen, at, tension[k])
            if tension[k] > load_row(shared.seen, at + 1):
                store_row(shared.seen, at + 1, tension[k])

    @wp.func
    def hold_extremes(shared: Shared, i: int, tension: of_each):
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
    def add_rates(shared: Shared, i: int, rate: of_each, weight: Real):
        """Adds one step's squared rates of thread i's links to their sums; `weight` is the time it stands for [s].

        Each link has a sum of its own, so that what comes out is the same however many links a thread has.
        """
        for k in range(wp.static(rollers_per_thread)):
            at = RATES + k * wp.static(threads) + i
            store_row(shared.seen, at, load_row(shared.seen, at) + (weight * rate[k]) * rate[k])

    @wp.func
    def flush(tallies: Tallies, shared: Shared, mine: Mine):
        """Adds what the thread's links and joints have taken to their tallies."""
        j = int(mine.thread)
        while j < mine.rollers:
            taken = RollerTally()
            first, n = span_of(shared, j, mine.rollers)
            stiffness, damping = link_spring(j - first, chain_at(shared, j))
            taken.dissipated = wp.float64(damping * load_row(shared.seen, RATES + j))
            store_row(shared.seen, RATES + j, Real(0.0))
            if wp.static(kind.friction.joints):
                taken.friction = wp.float64(load_row(shared.seen, FRICTION + j))
                store_row(shared.seen, FRICTION + j, Real(0.0))
            add_to_roller(tallies.roller, mine.first + j, taken)
            j = j + wp.static(threads)

    @wp.func
    def add_link(tallies: Tallies, drive: Drive, shared: Shared, j: int, n: int, tension: Real):
        """A look at link j, of n in all, whose tension goes to its tally of the strand it is on; returns that strand of
        its chain `drive`.
        """
        of = strand_in(shared, drive, j, strand_at(shared, j % wp.static(threads), j // wp.static(threads)))
        first, count = span_of(shared, j, n)
        seen = add_tension(LinkTally(), tension)
        seen.samples = wp.int64(1)
        add_to_link(tallies.link, drive.first_tally + of * count + j - first, seen)
        return of

    @wp.func
    def update_strand(state: kinds.State, shared: Shared, first: int, n: int, at: int, anew: bool):
        """Strand `at` of all brought up to date, or sought `anew`, of a chain of n rollers from `first` on."""
        state.strands[at] = follow(shared.rows, X + first, Y + first, n, state.strands[at], anew)

    @wp.func
    def add_middle(sums: Sums, shared: Shared, first: int, n: int, at: int, strand: Strand):
        """A look at the mid-strand displacement of `strand`, whose sums are at `at`, of such a chain."""
        rows = shared.rows
        a = first + strand.middle
        b = first + after(strand.middle, n)
        ax = wp.float64(load_row(rows, X + a))
        ay = wp.float64(load_row(rows, Y + a))
        value = displacement(ax, ay, wp.float64(load_row(rows, X + b)), wp.float64(load_row(rows, Y + b)), strand)
        sums.strand[at] = add_displacement(sums.strand[at], value)

    @wp.func
    def energy_of_roller(shared: Shared, j: int, n: int, v: vec2, extra: kinds.Extra):
        """Energy of roller j, of n, and elastic energy of the link after it and of its contacts [J]."""
        first, count = span_of(shared, j, n)
        position, chain = row.position(shared.rows, j), chain_at(shared, j)
        held, weight = roller_energy(position, v, extra.tension, extra.rate, j - first, chain)
        return held - weight + wp.float64(extra.energy)

    return SimpleNamespace(**locals())


@cache
def body_observing(kind: BlockKind) -> SimpleNamespace:
    """The functions that observe the body of a thread."""
    Real, sprockets, moving, paired = kind.Real, kind.parts.sprockets, kind.moving, kind.paired
    kinds, Now, steps, joints = kind.types, kind.types.Now, body_steps(kind), block_jointed(kind)
    Ensemble, Shared, Pose, Wrench = kinds.Ensemble, kinds.Shared, kinds.Pose, kinds.Wrench
    vec2, heading, of_joints = kinds.vec2, body_access(kind).heading, body_access(kind).of_joints
    of_three = wp.types.vector(3, Real)

    @wp.func
    def heading_seen(pose: Pose, seen: kinds.Instant):
        """Cosine and sine of a body's angle, at float64 anew from it."""
        if wp.static(paired):
            return heading(pose)
        else:
            return heading_of(seen)

    @wp.func
    def lag_at(mine: Mine, now: Now):
        """Time that speeds are behind the forces [s]."""
        if wp.static(kind.staged):
            return Real(0.0)
        else:
            return leapfrog_lag(now.step, Real(mine.h))

    @wp.func
    def late_on(shared: Shared, mine: Mine, now: Now, before: Pose, seen: kinds.Instant, acting: of_three):
        """`body.late_power` of the thread's body; arguments as of `observe_sprocket`."""
        wrench = kinds.Wrench()
        wrench.moment = acting[0]
        carried = bool(True)  # or fixed
        if wp.static(moving):
            wrench.force = vec2(acting[1], acting[2])
            carried = shared.mounts[mine.body].moves == CARRIED
        return late_power(wrench, seen, before, lag_at(mine, now), carried)

    @wp.func
    def observe_sprocket(
        ensemble: Ensemble,
        shared: Shared,
        mine: Mine,
        now: Now,
        before: Pose,
        seen: kinds.Instant,
        acting: of_three,
        whole: Wrench,
    ):
        """One step of the thread's sprocket for the sums of the window.

        Args:
            before: where the body was.
            seen: the body with its rates at the step's instant.
            acting: the chain's moment [N m] and force (x, y) [N] on it.
            whole: the chain's and its tensioners' wrench on it, with its load at the rates of `before`.
        """
        s = mine.sprocket
        speed, motion = leading(before.speed), shared.motions[s]
        whole.load = load_moment_at_speed(steps.rounded_time(mine, now), whole.load, speed, seen.speed, motion)
        if wp.static(moving):
            mount = shared.mounts[s]
            if mount.active != 0:
                off, to = steps.off(before, mount), heading_seen(before, seen)
                by = steps.with_bearing(whole)
                rates = body_accelerations(steps.time_of(mine, now), off, seen, to, by, motion, mount, ensemble)
                held, power = holding_force_and_power(off, seen, to, by, rates, motion, mount)
                sums = shared.mount_sums[s]
                shared.mount_sums[s] = add_mount(sums, off, seen.velocity, mount, held, power, now.weight)
        late = late_on(shared, mine, now, before, seen, acting)
        shared.sprocket_sums[s] = add_powers(
            shared.sprocket_sums[s], seen.speed, acting[0], whole.load, late, now.weight
        )

    @wp.func
    def leading_power(
        ensemble: Ensemble, shared: Shared, mine: Mine, now: Now, before: Pose, seen: kinds.Instant, whole: Wrench
    ):
        """Power [W] of what leads the pivot of the thread's arm; arguments as of `observe_sprocket`."""
        led = Real(0.0)
        if wp.static(moving):
            arm, motion = ensemble.arms[ensemble.drives[mine.variant].first_arm + mine.arm], shared.motions[mine.body]
            mount = steps.mount_of(shared, mine.body)
            if mount.active != 0:
                off, to = steps.off(before, mount), heading_seen(before, seen)
                whole.load = arm_own_moment(seen, to, arm)
                if wp.static(kind.parts.jointed):
                    whole.load = whole.load + of_joints(shared, mine.arm, MOMENT)
                acting, time = steps.with_bearing(whole), steps.time_of(mine, now)
                rates = body_accelerations(time, off, seen, to, acting, motion, mount, ensemble)
                if wp.static(kind.parts.jointed):
                    acting, rates = joints.with_turning(ensemble, shared, mine, acting, rates)
                held, power = holding_force_and_power(off, seen, to, acting, rates, motion, mount)
                led = pivot_power(power, seen, arm)
        return led

    @wp.func
    def as_its_spring(shared: Shared, mine: Mine, seen: kinds.Instant):
        """The thread's arm, which is `seen` there, as its spring sees it turn."""
        if wp.static(kind.parts.jointed):
            seen.angle = of_joints(shared, mine.arm, TURNED)
            seen.speed = of_joints(shared, mine.arm, TURNED + 1)
        return seen

    @wp.func
    def observe_arm(
        ensemble: Ensemble,
        sums: kinds.Sums,
        shared: Shared,
        mine: Mine,
        now: Now,
        seen: kinds.Instant,
        moment: Real,
        powers: vec2,
    ):
        """One step of the thread's arm for the sums of the window; `moment` is the chain's on it [N m], `powers` those
        of what leads its pivot and of `body.late_power` [W].
        """
        at = ensemble.drives[mine.variant].first_arm + mine.arm
        power = arm_dissipation(as_its_spring(shared, mine, seen), ensemble.arms[at])
        sums.arm[at] = add_arm(sums.arm[at], seen, moment, power, powers[0], powers[1], now.weight)

    @wp.func
    def observe_energy(
        ensemble: Ensemble, tallies: Tallies, shared: Shared, mine: Mine, now: Now, before: Pose, seen: kinds.Instant
    ):
        """Adds the energy of the thread's body to its tally, at the window's ends."""
        drive = ensemble.drives[mine.variant]
        motion, mount = shared.motions[mine.body], steps.mount_of(shared, mine.body)
        to, at = heading_seen(before, seen), ensemble.drives[mine.row].first_body + mine.number
        energy = body_energy(steps.off(before, mount), seen, to, motion, mount)
        if wp.static(kind.parts.arms > 0):
            if mine.arm >= 0:
                if wp.static(kind.parts.jointed):
                    energy = energy + wp.float64(of_joints(shared, mine.arm, ENERGY))
                turned = as_its_spring(shared, mine, seen)
                energy = arm_energy(energy, turned, to, ensemble.arms[drive.first_arm + mine.arm])
        if wp.static(kind.parts.tied > 0):
            if mine.arm < 0:
                energy = own_body_energy(energy, speed_as_float64(seen), motion)
                if wp.static(kind.parts.valves > 0):
                    energy = energy + wp.float64(cam_energy(seen.speed, shared.cams[mine.body], motion))
        tallies.body[at] = add_energy(tallies.body[at], now.flags & START != 0, energy)

    return SimpleNamespace(**locals())
