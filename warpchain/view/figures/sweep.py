"""Spectra over speed: Campbell diagrams of several runs, order cuts of one run-up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.frequencies import excited_orders
from warpchain.errors import SimulationError
from warpchain.model import ChainModel
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.order_tracking import BLOCK_TURNS, OrderCuts, driver_turns, last_rising_frames, order_cuts
from warpchain.results.run import Run, Trajectory, require_channels
from warpchain.results.signals import (
    amplitude_spectrum,
    forward_values,
    latter_half_frames,
    strand_tension,
    strand_transverse_frequency,
)
from warpchain.results.strand_passing import strand_displacement
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import (
    LINE_COLORS,
    Array,
    draw_legend,
    panel_column,
    rpm_of_speed,
    strand_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TOOTH_MULTIPLES = 3
"""Marked multiples of the tooth-passing frequency."""
COLOR_DECADES = 3.0
"""Decades of amplitude in a Campbell diagram's colors."""

STRAND_SIGNALS: dict[str, tuple[str, Callable[[Trajectory, int], NDArray[np.float64]]]] = {
    "displacement": ("displacement at mid-span [mm]", lambda t, k: 1e3 * strand_displacement(t, k)),
    "tension": ("tension at mid-strand [N]", strand_tension),
}
"""Labels and functions (F,) of a strand's signals, by name."""
FEWEST_BLOCKS = 6
"""Blocks that a run-up needs."""
LEAST_RISE = 1.25
"""Fastest over slowest block of a run-up, at least."""
MOST_ORDERS = 6
USUAL_ORDERS = (2.0, 4.0, 0.5, 1.0)
"""Orders of a run-up where few are excited."""


@dataclass(frozen=True)
class SpeedSweep:
    """Spectra of a signal over speeds, for a Campbell diagram.

    Attributes:
        name: of the strand.
        label: the signal with its unit.
        speed: (R,) mean speed of the driver [rpm], ascending.
        frequency, amplitude: R arrays [Hz], [unit of the signal].
        teeth: of the driver.
        natural: (R,) first transverse frequency of the strand [Hz], or None.
        excited: orders that motions and loads excite.
    """

    name: str
    label: str
    speed: NDArray[np.float64]
    frequency: Sequence[NDArray[np.float64]]
    amplitude: Sequence[NDArray[np.float64]]
    teeth: int
    natural: NDArray[np.float64] | None = None
    excited: Sequence[float] = ()


def speed_sweeps(sources: Sequence[Run | str | Path], signal: str = "displacement") -> list[SpeedSweep]:
    """Spectra of each strand over the speeds of recorded variants, ok ones, a sweep a strand.

    Args:
        signal: one of `STRAND_SIGNALS`.

    Raises:
        ArchiveError: an archive that cannot be read.
        SimulationError: an unknown signal, fewer than two speeds, drives of unlike topology or unlike teeth.
    """
    from warpchain.archive import read_archive

    if signal not in STRAND_SIGNALS:
        raise SimulationError(f"signal {signal!r}: allowed are {', '.join(STRAND_SIGNALS)}")
    label, values_of = STRAND_SIGNALS[signal]
    runs = [source if isinstance(source, Run) else read_archive(source) for source in sources]
    found = [run[variant] for run in runs for variant in run if run.ok[run.row_of(variant)]]
    for trajectory in found:
        require_channels(trajectory, "position", "tension", "sprocket_speed", name="a variant for a sweep over speed")
    alike = {(t.drive.strand_names, t.drive.sprockets[t.drive.driver].teeth) for t in found}
    if len(alike) > 1:
        raise SimulationError("a sweep over speed needs variants with the same strands and teeth of the driver")
    found.sort(key=_driver_rpm)
    speeds = np.array([_driver_rpm(trajectory) for trajectory in found])
    if len(np.unique(speeds)) < 2:
        held = f"{len(found)} recorded, all of one speed" if len(found) > 1 else f"{len(found)} recorded"
        raise SimulationError(f"a sweep over speed needs recorded variants of two speeds or more: {held}")
    drive = found[0].drive
    result = []
    for k, name in enumerate(drive.strand_names):
        lines, natural = [], []
        for trajectory in found:
            part = latter_half_frames(trajectory)
            values = np.nan_to_num(values_of(trajectory, k)[part])
            lines.append(amplitude_spectrum(values, float(np.diff(trajectory.time[part]).mean())))
            natural.append(strand_transverse_frequency(trajectory, k))
        frequency, amplitude = zip(*lines, strict=True)
        teeth = drive.sprockets[drive.driver].teeth
        orders = [order.value for order in excited_orders(drive)]
        result.append(
            SpeedSweep(strand_label(name), label, speeds, frequency, amplitude, teeth, np.array(natural), orders)
        )
    return result


def _driver_rpm(trajectory: Trajectory) -> float:
    """Driver's mean speed [rpm] in a sweep's recording, latter half."""
    (sprocket_speed,) = require_channels(trajectory, "sprocket_speed")
    part = sprocket_speed[latter_half_frames(trajectory), trajectory.parts.driver]
    return rpm_of_speed(float(abs(part.mean())))


def campbell_figure(found: Sequence[SpeedSweep], highest: float | None = None) -> Figure:
    """Campbell diagram of spectra over speed, a panel a sweep; raises SimulationError without any.

    `highest` ends the frequency axis [Hz]; None shows `TOOTH_MULTIPLES` tooth passings.
    """
    from matplotlib.colors import LogNorm

    if not found:
        raise SimulationError("no spectra: nothing to draw")
    title = f"Campbell diagram: {found[0].label} over the driver's speed"
    figure, axes = panel_column(len(found), 3.3 * len(found) + 0.7, title, None)
    figure.set_layout_engine("constrained")  # around color bars, and the legend below
    for axis, sweep in zip(axes, found, strict=True):
        passing = sweep.teeth * sweep.speed[-1] / 60.0
        top = min(
            (TOOTH_MULTIPLES + 0.3) * passing if highest is None else highest, min(f[-1] for f in sweep.frequency)
        )
        even = np.linspace(0.0, top, 600)
        image = np.stack(
            [_spectrum_on_grid(even, f, a) for f, a in zip(sweep.frequency, sweep.amplitude, strict=True)], axis=1
        )
        peak = max(float(image[1:].max()), 1e-300)
        middles = 0.5 * (sweep.speed[:-1] + sweep.speed[1:])
        ends = 1.5 * sweep.speed[[0, -1]] - 0.5 * sweep.speed[[1, -2]]
        edges = np.concatenate([ends[:1], middles, ends[1:]])
        up = np.append(even - 0.5 * even[1], even[-1] + 0.5 * even[1])
        norm = LogNorm(peak * 10.0**-COLOR_DECADES, peak)
        mesh = axis.pcolormesh(edges, up, np.maximum(image, 1e-300), norm=norm, cmap="viridis", rasterized=True)
        figure.colorbar(mesh, ax=axis, label=f"amplitude of\n{sweep.label}", extend="min")
        for k in range(1, TOOTH_MULTIPLES + 1):
            words = f"tooth passing, multiples of {sweep.teeth} per revolution" if k == 1 else None
            axis.plot(sweep.speed, k * sweep.teeth * sweep.speed / 60.0, "--", lw=1.0, color="white", label=words)
        for order in sweep.excited:
            words = f"order {order:g} of the driver, excited by a motion or load"
            axis.plot(sweep.speed, order * sweep.speed / 60.0, ":", lw=1.2, color="white", label=words)
        if sweep.natural is not None:
            words = "first transverse frequency at the mean tension, chain moving"
            axis.plot(sweep.speed, sweep.natural, "o-", ms=3, lw=1.0, color=LINE_COLORS[3], label=words)
        axis.set_ylim(0.0, top)
        axis.grid(False)
        axis.set_ylabel("frequency [Hz]")
        axis.set_title(sweep.name, loc="left", fontsize=10)
    names = axes[0].get_legend_handles_labels()
    if names[0]:  # below all panels, on the ground that the white lines need
        figure.legend(*names, loc="outside lower center", ncols=2, fontsize=8, facecolor="0.35", labelcolor="white")
    axes[-1].set_xlabel("mean speed of the driver [rpm]")
    return figure


def _spectrum_on_grid(
    even: NDArray[np.float64], frequency: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Amplitudes of a sweep's spectrum at even frequencies, largest lines kept."""
    step = even[1]
    at = np.rint(frequency / step).astype(int)
    inside = at < len(even)
    out = np.zeros(len(even))
    np.maximum.at(out, at[inside], amplitude[inside])
    empty = np.ones(len(even), dtype=bool)
    empty[at[inside]] = False
    out[empty] = np.interp(even[empty], frequency, amplitude)
    return out


def run_up_orders(model: ChainModel) -> list[float]:
    """Orders of a run-up's cuts: excited ones and tooth passing."""
    from warpchain.assembly.table_cells import shaft_ratio

    teeth = model.sprockets[model.driver].teeth
    found: set[float] = set()
    for s, sprocket in enumerate(model.sprockets):
        turns = teeth / sprocket.teeth
        for cause in (sprocket.prescribed, sprocket.load):
            for harmonic in () if cause is None else cause.harmonics:
                if harmonic.amplitude != 0.0:
                    found.add(round(harmonic.order / shaft_ratio(model, s, harmonic.shaft) * turns, 9))
    found |= set(USUAL_ORDERS[: max(0, len(USUAL_ORDERS) - len(found))])
    return [*sorted(found - {float(teeth)})[: MOST_ORDERS - 1], float(teeth)]


def run_up_cuts(found: EngineeringReport) -> dict[str, tuple[str, dict[str, OrderCuts]]]:
    """Order cuts of a run-up's speeds, tensions and hub forces by title, with unit, or {}."""
    drive, whole = found.model, found.whole
    if any(getattr(whole, name) is None for name in ("sprocket_speed", "sprocket_angle", "position", "tension")):
        return {}
    turns = driver_turns(whole)
    part = last_rising_frames(turns)
    if len(turns[part]) < 64 or np.diff(turns[part]).max() > 0.25:
        return {}
    orders = run_up_orders(drive)
    (sprocket_speed,) = require_channels(whole, "sprocket_speed")

    def cuts_of(values: Array) -> OrderCuts:
        """Order cuts of a signal (F,) over the run-up."""
        return order_cuts(whole.time[part], turns[part], np.nan_to_num(values[part]), orders)

    speeds = {p.name: forward_values(drive, sprocket_speed, s) for s, p in enumerate(drive.sprockets)}
    first = cuts_of(next(iter(speeds.values())))
    if len(first.speed) < FEWEST_BLOCKS or first.speed.max() < LEAST_RISE * first.speed.min():
        return {}
    hubs = EngineeringReport(whole, 0.0, float(whole.time[-1])).hub_forces
    signals = {
        "speed of the shaft": ("rad/s", speeds),
        "tension at mid-strand": (
            "N", {strand_label(name): strand_tension(whole, k) for k, name in enumerate(drive.strand_names)},
        ),
        "force on the hub": (
            "N", {p.name: np.hypot(*hubs[:, s].T) for s, p in enumerate(drive.sprockets)},
        ),
    }  # fmt: skip
    return {
        title: (unit, {name: cuts_of(values) for name, values in of.items()}) for title, (unit, of) in signals.items()
    }


def order_cuts_figure(model: ChainModel, title: str, unit: str, found: dict[str, OrderCuts]) -> Figure:
    """Figure of orders' amplitudes over the driver's speed, by shaft or strand."""
    figure, axes = panel_column(len(found), 1.9 * len(found) + 0.7, "", None)
    word, factor = display_unit(unit, *(cuts.amplitude for cuts in found.values()))
    for axis, (name, cuts) in zip(axes, found.items(), strict=True):
        for k, order in enumerate(cuts.orders):
            mark = "tooth passing" if order == model.sprockets[model.driver].teeth else f"order {order:g}"
            color = LINE_COLORS[k % len(LINE_COLORS)]
            axis.plot(rpm_of_speed(1.0) * cuts.speed, factor * cuts.amplitude[:, k], color=color, lw=1.1, label=mark)
        axis.set_title(name, loc="left", fontsize=9)
        axis.set_ylim(0.0)
        axis.set_ylabel(f"[{word}]")
    axes[0].set_title(f"{next(iter(found))}: amplitude of the {title}", loc="left", fontsize=9)
    draw_legend(axes[0])
    axes[-1].set_xlabel(f"speed of {model.sprockets[model.driver].name} [rpm], mean of {BLOCK_TURNS:g} revolutions")
    return figure
