"""Contact laws by name: factor for a restitution, and rebound."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from warpchain.argument_checks import check_arguments
from warpchain.drive import plugins
from warpchain.drive.stack_math import elementwise, sqrt
from warpchain.errors import PluginError

Means = Literal["parameter", "rebound"]


def hysteretic_rebound(d: float) -> float:
    """Rebound speed over impact speed for a hysteresis factor d [-]."""
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
    """Rebound speed over impact speed for a damping ratio [-]."""
    root = math.sqrt(abs(1.0 - zeta * zeta))
    if root < 1e-6:
        return math.exp(-2.0 * zeta)
    half = math.acos(zeta) if zeta < 1.0 else math.acosh(zeta)
    return math.exp(-2.0 * zeta * half / root)


def _kelvin_voigt_zeta(restitution: float) -> float:
    """Damping ratio of the Kelvin-Voigt law for a restitution [-]."""
    logarithm = math.log(restitution)
    return -logarithm / math.hypot(math.pi, logarithm)


@dataclass(frozen=True)
class Law:
    """Contact law of a drive file.

    Attributes:
        force: function of `kernels/physics/impact.py` by name, or a plug-in's.
        factor, rebound, unit, viscous: as of `contact_law`.
    """

    force: Any
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
LARGEST_FACTOR = 1e12
"""Factor at which any law's rebound is next to 0."""
LAWS_IN_USE: dict[str, None] = {}
"""Names of plug-ins' laws that drives have, in order."""


def is_law(name: str) -> bool:
    """Whether there is a contact law of this name, also of installed plug-ins."""
    if name not in LAWS:
        plugins.load_installed_plugins()
    if name in LAWS and not isinstance(LAWS[name].force, str):
        LAWS_IN_USE[name] = None
    return name in LAWS


@check_arguments(PluginError)
def contact_law(
    name: str,
    *,
    factor: Callable[[float], float],
    rebound: Callable[[float], float],
    unit: Callable[[Any, Any], Any] = lambda stiffness, mass: 1.0,
    viscous: bool = False,
) -> Callable[[Any], Any]:
    """Decorator of a plug-in's `warp.func` that makes it the contact law `name` of drive files.

    The function gets the elastic force K pen^n [N], the impact's speed v0 [m/s] and the damping (factor times `unit`),
    of one type, float64 or float32. It returns a damper c [N s/m], at least 0, and the speeds that bound its v below
    and above [m/s], of that type. The contact's force is K pen^n + c v, never negative.

    Args:
        factor: dimensionless factor for a restitution e, 0 < e <= 1; 0 for 1.
        rebound: speed after a free impact over that before for a factor [-].
        unit: of the factor, from stiffness K [N/m^n] and mass m [kg], numbers or arrays.
        viscous: whether a constant damper stands beside a linear spring, with n = 1.

    Raises:
        PluginError: a name that is taken or not allowed, no `warp.func`, or a factor and a rebound that are no
            functions of numbers.
    """

    def add(force: Any) -> Any:
        """Adds the law; returns its function."""
        import warp as wp

        if not isinstance(force, wp.Function) or force.func is None:
            raise PluginError(f"contact law {name!r}: must be a function with @warp.func below @contact_law")
        if len(force.input_types) != 3:
            count = len(force.input_types)
            raise PluginError(f"contact law {name!r}: has {count} arguments; must be elastic, speed, damping")
        numbers = [_number_function(f"contact law {name!r}: {what}", of)
                   for what, of in (("factor", factor), ("rebound", rebound))]  # fmt: skip
        for of, at in zip(numbers, (0.5, 0.1), strict=True):
            of(at)
        law, file = Law(force, numbers[0], numbers[1], unit, viscous), force.func.__code__.co_filename
        plugins.add_to_registry(LAWS, "contact law", name, law, file)
        return force

    return add


def _number_function(what: str, function: Callable[[float], float]) -> Callable[[float], float]:
    """A plug-in's function of a number, with errors of one line."""
    if not hasattr(function, "__code__"):
        raise PluginError(f"{what} must be a function of a number")

    def call(x: float) -> float:
        """The function's value, a finite number."""
        with plugins.function_code(function, f"{what} of {x:g}"):
            value = plugins.checked_number(function(x))
            if value is None:
                raise PluginError("gives None; must be a number")
            return value

    return call


def law_factor(name: str, restitution: float, means: Means = "parameter") -> float:
    """Dimensionless factor of a contact law for a restitution [-].

    Args:
        means: "parameter", the law's own; or "rebound", a free mass's.
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
        if high > LARGEST_FACTOR:
            raise PluginError(f"contact law {name!r}: no factor has a rebound of {restitution:g}")
    while True:  # the rebound falls with the factor: bisection to the last digit
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        low, high = (middle, high) if law.rebound(middle) > restitution else (low, middle)
