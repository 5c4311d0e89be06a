"""Sums over the chain of one variant: tensions by link and by strand, mid-strand displacement, energy, statistics.

Every link has a tally of its own, a value in each of four rows, so that a step adds to all in a loop that vectorizes;
every `MERGE_EVERY` steps, before strands change their links, tallies are merged into the sums of chain and strands.
Every `look_every` steps tensions, mid-strands and slips are looked at.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..native import accessors, whole_lanes
from ..physics.link import link_spring, roller_energy
from ..statistics import BINS, NOTES, bins_per_force, count_tension, follow_slip, mid_wrap, notes_due
from ..structs import ChainSums, Drive, LinkTally, MountNote, Note, SprocketNote, Strand, StrandSums, Sums, types
from ..sums import (
    add_displacement,
    add_tension,
    after,
    displacement,
    following,
    is_look,
    merge_extremes,
    merge_tension,
    note_mount,
    note_sprocket,
)
from .rollers import passes, rows


@cache
def tallies(Real: type, capacity: int) -> SimpleNamespace:
    """The sums over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Chain = kinds.Chain
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    row = rows(capacity)
    vec2, acceleration = kinds.vec2, passes(Real, capacity).acceleration

    @wp.func
    def clear(w: wp.array[Real], n: int):
        """Begins the links' tallies anew."""
        i = int(0)
        while i < whole(n):
            store_row(w, row.least + i, Real(wp.inf))
            store_row(w, row.greatest + i, Real(-wp.inf))
            store_row(w, row.rates + i, Real(0.0))
            store_row(w, row.rubbing + i, Real(0.0))
            i = i + 1

    @wp.func
    def add_rates(w: wp.array[Real], n: int, share: Real):
        """Adds a step's squared rates to the links' tallies; `share` is the part of a step that it stands for."""
        i = int(0)
        while i < whole(n):
            rate = load_row(w, row.rate + i)
            store_row(w, row.rates + i, load_row(w, row.rates + i) + share * (rate * rate))
            i = i + 1

    @wp.func
    def widen(w: wp.array[Real], n: int):
        """Holds a step's tensions against the links' extremes."""
        i = int(0)
        while i < whole(n):
            tension = load_row(w, row.tension + i)
            store_row(w, row.least + i, wp.min(load_row(w, row.least + i), tension))
            store_row(w, row.greatest + i, wp.max(load_row(w, row.greatest + i), tension))
            i = i + 1

    @wp.func
    def add_links(w: wp.array[Real], n: int, sums: ChainSums):
        """A look at every link's tension."""
        seen = LinkTally()
        for i in range(n):
            seen = add_tension(seen, load_row(w, row.tension + i))
        sums = merge_tension(sums, seen)
        sums.samples = sums.samples + wp.int64(1)
        return sums

    @wp.func
    def add_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """A look at the tension of the links between the strand's two tangent points."""
        seen = LinkTally()
        link = strand.first_link
        for _ in range(strand.links):
            seen = add_tension(seen, load_row(w, row.tension + link))
            link = after(link, n)
        sums = merge_tension(sums, seen)
        sums.links = sums.links + wp.int64(strand.links)
        return sums

    @wp.func
    def merge_extremes_of(w: wp.array[Real], i: int, sums: Any):
        """`sums` with the extremes of link i's tally."""
        return merge_extremes(sums, wp.float64(load_row(w, row.least + i)), wp.float64(load_row(w, row.greatest + i)))

    @wp.func
    def merge_links(w: wp.array[Real], n: int, chain: Chain, sums: ChainSums, step: wp.float64):
        """`sums` with the tallies of all links; `step` is a step's length [s]."""
        for i in range(n):
            sums = merge_extremes_of(w, i, sums)
            stiffness, damping = link_spring(i, chain)
            sums.dissipated = sums.dissipated + step * wp.float64(damping * load_row(w, row.rates + i))
        return sums

    @wp.func
    def merge_friction(w: wp.array[Real], n: int, friction: wp.float64, step: wp.float64):
        """`friction` with what the tallies of all rollers say that their joints took [J]."""
        for i in range(n):
            friction = friction + step * wp.float64(load_row(w, row.rubbing + i))
        return friction

    @wp.func
    def mid_displacement(w: wp.array[Real], n: int, strand: Strand):
        """Transverse displacement of the chain where it passes mid-strand [m], positive to the left of travel."""
        i = strand.middle
        j = after(i, n)
        return displacement(
            wp.float64(load_row(w, row.x + i)),
            wp.float64(load_row(w, row.y + i)),
            wp.float64(load_row(w, row.x + j)),
            wp.float64(load_row(w, row.y + j)),
            strand,
        )

    @wp.func
    def merge_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """`sums` with the tallies of the links between the strand's two tangent points."""
        link = strand.first_link
        for _ in range(strand.links):
            sums = merge_extremes_of(w, link, sums)
            link = after(link, n)
        return sums

    @wp.func
    def rollers_energy(w: wp.array[Real], n: int, chain: Chain, back: Real):
        """Kinetic, elastic and potential energy of rollers and links [J]; `back` is the time since the velocities'
        instant.
        """
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            a = acceleration(w, i, chain.inverse_mass, chain.gravity)
            position = vec2(load_row(w, row.x + i), load_row(w, row.y + i))
            velocity = vec2(load_row(w, row.vx + i) + back * a[0], load_row(w, row.vy + i) + back * a[1])
            tension, rate = load_row(w, row.tension + i), load_row(w, row.rate + i)
            held, weight = roller_energy(position, velocity, tension, rate, i, chain)
            total += held
            total -= weight
            i = i + 1
        return total

    return SimpleNamespace(**locals())


@cache
def chain_sums(Real: type, capacity: int) -> SimpleNamespace:
    """The sums over the chain of one variant, for rows of `capacity` values of type `Real`."""
    kinds, tally, follow = types(Real), tallies(Real, capacity), following(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    row = rows(capacity)

    @wp.func
    def note(sums: Sums, variant: int, drive: Drive, step: int):
        """Notes the sums at the ends of batches, before step `step` is added."""
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
    def place_links(state: State, drive: Drive, w: wp.array[Real]):
        """Which strand of the drive every link is on; the number of strands where it is on none."""
        n = drive.rollers
        for j in range(n):
            store_row(w, row.strand + j, Real(drive.sprockets))
        for s in range(drive.sprockets):
            strand = state.strands[drive.first_sprocket + s]
            link = strand.first_link
            for _ in range(strand.links):
                store_row(w, row.strand + link, Real(s))
                link = after(link, n)

    @wp.func
    def add_statistics(ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real]):
        """Counts tensions and follows slips."""
        n = drive.rollers
        first = drive.first_sprocket
        place_links(state, drive, w)
        per_force = bins_per_force(drive.tension_scale)
        for j in range(n):
            at = (first + variant + int(load_row(w, row.strand + j))) * BINS
            count_tension(sums.tension_counts, at, load_row(w, row.tension + j), per_force)
        for s in range(drive.sprockets):
            before = state.strands[first + wp.where(s > 0, s, drive.sprockets) - 1]
            roller = mid_wrap(before, state.strands[first + s], n)
            seat = state.seat[drive.first_contact + s * n + roller]
            sign = ensemble.motions[drive.first_body + s].sign
            teeth = ensemble.sprockets[first + s].teeth
            sums.slip[first + s] = follow_slip(sums.slip[first + s], roller, seat, teeth, sign, n)

    @wp.func
    def merge(ensemble: Ensemble, state: State, sums: Sums, variant: int, w: wp.array[Real]):
        """Merges the tallies of links into the sums of the window, and begins them anew."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        n = drive.rollers
        sums.chain[variant] = tally.merge_links(w, n, chain, sums.chain[variant], drive.step)
        if chain.joint.inertia > Real(0.0):
            sums.chain[variant].friction = tally.merge_friction(w, n, sums.chain[variant].friction, drive.step)
        for s in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            sums.strand[s] = tally.merge_strand_links(w, n, state.strands[s], sums.strand[s])
        tally.clear(w, n)

    @wp.func
    def look_at_chain(
        ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real], step: int
    ):
        """Brings the strands up to date, and adds tensions and mid-strand displacements of step `step` to the sums."""
        n = drive.rollers
        if step > drive.window_start:
            note(sums, variant, drive, step)
        for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            state.strands[i] = follow(w, row.x, row.y, n, state.strands[i], step == drive.window_start)
        add_statistics(ensemble, state, sums, variant, drive, w)
        sums.chain[variant] = tally.add_links(w, n, sums.chain[variant])
        for i in range(drive.first_sprocket, drive.first_sprocket + drive.sprockets):
            strand = state.strands[i]
            strand_sums = tally.add_strand_links(w, n, strand, sums.strand[i])
            sums.strand[i] = add_displacement(strand_sums, tally.mid_displacement(w, n, strand))

    @wp.func(inline=False)
    def gather(ensemble: Ensemble, state: State, sums: Sums, variant: int, drive: Drive, w: wp.array[Real], step: int):
        """Merges tallies and samples the chain before step `step` is added, at the steps where that is due."""
        if step > drive.window_start:
            merge(ensemble, state, sums, variant, w)
        if is_look(drive, step):
            look_at_chain(ensemble, state, sums, variant, drive, w, step)

    clear, widen, add_rates, energy = tally.clear, tally.widen, tally.add_rates, tally.rollers_energy
    return SimpleNamespace(**locals())
