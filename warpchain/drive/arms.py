"""Arms: bodies that turn about a pivot and carry guides and sprockets (docs/guides-and-tensioners.md).

The angle is 0 as drawn, counter-clockwise positive.
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
"""Default damping ratio of an arm's stop [-]."""


class ArmSpring(Part):
    """A coil spring or strut between an arm and an anchor.

    Attributes:
        at: where it holds the arm, as drawn [m].
        anchor: where its other end is held, as drawn [m].
        stiffness: k [N/m].
        free_length: length without force, l_0 [m].
        damping: damping of a damper beside it, c [N s/m].
    """

    at: Pair
    anchor: Pair
    stiffness: Positive
    free_length: Positive
    damping: NonNegative = 0.0


class Arm(Part):
    """An arm: a body that turns about a pivot, fixed or led.

    Attributes:
        name: unique among all parts.
        pivot: pivot, p [m].
        pivot_table: displacement of the pivot over time; None is a fixed pivot.
        arm: arm that carries it at the pivot, and that spring, damper and stops act against.
        mass: mass, m [kg].
        center: center of mass at angle 0, r_c [m].
        inertia: moment of inertia about the pivot, I [kg m^2].
        stiffness: stiffness of its torsion spring, k_t [N m/rad].
        free_angle: angle at which the torsion spring is relaxed, theta_0 [degrees].
        damping: damping of its bearing, c_t [N m s/rad].
        spring: coil spring to the ground, or to the arm that carries it.
        stops: lowest and highest angle [degrees].
        stop_stiffness: stiffness of the stops [N m/rad]; None is the chain's.
        stop_damping: damping of the stops [N m s/rad]; None is half critical.
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
        """Angle of an arm's relaxed torsion spring [rad]."""
        return radians(self.free_angle)

    @property
    def stops_rad(self) -> tuple[float, float]:
        """Lowest and highest angle of an arm [rad], else infinite."""
        if self.stops is None:
            return -math.inf, math.inf
        return radians(self.stops[0]), radians(self.stops[1])

    @property
    def spring_lever(self) -> float:
        """Upper bound of the lever of an arm's coil spring [m]."""
        ends = (self.spring.at, self.spring.anchor) if self.spring is not None else (self.pivot,)
        return minimum(*(hypot(x - self.pivot[0], y - self.pivot[1]) for x, y in (*ends, *ends)))

    @property
    def center_radius(self) -> float:
        """Distance of an arm's center of mass from its pivot [m]."""
        return hypot(self.center[0] - self.pivot[0], self.center[1] - self.pivot[1])

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of an arm's values."""
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
    """Stiffness of an arm's stops, own or a link's at the lever, at most I k/m [N m/rad].

    Args:
        lever: largest distance of the chain from the pivot [m].
    """
    if arm.stop_stiffness is not None:
        return arm.stop_stiffness
    return link_stiffness * minimum(lever * lever, arm.inertia / roller_mass)


def stop_damping(arm: Arm, stiffness: float) -> float:
    """Damping of an arm's stops, own or half the critical one [N m s/rad]."""
    if arm.stop_damping is not None:
        return arm.stop_damping
    return 2.0 * STOP_RATIO * sqrt(stiffness * arm.inertia)
