"""Tables of speeds and torques over time or angle, and of displacements over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from warpchain.drive.schema import BARE, Column, Finite, Name, Part, Problem, Value, are_numbers, node_list, node_value
from warpchain.drive.stack_math import array_of_columns

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from scipy.interpolate import CubicSpline

Interpolation = Annotated[Literal["linear", "cubic"], Value('must be "linear" or "cubic" (monotone between rows)')]
Factor = Finite

TURN_TOLERANCE = 1e-3
"""Revolutions by which a table's angles may miss whole ones."""

MOST_ROWS = 1_000_000

SAMPLES = 720
"""Samples of a revolution in a table's spectrum."""
NOTABLE = 0.05
"""Least share of a ripple in a spectrum's largest part [-]."""


def slowest_ripple(spectrum: NDArray[np.complexfloating]) -> int:
    """Periods of a spectrum's slowest notable part."""
    size = abs(spectrum[1:])
    return 1 + int((size >= NOTABLE * size.max()).argmax())


@lru_cache(maxsize=64)
def _slowest_ripple_of_column(angle: tuple[float, ...], column: tuple[float, ...], revolutions: int) -> int:
    """Periods of a table column's slowest ripple."""
    import numpy as np  # here, since drives are read without it

    over = np.linspace(angle[0], angle[-1], SAMPLES * revolutions, endpoint=False)
    return slowest_ripple(np.fft.rfft(np.interp(over, angle, column)))


class Table(Part):
    """A quantity over time or angle, row by row.

    Attributes:
        time: instants [s], ascending; outside them the nearest row holds.
        angle: forward angle since the start [rad] over whole revolutions; then it repeats.
        shaft: sprocket or shaft whose revolutions `angle` counts; None is the part's own.
        interpolation: "linear", or "cubic", a monotone cubic.
        factor: factor of the quantity.
    """

    time: Column | None = None
    angle: Column | None = None
    shaft: Name | None = None
    interpolation: Interpolation = "linear"
    factor: Factor = 1.0

    _quantity: ClassVar[str] = ""
    _axes: ClassVar[tuple[str, ...]] = ("time", "angle")

    @property
    def over(self) -> tuple[float, ...]:
        """Column that the table is over: times, angles or speeds."""
        return next(tuple(column) for key in self._axes if (column := getattr(self, key)) is not None)

    @property
    def values(self) -> tuple[float, ...]:
        """Column of the table's quantity times its factor."""
        return tuple(self.factor * value for value in getattr(self, self._quantity))

    @property
    def revolutions(self) -> int:
        """Revolutions that the table's angles span."""
        return round((self.over[-1] - self.over[0]) / (2.0 * math.pi))

    @property
    def slowest_order(self) -> float | None:
        """Periods per revolution of the table's slowest ripple, or None."""
        column = getattr(self, self._quantity)
        if self.angle is None or min(column) == max(column):
            return None
        return _slowest_ripple_of_column(self.angle, column, self.revolutions) / self.revolutions

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a table's columns."""
        given = [key for key in cls._axes if node_value(node, key) is not None]
        if node_value(node, "file") is not None:
            text = "only drive files name a file; give the columns themselves, such as time and " + cls._quantity
            yield Problem(("file",), node_value(node, "file"), text)
            return
        if not given:
            others = " or ".join((*cls._axes[1:], "file"))
            yield Problem(("time",), None, f"missing; must be a list of numbers, or give {others} instead", BARE)
        for key in given[1:]:
            yield Problem((key,), node_value(node, key), f"not together with {given[0]}; give one of the two")
        if node_value(node, "shaft") is not None and "angle" not in given:
            yield Problem(("shaft",), node_value(node, "shaft"), "only together with angle")
        values = node_list(node, cls._quantity)
        for key in given:
            over = node_list(node, key)
            if len(over) > MOST_ROWS:
                yield Problem((key,), None, f"has {len(over)} elements; must have at most {MOST_ROWS}", BARE)
                return
            if not (are_numbers(*over) and are_numbers(*values)) or len(over) < 2:
                return
            if len(values) != len(over):
                yield Problem((cls._quantity,), list(values), f"must have as many elements as {key}, {len(over)}")
            falling = list(ascending_rules(key, over))
            if falling:
                yield from falling
                return
            if key == "angle" and len(values) == len(over):
                yield from _closing_rules(over, values, cls._quantity)


def _closing_rules(over: Any, values: Any, quantity: str) -> Iterator[Problem]:
    """Problems of a table over angle that does not close."""
    turns = (over[-1] - over[0]) / (2.0 * math.pi)
    last = len(over) - 1
    if round(turns) < 1 or abs(turns - round(turns)) > TURN_TOLERANCE:
        text = f"must be a whole number of revolutions after the first, {over[0]:g} rad; it is {turns:.4g} after it"
        yield Problem(("angle", last), over[last], text)
    elif values[last] != values[0]:
        text = f"must repeat the first element, {values[0]:g}, where the next revolution begins"
        yield Problem((quantity, last), values[last], text)


class PlaceTable(Part):
    """Displacement of a center or pivot over time, a cubic spline that ends at rest.

    Attributes:
        time: instants [s], ascending; before the first it rests.
        x: displacement to the right [m], 0 in the first row; None is 0.
        y: displacement upward [m], 0 in the first row; None is 0.
        factor: factor of the displacements.
    """

    time: Column
    x: Column | None = None
    y: Column | None = None
    factor: Factor = 1.0

    def displacement_along(self, axis: str) -> PlaceColumn | None:
        """Displacement along "x" or "y"; None where it is 0."""
        column = getattr(self, axis)
        if column is None:
            return None
        return PlaceColumn(self.time, tuple(self.factor * place for place in column))

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacements (..., 2) at instants (...) [m]."""
        within = time.clip(self.time[0], self.time[-1])
        columns = (self.displacement_along(axis) for axis in "xy")
        x, y = (0.0 * within if column is None else column.spline(within) for column in columns)
        return array_of_columns((x, y))

    @property
    def start_velocity(self) -> tuple[float, float]:
        """Velocity of the displacement at t = 0 [m/s]."""
        columns = (self.displacement_along(axis) for axis in "xy")
        x, y = (0.0 if column is None else float(column.spline(0.0, 1)) for column in columns)
        return (x, y) if self.time[0] == 0.0 else (0.0, 0.0)

    @property
    def largest_displacement(self) -> float:
        """Upper bound of the table's displacement [m]."""
        return math.hypot(*(abs(self.factor) * max(map(abs, of), default=0.0) for of in (self.x or (), self.y or ())))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a displacement table's columns."""
        if node_value(node, "file") is not None:
            yield Problem(
                ("file",), node_value(node, "file"), "only drive files name a file; give the columns themselves"
            )
            return
        time = node_list(node, "time")
        if node_value(node, "x") is None and node_value(node, "y") is None:
            yield Problem(("x",), None, "missing; must be a list of numbers, or give y instead", BARE)
        if are_numbers(*time):
            if len(time) > MOST_ROWS:
                yield Problem(("time",), None, f"has {len(time)} elements; must have at most {MOST_ROWS}", BARE)
                return
            if time and time[0] < 0.0:
                yield Problem(("time", 0), time[0], "must be at least 0, when the run begins")
            yield from ascending_rules("time", time)
        for axis in ("x", "y"):
            column = node_list(node, axis)
            if node_value(node, axis) is not None and time and len(column) != len(time):
                yield Problem((axis,), list(column), f"must have as many elements as time, {len(time)}")
            if are_numbers(*column) and column and column[0] != 0.0:
                yield Problem((axis, 0), column[0], "must be 0: it begins where it is drawn")


@dataclass(frozen=True)
class PlaceColumn:
    """Displacement along one axis over time.

    Attributes:
        over: instants [s].
        values: displacements [m].
    """

    over: tuple[float, ...]
    values: tuple[float, ...]
    angle: ClassVar[None] = None

    @property
    def spline(self) -> CubicSpline:
        """Spline through the displacement's rows."""
        from scipy.interpolate import CubicSpline  # here, since it takes a quarter of a second

        start = "not-a-knot" if self.over[0] == 0.0 else (1, 0.0)
        return CubicSpline(self.over, self.values, bc_type=(start, (1, 0.0)))


def ascending_rules(key: str, over: Any) -> Iterator[Problem]:
    """Problem of a table column's first number that does not ascend."""
    for i in range(1, len(over)):
        if over[i] <= over[i - 1]:
            yield Problem((key, i), over[i], f"must be above the element before, {over[i - 1]:g}")
            return


class SpeedTable(Table):
    """Forward angular speed over time or over the angle turned.

    Attributes:
        speed: forward speed [rad/s].
    """

    speed: Column

    _quantity: ClassVar[str] = "speed"

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a speed table's columns."""
        yield from super()._rules(node)
        over_angle, speeds = node_value(node, "angle") is not None, node_list(node, "speed")
        for i, value in enumerate(speeds if over_angle else ()):
            if are_numbers(value) and value <= 0.0:
                yield Problem(("speed", i), value, "must be above 0 over angle")
        if not over_angle and speeds and are_numbers(*speeds) and min(speeds) < 0.0 >= max(speeds):
            text = "must have a positive element; forward is the sense of wrap, and negative speeds are backward"
            yield Problem(("speed",), list(speeds), text)
        factor = node_value(node, "factor")
        if are_numbers(factor) and factor <= 0.0:
            yield Problem(("factor",), factor, "must be a positive number")


class TorqueTable(Table):
    """Torque against forward rotation over time or over the angle turned.

    Attributes:
        torque: moment against forward rotation [N m].
    """

    torque: Column

    _quantity: ClassVar[str] = "torque"


class MotorTable(Table):
    """Torque of a motor over its forward speed, over time or over the angle turned.

    Attributes:
        speed: forward speeds [rad/s], ascending; outside them the nearest row holds.
        torque: moment in the direction of forward rotation [N m].
    """

    speed: Column | None = None
    torque: Column

    _quantity: ClassVar[str] = "torque"
    _axes: ClassVar[tuple[str, ...]] = ("time", "angle", "speed")


class ClutchTable(Table):
    """Moment at which a clutch or brake slips, over time or speed.

    Attributes:
        speed: magnitudes of speed [rad/s], ascending; outside them the nearest row holds.
        torque: moment at which it slips [N m].
    """

    speed: Column | None = None
    torque: Column

    _quantity: ClassVar[str] = "torque"
    _axes: ClassVar[tuple[str, ...]] = ("time", "speed")

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a clutch table's columns."""
        if node_value(node, "angle") is not None:
            yield Problem(("angle",), None, "not of a clutch; must be over time or speed", BARE)
        else:
            yield from (problem for problem in super()._rules(node) if problem.path != ("shaft",))
        if node_value(node, "shaft") is not None:
            yield Problem(
                ("shaft",), node_value(node, "shaft"), "not of a clutch, whose speed is that of a shaft it is between"
            )
        speed, values, factor = node_list(node, "speed"), node_list(node, "torque"), node_value(node, "factor")
        if speed and are_numbers(speed[0]) and speed[0] < 0.0:
            yield Problem(("speed", 0), speed[0], "must be at least 0: it is a magnitude")
        for i, value in enumerate(values):
            if are_numbers(value) and value < 0.0:
                yield Problem(("torque", i), value, "must be at least 0")
        if are_numbers(factor) and factor <= 0.0:
            yield Problem(("factor",), factor, "must be a positive number")
        if values and are_numbers(*values) and not any(values):
            yield Problem(("torque",), list(values), "must have one above 0; without any the clutch bears nothing")


class SupplyTable(Table):
    """Pressure of an oil supply over time, or over the pump's forward speed.

    Attributes:
        speed: forward speeds [rad/s], ascending; outside them the nearest row holds.
        shaft: sprocket or shaft that turns the pump; None is the chain's leader.
        pressure: absolute pressure of the supply [Pa].
    """

    speed: Column | None = None
    pressure: Column

    _quantity: ClassVar[str] = "pressure"
    _axes: ClassVar[tuple[str, ...]] = ("time", "speed")

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of an oil supply table's columns."""
        if node_value(node, "angle") is not None:
            yield Problem(("angle",), None, "no pressure is over angle; give time or speed instead", BARE)
        else:
            yield from (problem for problem in super()._rules(node) if problem.path != ("shaft",))
        if node_value(node, "shaft") is not None and node_value(node, "speed") is None:
            yield Problem(("shaft",), node_value(node, "shaft"), "only together with speed")


TABLES = (Table, PlaceTable)
