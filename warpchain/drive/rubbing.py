"""What rubs where rollers touch teeth and guide-bars: the coefficients of dry friction as the kernels take them.

A roller that rolls on a guide-bar turns on its bush, and passes on no more than that friction: at most mu_b r_b / R_r
of the normal force, mu_b of the joint and R_r the roller's radius. The bush's radius r_b is taken as the pin's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from warpchain.drive import Drive, ImpactLaw


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
        return max(self.dynamic, self.static) > 0.0


def _rubbing(law: ImpactLaw, most: float = math.inf) -> Rubbing:
    dynamic = law.friction or 0.0
    static = dynamic if law.static_friction is None else law.static_friction
    return Rubbing(min(dynamic, most), min(static, most), law.stribeck_speed or 1.0)


def tooth_rubbing(drive: Drive) -> Rubbing:
    """Of rollers and teeth."""
    return _rubbing(drive.contact.sprocket)


def guide_rubbing(drive: Drive, g: int) -> Rubbing:
    """Of rollers, or the chain's plates, and guide-bar g."""
    law = drive.guide_contact(g)
    return _rubbing(law, _rolling(drive) if law.rolling else math.inf)


def _rolling(drive: Drive) -> float:
    """What a rolling roller transmits, mu_b r_b / R_r [-]; nothing where joints do not rub."""
    joint, pin_radius = getattr(drive.chain, "joint", None), getattr(drive.chain, "pin_radius", None)
    if joint is None or pin_radius is None:
        return 0.0
    return float((joint.friction or 0.0) * pin_radius / drive.chain.roller_radius)
