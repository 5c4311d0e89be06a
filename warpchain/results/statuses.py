"""Statuses in which variants end, and their reasons gathered into few."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

OK, SUSPECT, DIVERGED = "ok", "suspect", "diverged"
STATUSES = (OK, SUSPECT, DIVERGED)

_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


def common_reasons(found: Iterable[tuple[str, str]]) -> list[tuple[str, str, int]]:
    """Statuses, reasons and counts of variants, most frequent first."""
    return sort_by_frequency(merge_alike_reasons((status, reason, 1) for status, reason in found))


def reason_of_count(count: int, reason: str) -> str:
    """Text of a reason, with its number of variants."""
    return f"1 variant: {reason}" if count == 1 else f"{count} variants, e.g. {reason}"


def sort_by_frequency(found: Iterable[tuple[str, str, int]]) -> list[tuple[str, str, int]]:
    """Statuses, reasons and counts, sorted by count."""
    return sorted(found, key=lambda each: -each[2])


def merge_alike_reasons(found: Iterable[tuple[str, str, int]]) -> list[tuple[str, str, int]]:
    """Statuses, reasons and counts, alike reasons merged."""
    counts: Counter[tuple[str, str]] = Counter()
    first: dict[tuple[str, str], str] = {}
    for status, reason, count in found:
        alike = status, _NUMBER.sub("#", reason)
        counts[alike] += count
        first.setdefault(alike, reason)
    return [(alike[0], reason, counts[alike]) for alike, reason in first.items()]
