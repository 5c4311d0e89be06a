"""Shafts that sprockets turn with, gear pairs, couplings, motors (docs/shafts.md).

Forward is the way the chain turns a shaft, else counter-clockwise. Couplings are also gearboxes, clutches, freewheels,
brakes and backstops.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field

from warpchain.drive.motion_table import ClutchTable, MotorTable, Table
from warpchain.drive.schema import (
    BARE,
    Column,
    Name,
    NonNegative,
    Part,
    Positive,
    Problem,
    Switch,
    Value,
    allowed_text,
    are_numbers,
    node_list,
    node_value,
    plain_sequence,
)
from warpchain.drive.sprocket import MOST_TEETH, ON_COUPLINGS, Load, Prescribed
from warpchain.drive.stack_math import Number, maximum, minimum

Names = Annotated[
    tuple[Name, Name],
    Field(strict=True),
    BeforeValidator(plain_sequence),
    Value("must be two names of shafts or sprockets [a, b]"),
]
FIXED = "ground"
"""Name of the ground in a coupling's `between`."""
_GearTeeth = Annotated[int, Field(strict=True, ge=5, le=MOST_TEETH)]
TeethPair = Annotated[
    tuple[_GearTeeth, _GearTeeth],
    Field(strict=True),
    BeforeValidator(plain_sequence),
    Value(f"must be two integers [a, b] from 5 to {MOST_TEETH}"),
]


def steepest_slope(table: Table, sign: float | None = None) -> float:
    """Steepest slope of a table: rising (`sign` 1.0), falling (-1.0), or either."""
    rows = list(zip(table.over, table.values, strict=True))
    slopes = [(n - m) / (w - v) for (v, m), (w, n) in pairwise(rows)]
    steepest = max(0.0, *(abs(slope) if sign is None else sign * slope for slope in slopes))
    return steepest * (1.5 if table.interpolation == "cubic" else 1.0)


class Governor(Part):
    """Governor of a motor: multiplies its moment by 1 + (speed - omega) / band.

    Attributes:
        speed: forward speed at which the factor is 1 [rad/s].
        band: further speed at which the moment is 0 [rad/s].
        most: largest factor.
    """

    speed: Positive
    band: Positive
    most: Annotated[float, Field(strict=True, ge=1.0, allow_inf_nan=False), Value("must be a number of at least 1")] = (
        1.0
    )

    def factor(self, speed: Number) -> Number:
        """Governor's factor of a motor's moment at a forward speed."""
        return minimum(maximum(1.0 + (self.speed - speed) / self.band, 0.0), self.most)


class Motor(Part):
    """Motor: a moment in the direction of forward rotation.

    Attributes:
        torque: constant, or largest, moment [N m]; this or a table.
        power: largest power [W].
        table: torque over forward speed, time or the angle turned.
        governor: controls its speed.
        ramp_time: time over which the moment comes on [s].
    """

    torque: Positive | None = None
    power: Positive | None = None
    table: MotorTable | None = None
    governor: Governor | None = None
    ramp_time: NonNegative = 0.0

    def at(self, speed: Number) -> Number:
        """Mean moment of the motor at a forward speed [N m]."""
        import numpy as np

        torque: Number = self.torque
        if self.table is not None and self.table.speed is not None:
            torque = np.interp(speed, self.table.over, self.table.values)
        elif self.table is not None:
            over, values = np.asarray(self.table.over), np.asarray(self.table.values)
            torque = float(np.sum(np.diff(over) * (values[1:] + values[:-1])) / (2.0 * (over[-1] - over[0])))
        if self.governor is not None:
            torque = torque * self.governor.factor(speed)
        if self.power is not None:
            torque = np.minimum(torque, self.power / np.maximum(speed, 1e-9))
        return torque

    def bounds(self, speed: Number) -> tuple[Number, Number]:
        """Least and largest moment of the motor at a speed [N m]."""
        if self.table is None or self.table.speed is not None:
            return self.at(speed), self.at(speed)
        factor = 1.0 if self.governor is None else self.governor.factor(speed)
        return factor * min(self.table.values), factor * max(self.table.values)

    @property
    def largest_moment(self) -> Number:
        """Largest magnitude of the motor's moment [N m]."""
        given: Number = self.torque if self.table is None else max(map(abs, self.table.values))
        return given if self.governor is None else self.governor.most * given

    @property
    def steepest_fall(self) -> float:
        """Steepest fall of the motor's moment with speed [N m s]."""
        fall = 0.0
        if self.table is not None and self.table.speed is not None:
            fall = steepest_slope(self.table, -1.0)
        if self.torque is not None and self.power is not None:
            fall = fall + self.torque**2 / self.power  # where the limits meet, P / w^2 at w = P / M
        if self.governor is not None:
            fall = self.governor.most * fall + self.largest_moment / (self.governor.most * self.governor.band)
        return fall

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a motor's torque, power and table."""
        torque, table = node_value(node, "torque"), node_value(node, "table")
        if torque is None and table is None:
            yield Problem(("torque",), None, f"missing; {allowed_text(cls, 'torque')}, or give table instead", BARE)
        for key in ("torque", "power"):
            if table is not None and node_value(node, key) is not None:
                yield Problem((key,), node_value(node, key), "not together with table")


class Shaft(Part):
    """A shaft, with or without sprockets on it.

    Attributes:
        name: unique among all parts.
        inertia: moment of inertia without its sprockets' [kg m^2]; needed unless prescribed.
        prescribed: prescribed motion.
        load: moment against forward rotation.
        motor: moment in the direction of forward rotation.
        initial_speed: forward speed at the start [rad/s]; None follows from ties, else rest.
    """

    name: Name
    inertia: Positive | None = None
    prescribed: Prescribed | None = None
    load: Load | None = None
    motor: Motor | None = None
    initial_speed: NonNegative | None = None

    _elsewhere: ClassVar[Mapping[str, str]] = ON_COUPLINGS

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a shaft's motion."""
        for key in ("motor", "initial_speed"):
            if node_value(node, "prescribed") is not None and node_value(node, key) is not None:
                yield Problem((key,), None, "not together with prescribed", BARE)


class Gear(Part):
    """A gear pair between two shafts or sprockets.

    Attributes:
        name: unique among all parts.
        between: the two shafts, a and b.
        teeth: teeth of both gears, z_a and z_b.
        module: pitch diameter over teeth [m].
        internal: whether one is an internal gear.
    """

    name: Name
    between: Names
    teeth: TeethPair
    module: Positive
    internal: Switch = False

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a gear pair's shafts."""
        yield from _two_shaft_rules(node)


LEAST_RATIO, MOST_RATIO = 0.01, 100.0
"""Least and largest magnitude of a gearbox's ratios [-]."""


class Ratios(Part):
    """Ratios of a gearbox over time; stiffness, damping and lash are at a.

    Attributes:
        time: instants at which each engages [s], from 0, ascending.
        ratio: speed of a over b's, signed; 0 is open.
    """

    time: Column
    ratio: Column

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a gearbox's ratios."""
        time, ratio = node_list(node, "time"), node_list(node, "ratio")
        if not are_numbers(*time, *ratio) or len(time) < 2:
            return
        if len(ratio) != len(time):
            yield Problem(("ratio",), list(ratio), f"must have as many elements as time, {len(time)}")
        if time[0] != 0.0:
            yield Problem(("time", 0), time[0], "must be 0, from when on the first ratio is in use")
        for i, (before, after) in enumerate(pairwise(time), 1):
            if after <= before:
                yield Problem(("time", i), after, f"must be above the element before, {before:g}")
        for i, value in enumerate(ratio):
            if value != 0.0 and not LEAST_RATIO <= abs(value) <= MOST_RATIO:
                yield Problem(
                    ("ratio", i), value, f"must be 0 (open), or {LEAST_RATIO:g} to {MOST_RATIO:g} in magnitude"
                )
        if not any(ratio):
            yield Problem(
                ("ratio",), list(ratio), "must have one that is not 0; without any the coupling never engages"
            )


class Clutch(Part):
    """A clutch of a coupling: the moment at which it slips.

    Attributes:
        torque: constant moment [N m]; this or a table.
        table: torque over time, or over the speed of a; with the ground, of b.
    """

    torque: Positive | None = None
    table: ClutchTable | None = None

    @property
    def largest_moment(self) -> float:
        """Largest moment of the clutch [N m]."""
        return max(self.table.values) if self.table is not None else self.torque or 0.0

    @property
    def steepest_change(self) -> float:
        """Steepest change of the clutch's moment with speed [N m s]."""
        return 0.0 if self.table is None or self.table.speed is None else steepest_slope(self.table)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a clutch's torque and table."""
        torque, table = node_value(node, "torque"), node_value(node, "table")
        if torque is None and table is None:
            yield Problem(("torque",), None, f"missing; {allowed_text(cls, 'torque')}, or give table instead", BARE)
        if torque is not None and table is not None:
            yield Problem(("torque",), torque, "not together with table")


class Coupling(Part):
    """A coupling: spring and damper with play between two shafts, sprockets, or the ground.

    Attributes:
        name: unique among all parts.
        between: both, a and b; a may be "ground".
        stiffness: torsional stiffness, k [N m/rad].
        damping: torsional damping, c [N m s/rad].
        lash: play to either side, b [rad].
        ratios: gearbox ratios over time; None is 1.
        clutch: moment at which it slips; None never slips.
        freewheel: a only drives b forward; of the ground, b turns only forward.
    """

    name: Name
    between: Names
    stiffness: Positive
    damping: NonNegative = 0.0
    lash: NonNegative = 0.0
    ratios: Ratios | None = None
    clutch: Clutch | None = None
    freewheel: Switch = False

    @property
    def is_grounded(self) -> bool:
        """Whether the coupling is with the ground."""
        return self.between[0] == FIXED

    @property
    def slips(self) -> bool:
        """Whether the coupling has a clutch or ratios."""
        return self.clutch is not None or self.ratios is not None

    @property
    def largest_ratio(self) -> float:
        """Largest magnitude of the coupling's ratios [-]."""
        return 1.0 if self.ratios is None else max(map(abs, self.ratios.ratio))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a coupling's values."""
        yield from _two_shaft_rules(node)
        names = node_list(node, "between")
        if len(names) == 2 and names[1] == FIXED:
            yield Problem(("between",), list(names), f'must have "{FIXED}" first')
        if names and names[0] == FIXED:
            if node_value(node, "ratios") is not None:
                yield Problem(("ratios",), None, "not to the ground", BARE)
            if node_value(node, "clutch") is None and node_value(node, "freewheel") is not True:
                text = "missing; what is between the ground and a shaft must have one (a brake), or freewheel = true"
                yield Problem(("clutch",), None, f"{text} (a backstop)", BARE)


def _two_shaft_rules(node: Any) -> Iterable[Problem]:
    """Problems of a gear or coupling without two different shafts."""
    names = node_list(node, "between")
    if len(names) == 2 and names[0] == names[1]:
        yield Problem(("between",), list(names), "must be two different shafts")
