"""Samples of a block every `sample_interval` steps: tensions by size, mid-strand displacement, slips, notes of sums."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..modules import own_module, without_contraction
from ..statistics import BINS, NOTES, bins_per_force, count_tension, follow_slip, mid_wrap_roller, notes_due
from ..structs import ContactSums, Drive, LinkTally, Note, Tallies, types
from ..sums import merge_contact, merge_extremes, merge_roller, merge_tension, note_mount, note_sprocket
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .link_tallies import link_tally_functions
from .links import link_functions
from .shared_memory import array_view


@wp.func
def strand_note(drive: Drive, tallies: Tallies, category: int):
    """Note of a block's link tensions on a strand so far, added in the links' order."""
    note = Note()
    first = drive.first_tally + category * drive.rollers
    for at in range(first, first + drive.rollers):
        note.links = note.links + tallies.link[at].samples
        note.tension = note.tension + tallies.link[at].tension
    return note


@dataclass(frozen=True)
class StatisticsFunctions:
    """Statistics functions of a block."""

    sample_chain: wp.Function
    note_sums: wp.Function


@cache
def statistics_functions(kind: BlockKind) -> StatisticsFunctions:
    """Statistics functions of block kernels."""
    Real, threads = kind.Real, kind.shape.threads
    links = link_functions(kind)
    chains = chain_functions(kind)
    link_tallies = link_tally_functions(kind)
    kinds = kind.types
    Ensemble, Shared, Out = kinds.Ensemble, kinds.Shared, kinds.Out
    SprocketNote, MountNote = kinds.SprocketNote, kinds.MountNote
    lengths_of = array_view(Real)

    @wp.func
    def sample_chain(ensemble: Ensemble, state: kinds.State, out: Out, shared: Shared, mine: ThreadParts):
        """Samples tensions of the thread's links, and its strand's middle and sprocket's slips."""
        n = mine.rollers
        lengths = lengths_of(ensemble.lengths, mine.first_roller, wp.static(kind.shape.slots))
        j = int(mine.thread)
        while j < n:
            tension, rate, force = links.link_load(shared, j, n, links.link_length(shared, lengths, j))
            row = chains.drive_row(shared, mine, j)
            drive = ensemble.drives[row]
            strand = link_tallies.add_link_tension(out.tallies, drive, shared, j, n, tension)
            at = (drive.first_sprocket + row + strand) * BINS
            first, count = chains.chain_span(shared, j, n)
            if j - first + 1 != chains.chain_at(shared, j).absent:
                count_tension(out.sums.tension_counts, at, tension, bins_per_force(drive.tension_scale))
            j = j + threads
        s = mine.sprocket
        if s >= 0:
            own = ensemble.drives[mine.drive_row]
            at = own.first_sprocket + mine.body_number
            begin, count = chains.own_chain_span(shared, mine)
            link_tallies.add_mid_displacement(out.sums, shared, begin, count, at, state.strands[at])
            last = wp.where(mine.body_number > 0, mine.body_number, own.sprockets) - 1
            roller = mid_wrap_roller(state.strands[own.first_sprocket + last], state.strands[at], count)
            seat = state.seat[chains.contact_memory(shared, mine, begin + roller, s)]
            sign = wp.float64(shared.motions[s].sign)
            out.sums.slip[at] = follow_slip(out.sums.slip[at], roller, seat, shared.teeth[s].teeth, sign, count)

    @wp.func
    def note_sums(ensemble: Ensemble, out: Out, shared: Shared, mine: ThreadParts, step: int):
        """Notes a block's sums at the ends of batches; all threads must be past the last sample."""
        drive = ensemble.drives[mine.variant]
        first, end = notes_due(drive, step)
        if end > first:
            if mine.thread == 0:
                for row in range(mine.variant, mine.variant + wp.static(kind.parts.chains)):
                    loose = strand_note(ensemble.drives[row], out.tallies, ensemble.drives[row].sprockets)
                    for k in range(first, end):
                        out.sums.chain_notes[row * NOTES + k] = loose
            s = mine.sprocket
            if s >= 0:
                of_strand = strand_note(ensemble.drives[mine.drive_row], out.tallies, mine.body_number)
                of_strand.samples = out.sums.strand[drive.first_sprocket + s].samples
                of_strand.displacement = out.sums.strand[drive.first_sprocket + s].displacement
                for k in range(first, end):
                    at = (drive.first_sprocket + s) * NOTES + k
                    out.sums.strand_notes[at] = of_strand
                    out.sums.sprocket_notes[at] = note_sprocket(SprocketNote(), shared.sprocket_sums[s])
                    if wp.static(kind.moving):
                        out.sums.mount_notes[at] = note_mount(MountNote(), shared.mount_sums[s])

    return StatisticsFunctions(
        sample_chain=sample_chain,
        note_sums=note_sums,
    )


@wp.func
def chain_note(sums: Any, drive: Drive, k: int, note: Note):
    """Note k of a block's chain from that of its links on no strand and those of its strands."""
    for s in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
        note.tension = note.tension + sums.strand_notes[s * NOTES + k].tension
        note.links = note.links + sums.strand_notes[s * NOTES + k].links
    note.samples = note.links / wp.int64(drive.rollers)
    return note


@wp.func
def contact_sums_of(tallies: Tallies, at: int):
    """Sums of one roller's contacts with one partner, from a block's tallies."""
    found = ContactSums()
    found.force_max = tallies.force_max[at]
    found.impacts = tallies.impacts[at]
    found.contacts = tallies.contacts[at]
    found.missed = tallies.missed[at]
    found.impulse = tallies.impulse[at]
    found.dissipated = tallies.dissipated[at]
    found.friction = tallies.friction[at]
    return found


@cache
def tally_sum_kernel(Real: type) -> wp.Kernel:
    """Kernel that adds each variant's block tallies of a precision to its sums."""
    kinds = types(Real, blocks=True)

    @wp.kernel(enable_backward=False, module=own_module(__file__, "tally_sum", Real))
    def add_tallies(drives: wp.array[Drive], tallies: Tallies, sums: kinds.Sums):
        """Adds up a variant's block tallies, roller by roller in order: a thread a variant."""
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
            sums.chain_notes[k] = chain_note(sums, drive, k - variant * NOTES, sums.chain_notes[k])
        for i in range(n):
            chain = merge_roller(chain, tallies.roller[drive.first_roller + i])
        for b in range(drive.bodies):
            chain = merge_roller(chain, tallies.body[drive.first_body + b])
        sums.chain[variant] = chain
        memory = drive.first_contact
        for p in range(drive.sprockets + drive.guides):
            at = drive.first_sprocket + drive.first_guide + p
            total = ContactSums()
            count = wp.where(p < drive.sprockets, drive.points, 1) * n
            for i in range(count):
                total = merge_contact(total, contact_sums_of(tallies, memory + i))
            sums.contact[at] = total
            memory = memory + count

    return without_contraction(add_tallies)
