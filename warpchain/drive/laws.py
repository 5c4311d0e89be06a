"""Contact laws by name: the factor of a law for a restitution, and the rebound that results."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from warpchain.drive.stack_math import elementwise, sqrt

Means = Literal["parameter", "rebound"]


def hysteretic_rebound(d: float) -> float:
    """Speed after an impact over the speed before [-] for the hysteresis factor d, from (a).

    With x = d r and y = -ln(1 - x) it reads y - 1 + exp(-y) = d - ln(1 + d); the left side is convex, so Newton's
    method descends to the root.
    """
    if d < 1e-4:  # both sides nearly cancel: the series of r in d
        return 1.0 - 2.0 * d / 3.0 + 4.0 * d * d / 9.0
    target = d - math.log1p(d)
    y = target + math.sqrt(2.0 * target)
    for _ in range(100):
        change = (y + math.expm1(-y) - target) / -math.expm1(-y)
        y -= change
        if abs(change) <= 1e-15 * y:
            break
    return -math.expm1(-y) / d


def kelvin_voigt_rebound(zeta: float) -> float:
    """Speed after an impact over the speed before [-] for the damping ratio zeta, (b)."""
    root = math.sqrt(abs(1.0 - zeta * zeta))
    if root < 1e-6:
        return math.exp(-2.0 * zeta)
    half = math.acos(zeta) if zeta < 1.0 else math.acosh(zeta)
    return math.exp(-2.0 * zeta * half / root)


def _kelvin_voigt_zeta(restitution: float) -> float:
    """Damping ratio zeta of the law for a restitution e, -ln e / sqrt(pi^2 + ln^2 e)."""
    logarithm = math.log(restitution)
    return -logarithm / math.hypot(math.pi, logarithm)


@dataclass(frozen=True)
class Law:
    """A contact law as the drive file names it.

    Attributes:
        force: name of its function in `kernels/physics/impact.py`.
        factor: of the restitution e, the law's own dimensionless factor (d or zeta), 0 for e = 1.
        rebound: of that factor, the speed after an impact over the speed before; falls from 1 towards 0.
        unit: of stiffness K [N/m^n] and mass m [kg], what the factor is multiplied by for the kernels.
        viscous: True for a damper of constant c beside a linear spring: n must be 1, and c shortens the longest step.
    """

    force: str
    factor: Callable[[float], float]
    rebound: Callable[[float], float]
    unit: Callable[[float, float], float] = lambda stiffness, mass: 1.0
    viscous: bool = False


LAWS = {
    "lankarani-nikravesh": Law(
        "hysteretic_damper",
        lambda e: 0.75 * (1.0 - e * e),
        hysteretic_rebound,
    ),
    "flores": Law("hysteretic_damper", lambda e: 1.6 * (1.0 - e) / e, hysteretic_rebound),
    "hunt-crossley": Law("hysteretic_damper", lambda e: 1.5 * (1.0 - e), hysteretic_rebound),
    "kelvin-voigt": Law(
        "kelvin_voigt_damper",
        _kelvin_voigt_zeta,
        kelvin_voigt_rebound,
        unit=lambda stiffness, mass: 2.0 * sqrt(stiffness * mass),
        viscous=True,
    ),
}
"""The laws by name; a new one is a function in `kernels/physics/impact.py` and a row here."""


def law_factor(name: str, restitution: float, means: Means = "parameter") -> float:
    """A law's dimensionless factor for a restitution [-].

    Args:
        name: of the law.
        restitution: e, above 0, at most 1.
        means: "parameter" puts it into the law's own formula; "rebound" finds the factor with which a free mass
            rebounds by just that.
    """
    found: float = elementwise(lambda e: _cached_law_factor(name, e, means))(restitution)
    return found


@lru_cache(maxsize=4096)
def _cached_law_factor(name: str, restitution: float, means: Means) -> float:
    law = LAWS[name]
    if means == "parameter" or restitution == 1.0:
        return law.factor(restitution)
    low, high = 0.0, 1.0
    while law.rebound(high) > restitution:
        low, high = high, 2.0 * high
    while True:  # the rebound falls with the factor: bisection to the last digit
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        low, high = (middle, high) if law.rebound(middle) > restitution else (low, middle)
