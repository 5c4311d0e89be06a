"""A measured signal over the simulated one as a figure: over time, and order spectra of both."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.results.measured import Comparison
from warpchain.results.signals import SPECTRUM_FLOOR, TOOTH_PASSINGS
from warpchain.results.units import display_unit
from warpchain.view.figures.style import arrowed, curve, key, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = (("simulated", "tab:blue"), ("measured", "tab:orange"))


def measured_figure(drive: Drive, found: Comparison) -> Figure:
    """Both signals over time where they overlap, or all of both, and below their order spectra."""
    measured = found.measured
    signals = [(found.time, found.simulated), (measured.time, measured.values)]
    first, last = max(time[0] for time, _ in signals), min(time[-1] for time, _ in signals)
    if last > first:
        signals = [(t[(t >= first) & (t <= last)], values[(t >= first) & (t <= last)]) for t, values in signals]
    finite = [values[np.isfinite(values)] for _, values in signals]
    unit, factor = display_unit(measured.unit, max(float(np.abs(values).max(initial=0.0)) for values in finite))
    spectra = any(spectrum is not None for spectrum in found.spectra)
    title = f"{arrowed(measured.name)}: simulated and measured"
    figure, axes = panels(1 + spectra, 3.6 + 3.4 * spectra, title, drive, share=False)
    for (word, color), (time, values) in zip(KINDS, signals, strict=True):
        curve(axes[0], time, factor * values, color=color, label=word)
    axes[0].set_xlabel("time [s]")
    quantity = measured.name.rsplit(".", 1)[-1]
    axes[0].set_ylabel(f"{quantity} [{unit}]")
    key(axes[0])
    if spectra:
        _draw_orders(axes[1], drive, found, factor)
        axes[1].set_ylabel(f"amplitude of {quantity} [{unit}]")
    return figure


def _draw_orders(axis: Any, drive: Drive, found: Comparison, factor: float) -> None:
    driver = drive.sprockets[drive.driver]
    last = (TOOTH_PASSINGS + 0.5) * driver.teeth
    peak = 0.0
    for (word, color), spectrum in zip(KINDS, found.spectra, strict=True):
        if spectrum is not None:
            shown = (spectrum[0] > 0.0) & (spectrum[0] <= last)
            amplitude = factor * spectrum[1][shown]
            curve(axis, spectrum[0][shown], amplitude, color=color, label=word)
            peak = max(peak, float(amplitude.max(initial=0.0)))
    for k in range(1, TOOTH_PASSINGS + 1):
        mark = f"tooth passing, multiples of {driver.teeth}" if k == 1 else None
        axis.axvline(k * driver.teeth, color="black", lw=0.8, ls=":", label=mark)
    if peak > 0.0:
        axis.set_yscale("log")
        axis.set_ylim(SPECTRUM_FLOOR * peak, 2.0 * peak)
    axis.set_xlim(0.0, last)
    axis.set_xlabel(f"order [multiples of the revolutions of {driver.name}]")
    key(axis)
