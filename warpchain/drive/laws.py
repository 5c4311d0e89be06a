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
    """Speed after an impact over that before [-] for a hysteresis factor d, (a).

    With x = d r and y = -ln(1 - x), y - 1 + exp(-y) = d - ln(1 + d), by Newton's method.
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
    """Speed after an impact over that before [-] for a damping ratio, (b)."""
    root = math.sqrt(abs(1.0 - zeta * zeta))
    if root < 1e-6:
        return math.exp(-2.0 * zeta)
    half = math.acos(zeta) if zeta < 1.0 else math.acosh(zeta)
    return math.exp(-2.0 * zeta * half / root)


def _kelvin_voigt_zeta(restitution: float) -> float:
    """Damping ratio for a restitution e, -ln e / sqrt(pi^2 + ln^2 e) [-]."""
    logarithm = math.log(restitution)
    return -logarithm / math.hypot(math.pi, logarithm)


@dataclass(frozen=True)
class Law:
    """Contact law of a drive file.

    Attributes:
        force: its function in `kernels/physics/impact.py`.
        factor: dimensionless factor (d or zeta) for a restitution, 0 for 1.
        rebound: speed after an impact over that before for a factor [-].
        unit: unit of the factor in kernels, from stiffness K [N/m^n] and mass m [kg].
        viscous: whether a constant damper stands beside a linear spring, with n = 1.
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
"""Contact laws by name."""


def law_factor(name: str, restitution: float, means: Means = "parameter") -> float:
    """Dimensionless factor of a contact law for a restitution [-].

    Args:
        means: "parameter" is the law's own; "rebound" that with which a free mass rebounds so.
    """
    found: float = elementwise(lambda e: _cached_law_factor(name, e, means))(restitution)
    return found


@lru_cache(maxsize=4096)
def _cached_law_factor(name: str, restitution: float, means: Means) -> float:
    """Factor of a contact law for one restitution [-]."""
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
