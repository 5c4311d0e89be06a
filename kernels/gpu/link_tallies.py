"""Tallies of a block's links and joints: squared rates, friction, tensions by strand, and extremes of tension."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import code_by_device, row_access
from ..physics.link import link_spring, roller_energy
from ..structs import Drive, LinkTally, RollerTally, Strand, Tallies
from ..sums import add_displacement, add_tension, merge_extremes, mid_strand_displacement, next_index, strand_follower
from .block_kinds import WARP, BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .rollers import roller_functions, roller_rows
from .shared_memory import extreme_values, joint_work_values, tally_places
from .strands import strand_functions
from .sync import add_to_link_tally, add_to_roller_tally, end_turn, lanes_with_flag, lowest_bit, warp_lanes


@dataclass(frozen=True)
class LinkTallyFunctions:
    """Link tally functions of a block."""

    begin_extremes: wp.Function
    merge_extremes_of_strands: wp.Function
    widen_extremes: wp.Function
    add_rates: wp.Function
    merge_tallies: wp.Function
    add_link_tension: wp.Function
    update_strand: wp.Function
    add_mid_displacement: wp.Function
    energy_of_roller: wp.Function


@cache
def link_tally_functions(kind: BlockKind) -> LinkTallyFunctions:
    """Link tally functions of block kernels."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    sprockets, chain_count = kind.parts.sprockets, kind.parts.chains
    kinds = kind.types
    Ensemble, Shared, Sums = kinds.Ensemble, kinds.Shared, kinds.Sums
    access = row_access(Real)
    strands = strand_functions(kind)
    chains = chain_functions(kind)
    rollers, row = roller_functions(kind), roller_rows(kind)
    vec2, of_each = kinds.vec2, wp.types.vector(rollers_per_thread, Real)
    summed_values = kind.shape.slots + joint_work_values(kind)
    RATES, FRICTION = (wp.constant(at) for at in tally_places(kind)[:2])
    follow = strand_follower(Real)
    high_bits = "__double2hiint" if Real == wp.float64 else "__float_as_int"

    @wp.func_native(code_by_device(f"return {high_bits}(value);", "return value < 0 ? -1 : 0;"))
    def sign_bits(value: Real) -> int:
        """Negative whole number where `value` is negative, to compare a block's tensions at once."""

    @wp.func
    def extremes_index(i: int, of: int):
        """Index of the lowest tension on strand `of` in thread i's warp; the highest is the next value."""
        return i // WARP * wp.static(extreme_values(kind)) + 2 * of

    @wp.func
    def set_extremes(shared: Shared, at: int, lowest: wp.float64, highest: wp.float64):
        """Stores a pair of extremes of tension of a warp at `at`."""
        access.store(shared.link_sums, at, Real(lowest))
        access.store(shared.link_sums, at + 1, Real(highest))

    @wp.func
    def begin_extremes(ensemble: Ensemble, sums: Sums, shared: Shared, mine: ThreadParts):
        """Sets the extremes of tension so far, one thread of each warp, and zero rates and friction."""
        i = mine.thread
        none = int(sprockets)
        if i % WARP == 0:
            first = ensemble.drives[mine.variant].first_sprocket
            for s in range(sprockets):
                strand = sums.strand[first + s]
                set_extremes(shared, extremes_index(i, s), strand.tension_min, strand.tension_max)
            for r in range(chain_count):
                chain = sums.chain[mine.variant + r]
                set_extremes(shared, extremes_index(i, none + r), chain.tension_min, chain.tension_max)
            set_extremes(shared, extremes_index(i, none + chain_count), wp.float64(-3.0e38), wp.float64(3.0e38))
        j = int(i)
        while j < summed_values:
            access.store(shared.link_sums, RATES + j, Real(0.0))
            j = j + threads

    @wp.func
    def strand_extremes(shared: Shared, of: int):
        """Lowest and highest tension [N] on strand `of` over all warps."""
        lowest = Real(3.0e38)
        highest = -Real(3.0e38)
        for w in range(wp.static(threads // WARP)):
            at = extremes_index(w * WARP, of)
            lowest = wp.min(lowest, access.load(shared.link_sums, at))
            highest = wp.max(highest, access.load(shared.link_sums, at + 1))
        return wp.float64(lowest), wp.float64(highest)

    @wp.func
    def merge_extremes_of_strands(ensemble: Ensemble, sums: Sums, shared: Shared, mine: ThreadParts):
        """Merges extremes of tension into the sums, by threads of the strands' sprockets and the first."""
        s = mine.sprocket
        if s >= 0:
            at = ensemble.drives[mine.variant].first_sprocket + s
            lowest, highest = strand_extremes(shared, s)
            if lowest <= highest:  # else it has had no links
                sums.strand[at] = merge_extremes(sums.strand[at], lowest, highest)
        if mine.thread == 0:
            for r in range(chain_count):
                lowest, highest = strand_extremes(shared, sprockets + r)
                sums.chain[mine.variant + r] = merge_extremes(sums.chain[mine.variant + r], lowest, highest)

    @wp.func
    def widen_extremes_of_warp(shared: Shared, i: int, tension: of_each):
        """Widens the warp's extremes of tension by those of thread i's links, while no other thread does."""
        for k in range(rollers_per_thread):
            at = extremes_index(i, strands.stored_strand(shared, i, k))
            if tension[k] < access.load(shared.link_sums, at):
                access.store(shared.link_sums, at, tension[k])
            if tension[k] > access.load(shared.link_sums, at + 1):
                access.store(shared.link_sums, at + 1, tension[k])

    @wp.func
    def widen_extremes(shared: Shared, i: int, tension: of_each):
        """Widens extremes of tension by links of thread i's warp, whose threads take turns."""
        beyond = int(0)
        for k in range(rollers_per_thread):
            at = extremes_index(i, strands.stored_strand(shared, i, k))
            beyond = beyond | sign_bits(tension[k] - access.load(shared.link_sums, at))
            beyond = beyond | sign_bits(access.load(shared.link_sums, at + 1) - tension[k])
        waiting = lanes_with_flag(wp.where(beyond < 0, 1, 0))
        while waiting != 0:
            if i % warp_lanes() == lowest_bit(waiting):
                widen_extremes_of_warp(shared, i, tension)
            waiting = waiting & (waiting - 1)
            end_turn()

    @wp.func
    def add_rates(shared: Shared, i: int, rate: of_each, weight: Real):
        """Adds a step's squared rates of thread i's links to their sums; `weight` is its time [s]."""
        for k in range(rollers_per_thread):
            at = RATES + k * threads + i
            access.store(shared.link_sums, at, access.load(shared.link_sums, at) + (weight * rate[k]) * rate[k])

    @wp.func
    def merge_tallies(tallies: Tallies, shared: Shared, mine: ThreadParts):
        """Adds the sums of the thread's links and joints to their tallies."""
        j = int(mine.thread)
        while j < mine.rollers:
            taken = RollerTally()
            first, n = chains.chain_span(shared, j, mine.rollers)
            stiffness, damping = link_spring(j - first, chains.chain_at(shared, j))
            taken.dissipated = wp.float64(damping * access.load(shared.link_sums, RATES + j))
            access.store(shared.link_sums, RATES + j, Real(0.0))
            if wp.static(kind.friction.joints):
                taken.friction = wp.float64(access.load(shared.link_sums, FRICTION + j))
                access.store(shared.link_sums, FRICTION + j, Real(0.0))
            add_to_roller_tally(tallies.roller, mine.first_roller + j, taken)
            j = j + threads

    @wp.func
    def add_link_tension(tallies: Tallies, drive: Drive, shared: Shared, j: int, n: int, tension: Real):
        """Adds the tension of a block's link j, of n, to its strand's tally; returns that strand of its chain."""
        of = chains.strand_in_chain(shared, drive, j, strands.stored_strand(shared, j % threads, j // threads))
        first, count = chains.chain_span(shared, j, n)
        seen = add_tension(LinkTally(), tension)
        seen.samples = wp.int64(1)
        add_to_link_tally(tallies.link, drive.first_tally + of * count + j - first, seen)
        return of

    @wp.func
    def update_strand(state: kinds.State, shared: Shared, first: int, n: int, at: int, anew: bool):
        """Updates a block's strand `at` of all, or seeks it `anew`, on a chain of n rollers from `first` on."""
        state.strands[at] = follow(shared.rows, row.x + first, row.y + first, n, state.strands[at], anew)

    @wp.func
    def add_mid_displacement(sums: Sums, shared: Shared, first: int, n: int, at: int, strand: Strand):
        """Adds the mid-strand displacement of a block's `strand`, of n rollers from `first` on, to the sums at `at`."""
        rows = shared.rows
        a = first + strand.middle
        b = first + next_index(strand.middle, n)
        ax = wp.float64(access.load(rows, row.x + a))
        ay = wp.float64(access.load(rows, row.y + a))
        value = mid_strand_displacement(
            ax, ay, wp.float64(access.load(rows, row.x + b)), wp.float64(access.load(rows, row.y + b)), strand
        )
        sums.strand[at] = add_displacement(sums.strand[at], value)

    @wp.func
    def energy_of_roller(shared: Shared, j: int, n: int, v: vec2, extra: kinds.Extra):
        """Energy [J] of a block's roller j, of n, and elastic energy of its next link and its contacts."""
        first, count = chains.chain_span(shared, j, n)
        position, chain = rollers.position(shared.rows, j), chains.chain_at(shared, j)
        held, weight = roller_energy(position, v, extra.tension, extra.rate, j - first, chain)
        return held - weight + wp.float64(extra.energy)

    return LinkTallyFunctions(
        begin_extremes=begin_extremes,
        merge_extremes_of_strands=merge_extremes_of_strands,
        widen_extremes=widen_extremes,
        add_rates=add_rates,
        merge_tallies=merge_tallies,
        add_link_tension=add_link_tension,
        update_strand=update_strand,
        add_mid_displacement=add_mid_displacement,
        energy_of_roller=energy_of_roller,
    )
