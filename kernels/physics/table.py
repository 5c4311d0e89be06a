"""Speeds and torques tabulated over time or angle: a cubic in every cell of a uniform grid, and its exact integral.

A table stands in the ensemble's list as five values a cell, c_0 .. c_3 and the integral F before the cell, then the
integral over all cells. With u the place in a cell, 0 to 1, and d the cells' length,

    f = c_0 + c_1 u + c_2 u^2 + c_3 u^3,    F = F_cell + d (c_0 u + c_1 u^2 / 2 + c_2 u^3 / 3 + c_3 u^4 / 4).

Beyond its ends a table keeps the value there, or begins anew.
"""

import warp as wp

from ..structs import Tabulated

CELL_VALUES = wp.constant(5)


@wp.func
def table_at(x: wp.float64, table: Tabulated, values: wp.array[wp.float64]):
    """Value, integral from x = 0 and slope of a table at `x`."""
    u = (x - table.start) / table.spacing
    cells = wp.float64(table.cells)
    rounds = wp.float64(0.0)
    if table.repeats == 1:
        rounds = wp.floor(u / cells)
        u = u - rounds * cells
    within = wp.clamp(u, wp.float64(0.0), cells)
    if not (within >= wp.float64(0.0)):  # no number: the variant is diverging
        within = wp.float64(0.0)
    cell = wp.min(int(within), table.cells - 1)
    at = table.first + CELL_VALUES * cell
    w = within - wp.float64(cell)
    c1 = values[at + 1]
    c2 = values[at + 2]
    c3 = values[at + 3]
    value = values[at] + w * (c1 + w * (c2 + w * c3))
    slope = (c1 + w * (wp.float64(2.0) * c2 + wp.float64(3.0) * w * c3)) / table.spacing
    c1 = c1 / wp.float64(2.0)
    c2 = c2 / wp.float64(3.0)
    c3 = c3 / wp.float64(4.0)
    integral = values[at + 4] + table.spacing * w * (values[at] + w * (c1 + w * (c2 + w * c3)))
    integral = integral + rounds * values[table.first + CELL_VALUES * table.cells]
    integral = integral + (u - within) * table.spacing * value
    if u != within:
        slope = wp.float64(0.0)
    return value, integral, slope
