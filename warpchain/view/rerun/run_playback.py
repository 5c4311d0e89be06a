"""Playback of runs in Rerun (docs/playback.md): drive in motion, curves, tension image, spectra, ensemble.

Everything is logged with its y turned around, as Rerun's 2D views have y pointing down.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.run import Run, Trajectory
from warpchain.results.signals import STRAND_TENSION_TITLE, forward_values, part_signals
from warpchain.view.palette import CURVE_PALETTE, Color, ScaleTop, curve_colors, tension_scale_top
from warpchain.view.recorded_variants import (
    DRIVE_CHANNELS,
    RecordedVariant,
    compared_variants,
    legend_titles,
    variants_by_chain,
)
from warpchain.view.rerun.chart import BACKGROUND_COLOR, WIDE_CHART, Chart
from warpchain.view.rerun.drive_scene import (
    COMMON_NAMES,
    log_chain_outline,
    log_common_names,
    log_drive,
    sprockets_about_one_center,
    thinned_trajectory,
)
from warpchain.view.rerun.ensemble_scatters import log_ensemble
from warpchain.view.rerun.signal_charts import (
    CURVE_GROUPS,
    SpectrumLine,
    curve_axis_range,
    log_curves,
    log_measured_signals,
    log_spectrum_charts,
    log_tension_image,
    spectrum_lines,
)
from warpchain.view.rerun.streams import TIMELINE, entity_path, stream_to_file

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

    from warpchain.results.measured import SignalComparison

TURN_SECONDS = 2.0
"""Time that playback takes for a driver's revolution [s]."""
LEAST_SECONDS, MOST_SECONDS = 5.0, 30.0
FRAME_BUDGET = 1000
"""Most frames of a recording in playback by default."""


def playback_blueprint(
    shown: Sequence[RecordedVariant],
    images: Sequence[Chart],
    spectra: Sequence[Chart],
    ensemble: tuple[Sequence[Chart], int],
    top: float,
    tab: str | None = None,
) -> rrb.Blueprint:
    """Rerun's layout of a playback, in tabs.

    Args:
        images: each variant's tension along the chain.
        ensemble: scatters row by row, and the number of columns.
        top: tension at which the color scale ends [N].
        tab: the tab open at first, by how its name begins; raises SimulationError for another.
    """
    import rerun.blueprint as rrb

    roots = [one.label for one in shown]

    def curve_views(*groups: str) -> list[rrb.TimeSeriesView]:
        """Rerun's time series views of groups of curves in a playback."""
        return [
            rrb.TimeSeriesView(
                name=CURVE_GROUPS[group],
                origin="/",
                contents=[f"+ {entity_path(root, 'curves', group)}/**" for root in roots],
                axis_y=_curve_axis(shown, group),
            )
            for group in groups
        ]

    beside = rrb.Vertical(*curve_views("tension", "contact", "displacement"))
    tabs = _drive_tabs(shown, beside, top)
    along = [
        f"{title}: tension along the chain" if title else "tension along the chain" for title in legend_titles(shown)
    ]
    pictures = [chart.chart_view(name) for chart, name in zip(images, along, strict=True)]
    tabs.append(rrb.Vertical(*pictures, *curve_views("strand tension"), name="tension along the chain"))
    rubs = ("friction",) if any(one.trajectory.joint_friction_power is not None for one in shown) else ()
    tabs.append(rrb.Vertical(*curve_views("contact", "moment", *rubs), name="contact forces"))
    tabs.append(rrb.Vertical(*curve_views("ratio", "error", "speed"), name="speed ratio and transmission error"))
    if any(one.trajectory.arm_angle is not None or one.trajectory.tensioner_force is not None for one in shown):
        there = {signal[3] for one in shown for signal in part_signals(one.trajectory.parts)}
        groups = [group for group in ("arm", "push", "extension", "pressure") if group in there]
        tabs.append(rrb.Vertical(*curve_views(*groups), name="arms and tensioners"))
    if any(one.trajectory.coupling_torque is not None for one in shown):
        tabs.append(rrb.Vertical(*curve_views("coupling", "twist"), name="couplings"))
    if any(one.trajectory.valve_torque is not None for one in shown):
        tabs.append(rrb.Vertical(*curve_views("valves"), name="valves"))
    if spectra:
        views = [chart.chart_view(f"spectrum of {chart.path[-1]}") for chart in spectra]
        tabs.append(rrb.Vertical(*views, name="spectrum"))
    charts, columns = ensemble
    if charts:
        views = [chart.chart_view(chart.path[-1]) for chart in charts]
        tabs.append(rrb.Grid(*views, grid_columns=columns, name="ensemble"))
    names = [str(part.name) for part in tabs]
    opened = next((k for k, name in enumerate(names) if name.startswith(tab or "")), None)
    if opened is None:
        raise SimulationError(f"tab {tab!r}: allowed are {', '.join(names)}")
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=opened),
        time_panel([one.trajectory for one in shown]),
        auto_views=False,
        collapse_panels=True,
    )


def _drive_tabs(shown: Sequence[RecordedVariant], beside: rrb.Vertical, top: float) -> list[rrb.Container | rrb.View]:
    """Rerun's tabs of the drive in motion, curves `beside` it, colors up to `top` [N]."""
    import rerun.blueprint as rrb

    roots = [one.label for one in shown]
    scale = f"from blue (0 N) to red ({top:,.0f} N)".replace(",", " ")
    look: dict[str, Any] = {"visual_bounds": _drive_bounds(shown), "background": BACKGROUND_COLOR}
    titles = {
        root: f"{title}: link tension {scale}" if title else f"link tension {scale}"
        for root, title in zip(roots, legend_titles(shown), strict=True)
    }
    drives = [rrb.Spatial2DView(origin=entity_path(root, "drive"), name=titles[root], **look) for root in roots]
    tabs: list[rrb.Container | rrb.View] = []
    if len(roots) == 1:
        tabs.append(rrb.Horizontal(drives[0], beside, column_shares=[2, 3], name="drive"))
    else:
        chains = chains_of_first(shown)
        of_first, names = [one.label for one in chains], _common_name_contents(chains)
        if len(of_first) > 1:  # chains of one drive
            whole = [*(f"+ {entity_path(root, 'drive')}/**" for root in of_first), *names]
            name = f"all chains: link tension {scale}"
            picture = rrb.Spatial2DView(origin="/", contents=whole, name=name, **look)
            tabs.append(rrb.Horizontal(picture, beside, column_shares=[2, 3], name="drive"))
        tabs.append(rrb.Horizontal(*drives, name="side by side"))
        overlay = rrb.Spatial2DView(
            origin="/",
            contents=[
                "+ /overlaid/**",
                *(f"+ {entity_path(root, 'drive', 'sprockets')}/**" for root in of_first),
                *names,
            ],
            name="chains overlaid (zoom in to tell them apart)",
            visual_bounds=look["visual_bounds"],
        )
        tabs.append(rrb.Horizontal(overlay, beside, column_shares=[2, 3], name="overlaid"))
    return tabs


def _common_name_contents(chains: Sequence[RecordedVariant]) -> list[str]:
    """Contents of a Rerun view that name sprockets about one center once."""
    found = [f"+ /{COMMON_NAMES}/**"]
    for members in sprockets_about_one_center([one.trajectory for one in chains]):
        for c, s in members:
            name = chains[c].trajectory.model.sprockets[s].name
            found.append(f"- {entity_path(chains[c].label, 'drive', 'sprockets', name, 'name')}")
    return found


def chains_of_first(shown: Sequence[RecordedVariant]) -> list[RecordedVariant]:
    """Chains of the first variant of a playback."""
    return [one for one in shown if one.index == shown[0].index and one.run is shown[0].run]


def playback_seconds(trajectory: Trajectory) -> float:
    """Time [s] that a recording's playback takes."""
    turns = 0.0
    if trajectory.sprocket_angle is not None:
        angle = forward_values(trajectory.parts, trajectory.sprocket_angle, trajectory.parts.driver)
        turns = float(np.abs(np.diff(angle)).sum()) / (2.0 * np.pi)
    return float(np.clip(TURN_SECONDS * turns, LEAST_SECONDS, MOST_SECONDS)) if np.isfinite(turns) else LEAST_SECONDS


def time_panel(shown: Sequence[Trajectory]) -> rrb.TimePanel:
    """Rerun's time panel, which loops the longest recording."""
    import rerun.blueprint as rrb

    longest = max(shown, key=lambda trajectory: float(trajectory.time[-1]))
    speed = float(f"{float(longest.time[-1]) / playback_seconds(longest):.2g}")
    return rrb.TimePanel(
        state="collapsed", timeline=TIMELINE, playback_speed=speed, loop_mode="all", play_state="playing"
    )


def _curve_axis(shown: Sequence[RecordedVariant], group: str) -> rrb.ScalarAxis | None:
    """Rerun's vertical axis of a group of curves, or None."""
    import rerun.blueprint as rrb

    ends = curve_axis_range([one.trajectory for one in shown], group)
    return None if ends is None else rrb.ScalarAxis(range=ends)


def _drive_bounds(shown: Sequence[RecordedVariant]) -> rrb.VisualBounds2D:
    """Rerun's bounds of a view around all variants' drives."""
    import rerun.blueprint as rrb

    corners = []
    for one in shown:
        model, position = one.trajectory.model, one.trajectory.position
        assert position is not None
        corners += [position[:: max(len(position) // 100, 1)].reshape(-1, 2)]
        corners += [
            np.add(s.center, model.tip_radius(k) * np.array([[-1], [1]])) for k, s in enumerate(model.sprockets)
        ]
    points = np.concatenate(corners)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max())
    return rrb.VisualBounds2D(
        x_range=[low[0] - margin, high[0] + margin], y_range=[-high[1] - margin, -low[1] + margin]
    )


def view(
    source: Run | str | Path,
    variant: int | None = None,
    save: str | Path | None = None,
    compare: Sequence[str | int | Run | Path] = (),
    frames: int = FRAME_BUDGET,
    web: bool = False,
    bind: str = "127.0.0.1",
    tab: str | None = None,
    scale: ScaleTop = None,
    measured: Sequence[SignalComparison] = (),
) -> None:
    """Shows recorded variants in Rerun: in its viewer, in a browser, or saved as a Rerun recording.

    Args:
        source: a run, or an archive's path.
        variant: None is the first recorded.
        save: file (.rrd) to write instead of opening a viewer.
        compare: further variants to lay over it: numbers in `source`, other runs or archives, or "ARCHIVE:NUMBER".
        frames: most frames to draw; longer recordings are thinned without losing peaks (docs/playback.md).
        web: serve the web viewer until interrupted, instead of the native one.
        bind: address that the viewer listens at.
        tab: the tab open at first, by how its name begins.
        scale: link tension at the red end of the color scale [N], or "breaking", the chain's breaking load; None takes
            99.9 % of the tensions in the latter half of the recording.
        measured: signals from a rig (`warpchain.results.measured`) to draw over the first variant's curves.

    Raises:
        ArchiveError: an archive that cannot be read, or a recording that cannot be written.
        SimulationError: a variant or channel not recorded, a budget below 2, an unknown tab or scale, no viewer.
    """
    if frames < 2:
        raise SimulationError(f"frames = {frames}: allowed is a whole number of at least 2")
    shown = compared_variants(source, variant, compare, (*DRIVE_CHANNELS, "sprocket_speed"))
    if save is not None:
        stream = _new_stream()
        with stream_to_file(stream, Path(save), ArchiveError):
            stream.send_blueprint(log_recording(stream, shown, frames, tab, scale, measured))
    else:
        from warpchain.view.rerun.viewer import Viewer

        with Viewer(bind, "web" if web else "native") as viewer:
            stream = _new_stream()
            with viewer.connection(stream):
                stream.send_blueprint(log_recording(stream, shown, frames, tab, scale, measured))


def log_recording(
    stream: rr.RecordingStream,
    shown: Sequence[RecordedVariant],
    frames: int = FRAME_BUDGET,
    tab: str | None = None,
    scale: ScaleTop = None,
    measured: Sequence[SignalComparison] = (),
) -> rrb.Blueprint:
    """Logs variants, comparison and ensemble to Rerun; returns the layout."""
    shown = [chain for one in shown for chain in variants_by_chain(one)]
    top = tension_scale_top([one.trajectory for one in shown], scale)
    images, lines = [], dict[str, list[SpectrumLine]]()
    width = WIDE_CHART * 0.5 * (len(shown) + 1)  # as many views below each other, and one of curves, fill their tab
    for k, (one, title) in enumerate(zip(shown, legend_titles(shown), strict=True)):
        color = CURVE_PALETTE[k % len(CURVE_PALETTE)] if len(shown) > 1 else None
        images.append(log_variant(stream, one, frames, top, color, title, width))
        colors = curve_colors(one.trajectory.parts, color)
        for spectrum, found in spectrum_lines(one.trajectory, colors).items():
            named = [line._replace(name=f"{title}: {line.name}") if title else line for line in found]
            lines.setdefault(spectrum, []).extend(named)
        if color is not None:
            outline = thinned_trajectory(one.trajectory, frames)
            log_chain_outline(stream, entity_path("overlaid", one.label), outline, color)
    log_common_names(stream, [thinned_trajectory(one.trajectory, frames) for one in chains_of_first(shown)])
    for line in log_measured_signals(stream, shown[0].label, measured, frames):
        lines.setdefault(STRAND_TENSION_TITLE, []).append(line)
    teeth = [one.trajectory.parts.sprockets[one.trajectory.parts.driver].teeth for one in shown]
    run = shown[0].run
    scatters = log_ensemble(stream, run, [one.index for one in shown if one.run is run])
    return playback_blueprint(shown, images, log_spectrum_charts(stream, lines, teeth), scatters, top, tab)


def log_variant(
    stream: rr.RecordingStream,
    one: RecordedVariant,
    frames: int,
    top: float,
    color: Color | None = None,
    title: str = "",
    width: float = WIDE_CHART,
) -> Chart:
    """Logs a variant's drive, curves and tension image to Rerun; returns the image's chart.

    Args:
        title: before the names of its curves; "" where there is nothing beside it.
        width: of the image over its height.
    """
    drawn = thinned_trajectory(one.trajectory, frames)
    colors = curve_colors(one.trajectory.parts, color)
    log_drive(stream, one.label, drawn, top, colors)
    log_curves(stream, one.label, one.trajectory, frames, colors, title)
    return log_tension_image(stream, one.label, one.trajectory, drawn, frames, top, width)


def _new_stream() -> rr.RecordingStream:
    """Recording stream of Rerun for a playback."""
    import rerun as rr

    return rr.RecordingStream("warpchain", recording_id=None)
