"""Units as engineers read them: 42 kN instead of 42,000 N, angles in degrees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MILLI, MICRO, KILO, MEGA, GIGA = 1e3, 1e6, 1e-3, 1e-6, 1e-9
DEGREES = 180.0 / math.pi

DISPLAY_UNITS: dict[str, tuple[tuple[float, str, float], ...]] = {
    "m": ((0.0, "\N{MICRO SIGN}m", MICRO), (1e-4, "mm", MILLI), (1.0, "m", 1.0)),
    "s": ((0.0, "\N{MICRO SIGN}s", MICRO), (1e-3, "ms", MILLI), (1.0, "s", 1.0)),
    "rad": ((0.0, "degrees", DEGREES),),
    "N": ((0.0, "mN", MILLI), (0.1, "N", 1.0), (1e3, "kN", KILO), (1e6, "MN", MEGA)),
    "N m": ((0.0, "mN m", MILLI), (0.1, "N m", 1.0), (1e4, "kN m", KILO)),
    "N s": ((0.0, "mN s", MILLI), (0.1, "N s", 1.0), (1e3, "kN s", KILO)),
    "N/m": ((0.0, "N/m", 1.0), (1e3, "kN/m", KILO), (1e6, "MN/m", MEGA), (1e9, "GN/m", GIGA)),
    "N s/m": ((0.0, "N s/m", 1.0), (1e3, "kN s/m", KILO), (1e6, "MN s/m", MEGA)),
    "J": ((0.0, "mJ", MILLI), (1.0, "J", 1.0), (1e3, "kJ", KILO), (1e6, "MJ", MEGA)),
    "W": ((0.0, "mW", MILLI), (1.0, "W", 1.0), (1e3, "kW", KILO), (1e6, "MW", MEGA)),
    "Pa": ((0.0, "Pa", 1.0), (1e3, "kPa", KILO), (1e6, "MPa", MEGA), (1e9, "GPa", GIGA)),
    "Hz": ((0.0, "Hz", 1.0), (1e3, "kHz", KILO)),
}


def display_unit(unit: str, *values: Any) -> tuple[str, float]:
    """Display unit of SI values, and factor to it."""
    whole = np.concatenate([np.ravel(each) for each in values]) if values else np.zeros(0)
    largest = float(np.abs(whole[np.isfinite(whole)]).max(initial=0.0))
    held = [(word, factor) for least, word, factor in DISPLAY_UNITS.get(unit, ()) if largest >= least]
    return held[-1] if held and largest > 0.0 else (unit, 1.0)


def display_unit_word(unit: str, *values: Any) -> tuple[str, float]:
    """Display unit of SI values, "" for none, and factor."""
    word, factor = display_unit(unit, *values)
    return "" if word == "1" else word, factor


def distinguishing_decimals(values: Any, digits: int = 4) -> int:
    """Number of decimals that distinguish displayed values."""
    held = np.asarray(values, dtype=float)
    held = held[np.isfinite(held)]
    largest, spread = float(np.abs(held).max(initial=0.0)), float(np.ptp(held)) if held.size else 0.0
    scale = spread if spread > 1e-9 * largest else largest
    return digits - 1 - math.floor(math.log10(scale)) if scale > 0.0 else 0


def quantity_words(value: float, unit: str, deviation: float | None = None, digits: int = 4) -> str:
    """Text of an SI value in its display unit: "5.612 kN"."""
    word, factor = display_unit_word(unit, value)
    text = f"{value * factor:.{digits}g}"
    if deviation is not None and math.isfinite(deviation):
        text += f" ± {deviation * factor:.2g}"
    return f"{text} {word}".rstrip()
