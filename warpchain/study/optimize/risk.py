"""`warpchain risk`: how likely a drive breaks a limit on a metric over its noise, and how it most likely does.

    study.toml  drive.toml   the study and its base drive
    rounds/NNNN/             a batch of runs (`optimize.bench`)
    results.parquet          all runs
    played/                  a recording of the most likely way to fail

Noise factors are made of independent standard normals by their rank correlations and distributions; design factors are
held where the base drive has them. The same study asks for the same runs, so that it can be killed and gone on with.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.arguments import Count, Workers, checked
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.progress import interruptible, look_for_stop
from warpchain.study.analysis.failure_probability import (
    Estimate,
    design_points,
    importance_sampling,
    subset_simulation,
)
from warpchain.study.design.noise import at_normals, noise_dimensions, own_value
from warpchain.study.optimize.bench import Bench, Report, together
from warpchain.study.optimize.campaign import made_folder
from warpchain.study.results import Array, Results, read_results
from warpchain.study.run.recordings import Rerun, recording_of
from warpchain.study.spec.study_tables import Bound, Risk
from warpchain.study.store import write_table


@dataclass(frozen=True)
class Risked:
    """A probability of failure, by two ways.

    Attributes:
        results: all runs.
        bounds: the limits.
        held: values of the design factors.
        subset: by subset simulation.
        sampled: by importance sampling about design points, or in words why there is none.
        points: number of design points.
        variant: of the run that failed at the likeliest values.
        distance: of it from the medians, in standard deviations [-].
        archive: its recording.
    """

    results: Results
    bounds: tuple[Bound, ...]
    held: dict[str, Any]
    subset: Estimate
    sampled: Estimate | str
    points: int
    variant: int
    distance: float
    archive: Path


class Margins:
    """g of standard normals: the least margin to a limit, in parts of it; run in rounds of a folder.

    A run that is not ok fails.
    """

    def __init__(self, bench: Bench, progress: Report) -> None:
        self._bench, self._progress = bench, progress
        chosen = [factor for factor in bench.study.designs.factors if factor.form != "expression"]
        self.held = {factor.name: own_value(factor, bench.drive) for factor in chosen}
        self.rounds = 0
        self._points: list[Array] = []
        self._margins: list[Array] = []

    def __call__(self, u: Array) -> Array:
        look_for_stop()
        rows = [self.held | row for row in at_normals(self._bench.study, u)]
        table = self._bench.round(self.rounds, rows, self._progress)
        self.rounds += 1
        results = read_results(table, self._bench.factors, ())
        g = np.full(len(rows), np.inf)
        for bound in self._bench.study.bounds:
            known = bound.metric in table.column_names
            values = results.values(bound.metric) if known else np.full(len(rows), np.nan)
            for end, way in ((bound.max, 1.0), (bound.min, -1.0)):
                if end is not None:
                    g = np.minimum(g, way * (end - values) / (abs(end) or 1.0))
        g = np.where(results.ok & np.isfinite(g), g, -np.inf)
        self._points.append(u)
        self._margins.append(g)
        return g

    def likeliest(self) -> tuple[int, float]:
        """Number of the run that failed nearest to the medians, and how far off it is."""
        g, size = np.concatenate(self._margins), np.linalg.norm(np.vstack(self._points), axis=1)
        ok = np.isfinite(g) if np.isfinite(g[g <= 0.0]).any() else np.ones(len(g), dtype=bool)
        at = int(np.argmin(np.where((g <= 0.0) & ok, size, np.inf)))
        return at, float(size[at])


@checked(StudyError)
@interruptible()
def estimate_risk(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Report = False,
) -> Risked:
    """Estimates how likely a study's limits on metrics are broken over its noise, and finds how they most likely are.

    Args:
        source: the study file, with noise factors and `[[limits]]` on metrics.
        out: the folder; made if there is none.
        workers: CPU threads; None takes all cores.
        memory: budget of a shard [bytes].
        progress: True shows a bar for each batch; see `Bench.evaluate`.

    Raises:
        StudyError: an error of the study, a folder of another one, or no failure that is likely enough to be found.
        KeyboardInterrupt: the user stopped it; what is done stays.
    """
    bench = Bench(source, out, workers=workers, memory=memory)
    study, settings = bench.study, bench.study.risk or Risk()
    if not study.noise_names:
        raise StudyError(f'{source}: factors: none is noise; risk needs at least one of kind "noise"')
    if not study.bounds:
        raise StudyError(f"{source}: limits: none is on a metric; risk needs an entry with metric, and max or min")
    folder = made_folder(Path(out), bench)
    margins, dimensions = Margins(bench, progress), noise_dimensions(study)
    subset = subset_simulation(margins, dimensions, settings.count, settings.repeats, settings.seed)
    points, _ = design_points(margins, subset.failed)
    sampled: Estimate | str
    try:
        sampled = importance_sampling(margins, points, settings.samples, settings.seed)
    except StudyError as error:
        sampled = str(error)
    write_table(folder / "results.parquet", together(folder, margins.rounds))
    results = read_results(folder / "results.parquet", bench.shown)
    variant, distance = margins.likeliest()
    again = recording_of(folder, variant)
    if isinstance(again, Rerun):
        again.run(workers=workers, memory=memory)
    archive = again.archive if isinstance(again, Rerun) else again[0]
    return Risked(results, study.bounds, margins.held, subset, sampled, len(points), variant, distance, archive)
