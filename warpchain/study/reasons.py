"""Why variants are not ok, in words; reasons that differ in their numbers only count as one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from warpchain.errors import WarpchainError

_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")
_VARIANT = re.compile(r"^variant \d+: ")


def reason_of(error: WarpchainError) -> str:
    """An error in one line, without the number that the variant had among those simulated with it."""
    return "; ".join(_VARIANT.sub("", str(error)).splitlines())


def common_reasons(found: Iterable[tuple[str, str]]) -> list[tuple[str, str, int]]:
    """(status, reason, how many), the most frequent first, from the (status, reason) of each variant.

    Reasons that differ in their numbers only count as one, named by its first.
    """
    counts: Counter[tuple[str, str]] = Counter()
    first: dict[tuple[str, str], str] = {}
    for status, reason in found:
        alike = status, _NUMBER.sub("#", reason)
        counts[alike] += 1
        first.setdefault(alike, reason)
    return [(alike[0], first[alike], count) for alike, count in counts.most_common()]
