"""Friction in joints, and where rollers touch teeth and guide-bars: coefficients as the kernels take them.

A roller that rolls on a guide-bar turns on its bush, and passes on no more than that friction: at most mu_b r_b / R_r
of the normal force, mu_b of the joint and R_r the roller's radius. The bush's radius r_b is taken as the pin's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warpchain.drive.stack_math import is_true_somewhere, maximum, minimum

if TYPE_CHECKING:
    from warpchain.drive import Drive, ImpactLaw
    from warpchain.drive.chain import Joint


@dataclass(frozen=True)
class Rubbing:
    """Coefficients of a contact: mu = dynamic + (static - dynamic) exp(-(v / stribeck_speed)^2).

    Attributes:
        dynamic, static: [-].
        stribeck_speed: [m/s].
    """

    dynamic: float
    static: float
    stribeck_speed: float

    @property
    def rubs(self) -> bool:
        """Whether there is friction."""
        return is_true_somewhere(self.most > 0.0)

    @property
    def most(self) -> float:
        """The larger of the two coefficients [-]."""
        return maximum(self.dynamic, self.static)


def rubbing_of(law: ImpactLaw | Joint, most: float = math.inf) -> Rubbing:
    """Of a contact, or of joints; `most` bounds the coefficients."""
    dynamic = 0.0 if law.friction is None else law.friction
    static = dynamic if law.static_friction is None else law.static_friction
    speed = 1.0 if law.stribeck_speed is None else law.stribeck_speed
    if most is not math.inf:
        dynamic, static = minimum(dynamic, most), minimum(static, most)
    return Rubbing(dynamic, static, speed)


def tooth_rubbing(drive: Drive) -> Rubbing:
    """Of rollers and teeth."""
    return rubbing_of(drive.contact.sprocket)


def guide_rubbing(drive: Drive, g: int) -> Rubbing:
    """Of rollers, or the chain's plates, and guide-bar g."""
    law = drive.guide_contact(g)
    return rubbing_of(law, _rolling(drive) if law.rolling else math.inf)


def _rolling(drive: Drive) -> float:
    """The coefficient that a rolling roller transmits, mu_b r_b / R_r [-]; 0 where joints have no friction."""
    joint, pin_radius = getattr(drive.chain, "joint", None), getattr(drive.chain, "pin_radius", None)
    if joint is None or pin_radius is None:
        return 0.0
    return joint.friction * pin_radius / drive.chain.roller_radius
