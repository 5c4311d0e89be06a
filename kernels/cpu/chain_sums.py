"""Sums over one variant's chain on the CPU, from links' tallies and samples of tensions, mid-strands, slips.

Tallies are merged every `MERGE_EVERY` steps, samples taken every `sample_interval`.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..statistics import BINS, NOTES, bins_per_force, count_tension, follow_slip, mid_wrap_roller, notes_due
from ..structs import Drive, MountNote, Note, SprocketNote, Sums, types
from ..sums import add_displacement, is_sample_step, next_index, note_mount, note_sprocket, strand_follower
from .link_tallies import link_tally_functions
from .rollers import rows


@dataclass(frozen=True)
class ChainSumFunctions:
    """CPU chain sum functions."""

    merge_tallies: wp.Function
    merge_and_sample: wp.Function


@cache
def chain_sum_functions(Real: type, capacity: int) -> ChainSumFunctions:
    """CPU chain sum functions."""
    kinds, follow = types(Real), strand_follower(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    link_tallies = link_tally_functions(Real, capacity)
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def note_sums(sums: Sums, variant: int, drive: Drive, step: int):
        """Notes the chain's sums of batches that end before `step`, on the CPU."""
        first, end = notes_due(drive, step)
        for k in range(first, end):
            of_chain = Note()
            of_chain.tension = sums.chain[variant].tension
            of_chain.samples = sums.chain[variant].samples
            of_chain.links = of_chain.samples * wp.int64(drive.rollers)
            sums.chain_notes[variant * NOTES + k] = of_chain
            for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
                of_strand = Note()
                of_strand.links = sums.strand[i].links
                of_strand.tension = sums.strand[i].tension
                of_strand.samples = sums.strand[i].samples
                of_strand.displacement = sums.strand[i].displacement
                sums.strand_notes[i * NOTES + k] = of_strand
                sums.sprocket_notes[i * NOTES + k] = note_sprocket(SprocketNote(), sums.sprocket[i])
                sums.mount_notes[i * NOTES + k] = note_mount(MountNote(), sums.mount[i])

    @wp.func
    def find_strands_of_links(state: State, drive: Drive, w: wp.array[Real]):
        """Sets each link's strand in its row; the number of strands for none."""
        n = drive.rollers
        for j in range(n):
            access.store(w, row.strand + j, Real(drive.sprockets))
        for s in range(drive.sprockets):
            strand = state.strands[drive.first_sprocket + s]
            link = strand.first_link
            for _ in range(strand.links):
                access.store(w, row.strand + link, Real(s))
                link = next_index(link, n)

    @wp.func
    def add_statistics(ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real]):
        """Adds a sample's tensions in rows to histograms, and the chain's slips."""
        n = drive.rollers
        first = drive.first_sprocket
        find_strands_of_links(state, drive, w)
        per_force = bins_per_force(drive.tension_scale)
        for j in range(n):
            at = (first + variant + int(access.load(w, row.strand + j))) * BINS
            if j + 1 != ensemble.chains[variant].absent:
                count_tension(sums.tension_counts, at, access.load(w, row.tension + j), per_force)
        for s in range(drive.sprockets):
            before = state.strands[first + wp.where(s > 0, s, drive.sprockets) - 1]
            roller = mid_wrap_roller(before, state.strands[first + s], n)
            seat = state.seat[drive.first_contact + s * drive.points * n + roller]
            sign = ensemble.motions[drive.first_body + s].sign
            teeth = ensemble.sprockets[first + s].teeth
            sums.slip[first + s] = follow_slip(sums.slip[first + s], roller, seat, teeth, sign, n)

    @wp.func
    def merge_tallies(ensemble: Ensemble, state: State, sums: Sums, variant: int, w: wp.array[Real]):
        """Merges CPU rows of links' tallies into the window's sums; clears them."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        n = drive.rollers
        sums.chain[variant] = link_tallies.merge_links(w, n, chain, sums.chain[variant], drive.step)
        if chain.joint.inertia > Real(0.0):
            sums.chain[variant].friction = link_tallies.merge_friction(w, n, sums.chain[variant].friction, drive.step)
        for s in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            sums.strand[s] = link_tallies.merge_strand_links(w, n, state.strands[s], sums.strand[s])
        link_tallies.clear(w, n)

    @wp.func
    def sample_chain(
        ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real], step: int
    ):
        """Updates strands on the CPU; adds a sample's tensions and mid-strand displacements to the sums."""
        n = drive.rollers
        if step > drive.window_start:
            note_sums(sums, variant, drive, step)
        for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            state.strands[i] = follow(w, row.x, row.y, n, state.strands[i], step == drive.window_start)
        add_statistics(ensemble, state, sums, variant, drive, w)
        sums.chain[variant] = link_tallies.add_tensions(w, n, sums.chain[variant])
        for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            strand = state.strands[i]
            strand_sums = link_tallies.add_strand_tensions(w, n, strand, sums.strand[i])
            sums.strand[i] = add_displacement(strand_sums, link_tallies.mid_displacement(w, n, strand))

    @wp.func(inline=False)
    def merge_and_sample(
        ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real], step: int
    ):
        """Merges tallies of and samples the chain before `step`, where due."""
        if step > drive.window_start:
            merge_tallies(ensemble, state, sums, variant, w)
        if is_sample_step(drive, step):
            sample_chain(ensemble, state, sums, variant, drive, w, step)

    return ChainSumFunctions(merge_tallies=merge_tallies, merge_and_sample=merge_and_sample)
