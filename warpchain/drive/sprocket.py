"""Sprockets: teeth and place, prescribed motion or load, balance wheel, mount."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
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

END_TEETH = 1
"""Number of seats of a chain's end, without teeth."""
Teeth = Annotated[int, Field(strict=True, ge=5), Value("must be an integer of at least 5")]
Wrap = Annotated[Literal["ccw", "cw"], Value('must be "ccw" or "cw"')]
MOST_TEETH = 1_000_000

_HARMONICS = Allowed("must be a list of { order, amplitude, phase }")


class Harmonic(Part):
    """One harmonic of a motion or load.

    Attributes:
        order: periods per revolution [-], halves for four-stroke engines.
        amplitude: share of the mean speed [-], or torque of a load [N m].
        phase: phase at the initial angle [rad].
        shaft: sprocket or shaft of `order`'s revolutions; None is its own.
    """

    order: Positive
    amplitude: Finite
    phase: Finite = 0.0
    shaft: Name | None = None


class Prescribed(Part):
    """A prescribed motion: speed (1 + sum of a_h cos(h phi + psi_h)).

    Attributes:
        speed: mean speed in the sense of `wrap` [rad/s]; this or a table.
        table: speed over time or over the angle turned.
        ramp_time: time to reach the speed from rest [s]; not with a table.
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
        """Speed of the prescribed motion, or its table's highest [rad/s]."""
        if self.speed is not None:
            return self.speed
        assert self.table is not None  # the rule below
        return self.table.factor * max(self.table.speed)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a prescribed motion."""
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
        table: torque over time or over the angle turned, in addition.
        viscous: torque over speed [N m s].
        quadratic: torque over the square of speed [N m s^2].
        ramp_time: time over which the load comes on [s].
        harmonics: torque harmonics.
    """

    torque: Finite = 0.0
    table: TorqueTable | None = None
    viscous: NonNegative = 0.0
    quadratic: NonNegative = 0.0
    ramp_time: NonNegative = 0.0
    harmonics: Annotated[tuple[Harmonic, ...], _HARMONICS] = ()

    def steady_moment(self, speed: float) -> float:
        """Moment of the load at a speed, without table and harmonics [N m]."""
        return self.torque + self.viscous * speed + self.quadratic * speed * speed


class BalanceWheel(Part):
    """An eccentric mass that turns with a sprocket.

    Attributes:
        mass: eccentric mass [kg].
        radius: distance from the sprocket's center [m].
        phase: angle on the sprocket [rad].
    """

    mass: NonNegative
    radius: NonNegative
    phase: Finite = 0.0


class FixedMount(Part):
    """A sprocket's center that does not move."""

    kind: Literal["fixed"] = "fixed"


class PrescribedMount(Part):
    """A sprocket's center led by center + direction (offset + amplitude sin(2 pi frequency t + phase)) or a table.

    Attributes:
        direction: direction of the line; this or a table.
        table: displacement from the center over time.
        offset: mean displacement [m].
        amplitude: amplitude [m].
        frequency: frequency [Hz].
        phase: phase at the start [rad].
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
        """Problems of a prescribed mount."""
        if node_value(node, "table") is None and node_value(node, "direction") is None:
            yield Problem(
                ("direction",), None, f"missing; {allowed_text(cls, 'direction')}, or give table instead", BARE
            )
        for key in ("direction", "offset", "amplitude", "frequency", "phase"):
            if node_value(node, "table") is not None and node_value(node, key):
                yield Problem((key,), node_value(node, key), "not together with table")


class ElasticMount(Part):
    """A sprocket's center on a spring and a damper along each axis.

    Attributes:
        stiffness: stiffness along x and y [N/m].
        damping: damping along x and y [N s/m].
        preload: constant force on the center [N].
    """

    kind: Literal["elastic"]
    stiffness: PositivePair
    damping: NonNegativePair
    preload: Pair = (0.0, 0.0)


class SliderMount(Part):
    """A sprocket's center on a line, pressed by spring, damper and constant force: a tensioner.

    Attributes:
        direction: direction of the line and of the preload.
        stiffness: stiffness along the line [N/m].
        damping: damping along the line [N s/m].
        preload: force along `direction` [N].
    """

    kind: Literal["slider"]
    direction: Direction
    stiffness: NonNegative
    damping: NonNegative
    preload: Finite = 0.0


class FreeMount(ElasticMount):
    """A center that nothing holds: a weight on a chain's end, free to swing."""

    kind: Literal["free"]  # type: ignore[assignment]
    stiffness: NonNegativePair = (0.0, 0.0)
    damping: NonNegativePair = (0.0, 0.0)


class ArmMount(Part):
    """A sprocket's center on an arm, with which it turns about the pivot.

    Attributes:
        arm: name of the arm.
    """

    kind: Literal["arm"]
    arm: Name


Mount = Annotated[
    FixedMount | PrescribedMount | ElasticMount | FreeMount | SliderMount | ArmMount,
    Field(discriminator="kind"),
    Allowed('must be "fixed", "prescribed", "elastic", "free", "slider" or "arm"'),
]


class Bearing(Part):
    """Friction of a bearing: a moment mu_b r_b |F| of the chain's force.

    Attributes:
        friction: coefficient of friction, mu_b [-].
        radius: sliding radius, r_b [m].
    """

    friction: NonNegative
    radius: Positive


class ToothGap(Part):
    """Tooth gap of a sprocket: seat arc, flanks, tips.

    Attributes:
        seat_radius: radius of the seat arc [m].
        seat_angle: extent of the seat arc [degrees].
        flank_radius: radius of the flanks [m]; None is straight.
        tip_radius: radius of the tips from the sprocket's center [m].
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
"""Keys of couplings in other parts, with the remedy."""


class Sprocket(Part):
    """A sprocket, in the order in which the chain visits them.

    Attributes:
        name: unique among all parts.
        chain: its chain, where there are several.
        teeth: number of teeth, z; an end of an open chain has none.
        center: its center [m].
        wrap: "ccw" if the chain turns counter-clockwise around it.
        pitch: pitch of its teeth, where worn [m]; None is the chain's.
        tooth: gap between its teeth, or a DXF file; None is that of `contact.sprocket`.
        mass: mass without balance wheel [kg]; needed where forces move the center.
        inertia: moment of inertia without balance wheel [kg m^2]; needed unless prescribed or on a shaft.
        prescribed: prescribed motion.
        load: moment against forward rotation.
        balance_wheel: eccentric mass.
        mount: mount of its center.
        shaft: shaft, or of several chains another sprocket, that it turns with.
        rim: radius of an end's pin on a wheel that turns about the center [m]; None is in the center.
        key: angle where the chain is laid [degrees], that of an end's pin on its rim; None is where it seats.
        bearing: friction of its bearing.
    """

    name: Name
    teeth: Teeth = END_TEETH
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
    rim: Positive | None = None
    key: Finite | None = None
    bearing: Bearing | None = None

    _unsaid: ClassVar[Mapping[str, Any]] = {"teeth": END_TEETH}
    _judged: ClassVar[frozenset[str]] = frozenset({"teeth"})
    _elsewhere: ClassVar[Mapping[str, str]] = ON_COUPLINGS

    @property
    def sign(self) -> int:
        """+1 if the sprocket's forward rotation is counter-clockwise, else -1."""
        return 1 if self.wrap == "ccw" else -1

    @property
    def is_end(self) -> bool:
        """Whether the sprocket is a toothless end of an open chain."""
        return self.teeth == END_TEETH

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a sprocket's values."""
        positive = allowed_text(cls, "mass")
        yield from at_most_rule(node, "teeth", MOST_TEETH)
        if all(node_value(node, key) is None for key in ("inertia", "prescribed", "shaft")):
            yield Problem(("inertia",), None, f"missing; {positive}; needed unless the sprocket is prescribed", BARE)
        kind = node_value(node_value(node, "mount"), "kind")
        if kind in ("elastic", "free", "slider", "arm") and node_value(node, "mass") is None:
            yield Problem(("mass",), None, f'missing; {positive}; needed with mount kind "{kind}"', BARE)
        if kind == "arm" and node_value(node, "balance_wheel") is not None:
            yield Problem(("balance_wheel",), None, 'not together with mount kind "arm"', BARE)
        if node_value(node, "bearing") is not None and node_value(node, "prescribed") is not None:
            yield Problem(("bearing",), None, "not together with prescribed, whose motion nothing disturbs", BARE)


def strand_names(sprockets: Sequence[Sprocket]) -> tuple[str, ...]:
    """Names "FROM->TO" of the strands of a chain's sprockets (S,)."""
    names = [sprocket.name for sprocket in sprockets]
    if sprockets and sprockets[-1].is_end:
        return tuple(f"{a}->{b}" for a, b in pairwise(names))
    return tuple(f"{a}->{b}" for a, b in zip(names, names[1:] + names[:1], strict=True))
