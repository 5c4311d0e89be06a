"""Valve trains: groups of like valves that cams lift (docs/valve-trains.md).

Lifts are periodic over the shaft's forward angle less a phase: a table, or a rise, dwell and fall, as a cubic spline.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from warpchain.drive.motion_table import MOST_ROWS, TURN_TOLERANCE, ascending_rules, slowest_ripple
from warpchain.drive.schema import (
    BARE,
    Column,
    Finite,
    Name,
    NonNegative,
    Part,
    Positive,
    Problem,
    Value,
    are_numbers,
    is_name,
    nearest_key_text,
    node_list,
    node_value,
    plain_sequence,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from scipy.interpolate import CubicSpline

    Array = NDArray[np.float64]

MOST_VALVES = 64
"""Most valves a phase, and phases."""
MOST_LIFT = 0.25
"""Largest lift of a valve [m]."""
STEEPEST = 0.25
"""Largest change of a lift between rows, over its rise [-]."""
ROWS = 720
"""Rows of a turn of a cam."""

Phases = Annotated[
    tuple[Annotated[float, Field(strict=True, allow_inf_nan=False)], ...],
    Field(strict=True, min_length=1, max_length=MOST_VALVES),
    BeforeValidator(plain_sequence),
    Value(f"must be a list of 1 to {MOST_VALVES} finite numbers"),
]
Count = Annotated[int, Field(strict=True, ge=1, le=MOST_VALVES), Value(f"must be an integer from 1 to {MOST_VALVES}")]
Lift = Annotated[
    float,
    Field(strict=True, gt=0.0, le=MOST_LIFT, allow_inf_nan=False),
    Value(f"must be a number above 0, at most {MOST_LIFT:g} m"),
]
Shape = Annotated[
    Literal["polynomial", "cycloid", "cosine"], Value('must be "polynomial" (4-5-6-7), "cycloid" or "cosine"')
]


@dataclass(frozen=True)
class LiftCurve:
    """Periodic lift of a valve as a table, without its factor.

    Attributes:
        over: angles [rad], ascending over the period.
        values: lifts [m], the last as the first.
    """

    over: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def angle(self) -> tuple[float, ...]:
        """Angles of the lift's table [rad]."""
        return self.over

    @property
    def revolutions(self) -> float:
        """Period of the valve lift in revolutions."""
        return 1.0 / round(2.0 * math.pi / (self.over[-1] - self.over[0]))

    @cached_property
    def spline(self) -> CubicSpline:
        """Spline through the valve lift's rows."""
        from scipy.interpolate import CubicSpline  # here, since it takes a quarter of a second

        return CubicSpline(self.over, self.values, bc_type="periodic")

    @cached_property
    def largest_slopes(self) -> tuple[float, float]:
        """Largest magnitudes of the lift's first and second derivative."""
        _, slope, bend = self.lift_and_slopes()
        return float(abs(slope).max()), float(abs(bend).max())

    def lift_and_slopes(self) -> tuple[Array, Array, Array]:
        """Lift and two derivatives by angle over a turn, (`ROWS`,) each."""
        import numpy as np  # here, since drives are read without it

        turn = np.linspace(0.0, 2.0 * np.pi, ROWS, endpoint=False)
        return self.spline(turn), self.spline(turn, 1), self.spline(turn, 2)


class LiftTable(Part):
    """Lift of a valve over the shaft's forward angle.

    Attributes:
        angle: forward angle [rad], ascending over one revolution or an equal part of one.
        lift: lift [m]; the last row repeats the first.
        factor: factor of the lifts.
    """

    angle: Column
    lift: Column
    factor: Positive = 1.0

    @cached_property
    def curve(self) -> LiftCurve:
        """Lift of the valve without its factor."""
        return LiftCurve(self.angle, self.lift)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a valve lift's table."""
        if node_value(node, "file") is not None:
            yield Problem(("file",), node_value(node, "file"), "only drive files name a file; give angle and lift")
            return
        angle, lift = node_list(node, "angle"), node_list(node, "lift")
        if not are_numbers(*angle, *lift) or min(len(angle), len(lift)) < 2:
            return
        if len(angle) > MOST_ROWS:
            yield Problem(("angle",), None, f"has {len(angle)} elements; must have at most {MOST_ROWS}", BARE)
        elif len(angle) != len(lift):
            yield Problem(("lift",), list(lift), f"must have as many elements as angle, {len(angle)}")
        else:
            yield from list(ascending_rules("angle", angle)) or _periodic_lift_rules(angle, lift)
        factor = 1.0 if node_value(node, "factor") is None else node_value(node, "factor")
        most = max(map(abs, lift))
        if are_numbers(factor) and factor > 0.0 and most * factor > MOST_LIFT:
            yield Problem(("lift",), None, f"reaches {most * factor:g} m; must be at most {MOST_LIFT:g} m", BARE)


def _periodic_lift_rules(angle: Any, lift: Any) -> Iterator[Problem]:
    """Problems of a valve lift that does not close, or jumps."""
    turn, last = angle[-1] - angle[0], len(angle) - 1
    parts = round(2.0 * math.pi / turn)
    if parts < 1 or abs(turn * parts / (2.0 * math.pi) - 1.0) > TURN_TOLERANCE:
        text = f"must be a revolution, or 1/2, 1/3 ... of one, after the first, {angle[0]:g} rad"
        yield Problem(("angle", last), angle[last], f"{text}; it is {turn / (2.0 * math.pi):.4g} after it")
        return
    if lift[last] != lift[0]:
        text = f"must repeat the first element, {lift[0]:g}, where the next period begins"
        yield Problem(("lift", last), lift[last], text)
        return
    rise = max(lift) - min(lift)
    if rise <= 0.0:
        yield Problem(("lift",), None, "must not be the same throughout", BARE)
        return
    for i in range(1, len(lift)):
        if abs(lift[i] - lift[i - 1]) > STEEPEST * rise:
            text = f"jumps from {lift[i - 1]:g}; must change by at most {STEEPEST * rise:g} from row to row"
            yield Problem(("lift", i), lift[i], text)
            return


class LiftProfile(Part):
    """Lift of a valve that rises from 0, dwells and falls.

    Attributes:
        shape: law of both flanks.
        lift: largest lift [m].
        rise: shaft angle over which it rises [degrees].
        dwell: shaft angle over which it stays [degrees].
        fall: shaft angle over which it falls [degrees].
    """

    shape: Shape = "polynomial"
    lift: Lift
    rise: Positive
    dwell: NonNegative = 0.0
    fall: Positive

    @property
    def curve(self) -> LiftCurve:
        """Lift of the valve over its largest [-]."""
        return profile_curve(self.shape, self.rise, self.dwell, self.fall)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a valve lift's profile."""
        parts = [node_value(node, key) for key in ("rise", "fall")]
        dwell = 0.0 if node_value(node, "dwell") is None else node_value(node, "dwell")
        if not are_numbers(*parts, dwell):
            return
        whole = sum(parts) + dwell
        if whole > 360.0:
            yield Problem(("rise",), parts[0], f"with dwell and fall must be at most 360 degrees; it is {whole:g}")
        for key, part in zip(("rise", "fall"), parts, strict=True):
            if 0.0 < part < 8.0 * 360.0 / ROWS:
                yield Problem((key,), part, f"must be at least {8.0 * 360.0 / ROWS:g} degrees")


FLANKS = {
    "polynomial": lambda s: s**4 * (35.0 - s * (84.0 - s * (70.0 - 20.0 * s))),
    "cycloid": lambda s: s - math.sin(2.0 * math.pi * s) / (2.0 * math.pi),
    "cosine": lambda s: 0.5 * (1.0 - math.cos(math.pi * s)),
}
"""Flanks of a valve's lift, 0 to 1, by name."""


@cache
def profile_curve(shape: str, rise: float, dwell: float, fall: float) -> LiftCurve:
    """Lift of a valve's profile over its largest [-]."""
    degrees = [360.0 * row / ROWS for row in range(ROWS)]
    parts = (min(angle / rise, (rise + dwell + fall - angle) / fall, 1.0) for angle in degrees)
    lift = [FLANKS[shape](max(part, 0.0)) for part in parts]
    return LiftCurve((*map(math.radians, degrees), 2.0 * math.pi), (*lift, lift[0]))


class ValveSpring(Part):
    """Spring that presses a follower on its cam.

    Attributes:
        preload: force at lift 0 [N].
        stiffness: stiffness [N/m].
    """

    preload: NonNegative
    stiffness: NonNegative = 0.0


@lru_cache(maxsize=64)
def _slowest_lift_ripple(curve: LiftCurve, phases: tuple[float, ...]) -> int:
    """Periods per turn of lifts' slowest ripple."""
    import numpy as np  # here, since drives are read without it

    shifts = np.exp(-1j * np.outer(np.arange(ROWS // 2 + 1), np.radians(phases))).sum(axis=1)
    return slowest_ripple(np.fft.rfft(curve.lift_and_slopes()[1]) * shifts)


class Valves(Part):
    """A group of like valves on a sprocket or shaft.

    Attributes:
        name: unique among all parts.
        on: sprocket or shaft whose cams lift them.
        number: number of valves of each phase.
        phases: forward angles at which the cams begin [degrees].
        phase: further angle of all [degrees].
        mass: moving mass of a valve, at the valve [kg].
        spring: spring of a valve.
        profile: lift as a profile; this or a table.
        table: lift as a table.
    """

    name: Name
    on: Name
    number: Count = 1
    phases: Phases = (0.0,)
    phase: Finite = 0.0
    mass: NonNegative
    spring: ValveSpring
    profile: LiftProfile | None = None
    table: LiftTable | None = None

    @property
    def curve(self) -> LiftCurve:
        """Lift curve of the valves without `height`."""
        of = self.profile or self.table
        assert of is not None  # the rule below
        return of.curve

    @property
    def height(self) -> float:
        """Factor of the valves' lift curve."""
        return self.table.factor if self.profile is None else self.profile.lift  # type: ignore[union-attr]

    def lifts(self) -> tuple[Array, Array, Array]:
        """Lift [m] of the valves and two derivatives by angle over a turn, (`ROWS`,) each."""
        lift, slope, bend = (self.height * of for of in self.curve.lift_and_slopes())
        return lift, slope, bend

    @property
    def float_speed(self) -> float:
        """Least shaft speed at which a valve's follower lifts off [rad/s]."""
        lift, _, bend = self.lifts()
        pressed, thrown = self.spring.preload + self.spring.stiffness * lift, -self.mass * bend
        over = thrown > 0.0
        return math.sqrt(max(0.0, float((pressed[over] / thrown[over]).min(initial=math.inf))))

    @property
    def slowest_order(self) -> float:
        """Periods per revolution of the valves' slowest torque ripple."""
        return float(_slowest_lift_ripple(self.curve, tuple(self.phases)))

    @property
    def torsional_stiffness(self) -> Any:
        """Upper bound of the valves' torsional stiffness [N m/rad]."""
        steepest, most = self.curve.largest_slopes
        springs = self.spring.stiffness * self.height * steepest**2
        springs = springs + (self.spring.preload + self.spring.stiffness * self.height * max(self.curve.values)) * most
        return self.number * len(self.phases) * self.height * springs

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problem of valves without one lift."""
        profile, table = node_value(node, "profile"), node_value(node, "table")
        if profile is None and table is None:
            yield Problem(("profile",), None, "missing; must be a table, or give table instead", BARE)
        if profile is not None and table is not None:
            yield Problem(("table",), None, "not together with profile; give one of the two", BARE)


def valve_rules(drive: Any) -> Iterator[Problem]:
    """Problems of valves on unknown bodies or beside balance wheels."""
    parts = [*node_list(drive, "sprockets"), *node_list(drive, "shafts")]
    names = [str(node_value(part, "name")) for part in parts if is_name(node_value(part, "name"))]
    wheels = [node_value(part, "name") for part in parts if node_value(part, "balance_wheel") is not None]
    for v, valves in enumerate(node_list(drive, "valves")):
        on = node_value(valves, "on")
        if is_name(on) and on not in names:
            yield Problem(
                ("valves", v, "on"), on, f"must be the name of a sprocket or a shaft; {nearest_key_text(on, names)}"
            )
        elif is_name(on) and on in wheels:
            yield Problem(("valves", v, "on"), on, "must not have a balance wheel")
