"""Campbell diagrams: how the spectrum of a signal moves with the speed of the drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.orders import excited_orders
from warpchain.errors import SimulationError
from warpchain.results.run import Run, Trajectory
from warpchain.results.scene import strand_displacement
from warpchain.results.signals import amplitude_spectrum, latter_half, strand_tension, transverse_frequency
from warpchain.view.figures.style import LINES, arrowed, panels, rpm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PASSINGS = 3
"""Multiples of the tooth-passing frequency that are marked."""
DECADES = 3.0
"""Decades of amplitude that the colors span."""

SIGNALS: dict[str, tuple[str, Callable[[Trajectory, int], NDArray[np.float64]]]] = {
    "displacement": ("displacement at mid-span [mm]", lambda t, k: 1e3 * strand_displacement(t, k)),
    "tension": ("tension at mid-strand [N]", strand_tension),
}
"""Signals of a strand, with their titles."""


@dataclass(frozen=True)
class Sweep:
    """Spectra of one signal over speeds.

    Attributes:
        name: of the strand, or of what else the signal is of.
        label: the signal with its unit.
        speed: (R,) mean speed of the driver [rpm], ascending.
        frequency: R arrays of frequencies [Hz].
        amplitude: R arrays of amplitudes.
        teeth: of the driver.
        natural: (R,) first transverse frequency of the strand at its mean tension [Hz]; None leaves it out.
        excited: orders of the driver's revolution that motions and loads excite.
    """

    name: str
    label: str
    speed: NDArray[np.float64]
    frequency: Sequence[NDArray[np.float64]]
    amplitude: Sequence[NDArray[np.float64]]
    teeth: int
    natural: NDArray[np.float64] | None = None
    excited: Sequence[float] = ()


def sweeps(sources: Sequence[Run | str | Path], signal: str = "displacement") -> list[Sweep]:
    """The spectra of every strand over the recorded variants of runs or archives that are ok, in the latter halves.

    Args:
        signal: one of `SIGNALS`.

    Raises:
        ArchiveError: an archive that cannot be read.
        SimulationError: an unknown signal, fewer than two speeds, drives of unlike topology or unlike teeth.
    """
    from warpchain.archive import read_archive

    if signal not in SIGNALS:
        raise SimulationError(f"signal {signal!r}: allowed are {', '.join(SIGNALS)}")
    label, values_of = SIGNALS[signal]
    runs = [source if isinstance(source, Run) else read_archive(source) for source in sources]
    found = [run[variant] for run in runs for variant in run if run.ok[run.row_of(variant)]]
    for trajectory in found:
        for channel in ("position", "tension", "sprocket_speed"):
            if getattr(trajectory, channel) is None:
                raise SimulationError(f"a variant was recorded without {channel}, which a sweep over speed needs")
    alike = {(t.drive.strand_names, t.drive.sprockets[t.drive.driver].teeth) for t in found}
    if len(alike) > 1:
        raise SimulationError("a sweep over speed needs variants with the same strands and teeth of the driver")
    found.sort(key=_speed)
    speeds = np.array([_speed(trajectory) for trajectory in found])
    if len(np.unique(speeds)) < 2:
        held = f"{len(found)} recorded, all of one speed" if len(found) > 1 else f"{len(found)} recorded"
        raise SimulationError(f"a sweep over speed needs recorded variants of two speeds or more: {held}")
    drive = found[0].drive
    result = []
    for k, name in enumerate(drive.strand_names):
        lines, natural = [], []
        for trajectory in found:
            part = latter_half(trajectory)
            values = np.nan_to_num(values_of(trajectory, k)[part])
            lines.append(amplitude_spectrum(values, float(np.diff(trajectory.time[part]).mean())))
            natural.append(transverse_frequency(trajectory, k))
        frequency, amplitude = zip(*lines, strict=True)
        teeth = drive.sprockets[drive.driver].teeth
        orders = [order.value for order in excited_orders(drive)]
        result.append(Sweep(arrowed(name), label, speeds, frequency, amplitude, teeth, np.array(natural), orders))
    return result


def _speed(trajectory: Trajectory) -> float:
    """Mean speed of the driver over the latter half [rpm]."""
    assert trajectory.sprocket_speed is not None
    part = trajectory.sprocket_speed[latter_half(trajectory), trajectory.drive.driver]
    return rpm(float(abs(part.mean())))


def campbell_figure(found: Sequence[Sweep], highest: float | None = None) -> Figure:
    """Spectra over speed, one panel a sweep: amplitude as color, tooth-passing and natural frequencies as lines.

    Args:
        highest: upper end of the frequency axis [Hz]; None shows `PASSINGS` tooth passings at the highest speed.

    Raises:
        SimulationError: nothing to draw.
    """
    from matplotlib.colors import LogNorm

    if not found:
        raise SimulationError("no spectra: nothing to draw")
    title = f"Campbell diagram: {found[0].label} over the driver's speed"
    figure, axes = panels(len(found), 3.3 * len(found) + 0.7, title, None)
    for axis, sweep in zip(axes, found, strict=True):
        passing = sweep.teeth * sweep.speed[-1] / 60.0
        top = min((PASSINGS + 0.3) * passing if highest is None else highest, min(f[-1] for f in sweep.frequency))
        even = np.linspace(0.0, top, 600)
        image = np.stack([_largest(even, f, a) for f, a in zip(sweep.frequency, sweep.amplitude, strict=True)], axis=1)
        peak = max(float(image[1:].max()), 1e-300)
        middles = 0.5 * (sweep.speed[:-1] + sweep.speed[1:])
        ends = 1.5 * sweep.speed[[0, -1]] - 0.5 * sweep.speed[[1, -2]]
        edges = np.concatenate([ends[:1], middles, ends[1:]])
        up = np.append(even - 0.5 * even[1], even[-1] + 0.5 * even[1])
        norm = LogNorm(peak * 10.0**-DECADES, peak)
        mesh = axis.pcolormesh(edges, up, np.maximum(image, 1e-300), norm=norm, cmap="viridis", rasterized=True)
        figure.colorbar(mesh, ax=axis, label=f"amplitude of\n{sweep.label}", extend="min")
        for k in range(1, PASSINGS + 1):
            words = f"tooth passing, multiples of {sweep.teeth} per revolution" if k == 1 else None
            axis.plot(sweep.speed, k * sweep.teeth * sweep.speed / 60.0, "--", lw=1.0, color="white", label=words)
        for order in sweep.excited:
            words = f"order {order:g} of the driver, excited by a motion or load"
            axis.plot(sweep.speed, order * sweep.speed / 60.0, ":", lw=1.2, color="white", label=words)
        if sweep.natural is not None:
            words = "first transverse frequency at the mean tension, chain moving"
            axis.plot(sweep.speed, sweep.natural, "o-", ms=3, lw=1.0, color=LINES[3], label=words)
        axis.set_ylim(0.0, top)
        axis.grid(False)
        axis.set_ylabel("frequency [Hz]")
        axis.set_title(sweep.name, loc="left", fontsize=10)
    names = axes[0].get_legend_handles_labels()
    if names[0]:  # below all panels, on the ground that the white lines need
        figure.legend(*names, loc="outside lower center", ncols=2, fontsize=8, facecolor="0.35", labelcolor="white")
    axes[-1].set_xlabel("mean speed of the driver [rpm]")
    return figure


def _largest(
    even: NDArray[np.float64], frequency: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A spectrum on even frequencies: the largest line near each, between lines the nearest one."""
    step = even[1]
    at = np.rint(frequency / step).astype(int)
    inside = at < len(even)
    out = np.zeros(len(even))
    np.maximum.at(out, at[inside], amplitude[inside])
    empty = np.ones(len(even), dtype=bool)
    empty[at[inside]] = False
    out[empty] = np.interp(even[empty], frequency, amplitude)
    return out
