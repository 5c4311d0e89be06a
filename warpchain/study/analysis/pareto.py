"""The Pareto front: variants that no other beats in one chosen metric without losing in another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.results import Results

SENSES = {"min": 1.0, "max": -1.0}


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


def pareto_front(results: Results, objectives: Mapping[str, str]) -> NDArray[np.intp]:
    """Rows of the table on the Pareto front, by the first objective from best to worst (P,).

    Args:
        results: the study's results; only variants that are ok and have all the metrics compete.
        objectives: "min" or "max" by metric, at least two.

    Raises:
        StudyError: fewer than two objectives, an unknown sense or column, or no variant that has them all.
    """
    if len(objectives) < 2:
        raise StudyError(f"objectives: {len(objectives)} given, a front needs at least 2")
    for metric, sense in objectives.items():
        if sense not in SENSES:
            raise StudyError(f'objectives: {metric} = {sense!r}: allowed are "min" and "max"')
    costs = np.stack([SENSES[sense] * results.values(metric) for metric, sense in objectives.items()], axis=1)
    rows = np.flatnonzero(results.ok & np.isfinite(costs).all(axis=1))
    if not len(rows):
        raise StudyError(f"objectives: no variant has all of {', '.join(objectives)}")
    front = rows[non_dominated(costs[rows])]
    return front[np.argsort(costs[front, 0], kind="stable")]
