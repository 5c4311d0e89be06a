"""`warpchain risk`: probability that a drive breaks a limit on a metric over its noise, and the likeliest ways.

study.toml  drive.toml   the study and its base drive
rounds/NNNN/             a batch of runs
results.parquet          all runs, marked as no sample of the noise
risk.json                the estimates
played/                  a recording of the most likely way to fail
today/                   the same of the study's own drive, beside another
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import Count, Workers, check_arguments
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.files import read_text_file
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.study.analysis.failure_probability import FailureEstimate, design_points, subset_simulation
from warpchain.study.analysis.importance_sampling import (
    FailureMixture,
    combined_estimate,
    fit_mixture,
    importance_sampling,
)
from warpchain.study.design.factor_values import design_dimensions
from warpchain.study.design.noise_rows import noise_dimensions, noise_mixing, noise_rows_of_normals
from warpchain.study.optimize.design_search import make_search_folder
from warpchain.study.optimize.study_session import StudySession, read_rounds
from warpchain.study.results import Array, Results, read_results
from warpchain.study.run.recordings import RepeatedRun, recording_of_variant
from warpchain.study.run.today import row_of_drive
from warpchain.study.spec import Study, load_study
from warpchain.study.spec.study_tables import Risk
from warpchain.study.store import write_study_text, write_table

SUMMARY_FILE, TODAY_FOLDER = "risk.json", "today"
NOT_OK_LIMIT = ("", "")
"""Limit that a run breaks by not being ok."""
LimitEnd = tuple[str, str]
"""Metric and end of a limit, "min" or "max"."""


@dataclass(frozen=True)
class DesignPoint:
    """Design point: a most likely way to break a limit."""

    variant: int  # number of the run there
    distance: float  # from the medians, in standard deviations [-]
    deviations: dict[str, float]  # normal score by dimension of the noise [-]
    broken: tuple[LimitEnd, ...]


@dataclass(frozen=True)
class RiskEstimate:
    """Risk that a drive breaks limits over noise."""

    folder: Path
    drive: str  # its file or example, as named
    study: Study
    results: Results
    joint: FailureEstimate | str  # the estimate to state, or why there is none
    subset: FailureEstimate
    sampled: FailureEstimate | str  # by importance sampling, or why there is none
    points: tuple[DesignPoint, ...]
    search_runs: int  # runs of the search for both
    shares: dict[LimitEnd, float]  # part of the failures that break each limit [-]
    variant: int  # number of the run that failed at the likeliest values
    distance: float  # of that from the medians, in standard deviations [-]
    archive: Path
    today: RiskEstimate | None = None  # of the study's own drive, unless that is this drive

    @property
    def sign_beside_today(self) -> int | None:
        """Sign of the drive's risk less today's, 0 if unsure, or None."""
        if self.today is None:
            return None
        here, there = self.joint, self.today.joint
        if isinstance(here, str) or isinstance(there, str):
            return 0
        return int(here.low > there.high) - int(here.high < there.low)


class LimitMargins:
    """Least margin to a study's limits at standard normals.

    Args:
        held: values of the design factors.
    """

    def __init__(
        self,
        bench: StudySession,
        held: Mapping[str, Any],
        progress: Progress,
        report: Callable[[str], object] = lambda line: None,
    ) -> None:
        self._bench, self._held, self._progress, self._report = bench, held, progress, report
        ends = [(b.metric, end, getattr(b, end)) for b in bench.study.bounds for end in ("min", "max")]
        self._ends = [(metric, end, float(value)) for metric, end, value in ends if value is not None]
        self.limits: list[LimitEnd] = [*((metric, end) for metric, end, _ in self._ends), NOT_OK_LIMIT]
        self.rounds = 0
        self._points: list[Array] = []
        self._each: list[Array] = []

    def __call__(self, u: Array) -> Array:
        raise_if_stopped()
        rows = [{**self._held, **row} for row in noise_rows_of_normals(self._bench.study, u)]
        table = self._bench.run_round(self.rounds, rows, self._progress)
        self.rounds += 1
        results = read_results(table, self._bench.factor_names, ())
        each = []
        for metric, end, limit in self._ends:
            known = metric in table.column_names
            values = results.values(metric) if known else np.full(len(rows), np.nan)
            way = 1.0 if end == "max" else -1.0
            each.append(np.where(results.ok, way * (limit - values) / (abs(limit) or 1.0), np.nan))
        margins = np.stack([*each, np.full(len(rows), np.inf)], axis=1)
        lost = ~np.isfinite(margins[:, :-1]).all(axis=1)
        margins[lost] = [*np.full(len(each), np.inf), -np.inf]
        self._points.append(u)
        self._each.append(margins)
        done = np.vstack(self._each).min(axis=1)
        self._report(f"{len(done)} runs in {self.rounds} rounds, {int((done <= 0.0).sum())} of them break a limit")
        return np.asarray(margins.min(axis=1))

    def runs_at_points(self, points: Array) -> NDArray[np.intp]:
        """Numbers (N,) of the runs at points (N, D)."""
        known: dict[bytes, int] = {}
        for k, point in enumerate(np.vstack(self._points)):
            known.setdefault(point.tobytes(), k)
        return np.array([known[point.tobytes()] for point in points], dtype=np.intp)

    def broken_limits(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(N, L) whether each run breaks each limit."""
        return np.asarray(np.vstack(self._each)[rows] <= 0.0)

    def likeliest_failure(self) -> tuple[int, float]:
        """Number and distance of the likeliest failed run."""
        g, size = np.vstack(self._each).min(axis=1), np.linalg.norm(np.vstack(self._points), axis=1)
        ok = np.isfinite(g) if np.isfinite(g[g <= 0.0]).any() else np.ones(len(g), dtype=bool)
        at = int(np.argmin(np.where((g <= 0.0) & ok, size, np.inf)))
        return at, float(size[at])


@check_arguments(StudyError)
@interruptible_work()
def estimate_risk(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    drive: str | os.PathLike[str] | None = None,
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    report: Callable[[str], object] | None = None,
) -> RiskEstimate:
    """Risk estimate of broken limits over a study's noise.

    Args:
        source: the study file, with noise factors and `[[limits]]` on metrics.
        out: the folder; made if there is none.
        drive: file or example, estimated beside the study's own; None is that alone.
        progress: True shows a bar; see `StudySession.evaluate`.
        report: called with lines before and after each batch.

    Raises:
        StudyError: an error of the study, another study's folder, or failures too unlikely.
        KeyboardInterrupt: what is done stays.
    """
    say = report or (lambda line: None)
    machine: dict[str, Any] = {"workers": workers, "memory": memory}
    bench = StudySession(source, out, drive=drive, search_target="failures", **machine)
    name = bench.study.study.drive if drive is None else os.fspath(drive)
    own = (
        bench if drive is None else StudySession(source, Path(out) / TODAY_FOLDER, search_target="failures", **machine)
    )
    _estimate_drive_risk(bench, name, machine, progress, say)
    if own.drive != bench.drive:
        try:
            report_today = lambda line: say(f"today's design: {line}")  # noqa: E731
            _estimate_drive_risk(own, own.study.study.drive, machine, progress, report_today)
        except StudyError as error:
            raise StudyError(f"today's design: {error}") from None
    return read_risk(out)


def _estimate_drive_risk(
    bench: StudySession, name: str, machine: Mapping[str, Any], progress: Progress, say: Callable[[str], object]
) -> None:
    """Estimates a drive's risk into its folder."""
    source, study, settings = bench.source, bench.study, bench.study.risk or Risk()
    if not study.noise_names:
        raise StudyError(f'{source}: factors: none is noise; risk needs at least one of kind "noise"')
    if not study.bounds:
        raise StudyError(f"{source}: limits: none is on a metric; risk needs an entry with metric, and max or min")
    held = row_of_drive(study, bench.drive, name)
    assert bench.folder is not None  # both sessions have one
    folder = make_search_folder(bench.folder, bench)
    say(
        f"{settings.count * settings.repeats} runs for each power of ten of the probability, then {settings.samples} "
        "more and the search of the design points"
    )
    margins = LimitMargins(bench, held, progress, say)
    try:
        found = {"drive": name, **_risk_data(margins, study, settings)}
    finally:
        if margins.rounds:
            write_table(folder / "results.parquet", read_rounds(folder, margins.rounds))
    again = recording_of_variant(folder, found["variant"])
    if isinstance(again, RepeatedRun):
        again.run_again(**machine)
    write_study_text(folder / SUMMARY_FILE, json.dumps(found, indent=1))


def _risk_data(margins: LimitMargins, study: Study, settings: Risk) -> dict[str, Any]:
    """Risk estimates and design points as data of `SUMMARY_FILE`."""
    subset = subset_simulation(margins, noise_dimensions(study), settings.count, settings.repeats, settings.seed)
    mixture = fit_mixture(subset.failed)
    sampled: FailureEstimate | str
    try:
        sampled = importance_sampling(margins, mixture, settings.samples, settings.seed)
    except StudyError as error:
        sampled = str(error)
    failed = np.vstack(subset.failed if isinstance(sampled, str) else (*subset.failed, *sampled.failed))
    places, search_runs = design_points(margins, failed)
    rows, axes = margins.runs_at_points(places), [axis.name for axis in design_dimensions(study.noise_study)]
    points = [
        DesignPoint(
            int(row),
            float(np.linalg.norm(place)),
            dict(zip(axes, map(float, scores), strict=True)),
            tuple(limit for limit, beyond in zip(margins.limits, broken, strict=True) if beyond),
        )
        for row, place, scores, broken in zip(
            rows, places, places @ noise_mixing(study).T, margins.broken_limits(rows), strict=True
        )
    ]
    variant, distance = margins.likeliest_failure()
    joint = combined_estimate(subset, sampled)
    return {
        "joint": _data_from_estimate(joint),
        "subset": _data_from_estimate(subset),
        "sampled": _data_from_estimate(sampled),
        "points": [asdict(point) for point in points],
        "search_runs": search_runs,
        "shares": [[*limit, share] for limit, share in _limit_shares(margins, subset, mixture, sampled)],
        "variant": variant,
        "distance": distance,
    }


def _limit_shares(
    margins: LimitMargins, subset: FailureEstimate, mixture: FailureMixture, sampled: FailureEstimate | str
) -> list[tuple[LimitEnd, float]]:
    """Share of the failures that break each limit."""
    by_weight = not isinstance(sampled, str)
    failed = np.vstack(sampled.failed if not isinstance(sampled, str) else subset.failed)
    weights = mixture.importance_weights(failed) if by_weight else np.ones(len(failed))
    parts = weights @ margins.broken_limits(margins.runs_at_points(failed)) / weights.sum()
    return list(zip(margins.limits, parts.tolist(), strict=True))


def _data_from_estimate(found: FailureEstimate | str) -> Any:
    """Data of a risk estimate for `SUMMARY_FILE`, without points."""
    if isinstance(found, str):
        return found
    return {name: getattr(found, name) for name in ("probability", "low", "high", "evaluations")}


def _estimate_from_data(found: Any) -> FailureEstimate | str:
    """Risk estimate from the data of `SUMMARY_FILE`."""
    return found if isinstance(found, str) else FailureEstimate(**found, failed=())


def read_risk(folder: str | os.PathLike[str]) -> RiskEstimate:
    """Risk estimate read from its folder.

    Raises:
        StudyError: it is not done, or damaged.
    """
    path = Path(folder)
    study = load_study(path / "study.toml")
    if not (path / SUMMARY_FILE).exists():
        raise StudyError(
            f"{path}: its runs look for failures and are no sample of the noise; {SUMMARY_FILE}, which warpchain risk "
            "writes at its end, is not there"
        )
    try:
        found: Mapping[str, Any] = json.loads(read_text_file(path / SUMMARY_FILE, "JSON", StudyError))
        points = tuple(
            DesignPoint(p["variant"], p["distance"], p["deviations"], tuple((m, e) for m, e in p["broken"]))
            for p in found["points"]
        )
        shares = {(metric, end): float(share) for metric, end, share in found["shares"]}
        joint, subset, sampled = (_estimate_from_data(found[name]) for name in ("joint", "subset", "sampled"))
        search_runs, variant, distance = int(found["search_runs"]), int(found["variant"]), float(found["distance"])
        drive = str(found["drive"])
    except (ValueError, TypeError, KeyError):
        raise StudyError(f"{path / SUMMARY_FILE}: is damaged; make it anew with: warpchain risk") from None
    assert isinstance(subset, FailureEstimate)
    shown = [factor.name for factor in study.factors if not factor.hidden]
    results = read_results(path / "results.parquet", shown)
    again = recording_of_variant(path, variant)
    archive = again.archive if isinstance(again, RepeatedRun) else again[0]
    today = read_risk(path / TODAY_FOLDER) if (path / TODAY_FOLDER / SUMMARY_FILE).exists() else None
    return RiskEstimate(
        path,
        drive,
        study,
        results,
        joint,
        subset,
        sampled,
        points,
        search_runs,
        shares,
        variant,
        distance,
        archive,
        today,
    )
