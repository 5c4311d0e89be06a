"""What one thread a variant takes for statistics every `look_every` steps: tensions by size, slips, notes of sums."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..batches import NOTES, notes_due
from ..rows import accessors
from ..slip import follow_slip, mid_wrap
from ..structs import Drive, types
from ..sum_structs import ChainNote, StrandNote, Sums
from ..sums import after
from ..tension_bins import BINS, bins_per_force, count_tension
from .rollers import rows


@dataclass(frozen=True)
class Statistics:
    """What takes one variant's statistics."""

    look: wp.Function
    note: wp.Function


@cache
def statistics(Real: type, capacity: int) -> Statistics:
    """The function that takes one variant's statistics, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    TENSION, STRAND = rows(capacity).tension, rows(capacity).strand
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row

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
    def place_links(state: kinds.State, drive: Drive, w: wp.array[Real]):
        """Which strand of the drive every link is on; the number of strands where it is on none."""
        n = drive.rollers
        for j in range(n):
            store_row(w, STRAND + j, Real(drive.sprockets))
        for s in range(drive.sprockets):
            strand = state.strands[drive.first_sprocket + s]
            link = strand.first_link
            for _ in range(strand.links):
                store_row(w, STRAND + link, Real(s))
                link = after(link, n)

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
        place_links(state, drive, w)
        per_force = bins_per_force(drive.tension_scale)
        for j in range(n):
            at = (first + variant + int(load_row(w, STRAND + j))) * BINS
            count_tension(sums.tension_counts, at, load_row(w, TENSION + j), per_force)
        for s in range(drive.sprockets):
            before = state.strands[first + wp.where(s > 0, s, drive.sprockets) - 1]
            roller = mid_wrap(before, state.strands[first + s], n)
            seat = state.seat[drive.first_contact + s * n + roller]
            sign = ensemble.motions[drive.first_body + s].sign
            teeth = ensemble.sprockets[first + s].teeth
            sums.slip[first + s] = follow_slip(sums.slip[first + s], roller, seat, teeth, sign, n)

    return Statistics(look=look, note=note)
