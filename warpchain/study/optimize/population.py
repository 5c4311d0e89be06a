"""A population for many rows at once: NSGA-II (Deb et al. 2002) by pymoo, with limits by its constraint dominance.

A generation is what a GPU takes at once. Noise is not modeled: replicates lessen it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.optimize.goals import Measured
from warpchain.study.results import Array

LOST = 1e3
"""Excess of a row that gave no metrics, in spreads: worse than any that did."""


class Population:
    """NSGA-II, asked and told generation by generation.

    Args:
        first: (N, D) the first generation.
        objectives, limits: how many there are.
        size: rows of a generation.
        seed: of everything that is drawn.

    Raises:
        StudyError: pymoo is not installed.
    """

    def __init__(self, first: Array, objectives: int, limits: int, size: int, seed: int) -> None:
        try:
            from pymoo.algorithms.moo.nsga2 import NSGA2
            from pymoo.core.problem import Problem
        except ImportError:
            raise StudyError(
                "optimize.engine = \"population\" needs pymoo: pip install 'warpchain[optimize]'"
            ) from None
        problem = Problem(n_var=first.shape[1], n_obj=objectives, n_ieq_constr=limits + 1, xl=0.0, xu=1.0 - 1e-12)
        self._algorithm: Any = NSGA2(pop_size=size, sampling=first)
        self._algorithm.setup(problem, termination=("n_gen", 10**9), seed=seed, verbose=False)
        self._asked: Any = None

    def ask(self) -> Array:
        """The next generation (N, D)."""
        if self._asked is None:
            self._asked = self._algorithm.ask()
        return np.asarray(self._asked.get("X"), dtype=float)

    def tell(self, measured: Measured) -> None:
        """What the generation that was asked for last gave."""
        self.ask()
        ok = measured.ok
        costs = np.where(ok[:, None], measured.costs, LOST)
        excess = np.where(ok[:, None], measured.excess, LOST)
        lost = np.where(ok, 0.0, LOST)[:, None]
        self._asked.set("F", costs)
        self._asked.set("G", np.hstack([excess, lost]))
        self._asked.set("evaluated", [{"F", "G", "H"} for _ in range(len(costs))])
        for individual in self._asked:
            individual.evaluated.update({"F", "G", "H"})
        self._algorithm.tell(infills=self._asked)
        self._asked = None
