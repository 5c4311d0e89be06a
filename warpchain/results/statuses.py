"""The words for how a variant ended, and the reasons of many gathered into few."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

OK, SUSPECT, DIVERGED = "ok", "suspect", "diverged"
STATUSES = (OK, SUSPECT, DIVERGED)
"""Statuses of a variant, from good to bad."""

_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


def common_reasons(found: Iterable[tuple[str, str]]) -> list[tuple[str, str, int]]:
    """(status, reason, how many), the most frequent first, from the (status, reason) of each variant.

    Reasons that differ in their numbers only count as one, named by its first.
    """
    return by_frequency(alike_reasons((status, reason, 1) for status, reason in found))


def reason_words(count: int, reason: str) -> str:
    """A count of variants and the reason of the first: those of others may have other numbers."""
    return f"1 variant: {reason}" if count == 1 else f"{count} variants, e.g. {reason}"


def by_frequency(found: Iterable[tuple[str, str, int]]) -> list[tuple[str, str, int]]:
    """(status, reason, how many), the most frequent first, and of equally frequent ones the earlier."""
    return sorted(found, key=lambda each: -each[2])


def alike_reasons(found: Iterable[tuple[str, str, int]]) -> list[tuple[str, str, int]]:
    """(status, reason, how many) in the order of the first of each, those that differ in their numbers only as one."""
    counts: Counter[tuple[str, str]] = Counter()
    first: dict[tuple[str, str], str] = {}
    for status, reason, count in found:
        alike = status, _NUMBER.sub("#", reason)
        counts[alike] += count
        first.setdefault(alike, reason)
    return [(alike[0], reason, counts[alike]) for alike, reason in first.items()]
