"""`warpchain calibrate`: posterior of a drive's unknowns given measurements on a rig.

    study.toml  drive.toml      the study and its base drive
    rounds/NNNN/                a round of runs (`optimize.bench`), all recorded
    rounds/NNNN/normals.parquet where its rows are among independent standard normals
    results.parquet             all runs
    posterior.csv               samples of the unknowns, to be the noise of other studies
    calibrated.toml             the drive at the posterior's means

The first round is spread over the prior. A Gaussian process of each number that was
measured follows, and a posterior by it (`analysis.posterior`), which the next round is drawn from, and so on; the last
round is not learned from: it checks the processes where the posterior is. A run scatters as the rig
does, so the processes' own noise counts as an error of the measurement.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.argument_checks import Count, Workers, check_arguments
from warpchain.drive.drive_text import drive_text
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError, WarpchainError
from warpchain.extras import require_extra
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.results.measured import signal_units, source
from warpchain.results.measured_columns import Columns
from warpchain.results.measured_file import Measured, read_signal
from warpchain.results.run import Trajectory, need
from warpchain.results.signal_features import Features
from warpchain.results.signals import forward
from warpchain.study.analysis.posterior import (
    PosteriorDirection,
    posterior_directions,
    sample_posterior,
    standardized_residuals,
)
from warpchain.study.design.factor_values import values_from_probabilities
from warpchain.study.design.noise_rows import noise_dimensions, noise_mixing, noise_rows_of_normals, nominal_value
from warpchain.study.optimize.bench import Bench, round_name, together
from warpchain.study.optimize.campaign import made_folder
from warpchain.study.results import NOISE, Array, Results, read_results
from warpchain.study.run.recordings import recorded_trajectories
from warpchain.study.spec import Study
from warpchain.study.spec.calibration_tables import Calibrate, Measurement
from warpchain.study.spec.study_tables import Recording
from warpchain.study.store import read_table, write_study_text, write_table
from warpchain.study.surrogate.gaussian_process import GaussianProcess, fit_gaussian_process, one_linear_algebra_thread

REACH = 3.0
"""Standard normals from minus to plus this are the processes' coordinates from 0 to 1."""
CHECKS = 8
"""Most runs of the last round."""
DRAWS = 2000
"""Samples that predictions are taken over."""
NARROWEST = 1e-9
"""Least standard deviation of an unknown a priori, in parts of its largest value."""


@dataclass(frozen=True)
class Number:
    """A number that was measured.

    Attributes:
        name: a metric, or "SIGNAL: STATISTIC".
        unit: SI.
        value: that was measured.
        error: its standard deviation.
    """

    name: str
    unit: str
    value: float
    error: float


@dataclass(frozen=True)
class Prediction:
    """A metric before and after: (S,) samples of what a run gives, and the processes' Q2."""

    metric: str
    before: Array
    after: Array
    q2: float


@dataclass(frozen=True)
class Calibrated:
    """Result of a calibration.

    Attributes:
        folder: of the runs.
        study: with the unknowns, its noise factors, and what was measured.
        results: all runs.
        normals: (R, D) where they are among independent standard normals.
        signals: that were measured, by name.
        numbers: that were measured.
        runs: (R, J) the numbers of the runs, NaN where a run is not ok.
        emulated: their Gaussian processes, of all rounds but the last.
        checks: number of runs of the last round, the first of which is of the calibrated drive.
        rounds: mean and standard deviation (D,) of the normals after each round.
        before, after: (S, D) samples of the normals a priori, and of the posterior.
        values_before, values: (S,) of each unknown at these.
        independent: samples that the posterior's are worth.
        directions: of the unknowns' normals, the least identified first.
        residuals: (J,) measured less expected numbers, in standard deviations of both.
        predictions: of metrics.
        drive: file of the drive at the posterior's means.
    """

    folder: Path
    study: Study
    results: Results
    normals: Array
    signals: dict[str, Measured]
    numbers: tuple[Number, ...]
    runs: Array
    emulated: Emulated
    checks: int
    rounds: tuple[tuple[Array, Array], ...]
    before: Array
    after: Array
    values_before: dict[str, Array]
    values: dict[str, Array]
    independent: float
    directions: tuple[PosteriorDirection, ...]
    residuals: Array
    predictions: tuple[Prediction, ...]
    drive: Path

    @cached_property
    def checked(self) -> tuple[int, int]:
        """Numbers of the last round's runs within 1.96 standard deviations of the processes, and numbers in all."""
        mean, variance = self.emulated(self.normals[-self.checks :])
        off = np.abs(self.runs[-self.checks :] - mean) / np.sqrt(variance)
        return int((off <= 1.96).sum()), int(np.isfinite(off).sum())


def check_spreads(source: str | os.PathLike[str], study: Study) -> None:
    """Refuses unknowns whose values are all but equal a priori, before anything runs.

    Raises:
        StudyError: a distribution that is narrower than `NARROWEST`.
    """
    u = (np.arange(DRAWS) + 0.5) / DRAWS
    for i, factor in enumerate(study.factors):
        if factor.kind != NOISE:
            continue
        values = np.array(values_from_probabilities(factor, u), dtype=float)
        spread, least = float((values - values[0]).std()), NARROWEST * float(np.abs(values).max())
        if not spread > least:
            key = next((key for key in ("std", "sample", "range") if getattr(factor, key) is not None), "range")
            raise StudyError(
                f"{source}: factors.{i}.{key}: the standard deviation of {factor.name} is {spread:.3g}: must be above "
                f"{least:.3g}, {NARROWEST:g} of its largest value"
            )


class Emulated:
    """Gaussian processes of numbers over standard normals; a `posterior.Model`.

    Args:
        normals: (R, D) of all runs.
        values: (R', J) the numbers of the first R' of them; NaN where there is none.
        names: of the numbers.
    """

    def __init__(self, normals: Array, values: Array, names: Sequence[str]) -> None:
        self.processes: list[GaussianProcess] = []
        for name, column in zip(names, values.T, strict=True):
            raise_if_stopped()
            known = np.isfinite(column)
            if known.sum() < max(4, normals.shape[1] + 2):
                raise StudyError(f"{name}: {int(known.sum())} of {len(column)} runs have it; raise calibrate.count")
            self.processes.append(fit_gaussian_process(_scaled(normals[: len(column)][known]), column[known]))

    def __call__(self, u: Array) -> tuple[Array, Array]:
        x = _scaled(u)
        with one_linear_algebra_thread():
            found = [of.mean_and_variance(x) for of in self.processes]
        variance = [variance + of.run_variance for (_, variance), of in zip(found, self.processes, strict=True)]
        return np.stack([mean for mean, _ in found], axis=1), np.stack(variance, axis=1)

    @property
    def q2(self) -> list[float]:
        """Cross-validated Q2 of each number."""
        found = []
        for of in self.processes:
            observed, (predicted, _) = of.center + of.scale * of.z, of.leave_one_out()
            found.append(1.0 - float(((observed - predicted) ** 2).sum() / ((observed - observed.mean()) ** 2).sum()))
        return found


def _scaled(u: Array) -> Array:
    return 0.5 + u / (2.0 * REACH)


class Rig:
    """Measured numbers, and the same numbers of runs.

    Raises:
        StudyError: a file that cannot be read, or a number without an error.
    """

    def __init__(self, study: Study, source: Path, units: dict[str, str]) -> None:
        self.of = study.measured
        self.model_error = (study.calibrate or Calibrate()).model_error
        self.signals: dict[str, Measured] = {}
        for of in self.of:
            if of.signal is not None and of.file is not None:
                columns = Columns(of.column, of.time, of.unit, of.time_unit, of.decimal)
                try:
                    measured = read_signal(source.parent / of.file, of.signal, units[of.signal], columns)
                except WarpchainError as error:
                    raise StudyError(re.sub(r"say --(\w+)", r"give \1", str(error))) from None
                self.signals[of.signal] = measured

    def numbers(self, turns: float, results: Results) -> tuple[Number, ...]:
        """The measured numbers; the rig's driver is taken to turn at `turns` [1/s]."""
        found = []
        for of in self.of:
            if of.metric is not None:
                assert of.value is not None  # its own rule
                found.append(self._number(of, of.metric, results.column_unit(of.metric), of.value, 0.0))
                continue
            signal, features = self.signals[str(of.signal)], _features(of)
            values, errors = (form(signal.time, signal.values, turns) for form in (features.of, features.errors))
            for name, value, error in zip(features.names, values, errors, strict=True):
                found.append(self._number(of, f"{of.signal}: {name}", signal.unit, float(value), float(error)))
        return tuple(found)

    def _number(self, of: Measurement, name: str, unit: str, value: float, scatter: float) -> Number:
        if not np.isfinite(value):
            raise StudyError(f"measured: {name}: the measured signal is too short or too coarse for it")
        said = of.error if of.error is not None else abs(value) * float(of.relative_error or 0.0)
        error = float(np.sqrt(said**2 + scatter**2 + (self.model_error * value) ** 2))
        if not error > 0.0:
            raise StudyError(f"measured: {name} = {value:g}: relative_error of 0 is no error; give error")
        return Number(name, unit, value, error)

    def of_run(self, results: Results, row: int, trajectory: Trajectory | None) -> list[float]:
        """The numbers of a run; NaN where it has none."""
        found: list[float] = []
        for of in self.of:
            if of.metric is not None:
                held = of.metric in results.table.column_names and results.ok[row]
                found.append(float(results.values(of.metric)[row]) if held else np.nan)
                continue
            features = _features(of)
            if trajectory is None:
                found += [np.nan] * len(features.names)
                continue
            part = _window(results, row, trajectory)
            signal = source(trajectory, str(of.signal)).values()[part]
            found += features.of(trajectory.time[part], signal, turns_of(trajectory, part)).tolist()
        return found


def _features(of: Measurement) -> Features:
    return Features(of.statistics, of.orders, of.bands)


def _window(results: Results, row: int, trajectory: Trajectory) -> slice:
    """The frames of a run's window."""
    ends = (float(results.values(name)[row]) for name in ("window_start", "window_end"))
    first, last = (int(np.searchsorted(trajectory.time, end)) for end in ends)
    return slice(first, last + 1)


def turns_of(trajectory: Trajectory, part: slice) -> float:
    """Mean speed of the driver over frames [1/s]."""
    (angles,) = need(trajectory, "sprocket_angle")
    angle, time = forward(trajectory.drive, angles[part], trajectory.drive.driver), trajectory.time[part]
    return float((angle[-1] - angle[0]) / (time[-1] - time[0]) / (2.0 * np.pi)) if len(time) > 1 else 0.0


class Runs:
    """Runs of a folder by rounds: their normals, and the numbers that are measured."""

    def __init__(self, bench: Bench, folder: Path, rig: Rig, progress: Progress) -> None:
        self.bench, self.folder, self.rig, self.progress = bench, folder, rig, progress
        chosen = [factor for factor in bench.study.design_study.factors if factor.value_source != "expression"]
        self._held = {factor.name: nominal_value(factor, bench.drive) for factor in chosen}
        self.rounds = 0
        self.normals = np.zeros((0, noise_dimensions(bench.study)))
        self.turns: list[float] = []
        self._numbers: list[list[float]] = []
        self.results: Results

    def rows_at(self, u: Array) -> list[dict[str, Any]]:
        """Values by factor at normals (R, D)."""
        return [self._held | row for row in noise_rows_of_normals(self.bench.study, u)]

    def run(self, u: Array) -> None:
        """Runs a round at normals (R, D), or takes the one that was run there."""
        import pyarrow as pa

        raise_if_stopped()
        note = self.folder / round_name(self.rounds) / "normals.parquet"
        if not note.exists():
            note.parent.mkdir(parents=True, exist_ok=True)
            write_table(note, pa.table({f"u{k}": column for k, column in enumerate(u.T)}))
        held = read_table(note)
        u = np.stack([np.asarray(held[name].to_numpy(), dtype=float) for name in held.column_names], axis=1)
        self.bench.round(self.rounds, self.rows_at(u), self.progress)
        self.rounds += 1
        table = together(self.folder, self.rounds)
        write_table(self.folder / "results.parquet", table)
        self.results = read_results(table, self.bench.shown)
        for row in range(len(self.normals), table.num_rows):
            trajectory = None
            if self.rig.signals and self.results.ok[row]:
                number = int(self.results.variants[row])
                (trajectory,) = recorded_trajectories(self.results, self.folder, [number]).values()
                self.turns.append(turns_of(trajectory, _window(self.results, row, trajectory)))
            self._numbers.append(self.rig.of_run(self.results, row, trajectory))
        self.normals = np.vstack([self.normals, u])
        if not self.results.ok.any():
            raise StudyError(f"no run is ok: {self.results.reason_counts()[0][1]}")

    @property
    def numbers(self) -> Array:
        """(R, J) of all runs."""
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
) -> Calibrated:
    """Calibrates a study's noise factors to measurements, or goes on with a calibration.

    Args:
        source: the study file, with `[[measured]]` and noise factors.
        out: the folder; made if there is none.
        workers: CPU threads; None takes all cores.
        memory: budget of a shard [bytes].
        progress: True shows a bar for each round; see `Bench.evaluate`.
        report: called with a line after each round.

    Raises:
        StudyError: an error of the study, a folder of another one, or runs that are not ok.
        KeyboardInterrupt: the user stopped it; what is done stays.
    """
    from scipy.stats import norm, qmc

    require_extra("calibrate", "calibrate", StudyError)
    bench = Bench(source, out, workers=workers, memory=memory, search_target="what was measured")
    if not bench.study.measured:
        raise StudyError(f"{source}: measured: missing; calibrate needs at least one measured value or signal")
    check_spreads(source, bench.study)
    settings = bench.study.calibrate or Calibrate()
    rig = Rig(bench.study, Path(source), signal_units(bench.drive))
    if rig.signals:
        record = Recording(every=1, rate=bench.study.record.rate)
        bench.study = bench.study.model_copy(update={"record": record})
    folder = made_folder(Path(out), bench)
    runs, rng = Runs(bench, folder, rig, progress), np.random.default_rng(settings.seed)
    dimensions, checks = noise_dimensions(bench.study), min(CHECKS, settings.batch)
    if report is not None:
        total = settings.count + settings.rounds * settings.batch + checks
        report(f"{settings.count} runs at first, {total} in all")
    runs.run(norm.ppf(qmc.LatinHypercube(dimensions, rng=rng).random(settings.count)))
    steps: list[tuple[Array, Array]] = []
    for number in range(settings.rounds + 1):
        measured = rig.numbers(float(np.mean(runs.turns)) if runs.turns else 0.0, runs.results)
        values, errors = (np.array([getattr(of, key) for of in measured]) for key in ("value", "error"))
        emulated = Emulated(runs.normals, runs.numbers, [of.name for of in measured])
        posterior = sample_posterior(emulated, values, errors, dimensions, settings.seed)
        steps.append((posterior.sample_mean, posterior.u.std(axis=0)))
        if report is not None:
            left = ", ".join(f"{100.0 * of.left:.0f} %" for of in posterior_directions(posterior.u))
            report(f"{len(runs.normals)} runs: remaining uncertainty by direction: {left}")
        if number < settings.rounds:
            runs.run(_some(posterior.u, settings.batch, rng))
    runs.run(np.vstack([posterior.sample_mean[None], _some(posterior.u, checks - 1, rng)]))
    before, after = rng.standard_normal((DRAWS, dimensions)), _some(posterior.u, DRAWS, rng)
    drive = _write(folder, runs, posterior.sample_mean, after)
    return Calibrated(
        folder, bench.study, runs.results, runs.normals, rig.signals, measured, runs.numbers, emulated, checks,
        tuple(steps), before, after, _columns(runs, before), _columns(runs, after), posterior.independent,
        tuple(_mixed(posterior_directions(after), noise_mixing(bench.study))),
        standardized_residuals(emulated, values, errors, after),
        tuple(_predictions(runs, settings, before, after, rng)), drive,
    )  # fmt: skip


def _some(u: Array, count: int, rng: np.random.Generator) -> Array:
    """So many of the samples, or all."""
    return u[rng.permutation(len(u))[:count]]


def _mixed(found: Sequence[PosteriorDirection], mixing: Array) -> list[PosteriorDirection]:
    """Directions of the independent normals as those of the factors' own."""
    turned = [mixing @ of.weights for of in found]
    return [PosteriorDirection(w / np.linalg.norm(w), of.left) for w, of in zip(turned, found, strict=True)]


def _columns(runs: Runs, u: Array) -> dict[str, Array]:
    """(S,) values of each unknown at normals (S, D)."""
    rows = runs.rows_at(u)
    names = [factor.name for factor in runs.bench.study.noise_study.factors]
    return {name: np.array([row[name] for row in rows], dtype=float) for name in names}


def _write(folder: Path, runs: Runs, mean: Array, after: Array) -> Path:
    """Writes the samples, and the drive at the posterior's means; returns the drive's file."""
    columns = _columns(runs, after)
    lines = [
        ",".join(columns),
        *(",".join(f"{value:.15g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    write_study_text(folder / "posterior.csv", "\n".join(lines) + "\n")
    drive = folder / "calibrated.toml"
    write_study_text(drive, drive_text(runs.bench.drive_text, runs.bench.drives(runs.rows_at(mean[None]))[0]))
    return drive


def _predictions(runs: Runs, settings: Calibrate, before: Array, after: Array, rng: np.random.Generator) -> Any:
    """Predictions of metrics by processes of all runs."""
    results = runs.results
    named = settings.predict or [of.metric for of in runs.bench.study.measured if of.metric is not None]
    for metric in dict.fromkeys(named):
        values = np.where(results.usable_rows(metric), results.values(metric), np.nan)
        of = Emulated(runs.normals, values[:, None], [metric])
        drawn = []
        for u in (before, after):
            mean, variance = of(u)
            drawn.append(mean[:, 0] + np.sqrt(variance[:, 0]) * rng.standard_normal(len(u)))
        yield Prediction(metric, drawn[0], drawn[1], of.q2[0])
