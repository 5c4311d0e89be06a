"""`warpchain better`: which of two drives is better over a study's noise, by pairs of runs until it is sure.

    A/  B/   a folder of runs of each drive, as searches have (`campaign`): the n-th rows of both are a pair

A pair has the same noise and, with replicates, begins in the same ways. Noise factors are made of independent standard
normals by their rank correlations and distributions; design factors are held where each drive has them. The same study
asks for the same runs, so that it can be killed and gone on with, also with a larger budget or for another metric. Rare
events that no pair had are reckoned with (`warpchain.study.analysis.paired`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from warpchain.argument_checks import AllowedRange, Count, NonNegativeNumber, Workers, check_arguments
from warpchain.drive import Drive
from warpchain.drive.schema import nearest
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError, WarpchainError
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.results.metric_columns import metric_names
from warpchain.study.analysis.paired import MeanDifference, mean_difference
from warpchain.study.design.factor_values import fill_tied_values, tied_factors
from warpchain.study.design.noise_rows import noise_dimensions, noise_rows_of_normals, nominal_value
from warpchain.study.optimize.bench import Bench, together
from warpchain.study.optimize.campaign import made_folder
from warpchain.study.results import Array, Results, read_results
from warpchain.study.run.row_drives import drive_of_row
from warpchain.study.run.shards import kept_metric_patterns
from warpchain.study.spec import Study
from warpchain.study.spec.noise_table import Noise, metric_from_name, statistic_from_name
from warpchain.study.store import write_table

DRIVES = ("A", "B")


@check_arguments(StudyError)
@dataclass(frozen=True)
class Comparison:
    """Settings of a comparison.

    Attributes:
        metric: whose means are compared; None is the study's only objective.
        sense: which is better; None is the objective's where there is one of the metric, else "min".
        level: probability with which no wrong sign is told, however often it is looked for.
        budget: most runs of both drives.
        batch: pairs that are run at once.
        event: change of a pair's difference by rare events that is reckoned with though no pair had it, in SI units;
            None takes `paired.EVENT` deviations of the differences.

    Raises:
        StudyError: a number that is not allowed.
    """

    metric: str | None = None
    sense: Literal["min", "max"] | None = None
    level: Annotated[float, AllowedRange("a number from 0.5 to below 1", lambda x: 0.5 <= x < 1.0)] = 0.95
    budget: Count = 200
    batch: Annotated[int, AllowedRange("a whole number of at least 4", lambda n: n >= 4)] = 8
    event: NonNegativeNumber | None = None

    def batches(self, copies: int) -> int:
        """Most batches, with so many runs of each drive in a pair.

        Raises:
            StudyError: there is not even one.
        """
        runs = 2 * self.batch * copies
        if self.budget < runs:
            raise StudyError(f"budget = {self.budget}: must be at least {runs}, the runs of a batch")
        return self.budget // runs


DEFAULT = Comparison()


@dataclass(frozen=True)
class Better:
    """Two drives compared by a metric.

    Attributes:
        metric: its name.
        sense: "min" or "max", which is better.
        results: all runs of A and of B.
        differences: (P,) of the pairs, B less A; NaN where one of the two is not ok.
        found: mean of those that are there.
        means: of the metric over the same pairs, of A and of B.
        copies: runs of each drive in a pair.
        budget: runs that were allowed.
        folders: of A's and B's runs.
    """

    metric: str
    sense: str
    results: tuple[Results, ...]
    differences: Array
    found: MeanDifference
    means: tuple[float, ...]
    copies: int
    budget: int
    folders: tuple[Path, ...]

    @property
    def better(self) -> str | None:
        """ "A" or "B" where it is sure, also if the pairs missed rare events, else None."""
        return self._of_sign(self.found.sure_sign)

    @property
    def shown(self) -> str | None:
        """ "A" or "B" where the pairs show it, apart from events larger than all they had; else None."""
        return self._of_sign(self.found.shown_sign)

    def _of_sign(self, sign: int) -> str | None:
        return {1: "B", -1: "A"}.get(sign * (1 if self.sense == "max" else -1))

    @property
    def runs(self) -> int:
        """Number of runs of both."""
        return 2 * self.copies * len(self.differences)

    @property
    def unit(self) -> str:
        """Unit of the metric."""
        return self.results[0].column_unit(self.metric)

    def won(self, name: str) -> int:
        """In how many pairs a drive is better."""
        way = (1.0 if self.sense == "max" else -1.0) * (1.0 if name == "B" else -1.0)
        return int((way * self.differences > 0.0).sum())

    def lost(self, name: str) -> tuple[int, str]:
        """Number of a drive's runs that are not ok or lack the metric, and why."""
        results = self.results[DRIVES.index(name)]
        reasons = results.reason_counts()
        return int((~results.usable_rows(self.metric)).sum()), reasons[0][1] if reasons else f"no {self.metric}"


@check_arguments(StudyError)
@interruptible_work()
def find_better(
    source: str | os.PathLike[str],
    drives: tuple[str | os.PathLike[str], str | os.PathLike[str]],
    out: str | os.PathLike[str],
    by: Comparison = DEFAULT,
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    report: Callable[[Better], object] | None = None,
) -> Better:
    """Runs two drives over the same noise until it is sure which has the better mean of a metric.

    Args:
        source: the study file, with noise factors.
        drives: files of A and B, or names of examples; the study's own drive is not run.
        out: the folder; made if there is none.
        by: metric, level and budget.
        workers: CPU threads; None takes all cores.
        memory: budget of a shard [bytes].
        progress: True shows a bar for each batch; see `Bench.evaluate`.
        report: called after each batch.

    Raises:
        StudyError: an error of the study or a drive, a folder of another study, or runs that are not ok.
        KeyboardInterrupt: the user stopped it; what is done stays.
    """
    benches = first, second = tuple(
        Bench(source, Path(out) / name, workers=workers, memory=memory, drive=drive)
        for name, drive in zip(DRIVES, drives, strict=True)
    )
    study, rounds = first.study, by.batches(first.study.design.copies)
    if not study.noise_names:
        raise StudyError(f'{source}: factors: none is noise; better needs at least one of kind "noise"')
    if first.drive == second.drive:
        raise StudyError(f"{drives[0]} and {drives[1]}: are the same drive")
    metric, way = _wanted(benches, by)
    held = [_held(bench, drive) for bench, drive in zip(benches, drives, strict=True)]
    folders = tuple(made_folder(Path(out) / name, bench) for name, bench in zip(DRIVES, benches, strict=True))
    rng, dimensions = np.random.default_rng((study.noise or Noise()).seed), noise_dimensions(study)
    for number in range(rounds):
        raise_if_stopped()
        noise = noise_rows_of_normals(study, rng.standard_normal((by.batch, dimensions)))
        for bench, own, folder in zip(benches, held, folders, strict=True):
            bench.round(number, [own | row for row in noise], progress)
            write_table(folder / "results.parquet", together(folder, number + 1))
        both = tuple(read_results(folder / "results.parquet", first.shown) for folder in folders)
        found = _differences(both, metric, by)
        better = Better(metric, way, both, *found, study.design.copies, by.budget, folders)
        if report is not None:
            report(better)
        if better.better is not None:
            break
    return better


def _differences(
    both: Sequence[Results], metric: str, by: Comparison
) -> tuple[Array, MeanDifference, tuple[float, ...]]:
    """Differences of the pairs, B less A, NaN where one is not ok; their mean, and those of the metric of A and B.

    Raises:
        StudyError: fewer than two pairs are whole.
    """
    values = np.array([_values(each, metric) for each in both])
    whole, differences = np.isfinite(values).all(axis=0), values[1] - values[0]
    if whole.sum() < 2:
        reasons = [text for each in both for _, text, _ in each.reason_counts()] or [f"runs have no {metric}"]
        raise StudyError(f"{metric}: {int(whole.sum())} of {len(whole)} pairs have both runs ok: {reasons[0]}")
    found = mean_difference(differences[whole], by.level, by.event)
    return differences, found, tuple(values[:, whole].mean(axis=1).tolist())


def _values(results: Results, metric: str) -> Array:
    """A metric of each run (R,), NaN where it is not ok."""
    if metric not in results.table.column_names:
        return np.full(len(results.status), np.nan)
    return np.where(results.ok, results.values(metric), np.nan)


def _wanted(benches: Sequence[Bench], by: Comparison) -> tuple[str, str]:
    """The metric that is compared, and its sense.

    Raises:
        StudyError: none is named, or one that the drives do not have or the study does not keep.
    """
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
        names = [*metric_names(bench.drive), *(name for name in study.named_metrics if name not in bench.factors)]
        if metric not in names:
            raise StudyError(f"metric = {metric!r}: no such metric; {nearest(metric, names, 8)}")
    if not any(fnmatchcase(metric, pattern) for pattern in kept_metric_patterns(study)):
        raise StudyError(f"metric = {metric!r}: metrics.keep of the study leaves it out")
    named = [o for o in study.objectives if metric_from_name(o.metric) == metric and not o.metric.startswith("std(")]
    return metric, by.sense or (named[0].sense if named else "min")


def _held(bench: Bench, drive: Any) -> dict[str, Any]:
    """Values of the design factors that leave a drive as it is.

    Raises:
        StudyError: there are none, or they miss a constraint.
    """
    study: Study = bench.study.design_study
    row = {
        factor.name: nominal_value(factor, bench.drive)
        for factor in study.factors
        if factor.value_source != "expression"
    }
    given = dict(row)
    reason = fill_tied_values(study, tied_factors(study), row)
    for factor in study.factors if reason is None else ():
        if factor.value_source != "expression" and not any(factor.target_paths()) and factor.shift is None:
            reason = f"factor {factor.name} has no place in a drive file, which could not say its value"
        elif not _leaves(study.model_copy(update={"factors": (factor,)}), bench.drive, row):
            reason = reason or f"factor {factor.name} has no value that leaves this drive as it is"
    if reason is not None:
        raise StudyError(f"{drive}: {reason}")
    return given


def _leaves(study: Study, drive: Drive, row: dict[str, Any]) -> bool:
    """Whether values of a study's factors leave a drive as it is."""
    try:
        return drive_of_row(study, drive, row) == drive
    except WarpchainError:
        return False
