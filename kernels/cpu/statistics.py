"""What one thread a variant looks at every `STRAND_EVERY` steps: tensions by size, slips, notes of sums."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..batches import NOTES, notes_due
from ..rows import accessors
from ..slip import follow_slip, mid_wrap
from ..structs import Drive, Strand, types
from ..sum_structs import ChainNote, StrandNote, Sums
from ..tension_bins import BINS, bins_per_force, count_tension
from .rollers import rows


@wp.func
def strand_of(strands: wp.array[Strand], first: int, count: int, link: int, n: int):
    """Which of `count` strands from `first` on a link is on; `count` where it is on none."""
    found = count
    for s in range(count):
        place = link - strands[first + s].first_link
        if place < 0:
            place = place + n
        if place < strands[first + s].links:
            found = s
    return found


@dataclass(frozen=True)
class Statistics:
    """What takes one variant's statistics."""

    look: wp.Function
    note: wp.Function


@cache
def statistics(Real: type, capacity: int) -> Statistics:
    """The function that takes one variant's statistics, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    TENSION = rows(capacity).tension
    load_row = accessors(Real).load_row

    @wp.func
    def note(sums: Sums, variant: int, drive: Drive, step: int):
        """Notes the sums at the ends of batches, before step `step` is added."""
        first, end = notes_due(drive, step)
        for k in range(first, end):
            of_chain = ChainNote()
            of_chain.tension = sums.chain[variant].tension
            of_chain.samples = sums.chain[variant].samples
            sums.chain_notes[variant * NOTES + k] = of_chain
            for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
                of_strand = StrandNote()
                of_strand.links = sums.strand[i].links
                of_strand.tension = sums.strand[i].tension
                of_strand.samples = sums.strand[i].samples
                of_strand.displacement = sums.strand[i].displacement
                sums.strand_notes[i * NOTES + k] = of_strand
                sums.sprocket_notes[i * NOTES + k] = sums.sprocket[i]
                sums.mount_notes[i * NOTES + k] = sums.mount[i]

    @wp.func
    def look(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        sums: Sums,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
    ):
        """Counts tensions and follows slips."""
        n = drive.rollers
        first = drive.first_sprocket
        per_force = bins_per_force(drive.tension_scale)
        for j in range(n):
            category = strand_of(state.strands, first, drive.sprockets, j, n)
            at = (first + variant + category) * BINS
            count_tension(sums.tension_counts, at, load_row(w, TENSION + j), per_force)
        for s in range(drive.sprockets):
            before = state.strands[first + wp.where(s > 0, s, drive.sprockets) - 1]
            roller = mid_wrap(before, state.strands[first + s], n)
            seat = state.seat[drive.first_contact + s * n + roller]
            sign = ensemble.motions[drive.first_body + s].sign
            teeth = ensemble.sprockets[first + s].teeth
            sums.slip[first + s] = follow_slip(sums.slip[first + s], roller, seat, teeth, sign, n)

    return Statistics(look=look, note=note)
