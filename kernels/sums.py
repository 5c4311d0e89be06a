"""What is added up over the window, in float64: tension, displacement, contacts, work, each step with its weight
in time.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .rollers import accessors, rows
from .root import reciprocal
from .structs import Mount, SprocketState, Strand, types, vec2d
from .sum_structs import ChainSums, ContactSums, MountSums, SprocketSums, StrandSums, Totals

STRAND_LOOK_EVERY = wp.constant(16)
"""Steps between two looks at which links lie on a strand; the chain moves a small part of a pitch in between."""


@wp.func
def before(i: int, n: int):
    """Index of the neighbor before i in a closed chain of n."""
    return wp.where(i == 0, n - 1, i - 1)


@wp.func
def after(i: int, n: int):
    """Index of the neighbor after i in a closed chain of n."""
    return wp.where(i == n - 1, 0, i + 1)


@wp.func
def add_contact(sums: ContactSums, totals: Totals, weight: wp.float64):
    """One partner's contacts of one step; `weight` is the time it stands for [s]."""
    sums.force_max = wp.max(sums.force_max, totals.force_max)
    sums.impacts = sums.impacts + totals.impacts
    sums.impulse = sums.impulse + weight * totals.force
    sums.dissipated = sums.dissipated + weight * totals.dissipated
    return sums


@wp.func
def add_sprocket(sums: SprocketSums, speed: wp.float64, moment: wp.float64, load: wp.float64, weight: wp.float64):
    """One sprocket's speed, contact moment and load moment at one step."""
    sums.speed_min = wp.min(sums.speed_min, speed)
    sums.speed_max = wp.max(sums.speed_max, speed)
    sums.speed = sums.speed + weight * speed
    sums.speed_square = sums.speed_square + weight * speed * speed
    sums.moment = sums.moment + weight * moment
    sums.contact_work = sums.contact_work + weight * moment * speed
    sums.load_work = sums.load_work + weight * load * speed
    return sums


@wp.func
def add_mount(sums: MountSums, body: SprocketState, mount: Mount, held: vec2d, power: wp.float64, weight: wp.float64):
    """One moving sprocket's displacement, the force `held` on its center, its damper's and its prescription's power."""
    apart = body.center - mount.home
    sums.travel = sums.travel + weight * apart
    sums.travel_max = wp.max(sums.travel_max, wp.length(apart))
    sums.force = sums.force + weight * wp.length(held)
    sums.dissipated = sums.dissipated + weight * wp.dot(body.velocity, mount.damping * body.velocity)
    sums.work = sums.work + weight * power
    return sums


@wp.func
def add_displacement(sums: StrandSums, displacement: wp.float64):
    """One mid-strand transverse displacement [m]."""
    sums.samples = sums.samples + wp.int64(1)
    sums.displacement_min = wp.min(sums.displacement_min, displacement)
    sums.displacement_max = wp.max(sums.displacement_max, displacement)
    sums.displacement = sums.displacement + displacement
    sums.displacement_square = sums.displacement_square + displacement * displacement
    return sums


@wp.func
def along(x: wp.float64, y: wp.float64, strand: Strand):
    """Coordinate of a point along a strand's nominal line [m]."""
    return (x - strand.start[0]) * strand.direction[0] + (y - strand.start[1]) * strand.direction[1]


@wp.func
def across(x: wp.float64, y: wp.float64, strand: Strand):
    """Distance of a point to the left of a strand's nominal line [m]."""
    return (y - strand.start[1]) * strand.direction[0] - (x - strand.start[0]) * strand.direction[1]


@wp.func
def displacement(ax: wp.float64, ay: wp.float64, bx: wp.float64, by: wp.float64, strand: Strand):
    """Transverse displacement of the chain where it passes mid-strand between two rollers [m], left positive."""
    a = along(ax, ay, strand)
    b = along(bx, by, strand)
    part = (wp.float64(0.5) * strand.length - a) * reciprocal(b - a)
    return across(ax, ay, strand) * (wp.float64(1.0) - part) + across(bx, by, strand) * part


@cache
def following(Real: type) -> SimpleNamespace:
    """The function that keeps up which part of the chain is on a strand."""

    @wp.func
    def reach(rollers: wp.array(dtype=Real), x: int, y: int, i: int, strand: Strand):
        """Coordinate of roller i along a strand's nominal line [m]."""
        return along(wp.float64(rollers[x + i]), wp.float64(rollers[y + i]), strand)

    @wp.func
    def follow(rollers: wp.array(dtype=Real), x: int, y: int, n: int, strand: Strand):
        """The strand with its middle and its links brought up to date; the chain has moved little since.

        Roller i's coordinates are `rollers[x + i]` and `rollers[y + i]`.
        """
        half = wp.float64(0.5) * strand.length
        middle = strand.middle
        tries = int(0)
        while reach(rollers, x, y, middle, strand) > half and tries < n:
            middle = before(middle, n)
            tries = tries + 1
        tries = int(0)
        while reach(rollers, x, y, after(middle, n), strand) <= half and tries < n:
            middle = after(middle, n)
            tries = tries + 1
        first = middle
        last = middle
        if strand.links > 0:
            first = strand.first_link
            last = (first + strand.links) % n
        tries = int(0)
        while reach(rollers, x, y, before(first, n), strand) > wp.float64(0.0) and tries < n:
            first = before(first, n)
            tries = tries + 1
        tries = int(0)
        while reach(rollers, x, y, first, strand) <= wp.float64(0.0) and tries < n:
            first = after(first, n)
            tries = tries + 1
        tries = int(0)
        while reach(rollers, x, y, after(last, n), strand) < strand.length and tries < n:
            last = after(last, n)
            tries = tries + 1
        tries = int(0)
        while reach(rollers, x, y, last, strand) >= strand.length and tries < n:
            last = before(last, n)
            tries = tries + 1
        strand.middle = middle
        strand.first_link = first
        strand.links = (last - first + n) % n
        return strand

    return SimpleNamespace(follow=follow)


@cache
def tallies(Real: type, capacity: int) -> SimpleNamespace:
    """The sums over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    load = accessors(Real).load
    at = rows(capacity)
    X, Y, VX, VY, TENSION, RATE = at.x, at.y, at.vx, at.vy, at.tension, at.rate
    LINK_X, LINK_Y, FX, FY = at.link_x, at.link_y, at.fx, at.fy

    @wp.func
    def add_links(w: wp.array(dtype=Real), n: int, chain: kinds.Chain, sums: ChainSums, weight: wp.float64):
        """Tension of every link, and the power of the links' dampers."""
        lowest = Real(sums.tension_min)
        highest = Real(sums.tension_max)
        total = wp.float64(0.0)
        square = wp.float64(0.0)
        rates = Real(0.0)
        i = int(0)
        while i < n:
            tension = load(w, TENSION + i)
            lowest = wp.min(lowest, tension)
            highest = wp.max(highest, tension)
            value = wp.float64(tension)
            total += value
            square += value * value
            rate = load(w, RATE + i)
            rates += rate * rate
            i = i + 1
        sums.tension_min = wp.float64(lowest)
        sums.tension_max = wp.float64(highest)
        sums.tension = sums.tension + total
        sums.tension_square = sums.tension_square + square
        sums.samples = sums.samples + wp.int64(1)
        sums.dissipated = sums.dissipated + weight * wp.float64(chain.damping * rates)
        return sums

    @wp.func
    def mid_displacement(w: wp.array(dtype=Real), n: int, strand: Strand):
        """Transverse displacement of the chain where it passes mid-strand [m], positive to the left of travel."""
        i = strand.middle
        j = after(i, n)
        return displacement(
            wp.float64(load(w, X + i)),
            wp.float64(load(w, Y + i)),
            wp.float64(load(w, X + j)),
            wp.float64(load(w, Y + j)),
            strand,
        )

    @wp.func
    def add_strand_links(w: wp.array(dtype=Real), n: int, strand: Strand, sums: StrandSums):
        """Tension of the links between the strand's two tangent points."""
        lowest = Real(sums.tension_min)
        highest = Real(sums.tension_max)
        total = wp.float64(0.0)
        square = wp.float64(0.0)
        link = strand.first_link
        count = int(0)
        while count < strand.links:
            tension = load(w, TENSION + link)
            lowest = wp.min(lowest, tension)
            highest = wp.max(highest, tension)
            value = wp.float64(tension)
            total += value
            square += value * value
            link = after(link, n)
            count = count + 1
        sums.tension_min = wp.float64(lowest)
        sums.tension_max = wp.float64(highest)
        sums.tension = sums.tension + total
        sums.tension_square = sums.tension_square + square
        sums.links = sums.links + wp.int64(strand.links)
        return sums

    @wp.func
    def roller_energy(w: wp.array(dtype=Real), n: int, chain: kinds.Chain, back: Real):
        """Kinetic, elastic and potential energy of rollers and links [J]; `back` is the time since the velocities'
        instant.
        """
        total = wp.float64(0.0)
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            ax = inverse_mass * (load(w, LINK_X + i + 1) - load(w, LINK_X + i) + load(w, FX + i)) + chain.gravity[0]
            ay = inverse_mass * (load(w, LINK_Y + i + 1) - load(w, LINK_Y + i) + load(w, FY + i)) + chain.gravity[1]
            vx = wp.float64(load(w, VX + i) + back * ax)
            vy = wp.float64(load(w, VY + i) + back * ay)
            spring = wp.float64(load(w, TENSION + i) - chain.damping * load(w, RATE + i))
            lift = wp.float64(chain.gravity[0]) * wp.float64(load(w, X + i)) + wp.float64(
                chain.gravity[1]
            ) * wp.float64(load(w, Y + i))
            total += wp.float64(0.5) * (
                wp.float64(chain.mass) * (vx * vx + vy * vy) + spring * spring / wp.float64(chain.stiffness)
            )
            total -= wp.float64(chain.mass) * lift
            i = i + 1
        return total

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
