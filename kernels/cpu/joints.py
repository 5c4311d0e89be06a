"""The CPU kernel's passes for chains whose joints rub or whose links differ, and what friction dissipates.

Plain loops over rows, as in `rollers`: joint n is joint 0 again, link i's values of two components stand at i + 1.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import accessors, whole_lanes
from ..physics.friction import (
    couple_force,
    joint_friction_coefficient,
    joint_friction_moment,
    joint_friction_power,
    link_turning,
)
from ..physics.link import has_uneven_links, link_force, uneven_link_force
from ..structs import types
from ..sums import after, before
from .rollers import passes, rows


@cache
def joint_passes(Real: type, capacity: int) -> SimpleNamespace:
    """The passes over the joints of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Chain = kinds.Chain
    vec2 = kinds.vec2
    part = passes(Real, capacity)
    apart, parting, store_link, close = part.apart, part.parting, part.store_link, part.close
    acceleration, accelerations = part.acceleration, part.accelerations
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    row = rows(capacity)

    @wp.func
    def store_turning(w: wp.array[Real], i: int, d: vec2, v: vec2):
        """Stores the rate at which link i turns."""
        lever, turn = link_turning(d, v)
        store_row(w, row.turn + i, turn)
        store_row(w, row.bend_x + i + 1, lever[0])
        store_row(w, row.bend_y + i + 1, lever[1])

    @wp.func
    def pull_links(w: wp.array[Real], n: int, chain: Chain):
        """Tension, force and turning of every link, in a loop of its own where links differ or have play; contact
        forces start at zero.
        """
        close(w, n)
        i = int(0)
        if not has_uneven_links(chain):
            while i < whole(n):
                d, v = apart(w, i), parting(w, i)
                tension, rate, u = link_force(d, v, load_row(w, row.length + i), chain)
                store_link(w, i, tension, rate, u)
                store_turning(w, i, d, v)
                i = i + 1
        while i < whole(n):
            d, v = apart(w, i), parting(w, i)
            tension, rate, u = uneven_link_force(d, v, load_row(w, row.length + i), i, chain)
            store_link(w, i, tension, rate, u)
            store_turning(w, i, d, v)
            i = i + 1
        store_row(w, row.link_x, load_row(w, row.link_x + n))
        store_row(w, row.link_y, load_row(w, row.link_y + n))

    @wp.func
    def rub_joint(w: wp.array[Real], i: int, mu: Real, chain: Chain, memory: kinds.Memory):
        """The moment of the joint after link i, and what it holds; in numbers, not vectors."""
        tension, turn = load_row(w, row.tension + i), load_row(w, row.turn + i)
        tension_after, turn_after = load_row(w, row.tension + i + 1), load_row(w, row.turn + i + 1)
        held = load_row(w, row.joint_hold + i + 1)
        moment, holds = joint_friction_moment(
            mu, tension, turn, tension_after, turn_after, held, chain, memory.stretched
        )
        store_row(w, row.moment + i + 1, moment)
        store_row(w, row.joint_hold + i + 1, wp.where(memory.stage == 0, holds, held))

    @wp.func
    def rub_joints(w: wp.array[Real], n: int, chain: Chain, memory: kinds.Memory):
        """The moment of every joint; of one coefficient at all speeds in a loop of its own, which vectorizes."""
        store_row(w, row.tension + n, load_row(w, row.tension))
        store_row(w, row.turn + n, load_row(w, row.turn))
        mu = chain.joint.mu_dynamic
        i = int(0)
        if chain.joint.mu_static == mu:
            while i < whole(n):
                rub_joint(w, i, mu, chain, memory)
                i = i + 1
        while i < n:
            mu = joint_friction_coefficient(load_row(w, row.turn + i), load_row(w, row.turn + i + 1), chain)
            rub_joint(w, i, mu, chain, memory)
            i = i + 1
        store_row(w, row.moment, load_row(w, row.moment + n))

    @wp.func
    def bend_links(w: wp.array[Real], n: int):
        """Adds the force of its joints' couple to every link's."""
        i = int(0)
        while i < whole(n):
            lever = vec2(load_row(w, row.bend_x + i + 1), load_row(w, row.bend_y + i + 1))
            force = couple_force(load_row(w, row.moment + i), load_row(w, row.moment + i + 1), lever)
            store_row(w, row.bend_x + i + 1, force[0])
            store_row(w, row.bend_y + i + 1, force[1])
            store_row(w, row.link_x + i + 1, load_row(w, row.link_x + i + 1) + force[0])
            store_row(w, row.link_y + i + 1, load_row(w, row.link_y + i + 1) + force[1])
            i = i + 1
        for k in range(2):
            store_row(w, row.link_x + k * wp.static(capacity), load_row(w, row.link_x + k * wp.static(capacity) + n))
            store_row(w, row.bend_x + k * wp.static(capacity), load_row(w, row.bend_x + k * wp.static(capacity) + n))

    @wp.func
    def add_friction(w: wp.array[Real], n: int, chain: Chain, lag: Real, share: Real):
        """Adds the powers that the joints dissipate to the rollers' tallies, at the mean of the velocities before and
        after a leapfrog kick.

        `lag` is the time from the velocities' instant to that of the forces, half a step; `share` is the part of a
        step that these stand for.
        """
        i = int(0)
        while i < whole(n):
            ax, ay = accelerations(w, i, chain.inverse_mass, chain.gravity)
            x = load_row(w, row.bend_x + i + 1) - load_row(w, row.bend_x + i)
            y = load_row(w, row.bend_y + i + 1) - load_row(w, row.bend_y + i)
            given = x * (load_row(w, row.vx + i) + lag * ax) + y * (load_row(w, row.vy + i) + lag * ay)
            store_row(w, row.rubbing + i, load_row(w, row.rubbing + i) - share * given)
            i = i + 1

    @wp.func
    def turn_at(w: wp.array[Real], i: int, n: int, chain: Chain, lag: Real):
        """Rate at which link i turns [rad/s], `lag` after the velocities' instant."""
        mine = acceleration(w, i, chain.inverse_mass, chain.gravity)
        of_next = acceleration(w, after(i, n), chain.inverse_mass, chain.gravity)
        lever, turn = link_turning(apart(w, i), parting(w, i) + lag * (of_next - mine))
        return turn

    @wp.func
    def joint_power(w: wp.array[Real], i: int, n: int, chain: Chain, lag: Real):
        """Power that joint i dissipates [W]; over all joints the sum is that of `add_friction`."""
        turn = turn_at(w, i, n, chain, lag)
        return joint_friction_power(load_row(w, row.moment + i), turn_at(w, before(i, n), n, chain, lag), turn)

    return SimpleNamespace(**locals())
