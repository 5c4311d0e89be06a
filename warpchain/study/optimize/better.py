"""`warpchain better`: finds the better of two drives over a study's noise, by pairs of runs until it is sure.

    A/  B/   folders of the runs of each drive: their n-th rows are a pair, with the same noise

Design factors are held at each drive's values.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from warpchain.argument_checks import AllowedRange, Count, NonNegativeNumber, Workers, check_arguments
from warpchain.drive.schema import nearest_key_text
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.results.metric_columns import metric_names
from warpchain.study.analysis.paired import MeanDifference, mean_difference
from warpchain.study.design.noise_rows import noise_dimensions, noise_rows_of_normals
from warpchain.study.optimize.design_search import make_search_folder
from warpchain.study.optimize.study_session import StudySession, read_rounds
from warpchain.study.results import Array, Results, read_results
from warpchain.study.run.shards import kept_metric_patterns
from warpchain.study.run.today import row_of_drive
from warpchain.study.spec.noise_table import Noise, metric_from_name, statistic_from_name
from warpchain.study.store import write_table

DRIVE_NAMES = ("A", "B")


@check_arguments(StudyError)
@dataclass(frozen=True)
class Comparison:
    """Settings of a comparison of two drives.

    Attributes:
        metric: whose means are compared; None is the study's only objective.
        sense: "min" or "max"; None is the objective's, or else "min".
        level: probability with which no wrong sign is stated.
        event: change of a difference by rare events, in SI; None takes `paired.EVENT_DEVIATIONS`.
    """

    metric: str | None = None
    sense: Literal["min", "max"] | None = None
    level: Annotated[float, AllowedRange("a number from 0.5 to below 1", lambda x: 0.5 <= x < 1.0)] = 0.95
    budget: Count = 200
    batch: Annotated[int, AllowedRange("a whole number of at least 4", lambda n: n >= 4)] = 8
    event: NonNegativeNumber | None = None

    def most_batches(self, copies: int) -> int:
        """Most batches of pairs that the comparison's budget allows."""
        runs = 2 * self.batch * copies
        if self.budget < runs:
            raise StudyError(f"budget = {self.budget}: must be at least {runs}, the runs of a batch")
        return self.budget // runs


DEFAULT_COMPARISON = Comparison()


@dataclass(frozen=True)
class DriveComparison:
    """Two drives compared by the mean of a metric."""

    metric: str
    sense: str  # "min" or "max", which is better
    results: tuple[Results, ...]
    differences: Array  # (P,) of the pairs, B less A; NaN if one is not ok
    found: MeanDifference  # mean of the differences
    means: tuple[float, ...]  # of the metric over the pairs, of A and of B
    copies: int  # runs of each drive in a pair
    budget: int
    folders: tuple[Path, ...]

    @property
    def sure_winner(self) -> str | None:
        """Drive, "A" or "B", that is surely better, or None."""
        return self._winner_of_sign(self.found.sure_sign)

    @property
    def shown_winner(self) -> str | None:
        """Drive, "A" or "B", that pairs show better, or None."""
        return self._winner_of_sign(self.found.shown_sign)

    def _winner_of_sign(self, sign: int) -> str | None:
        """Better drive, "A" or "B", by a difference's sign."""
        return {1: "B", -1: "A"}.get(sign * (1 if self.sense == "max" else -1))

    @property
    def run_count(self) -> int:
        """Number of runs of both compared drives."""
        return 2 * self.copies * len(self.differences)

    @property
    def metric_unit(self) -> str:
        """Unit of the compared metric."""
        return self.results[0].column_unit(self.metric)

    def won_pairs(self, name: str) -> int:
        """Number of pairs that a compared drive wins."""
        way = (1.0 if self.sense == "max" else -1.0) * (1.0 if name == "B" else -1.0)
        return int((way * self.differences > 0.0).sum())

    def failed_runs(self, name: str) -> tuple[int, str]:
        """Number of a drive's failed runs, and a reason."""
        results = self.results[DRIVE_NAMES.index(name)]
        reasons = results.reason_counts()
        return int((~results.usable_rows(self.metric)).sum()), reasons[0][1] if reasons else f"no {self.metric}"


@check_arguments(StudyError)
@interruptible_work()
def find_better(
    source: str | os.PathLike[str],
    drives: tuple[str | os.PathLike[str], str | os.PathLike[str]],
    out: str | os.PathLike[str],
    by: Comparison = DEFAULT_COMPARISON,
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    report: Callable[[DriveComparison], object] | None = None,
) -> DriveComparison:
    """Comparison of two drives over a study's noise, run until sure.

    Args:
        source: the study file, with noise factors.
        drives: files of A and B, or names of examples.
        out: the folder; made if there is none.
        by: metric, level and budget.
        progress: True shows a bar; see `StudySession.evaluate`.
        report: called after each batch.

    Raises:
        StudyError: an error of the study or a drive, another study's folder, or runs that are not ok.
        KeyboardInterrupt: what is done stays.
    """
    benches = first, second = tuple(
        StudySession(source, Path(out) / name, workers=workers, memory=memory, drive=drive)
        for name, drive in zip(DRIVE_NAMES, drives, strict=True)
    )
    study, rounds = first.study, by.most_batches(first.study.design.copies)
    if not study.noise_names:
        raise StudyError(f'{source}: factors: none is noise; better needs at least one of kind "noise"')
    if first.drive == second.drive:
        raise StudyError(f"{drives[0]} and {drives[1]}: are the same drive")
    metric, way = _compared_metric(benches, by)
    held = [row_of_drive(study, bench.drive, drive) for bench, drive in zip(benches, drives, strict=True)]
    folders = tuple(
        make_search_folder(Path(out) / name, bench) for name, bench in zip(DRIVE_NAMES, benches, strict=True)
    )
    rng, dimensions = np.random.default_rng((study.noise or Noise()).seed), noise_dimensions(study)
    for number in range(rounds):
        raise_if_stopped()
        noise = noise_rows_of_normals(study, rng.standard_normal((by.batch, dimensions)))
        for bench, own, folder in zip(benches, held, folders, strict=True):
            bench.run_round(number, [own | row for row in noise], progress)
            write_table(folder / "results.parquet", read_rounds(folder, number + 1))
        both = tuple(read_results(folder / "results.parquet", first.shown_factors) for folder in folders)
        found = _pair_differences(both, metric, by)
        better = DriveComparison(metric, way, both, *found, study.design.copies, by.budget, folders)
        if report is not None:
            report(better)
        if better.sure_winner is not None:
            break
    return better


def _pair_differences(
    both: Sequence[Results], metric: str, by: Comparison
) -> tuple[Array, MeanDifference, tuple[float, ...]]:
    """Differences (P,) of pairs, mean difference, both drives' means."""
    values = np.array([_metric_of_runs(each, metric) for each in both])
    whole, differences = np.isfinite(values).all(axis=0), values[1] - values[0]
    if whole.sum() < 2:
        reasons = [text for each in both for _, text, _ in each.reason_counts()] or [f"runs have no {metric}"]
        raise StudyError(f"{metric}: {int(whole.sum())} of {len(whole)} pairs have both runs ok: {reasons[0]}")
    found = mean_difference(differences[whole], by.level, by.event)
    return differences, found, tuple(values[:, whole].mean(axis=1).tolist())


def _metric_of_runs(results: Results, metric: str) -> Array:
    """Compared metric (R,) of runs, NaN if not ok."""
    if metric not in results.table.column_names:
        return np.full(len(results.status), np.nan)
    return np.where(results.ok, results.values(metric), np.nan)


def _compared_metric(benches: Sequence[StudySession], by: Comparison) -> tuple[str, str]:
    """Name of the compared metric, and its sense."""
    study, metric = benches[0].study, by.metric
    if metric is None:
        if len(study.objectives) != 1:
            raise StudyError(f"metric: missing; needed where the study has {len(study.objectives)} objectives")
        metric = study.objectives[0].metric
    over = statistic_from_name(metric)
    if over is not None and over.word != "mean":
        raise StudyError(f"metric = {metric!r}: is a statistic over noise, which a pair does not have; give a metric")
    metric = metric if over is None else over.metric
    for bench in benches:
        names = [*metric_names(bench.drive), *(name for name in study.named_metrics if name not in bench.factor_names)]
        if metric not in names:
            raise StudyError(f"metric = {metric!r}: no such metric; {nearest_key_text(metric, names, 8)}")
    if not any(fnmatchcase(metric, pattern) for pattern in kept_metric_patterns(study)):
        raise StudyError(f"metric = {metric!r}: metrics.keep of the study leaves it out")
    named = [o for o in study.objectives if metric_from_name(o.metric) == metric and not o.metric.startswith("std(")]
    return metric, by.sense or (named[0].sense if named else "min")
