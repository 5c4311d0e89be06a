"""Analysis that a few wild values do not upset: ranks, logarithms, medians.

`transformed` gives results in which a metric is its rank or logarithm, for any of the other analyses. The interval of
a median needs no distribution (Conover 1999, 3.2): of n sorted values, it is between the k-th from either end, k the
most for which a binomial of n and 1/2 has at most 2.5 % below k.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.effects import _groups
from warpchain.study.results import Array, Results

TRANSFORMS = ("rank", "log")


def transformed(results: Results, metric: str, how: str) -> Results:
    """Results in which a metric is transformed, under its own name, without a unit.

    Args:
        how: "rank" (of the variants that are ok, 1 the lowest, ties share their mean; empty elsewhere) or "log".

    Raises:
        StudyError: another word, or values that have no logarithm.
    """
    import pyarrow as pa
    from scipy.stats import rankdata

    values, rows = results.values(metric), results.rows_for(metric)
    found = np.full(len(values), np.nan)
    if how == "rank":
        found[rows] = rankdata(values[rows])
    elif how == "log":
        if not (values[rows] > 0.0).all():
            raise StudyError(f"metric {metric!r}: has values that are not above 0, of which there is no logarithm")
        found[rows] = np.log(values[rows])
    else:
        raise StudyError(f"transform {how!r}: allowed are {', '.join(TRANSFORMS)}")
    at = results.table.column_names.index(metric)
    held = dict(results.table.schema.field(metric).metadata or {}) | {b"unit": b"1"}
    column = pa.array(found, pa.float64(), mask=np.isnan(found))
    return replace(results, table=results.table.set_column(at, pa.field(metric, pa.float64(), metadata=held), column))


@dataclass(frozen=True)
class MedianEffect:
    """The median of a metric in each group of a factor's values.

    Attributes:
        factor: name of the factor.
        labels: what each group is called (G,).
        centers: mean factor value of each group (G,); counts from 0 where the factor holds words.
        medians: (G,)
        low, high: (G,) the 95 % interval of each median; infinite where a group has fewer than 6 variants.
        counts: (G,)
    """

    factor: str
    labels: tuple[str, ...]
    centers: Array
    medians: Array
    low: Array
    high: Array
    counts: NDArray[np.int64]

    @property
    def span(self) -> float:
        """Largest less smallest median, in the metric's unit."""
        return float(np.ptp(self.medians))


def median_interval(values: Array) -> tuple[float, float]:
    """The 95 % interval of a median; infinite for fewer than 6 values."""
    from scipy.stats import binom

    n = len(values)
    k = int(binom.ppf(0.025, n, 0.5)) if n else 0
    if k < 1 or binom.cdf(k - 1, n, 0.5) > 0.025:
        return -np.inf, np.inf
    ordered = np.sort(values)
    return float(ordered[k - 1]), float(ordered[n - k])


def median_effects(results: Results, metric: str) -> list[MedianEffect]:
    """Medians of a metric over the groups of each factor (as `main_effects` makes them), the largest span first.

    Raises:
        StudyError: fewer than two usable variants, or an unknown column.
    """
    y, tied = results.values(metric), results.ties()
    if results.rows_for(metric).sum() < 2:
        raise StudyError(f"metric {metric!r}: fewer than 2 variants have a value")
    effects = []
    for factor in (name for name in results.factors if name not in tied):
        rows = results.rows_for(metric, [factor])
        group, labels, centers = _groups(results, factor, rows)
        if len(labels) < 2:
            continue
        parts = [y[rows][group == g] for g in range(len(labels))]
        ends = np.array([median_interval(part) for part in parts])
        medians = np.array([np.median(part) for part in parts])
        counts = np.array([len(part) for part in parts])
        effects.append(MedianEffect(factor, labels, centers, medians, ends[:, 0], ends[:, 1], counts))
    return sorted(effects, key=lambda effect: -effect.span)
