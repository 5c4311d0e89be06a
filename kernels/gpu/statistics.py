"""What a block looks at every `look_every` steps: tensions by size, mid-strand, slips, notes of sums."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..batches import NOTES, notes_due
from ..number import whole
from ..slip import follow_slip, mid_wrap
from ..structs import Drive, types
from ..sum_structs import ChainNote, StrandNote, Sums, Tallies
from ..tension_bins import BINS, bins_per_force, count_tension
from .kind import BlockKind, Mine
from .link_forces import link_forces
from .observe import block_observing
from .roller_rows import roller_rows
from .shared_memory import view


@dataclass(frozen=True)
class StatisticsFunctions:
    """What takes a block's statistics."""

    look: wp.Function
    note: wp.Function


@wp.func
def seen_on(drive: Drive, tallies: Tallies, category: int):
    """Tensions that links have seen on a strand so far, link by link in order, whatever the block's threads."""
    note = StrandNote()
    first = drive.first_tally + category * drive.rollers
    for at in range(first, first + drive.rollers):
        note.links = note.links + tallies.link[at].samples
        note.tension = note.tension + tallies.link[at].tension
    return note


@cache
def block_statistics(kind: BlockKind) -> StatisticsFunctions:
    """The functions that take one variant's statistics on a block."""
    Real, threads, sprockets, moving = kind.Real, kind.threads, kind.sprockets, kind.moving
    kinds, row, observe = types(Real), roller_rows(kind), block_observing(kind)
    links, lengths_of = link_forces(kind), view(Real)
    link_of, length_of = links.link_of, links.length_of

    @wp.func
    def look(
        ensemble: kinds.Ensemble, state: kinds.State, sums: Sums, tallies: Tallies, shared: kinds.Shared, mine: Mine
    ):
        """Adds up and counts tensions of the thread's links, and follows its strand's middle and sprocket's slips."""
        n = mine.rollers
        drive = ensemble.drives[mine.variant]
        per_force = bins_per_force(drive.tension_scale)
        lengths = lengths_of(ensemble.lengths, mine.first, wp.static(kind.slots))
        j = int(mine.thread)
        while j < n:
            tension, rate, force = link_of(shared, j, n, length_of(shared, lengths, j))
            strand = observe.add_link(tallies, drive, shared, j, tension)
            at = (drive.first_sprocket + mine.variant + strand) * BINS
            count_tension(sums.tension_counts, at, tension, per_force)
            j = j + wp.static(threads)
        s = mine.sprocket
        if s >= 0:
            first = drive.first_sprocket
            observe.add_middle(sums, shared, n, first + s, state.strands[first + s])
            before = state.strands[first + wp.where(s > 0, s, wp.static(sprockets)) - 1]
            roller = mid_wrap(before, state.strands[first + s], n)
            seat = state.seat[mine.memory + s * n + roller]
            if wp.static(kind.paired):
                sign = wp.float64(shared.spins[s].sign)
            else:
                sign = shared.motions[s].sign
            slip = sums.slip[first + s]
            sums.slip[first + s] = follow_slip(slip, roller, seat, shared.teeth[s].teeth, sign, n)

    @wp.func
    def note(ensemble: kinds.Ensemble, tallies: Tallies, sums: Sums, shared: kinds.Shared, mine: Mine, step: int):
        """Notes the sums at the ends of batches; links on no strand are noted as the chain's, `collect` adds the rest.

        All threads must be past the look before.
        """
        drive = ensemble.drives[mine.variant]
        first, end = notes_due(drive, step)
        if end > first:
            if mine.thread == 0:
                loose = seen_on(drive, tallies, wp.static(sprockets))
                for k in range(first, end):
                    of_chain = ChainNote()
                    of_chain.tension = loose.tension
                    of_chain.samples = loose.links
                    sums.chain_notes[mine.variant * NOTES + k] = of_chain
            s = mine.sprocket
            if s >= 0:
                of_strand = seen_on(drive, tallies, s)
                of_strand.samples = sums.strand[drive.first_sprocket + s].samples
                of_strand.displacement = sums.strand[drive.first_sprocket + s].displacement
                of_sprocket = whole(shared.sprocket_sums[s])
                for k in range(first, end):
                    at = (drive.first_sprocket + s) * NOTES + k
                    sums.strand_notes[at] = of_strand
                    sums.sprocket_notes[at] = of_sprocket
                    if wp.static(moving):
                        sums.mount_notes[at] = whole(shared.mount_sums[s])

    return StatisticsFunctions(look=look, note=note)
