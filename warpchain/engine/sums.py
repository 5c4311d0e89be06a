"""The sums that the kernels hand back, variant by variant."""

from __future__ import annotations

from typing import Any

import numpy as np

from warpchain.drive import Drive
from warpchain.engine.packed import Packed
from warpchain.kernels import sum_structs
from warpchain.results.metrics import RUN_COLUMNS, SETTLING_COLUMNS, row_of
from warpchain.results.schedule import Schedule


def split_sums(sums: dict[str, Any], packed: Packed, variant: int) -> dict[str, Any]:
    """The part of the sums that is one variant's."""
    drive = packed.drives[variant]
    wheels, bars = int(drive["sprockets"]), int(drive["guides"])
    first = int(drive["first_sprocket"])
    partner = first + int(drive["first_guide"])
    return {
        "chain": sums["chain"][variant],
        "strand": sums["strand"][first : first + wheels],
        "sprocket": sums["sprocket"][first : first + wheels],
        "mount": sums["mount"][first : first + wheels],
        "contact": sums["contact"][partner : partner + wheels + bars],
    }


def metric_names(drive: Drive) -> list[str]:
    """Names of the metrics that a drive has."""
    wheels, bars = len(drive.sprockets), len(drive.guides)
    kinds = {
        "chain": ((), sum_structs.ChainSums),
        "strand": (wheels, sum_structs.StrandSums),
        "sprocket": (wheels, sum_structs.SprocketSums),
        "mount": (wheels, sum_structs.MountSums),
        "contact": (wheels + bars, sum_structs.ContactSums),
    }
    sums = {name: np.ones(count, kind.numpy_dtype()) for name, (count, kind) in kinds.items()}
    row = row_of(drive, Schedule(1e-6, 2, 0, 1, 0), sums, 3, False)
    settled = SETTLING_COLUMNS if drive.run.settle else ()
    return [*(name for name in row if name not in RUN_COLUMNS), *settled]
