"""Rows that an analysis is without, and the parts of the factors' ranges that are lost with them.

A row that is suspect or diverged is left out by its own result. The rows that are left are then no fair sample of what
was varied: shares of variance, indices and means of groups hold for them alone. Factors are not ranked by a metric
where more than `FEW` of the rows that ran are left out, or where the loss goes along with a factor or with the metric
itself. Whether it does is tested by the two-sample statistic of Kolmogorov and Smirnov, with F the distributions of a
factor's values among rows that are left out and rows that are not,

    D = max |F_out(x) - F_in(x)|,                                                                             (a)

and of words by chi-square of their counts; chances are multiplied by the number of tests (Bonferroni). The part of a
range that is lost lies on the side of the x of (a) where rows were left out more often.

An infeasible row has no drive, and so no result that could select it: factors are ranked for the drives that exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from warpchain.results.statuses import DIVERGED, SUSPECT, reason_words
from warpchain.results.units import quantity
from warpchain.study.analysis.pure_error import CONFIDENCE
from warpchain.study.results import Array, Results

FEW = 0.05
"""Share of the rows that ran from which on factors are not ranked without those left out."""
EXACT = 250_000
"""Most pairs of rows of which the chance of (a) is found exactly."""


@dataclass(frozen=True)
class LostPart:
    """The part of a factor's range, or the word, at which rows were left out most.

    Attributes:
        factor: name of the factor.
        part: in words, with its unit.
        lost, rows: number of rows there that were left out, and of all rows there.
        lost_elsewhere, rows_elsewhere: the same for the rest of the range.
        chance: probability that chance alone loses rows as unevenly, for one of all factors.
    """

    factor: str
    part: str
    lost: int
    rows: int
    lost_elsewhere: int
    rows_elsewhere: int
    chance: float

    @property
    def sure(self) -> bool:
        """Whether the loss goes along with the factor beyond chance."""
        return self.chance < 1.0 - CONFIDENCE

    def __str__(self) -> str:
        elsewhere = f", {self.lost_elsewhere} of {self.rows_elsewhere} elsewhere" if self.rows_elsewhere else ""
        return f"{self.factor}: {self.lost} of {self.rows} {self.part}{elsewhere}"


@dataclass(frozen=True)
class LeftOut:
    """Rows of a study that its analysis is without.

    Attributes:
        results: of the study.
    """

    results: Results

    @cached_property
    def by_result(self) -> NDArray[np.bool_]:
        """Rows that ran and are left out by their own results (R,)."""
        return np.isin(self.results.status, (SUSPECT, DIVERGED))

    @cached_property
    def unbuilt(self) -> NDArray[np.bool_]:
        """Rows whose drive does not exist (R,)."""
        return ~(self.results.ok | self.by_result)

    @cached_property
    def parts(self) -> list[LostPart]:
        """Parts of the factors' ranges that rows which ran were left out of, the surest first."""
        return _lost_parts(self.results, self.by_result, self.results.ok)

    @cached_property
    def unbuilt_parts(self) -> list[LostPart]:
        """Parts of the factors' ranges at which drives do not exist, the surest first."""
        return _lost_parts(self.results, self.unbuilt, ~self.unbuilt)

    def selects(self, metric: str) -> bool:
        """Whether the rows that are left are selected by their results, so that a metric ranks no factor."""
        lost, kept = self.by_result, self.results.ok
        if not lost.any() or not kept.any():
            return False
        if lost.sum() > FEW * (lost.sum() + kept.sum()) or any(part.sure for part in self.parts):
            return True
        values = self.results.values(metric)
        known = [values[rows & np.isfinite(values)] for rows in (lost, kept)]
        return bool(_chance(*known) * (len(self.parts) + 1) < 1.0 - CONFIDENCE)

    def lines(self) -> list[str]:
        """Number of rows left out, reason, and lost parts of the factors' ranges, in words; none where none is lost."""
        found, count = [], len(self.results.status)
        if self.by_result.any():
            status, reason, often = self._reasons(self.by_result)[0]
            lost = f"{int(self.by_result.sum())} of {count} variants are left out by their own results"
            rest = f"{self.rest()}{_parts_words(self.parts)}"
            found.append(f"{lost}: {reason_words(often, f'{status}, {reason}')}. {rest}.")
        if self.unbuilt.any():
            found.append(
                f"{int(self.unbuilt.sum())} of {count} variants could not be built and have no result"
                f"{_parts_words(self.unbuilt_parts)}."
            )
        return found

    def rest(self) -> str:
        """The rows that all figures of the metrics are of, in words."""
        return f"Statistics of metrics cover only the {int(self.results.ok.sum())} variants that are left"

    def _reasons(self, rows: NDArray[np.bool_]) -> list[tuple[str, str, int]]:
        held = self.results.table.filter(rows)
        return Results(held, self.results.factors, self.results.metrics).reason_counts()


def _parts_words(parts: list[LostPart]) -> str:
    words = [str(part) for part in parts if part.sure]
    return f". Lost, by factor: {'; '.join(words)}" if words else ". No part of a factor's range stands out"


def _lost_parts(results: Results, lost: NDArray[np.bool_], others: NDArray[np.bool_]) -> list[LostPart]:
    """The part of each factor's range at which rows were left out most, the surest first."""
    if not lost.any():
        return []
    words = [
        name for name in results.factors if not results.is_numeric(name) and len(set(results.text_values(name))) > 1
    ]
    numbers = results.independent_factors()
    tests = len(numbers) + len(words)
    found = [_of_numbers(results, name, lost, others, tests) for name in numbers]
    found += [_of_words(results, name, lost, others, tests) for name in words]
    return sorted(found, key=lambda part: part.chance)


def _of_numbers(
    results: Results, name: str, lost: NDArray[np.bool_], others: NDArray[np.bool_], tests: int
) -> LostPart:
    values, unit = results.values(name), results.column_unit(name)
    known = np.isfinite(values)
    out, rest = np.sort(values[lost & known]), np.sort(values[others & known])
    levels = np.unique(np.concatenate([out, rest]))
    below = [np.searchsorted(of, levels, side="right") for of in (out, rest)]
    gap = below[0] / max(len(out), 1) - below[1] / max(len(rest), 1)  # of (a); 0 at the highest level
    at = int(np.argmax(np.abs(gap)))
    low, high = (0, at) if gap[at] > 0.0 else (min(at + 1, len(levels) - 1), len(levels) - 1)
    ends = [quantity(float(levels[k]), "" if unit == "-" else unit, digits=5) for k in (low, high)]
    within = [int(((of >= levels[low]) & (of <= levels[high])).sum()) for of in (out, rest)]
    part = f"at {ends[0]}" if low == high else f"from {ends[0]} to {ends[1]}"
    chance = min(1.0, tests * _chance(out, rest))
    return _part(name, part, within, [len(out), len(rest)], chance)


def _of_words(results: Results, name: str, lost: NDArray[np.bool_], others: NDArray[np.bool_], tests: int) -> LostPart:
    from scipy.stats import chi2_contingency

    words = np.array(results.text_values(name))
    kinds = np.unique(words[lost | others])
    counts = np.array([[(words[rows] == kind).sum() for kind in kinds] for rows in (lost, others)])
    worst = int(np.argmax(counts[0] / counts.sum(axis=0)))
    chance = float(chi2_contingency(counts).pvalue) if len(kinds) > 1 and counts.any(axis=1).all() else 1.0
    totals = counts.sum(axis=1).tolist()
    return _part(name, f"at {kinds[worst]}", counts[:, worst].tolist(), totals, min(1.0, tests * chance))


def _part(name: str, part: str, within: list[int], totals: list[int], chance: float) -> LostPart:
    """A part from the numbers of rows in it and in all: left out, and not."""
    rest = [total - inside for total, inside in zip(totals, within, strict=True)]
    return LostPart(name, part, within[0], sum(within), rest[0], sum(rest), chance)


def _chance(out: Array, rest: Array) -> float:
    """Probability that two samples of one distribution lie as far apart as these, by (a)."""
    from scipy.stats import ks_2samp

    if not len(out) or not len(rest):
        return 1.0
    return float(ks_2samp(out, rest, method="exact" if len(out) * len(rest) <= EXACT else "asymp").pvalue)
