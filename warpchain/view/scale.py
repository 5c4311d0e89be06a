"""Where the color scale of link tension ends: a quantile of the latter half, the breaking load, or a given limit."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from warpchain.errors import SimulationError
from warpchain.results.colors import full_scale
from warpchain.results.run import Trajectory
from warpchain.results.signals import latter_half

BREAKING = "breaking"
"""Word for the chain's breaking load."""
SAMPLES = 500
"""Frames that the quantile is taken of, about."""

Scale = float | str | None
"""A tension [N], `BREAKING`, or None for the quantile."""


def scale_top(trajectories: Iterable[Trajectory], wanted: Scale = None) -> float:
    """Tension at the red end of the scale that some recordings share [N].

    By itself it is `results.colors.PERCENTILE` of all links' tensions in the latter half of a recording, the largest of
    the recordings': neither the pull of a start nor a single impact sets it.

    Raises:
        SimulationError: a limit that is no positive number, or the breaking load of a chain without a size.
    """
    if wanted is None:
        return max(_quantile(trajectory) for trajectory in trajectories)
    if wanted == BREAKING:
        loads = [trajectory.drive.chain.breaking_load for trajectory in trajectories]
        known = [load for load in loads if load is not None]
        if len(known) < len(loads):
            raise SimulationError(
                f"scale = {BREAKING}: needs a chain by its size (chain.size), which has a breaking load"
            )
        return max(known)
    try:
        limit = float(wanted)
    except ValueError:
        limit = np.nan
    if not 0.0 < limit < np.inf:
        raise SimulationError(f"scale = {wanted}: allowed are a tension above 0 in newton, or {BREAKING}")
    return limit


def _quantile(trajectory: Trajectory) -> float:
    assert trajectory.tension is not None
    part = trajectory.tension[latter_half(trajectory)]
    return full_scale(part[:: max(len(part) // SAMPLES, 1)])
