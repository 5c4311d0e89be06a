"""The sums that the kernels hand back, variant by variant."""

from __future__ import annotations

from typing import Any

from warpchain.engine.packed import Packed


def split_sums(sums: dict[str, Any], packed: Packed, variant: int) -> dict[str, Any]:
    """The part of the sums that is one variant's."""
    drive = packed.drives[variant]
    sprockets, guides = int(drive["sprockets"]), int(drive["guides"])
    first = int(drive["first_sprocket"])
    partner = first + int(drive["first_guide"])
    return {
        "chain": sums["chain"][variant],
        "strand": sums["strand"][first : first + sprockets],
        "sprocket": sums["sprocket"][first : first + sprockets],
        "mount": sums["mount"][first : first + sprockets],
        "contact": sums["contact"][partner : partner + sprockets + guides],
    }
