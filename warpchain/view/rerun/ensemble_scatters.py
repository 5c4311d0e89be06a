"""Scatters of a run's ensemble in Rerun: varied inputs against metrics, a dot a variant."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.results.metric_columns import unit_of_metric
from warpchain.results.run import Run
from warpchain.view.palette import OTHER_DOT, RECORDED_DOT, SHOWN_DOT
from warpchain.view.recorded_variants import varied_inputs
from warpchain.view.rerun.chart import MOST_INPUTS, MOST_METRICS, AxisQuantity, Chart, DotGroup, log_scatter

if TYPE_CHECKING:
    import rerun as rr

Values = dict[str, NDArray[np.float64]]


def ensemble_metrics(drive: Drive) -> list[str]:
    """Names of metrics for an ensemble's scatters, by importance."""
    loaded = [s.name for s in drive.sprockets if s.load is not None]
    chains = drive.chain_prefixes
    return [
        *(f"{chain}tension_max" for chain in chains),
        *(f"{name}.force_max" for name in loaded[:1]),
        f"{drive.strand_names[0]}.displacement_rms",
        *(f"{name}.speed_std" for name in loaded[:1]),
        *(f"{chain}tension_mean" for chain in chains),
        *(f"{chain}tension_std" for chain in chains),
        *(f"{guide.name}.force_max" for guide in drive.guides),
    ]


def log_ensemble(stream: rr.RecordingStream, run: Run, shown: Collection[int]) -> tuple[list[Chart], int]:
    """Logs scatters of a run's ensemble to Rerun; returns charts and number of columns.

    Dots of variants in `shown` are larger.
    """
    inputs = varied_inputs(run)
    metrics = _varied_metrics(run)
    if not inputs or not metrics:
        return [], 0
    chosen = _most_correlated_inputs(inputs, metrics)
    everything = np.asarray(run.numbers)
    recorded, played = ({run.row_of(variant) for variant in variants} for variants in (run, shown))
    groups = [
        DotGroup("other variants", OTHER_DOT, 2.5, _row_indices(set(range(len(everything))) - recorded)),
        DotGroup("recorded variants", RECORDED_DOT, 3.5, _row_indices(recorded - played)),
        DotGroup("shown variants", SHOWN_DOT, 5.0, _row_indices(played)),
    ]
    charts = [
        log_scatter(
            stream,
            "ensemble",
            AxisQuantity(name, inputs[name]),
            AxisQuantity(metric, y, unit_of_metric(metric)),
            groups,
            everything,
        )
        for name in chosen
        for metric, y in metrics.items()
    ]
    return charts, len(metrics)


def _row_indices(rows: Collection[int]) -> NDArray[np.intp]:
    """Row numbers of a scatter as a sorted array."""
    return np.array(sorted(rows), dtype=np.intp)


def _varied_metrics(run: Run) -> Values:
    """Metrics (V,) that vary in an ensemble, by name."""
    found: Values = {}
    for name in ensemble_metrics(run.drives[0]):
        if name in run.metrics.column_names and len(found) < MOST_METRICS:
            values: Any = run.metrics[name].to_numpy(zero_copy_only=False)
            values = np.where(run.ok, np.asarray(values, dtype=float), np.nan)
            finite = values[np.isfinite(values)]
            if len(finite) > 1 and np.ptp(finite) > 0.0:
                found[name] = values
    return found


def _most_correlated_inputs(inputs: Values, metrics: Values) -> list[str]:
    """Names of an ensemble's varied inputs that correlate most with any metric."""

    def largest_correlation(values: NDArray[np.float64]) -> float:
        """Largest correlation of an input (V,) with any metric."""
        best = 0.0
        for other in metrics.values():
            both = np.isfinite(values) & np.isfinite(other)
            if both.sum() > 2 and np.ptp(values[both]) > 0.0 and np.ptp(other[both]) > 0.0:
                best = max(best, abs(float(np.corrcoef(values[both], other[both])[0, 1])))
        return best

    ranked = sorted(inputs, key=lambda name: -largest_correlation(inputs[name]))[:MOST_INPUTS]
    return [name for name in inputs if name in ranked]
