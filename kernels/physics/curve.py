r"""Tabulated speeds and torques at float32 without float64: `table` in pairs.

The place in the table, what of it is in its cell, and the integral are pairs, so that an angle that a tabulated speed
leads is as smooth as others; a torque is float32.
"""

import warp as wp

from ..number import Pair, exact_product, minus, pair, pair_of, plus, split, times
from ..structs import SplitTable
from .table import CELL_VALUES

THIRD = split(1 / 3)


@wp.func
def floor_of(a: Pair):
    """The whole number at or below a pair, as float32."""
    whole = wp.floor(a.high)
    return wp.where(whole == a.high and a.low < 0.0, whole - 1.0, whole)


@wp.func
def cell_at(x: Pair, table: SplitTable):
    """Where `x` is in a table: cell, place in it from 0 to 1, cells beyond the ends, and how often it began anew."""
    u = times(plus(x, minus(table.start)), table.rate)
    cells = float(table.cells)
    rounds = float(0.0)
    if table.repeats == 1:
        rounds = wp.floor(u.high / cells)
        u = plus(u, minus(exact_product(rounds, cells)))
        past = floor_of(u)
        if past < 0.0:  # the quotient was rounded
            rounds = rounds - 1.0
            u = plus(u, cells)
        if past >= cells:
            rounds = rounds + 1.0
            u = plus(u, -cells)
    within = u
    if not (floor_of(u) >= 0.0):  # before it, or no number: the variant is diverging
        within = pair_of(float(0.0))
    if floor_of(u) >= cells:
        within = pair_of(cells)
    cell = wp.min(int(floor_of(within)), table.cells - 1)
    return cell, plus(within, -float(cell)), plus(u, minus(within)), rounds


@wp.func
def value_of(values: wp.array[wp.vec2f], i: int):
    """Number i of the tables."""
    parts = values[i]
    return pair(parts[0], parts[1])


@wp.func
def value_at(x: Pair, table: SplitTable, values: wp.array[wp.vec2f]):
    """Value of a table at `x`."""
    cell, place, beyond, rounds = cell_at(x, table)
    at = table.first + CELL_VALUES * cell
    w = place.high
    return values[at][0] + w * (values[at + 1][0] + w * (values[at + 2][0] + w * values[at + 3][0]))


@wp.func
def slope_at(x: Pair, table: SplitTable, values: wp.array[wp.vec2f]):
    """Slope of a table at `x`."""
    cell, place, beyond, rounds = cell_at(x, table)
    at = table.first + CELL_VALUES * cell
    w = place.high
    slope = (values[at + 1][0] + w * (2.0 * values[at + 2][0] + 3.0 * w * values[at + 3][0])) * table.rate.high
    return wp.where(beyond.high == 0.0, slope, 0.0)


@wp.func
def integral_at(x: Pair, table: SplitTable, values: wp.array[wp.vec2f]):
    """Value and integral from x = 0 of a table at `x`, as pairs."""
    cell, w, beyond, rounds = cell_at(x, table)
    at = table.first + CELL_VALUES * cell
    c0 = value_of(values, at)
    c1 = value_of(values, at + 1)
    c2 = value_of(values, at + 2)
    c3 = value_of(values, at + 3)
    value = plus(c0, times(w, plus(c1, times(w, plus(c2, times(w, c3))))))
    third = pair(wp.static(THIRD[0]), wp.static(THIRD[1]))
    mean = plus(times(c1, 0.5), times(w, plus(times(c2, third), times(times(w, c3), 0.25))))
    way = plus(times(w, plus(c0, times(w, mean))), times(beyond, value))
    integral = plus(value_of(values, at + 4), times(table.spacing, way))
    ending = value_of(values, table.first + CELL_VALUES * table.cells)
    return value, plus(integral, times(ending, rounds))
