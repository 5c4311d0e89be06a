"""Tallies of each link and roller of one variant on the CPU, added to every step by vectorized loops.

Sums of chain and strands merge them every `MERGE_EVERY` steps, before strands' links change.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import larger, row_access, smaller
from ..physics.link import chain_at_roller, link_spring, roller_energy
from ..structs import ChainSums, LinkTally, Strand, StrandSums, types
from ..sums import add_tension, merge_extremes, merge_tension, mid_strand_displacement, next_index
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class LinkTallyFunctions:
    """CPU link tally functions."""

    clear: wp.Function
    add_rates: wp.Function
    widen_extremes: wp.Function
    add_tensions: wp.Function
    add_strand_tensions: wp.Function
    merge_links: wp.Function
    merge_friction: wp.Function
    mid_displacement: wp.Function
    merge_strand_links: wp.Function
    rollers_energy: wp.Function


@cache
def link_tally_functions(Real: type, capacity: int) -> LinkTallyFunctions:
    """CPU link tally functions."""
    kinds = types(Real)
    Chain = kinds.Chain
    vec2 = kinds.vec2
    access = row_access(Real)
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)

    @wp.func
    def clear(w: wp.array[Real], n: int):
        """Sets the rows of links' tallies to zero."""
        i = int(0)
        while i < access.round_up(n):
            access.store(w, row.tension_min + i, Real(wp.inf))
            access.store(w, row.tension_max + i, Real(-wp.inf))
            access.store(w, row.rate_squares + i, Real(0.0))
            access.store(w, row.joint_friction + i, Real(0.0))
            i = i + 1

    @wp.func
    def add_rates(w: wp.array[Real], n: int, share: Real):
        """Adds squared rates of elongation, times `share` of a step, to CPU rows of links' tallies."""
        i = int(0)
        while i < access.round_up(n):
            rate = access.load(w, row.rate + i)
            access.store(w, row.rate_squares + i, access.load(w, row.rate_squares + i) + share * (rate * rate))
            i = i + 1

    @wp.func
    def widen_extremes(w: wp.array[Real], n: int):
        """Widens extremes in CPU rows of links' tallies by a step's tensions."""
        i = int(0)
        while i < access.round_up(n):
            tension = access.load(w, row.tension + i)
            access.store(w, row.tension_min + i, smaller(access.load(w, row.tension_min + i), tension))
            access.store(w, row.tension_max + i, larger(access.load(w, row.tension_max + i), tension))
            i = i + 1

    @wp.func
    def add_tensions(w: wp.array[Real], n: int, sums: ChainSums):
        """Chain's sums with a sample of every link's tension in rows."""
        seen = LinkTally()
        for i in range(n):
            seen = add_tension(seen, access.load(w, row.tension + i))
        sums = merge_tension(sums, seen)
        sums.samples = sums.samples + wp.int64(1)
        return sums

    @wp.func
    def add_strand_tensions(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """Strand's sums with a sample of its links' tensions in rows."""
        seen = LinkTally()
        link = strand.first_link
        for _ in range(strand.links):
            seen = add_tension(seen, access.load(w, row.tension + link))
            link = next_index(link, n)
        sums = merge_tension(sums, seen)
        sums.links = sums.links + wp.int64(strand.links)
        return sums

    @wp.func
    def merge_extremes_of(w: wp.array[Real], i: int, sums: Any):
        """Sums with the extremes of tension of link i's tally."""
        return merge_extremes(
            sums, wp.float64(access.load(w, row.tension_min + i)), wp.float64(access.load(w, row.tension_max + i))
        )

    @wp.func
    def merge_links(w: wp.array[Real], n: int, chain: Chain, sums: ChainSums, step: wp.float64):
        """Chain's sums with the tallies of all links; `step` is its length [s]."""
        for i in range(n):
            if i + 1 != chain.absent:
                sums = merge_extremes_of(w, i, sums)
            stiffness, damping = link_spring(i, chain)
            sums.dissipated = sums.dissipated + step * wp.float64(damping * access.load(w, row.rate_squares + i))
        return sums

    @wp.func
    def merge_friction(w: wp.array[Real], n: int, friction: wp.float64, step: wp.float64):
        """Work [J] of joints' friction with that in all rollers' tallies."""
        for i in range(n):
            friction = friction + step * wp.float64(access.load(w, row.joint_friction + i))
        return friction

    @wp.func
    def mid_displacement(w: wp.array[Real], n: int, strand: Strand):
        """Transverse displacement [m] of the chain in rows at mid-strand, left positive."""
        i = strand.middle
        j = next_index(i, n)
        return mid_strand_displacement(
            wp.float64(access.load(w, row.x + i)),
            wp.float64(access.load(w, row.y + i)),
            wp.float64(access.load(w, row.x + j)),
            wp.float64(access.load(w, row.y + j)),
            strand,
        )

    @wp.func
    def merge_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """Strand's sums with the tallies of its links."""
        link = strand.first_link
        for _ in range(strand.links):
            sums = merge_extremes_of(w, link, sums)
            link = next_index(link, n)
        return sums

    @wp.func
    def rollers_energy(w: wp.array[Real], n: int, chain: Chain, back: Real):
        """Energy [J] of all rollers and links in rows, `back` [s] after the velocities' instant."""
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            a = rollers.acceleration(w, i, chain.inverse_mass, chain.gravity)
            position = vec2(access.load(w, row.x + i), access.load(w, row.y + i))
            velocity = vec2(access.load(w, row.vx + i) + back * a[0], access.load(w, row.vy + i) + back * a[1])
            tension, rate = access.load(w, row.tension + i), access.load(w, row.rate + i)
            own = chain_at_roller(chain, access.load(w, row.relative_mass + i), access.load(w, row.mobility + i))
            held, weight = roller_energy(position, velocity, tension, rate, i, own)
            total += held
            total -= weight
            i = i + 1
        return total

    return LinkTallyFunctions(
        clear=clear,
        add_rates=add_rates,
        widen_extremes=widen_extremes,
        add_tensions=add_tensions,
        add_strand_tensions=add_strand_tensions,
        merge_links=merge_links,
        merge_friction=merge_friction,
        mid_displacement=mid_displacement,
        merge_strand_links=merge_strand_links,
        rollers_energy=rollers_energy,
    )
