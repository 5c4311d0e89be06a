"""Pareto front of objectives and limits: costs of rows, and the probability of keeping limits."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.pure_error import pure_error, row_standard_errors
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.noise_table import Noise
from warpchain.study.spec.study_tables import Bound, Objective

SENSE_SIGNS = {"min": 1.0, "max": -1.0}
FRONT_DRAWS = 400
HOPELESS_ERRORS = 4.0


def is_non_dominated(costs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(R,) whether costs (R, M) are on the Pareto front."""
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
    """Probability (R,) of rows to be on the Pareto front.

    Args:
        results: of a study with replicates.
        objectives: "min" or "max" by metric.

    Raises:
        StudyError: as of `pareto_front`.
    """
    rows, costs = _competing_costs(results, objectives)
    errors = np.zeros_like(costs)
    for k, metric in enumerate(objectives):
        with suppress(StudyError):
            errors[:, k] = pure_error(results, metric).deviation / np.sqrt(results.run_counts[rows])
    best, worst = costs - HOPELESS_ERRORS * errors, costs + HOPELESS_ERRORS * errors
    edge = worst[is_non_dominated(worst)]
    near = np.array([not ((edge < row).all(axis=1)).any() for row in best])
    random, hits = np.random.default_rng(0), np.zeros(len(rows))
    for _ in range(FRONT_DRAWS):
        drawn = costs[near] + errors[near] * random.standard_normal((int(near.sum()), costs.shape[1]))
        hits[near] += is_non_dominated(drawn)
    chances = np.zeros(results.table.num_rows)
    chances[rows] = hits / FRONT_DRAWS
    return chances


def pareto_front(results: Results, objectives: Mapping[str, str]) -> NDArray[np.intp]:
    """Indices (P,) of rows on the Pareto front.

    Args:
        results: only ok variants with all metrics compete.
        objectives: "min" or "max" by metric.

    Raises:
        StudyError: no objective, an unknown sense or column, or no variant with all.
    """
    rows, costs = _competing_costs(results, objectives)
    front = is_non_dominated(costs)
    return rows[front][np.argsort(costs[front, 0], kind="stable")]


def _competing_costs(results: Results, objectives: Mapping[str, str]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Rows (P,) that compete for the Pareto front, and costs."""
    if not objectives:
        raise StudyError("objectives: none given, a front needs at least one")
    check_senses(objectives)
    costs = np.stack([SENSE_SIGNS[sense] * results.values(metric) for metric, sense in objectives.items()], axis=1)
    rows = np.flatnonzero(results.ok & np.isfinite(costs).all(axis=1))
    if not len(rows):
        raise StudyError(f"objectives: no variant has all of {', '.join(objectives)}")
    return rows, costs[rows]


def check_senses(objectives: Mapping[str, str]) -> None:
    """Raises StudyError for objectives' senses but "min" and "max"."""
    for metric, sense in objectives.items():
        if sense not in SENSE_SIGNS:
            raise StudyError(f'objectives: {metric} = {sense!r}: allowed are "min" and "max"')


@dataclass(frozen=True)
class Goals:
    """Objectives and limits of a study.

    Attributes:
        keep: share of the noise in which limits must be kept.
    """

    objectives: tuple[Objective, ...]
    bounds: tuple[Bound, ...] = ()
    keep: float = Noise().keep

    @property
    def named_metrics(self) -> tuple[str, ...]:
        """Metrics and factors in objectives and limits, each once."""
        return tuple(dict.fromkeys([*(o.metric for o in self.objectives), *(b.metric for b in self.bounds)]))

    @property
    def objective_senses(self) -> dict[str, str]:
        """Sense, "min" or "max", by objective."""
        return {objective.metric: objective.sense for objective in self.objectives}

    @property
    def cost_signs(self) -> Array:
        """Signs (M,) that turn objectives into costs."""
        return np.array([SENSE_SIGNS[objective.sense] for objective in self.objectives])

    def goal_values(self, results: Results) -> GoalValues:
        """Values of objectives and limits in results."""
        columns, errors = {}, {}
        for name in self.named_metrics:
            if name not in results.table.column_names and not results.ok.any():
                columns[name] = np.full(len(results.status), np.nan)  # nothing ran: no metric has a column yet
            else:
                columns[name] = results.values(name)
            found = row_standard_errors(results, name)
            if found is not None:
                errors[name] = found
        whole = results.ok & np.all([np.isfinite(column) for column in columns.values()], axis=0)
        return GoalValues(self, columns, errors, whole)


@dataclass(frozen=True)
class GoalValues:
    """Values of objectives and limits in R rows of results.

    Attributes:
        columns: (R,) by metric.
        errors: (R,) standard errors by metric.
        ok: (R,) whether a row is ok and has all values.
    """

    goals: Goals
    columns: Mapping[str, Array]
    errors: Mapping[str, Array]
    ok: NDArray[np.bool_]

    @property
    def costs(self) -> Array:
        """Costs (R, M) of objectives, better if smaller."""
        return np.stack([self.columns[o.metric] for o in self.goals.objectives], axis=1) * self.goals.cost_signs

    @property
    def limit_excess(self) -> Array:
        """Excess (R, B) over limits, in the metrics' spread."""
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
    def limits_kept(self) -> NDArray[np.bool_]:
        """(R,) whether each row is ok and keeps all limits."""
        return self.ok & (self.limit_excess <= 0.0).all(axis=1)


def keeping_probability(bound: Bound, mean: Array, deviation: Array) -> Array:
    """Probability that a normally distributed metric keeps a limit."""
    from scipy.stats import norm

    spread = np.maximum(deviation, 1e-12 * np.abs(mean) + 1e-200)
    upper = 1.0 if bound.max is None else norm.cdf((bound.max - mean) / spread)
    lower = 0.0 if bound.min is None else norm.cdf((bound.min - mean) / spread)
    return np.asarray(upper - lower)


def goals_of_study(study: Study) -> Goals:
    """Goals of a study file: its objectives and limits."""
    if not study.objectives:
        raise StudyError("objectives: none; a study that is optimized needs at least one [[objectives]]")
    return Goals(study.objectives, study.bounds, (study.noise or Noise()).keep)
