"""Ask and tell: which rows to run next, from the rows that were run.

The same study, seed and results give the same rows again, bit by bit: what is drawn in a round is drawn from the seed
and the number of rows told, linear algebra runs on one thread, and a population is led through its generations anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.design import make_design
from warpchain.study.design.rows import Cube, table_of_rows
from warpchain.study.optimize.bayes import propose
from warpchain.study.optimize.goals import Measured, goals_of
from warpchain.study.optimize.population import Population
from warpchain.study.results import Array, read_results
from warpchain.study.spec import Study
from warpchain.study.spec.objectives import Search

if TYPE_CHECKING:
    import pyarrow as pa


class Optimizer:
    """A search for a study's objectives within its limits.

    Args:
        study: the study; its design is what is asked for first.
        source: the study file, which errors name.

    Raises:
        StudyError: a study without objectives, or with factors that have no range.
    """

    def __init__(self, study: Study, source: str = "study") -> None:
        self.study = study
        self.settings = study.optimize or Search()
        self.goals = goals_of(study)
        self.cube = Cube(study)
        self._source = source
        self._told: list[pa.Table] = []
        self._points: list[Array] = []
        self._population: Population | None = None

    @property
    def told(self) -> int:
        """Rows that were told."""
        return sum(table.num_rows for table in self._told)

    def ask(self, count: int | None = None) -> list[dict[str, Any]]:
        """The next rows, values by factor: the study's design first, then what the engine proposes.

        Args:
            count: how many; None takes `optimize.batch`. Of the design, and of a population's generations, all.
        """
        if not self._told:
            names = [factor.name for factor in self.study.factors]
            return make_design(self.study, self._source).select(names).to_pylist()
        if self.settings.engine == "population":
            return self.cube.rows(self._engine().ask())
        results = read_results(_together(self._told), [f.name for f in self.study.factors], ())
        measured = self.goals.measured(results)
        points = np.vstack(self._points)
        seed = int(np.random.SeedSequence([self.settings.seed, self.told]).generate_state(1)[0])
        return self.cube.rows(propose(self.cube, measured, points, count or self.settings.batch, seed))

    def tell(self, table: pa.Table) -> None:
        """What rows gave: factors, the goals' metrics, `METRIC_se` where known, `status` where not all are ok.

        Raises:
            StudyError: a column is missing, or other rows than a population has asked for.
        """
        rows = table.to_pylist()
        results = read_results(table, [f.name for f in self.study.factors], ())
        measured = self.goals.measured(results)
        points = self._placed(rows)
        if self._told and self.settings.engine == "population":
            self._follow(rows, measured)
        self._told.append(table)
        self._points.append(points)

    def _placed(self, rows: Sequence[dict[str, Any]]) -> Array:
        return self.cube.points(rows)

    def _engine(self) -> Population:
        """The population, led through what was told."""
        if self._population is None:
            goals = self.goals
            sizes = len(goals.objectives), len(goals.bounds), self.settings.batch
            self._population = Population(np.vstack(self._points), *sizes, self.settings.seed)
            results = read_results(self._told[0], [f.name for f in self.study.factors], ())
            self._population.tell(goals.measured(results))
        return self._population

    def _follow(self, rows: Sequence[dict[str, Any]], measured: Measured) -> None:
        """Tells the population of its generation."""
        asked = table_of_rows(self.study, self.cube.rows(self._engine().ask())).to_pylist()
        names = [factor.name for factor in self.study.factors]
        if [[row[n] for n in names] for row in asked] != [[row[n] for n in names] for row in rows]:
            raise StudyError(
                "tell: other rows than the population asked for; rows of an earlier run were made by another version "
                "of pymoo"
            )
        self._engine().tell(measured)


def _together(tables: Sequence[pa.Table]) -> pa.Table:
    import pyarrow as pa

    return pa.concat_tables(tables, promote_options="permissive")
