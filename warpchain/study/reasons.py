"""Why a row gives no variant, in words; why variants are not ok says `results.judgement`."""

from __future__ import annotations

import re

from warpchain.errors import WarpchainError

_VARIANT = re.compile(r"^variant \d+: ")


def reason_of(error: WarpchainError) -> str:
    """An error in one line, without the number that the variant had among those simulated with it."""
    return "; ".join(_VARIANT.sub("", str(error)).splitlines())
