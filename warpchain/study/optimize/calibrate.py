"""`warpchain calibrate`: posterior of a drive's unknowns given measurements on a rig (docs/calibration.md).

study.toml  drive.toml      the study and its base drive
rounds/NNNN/                a round of runs, all recorded
rounds/NNNN/normals.parquet its rows as standard normals
results.parquet             all runs
posterior.csv               samples of the unknowns
calibrated.toml             the drive at the posterior's means
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.argument_checks import Count, Workers, check_arguments
from warpchain.drive.drive_text import drive_text
from warpchain.drive.text_table import options_as_keys
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError, WarpchainError
from warpchain.extras import require_extra
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.results.measured import signal_source, signal_units
from warpchain.results.measured_columns import MeasuredColumns
from warpchain.results.measured_file import MeasuredSignal, read_signal
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signal_features import SignalFeatures
from warpchain.results.signals import forward_values
from warpchain.study.analysis.posterior import (
    PosteriorDirection,
    posterior_directions,
    sample_posterior,
    standardized_residuals,
)
from warpchain.study.design.factor_values import values_from_probabilities
from warpchain.study.design.noise_rows import noise_dimensions, noise_mixing, noise_rows_of_normals, nominal_value
from warpchain.study.optimize.design_search import make_search_folder
from warpchain.study.optimize.study_session import StudySession, read_rounds, round_folder_name
from warpchain.study.results import NOISE, Array, Results, read_results
from warpchain.study.run.recordings import recorded_trajectories
from warpchain.study.spec import Study
from warpchain.study.spec.calibration_tables import Calibrate, Measurement
from warpchain.study.spec.study_tables import Recording
from warpchain.study.store import read_table, write_study_text, write_table
from warpchain.study.surrogate.gaussian_process import GaussianProcess, fit_gaussian_process, one_linear_algebra_thread

COORDINATE_REACH = 3.0
"""Standard normal whose coordinate is 1, its negative 0."""
MOST_CHECK_RUNS = 8
PREDICTION_DRAWS = 2000
LEAST_SPREAD = 1e-9


@dataclass(frozen=True)
class MeasuredNumber:
    """Number measured on a rig, with its standard deviation."""

    name: str  # a metric, or "SIGNAL: STATISTIC"
    unit: str
    value: float
    error: float


@dataclass(frozen=True)
class MetricPrediction:
    """Predictions (S,) of a metric before and after calibration."""

    metric: str
    before: Array
    after: Array
    q2: float


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration: posterior, runs, predictions."""

    folder: Path
    study: Study
    results: Results
    normals: Array  # (R, D) the runs as independent standard normals
    signals: dict[str, MeasuredSignal]
    numbers: tuple[MeasuredNumber, ...]
    runs: Array  # (R, J) numbers of the runs, NaN if not ok
    emulated: NumberEmulators  # Gaussian processes of the numbers, without the last round
    checks: int  # runs of the last round, the first of the calibrated drive
    rounds: tuple[tuple[Array, Array], ...]  # mean and deviation (D,) of normals after each round
    before: Array  # (S, D) samples of normals a priori
    after: Array  # (S, D) samples of normals of the posterior
    values_before: dict[str, Array]  # (S,) of each unknown
    values: dict[str, Array]  # (S,) of each unknown
    independent: float
    directions: tuple[PosteriorDirection, ...]  # of normals, the least identified first
    residuals: Array  # (J,) measured less expected, in standard deviations of both
    predictions: tuple[MetricPrediction, ...]
    drive: Path  # file of the drive at the posterior's means

    @cached_property
    def check_counts(self) -> tuple[int, int]:
        """Numbers within their bands in the last round, and all."""
        mean, variance = self.emulated(self.normals[-self.checks :])
        off = np.abs(self.runs[-self.checks :] - mean) / np.sqrt(variance)
        return int((off <= 1.96).sum()), int(np.isfinite(off).sum())


def check_prior_spreads(source: str | os.PathLike[str], study: Study) -> None:
    """Raises StudyError for unknowns that hardly vary a priori."""
    u = (np.arange(PREDICTION_DRAWS) + 0.5) / PREDICTION_DRAWS
    for i, factor in enumerate(study.factors):
        if factor.kind != NOISE:
            continue
        values = np.array(values_from_probabilities(factor, u), dtype=float)
        spread, least = float((values - values[0]).std()), LEAST_SPREAD * float(np.abs(values).max())
        if not spread > least:
            key = next((key for key in ("std", "sample", "range") if getattr(factor, key) is not None), "range")
            raise StudyError(
                f"{source}: factors.{i}.{key}: the standard deviation of {factor.name} is {spread:.3g}: must be above "
                f"{least:.3g}, {LEAST_SPREAD:g} of its largest value"
            )


class NumberEmulators:
    """Gaussian processes of measured numbers over standard normals.

    Args:
        normals: (R, D) of all runs.
        values: (R', J) numbers of the first R' runs, NaN for none.
    """

    def __init__(self, normals: Array, values: Array, names: Sequence[str]) -> None:
        self.processes: list[GaussianProcess] = []
        for name, column in zip(names, values.T, strict=True):
            raise_if_stopped()
            known = np.isfinite(column)
            if known.sum() < max(4, normals.shape[1] + 2):
                raise StudyError(f"{name}: {int(known.sum())} of {len(column)} runs have it; raise calibrate.count")
            self.processes.append(
                fit_gaussian_process(_process_coordinates(normals[: len(column)][known]), column[known])
            )

    def __call__(self, u: Array) -> tuple[Array, Array]:
        x = _process_coordinates(u)
        with one_linear_algebra_thread():
            found = [of.mean_and_variance(x) for of in self.processes]
        variance = [variance + of.run_variance for (_, variance), of in zip(found, self.processes, strict=True)]
        return np.stack([mean for mean, _ in found], axis=1), np.stack(variance, axis=1)

    @property
    def q2_values(self) -> list[float]:
        """Cross-validated Q2 of each measured number's process."""
        found = []
        for of in self.processes:
            observed, (predicted, _) = of.center + of.scale * of.z, of.leave_one_out()
            found.append(1.0 - float(((observed - predicted) ** 2).sum() / ((observed - observed.mean()) ** 2).sum()))
        return found


def _process_coordinates(u: Array) -> Array:
    """Coordinates of Gaussian processes from standard normals."""
    return 0.5 + u / (2.0 * COORDINATE_REACH)


class RigMeasurements:
    """Measurements on a rig, as numbers of any run.

    Raises:
        StudyError: a file that cannot be read, or a number without an error.
    """

    def __init__(self, study: Study, source: Path, units: dict[str, str]) -> None:
        self.of = study.measured
        self.model_error = (study.calibrate or Calibrate()).model_error
        self.signals: dict[str, MeasuredSignal] = {}
        for of in self.of:
            if of.signal is not None and of.file is not None:
                columns = MeasuredColumns(of.column, of.time, of.unit, of.time_unit, of.decimal, of.head)
                try:
                    measured = read_signal(source.parent / of.file, of.signal, units[of.signal], columns)
                except WarpchainError as error:
                    raise StudyError(options_as_keys(str(error))) from None
                self.signals[of.signal] = measured

    def measured_numbers(self, turns: float, results: Results) -> tuple[MeasuredNumber, ...]:
        """Numbers measured on the rig, with their errors."""
        found = []
        for of in self.of:
            if of.metric is not None:
                assert of.value is not None  # its own rule
                found.append(self._measured_number(of, of.metric, results.column_unit(of.metric), of.value, 0.0))
                continue
            signal, features = self.signals[str(of.signal)], _features_of_measurement(of)
            values, errors = (
                form(signal.time, signal.values, turns)
                for form in (features.values_of_signal, features.standard_errors)
            )
            for name, value, error in zip(features.names, values, errors, strict=True):
                found.append(self._measured_number(of, f"{of.signal}: {name}", signal.unit, float(value), float(error)))
        return tuple(found)

    def _measured_number(self, of: Measurement, name: str, unit: str, value: float, scatter: float) -> MeasuredNumber:
        """One number measured on the rig, with its error."""
        if not np.isfinite(value):
            raise StudyError(f"measured: {name}: the measured signal is too short or too coarse for it")
        said = of.error if of.error is not None else abs(value) * float(of.relative_error or 0.0)
        error = float(np.sqrt(said**2 + scatter**2 + (self.model_error * value) ** 2))
        if not error > 0.0:
            raise StudyError(f"measured: {name} = {value:g}: relative_error of 0 is no error; give error")
        return MeasuredNumber(name, unit, value, error)

    def numbers_of_run(self, results: Results, row: int, trajectory: Trajectory | None) -> list[float]:
        """Numbers of a run as measured on the rig."""
        found: list[float] = []
        for of in self.of:
            if of.metric is not None:
                held = of.metric in results.table.column_names and results.ok[row]
                found.append(float(results.values(of.metric)[row]) if held else np.nan)
                continue
            features = _features_of_measurement(of)
            if trajectory is None:
                found += [np.nan] * len(features.names)
                continue
            part = _window_frames(results, row, trajectory)
            signal = signal_source(trajectory, str(of.signal)).values()[part]
            found += features.values_of_signal(
                trajectory.time[part], signal, mean_driver_turns(trajectory, part)
            ).tolist()
        return found


def _features_of_measurement(of: Measurement) -> SignalFeatures:
    """Features of a measured signal that count."""
    return SignalFeatures(of.statistics, of.orders, of.bands)


def _window_frames(results: Results, row: int, trajectory: Trajectory) -> slice:
    """Frames of a trajectory in the metrics' window."""
    ends = (float(results.values(name)[row]) for name in ("window_start", "window_end"))
    first, last = (int(np.searchsorted(trajectory.time, end)) for end in ends)
    return slice(first, last + 1)


def mean_driver_turns(trajectory: Trajectory, part: slice) -> float:
    """Mean turns of the driver [1/s] over some frames."""
    (angles,) = require_channels(trajectory, "sprocket_angle")
    angle, time = forward_values(trajectory.drive, angles[part], trajectory.drive.driver), trajectory.time[part]
    return float((angle[-1] - angle[0]) / (time[-1] - time[0]) / (2.0 * np.pi)) if len(time) > 1 else 0.0


class CalibrationRuns:
    """Rounds of a calibration's runs: standard normals, numbers."""

    def __init__(self, bench: StudySession, folder: Path, rig: RigMeasurements, progress: Progress) -> None:
        self.bench, self.folder, self.rig, self.progress = bench, folder, rig, progress
        chosen = [factor for factor in bench.study.design_study.factors if factor.value_source != "expression"]
        self._held = {factor.name: nominal_value(factor, bench.drive) for factor in chosen}
        self.rounds = 0
        self.normals = np.zeros((0, noise_dimensions(bench.study)))
        self.turns: list[float] = []
        self._numbers: list[list[float]] = []
        self.results: Results

    def rows_of_normals(self, u: Array) -> list[dict[str, Any]]:
        """Calibration rows at standard normals (R, D)."""
        return [self._held | row for row in noise_rows_of_normals(self.bench.study, u)]

    def run_round(self, u: Array) -> None:
        """Runs a calibration's round at standard normals (R, D)."""
        import pyarrow as pa

        raise_if_stopped()
        note = self.folder / round_folder_name(self.rounds) / "normals.parquet"
        if not note.exists():
            note.parent.mkdir(parents=True, exist_ok=True)
            write_table(note, pa.table({f"u{k}": column for k, column in enumerate(u.T)}))
        held = read_table(note)
        u = np.stack([np.asarray(held[name].to_numpy(), dtype=float) for name in held.column_names], axis=1)
        self.bench.run_round(self.rounds, self.rows_of_normals(u), self.progress)
        self.rounds += 1
        table = read_rounds(self.folder, self.rounds)
        write_table(self.folder / "results.parquet", table)
        self.results = read_results(table, self.bench.shown_factors)
        for row in range(len(self.normals), table.num_rows):
            trajectory = None
            if self.rig.signals and self.results.ok[row]:
                number = int(self.results.variants[row])
                (trajectory,) = recorded_trajectories(self.results, self.folder, [number]).values()
                self.turns.append(mean_driver_turns(trajectory, _window_frames(self.results, row, trajectory)))
            self._numbers.append(self.rig.numbers_of_run(self.results, row, trajectory))
        self.normals = np.vstack([self.normals, u])
        if not self.results.ok.any():
            raise StudyError(f"no run is ok: {self.results.reason_counts()[0][1]}")

    @property
    def run_numbers(self) -> Array:
        """Numbers (R, J) of all runs of a calibration."""
        return np.array(self._numbers)


@check_arguments(StudyError)
@interruptible_work()
def calibrate(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    report: Callable[[str], object] | None = None,
) -> Calibration:
    """Calibration of a study's noise factors to measurements.

    Args:
        source: the study file, with `[[measured]]` and noise factors.
        out: the folder; made if there is none.
        progress: True shows a bar; see `StudySession.evaluate`.
        report: called with a line after each round.

    Raises:
        StudyError: an error of the study, another study's folder, or runs that are not ok.
        KeyboardInterrupt: what is done stays.
    """
    from scipy.stats import norm, qmc

    require_extra("calibrate", "calibrate", StudyError)
    bench = StudySession(source, out, workers=workers, memory=memory, search_target="what was measured")
    if not bench.study.measured:
        raise StudyError(f"{source}: measured: missing; calibrate needs at least one measured value or signal")
    check_prior_spreads(source, bench.study)
    settings = bench.study.calibrate or Calibrate()
    rig = RigMeasurements(bench.study, Path(source), signal_units(bench.drive))
    if rig.signals:
        record = Recording(every=1, rate=bench.study.record.rate)
        bench.study = bench.study.model_copy(update={"record": record})
    folder = make_search_folder(Path(out), bench)
    runs, rng = CalibrationRuns(bench, folder, rig, progress), np.random.default_rng(settings.seed)
    dimensions, checks = noise_dimensions(bench.study), min(MOST_CHECK_RUNS, settings.batch)
    if report is not None:
        total = settings.count + settings.rounds * settings.batch + checks
        report(f"{settings.count} runs at first, {total} in all")
    runs.run_round(norm.ppf(qmc.LatinHypercube(dimensions, rng=rng).random(settings.count)))
    steps: list[tuple[Array, Array]] = []
    for number in range(settings.rounds + 1):
        measured = rig.measured_numbers(float(np.mean(runs.turns)) if runs.turns else 0.0, runs.results)
        values, errors = (np.array([getattr(of, key) for of in measured]) for key in ("value", "error"))
        emulated = NumberEmulators(runs.normals, runs.run_numbers, [of.name for of in measured])
        posterior = sample_posterior(emulated, values, errors, dimensions, settings.seed)
        steps.append((posterior.sample_mean, posterior.u.std(axis=0)))
        if report is not None:
            left = ", ".join(f"{100.0 * of.left:.0f} %" for of in posterior_directions(posterior.u))
            report(f"{len(runs.normals)} runs: remaining uncertainty by direction: {left}")
        if number < settings.rounds:
            runs.run_round(_random_samples(posterior.u, settings.batch, rng))
    runs.run_round(np.vstack([posterior.sample_mean[None], _random_samples(posterior.u, checks - 1, rng)]))
    before, after = (
        rng.standard_normal((PREDICTION_DRAWS, dimensions)),
        _random_samples(posterior.u, PREDICTION_DRAWS, rng),
    )
    drive = _write_posterior(folder, runs, posterior.sample_mean, after)
    return Calibration(
        folder, bench.study, runs.results, runs.normals, rig.signals, measured, runs.run_numbers, emulated, checks,
        tuple(steps), before, after, _unknown_values(runs, before), _unknown_values(runs, after), posterior.independent,
        tuple(_directions_of_factors(posterior_directions(after), noise_mixing(bench.study))),
        standardized_residuals(emulated, values, errors, after),
        tuple(_metric_predictions(runs, settings, before, after, rng)), drive,
    )  # fmt: skip


def _random_samples(u: Array, count: int, rng: np.random.Generator) -> Array:
    """Random choice of at most `count` posterior samples."""
    return u[rng.permutation(len(u))[:count]]


def _directions_of_factors(found: Sequence[PosteriorDirection], mixing: Array) -> list[PosteriorDirection]:
    """Posterior directions of factors from independent normals'."""
    turned = [mixing @ of.weights for of in found]
    return [PosteriorDirection(w / np.linalg.norm(w), of.left) for w, of in zip(turned, found, strict=True)]


def _unknown_values(runs: CalibrationRuns, u: Array) -> dict[str, Array]:
    """Values (S,) by unknown at standard normals (S, D)."""
    rows = runs.rows_of_normals(u)
    names = [factor.name for factor in runs.bench.study.noise_study.factors]
    return {name: np.array([row[name] for row in rows], dtype=float) for name in names}


def _write_posterior(folder: Path, runs: CalibrationRuns, mean: Array, after: Array) -> Path:
    """Writes posterior samples and calibrated drive; returns the latter's file."""
    columns = _unknown_values(runs, after)
    lines = [
        ",".join(columns),
        *(",".join(f"{value:.15g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    write_study_text(folder / "posterior.csv", "\n".join(lines) + "\n")
    drive = folder / "calibrated.toml"
    write_study_text(drive, drive_text(runs.bench.drive_text, runs.bench.drives(runs.rows_of_normals(mean[None]))[0]))
    return drive


def _metric_predictions(
    runs: CalibrationRuns, settings: Calibrate, before: Array, after: Array, rng: np.random.Generator
) -> Any:
    """Predictions of metrics before and after calibration."""
    results = runs.results
    named = settings.predict or [of.metric for of in runs.bench.study.measured if of.metric is not None]
    for metric in dict.fromkeys(named):
        values = np.where(results.usable_rows(metric), results.values(metric), np.nan)
        of = NumberEmulators(runs.normals, values[:, None], [metric])
        drawn = []
        for u in (before, after):
            mean, variance = of(u)
            drawn.append(mean[:, 0] + np.sqrt(variance[:, 0]) * rng.standard_normal(len(u)))
        yield MetricPrediction(metric, drawn[0], drawn[1], of.q2_values[0])
