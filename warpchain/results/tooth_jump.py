"""Margin to tooth jump: how far rollers in a sprocket's wrap stand below where teeth let them go.

Of a roller at rho from the sprocket's center it is rho_top - rho [m], rho_top the tip's (docs/report.md).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import assembled_path
from warpchain.assembly.tooth_hold import top_radius
from warpchain.results.run import Trajectory, require_channels

Array = NDArray[np.float64]


class JumpMargin(NamedTuple):
    """Margin to tooth jump of a sprocket, or nan."""

    margin: Array  # (F,) least of all rollers [m]
    angle: Array  # (F,) of that roller past the chain's arrival [rad]
    height: float  # from seat to tip, rho_top - R [m]


def tooth_jump_margin(trajectory: Trajectory, s: int) -> JumpMargin:
    """Margin to tooth jump on a sprocket; nan of an end.

    Raises:
        SimulationError: recorded without positions or sprocket centers.
    """
    position, sprocket_center = require_channels(trajectory, "position", "sprocket_center")
    model, path = trajectory.model, assembled_path(trajectory.model)
    if model.sprockets[s].is_end:
        nothing = np.full(len(position), np.nan)
        return JumpMargin(nothing, nothing, 1.0)
    top = top_radius(model, s)
    step, wrap = 2.0 * np.pi / model.sprockets[s].teeth, float(path.wrap_angle[s])
    r = np.asarray(position, dtype=float) - sprocket_center[:, None, s]
    apart = np.hypot(r[..., 0], r[..., 1])
    polar = model.sprockets[s].sign * (np.arctan2(r[..., 1], r[..., 0]) - path.arrival_angle[s])
    from_middle = np.mod(polar - 0.5 * wrap + np.pi, 2.0 * np.pi) - np.pi
    near = np.abs(apart - model.pitch_radius(s)) < model.engagement(s)
    margin = np.where(near & (np.abs(from_middle) <= 0.5 * max(wrap - step, step)), top - apart, np.inf)
    roller = margin.argmin(axis=1)
    frame = np.arange(len(margin))
    least, angle = margin[frame, roller], from_middle[frame, roller] + 0.5 * wrap
    known = np.isfinite(least)
    nothing = np.full(len(least), np.nan)
    height = top - model.pitch_radius(s)
    return JumpMargin(np.where(known, least, nothing), np.where(known, angle, nothing), height)
