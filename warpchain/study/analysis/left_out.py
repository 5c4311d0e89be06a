"""Rows that an analysis leaves out, and parts of factors' ranges that are lost with them (docs/analysis.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from warpchain.results.statuses import DIVERGED, SUSPECT, reason_of_count
from warpchain.results.units import quantity_words
from warpchain.study.analysis.pure_error import CONFIDENCE
from warpchain.study.results import Array, Results

MOST_LEFT_OUT = 0.05
"""Share of rows left out from which factors are unranked."""
MOST_EXACT_PAIRS = 250_000


@dataclass(frozen=True)
class LostPart:
    """Part of a factor's range that lost most rows."""

    factor: str
    part: str  # in words, with its unit
    lost: int  # rows there that were left out
    rows: int  # all rows there
    lost_elsewhere: int
    rows_elsewhere: int
    chance: float  # of losing rows as unevenly, for one of all factors

    @property
    def is_sure(self) -> bool:
        """Whether lost rows surely depend on the factor."""
        return self.chance < 1.0 - CONFIDENCE

    def __str__(self) -> str:
        elsewhere = f", {self.lost_elsewhere} of {self.rows_elsewhere} elsewhere" if self.rows_elsewhere else ""
        return f"{self.factor}: {self.lost} of {self.rows} {self.part}{elsewhere}"


@dataclass(frozen=True)
class LeftOut:
    """Rows left out of an analysis, and ranges lost with them."""

    results: Results

    @cached_property
    def left_out_rows(self) -> NDArray[np.bool_]:
        """(R,) whether each row ran and is left out."""
        return np.isin(self.results.status, (SUSPECT, DIVERGED))

    @cached_property
    def unbuilt_rows(self) -> NDArray[np.bool_]:
        """(R,) whether each row has no drive to run."""
        return ~(self.results.ok | self.left_out_rows)

    @cached_property
    def lost_parts(self) -> list[LostPart]:
        """Ranges of factors lost with left-out rows, surest first."""
        return _lost_parts(self.results, self.left_out_rows, self.results.ok)

    @cached_property
    def unbuilt_parts(self) -> list[LostPart]:
        """Ranges of factors lost with unbuilt rows, surest first."""
        return _lost_parts(self.results, self.unbuilt_rows, ~self.unbuilt_rows)

    def is_unranked(self, metric: str) -> bool:
        """Whether left-out rows would bias a metric's ranking of factors."""
        lost, kept = self.left_out_rows, self.results.ok
        if not lost.any() or not kept.any():
            return False
        if lost.sum() > MOST_LEFT_OUT * (lost.sum() + kept.sum()) or any(part.is_sure for part in self.lost_parts):
            return True
        values = self.results.values(metric)
        known = [values[rows & np.isfinite(values)] for rows in (lost, kept)]
        return bool(_distribution_chance(*known) * (len(self.lost_parts) + 1) < 1.0 - CONFIDENCE)

    def lines(self) -> list[str]:
        """Lines on left-out rows and lost ranges."""
        found, count = [], len(self.results.status)
        if self.left_out_rows.any():
            status, reason, often = self._reasons_of_rows(self.left_out_rows)[0]
            lost = f"{int(self.left_out_rows.sum())} of {count} variants are left out by their own results"
            rest = f"{self.rest_text()}{_lost_parts_text(self.lost_parts)}"
            found.append(f"{lost}: {reason_of_count(often, f'{status}, {reason}')}. {rest}.")
        if self.unbuilt_rows.any():
            found.append(
                f"{int(self.unbuilt_rows.sum())} of {count} variants could not be built and have no result"
                f"{_lost_parts_text(self.unbuilt_parts)}."
            )
        return found

    def rest_text(self) -> str:
        """Sentence on the number of rows not left out."""
        return f"Statistics of metrics cover only the {int(self.results.ok.sum())} variants that are left"

    def _reasons_of_rows(self, rows: NDArray[np.bool_]) -> list[tuple[str, str, int]]:
        """Statuses, reasons and numbers of left-out rows."""
        held = self.results.table.filter(rows)
        return Results(held, self.results.factors, self.results.metrics).reason_counts()


def _lost_parts_text(parts: list[LostPart]) -> str:
    """Sentence on lost parts that are beyond chance."""
    words = [str(part) for part in parts if part.is_sure]
    return f". Lost, by factor: {'; '.join(words)}" if words else ". No part of a factor's range stands out"


def _lost_parts(results: Results, lost: NDArray[np.bool_], others: NDArray[np.bool_]) -> list[LostPart]:
    """Part of each factor's range that lost most rows, surest first."""
    if not lost.any():
        return []
    words = [
        name for name in results.factors if not results.is_numeric(name) and len(set(results.text_values(name))) > 1
    ]
    numbers = results.independent_factors()
    tests = len(numbers) + len(words)
    found = [_lost_range(results, name, lost, others, tests) for name in numbers]
    found += [_lost_word(results, name, lost, others, tests) for name in words]
    return sorted(found, key=lambda part: part.chance)


def _lost_range(
    results: Results, name: str, lost: NDArray[np.bool_], others: NDArray[np.bool_], tests: int
) -> LostPart:
    """Part of a numeric factor's range that lost most rows."""
    values, unit = results.values(name), results.column_unit(name)
    known = np.isfinite(values)
    out, rest = np.sort(values[lost & known]), np.sort(values[others & known])
    levels = np.unique(np.concatenate([out, rest]))
    below = [np.searchsorted(of, levels, side="right") for of in (out, rest)]
    gap = below[0] / max(len(out), 1) - below[1] / max(len(rest), 1)  # F_out - F_in; 0 at the highest level
    at = int(np.argmax(np.abs(gap)))
    low, high = (0, at) if gap[at] > 0.0 else (min(at + 1, len(levels) - 1), len(levels) - 1)
    ends = [quantity_words(float(levels[k]), "" if unit == "-" else unit, digits=5) for k in (low, high)]
    within = [int(((of >= levels[low]) & (of <= levels[high])).sum()) for of in (out, rest)]
    part = f"at {ends[0]}" if low == high else f"from {ends[0]} to {ends[1]}"
    chance = min(1.0, tests * _distribution_chance(out, rest))
    return _lost_part(name, part, within, [len(out), len(rest)], chance)


def _lost_word(results: Results, name: str, lost: NDArray[np.bool_], others: NDArray[np.bool_], tests: int) -> LostPart:
    """Word of a factor that lost most rows."""
    from scipy.stats import chi2_contingency

    words = np.array(results.text_values(name))
    kinds = np.unique(words[lost | others])
    counts = np.array([[(words[rows] == kind).sum() for kind in kinds] for rows in (lost, others)])
    worst = int(np.argmax(counts[0] / counts.sum(axis=0)))
    chance = float(chi2_contingency(counts).pvalue) if len(kinds) > 1 and counts.any(axis=1).all() else 1.0
    totals = counts.sum(axis=1).tolist()
    return _lost_part(name, f"at {kinds[worst]}", counts[:, worst].tolist(), totals, min(1.0, tests * chance))


def _lost_part(name: str, part: str, within: list[int], totals: list[int], chance: float) -> LostPart:
    """Lost part of a factor's range from counts of rows."""
    rest = [total - inside for total, inside in zip(totals, within, strict=True)]
    return LostPart(name, part, within[0], sum(within), rest[0], sum(rest), chance)


def _distribution_chance(out: Array, rest: Array) -> float:
    """Chance that rows left out and kept differ so (Kolmogorov, Smirnov)."""
    from scipy.stats import ks_2samp

    if not len(out) or not len(rest):
        return 1.0
    return float(ks_2samp(out, rest, method="exact" if len(out) * len(rest) <= MOST_EXACT_PAIRS else "asymp").pvalue)
