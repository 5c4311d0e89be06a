"""Interactions of factors: the part of a metric that the product of two takes up beyond each alone.

Of R rows, with q products of two factors' values, p terms in all, squares S about the mean, residual squares S_0 and
S_1 (Montgomery 2017, 10.4),

    E = (S_0 - S_1) / S,      F = (S_0 - S_1) / q / (S_1 / (R - p)).                                          (a)

Chances are multiplied by the number of pairs (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from warpchain.study.analysis.pure_error import CONFIDENCE
from warpchain.study.results import Array, Results


@dataclass(frozen=True)
class Interaction:
    """Interaction of two factors in a metric."""

    first: str
    second: str
    explained: float  # part of the metric's variance [-], E of (a)
    chance: float  # probability of so large a part in one of all pairs

    @property
    def is_sure(self) -> bool:
        """Whether the interaction is beyond chance."""
        return self.chance < 1.0 - CONFIDENCE

    def __str__(self) -> str:
        return f"{self.first} and {self.second} act together: {100.0 * self.explained:.0f} % of the variance"


def interactions(results: Results, metric: str) -> list[Interaction]:
    """Interactions of all pairs of factors, the largest first.

    Raises:
        StudyError: an unknown metric, or rows of a search.
    """
    from scipy.special import fdtrc

    results.check_sampled()
    tied = results.factor_ties()
    factors = [name for name in results.factors if name not in tied]
    rows = results.usable_rows(metric, factors)
    alone = {name: terms for name in factors if (terms := _interaction_terms(results, name, rows)).shape[1]}
    y = results.values(metric)[rows]
    base = np.hstack([np.ones((len(y), 1)), *(_terms_with_square(terms) for terms in alone.values())])
    if len(y) <= base.shape[1] or not np.ptp(y) > 0.0:
        return []
    basis = _orthonormal_basis(base)
    left = y - basis @ (basis.T @ y)
    whole, before = float(((y - y.mean()) ** 2).sum()), float(left @ left)
    pairs = list(combinations(alone, 2))
    found = []
    for first, second in pairs:
        products = (alone[first][:, :, None] * alone[second][:, None, :]).reshape(len(y), -1)
        more = _orthonormal_basis(products - basis @ (basis.T @ products), np.linalg.norm(products, axis=0).max())
        count, freedom = more.shape[1], len(y) - basis.shape[1] - more.shape[1]
        if not count or freedom < 1:
            continue
        taken = float(((more.T @ left) ** 2).sum())
        ratio = taken / count / (before - taken) * freedom if before > taken else float("inf")
        chance = min(1.0, len(pairs) * float(fdtrc(count, freedom, ratio)))
        found.append(Interaction(first, second, taken / whole, chance))
    return sorted(found, key=lambda one: -one.explained)


def _interaction_terms(results: Results, name: str, rows: NDArray[np.bool_]) -> Array:
    """Standardized terms (R, p) of a factor's values, or words."""
    if results.is_numeric(name):
        of = results.values(name)[rows][:, None]
    else:
        words = np.array(results.text_values(name))[rows]
        of = (words[:, None] == np.unique(words)[1:]).astype(float)
    of = of - of.mean(axis=0)
    deviation = of.std(axis=0)
    varies = deviation > 1e-12 * np.abs(of).max(axis=0, initial=0.0)
    return np.asarray(of[:, varies] / deviation[varies])


def _terms_with_square(terms: Array) -> Array:
    """Terms (R, p) of a factor, a single one also squared."""
    return np.hstack([terms, terms**2]) if terms.shape[1] == 1 else terms


def _orthonormal_basis(terms: Array, size: float | None = None) -> Array:
    """Orthonormal columns (R, p) that span a factor's terms."""
    columns, values, _ = np.linalg.svd(terms, full_matrices=False)
    least = 1e-9 * (size if size is not None else values.max(initial=0.0))
    return np.asarray(columns[:, values > least])
