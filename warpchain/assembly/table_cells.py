"""Tables of motions, loads and lifts as cubics on a uniform grid, for kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.body_ties import body_names
from warpchain.drive.motion_table import PlaceColumn, SpeedTable, Table
from warpchain.drive.valves import LiftCurve
from warpchain.model.trains import body_speed_ratio

if TYPE_CHECKING:
    from warpchain.model import ChainModel

Array = NDArray[np.float64]

Tabled = Table | PlaceColumn | LiftCurve

MOST_CELLS = 2**17
FINEST = 1000  # parts of the smallest distance between rows tried as spacing
_COMMON = 1e-6  # of a spacing: rows this near to the grid are on it


@dataclass(frozen=True)
class TableCells:
    """Table on a uniform grid: `kernels.structs.Tabulated` and its values.

    Attributes:
        start, spacing: of the grid [s], or [rad] of the sprocket's own angle.
        coefficients: (cells, 4) of each cell's cubic, by powers of the place in it, 0 to 1.
        integral: (cells + 1,) from 0 to each cell's beginning, and the end.
        over_angle, repeats: see `kernels.structs.Tabulated`.
    """

    start: float
    spacing: float
    coefficients: Array
    integral: Array
    over_angle: bool = False
    repeats: bool = False

    def values(self) -> Array:
        """Values of a table for kernels: five a cell, and the whole integral."""
        cells = np.column_stack([self.coefficients, self.integral[:-1]])
        return np.append(cells.ravel(), self.integral[-1])

    def fill(self, row: Any, first: int) -> None:
        """Fills a `kernels.structs.Tabulated` whose values begin at `first`."""
        row["cells"], row["first"] = len(self.coefficients), first
        row["over_angle"], row["repeats"] = self.over_angle, self.repeats
        row["start"], row["spacing"] = self.start, self.spacing


class TableList:
    """Values of all tables of an ensemble, each table once."""

    def __init__(self) -> None:
        self.blocks: list[Array] = []
        self.length = 0
        self.rows: dict[tuple[tuple[float, ...], ...], int] = {}
        self.known: dict[tuple[Tabled, float], tuple[TableCells, int]] = {}
        self.seen: dict[
            tuple[int, float], tuple[Tabled, TableCells, int]
        ] = {}  # by identity: long tables are slow to hash

    def add(self, row: Any, table: Tabled, ratio: float) -> None:
        """Fills a `kernels.structs.Tabulated`; `ratio` is the sprocket's angle over the table's."""
        if (id(table), ratio) not in self.seen:
            self.seen[id(table), ratio] = (table, *self._find(table, ratio))
        _, cells, first = self.seen[id(table), ratio]
        cells.fill(row, first)

    def _find(self, table: Tabled, ratio: float) -> tuple[TableCells, int]:
        """Cells of a table, and their values' index in the list."""
        key = (table, ratio)
        if key not in self.known:
            cells = table_cells(table, ratio)
            self.known[key] = cells, self.length
            self.blocks.append(cells.values())
            self.length += len(self.blocks[-1])
        return self.known[key]

    def add_rows(self, rows: tuple[tuple[float, ...], ...]) -> int:
        """Adds rows that kernels read as they are; returns their index."""
        if rows not in self.rows:
            self.rows[rows] = self.length
            self.blocks.append(np.ravel(rows))
            self.length += len(self.blocks[-1])
        return self.rows[rows]

    def array(self) -> Array:
        """Values of all tables; a zero for none."""
        return np.concatenate(self.blocks) if self.blocks else np.zeros(1)


def shaft_ratio(model: ChainModel, s: int, shaft: str | None) -> float:
    """Angle of body s over that of the shaft named `shaft`; 1 for None."""
    return 1.0 if shaft is None else body_speed_ratio(model, s, body_names(model).index(shaft))


def initial_speed(table: SpeedTable) -> float:
    """Forward speed of a speed table at t = 0 [rad/s]."""
    if table.time is not None and table.over[0] >= 0.0:
        return table.factor * table.speed[0]
    over, values = np.array(table.over), np.array(table.values)
    at = 0.0 if table.time is not None else over[0] + np.mod(-over[0], 2.0 * math.pi * table.revolutions)
    return float(hermite(over, values, table_slopes(table), np.clip([at], over[0], over[-1]))[0][0])


def table_cells(table: Tabled, ratio: float) -> TableCells:
    """Cells of a table on a uniform grid; speeds over angle become ones over time."""
    over, values, slopes = np.array(table.over), np.array(table.values), table_slopes(table)
    if table.angle is None:
        return _cells_from_origin(*_uniform_grid(over, values, slopes), False, False)
    over, slopes = over * ratio, None if slopes is None else slopes / ratio
    period = 2.0 * math.pi * table.revolutions * ratio
    over = over[0] + (over - over[0]) * (period / (over[-1] - over[0]))
    if isinstance(table, SpeedTable):
        return _cells_over_time(over, values, slopes, period)
    return _cells_from_origin(*_uniform_grid(over, values, slopes), True, True)


def table_slopes(table: Tabled) -> Array | None:
    """Slopes at a table's rows, by PCHIP or spline; None for straight lines."""
    if isinstance(table, PlaceColumn | LiftCurve):
        return np.asarray(table.spline(table.over, 1))
    if table.interpolation == "linear":
        return None
    from scipy.interpolate import PchipInterpolator  # here, since it takes a quarter of a second

    x, y = np.array(table.over), np.array(table.values)
    if table.angle is None or len(x) == 2:
        return np.asarray(PchipInterpolator(x, y)(x, 1))
    before, after = x[0] - (x[-1] - x[-2]), x[-1] + (x[1] - x[0])
    beyond = PchipInterpolator(np.concatenate([[before], x, [after]]), np.concatenate([[y[-2]], y, [y[1]]]))
    return np.asarray(beyond(x, 1))


def hermite(x: Array, y: Array, slopes: Array | None, at: Array) -> tuple[Array, Array]:
    """Value and slope at `at` of a table's cubic by row slopes, None for straight lines."""
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    step, rise = x[k + 1] - x[k], y[k + 1] - y[k]
    u = (at - x[k]) / step
    if slopes is None:
        return np.asarray(y[k] + u * rise), np.asarray(rise / step)
    c1, m1 = step * slopes[k], step * slopes[k + 1]
    c2, c3 = 3.0 * rise - 2.0 * c1 - m1, c1 + m1 - 2.0 * rise
    return y[k] + u * (c1 + u * (c2 + u * c3)), (c1 + u * (2.0 * c2 + 3.0 * u * c3)) / step


def _grid_spacing(x: Array) -> tuple[float, int]:
    """Spacing and number of cells of a uniform grid for rows at x."""
    gap, span = float(np.diff(x).min()), float(x[-1] - x[0])
    for parts in range(1, FINEST + 1):
        cells = round(span / gap * parts)
        if cells > MOST_CELLS:
            break
        places = (x - x[0]) * (cells / span)
        if np.abs(places - np.rint(places)).max() < _COMMON:
            return span / cells, cells
    cells = min(MOST_CELLS, math.ceil(64.0 * span / gap))
    return span / cells, cells


def _uniform_grid(x: Array, y: Array, slopes: Array | None) -> tuple[float, float, Array]:
    """Start, spacing and cubic coefficients of a table on its uniform grid."""
    spacing, cells = _grid_spacing(x)
    grid = x[0] + spacing * np.arange(cells + 1)
    grid[-1] = x[-1]
    places = np.rint((x - x[0]) / spacing).astype(int)
    on = np.abs((x - x[0]) / spacing - places) < _COMMON
    grid[places[on]] = x[on]
    value, slope = hermite(x, y, slopes, grid)
    return float(x[0]), spacing, _cell_coefficients(value, None if slopes is None else slope * spacing)


def _cell_coefficients(value: Array, slope: Array | None) -> Array:
    """Coefficients (cells, 4) of table cells from grid values and slopes, None for straight lines."""
    rise = np.diff(value)
    if slope is None:
        return np.column_stack([value[:-1], rise, 0.0 * rise, 0.0 * rise])
    left, right = slope[:-1], slope[1:]
    return np.column_stack([value[:-1], left, 3.0 * rise - 2.0 * left - right, left + right - 2.0 * rise])


def _cells_from_origin(
    start: float, spacing: float, coefficients: Array, over_angle: bool, repeats: bool
) -> TableCells:
    """Table cells with integrals from 0 of the axis."""
    parts = spacing * (coefficients @ [1.0, 0.5, 1.0 / 3.0, 0.25])
    integral = np.append(0.0, np.cumsum(parts))
    if not repeats:
        within = min(max(-start / spacing, 0.0), float(len(parts)))
        cell = min(int(within), len(parts) - 1)
        u = within - cell
        c0, c1, c2, c3 = coefficients[cell]
        value = c0 + u * (c1 + u * (c2 + u * c3))
        origin = integral[cell] + spacing * u * (c0 + u * (c1 / 2.0 + u * (c2 / 3.0 + u * c3 / 4.0)))
        integral = integral - (origin + (-start / spacing - within) * spacing * value)
    return TableCells(start, spacing, coefficients, integral, over_angle, repeats)


def _cells_over_time(over: Array, speed: Array, slopes: Array | None, period: float) -> TableCells:
    """Cells of a speed over angle, as a periodic one over time."""
    begin = float(over[0])
    rows = np.unique(np.append(np.mod(over, period), [0.0, period]))
    parts = min(32, max(4, MOST_CELLS // (2 * len(rows))))
    phi = np.append((rows[:-1, None] + np.diff(rows)[:, None] / parts * np.arange(parts)).ravel(), period)
    node, weight = np.polynomial.legendre.leggauss(5)
    half = 0.5 * np.diff(phi)[:, None]

    def speed_and_slope(angle: Array) -> tuple[Array, Array]:
        """Speed Omega [rad/s] at angles [rad], and its slope over the angle [1/s]."""
        return hermite(over, speed, slopes, begin + np.mod(angle - begin, period))

    inside = phi[:-1, None] + half * (1.0 + node)
    time = np.append(0.0, np.cumsum((half * weight / speed_and_slope(inside)[0]).sum(axis=1)))
    cells = min(MOST_CELLS, max(1024, len(phi)))
    at, _ = hermite(time, phi, speed_and_slope(phi)[0], np.linspace(0.0, time[-1], cells + 1))
    value, slope = speed_and_slope(at)
    value[-1] = value[0]
    spacing = float(time[-1]) / cells
    coefficients = _cell_coefficients(value, value * slope * spacing)
    table = _cells_from_origin(0.0, spacing, coefficients, False, True)
    return _cells_from_origin(0.0, spacing, coefficients * (period / table.integral[-1]), False, True)
