"""What the rollers of one variant add up to: tensions by link, mid-strand displacement, energy.

Every link has a tally of its own, a value in each of three rows, so that a step adds to all in a loop that vectorizes;
every `MERGE_EVERY` steps, before strands change their links, tallies are merged into the sums of chain and strands.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..physics.link import link_chain
from ..physics.roller import roller_energy
from ..rows import accessors, whole_lanes
from ..structs import Strand, types
from ..sum_structs import ChainSums, LinkTally, StrandSums
from ..sums import add_tension, after, displacement, merge_extremes, merge_tension
from .rollers import passes, rows


@dataclass(frozen=True)
class RollerSums:
    """The sums over the rollers of one variant."""

    clear: wp.Function
    add_rates: wp.Function
    widen: wp.Function
    add_links: wp.Function
    add_strand_links: wp.Function
    merge_links: wp.Function
    mid_displacement: wp.Function
    merge_strand_links: wp.Function
    rollers_energy: wp.Function


@cache
def tallies(Real: type, capacity: int) -> RollerSums:
    """The sums over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    at = rows(capacity)
    X, Y, VX, VY, TENSION, RATE = at.x, at.y, at.vx, at.vy, at.tension, at.rate
    LEAST, GREATEST, RATES = at.least, at.greatest, at.rates
    vec2, acceleration = kinds.vec2, passes(Real, capacity).acceleration

    @wp.func
    def clear(w: wp.array[Real], n: int):
        """Begins the links' tallies anew."""
        i = int(0)
        while i < whole(n):
            store_row(w, LEAST + i, Real(wp.inf))
            store_row(w, GREATEST + i, Real(-wp.inf))
            store_row(w, RATES + i, Real(0.0))
            i = i + 1

    @wp.func
    def add_rates(w: wp.array[Real], n: int, share: Real):
        """Adds a step's squared rates to the links' tallies; `share` is the part of a step that it stands for."""
        i = int(0)
        while i < whole(n):
            rate = load_row(w, RATE + i)
            store_row(w, RATES + i, load_row(w, RATES + i) + share * (rate * rate))
            i = i + 1

    @wp.func
    def widen(w: wp.array[Real], n: int):
        """Holds a watched step's tensions against the links' extremes."""
        i = int(0)
        while i < whole(n):
            tension = load_row(w, TENSION + i)
            store_row(w, LEAST + i, wp.min(load_row(w, LEAST + i), tension))
            store_row(w, GREATEST + i, wp.max(load_row(w, GREATEST + i), tension))
            i = i + 1

    @wp.func
    def add_links(w: wp.array[Real], n: int, sums: ChainSums):
        """A look at every link's tension."""
        seen = LinkTally()
        for i in range(n):
            seen = add_tension(seen, load_row(w, TENSION + i))
        sums = merge_tension(sums, seen)
        sums.samples = sums.samples + wp.int64(1)
        return sums

    @wp.func
    def add_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """A look at the tension of the links between the strand's two tangent points."""
        seen = LinkTally()
        link = strand.first_link
        for _ in range(strand.links):
            seen = add_tension(seen, load_row(w, TENSION + link))
            link = after(link, n)
        sums = merge_tension(sums, seen)
        sums.links = sums.links + wp.int64(strand.links)
        return sums

    @wp.func
    def merge_extremes_of(w: wp.array[Real], i: int, sums: Any):
        """`sums` with the extremes of link i's tally."""
        return merge_extremes(sums, wp.float64(load_row(w, LEAST + i)), wp.float64(load_row(w, GREATEST + i)))

    @wp.func
    def merge_links(
        w: wp.array[Real], n: int, chain: kinds.Chain, links: kinds.Links, sums: ChainSums, step: wp.float64
    ):
        """`sums` with the tallies of all links; `step` is a step's length [s]."""
        for i in range(n):
            sums = merge_extremes_of(w, i, sums)
            mine = chain
            if links.uneven != 0:
                mine = link_chain(i, chain, links)
            sums.dissipated = sums.dissipated + step * wp.float64(mine.damping * load_row(w, RATES + i))
        return sums

    @wp.func
    def mid_displacement(w: wp.array[Real], n: int, strand: Strand):
        """Transverse displacement of the chain where it passes mid-strand [m], positive to the left of travel."""
        i = strand.middle
        j = after(i, n)
        return displacement(
            wp.float64(load_row(w, X + i)),
            wp.float64(load_row(w, Y + i)),
            wp.float64(load_row(w, X + j)),
            wp.float64(load_row(w, Y + j)),
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
    def rollers_energy(w: wp.array[Real], n: int, chain: kinds.Chain, links: kinds.Links, back: Real):
        """Kinetic, elastic and potential energy of rollers and links [J]; `back` is the time since the velocities'
        instant.
        """
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            a = acceleration(w, i, chain.inverse_mass, chain.gravity)
            position = vec2(load_row(w, X + i), load_row(w, Y + i))
            velocity = vec2(load_row(w, VX + i) + back * a[0], load_row(w, VY + i) + back * a[1])
            mine = chain
            if links.uneven != 0:
                mine = link_chain(i, chain, links)
            held, weight = roller_energy(position, velocity, load_row(w, TENSION + i), load_row(w, RATE + i), mine)
            total += held
            total -= weight
            i = i + 1
        return total

    return RollerSums(
        clear=clear,
        add_rates=add_rates,
        widen=widen,
        add_links=add_links,
        add_strand_links=add_strand_links,
        merge_links=merge_links,
        mid_displacement=mid_displacement,
        merge_strand_links=merge_strand_links,
        rollers_energy=rollers_energy,
    )
