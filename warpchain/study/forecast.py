"""Forecast of a study before it runs: runs, share of infeasible rows, cost, expected precision."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive
from warpchain.engine.simulation import MEMORY, available_cores
from warpchain.errors import StudyError, WarpchainError
from warpchain.progress import duration_text
from warpchain.results.statuses import common_reasons, reason_of_count
from warpchain.study.analysis.pure_error import PureError, pure_error, pure_errors, student_quantile
from warpchain.study.results import Results, read_results
from warpchain.study.run.prepare import gpu_count, overhead_seconds, preferred_shard_size, read_study, stored_step_rate
from warpchain.study.run.row_drives import Variant, build_and_check_drives
from warpchain.study.spec import Study

MOST_BUILT_ROWS = 200
PROBES_PER_CORE = 4
PROBE_SECONDS = 0.7
MOST_REASONS = 3


@dataclass(frozen=True)
class RunCost:
    """Forecast cost of a study's runs."""

    work: float  # roller-steps of all runs
    rate: float
    each: float  # overhead of a run [s], for packing and settling
    seconds: float
    measured: bool  # whether the rate was measured here


@dataclass(frozen=True)
class Forecast:
    """Forecast of a study: rows, cost, precision."""

    rows: int
    copies: int
    ruled_out: int  # rows without a value or against constraints
    built: int  # other rows that were built
    refused: int  # built rows that cannot be assembled or stepped
    reasons: tuple[tuple[str, int], ...]  # the most frequent, with numbers
    cost: RunCost
    shards: int
    recorded: int  # rows that are recorded, without the worst
    precision: tuple[PureError, ...] = ()  # scatter of metrics in an earlier study, the noisiest first
    window: float | None = None  # of that study [s]

    @property
    def run_count(self) -> int:
        """Number of runs forecast, infeasible ones too."""
        return self.rows * self.copies

    @property
    def infeasible_share(self) -> float:
        """Expected share of infeasible rows."""
        part = self.refused / self.built if self.built else 0.0
        return (self.ruled_out + part * (self.rows - self.ruled_out)) / max(self.rows, 1)

    @property
    def infeasible_interval(self) -> tuple[float, float]:
        """95 % interval of the share of infeasible rows."""
        from scipy.special import betaincinv

        others, n, k = self.rows - self.ruled_out, self.built, self.refused
        if n >= others:
            return self.infeasible_share, self.infeasible_share
        low = betaincinv(k, n - k + 1, 0.025) if k else 0.0
        high = betaincinv(k + 1, n - k, 0.975) if k < n else 1.0
        return tuple((self.ruled_out + part * others) / self.rows for part in (low, high))  # type: ignore[return-value]

    @property
    def relative_precision(self) -> float | None:
        """Half width of a row's interval, in deviations."""
        if self.copies < 2:
            return None
        rows = max(1.0, (1.0 - self.infeasible_share) * self.rows)
        return student_quantile(rows * (self.copies - 1)) / math.sqrt(self.copies)


def forecast_study(
    source: str | os.PathLike[str],
    *,
    like: str | os.PathLike[str] | None = None,
    metrics: Sequence[str] = (),
    calibrate: bool = True,
    workers: int | None = None,
    memory: int = MEMORY,
) -> Forecast:
    """Forecast of a study: rows, runs, cost, precision.

    Args:
        like: table of an earlier study with replicates.
        metrics: whose precision is wanted; none takes all.
        calibrate: measure the rate by short runs; else take stored rates.
    """
    study, drive, design = read_study(source)
    cores = workers or available_cores()
    rows = design.to_pylist()
    open_rows = [row for row in rows if row["reason"] is None]
    drives, reasons = _built_drives(study, drive, open_rows)
    built = len(drives) + len(reasons)
    excluded = [("infeasible", row["reason"]) for row in rows if row["reason"] is not None]
    often = common_reasons([*excluded, *(("infeasible", reason) for reason in reasons)])[:MOST_REASONS]
    share = len(drives) / built if built else 0.0
    count = share * len(open_rows) * study.design.copies
    record = study.record
    every = set(range(0, len(rows), record.every)) if record.every else set()
    size = study.run.shard or preferred_shard_size(study, drive, len(rows) * study.design.copies, 1, cores, memory)
    earlier, window = _earlier_scatter(like, metrics)
    return Forecast(
        rows=len(rows),
        copies=study.design.copies,
        ruled_out=len(rows) - len(open_rows),
        built=built,
        refused=len(reasons),
        reasons=tuple((reason, number) for _, reason, number in often),
        cost=_run_cost(study, drives, count, cores, calibrate),
        shards=-(-len(rows) * study.design.copies // size),
        recorded=len(every | set(record.variants)),
        precision=earlier,
        window=window,
    )


def _built_drives(study: Study, base: Drive, rows: Sequence[dict[str, Any]]) -> tuple[list[Drive], list[str]]:
    """Drives of evenly spread rows, and reasons of failures."""
    chosen = sorted({round(place) for place in np.linspace(0, len(rows) - 1, min(len(rows), MOST_BUILT_ROWS)).tolist()})
    variants = [Variant(rows[i]) for i in chosen]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        build_and_check_drives(study, base, variants)
    drives = [variant.drive for variant in variants if variant.drive is not None]
    return drives, [variant.reason or "no reason given" for variant in variants if variant.drive is None]


def _run_cost(study: Study, drives: Sequence[Drive], count: float, cores: int, calibrate: bool) -> RunCost:
    """Forecast cost of `count` runs by a step rate."""
    gpus = gpu_count(study.run.device)
    if not drives:
        return RunCost(0.0, 0.0, 0.0, 0.0, False)
    steps = [(study.run.duration or drive.run.duration) / resolve_step(drive, study.run.step) for drive in drives]
    work = count * float(np.mean([n * drive.links for n, drive in zip(steps, drives, strict=True)]))
    rate = stored_step_rate(gpus, cores)
    each = float(np.mean([overhead_seconds(study, drive, gpus, cores) for drive in drives]))
    if calibrate:
        rate, each = _measured_rate(
            study, drives, 1000 * PROBES_PER_CORE * gpus if gpus else PROBES_PER_CORE * cores, min(steps), cores
        )
    return RunCost(work, rate, each, count * each + work / rate, calibrate)


def _measured_rate(study: Study, drives: Sequence[Drive], count: int, most: float, cores: int) -> tuple[float, float]:
    """Measured roller-steps a second, and a variant's overhead [s]."""
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record

    chosen = [drives[k * len(drives) // count % len(drives)] for k in range(count)]
    finest = min(resolve_step(drive, study.run.step) for drive in chosen)
    rollers = sum(drive.links * finest / resolve_step(drive, study.run.step) for drive in chosen)

    def run_seconds(steps: int) -> float:
        """Wall time [s] of the measured variants for `steps`."""
        begin = time.perf_counter()
        simulate(
            chosen,
            device=study.run.device,
            precision=study.run.precision,
            duration=steps * finest,
            step=study.run.step,
            record=Record("none"),
            limits=study.limits,
            workers=cores,
        )
        return time.perf_counter() - begin

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        short = max(2, min(200, int(most) // 4))
        run_seconds(short)  # loads the kernels
        first = run_seconds(short)
        long = min(max(1000, 4 * short), max(int(most), 2 * short))
        second = run_seconds(long)
        if 4 * long <= most and second < 0.5 * PROBE_SECONDS:
            long = int(min(most, long * PROBE_SECONDS / max(second - first, 1e-3)))
            second = run_seconds(long)
    rate = rollers * (long - short) / max(second - first, 1e-6)
    return rate, max(0.0, first - rollers * short / rate) / count


def _earlier_scatter(
    like: str | os.PathLike[str] | None, metrics: Sequence[str]
) -> tuple[tuple[PureError, ...], float | None]:
    """Pure errors of an earlier study, and its window [s]."""
    if like is None:
        return (), None
    path = Path(like)
    results = read_results(path / "results.parquet" if path.is_dir() else path)
    chosen = tuple(pure_error(results, metric) for metric in metrics) or tuple(pure_errors(results))
    if not chosen:
        raise StudyError(f"{like}: no row was run several times; only studies with design.replicates tell the scatter")
    return chosen, _window_length(results)


def _window_length(results: Results) -> float | None:
    """Median length [s] of metrics' windows, or None."""
    try:
        lengths = results.values("window_end") - results.values("window_start")
    except WarpchainError:
        return None
    return float(np.nanmedian(lengths)) if np.isfinite(lengths).any() else None


def forecast_lines(forecast: Forecast, wanted: Mapping[str, float] | None = None) -> list[str]:
    """Lines on a study's forecast.

    Args:
        wanted: half width of the 95 % interval by metric.
    """
    lines = [f"rows: {forecast.rows}, each run {forecast.copies} times: {forecast.run_count} runs in "
             f"{forecast.shards} shards"
             if forecast.copies > 1 else f"rows: {forecast.rows} in {forecast.shards} shards"]  # fmt: skip
    low, high = (f"{100.0 * part:.3g}" for part in forecast.infeasible_interval)
    sure = "" if low == high else f" ({low} to {high} %)"
    lines.append(
        f"infeasible: {100.0 * forecast.infeasible_share:.3g} %{sure}: {forecast.ruled_out} rows by constraints, and "
        f"{forecast.refused} "
        f"of {forecast.built} rows that were built"
    )
    lines += [f"  {reason_of_count(number, reason)}" for reason, number in forecast.reasons]
    cost = forecast.cost
    how = "measured here" if cost.measured else "assumed"
    besides = f", and {1e3 * cost.each:.2g} ms a run besides" if cost.each > 0.0 else ""
    length = f"{cost.seconds:.2g} s" if cost.seconds < 10.0 else duration_text(cost.seconds)
    lines.append(f"cost: {cost.work:.3g} roller-steps at {cost.rate:.3g} a second ({how}){besides}: {length}")
    if forecast.recorded:
        lines.append(f"recorded: {forecast.recorded} rows")
    if forecast.relative_precision is None:
        lines.append("precision: one run a row does not tell it; give design.replicates")
    else:
        lines.append(f"precision: means of {forecast.copies} runs are known to "
                     f"+-{forecast.relative_precision:.2g} of the "
                     "standard deviation of one run (95 %)")  # fmt: skip
    lines += [_scatter_line(forecast, error) for error in forecast.precision[:12]]
    return lines + [_replicates_line(forecast, metric, half) for metric, half in (wanted or {}).items()]


def _scatter_line(forecast: Forecast, error: PureError) -> str:
    """Line of a forecast on a metric's scatter."""
    return (
        f"  {error.metric}: one run scatters by {error.deviation:.3g} ({error.low:.3g} to {error.high:.3g}); "
        f"+-{error.interval(forecast.copies):.3g} with {forecast.copies}"
    )


def _replicates_line(forecast: Forecast, metric: str, half: float) -> str:
    """Line of a forecast on replicates for a precision."""
    found = next((error for error in forecast.precision if error.metric == metric), None)
    if found is None:
        raise StudyError(f"--precision {metric}: the earlier study (--like) tells no scatter of it")
    line = f"  {metric} to +-{half:g}: {found.replicates_for(half)} replicates"
    if forecast.window is None or not metric.rpartition(".")[2].endswith("_mean"):
        return line
    length = found.window_for(half, forecast.window, forecast.copies)
    return f"{line}, or {forecast.copies} and a window of {length:.3g} s (the earlier one had {forecast.window:.3g} s)"
