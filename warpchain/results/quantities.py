"""Quantities in words and on scales, in the units of `results.units`."""

from __future__ import annotations

import math

from warpchain.results.units import shown


def shown_unit(unit: str, *values: float) -> tuple[str, float]:
    """Unit to show values in, "" for a count or ratio, and the factor to multiply them by; the largest decides."""
    word, factor = shown(unit, *values)
    return "" if word == "1" else word, factor


def quantity(value: float, unit: str, deviation: float | None = None, digits: int = 4) -> str:
    """A value with its unit in words: "5.612 kN", and with a deviation "5.612 ± 0.083 kN"."""
    word, factor = shown_unit(unit, value)
    text = f"{value * factor:.{digits}g}"
    if deviation is not None and math.isfinite(deviation):
        text += f" ± {deviation * factor:.2g}"
    return f"{text} {word}".rstrip()
