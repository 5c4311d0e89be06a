r"""Viscosity of oils over temperature by ASTM D341 (Walther), nu in mm^2/s and T in K:

    log10(log10(nu + 0.7)) = A - B log10(T).                                                              (a)

Two viscosities give A and B, as data sheets have them, at 40 and 100 degrees C. B is 3.1 for engine oils of several
grades (a 5W-30 of 62 mm^2/s at 40 degrees C and 10.3 at 100), 3.5 to 3.7 for mineral oils of a single one. D341 takes
the constant 0.7 for 2 to 2e7 mm^2/s, of oils that are liquid and have not begun to cloud.
"""

from __future__ import annotations

import math
from typing import NamedTuple

KELVIN = 273.15
SLOPE = 3.1
"""B of (a) by default."""
REFERENCE = 20.0
"""Temperature [degrees C] at which drives are as their files say."""
SWEPT_FROM = 40.0
"""Temperature [degrees C] at which a drive's viscosity is meant where the rig sweeps over temperature."""
THINNEST, THICKEST = 2e-6, 20.0
"""Viscosities [m^2/s] that (a) holds for."""


class Walther(NamedTuple):
    """The constants of (a): A and B."""

    a: float
    b: float

    def viscosity(self, temperature: float) -> float:
        """Kinematic viscosity [m^2/s] at a temperature [degrees C]; infinite where it is beyond all numbers."""
        try:
            return 1e-6 * (10.0 ** (10.0 ** (self.a - self.b * math.log10(temperature + KELVIN))) - 0.7)
        except OverflowError:
            return math.inf

    def temperature(self, viscosity: float) -> float:
        """Temperature [degrees C] at which the oil has a viscosity [m^2/s]."""
        return 10.0 ** ((self.a - _double_logarithm(viscosity)) / self.b) - KELVIN


def _double_logarithm(viscosity: float) -> float:
    """log10 log10 of a viscosity [m^2/s], as in (a)."""
    return math.log10(math.log10(1e6 * viscosity + 0.7))


def walther_from_two_points(at_40: float, at_100: float) -> Walther:
    """(a) through the viscosities at 40 and 100 degrees C [m^2/s], `THINNEST` to `THICKEST`."""
    fall = _double_logarithm(at_40) - _double_logarithm(at_100)
    return walther_from_slope(at_40, 40.0, fall / math.log10((100.0 + KELVIN) / (40.0 + KELVIN)))


def walther_from_slope(viscosity: float, at: float = SWEPT_FROM, slope: float = SLOPE) -> Walther:
    """(a) of an oil that has a viscosity [m^2/s] at a temperature [degrees C], with B given."""
    return Walther(_double_logarithm(viscosity) + slope * math.log10(at + KELVIN), slope)
