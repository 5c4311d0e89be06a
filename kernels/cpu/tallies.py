"""Sums over the rollers of one variant: tension, mid-strand displacement, what links take, energy."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.link import link_chain
from ..physics.roller import roller_energy
from ..rows import accessors
from ..structs import Strand, types
from ..sum_structs import ChainSums, LinkTally, StrandSums
from ..sums import add_tension, after, displacement, merge_tension
from .rollers import passes, rows


@dataclass(frozen=True)
class RollerSums:
    """The sums over the rollers of one variant."""

    links_power: wp.Function
    add_links: wp.Function
    add_strand_links: wp.Function
    widen: wp.Function
    mid_displacement: wp.Function
    rollers_energy: wp.Function


@cache
def tallies(Real: type, capacity: int) -> RollerSums:
    """The sums over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    load_row = accessors(Real).load_row
    at = rows(capacity)
    X, Y, VX, VY, TENSION, RATE = at.x, at.y, at.vx, at.vy, at.tension, at.rate
    vec2, acceleration = kinds.vec2, passes(Real, capacity).acceleration

    @wp.func
    def damper_power(w: wp.array[Real], n: int, chain: kinds.Chain, links: kinds.Links):
        """Power of the dampers of links that differ [W]."""
        power = Real(0.0)
        i = int(0)
        while i < n:
            rate = load_row(w, RATE + i)
            power += link_chain(i, chain, links).damping * (rate * rate)
            i = i + 1
        return power

    @wp.func
    def links_power(w: wp.array[Real], n: int, chain: kinds.Chain, links: kinds.Links):
        """Power of the links' dampers [W]."""
        rates = Real(0.0)
        i = int(0)
        while i < n:
            rate = load_row(w, RATE + i)
            rates += rate * rate
            i = i + 1
        power = chain.damping * rates
        if links.uneven != 0:
            power = damper_power(w, n, chain, links)
        return wp.float64(power)

    @wp.func
    def add_links(w: wp.array[Real], n: int, sums: ChainSums):
        """A look at every link's tension."""
        seen = LinkTally()
        i = int(0)
        while i < n:
            seen = add_tension(seen, load_row(w, TENSION + i))
            i = i + 1
        sums = merge_tension(sums, seen)
        sums.samples = sums.samples + wp.int64(1)
        return sums

    @wp.func
    def widen(w: wp.array[Real], first: int, end: int, lowest: Real, highest: Real):
        """The smallest and the largest tension so far, after those of links `first` to `end` - 1."""
        i = first
        while i < end:
            tension = load_row(w, TENSION + i)
            lowest = wp.min(lowest, tension)
            highest = wp.max(highest, tension)
            i = i + 1
        return lowest, highest

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
    def add_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """A look at the tension of the links between the strand's two tangent points."""
        seen = LinkTally()
        link = strand.first_link
        count = int(0)
        while count < strand.links:
            seen = add_tension(seen, load_row(w, TENSION + link))
            link = after(link, n)
            count = count + 1
        sums = merge_tension(sums, seen)
        sums.links = sums.links + wp.int64(strand.links)
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
        links_power=links_power,
        add_links=add_links,
        add_strand_links=add_strand_links,
        widen=widen,
        mid_displacement=mid_displacement,
        rollers_energy=rollers_energy,
    )
