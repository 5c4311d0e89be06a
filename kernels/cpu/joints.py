"""Joint friction on the CPU, and links of chains with it or whose links differ.

Joint n is joint 0 again; link i's two-component values are at i + 1.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.friction import (
    couple_force,
    joint_friction_coefficient,
    joint_friction_moment,
    joint_friction_power,
    link_turning,
)
from ..physics.link import has_uneven_links, link_force, uneven_link_force
from ..structs import types
from ..sums import next_index, previous_index
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class JointFunctions:
    """CPU joint functions."""

    find_link_forces: wp.Function
    find_joint_moments: wp.Function
    add_couple_forces: wp.Function
    add_friction_powers: wp.Function
    friction_power: wp.Function


@cache
def joint_functions(Real: type, capacity: int) -> JointFunctions:
    """CPU joint functions."""
    kinds = types(Real)
    Chain = kinds.Chain
    vec2 = kinds.vec2
    rollers = roller_functions(Real, capacity)
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def store_turn_rate(w: wp.array[Real], i: int, d: vec2, v: vec2):
        """Stores rate of turning and n / L of link `i`."""
        lever, turn = link_turning(d, v)
        access.store(w, row.turn_rate + i, turn)
        access.store(w, row.couple_x + i + 1, lever[0])
        access.store(w, row.couple_y + i + 1, lever[1])

    @wp.func
    def find_link_forces(w: wp.array[Real], n: int, chain: Chain):
        """Stores tension, force and turning of links with joints in CPU rows; clears contact forces."""
        rollers.repeat_first_roller(w, n)
        i = int(0)
        if not has_uneven_links(chain):
            while i < access.round_up(n):
                d, v = rollers.link_vector(w, i), rollers.link_velocity(w, i)
                tension, rate, u = link_force(d, v, access.load(w, row.length + i), chain)
                rollers.store_link_force(w, i, tension, rate, u)
                store_turn_rate(w, i, d, v)
                i = i + 1
        while i < access.round_up(n):
            d, v = rollers.link_vector(w, i), rollers.link_velocity(w, i)
            tension, rate, u = uneven_link_force(d, v, access.load(w, row.length + i), i, chain)
            rollers.store_link_force(w, i, tension, rate, u)
            store_turn_rate(w, i, d, v)
            i = i + 1
        if chain.absent > 0:  # in its place, what holds the ends does not turn
            access.store(w, row.turn_rate + chain.absent - 1, Real(0.0))
            access.store(w, row.couple_x + chain.absent, Real(0.0))
            access.store(w, row.couple_y + chain.absent, Real(0.0))
        access.store(w, row.link_x, access.load(w, row.link_x + n))
        access.store(w, row.link_y, access.load(w, row.link_y + n))

    @wp.func
    def find_joint_moment(w: wp.array[Real], i: int, mu: Real, chain: Chain, memory: kinds.Memory):
        """Stores friction moment and bristle of the joint after link `i` in rows."""
        tension, turn = access.load(w, row.tension + i), access.load(w, row.turn_rate + i)
        tension_after, turn_after = access.load(w, row.tension + i + 1), access.load(w, row.turn_rate + i + 1)
        held = access.load(w, row.joint_bristle + i + 1)
        moment, holds = joint_friction_moment(
            mu, tension, turn, tension_after, turn_after, held, chain, memory.stretch_part
        )
        access.store(w, row.moment + i + 1, moment)
        access.store(w, row.joint_bristle + i + 1, wp.where(memory.stage == 0, holds, held))

    @wp.func
    def find_joint_moments(w: wp.array[Real], n: int, chain: Chain, memory: kinds.Memory):
        """Stores friction moments and bristles of all joints in rows."""
        access.store(w, row.tension + n, access.load(w, row.tension))
        access.store(w, row.turn_rate + n, access.load(w, row.turn_rate))
        mu = chain.joint.mu_dynamic
        i = int(0)
        if chain.joint.mu_static == mu:
            while i < access.round_up(n):
                find_joint_moment(w, i, mu, chain, memory)
                i = i + 1
        while i < n:
            mu = joint_friction_coefficient(
                access.load(w, row.turn_rate + i), access.load(w, row.turn_rate + i + 1), chain
            )
            find_joint_moment(w, i, mu, chain, memory)
            i = i + 1
        access.store(w, row.moment, access.load(w, row.moment + n))

    @wp.func
    def add_couple_forces(w: wp.array[Real], n: int):
        """Adds the couple of its joints' friction to every link's force."""
        i = int(0)
        while i < access.round_up(n):
            lever = vec2(access.load(w, row.couple_x + i + 1), access.load(w, row.couple_y + i + 1))
            force = couple_force(access.load(w, row.moment + i), access.load(w, row.moment + i + 1), lever)
            access.store(w, row.couple_x + i + 1, force[0])
            access.store(w, row.couple_y + i + 1, force[1])
            access.store(w, row.link_x + i + 1, access.load(w, row.link_x + i + 1) + force[0])
            access.store(w, row.link_y + i + 1, access.load(w, row.link_y + i + 1) + force[1])
            i = i + 1
        for k in range(2):
            access.store(
                w, row.link_x + k * wp.static(capacity), access.load(w, row.link_x + k * wp.static(capacity) + n)
            )
            access.store(
                w, row.couple_x + k * wp.static(capacity), access.load(w, row.couple_x + k * wp.static(capacity) + n)
            )

    @wp.func
    def add_friction_powers(w: wp.array[Real], n: int, chain: Chain, lag: Real, share: Real):
        """Adds the powers of joints' friction to rollers' tallies, at a leapfrog step's mean velocities.

        `lag` [s] is from velocities to forces, `share` the step's part.
        """
        i = int(0)
        while i < access.round_up(n):
            ax, ay = rollers.acceleration_components(w, i, chain.inverse_mass, chain.gravity)
            x = access.load(w, row.couple_x + i + 1) - access.load(w, row.couple_x + i)
            y = access.load(w, row.couple_y + i + 1) - access.load(w, row.couple_y + i)
            given = x * (access.load(w, row.vx + i) + lag * ax) + y * (access.load(w, row.vy + i) + lag * ay)
            access.store(w, row.joint_friction + i, access.load(w, row.joint_friction + i) - share * given)
            i = i + 1

    @wp.func
    def turn_rate(w: wp.array[Real], i: int, n: int, chain: Chain, lag: Real):
        """Rate of turning [rad/s] of link `i` in rows, `lag` [s] after the velocities' instant."""
        mine = rollers.acceleration(w, i, chain.inverse_mass, chain.gravity)
        of_next = rollers.acceleration(w, next_index(i, n), chain.inverse_mass, chain.gravity)
        lever, turn = link_turning(rollers.link_vector(w, i), rollers.link_velocity(w, i) + lag * (of_next - mine))
        return wp.where(i + 1 == chain.absent, Real(0.0), turn)

    @wp.func
    def friction_power(w: wp.array[Real], i: int, n: int, chain: Chain, lag: Real):
        """Power [W] that joint `i` in CPU rows dissipates, as added by `add_friction_powers`."""
        turn = turn_rate(w, i, n, chain, lag)
        return joint_friction_power(
            access.load(w, row.moment + i), turn_rate(w, previous_index(i, n), n, chain, lag), turn
        )

    return JointFunctions(
        find_link_forces=find_link_forces,
        find_joint_moments=find_joint_moments,
        add_couple_forces=add_couple_forces,
        add_friction_powers=add_friction_powers,
        friction_power=friction_power,
    )
