"""Sprockets: teeth and place, prescribed motion or load, balance wheel, mount."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from warpchain.drive.contact_settings import SeatAngle
from warpchain.drive.motion_table import PlaceTable, SpeedTable, TorqueTable
from warpchain.drive.schema import (
    BARE,
    Allowed,
    Direction,
    Finite,
    Name,
    NonNegative,
    NonNegativePair,
    Pair,
    Part,
    Positive,
    PositivePair,
    Problem,
    Value,
    allowed_text,
    at_most_rule,
    node_value,
)

Teeth = Annotated[int, Field(strict=True, ge=5), Value("must be an integer of at least 5")]
Wrap = Annotated[Literal["ccw", "cw"], Value('must be "ccw" or "cw"')]
MOST_TEETH = 1_000_000
"""Largest number of teeth: beyond it a file is surely mistaken."""

_HARMONICS = Allowed("must be a list of { order, amplitude, phase }")


class Harmonic(Part):
    """One harmonic of a motion or a load.

    Attributes:
        order: times per revolution of the sprocket itself [-], > 0; halves occur in four-stroke engines.
        amplitude: share of the mean speed [-] in a prescribed motion, a torque [N m] in a load.
        phase: phase at the sprocket's initial angle [rad].
        shaft: sprocket whose revolutions `order` counts, in the ratio of teeth (engine orders); None is the sprocket
            itself.
    """

    order: Positive
    amplitude: Finite
    phase: Finite = 0.0
    shaft: Name | None = None


class Prescribed(Part):
    """A motion that nothing disturbs: speed (1 + sum of a_h cos(h phi + psi_h)), after a smooth start.

    Attributes:
        speed: mean angular speed [rad/s], >= 0; its sense is the sprocket's `wrap`; this or a table.
        table: speed over time or over the angle turned: run-up, coast-down, measured fluctuation.
        ramp_time: time to reach that speed from rest [s]; 0 is at speed from the start; not with a table.
        harmonics: speed fluctuation.
    """

    speed: NonNegative | None = None
    table: SpeedTable | None = None
    ramp_time: NonNegative = 0.0
    harmonics: Annotated[tuple[Harmonic, ...], _HARMONICS] = ()

    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = {"speed": ("table",), "table": ("speed", "ramp_time")}
    _judged: ClassVar[frozenset[str]] = frozenset({"ramp_time"})

    @property
    def top_speed(self) -> float:
        """The speed [rad/s], or the highest of the table: what reports call the drive's speed."""
        if self.speed is not None:
            return self.speed
        assert self.table is not None  # the rule below
        return self.table.factor * max(self.table.speed)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        speed, table, ramp = node_value(node, "speed"), node_value(node, "table"), node_value(node, "ramp_time")
        if speed is None and table is None:
            yield Problem(("speed",), None, f"missing; {allowed_text(cls, 'speed')}, or give table instead", BARE)
        if speed is not None and table is not None:
            yield Problem(("speed",), speed, "not together with table; give one of the two")
        if table is not None and ramp:
            yield Problem(("ramp_time",), ramp, "not together with table")


class Load(Part):
    """A moment against forward rotation: torque + viscous |omega| + quadratic omega^2 + sum of T_h cos(h phi + psi_h).

    Attributes:
        torque: constant part [N m].
        table: a torque over time or over the angle turned, which adds to the rest.
        viscous: torque over angular speed [N m s], >= 0.
        quadratic: torque over its square [N m s^2], >= 0, as of a propeller.
        ramp_time: time over which the load comes on [s]; 0 is from the start.
        harmonics: torque harmonics, as of cams and fuel pumps.
    """

    torque: Finite = 0.0
    table: TorqueTable | None = None
    viscous: NonNegative = 0.0
    quadratic: NonNegative = 0.0
    ramp_time: NonNegative = 0.0
    harmonics: Annotated[tuple[Harmonic, ...], _HARMONICS] = ()

    def steady_moment(self, speed: float) -> float:
        """The moment [N m] at an angular speed [rad/s], without table and harmonics."""
        return self.torque + self.viscous * speed + self.quadratic * speed * speed


class BalanceWheel(Part):
    """An eccentric mass that turns with the sprocket.

    Attributes:
        mass: the eccentric mass [kg], >= 0.
        radius: distance from the sprocket's center [m], >= 0.
        phase: angle in the sprocket's own frame [rad].
    """

    mass: NonNegative
    radius: NonNegative
    phase: Finite = 0.0


class FixedMount(Part):
    """The center does not move."""

    kind: Literal["fixed"] = "fixed"


class PrescribedMount(Part):
    """The center is led: center + direction (offset + amplitude sin(2 pi frequency t + phase)), or by a table.

    Attributes:
        direction: direction of a line; only its sense counts, not its length; this or a table.
        table: displacement from the center over time, instead of all else.
        offset: mean displacement along the line [m].
        amplitude: amplitude of the displacement [m].
        frequency: frequency of the displacement [Hz], >= 0.
        phase: phase of the displacement at the start [rad].
    """

    kind: Literal["prescribed"]
    direction: Direction | None = None
    table: PlaceTable | None = None
    offset: Finite = 0.0
    amplitude: Finite = 0.0
    frequency: NonNegative = 0.0
    phase: Finite = 0.0

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        if node_value(node, "table") is None and node_value(node, "direction") is None:
            yield Problem(
                ("direction",), None, f"missing; {allowed_text(cls, 'direction')}, or give table instead", BARE
            )
        for key in ("direction", "offset", "amplitude", "frequency", "phase"):
            if node_value(node, "table") is not None and node_value(node, key):
                yield Problem((key,), node_value(node, key), "not together with table")


class ElasticMount(Part):
    """The center rests on a spring and a damper along each axis.

    Attributes:
        stiffness: stiffness along x and y [N/m], > 0.
        damping: damping along x and y [N s/m], >= 0.
        preload: constant force on the center [N].
    """

    kind: Literal["elastic"]
    stiffness: PositivePair
    damping: NonNegativePair
    preload: Pair = (0.0, 0.0)


class SliderMount(Part):
    """The center moves on a line, pressed by a spring, a damper and a constant force: a tensioner.

    Attributes:
        direction: direction of the line and of the preload; only its sense counts, not its length.
        stiffness: stiffness along the line [N/m], >= 0.
        damping: damping along the line [N s/m], >= 0.
        preload: force along `direction` [N].
    """

    kind: Literal["slider"]
    direction: Direction
    stiffness: NonNegative
    damping: NonNegative
    preload: Finite = 0.0


class ArmMount(Part):
    """The center is a point of an arm, as drawn, and turns with it about the pivot; the sprocket turns for itself.

    Attributes:
        arm: name of the arm.
    """

    kind: Literal["arm"]
    arm: Name


Mount = Annotated[
    FixedMount | PrescribedMount | ElasticMount | SliderMount | ArmMount,
    Field(discriminator="kind"),
    Allowed('must be "fixed", "prescribed", "elastic", "slider" or "arm"'),
]


class Bearing(Part):
    """A bearing that rubs: a moment mu_b r_b |F| against turning, on an arm against turning relative to it.

    F is the chain's force on the sprocket.

    Attributes:
        friction: coefficient mu_b [-].
        radius: radius r_b at which it slides [m].
    """

    friction: NonNegative
    radius: Positive


class ToothGap(Part):
    """The gap between two teeth of a sprocket, where it has one of its own: a seat arc, flanks that leave it, tips.

    Attributes:
        seat_radius: radius of the arc that rollers lie in [m], at least theirs.
        seat_angle: extent of that arc [degrees], above 0 and below 180.
        flank_radius: radius of the convex flanks [m]; None is straight ones.
        tip_radius: radius at which the teeth end, from the sprocket's center [m].
    """

    seat_radius: Positive
    seat_angle: SeatAngle
    flank_radius: Positive | None = None
    tip_radius: Positive


Gap = Annotated[ToothGap | None, Allowed("must be a table; only drive files name a DXF file of it")]


ON_COUPLINGS = {
    "freewheel": "give it to a coupling, of a shaft and a sprocket on it or of two shafts",
    "clutch": "give it to a coupling, of a shaft and a sprocket on it or of two shafts",
    "brake": 'give a coupling between "ground" and this one with a clutch',
    "backstop": 'give a coupling between "ground" and this one with freewheel = true',
}
"""Keys that are looked for at sprockets and shafts, and how they are given."""


class Sprocket(Part):
    """A sprocket, at its place in the order in which the chain visits them.

    Attributes:
        name: unique among all parts.
        chain: name of its chain, where there are several.
        teeth: number of teeth, z >= 5.
        center: where it stands [m].
        wrap: "ccw" if the chain turns counter-clockwise around it, else "cw".
        pitch: pitch of its teeth, where worn [m]; None is the chain's.
        tooth: the gap between its teeth; a drive file may name a DXF file of its outline instead. None is that of
            `contact.sprocket`.
        mass: its mass without the balance wheel [kg]; needed when the mount is elastic, a slider or an arm.
        inertia: its moment of inertia without the balance wheel [kg m^2]; needed unless prescribed or on a shaft.
        prescribed: its motion, if that is given.
        load: moment against forward rotation.
        balance_wheel: eccentric mass that turns with it.
        mount: how the center is held.
        shaft: the shaft that it is on, which then has motion and load, or one of its sprockets where there are several
            chains; None is one of its own.
        key: its angle where the chain is laid, up to whole teeth [degrees]; None is where the chain seats.
        bearing: friction of its bearing; None is none.
    """

    name: Name
    teeth: Teeth
    center: Pair
    wrap: Wrap
    chain: Name | None = None
    pitch: Positive | None = None
    tooth: Gap = None
    mass: Positive | None = None
    inertia: Positive | None = None
    prescribed: Prescribed | None = None
    load: Load | None = None
    balance_wheel: BalanceWheel | None = None
    mount: Mount = FixedMount()
    shaft: Name | None = None
    key: Finite | None = None
    bearing: Bearing | None = None

    _judged: ClassVar[frozenset[str]] = frozenset({"teeth"})
    _elsewhere: ClassVar[Mapping[str, str]] = ON_COUPLINGS

    @property
    def sign(self) -> int:
        """+1 if forward rotation is counter-clockwise, else -1."""
        return 1 if self.wrap == "ccw" else -1

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        positive = allowed_text(cls, "mass")
        yield from at_most_rule(node, "teeth", MOST_TEETH)
        if all(node_value(node, key) is None for key in ("inertia", "prescribed", "shaft")):
            yield Problem(("inertia",), None, f"missing; {positive}; needed unless the sprocket is prescribed", BARE)
        kind = node_value(node_value(node, "mount"), "kind")
        if kind in ("elastic", "slider", "arm") and node_value(node, "mass") is None:
            yield Problem(("mass",), None, f'missing; {positive}; needed with mount kind "{kind}"', BARE)
        if kind == "arm" and node_value(node, "balance_wheel") is not None:
            yield Problem(("balance_wheel",), None, 'not together with mount kind "arm"', BARE)
        if node_value(node, "bearing") is not None and node_value(node, "prescribed") is not None:
            yield Problem(("bearing",), None, "not together with prescribed, whose motion nothing disturbs", BARE)
