"""Scatter between runs that are equal but for chance, as far as a study's table tells it.

Either a metric has a column of its standard error, `METRIC_se`, of each row; or rows of the design repeat, and the
variance within them, pooled, is that of a single run (the pure error of Box and Draper 1987, 3.4):

    s^2 = sum_g sum_i (y_gi - mean_g)^2 / sum_g (n_g - 1).                                                  (a)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.study.results import Array, Results

ERROR = "{}_se"
"""Name of the column of a metric's standard error."""


@dataclass(frozen=True)
class PureError:
    """How much a row's metric scatters by chance.

    Attributes:
        deviation: standard deviation of a row's value, in the metric's unit.
        share: part of the variance of all rows that this is [-].
        freedom: degrees of freedom that it stands on.
        source: where it comes from, in words.
    """

    deviation: float
    share: float
    freedom: int
    source: str


def standard_errors(results: Results, metric: str) -> Array | None:
    """Standard error of each row's value of a metric (R,), NaN where none is told; None without such a column."""
    name = ERROR.format(metric)
    return results.values(name) if name in results.table.column_names and results.numeric(name) else None


def _groups(results: Results, rows: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Number of the combination of factors that each chosen row has."""
    group = np.zeros(int(rows.sum()), dtype=np.intp)
    for name in results.factors:
        column = results.values(name) if results.numeric(name) else np.array(results.labels(name))
        values, place = np.unique(column[rows], return_inverse=True)
        _, group = np.unique(group * len(values) + place, return_inverse=True)
    return group


def pure_error(results: Results, metric: str) -> PureError | None:
    """Scatter of a metric between equal runs; None where the table tells nothing of it."""
    rows = results.rows_for(metric)
    y = results.values(metric)[rows]
    if len(y) < 2:
        return None
    spread = float(y.var(ddof=1))
    errors = standard_errors(results, metric)
    if errors is not None and np.isfinite(errors[rows]).any():
        known = errors[rows][np.isfinite(errors[rows])]
        variance, freedom, source = float(np.mean(known**2)), len(known), "standard errors of the rows"
    else:
        group = _groups(results, rows)
        counts = np.bincount(group)
        freedom = int((counts - 1).sum())
        if not freedom:
            return None
        means = np.bincount(group, y) / counts
        variance, source = float(((y - means[group]) ** 2).sum()) / freedom, "rows that repeat"
    share = min(1.0, variance / spread) if spread > 0.0 else 0.0
    return PureError(float(np.sqrt(variance)), share, freedom, source)
