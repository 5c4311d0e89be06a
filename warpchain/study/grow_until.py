"""Growth of a study by doubling, until its main effects are known precisely enough."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warpchain.engine.simulation import MEMORY, available_cores
from warpchain.errors import StudyError
from warpchain.progress import Progress
from warpchain.study.analysis.effects import main_effects
from warpchain.study.results import Results, read_results
from warpchain.study.run.prepare import grow_folder, preferred_shard_size
from warpchain.study.run.runner import run_folder
from warpchain.study.run.study_folder import StudyFolder, open_folder
from warpchain.study.spec.study_tables import SAMPLED_DESIGNS

_CONDITION = re.compile(r"\s*se\(\s*main effects(?:\s+of\s+(.+?))?\s*\)\s*<\s*([-+.\deE]+)\s*(%?)\s*")
_CONDITION_HELP = (
    'must be such as "se(main effects) < 1 %", "se(main effects of METRIC) < 1 %" or "... of METRIC) < 50"'
)


@dataclass(frozen=True)
class Until:
    """Condition on main effects' errors that ends growth."""

    metric: str | None  # None is those of objectives and limits, or the most telling ones
    most: float  # largest error, in the metric's unit or over its mean [-]
    relative: bool  # whether over the mean

    @classmethod
    def of(cls, text: str) -> Until:
        """Growth condition from text, "se(main effects) < 1 %".

        Raises:
            StudyError: it states none.
        """
        found = _CONDITION.fullmatch(text)
        try:
            value = float(found[2]) if found else math.nan
        except ValueError:
            value = math.nan
        if found is None or not (math.isfinite(value) and value > 0.0):
            raise StudyError(f"--until {text!r}: {_CONDITION_HELP}")
        if not found[3] and found[1] is None:
            raise StudyError(f"--until {text!r}: a value without % needs a metric: {_CONDITION_HELP}")
        return cls(found[1], value / 100.0 if found[3] else value, bool(found[3]))

    def error_text(self, error: float) -> str:
        """Text of a main effect's standard error."""
        if math.isinf(error):
            return "unknown"
        return f"{100.0 * error:.3g} %" if self.relative else f"{error:.4g}"


@dataclass(frozen=True)
class GrowthState:
    """State of a growing study after a run."""

    rows: int
    error: float  # largest standard error of a group's mean; infinite if a group is too small
    metric: str
    factor: str
    count: int
    done: bool  # whether the condition is met


def largest_effect_error(results: Results, metrics: tuple[str, ...], relative: bool) -> tuple[float, str, str]:
    """Largest standard error of main effects, metric, factor."""
    if not results.ok.any():
        raise StudyError("no variant is ok: there are no main effects to know")
    results, worst = results.sampled_rows(), (0.0, "", "")
    for metric in metrics:
        rows = results.usable_rows(metric)
        if rows.sum() < 2:
            return math.inf, metric, ""
        scale = abs(float(results.values(metric)[rows].mean())) if relative else 1.0
        for effect in main_effects(results, metric):
            errors = np.where(np.isfinite(effect.errors), effect.errors, math.inf)
            error = float(errors.max())
            worst = max(
                worst, (error / scale if scale > 0.0 else math.inf if error > 0.0 else 0.0, metric, effect.factor)
            )
    return worst


def grow_until(
    out: str | os.PathLike[str],
    until: Until,
    *,
    most: int = 10_000,
    workers: int | None = None,
    memory: int = MEMORY,
    progress: Progress = False,
    report: Callable[[GrowthState], object] | None = None,
) -> GrowthState:
    """Grows a study until a condition is met; returns its state.

    Args:
        out: folder of a study whose design is sampled.
        workers, memory, progress: as of `run_study`.
        report: called after each growth, and at the beginning.

    Raises:
        StudyError: no folder, a design that does not grow, an unknown metric, or no ok variant.
    """
    folder = open_folder(Path(out))
    if folder.study.design.kind not in SAMPLED_DESIGNS:
        raise StudyError(
            f'{out}: design.kind = "{folder.study.design.kind}" does not grow; {", ".join(SAMPLED_DESIGNS)} do'
        )
    while True:
        run_folder(folder, workers=workers, memory=memory, progress=progress)
        results = read_results(folder.results_path)
        metrics = (until.metric,) if until.metric is not None else _judged_metrics(folder, results)
        error, metric, factor = largest_effect_error(results, metrics, until.relative)
        count = folder.study.design.count or 0
        reached = GrowthState(folder.rows, error, metric, factor, count, error < until.most)
        if report is not None:
            report(reached)
        if reached.done or 2 * folder.rows > most:
            return reached
        design = folder.study.design.model_copy(update={"count": 2 * count})
        study = folder.study.model_copy(update={"design": design})
        runs = 2 * folder.rows * design.copies
        size = study.run.shard or preferred_shard_size(
            study, folder.base_drive, runs, 1, workers or available_cores(), memory
        )
        folder = grow_folder(folder, study, folder.path / "study.toml", size)


def _judged_metrics(folder: StudyFolder, results: Results) -> tuple[str, ...]:
    """Metrics whose main effects decide on a study's growth."""
    from warpchain.study.report.study_page import telling_metrics

    named = tuple(name for name in folder.study.named_metrics if name in results.metrics)
    return named or telling_metrics(results)
