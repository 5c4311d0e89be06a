"""Units as engineers write them: millimeters and kilonewtons instead of powers of ten of SI units."""

from __future__ import annotations

import math

PREFIXES = {-9: "n", -6: "\N{MICRO SIGN}", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
BARE = ("1", "", "%", "1/h")
"""Units that take no prefix."""
SMALLEST = {"m": -6, "N": 0, "s": -6, "rad": -3, "N m": 0, "J": -3, "W": 0, "Pa": 3, "m/s": 0, "rad/s": 0}
"""Smallest power of ten that a unit is shown in; -9 for others."""
LARGEST = {"m": 0, "s": 0, "rad": 0, "m/s": 0, "rad/s": 0, "kg": 0}
"""Largest power of ten; 9 for others."""


def display_unit(unit: str, largest: float) -> tuple[str, float]:
    """The unit that values of up to `largest` [SI] are shown in, and the factor that turns SI values into it.

    The unit has a prefix for thousands where that brings the largest value to between 1 and 1,000: 0.0123 m is 12.3 mm,
    18,300 N are 18.3 kN. Lengths go no further up than meters, forces no further down than newtons.

    Args:
        unit: an SI unit such as "N" or "N m"; the prefix goes to the front. "1" and the like stay.
        largest: the largest magnitude to be shown; 0 or what is not finite leaves the unit as it is.
    """
    size = abs(largest)
    if unit in BARE or not math.isfinite(size) or size == 0.0:
        return unit, 1.0
    power = 3 * math.floor(math.log10(size * (1.0 + 1e-12)) / 3.0)
    power = min(max(power, SMALLEST.get(unit, -9)), LARGEST.get(unit, 9))
    return PREFIXES[power] + unit, 10.0**-power
