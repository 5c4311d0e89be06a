"""The sums that the kernels hand back, variant by variant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.packed import Packed


def split_sums(sums: dict[str, Any], packed: Packed, variants: NDArray[np.integer]) -> dict[str, Any]:
    """The sums of V variants that have S sprockets and G guide-bars each.

    Returns:
        "chain" (V,), "strand", "sprocket" and "mount" (V, S), "contact" (V, S + G), a row a variant.
    """
    drives = packed.drives[variants]
    sprockets, guides = int(drives["sprockets"][0]), int(drives["guides"][0])
    first = drives["first_sprocket"][:, None].astype(np.int64)
    sprocket = first + np.arange(sprockets)
    partner = first + drives["first_guide"][:, None] + np.arange(sprockets + guides)
    return {
        "chain": sums["chain"][variants],
        "strand": sums["strand"][sprocket],
        "sprocket": sums["sprocket"][sprocket],
        "mount": sums["mount"][sprocket],
        "contact": sums["contact"][partner],
    }
