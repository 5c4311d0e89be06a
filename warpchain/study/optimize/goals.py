"""What is wanted of a table's rows: costs to be small, limits to be kept, and how sure both are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.pareto import SENSES
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.objectives import Bound, Objective
from warpchain.study.surrogate.noise import standard_errors


@dataclass(frozen=True)
class Goals:
    """Objectives and limits.

    Attributes:
        objectives: what should be small or large.
        bounds: limits on metrics.
    """

    objectives: tuple[Objective, ...]
    bounds: tuple[Bound, ...] = ()

    @property
    def metrics(self) -> tuple[str, ...]:
        """What they name, each once."""
        return tuple(dict.fromkeys([*(o.metric for o in self.objectives), *(b.metric for b in self.bounds)]))

    @property
    def senses(self) -> dict[str, str]:
        """ "min" or "max" by objective."""
        return {objective.metric: objective.sense for objective in self.objectives}

    @property
    def signs(self) -> Array:
        """What makes an objective a cost: 1, or -1 of one that should be large (M,)."""
        return np.array([SENSES[objective.sense] for objective in self.objectives])

    def measured(self, results: Results) -> Measured:
        """What a table says of the goals.

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
        """How far each limit is overstepped, in the metric's spread; not above 0 where it is kept (R, B)."""
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
    return Goals(study.objectives, study.bounds)
