"""Tensioners: springs, hydraulic elements and ratchets that push an arm or slider (docs/tensioners.md)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from warpchain.drive.motion_table import SupplyTable
from warpchain.drive.schema import (
    BARE,
    Allowed,
    Direction,
    Name,
    NonNegative,
    Pair,
    Part,
    Positive,
    Problem,
    Value,
    allowed_text,
    are_numbers,
    node_list,
    node_value,
)
from warpchain.drive.stack_math import hypot, is_true_somewhere, power, radians
from warpchain.drive.viscosity import REFERENCE, THICKEST, THINNEST, Walther, walther_from_two_points

Kind = Annotated[Literal["spring", "hydraulic"], Value('must be "spring" or "hydraulic"')]
Fraction = Annotated[float, Field(strict=True, ge=0.0, le=1.0), Value("must be a number from 0 to 1")]
Share = Annotated[float, Field(strict=True, ge=0.0, lt=1.0), Value("must be a number of at least 0 and below 1")]
Discharge = Annotated[float, Field(strict=True, gt=0.0, le=1.0), Value("must be a number above 0, at most 1")]
Viscosity = Annotated[
    float,
    Field(strict=True, ge=THINNEST, le=THICKEST),
    Value(f"must be a number from {THINNEST:g} to {THICKEST:g}, for which ASTM D341 holds"),
]
SeatAngle = Annotated[
    float, Field(strict=True, gt=0.0, lt=90.0), Value("must be a number of degrees above 0, below 90")
]

POINTS = ("viscosity_40", "viscosity_100")
"""Keys of an oil's viscosity over temperature."""

VAPOR_PRESSURE = 1.0e3
"""Absolute vapor pressure of mineral oils [Pa]."""

OUTLET_DISCHARGE = 0.6
"""Discharge coefficient of relief valves and vents [-]."""

OIL_PARTS = ("plunger", "chamber", "valve", "oil")
"""Keys that make a tensioner hydraulic."""


class Spring(Part):
    """The spring behind a tensioner's plunger.

    Attributes:
        stiffness: stiffness [N/m].
        preload: force as drawn [N].
        damping: damping [N s/m].
    """

    stiffness: NonNegative
    preload: NonNegative = 0.0
    damping: NonNegative = 0.0


class Plunger(Part):
    """The plunger of a tensioner in its bore.

    Attributes:
        diameter: diameter, d [m].
        mass: mass that moves with the point of contact [kg].
        gap: radial gap, h [m].
        length: length of the gap, L [m].
        eccentricity: eccentricity in the bore, eps [-], 1 at the wall.
    """

    diameter: Positive | None = None
    mass: NonNegative = 0.0
    gap: Positive | None = None
    length: Positive | None = None
    eccentricity: Fraction = 0.9

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problem of a plunger's gap."""
        diameter, gap = node_value(node, "diameter"), node_value(node, "gap")
        if are_numbers(diameter, gap) and gap >= 0.5 * diameter > 0.0:
            yield Problem(("gap",), gap, f"must be below half the diameter, {0.5 * diameter:g}")


class Chamber(Part):
    """The pressure chamber of a tensioner.

    Attributes:
        volume: volume of oil as drawn, V_0 [m^3].
        drained: share that is air as the run begins [-].
    """

    volume: Positive
    drained: Fraction = 0.0


class Valve(Part):
    """The check valve of a tensioner: a ball on a conical seat.

    Attributes:
        ball_radius: radius of the ball, r_B [m].
        seat_diameter: diameter of the hole [m].
        lift: largest lift [m].
        stiffness: stiffness of the spring, k_cv [N/m].
        preload: force of the spring when closed, F_0 [N].
        seat_angle: angle of the cone's wall to its axis, gamma [degrees].
        discharge: discharge coefficient, C_d [-].
    """

    ball_radius: Positive
    seat_diameter: Positive
    lift: Positive
    stiffness: NonNegative
    preload: NonNegative
    seat_angle: SeatAngle = 45.0
    discharge: Discharge = 0.2

    @property
    def hole_area(self) -> float:
        """Area of the check valve's hole [m^2]."""
        return 0.25 * math.pi * power(self.seat_diameter, 2)

    @property
    def seat_angle_rad(self) -> float:
        """Angle of the check valve's cone [rad]."""
        return radians(self.seat_angle)

    @property
    def cracking_pressure(self) -> float:
        """Pressure difference above which the check valve opens [Pa]."""
        return self.preload / self.hole_area

    def flow_area(self, lift: float) -> float:
        """Area of the check valve's gap at a lift [m^2]."""
        angle = self.seat_angle_rad
        wide = 2.0 * self.ball_radius * math.tan(angle) + lift * math.sin(angle) / math.cos(angle) ** 2
        return math.pi * lift * wide

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problem of a check valve's hole."""
        hole, ball = node_value(node, "seat_diameter"), node_value(node, "ball_radius")
        if are_numbers(hole, ball) and hole >= 2.0 * ball > 0.0:
            yield Problem(("seat_diameter",), hole, f"must be below the ball's diameter, {2.0 * ball:g}")


class Relief(Part):
    """The relief valve of a tensioner: a disk, on a spring, over a hole.

    Attributes:
        pressure: absolute pressure above which it opens [Pa].
        diameter: diameter of the hole [m].
        stiffness: stiffness of the spring [N/m].
        lift: largest lift [m].
        discharge: discharge coefficient of the gap, C_d [-].
    """

    pressure: Positive
    diameter: Positive
    stiffness: Positive
    lift: Positive
    discharge: Discharge = OUTLET_DISCHARGE

    @property
    def hole_area(self) -> float:
        """Area of the relief valve's hole [m^2]."""
        return 0.25 * math.pi * power(self.diameter, 2)

    def preload(self, ambient: float) -> float:
        """Force of the closed relief valve's spring [N]."""
        return (self.pressure - ambient) * self.hole_area

    def flow_area(self, lift: float) -> float:
        """Area of the relief valve's gap at a lift [m^2]."""
        return math.pi * self.diameter * lift


class Vent(Part):
    """The vent of a tensioner: an orifice that is always open.

    Attributes:
        diameter: diameter [m].
        discharge: discharge coefficient, C_d [-].
    """

    diameter: Positive
    discharge: Discharge = OUTLET_DISCHARGE

    @property
    def flow_area(self) -> float:
        """Area of the vent's jet [m^2]."""
        return self.discharge * 0.25 * math.pi * power(self.diameter, 2)


class Oil(Part):
    """The oil of a tensioner, with absolute pressures.

    Attributes:
        density: density [kg/m^3].
        viscosity: kinematic viscosity [m^2/s]; None is of the next two.
        viscosity_40, viscosity_100: kinematic viscosities at 40 and 100 degrees C [m^2/s].
        bulk_modulus: bulk modulus of oil without air, E_0 [Pa].
        air: share of air at ambient pressure [-].
        supply: supply pressure, P_s [Pa]; of a table at rest.
        supply_table: supply pressure over time or speed; None is constant.
        ambient: ambient pressure, P_0 [Pa].
    """

    density: Positive = 800.0
    viscosity: Positive
    viscosity_40: Viscosity | None = None
    viscosity_100: Viscosity | None = None
    bulk_modulus: Positive = 8.0e8
    air: Share = 0.01
    supply: Positive
    supply_table: SupplyTable | None = None
    ambient: Positive = 1.0e5

    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "viscosity": ("viscosity_40", "viscosity_100"),
        "viscosity_40": ("viscosity",),
        "viscosity_100": ("viscosity",),
    }
    _filled: ClassVar[tuple[str, ...]] = ("viscosity",)
    """Keys of an oil that others fill."""

    @property
    def dynamic_viscosity(self) -> float:
        """Dynamic viscosity of the oil, eta [Pa s]."""
        return self.density * self.viscosity

    @property
    def walther(self) -> Walther | None:
        """Viscosity of the oil over temperature, if known."""
        return _walther_of_oil(self)

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """Values of an oil with its viscosity at 20 degrees C."""
        given = isinstance(values, Mapping) and any(values.get(key) is not None for key in POINTS)
        if not given or values.get("viscosity") is not None:
            return values
        law = _walther_of_oil(cls._values_in_units(values)[0])  # of points that are wrong, their own rules say it
        return dict(values) | {"viscosity": THINNEST if law is None else law.viscosity(REFERENCE)}

    @classmethod
    def _missing_key_problem(cls, key: str, node: Any) -> Problem:
        """Problem of an oil's missing key."""
        if key == "viscosity":
            text = f"missing; {allowed_text(cls, key)}, or give viscosity_40 and viscosity_100 instead"
            return Problem((key,), None, text, BARE)
        return super()._missing_key_problem(key, node)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of an oil's viscosities and pressures."""
        yield from _viscosity_rules(node)
        supply, ambient = node_value(node, "supply"), node_value(node, "ambient")
        ambient = 1.0e5 if ambient is None else ambient
        dry = False
        for key in ("ambient", "supply"):
            value = node_value(node, key)
            if are_numbers(value) and 0.0 < value <= VAPOR_PRESSURE:
                text = f"must be above the oil's vapor pressure, {VAPOR_PRESSURE:g} Pa; pressures are absolute, in Pa"
                yield Problem((key,), value, text)
                dry = True
        if not dry and are_numbers(supply, ambient) and 0.0 < supply < ambient:
            text = f"must be at least the ambient pressure, {ambient:g} Pa; pressures are absolute, in Pa"
            yield Problem(("supply",), supply, text)
        table = node_value(node, "supply_table")
        factor = 1.0 if node_value(table, "factor") is None else node_value(table, "factor")
        for i, pressure in enumerate(node_list(table, "pressure")):
            if not dry and are_numbers(pressure, factor, ambient) and factor * pressure < ambient:
                text = f"must be at least the ambient pressure, {ambient:g} Pa; pressures are absolute, in Pa"
                if factor == 1.0:
                    yield Problem(("supply_table", "pressure", i), pressure, text)
                else:
                    yield Problem(("supply_table", "factor"), factor, f"times the pressure {pressure:g} {text}")
                return


def _walther_of_oil(oil: Any) -> Walther | None:
    """Viscosity of an oil or mapping over temperature, or None."""
    at_40, at_100 = (node_value(oil, key) for key in POINTS)
    if not are_numbers(at_40, at_100) or not THINNEST <= at_100 < at_40 <= THICKEST:
        return None
    return walther_from_two_points(at_40, at_100)


def _viscosity_rules(oil: Any) -> Iterable[Problem]:
    """Problems of an oil's viscosities at two temperatures."""
    at_40, at_100 = (node_value(oil, key) for key in POINTS)
    for key, other in zip(POINTS, reversed(POINTS), strict=True):
        if node_value(oil, key) is None and node_value(oil, other) is not None:
            yield Problem((key,), None, f"missing; {allowed_text(Oil, key)}; needed with {other}", BARE)
    if are_numbers(at_40, at_100) and at_100 >= at_40 >= THINNEST:
        yield Problem(("viscosity_100",), at_100, f"must be below viscosity_40, {at_40:g}: oil thins as it warms")
    law, own = _walther_of_oil(oil), node_value(oil, "viscosity")
    if law is not None and are_numbers(own) and not math.isclose(own, law.viscosity(REFERENCE), rel_tol=1e-12):
        yield Problem(("viscosity",), own, "not together with viscosity_40 and viscosity_100, which say it")


class Ratchet(Part):
    """A ratchet that lets a tensioner's plunger only out.

    Attributes:
        pitch: pitch of the teeth, a [m].
        backlash: way back behind the last tooth, s [m].
    """

    pitch: Positive
    backlash: NonNegative = 0.0


class Tensioner(Part):
    """A tensioner that pushes an arm, or a sprocket on a slider, against the chain.

    Attributes:
        name: unique among all parts.
        on: its arm or sprocket.
        at: point of contact as drawn [m].
        direction: direction of the push.
        kind: "spring" or "hydraulic".
        spring: needed with kind "spring".
        plunger: needed with kind "hydraulic".
        chamber, valve, oil: chamber, check valve and oil; needed with kind "hydraulic".
        relief: relief valve.
        vent: vent.
        ratchet: ratchet.
    """

    name: Name
    on: Name
    at: Pair
    direction: Direction
    kind: Kind
    spring: Annotated[Spring | None, Allowed("must be a table { stiffness, preload, damping }")] = None
    plunger: Annotated[Plunger | None, Allowed("must be a table { diameter, mass, gap, length, eccentricity }")] = None
    chamber: Annotated[Chamber | None, Allowed("must be a table { volume }")] = None
    valve: Annotated[
        Valve | None, Allowed("must be a table { ball_radius, seat_diameter, lift, stiffness, preload }")
    ] = None
    relief: Annotated[Relief | None, Allowed("must be a table { pressure, diameter, stiffness, lift }")] = None
    vent: Annotated[Vent | None, Allowed("must be a table { diameter, discharge }")] = None
    oil: Annotated[Oil | None, Allowed("must be a table { viscosity, supply }")] = None
    ratchet: Annotated[Ratchet | None, Allowed("must be a table { pitch, backlash }")] = None

    @property
    def hydraulic(self) -> bool:
        """Whether the tensioner is hydraulic."""
        return self.kind == "hydraulic"

    @property
    def is_drained(self) -> bool:
        """Whether the tensioner's chamber has air as the run begins."""
        return self.chamber is not None and bool(is_true_somewhere(self.chamber.drained))

    @property
    def unit_direction(self) -> tuple[float, float]:
        """Unit vector of the tensioner's push."""
        length = hypot(*self.direction)
        return self.direction[0] / length, self.direction[1] / length

    @property
    def spring_stiffness(self) -> float:
        """Stiffness of the tensioner's spring, or 0 [N/m]."""
        return 0.0 if self.spring is None else self.spring.stiffness

    @property
    def spring_preload(self) -> float:
        """Force of the tensioner's spring as drawn, or 0 [N]."""
        return 0.0 if self.spring is None else self.spring.preload

    @property
    def spring_damping(self) -> float:
        """Damping of the tensioner's spring, or 0 [N s/m]."""
        return 0.0 if self.spring is None else self.spring.damping

    @property
    def plunger_mass(self) -> float:
        """Mass of the tensioner's plunger, or 0 [kg]."""
        return 0.0 if self.plunger is None else self.plunger.mass

    @property
    def area(self) -> float:
        """Area of the tensioner's plunger, 0 without oil [m^2]."""
        return 0.25 * math.pi * power(self._bore[0], 2) if self.hydraulic else 0.0

    @property
    def hole_area(self) -> float:
        """Area of the check valve's hole, 0 without oil [m^2]."""
        return self.valve.hole_area if self.hydraulic and self.valve is not None else 0.0

    @property
    def leak_conductance(self) -> float:
        """Leak flow over pressure difference, 0 without oil [m^3/(s Pa)]."""
        if not self.hydraulic:
            return 0.0
        diameter, gap, length = self._bore
        assert self.oil is not None and self.plunger is not None
        wide = 1.0 + 1.5 * power(self.plunger.eccentricity, 2)
        return math.pi * diameter * power(gap, 3) * wide / (12.0 * self.oil.dynamic_viscosity * length)

    @property
    def drag_flow(self) -> float:
        """Oil flow that the plunger drags over its speed [m^2]."""
        return 0.5 * math.pi * self._bore[0] * self._bore[1] if self.hydraulic else 0.0

    @property
    def _bore(self) -> tuple[float, float, float]:
        """Diameter, gap and length of the plunger [m]."""
        plunger = self.plunger
        assert plunger is not None  # the rules below
        assert plunger.diameter is not None and plunger.gap is not None and plunger.length is not None
        return plunger.diameter, plunger.gap, plunger.length

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a tensioner's parts."""
        kind = node_value(node, "kind")
        if kind == "spring":
            if node_value(node, "spring") is None:
                text = 'missing; must be a table { stiffness, preload, damping }; needed with kind "spring"'
                yield Problem(("spring",), None, text, BARE)
            for key in ("chamber", "valve", "relief", "vent", "oil"):
                if node_value(node, key) is not None:
                    yield Problem((key,), None, 'only with kind "hydraulic"', BARE)
        if kind != "hydraulic":
            return
        for key in OIL_PARTS:
            if node_value(node, key) is None:
                yield Problem((key,), None, f'missing; {allowed_text(cls, key)}; needed with kind "hydraulic"', BARE)
        plunger = node_value(node, "plunger")
        for key in ("diameter", "gap", "length"):
            if isinstance(plunger, (Mapping, Part)) and node_value(plunger, key) is None:
                text = 'missing; must be a positive number; needed with kind "hydraulic"'
                yield Problem(("plunger", key), None, text, BARE)
        ambient = node_value(node_value(node, "oil"), "ambient")
        ambient, opens = 1.0e5 if ambient is None else ambient, node_value(node_value(node, "relief"), "pressure")
        if are_numbers(opens, ambient) and 0.0 < opens <= ambient:
            text = f"must be above the ambient pressure, {ambient:g} Pa; pressures are absolute, in Pa"
            yield Problem(("relief", "pressure"), opens, text)
