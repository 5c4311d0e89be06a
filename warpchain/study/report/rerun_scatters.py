"""Scene of a study in Rerun: scatters of factors against metrics, beside the recorded variants."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpchain.errors import StudyError
from warpchain.results.chains import chain_trajectories
from warpchain.results.run import Trajectory
from warpchain.study.analysis.pareto import pareto_front
from warpchain.study.report.study_page import telling_metrics
from warpchain.study.results import Results
from warpchain.view.palette import BEST_DOT, OTHER_DOT, SHOWN_DOT, curve_colors, tension_scale_top
from warpchain.view.recorded_variants import DRIVE_CHANNELS
from warpchain.view.rerun.chart import (
    BACKGROUND_COLOR,
    MOST_INPUTS,
    MOST_METRICS,
    AxisQuantity,
    Chart,
    DotGroup,
    log_scatter,
)
from warpchain.view.rerun.drive_scene import log_drive, thinned_trajectory
from warpchain.view.rerun.run_playback import time_panel
from warpchain.view.rerun.signal_charts import CURVE_GROUPS, log_curves
from warpchain.view.rerun.streams import entity_path, stream_to_file

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

PLAYBACK_FRAMES = 400


def view_study(
    results: Results,
    recorded: Mapping[int, Trajectory] | None = None,
    factors: Sequence[str] = (),
    metrics: Sequence[str] = (),
    objectives: Mapping[str, str] | None = None,
    save: str | Path | None = None,
) -> None:
    """Shows a study in the Rerun viewer, or saves it.

    Args:
        recorded: trajectories to play, by variant.
        factors, metrics: across and up the scatters; none takes the telling ones.
        objectives: "min" or "max" by metric; the best or the Pareto front is marked.
        save: file (.rrd) to write instead.

    Raises:
        StudyError: an unknown column, nothing to draw, a file that cannot be written.
        SimulationError: no viewer to open.
    """
    import rerun as rr

    stream = rr.RecordingStream("warpchain-study", recording_id=None)
    if save is None:
        from warpchain.view.rerun.viewer import Viewer

        with Viewer() as viewer, viewer.connection(stream):
            stream.send_blueprint(log_study(stream, results, recorded or {}, factors, metrics, objectives))
        return
    target = Path(save)
    with stream_to_file(stream, target, StudyError):
        stream.send_blueprint(log_study(stream, results, recorded or {}, factors, metrics, objectives))


def log_study(
    stream: rr.RecordingStream,
    results: Results,
    recorded: Mapping[int, Trajectory],
    factors: Sequence[str] = (),
    metrics: Sequence[str] = (),
    objectives: Mapping[str, str] | None = None,
) -> rrb.Blueprint:
    """Logs a study to Rerun; returns the viewer's layout."""
    import rerun.blueprint as rrb

    charts, columns = log_study_scatters(stream, results, list(recorded), factors, metrics, objectives)
    scatters = rrb.Grid(*(chart.chart_view(chart.path[-1]) for chart in charts), grid_columns=columns, name="study")
    played = [_log_recorded_variant(stream, f"variant {variant}", one) for variant, one in recorded.items()]
    both = rrb.Horizontal(scatters, rrb.Tabs(*played), column_shares=[3, 2]) if played else scatters
    panel = time_panel(list(recorded.values())) if recorded else rrb.TimePanel(state="collapsed")
    return rrb.Blueprint(both, panel, auto_views=False, collapse_panels=True)


def _log_recorded_variant(stream: rr.RecordingStream, name: str, trajectory: Trajectory) -> rrb.Container:
    """Logs a recorded variant to Rerun; returns its tab."""
    import rerun.blueprint as rrb

    missing = [channel for channel in DRIVE_CHANNELS if getattr(trajectory, channel) is None]
    if missing:
        raise StudyError(f"{name} was recorded without {', '.join(missing)}, which this needs")
    chains = {f"{name} {chain}".rstrip(): own for chain, own in chain_trajectories(trajectory).items()}
    top = tension_scale_top(chains.values())
    for root, own in chains.items():
        log_drive(stream, root, thinned_trajectory(own, PLAYBACK_FRAMES), top)
        log_curves(stream, root, own, PLAYBACK_FRAMES, curve_colors(own.drive))
    title = f"{name}: link tension from blue (0 N) to red ({top:.4g} N)"
    drawn, curves = (
        [f"+ {entity_path(root, *part)}/**" for root in chains] for part in (["drive"], ["curves", "tension"])
    )
    moving = rrb.Spatial2DView(origin="/", contents=drawn, name=title, background=BACKGROUND_COLOR)
    over_time = rrb.TimeSeriesView(origin="/", contents=curves, name=CURVE_GROUPS["tension"])
    return rrb.Vertical(moving, over_time, row_shares=[3, 1], name=name)


def log_study_scatters(
    stream: rr.RecordingStream,
    results: Results,
    recorded: Sequence[int],
    factors: Sequence[str] = (),
    metrics: Sequence[str] = (),
    objectives: Mapping[str, str] | None = None,
) -> tuple[list[Chart], int]:
    """Logs scatters of a study to Rerun; returns charts and number of columns."""
    wanted = tuple(objectives or ())
    set_ones = [name for name in wanted if name in results.factors]
    across = tuple(dict.fromkeys((*set_ones, *(tuple(factors) or _telling_inputs(results)))))
    measured = [name for name in wanted if name not in results.factors]
    up = tuple(dict.fromkeys((*measured, *(tuple(metrics) or telling_metrics(results)[:MOST_METRICS]))))
    if not across or not up:
        raise StudyError("nothing to draw: needs a factor and a metric that hold numbers and vary")
    front = np.zeros(0, dtype=np.intp)
    if objectives and not results.noise_factors:
        front = pareto_front(results, objectives)
    played = np.flatnonzero(results.ok & np.isin(results.variants, list(recorded)))
    groups = [  # each variant once, so that dots do not cover each other
        DotGroup("variants", OTHER_DOT, 2.5, np.setdiff1d(np.flatnonzero(results.ok), np.union1d(front, played))),
        DotGroup("Pareto front" if len(wanted) > 1 else "best", BEST_DOT, 4.0, np.setdiff1d(front, played)),
        DotGroup("recorded variants", SHOWN_DOT, 5.0, played),
    ]
    charts = [
        log_scatter(
            stream,
            "study",
            AxisQuantity(factor, results.values(factor)),
            AxisQuantity(metric, results.values(metric), results.column_unit(metric)),
            groups,
            results.variants,
            results.ok,
        )
        for factor in across
        for metric in up
    ]
    return charts, len(up) if len(across) > 1 else math.ceil(math.sqrt(len(up)))


def _telling_inputs(results: Results) -> tuple[str, ...]:
    """Names of numeric factors that explain most, for scatters."""
    from warpchain.study.analysis import main_effects
    from warpchain.study.analysis.left_out import LeftOut

    numeric = results.independent_factors()
    if results.search_target:
        return numeric[:MOST_INPUTS]
    left_out = LeftOut(results)
    weights = dict.fromkeys(numeric, 0.0)
    for metric in (name for name in telling_metrics(results)[:MOST_METRICS] if not left_out.is_unranked(name)):
        for effect in main_effects(results, metric, numeric):
            weights[effect.factor] = max(weights[effect.factor], effect.explained)
    best = sorted(numeric, key=lambda name: -weights[name])[:MOST_INPUTS]
    return tuple(name for name in numeric if name in best)
