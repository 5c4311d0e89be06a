"""How far a row's metric scatters by chance, as far as a study's table tells it.

Either a metric has a column of its standard error, `METRIC_se`, of each row, between equal runs or from the batches of
one run's window; or rows of equal factors stand several times (`study.analysis.pure_error`).
"""

from __future__ import annotations

import numpy as np

from warpchain.errors import StudyError
from warpchain.results.replicates import ERROR
from warpchain.study.analysis.pure_error import pure_error
from warpchain.study.results import Array, Results


def standard_errors(results: Results, metric: str) -> Array | None:
    """Standard error of each row's value of a metric (R,), NaN where none is told; None without such a column."""
    name = metric + ERROR
    return results.values(name) if name in results.table.column_names and results.numeric(name) else None


def repeats(results: Results) -> bool:
    """Whether rows are means of several runs, or some rows have equal factors."""
    if results.replicated:
        return True
    group = np.zeros(len(results.status), dtype=np.intp)
    for name in results.factors:
        column = results.values(name) if results.numeric(name) else np.array(results.labels(name))
        values, place = np.unique(column, return_inverse=True)
        held, group = np.unique(group * len(values) + place, return_inverse=True)
        if len(held) == len(group):
            return False
    return True


def scatter_share(results: Results, metric: str) -> float | None:
    """Part of the variance of the rows' values that is scatter between equal runs; None where nothing tells.

    Of a mean of n runs this is the n-th part of the variance of one run.
    """
    if not repeats(results):
        return None
    try:
        error = pure_error(results, metric)
    except StudyError:
        return None
    rows = results.rows_for(metric)
    spread = float(results.values(metric)[rows].var(ddof=1))
    chance = error.deviation**2 * float(np.mean(1.0 / results.counts[rows]))
    return min(1.0, chance / spread) if spread > 0.0 else 0.0
