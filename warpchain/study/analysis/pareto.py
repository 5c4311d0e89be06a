"""The Pareto front: variants that no other beats in one chosen metric without losing in another."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

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


DRAWS = 400
"""Fronts that chances are taken from."""
BEYOND = 4.0
"""A row that loses by this many standard errors in everything has no chance worth drawing."""


def front_chances(results: Results, objectives: Mapping[str, str], seed: int = 0) -> NDArray[np.float64]:
    """How probable it is that each row of the table is on the Pareto front (R,), by what equal runs scatter.

    Metrics are drawn about their means, normally with the pooled scatter of one run over the root of the row's runs;
    0 for rows that do not compete. A metric without scatter stays as it is.

    Args:
        results: of a study with replicates.
        objectives: see `pareto_front`.
        seed: of the draws.

    Raises:
        StudyError: see `pareto_front`.
    """
    from warpchain.study.analysis.pure_error import pure_error

    rows = np.sort(_competing(results, objectives)[0])
    costs = _costs(results, objectives)[rows]
    errors = np.zeros_like(costs)
    for k, metric in enumerate(objectives):
        with suppress(StudyError):
            errors[:, k] = pure_error(results, metric).deviation / np.sqrt(results.counts[rows])
    best, worst = costs - BEYOND * errors, costs + BEYOND * errors
    edge = worst[non_dominated(worst)]
    near = np.array([not ((edge < row).all(axis=1)).any() for row in best])
    random, hits = np.random.default_rng(seed), np.zeros(len(rows))
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
        objectives: "min" or "max" by metric, at least two.

    Raises:
        StudyError: fewer than two objectives, an unknown sense or column, or no variant that has them all.
    """
    rows, costs = _competing(results, objectives)
    front = rows[non_dominated(costs)]
    order = _costs(results, objectives)[front, 0]
    return front[np.argsort(order, kind="stable")]


def _competing(results: Results, objectives: Mapping[str, str]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Rows that compete, and their costs, all to be small."""
    if len(objectives) < 2:
        raise StudyError(f"objectives: {len(objectives)} given, a front needs at least 2")
    for metric, sense in objectives.items():
        if sense not in SENSES:
            raise StudyError(f'objectives: {metric} = {sense!r}: allowed are "min" and "max"')
    costs = _costs(results, objectives)
    rows = np.flatnonzero(results.ok & np.isfinite(costs).all(axis=1))
    if not len(rows):
        raise StudyError(f"objectives: no variant has all of {', '.join(objectives)}")
    return rows, costs[rows]


def _costs(results: Results, objectives: Mapping[str, str]) -> NDArray[np.float64]:
    """Costs of all rows (R, M)."""
    return np.stack([SENSES[sense] * results.values(metric) for metric, sense in objectives.items()], axis=1)
