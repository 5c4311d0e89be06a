"""Metrics of plug-ins: functions of a variant's drive, metrics and recorded frames (docs/plugins.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from warpchain.argument_checks import check_arguments
from warpchain.drive.plugins import (
    add_to_registry,
    checked_number,
    digest_of_file,
    function_code,
    load_installed_plugins,
    plugin_words,
)
from warpchain.errors import PluginError
from warpchain.results.channels import CHANNEL_BY_NAME
from warpchain.results.metric_columns import COLUMN_BY_NAME, OWN_COLUMNS, Column
from warpchain.results.own_channels import OWN_CHANNELS, recorded_names
from warpchain.results.run import Trajectory

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.drive import Drive

MetricFunction = Callable[["MeasuredVariant"], float | None]
PLUGIN_KEY, PLUGINS_KEY = "plugin", "plugins"
"""Metadata keys of a column's plug-in, and of a table's."""


@dataclass(frozen=True)
class MeasuredVariant:
    """Variant of a run, for a plug-in's metric.

    Attributes:
        drive: the variant's.
        metrics: its metrics by name, in SI units.
        window: (start, end) of the metrics [s].
        trajectory: its frames in the window, with the channels that the metric asks for; None for none.
    """

    drive: Drive
    metrics: Mapping[str, Any]
    window: tuple[float, float]
    trajectory: Trajectory | None = field(default=None, repr=False)

    def __getitem__(self, name: str) -> Any:
        """Metric of the variant, or channel asked for."""
        if name in self.metrics:
            return self.metrics[name]
        values = None
        if self.trajectory is not None and name in OWN_CHANNELS:
            values = OWN_CHANNELS[name].values(self.trajectory)
        elif name in CHANNEL_BY_NAME:
            values = getattr(self.trajectory, name, None)
        if values is None:
            raise PluginError(f"{name!r} is no metric of this drive, and no channel that the own metric asks for")
        return values


@dataclass(frozen=True)
class OwnMetric:
    """Metric of a plug-in: its function, and channels needed."""

    function: MetricFunction
    channels: tuple[str, ...]

    def value(self, name: str, of: MeasuredVariant, variant: int) -> float | None:
        """Value of the plug-in's metric for a variant, or None.

        Raises:
            PluginError: what the function raises, or a value that is no finite number.
        """
        with function_code(self.function, f"metric {name!r} of variant {variant}"):
            if of.trajectory is not None and not len(of.trajectory.time):
                raise PluginError("no frame lies in the window; raise run.sample_rate")
            return checked_number(self.function(of))


OWN_METRICS: dict[str, OwnMetric] = {}


@check_arguments(PluginError)
def metric(
    name: str, *, unit: str = "1", title: str, channels: Sequence[str] = ()
) -> Callable[[MetricFunction], MetricFunction]:
    """Decorator that makes a plug-in's function the metric `name` of variants that have run their window.

    The function takes a `MeasuredVariant`, of which `run["tension_max"]` is a metric; it returns a finite number, or
    None where the variant has no such value.

    Args:
        unit: SI unit, "1" for a ratio or count.
        title: what the metric is, in words.
        channels: of `Trajectory`, such as "tension", whose frames in the window the function reads; they are recorded
            for it, at each drive's `run.sample_rate` or that of the run's `Record`.

    Raises:
        PluginError: a name that is taken or not allowed, an unknown channel, or no function.
    """

    def add_metric(function: MetricFunction) -> MetricFunction:
        """Registers the plug-in's metric; returns its function."""
        if not hasattr(function, "__code__"):
            raise PluginError(f"metric {name!r}: must be a function")
        for channel in (channels,) if isinstance(channels, str) else channels:
            if channel not in CHANNEL_BY_NAME:
                raise PluginError(f"metric {name!r}: no channel {channel!r}; allowed are {', '.join(CHANNEL_BY_NAME)}")
        asked = (channels,) if isinstance(channels, str) else tuple(channels)
        column, file = Column(name, unit, title), function.__code__.co_filename
        add_to_registry(COLUMN_BY_NAME, "metric", name, column, file)
        add_to_registry(OWN_COLUMNS, "metric", name, column, file)
        add_to_registry(OWN_METRICS, "metric", name, OwnMetric(function, asked), file)
        return function

    return add_metric


def metric_channels() -> tuple[str, ...]:
    """Names of channels that plug-ins' metrics need, in order."""
    load_installed_plugins()
    return recorded_names(channel for own in OWN_METRICS.values() for channel in own.channels)


def table_with_own_metrics(
    table: pa.Table, drives: Sequence[Drive], frames: Mapping[int, Trajectory] | None = None
) -> pa.Table:
    """Metrics table with plug-ins' columns, names and digests.

    Args:
        table: a row a variant, with `diverged` and `window_start`.
        frames: trajectories of variants within their windows, with `metric_channels`.

    Raises:
        PluginError: a metric that fails.
    """
    words = plugin_words()
    if words is not None:
        table = table.replace_schema_metadata({PLUGINS_KEY: words})
    if not OWN_METRICS:
        return table
    rows, frames = table.to_pylist(), frames or {}
    for name, own in OWN_METRICS.items():
        values = [
            own.value(name, _measured_variant(own, drives[v], row, frames.get(v)), v)
            if _is_measured(row) and (v in frames or not own.channels)
            else None
            for v, row in enumerate(rows)
        ]
        table = _table_with_own_metric(table, name, values, digest_of_file(own.function.__code__.co_filename))
    return table


def _table_with_own_metric(table: pa.Table, name: str, values: Sequence[float | None], digest: str) -> pa.Table:
    """Metrics table with the column of a plug-in's metric."""
    import pyarrow as pa

    if all(value is None for value in values):
        return table
    facts = {"unit": OWN_COLUMNS[name].unit, **({PLUGIN_KEY: digest} if digest else {})}
    return table.append_column(pa.field(name, pa.float64(), metadata=facts), pa.array(values, pa.float64()))


def _is_measured(row: Mapping[str, Any]) -> bool:
    """Whether a variant has run its window."""
    return not row["diverged"] and row.get("energy_residual") is not None


def _measured_variant(
    own: OwnMetric, drive: Drive, row: Mapping[str, Any], frames: Trajectory | None
) -> MeasuredVariant:
    """Variant with what a plug-in's metric may read."""
    known = {name: value for name, value in row.items() if value is not None}
    return MeasuredVariant(drive, known, (row["window_start"], row["window_end"]), frames if own.channels else None)
