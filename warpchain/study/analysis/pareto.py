"""Objectives and limits: costs of rows, the probability of keeping limits, and the Pareto front.

The front has the variants that no other beats in one objective without losing in another.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.pure_error import pure_error, standard_errors
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.noise_table import Noise
from warpchain.study.spec.study_tables import Bound, Objective

SENSES = {"min": 1.0, "max": -1.0}
DRAWS = 400
"""Fronts that chances are taken from."""
BEYOND = 4.0
"""A row that loses by this many standard errors in everything has no chance worth drawing."""


def non_dominated(costs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which rows are on the Pareto front (R,).

    Row a dominates row b if it is nowhere higher and somewhere lower; equal rows stay together.

    Args:
        costs: (R, M), all finite, all to be small.
    """
    left = np.lexsort(costs.T[::-1])  # a row is never dominated by a later one in this order
    front = np.zeros(len(costs), dtype=bool)
    while len(left):
        best = costs[left[0]]
        front[left[0]] = True
        rest = left[1:]
        keep = (costs[rest] < best).any(axis=1) | (costs[rest] == best).all(axis=1)
        left = rest[keep]
    return front


def front_chances(results: Results, objectives: Mapping[str, str]) -> NDArray[np.float64]:
    """Probability that each row of the table is on the Pareto front (R,), from the scatter between equal runs.

    Metrics are drawn about their means, normally with the pooled scatter of one run over the root of the row's runs;
    0 for rows that do not compete. A metric without scatter stays as it is.

    Args:
        results: of a study with replicates.
        objectives: see `pareto_front`.

    Raises:
        StudyError: see `pareto_front`.
    """
    rows, costs = _competing(results, objectives)
    errors = np.zeros_like(costs)
    for k, metric in enumerate(objectives):
        with suppress(StudyError):
            errors[:, k] = pure_error(results, metric).deviation / np.sqrt(results.run_counts[rows])
    best, worst = costs - BEYOND * errors, costs + BEYOND * errors
    edge = worst[non_dominated(worst)]
    near = np.array([not ((edge < row).all(axis=1)).any() for row in best])
    random, hits = np.random.default_rng(0), np.zeros(len(rows))
    for _ in range(DRAWS):
        drawn = costs[near] + errors[near] * random.standard_normal((int(near.sum()), costs.shape[1]))
        hits[near] += non_dominated(drawn)
    chances = np.zeros(results.table.num_rows)
    chances[rows] = hits / DRAWS
    return chances


def pareto_front(results: Results, objectives: Mapping[str, str]) -> NDArray[np.intp]:
    """Rows of the table on the Pareto front, by the first objective from best to worst (P,).

    Args:
        results: the study's results; only variants that are ok and have all the metrics compete.
        objectives: "min" or "max" by metric; the front of one is the best row, and those that equal it.

    Raises:
        StudyError: no objective, an unknown sense or column, or no variant that has them all.
    """
    rows, costs = _competing(results, objectives)
    front = non_dominated(costs)
    return rows[front][np.argsort(costs[front, 0], kind="stable")]


def _competing(results: Results, objectives: Mapping[str, str]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Rows that compete, and their costs, all to be small."""
    if not objectives:
        raise StudyError("objectives: none given, a front needs at least one")
    check_senses(objectives)
    costs = np.stack([SENSES[sense] * results.values(metric) for metric, sense in objectives.items()], axis=1)
    rows = np.flatnonzero(results.ok & np.isfinite(costs).all(axis=1))
    if not len(rows):
        raise StudyError(f"objectives: no variant has all of {', '.join(objectives)}")
    return rows, costs[rows]


def check_senses(objectives: Mapping[str, str]) -> None:
    """Refuses an objective that is neither "min" nor "max".

    Raises:
        StudyError: an unknown sense.
    """
    for metric, sense in objectives.items():
        if sense not in SENSES:
            raise StudyError(f'objectives: {metric} = {sense!r}: allowed are "min" and "max"')


@dataclass(frozen=True)
class Goals:
    """Objectives and limits.

    Attributes:
        objectives: what should be small or large.
        bounds: limits on metrics.
        keep: share of the noise in which they must be kept.
    """

    objectives: tuple[Objective, ...]
    bounds: tuple[Bound, ...] = ()
    keep: float = Noise().keep

    @property
    def metrics(self) -> tuple[str, ...]:
        """Metrics and factors that they name, each once."""
        return tuple(dict.fromkeys([*(o.metric for o in self.objectives), *(b.metric for b in self.bounds)]))

    @property
    def senses(self) -> dict[str, str]:
        """ "min" or "max" by objective."""
        return {objective.metric: objective.sense for objective in self.objectives}

    @property
    def signs(self) -> Array:
        """Factors that make objectives costs: 1, or -1 of one that should be large (M,)."""
        return np.array([SENSES[objective.sense] for objective in self.objectives])

    def measured(self, results: Results) -> Measured:
        """A table's values of the goals.

        Raises:
            StudyError: a metric that the table lacks.
        """
        columns, errors = {}, {}
        for name in self.metrics:
            if name not in results.table.column_names and not results.ok.any():
                columns[name] = np.full(len(results.status), np.nan)  # nothing ran: no metric has a column yet
            else:
                columns[name] = results.values(name)
            found = standard_errors(results, name)
            if found is not None:
                errors[name] = found
        whole = results.ok & np.all([np.isfinite(column) for column in columns.values()], axis=0)
        return Measured(self, columns, errors, whole)


@dataclass(frozen=True)
class Measured:
    """Goals of rows that were run.

    Attributes:
        goals: what is wanted.
        columns: (R,) by metric.
        errors: (R,) standard errors by metric, of those that have them.
        ok: (R,) rows that are ok and have all of them.
    """

    goals: Goals
    columns: Mapping[str, Array]
    errors: Mapping[str, Array]
    ok: NDArray[np.bool_]

    @property
    def costs(self) -> Array:
        """Objectives, all to be small (R, M)."""
        return np.stack([self.columns[o.metric] for o in self.goals.objectives], axis=1) * self.goals.signs

    @property
    def excess(self) -> Array:
        """Excess over each limit, in the metric's spread; not above 0 where it is kept (R, B)."""
        parts = []
        for bound in self.goals.bounds:
            values = self.columns[bound.metric]
            scale = float(np.nanstd(values[self.ok])) if self.ok.any() else 0.0
            over = np.maximum(
                values - bound.max if bound.max is not None else -np.inf,
                bound.min - values if bound.min is not None else -np.inf,
            )
            parts.append(over / (scale or 1.0))
        return np.stack(parts, axis=1) if parts else np.zeros((len(self.ok), 0))

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Rows that are ok and keep all limits, as they were measured (R,)."""
        return self.ok & (self.excess <= 0.0).all(axis=1)


def keeping(bound: Bound, mean: Array, deviation: Array) -> Array:
    """Probability that a normal metric keeps a limit."""
    from scipy.stats import norm

    spread = np.maximum(deviation, 1e-12 * np.abs(mean) + 1e-200)
    upper = 1.0 if bound.max is None else norm.cdf((bound.max - mean) / spread)
    lower = 0.0 if bound.min is None else norm.cdf((bound.min - mean) / spread)
    return np.asarray(upper - lower)


def goals_of(study: Study) -> Goals:
    """The goals of a study file.

    Raises:
        StudyError: it has no objectives.
    """
    if not study.objectives:
        raise StudyError("objectives: none; a study that is optimized needs at least one [[objectives]]")
    return Goals(study.objectives, study.bounds, (study.noise or Noise()).keep)
