"""Features of a signal: statistics, amplitudes of orders, root mean squares of frequency bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.results.measured import LINES_WITHIN
from warpchain.results.measured_file import SIGNAL_STATISTICS
from warpchain.results.signals import amplitude_spectrum

Array = NDArray[np.float64]
ERROR_PARTS = 8


@dataclass(frozen=True)
class SignalFeatures:
    """Choice of features to which a signal is reduced."""

    statistics: tuple[str, ...] = ()  # of `measured_file.SIGNAL_STATISTICS`
    orders: tuple[float, ...] = ()  # of the driver's revolution, whose amplitudes are taken
    bands: tuple[tuple[float, float], ...] = ()  # [low, high] [Hz], of root mean squares

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a signal's features."""
        of_orders = (f"order {order:g}" for order in self.orders)
        return (*self.statistics, *of_orders, *(f"{low:g} to {high:g} Hz" for low, high in self.bands))

    def values_of_signal(self, time: Array, values: Array, turns: float) -> Array:
        """Features (N,) of a signal (K,), or nan.

        Args:
            turns: mean speed of the driver [1/s].
        """
        held = np.isfinite(values)
        time, values = time[held], values[held]
        if len(time) < 8:
            return np.full(len(self.names), np.nan)
        found = [SIGNAL_STATISTICS[name](values) for name in self.statistics]
        if not (self.orders or self.bands):
            return np.array(found)
        even = np.linspace(time[0], time[-1], len(time))
        lines, amplitude = amplitude_spectrum(np.interp(even, time, values), float(even[1] - even[0]))
        found += [_amplitude_near_frequency(lines, amplitude, order * turns) for order in self.orders]
        return np.array(found + [_band_root_mean_square(lines, amplitude, *band) for band in self.bands])

    def standard_errors(self, time: Array, values: Array, turns: float) -> Array:
        """Standard errors (N,) of a signal's features."""
        cuts = np.array_split(np.arange(len(time)), ERROR_PARTS)
        parts = np.array([self.values_of_signal(time[cut], values[cut], turns) for cut in cuts])
        return np.nan_to_num(parts.std(axis=0, ddof=1) / np.sqrt(ERROR_PARTS))


def _amplitude_near_frequency(lines: Array, amplitude: Array, frequency: float) -> float:
    """Largest amplitude of a spectrum near a frequency."""
    at = round(frequency / float(lines[1]))
    if at <= LINES_WITHIN or at + LINES_WITHIN >= len(lines):
        return np.nan
    return float(amplitude[at - LINES_WITHIN : at + LINES_WITHIN + 1].max())


def _band_root_mean_square(lines: Array, amplitude: Array, low: float, high: float) -> float:
    """Root mean square of a frequency band, from a spectrum."""
    inside = (lines >= low) & (lines < high)
    if inside.sum() < 4 or high > lines[-1]:
        return np.nan
    return float(np.sqrt((amplitude[inside] ** 2).sum() / 2.0 / 1.5))
