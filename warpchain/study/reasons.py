"""How rows ended, and why one gives no variant, in words; why variants are not ok says `results.judgement`."""

from __future__ import annotations

import re

from warpchain.errors import WarpchainError
from warpchain.results.reasons import STATUSES as JUDGED

OUTCOME = ("status", "reason")
"""Columns of a study's table: how a variant ended, and why where that is not "ok"."""
STATUSES = (*JUDGED, "infeasible")
"""What a row can be: a variant as it is judged, or a row that gives none."""

_VARIANT = re.compile(r"^variant \d+: ")


def reason_of(error: WarpchainError) -> str:
    """An error in one line, without the number that the variant had among those simulated with it."""
    return "; ".join(_VARIANT.sub("", str(error)).splitlines())
