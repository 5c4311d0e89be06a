"""Viscosity of oils over temperature by ASTM D341 (Walther), nu in mm^2/s and T in K:

    log10(log10(nu + 0.7)) = A - B log10(T),  2 <= nu <= 2e7.                                             (a)

B is 3.1 for multigrade engine oils, 3.5 to 3.7 for single-grade mineral oils.
"""

from __future__ import annotations

import math
from typing import NamedTuple

KELVIN = 273.15
SLOPE = 3.1
"""Default slope B of (a) [-]."""
REFERENCE = 20.0
"""Reference temperature of drive files [degrees C]."""
SWEPT_FROM = 40.0
"""Reference temperature of viscosity in sweeps [degrees C]."""
THINNEST, THICKEST = 2e-6, 20.0
"""Viscosities for which (a) holds [m^2/s]."""


class Walther(NamedTuple):
    """Constants A and B of an oil's viscosity, (a)."""

    a: float
    b: float

    def viscosity(self, temperature: float) -> float:
        """Kinematic viscosity at a temperature [degrees C], or infinite [m^2/s]."""
        try:
            return 1e-6 * (10.0 ** (10.0 ** (self.a - self.b * math.log10(temperature + KELVIN))) - 0.7)
        except OverflowError:
            return math.inf

    def temperature(self, viscosity: float) -> float:
        """Temperature of an oil's viscosity [degrees C]."""
        return 10.0 ** ((self.a - _double_logarithm(viscosity)) / self.b) - KELVIN


def _double_logarithm(viscosity: float) -> float:
    """log10 log10 of a viscosity [m^2/s], (a)."""
    return math.log10(math.log10(1e6 * viscosity + 0.7))


def walther_from_two_points(at_40: float, at_100: float) -> Walther:
    """Walther's constants through viscosities at 40 and 100 degrees C."""
    fall = _double_logarithm(at_40) - _double_logarithm(at_100)
    return walther_from_slope(at_40, 40.0, fall / math.log10((100.0 + KELVIN) / (40.0 + KELVIN)))


def walther_from_slope(viscosity: float, at: float = SWEPT_FROM, slope: float = SLOPE) -> Walther:
    """Walther's constants from a viscosity at a temperature and B."""
    return Walther(_double_logarithm(viscosity) + slope * math.log10(at + KELVIN), slope)
