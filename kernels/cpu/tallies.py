"""Sums over the rollers of one variant at one step: tension, mid-strand displacement, energy."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..rows import accessors
from ..structs import Strand, types
from ..sum_structs import ChainSums, StrandSums
from ..sums import add_tension, after, displacement, merge_tension, unseen
from .rollers import rows


@dataclass(frozen=True)
class RollerSums:
    """The sums over the rollers of one variant."""

    add_links: wp.Function
    mid_displacement: wp.Function
    add_strand_links: wp.Function
    roller_energy: wp.Function


@cache
def tallies(Real: type, capacity: int) -> RollerSums:
    """The sums over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    load_row = accessors(Real).load_row
    at = rows(capacity)
    X, Y, VX, VY, TENSION, RATE = at.x, at.y, at.vx, at.vy, at.tension, at.rate
    LINK_X, LINK_Y, FX, FY = at.link_x, at.link_y, at.fx, at.fy

    @wp.func
    def add_links(w: wp.array[Real], n: int, chain: kinds.Chain, sums: ChainSums, weight: wp.float64):
        """Tension of every link, and the power of the links' dampers."""
        seen = unseen()
        rates = Real(0.0)
        i = int(0)
        while i < n:
            seen = add_tension(seen, load_row(w, TENSION + i))
            rate = load_row(w, RATE + i)
            rates += rate * rate
            i = i + 1
        sums = merge_tension(sums, seen)
        sums.samples = sums.samples + wp.int64(1)
        sums.dissipated = sums.dissipated + weight * wp.float64(chain.damping * rates)
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
    def add_strand_links(w: wp.array[Real], n: int, strand: Strand, sums: StrandSums):
        """Tension of the links between the strand's two tangent points."""
        seen = unseen()
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
    def roller_energy(w: wp.array[Real], n: int, chain: kinds.Chain, back: Real):
        """Kinetic, elastic and potential energy of rollers and links [J]; `back` is the time since the velocities'
        instant.
        """
        total = wp.float64(0.0)
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            ax = (
                inverse_mass * (load_row(w, LINK_X + i + 1) - load_row(w, LINK_X + i) + load_row(w, FX + i))
                + chain.gravity[0]
            )
            ay = (
                inverse_mass * (load_row(w, LINK_Y + i + 1) - load_row(w, LINK_Y + i) + load_row(w, FY + i))
                + chain.gravity[1]
            )
            vx = wp.float64(load_row(w, VX + i) + back * ax)
            vy = wp.float64(load_row(w, VY + i) + back * ay)
            spring = wp.float64(load_row(w, TENSION + i) - chain.damping * load_row(w, RATE + i))
            lift = wp.float64(chain.gravity[0]) * wp.float64(load_row(w, X + i)) + wp.float64(
                chain.gravity[1]
            ) * wp.float64(load_row(w, Y + i))
            total += wp.float64(0.5) * (
                wp.float64(chain.mass) * (vx * vx + vy * vy) + spring * spring / wp.float64(chain.stiffness)
            )
            total -= wp.float64(chain.mass) * lift
            i = i + 1
        return total

    return RollerSums(
        add_links=add_links,
        mid_displacement=mid_displacement,
        add_strand_links=add_strand_links,
        roller_energy=roller_energy,
    )
