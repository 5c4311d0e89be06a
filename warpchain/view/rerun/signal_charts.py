"""Signals of a run in Rerun: curves over time, tension image, order spectra."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import (
    SPECTRUM_FLOOR,
    TOOTH_PASSINGS,
    largest_contact_forces,
    latter_half_frames,
    order_spectra,
    part_signals,
    peak_frames,
    peaks_over_time,
    speed_ratio_to_driver,
    strand_tension,
    transmission_error,
)
from warpchain.results.strand_passing import passing_link
from warpchain.results.units import DEGREES
from warpchain.view.palette import Color, packed_tension_colors, tension_color_steps
from warpchain.view.rerun.chart import INK_COLOR, WIDE_CHART, Chart, ChartAxis
from warpchain.view.rerun.streams import ComponentValues, entity_path, list_array, send_columns

if TYPE_CHECKING:
    import rerun as rr

    from warpchain.results.measured import SignalComparison

CURVE_GROUPS = {
    "tension": "link tension [N]",
    "strand tension": "tension at the middle of each strand [N]",
    "contact": "largest contact force on a roller or pin, by sprocket and guide-bar [N]",
    "moment": "moment of the contact forces [N m]",
    "ratio": "speed ratio over that of the teeth [1]",
    "error": "transmission error [degrees]",
    "speed": "sprocket speed [rad/s]",
    "displacement": "strand displacement at mid-span [mm]",
    "friction": "friction power of all joints [W]",
    "coupling": "torque of the couplings [N m]",
    "twist": "twist of the couplings [deg]",
    "arm": "angle of the arms from the drawing [deg]",
    "push": "force of the tensioners [N]",
    "extension": "extension of the tensioners [mm]",
    "pressure": "pressure in the tensioners' chambers [bar]",
    "valves": "torque of the valves against rotation [N m]",
}
"""Groups of curves, a Rerun view each, with titles."""
DISPLAY_FACTORS = {"displacement": 1e3, "extension": 1e3, "pressure": 1e-5} | dict.fromkeys(
    ("error", "twist", "arm"), DEGREES
)
"""Factors from SI for groups of curves."""
MOST_COLUMNS = 4096


def recorded_curves(trajectory: Trajectory) -> Iterator[tuple[str, str, NDArray[np.floating]]]:
    """Group, name and values (F,) of each curve of a trajectory."""
    (tension,) = require_channels(trajectory, "tension")
    parts = trajectory.parts
    yield "tension", "largest", tension.max(axis=1)
    yield "tension", "mean", tension.mean(axis=1)
    yield "tension", "smallest", tension.min(axis=1)
    bodies = [*(s.name for s in parts.sprockets), *(g.name for g in parts.guides)]
    for name, force in zip(bodies, largest_contact_forces(trajectory), strict=True):
        yield "contact", name, force
    if trajectory.joint_friction_power is not None:
        yield "friction", "of joints", trajectory.joint_friction_power.sum(axis=1)
    for k, name in enumerate(parts.strand_names):
        passing = passing_link(trajectory, k)
        yield "strand tension", name, strand_tension(trajectory, k, passing)
        yield "displacement", name, 1e3 * passing.displacement
    for s, sprocket in enumerate(parts.sprockets):
        if trajectory.sprocket_moment is not None:
            yield "moment", sprocket.name, trajectory.sprocket_moment[:, s]
        if trajectory.sprocket_speed is not None:
            yield "speed", sprocket.name, trajectory.sprocket_speed[:, s]
        if s != parts.driver:
            yield "error", sprocket.name, DEGREES * transmission_error(trajectory, s)
            if trajectory.sprocket_speed is not None:
                yield "ratio", sprocket.name, speed_ratio_to_driver(trajectory, s)
    held = trajectory.channels()
    for name, _, channel, group, i in part_signals(parts):
        if channel in held:
            yield group, name, DISPLAY_FACTORS.get(group, 1.0) * held[channel][:, i]


def log_curves(
    stream: rr.RecordingStream,
    root: str,
    trajectory: Trajectory,
    budget: int,
    colors: Mapping[str, Color],
    title: str = "",
) -> None:
    """Logs a trajectory's curves to Rerun, thinned with peaks kept, names after `title`."""
    import pyarrow as pa
    import rerun as rr

    for group, name, values in recorded_curves(trajectory):
        path = entity_path(root, "curves", group, name)
        style = rr.SeriesLines(
            names=[f"{title}: {name}" if title else name],
            colors=[colors.get(name, INK_COLOR)],
            aggregation_policy=rr.components.AggregationPolicy.MinMax,
        )
        stream.log(path, style, static=True)
        frames = peak_frames(values, budget)
        scalars = pa.array(np.asarray(values, dtype=np.float64)[frames])
        column = ComponentValues(rr.Scalars.descriptor_scalars(), list_array(scalars, 1, len(frames)))
        send_columns(stream, path, trajectory.time[frames], [column])


def log_measured_signals(
    stream: rr.RecordingStream, root: str, found: Sequence[SignalComparison], budget: int
) -> list[SpectrumLine]:
    """Logs measured signals to Rerun beside simulated curves; returns spectrum lines."""
    import pyarrow as pa
    import rerun as rr

    lines = []
    for one in found:
        name = f"measured: {one.measured.name}"
        path = entity_path(root, "curves", one.group, name)
        style = rr.SeriesLines(names=[name], colors=[INK_COLOR], widths=[1.5])
        stream.log(path, style, static=True)
        frames = peak_frames(one.measured.values, budget)
        values = DISPLAY_FACTORS.get(one.group, 1.0) * one.measured.values[frames]
        column = ComponentValues(rr.Scalars.descriptor_scalars(), list_array(pa.array(values), 1, len(frames)))
        send_columns(stream, path, one.measured.time[frames], [column])
        spectrum = one.spectra[1]
        if one.measured.unit == "N" and spectrum is not None and one.spectra[0] is not None:
            shown = (spectrum[0] > 0.0) & (spectrum[0] <= one.spectra[0][0][-1])
            lines.append(SpectrumLine(name, INK_COLOR, spectrum[0][shown], spectrum[1][shown]))
    return lines


def curve_axis_range(shown: Sequence[Trajectory], group: str) -> tuple[float, float] | None:
    """Range of a curve group's vertical axis in Rerun, or None."""
    held = [np.zeros(0)]
    for trajectory in shown:
        parts, part = trajectory.parts, latter_half_frames(trajectory)
        for s in range(len(parts.sprockets)):
            if s != parts.driver and group == "error":
                held.append(DEGREES * transmission_error(trajectory, s)[part])
            elif s != parts.driver and group == "ratio" and trajectory.sprocket_speed is not None:
                held.append(speed_ratio_to_driver(trajectory, s)[part])
    values = np.concatenate(held)
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    room = 0.1 * (high - low) or 0.01 * abs(high) or 0.01
    return low - room, high + room


def log_tension_image(
    stream: rr.RecordingStream,
    root: str,
    trajectory: Trajectory,
    shown: Trajectory,
    budget: int,
    top: float,
    width: float = WIDE_CHART,
) -> Chart:
    """Logs the tension of all links over time to Rerun as an image; returns its chart."""
    (tension,) = require_channels(trajectory, "tension")
    _, peaks = peaks_over_time(tension, min(budget, MOST_COLUMNS))
    pixels = _tension_pixels(tension_color_steps(np.ascontiguousarray(peaks.T[::-1]), top))
    axes = (
        ChartAxis("time [s]", 0.0, float(trajectory.time[-1])),
        ChartAxis("link", 0.0, float(trajectory.parts.chain.links)),
    )
    chart = Chart(stream, (root, "tension image"), *axes, width=width, beside=0.4)
    chart.log_image("image", pixels)
    chart.log_frame(grid=False)
    bar = _tension_pixels(np.arange(255, -1, -1, dtype=np.uint8)[:, None])
    chart.log_color_bar(bar, ChartAxis("tension [N]", 0.0, top))
    chart.log_cursor("cursor", shown.time)
    return chart


def _tension_pixels(steps: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pixels (rows, columns, 3) of the tension scale's steps (rows, columns)."""
    packed = packed_tension_colors(steps)
    return np.ascontiguousarray(packed.astype(">u4").view(np.uint8).reshape(*packed.shape, 4)[..., :3])


class SpectrumLine(NamedTuple):
    """Line of an order spectrum's chart: name, color, orders, amplitudes."""

    name: str
    color: Color
    orders: NDArray[np.float64]
    amplitude: NDArray[np.float64]


def spectrum_lines(trajectory: Trajectory, colors: Mapping[str, Color]) -> dict[str, list[SpectrumLine]]:
    """Lines of a recording's order spectra, by chart title."""
    return {
        title: [SpectrumLine(one.name, colors.get(one.name, INK_COLOR), one.orders, one.amplitude) for one in found]
        for title, found in order_spectra(trajectory).items()
    }


def log_spectrum_charts(
    stream: rr.RecordingStream, found: dict[str, list[SpectrumLine]], teeth: Sequence[int]
) -> list[Chart]:
    """Logs charts of order spectra to Rerun; returns them."""
    charts = []
    for title, lines in found.items():
        peak = max(float(line.amplitude.max()) for line in lines)
        if peak <= 0.0:
            continue
        x = ChartAxis("order of the driver's revolution", 0.0, max(float(line.orders[-1]) for line in lines))
        y = ChartAxis(f"amplitude of {title}", SPECTRUM_FLOOR * peak, 2.0 * peak, True)
        chart = Chart(stream, ("spectrum", title), x, y, WIDE_CHART, beside=0.6)
        chart.log_frame()
        passing = [k * z for z in sorted(set(teeth)) for k in range(1, TOOTH_PASSINGS + 1) if k * z <= x.high]
        chart.log_verticals("tooth passing", passing, [f"tooth passing {order}" for order in passing], (120, 120, 60))
        for k, line in enumerate(lines):
            chart.log_line(line.name, line.orders, line.amplitude, line.color)
            chart.log_key(k, line.name, line.color)
        charts.append(chart)
    return charts
