"""A seeded displacement of the rollers at the start, far below what anyone could measure, that chaos makes large."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warpchain.drive import Drive
from warpchain.engine.packed import Packed

SIZE = 1e-9
"""Standard deviation of each coordinate's displacement, in pitches."""


def perturb(packed: Packed, drives: Sequence[Drive]) -> None:
    """Displaces the rollers of drives with `run.perturbation`, after settling; `packed` is in float64."""
    for v, drive in enumerate(drives):
        if drive.run.perturbation is not None:
            rows = packed.rows(v)
            random = np.random.default_rng(drive.run.perturbation)
            rows[0:2] += SIZE * drive.chain.pitch * random.standard_normal(rows[0:2].shape)
