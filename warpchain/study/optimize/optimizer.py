"""Optimizer: search for a study's next rows by ask and observe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.argument_checks import Count, check_arguments
from warpchain.errors import StudyError
from warpchain.extras import require_extra
from warpchain.study.analysis.over_noise import designs_over_noise, goals_of_designs
from warpchain.study.analysis.pareto import GoalValues, goals_of_study
from warpchain.study.design import make_design
from warpchain.study.design.design_table import design_table_of_rows
from warpchain.study.design.factor_values import DesignCube
from warpchain.study.design.noise_rows import crossed_rows, noise_rows
from warpchain.study.optimize.bayesian_search import propose_points
from warpchain.study.results import Array, read_results
from warpchain.study.spec import Study
from warpchain.study.spec.study_tables import Search

if TYPE_CHECKING:
    import pyarrow as pa

LOST_EXCESS = 1e3
"""Cost and excess of a row without metrics."""


class Population:
    """Population of NSGA-II, generation by generation.

    Args:
        first: (N, D) the first generation.
        objectives, limits: number of each.
    """

    def __init__(self, first: Array, objectives: int, limits: int, size: int, seed: int) -> None:
        require_extra("optimize", "optimize", StudyError)
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem

        problem = Problem(n_var=first.shape[1], n_obj=objectives, n_ieq_constr=limits + 1, xl=0.0, xu=1.0 - 1e-12)
        self._algorithm: Any = NSGA2(pop_size=size, sampling=first)
        self._algorithm.setup(problem, termination=("n_gen", 10**9), seed=seed, verbose=False)
        self._asked: Any = None

    def next_generation(self) -> Array:
        """Unit-cube points (N, D) of NSGA-II's next generation."""
        if self._asked is None:
            self._asked = self._algorithm.ask()
        return np.asarray(self._asked.get("X"), dtype=float)

    def observe_generation(self, measured: GoalValues) -> None:
        """Gives NSGA-II the goal values of its last generation."""
        self.next_generation()
        ok = measured.ok
        costs = np.where(ok[:, None], measured.costs, LOST_EXCESS)
        excess = np.where(ok[:, None], measured.limit_excess, LOST_EXCESS)
        lost = np.where(ok, 0.0, LOST_EXCESS)[:, None]
        self._asked.set("F", costs)
        self._asked.set("G", np.hstack([excess, lost]))
        self._asked.set("evaluated", [{"F", "G", "H"} for _ in range(len(costs))])
        for individual in self._asked:
            individual.evaluated.update({"F", "G", "H"})
        self._algorithm.tell(infills=self._asked)
        self._asked = None


class Optimizer:
    """Optimizer of a study's objectives, by ask and observe.

    Args:
        study: its design is asked for first.
        source: the study file, which errors name.

    Raises:
        StudyError: no objectives, or factors without a range.
    """

    def __init__(self, study: Study, source: str = "study") -> None:
        self.study = study
        self.settings = study.optimize or Search()
        self.goals = goals_of_study(study)
        self._designs = study.design_study
        self._noise = noise_rows(study)
        self.cube = DesignCube(self._designs)
        self._source = source
        self._factors = [factor.name for factor in self._designs.factors]
        self._over = goals_of_designs(self.goals, self._factors) if study.noise_names else self.goals
        self._tables: list[pa.Table] = []
        self._points: list[Array] = []
        self._population: Population | None = None

    @property
    def observed_count(self) -> int:
        """Number of designs whose results the optimizer knows."""
        return sum(table.num_rows for table in self._tables)

    @check_arguments(StudyError)
    def ask(self, count: Count | None = None) -> list[dict[str, Any]]:
        """Next rows to run, values by factor.

        Args:
            count: designs; None takes `optimize.batch`. The design and a population's generations come whole.
        """
        if not self._tables:
            return make_design(self.study, self._source).select([f.name for f in self.study.factors]).to_pylist()
        return crossed_rows(self._proposed_rows(count), self._noise)

    def _proposed_rows(self, count: int | None) -> list[dict[str, Any]]:
        """Rows that the search engine proposes next."""
        if self.settings.engine == "population":
            return self.cube.rows_of_points(self._current_population().next_generation())
        import pyarrow as pa

        measured = self._goal_values(pa.concat_tables(self._tables, promote_options="permissive"))
        points = np.vstack(self._points)
        seed = int(np.random.SeedSequence([self.settings.seed, self.observed_count]).generate_state(1)[0])
        return self.cube.rows_of_points(propose_points(self.cube, measured, points, count or self.settings.batch, seed))

    @check_arguments(StudyError)
    def observe(self, table: pa.Table) -> None:
        """Adds results of rows to the optimizer.

        Raises:
            StudyError: a column is missing, or other rows than a population has asked for.
        """
        if self.study.noise_names:
            factors = [factor.name for factor in self.study.factors]
            table = designs_over_noise(read_results(table, factors, ()), self.goals, self.study.noise_names)[0].table
        rows, measured = table.to_pylist(), self._goal_values(table)
        points = self.cube.points_of_rows(rows)
        if self._tables and self.settings.engine == "population":
            self._observe_population(rows, measured)
        self._tables.append(table)
        self._points.append(points)

    def _goal_values(self, table: pa.Table) -> GoalValues:
        """Goal values of a results table."""
        return self._over.goal_values(read_results(table, self._factors, ()))

    def _current_population(self) -> Population:
        """Population that has observed all results so far."""
        if self._population is None:
            sizes = len(self._over.objectives), len(self._over.bounds), self.settings.batch
            self._population = Population(np.vstack(self._points), *sizes, self.settings.seed)
            self._population.observe_generation(self._goal_values(self._tables[0]))
        return self._population

    def _observe_population(self, rows: Sequence[dict[str, Any]], measured: GoalValues) -> None:
        """Gives the population its results; raises for other rows."""
        asked = design_table_of_rows(
            self._designs, self.cube.rows_of_points(self._current_population().next_generation())
        ).to_pylist()
        if [[row[n] for n in self._factors] for row in asked] != [[row[n] for n in self._factors] for row in rows]:
            raise StudyError(
                "observe: other rows than the population asked for; rows of an earlier run are of another version "
                "of pymoo"
            )
        self._current_population().observe_generation(measured)
