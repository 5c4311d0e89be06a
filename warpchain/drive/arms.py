r"""Arms: bodies that turn about a pivot and carry guides and sprockets, such as a tensioner's sprung blade.

    I theta'' = -k_t (theta - theta_0) - c_t theta' + m g x (r_c - p) + moments of the chain, tensioners and stops,

theta = 0 as drawn, counter-clockwise positive. A coil spring of length l from an anchor to a point of the arm adds
-(k (l - l_0) + c l') dl/dtheta, with q that point and f the anchor, both from p: dl/dtheta = q x (q - f) / l. A stop
is a torsion spring with a damper that acts beyond its angle and only pushes back. A pivot that is led accelerates by
a, which acts as g - a in place of g.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from warpchain.drive.motion_table import PlaceTable
from warpchain.drive.schema import (
    Name,
    NonNegative,
    Pair,
    Part,
    Positive,
    Problem,
    Value,
    are_numbers,
    node_list,
    node_value,
    plain_sequence,
)
from warpchain.drive.stack_math import hypot, minimum, radians, sqrt

_Turn = Annotated[float, Field(strict=True, ge=-360.0, le=360.0)]
Wound = Annotated[
    float,
    Field(strict=True, ge=-3600.0, le=3600.0),
    Value("must be a number of degrees from -3600 to 3600"),
]
Stops = Annotated[
    tuple[_Turn, _Turn],
    Field(strict=True),
    BeforeValidator(plain_sequence),
    Value("must be two numbers of degrees from -360 to 360, [lower, upper]"),
]

STOP_RATIO = 0.5
"""Damping ratio of a stop whose damping is not given."""


class ArmSpring(Part):
    """A coil spring, or a strut, that pulls a point of an arm towards an anchor, or pushes it away.

    Attributes:
        at: point of the arm at which it holds it, as drawn [m].
        anchor: where its other end is held, on the ground or on the arm that carries this one, as drawn [m].
        stiffness: k [N/m].
        free_length: length without force, l_0 [m]; it pulls where it is longer and pushes where it is shorter.
        damping: c of a damper beside it [N s/m].
    """

    at: Pair
    anchor: Pair
    stiffness: Positive
    free_length: Positive
    damping: NonNegative = 0.0


class Arm(Part):
    """A body that turns about a pivot, which is fixed or led.

    Attributes:
        name: unique among all parts.
        pivot: where it turns [m].
        pivot_table: displacement of its pivot over time; None is a fixed pivot.
        arm: name of the arm that carries it, of which its pivot is a point; spring, damper and stops then act between
            the two, at what it is turned by more. None is the ground.
        mass: its mass [kg].
        center: its center of mass, at angle 0 [m].
        inertia: its moment of inertia about the pivot [kg m^2].
        stiffness: stiffness of its torsion spring, k_t [N m/rad].
        free_angle: angle at which the spring is relaxed, theta_0 [degrees].
        damping: damping of its bearing, c_t [N m s/rad].
        spring: a coil spring between a point of it and the ground, or the arm that carries it; where its pivot is led,
            the anchor moves along. None is none.
        stops: lowest and highest angle [degrees]; None is none.
        stop_stiffness: stiffness of the stops [N m/rad]; None is the drive's choice (`Drive.stop_stiffness`).
        stop_damping: damping of the stops [N m s/rad]; None is the drive's choice (`Drive.stop_damping`).
    """

    name: Name
    pivot: Pair
    pivot_table: PlaceTable | None = None
    arm: Name | None = None
    mass: Positive
    center: Pair
    inertia: Positive
    stiffness: NonNegative = 0.0
    free_angle: Wound = 0.0
    damping: NonNegative = 0.0
    spring: ArmSpring | None = None
    stops: Stops | None = None
    stop_stiffness: Positive | None = None
    stop_damping: NonNegative | None = None

    @property
    def free_angle_rad(self) -> float:
        """theta_0 [rad]."""
        return radians(self.free_angle)

    @property
    def stops_rad(self) -> tuple[float, float]:
        """Lowest and highest angle [rad]; without stops minus and plus infinity."""
        if self.stops is None:
            return -math.inf, math.inf
        return radians(self.stops[0]), radians(self.stops[1])

    @property
    def spring_lever(self) -> float:
        """The most that its coil spring's lever can be [m]: both its ends are farther from the pivot, or as far."""
        ends = (self.spring.at, self.spring.anchor) if self.spring is not None else (self.pivot,)
        return minimum(*(hypot(x - self.pivot[0], y - self.pivot[1]) for x, y in (*ends, *ends)))

    @property
    def center_radius(self) -> float:
        """Distance of the center of mass from the pivot [m]."""
        return hypot(self.center[0] - self.pivot[0], self.center[1] - self.pivot[1])

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        stops = node_list(node, "stops")
        if len(stops) == 2 and are_numbers(*stops) and stops[0] >= stops[1]:
            yield Problem(("stops",), list(stops), "must be the lower angle first, then the upper one [lower, upper]")
        pivot, spring = list(node_list(node, "pivot")), node_value(node, "spring")
        at, anchor = (list(node_list(spring, key)) for key in ("at", "anchor"))
        for key, end in (("at", at), ("anchor", anchor)):
            if end and end == pivot:
                yield Problem(("spring", key), end, "must not be the pivot, about which it then turns nothing")
        if at and at == anchor:
            yield Problem(("spring", "anchor"), anchor, "must be another point than at")
        for key in ("stop_stiffness", "stop_damping"):
            if node_value(node, key) is not None and node_value(node, "stops") is None:
                yield Problem((key,), node_value(node, key), "only together with stops")


def stop_stiffness(arm: Arm, lever: float, link_stiffness: float, roller_mass: float) -> float:
    """Stiffness of an arm's stops [N m/rad]: its own, or that of one link at the lever.

    At most I k/m, so that an arm of little inertia swings at its stop no faster than a roller between its links and
    asks for no shorter steps.

    Args:
        lever: farthest place at which the chain touches the arm, from the pivot [m].
        link_stiffness: k [N/m].
        roller_mass: m [kg].
    """
    if arm.stop_stiffness is not None:
        return arm.stop_stiffness
    return link_stiffness * minimum(lever * lever, arm.inertia / roller_mass)


def stop_damping(arm: Arm, stiffness: float) -> float:
    """Damping of an arm's stops of a stiffness [N m/rad]: its own, or half the critical one [N m s/rad]."""
    if arm.stop_damping is not None:
        return arm.stop_damping
    return 2.0 * STOP_RATIO * sqrt(stiffness * arm.inertia)
