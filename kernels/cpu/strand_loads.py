"""Goods on a strand of a variant's chain on the CPU: rollers' masses, and forces of taking goods on."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.strand_load import carried_relative_mass, feed_rate_and_force, goods_power
from ..structs import types
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class StrandLoadFunctions:
    """CPU strand load functions."""

    carry_goods: wp.Function
    power_of_goods: wp.Function


@cache
def strand_load_functions(Real: type, capacity: int) -> StrandLoadFunctions:
    """CPU strand load functions."""
    kinds = types(Real)
    Chain, vec2 = kinds.Chain, kinds.vec2
    rollers = roller_functions(Real, capacity)
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def carry_goods(state: kinds.State, w: wp.array[Real], first: int, n: int, step: Real, chain: Chain):
        """Sets masses of rollers with goods on a strand, and adds forces of taking goods on."""
        for i in range(n):
            position = vec2(access.load(w, row.x + i), access.load(w, row.y + i))
            velocity = vec2(access.load(w, row.vx + i), access.load(w, row.vy + i))
            relative = state.relative_mass[first + i] + carried_relative_mass(position, chain.load)
            access.store(w, row.relative_mass + i, relative)
            access.store(w, row.mobility + i, Real(1.0) / relative)
            rate, force = feed_rate_and_force(position, velocity, step, chain)
            access.store(w, row.fx + i, access.load(w, row.fx + i) + force[0])
            access.store(w, row.fy + i, access.load(w, row.fy + i) + force[1])

    @wp.func
    def power_of_goods(w: wp.array[Real], n: int, chain: Chain, step: Real, back: Real):
        """Power [W] that goods bring to rollers, `back` [s] after the velocities' instant."""
        total = wp.float64(0.0)
        for i in range(n):
            a = rollers.acceleration(w, i, chain.inverse_mass, chain.gravity)
            position = vec2(access.load(w, row.x + i), access.load(w, row.y + i))
            velocity = vec2(access.load(w, row.vx + i) + back * a[0], access.load(w, row.vy + i) + back * a[1])
            total += wp.float64(goods_power(position, velocity, step, chain))
        return total

    return StrandLoadFunctions(carry_goods=carry_goods, power_of_goods=power_of_goods)
