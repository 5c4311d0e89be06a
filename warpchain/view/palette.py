"""Colors of pictures: curves, dots, and the scale of link tension from blue (0 N) to red."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import SimulationError
from warpchain.model import ChainModel
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import PART_SIGNALS, latter_half_frames
from warpchain.results.tension_colors import tension_colors, tension_scale_end

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap

    from warpchain.drive import Drive

Color = tuple[int, int, int]

CURVE_PALETTE: tuple[Color, ...] = (
    *((90, 170, 240), (250, 165, 100), (125, 210, 125), (220, 110, 200), (230, 220, 90), (120, 225, 225)),
    *((240, 130, 125), (170, 145, 250), (185, 150, 115), (165, 230, 50), (150, 190, 165), (245, 180, 225)),
)
"""Colors of curves and compared variants."""
EXTREME_COLORS: dict[str, Color] = {"largest": (255, 75, 75), "mean": (240, 240, 240), "smallest": (95, 120, 255)}
"""Colors of the largest, mean and smallest tension."""
SHOWN_DOT, RECORDED_DOT, BEST_DOT, OTHER_DOT = (240, 90, 60), (90, 170, 240), (240, 200, 60), (140, 140, 140)
"""Colors of variants' dots: played, recorded, on the Pareto front, others."""
BREAKING_LOAD = "breaking"
"""Word for a tension scale up to the breaking load."""
QUANTILE_FRAMES = 500
"""Frames for the tension scale's quantile, about."""
ScaleTop = float | str | None
"""Upper end of the tension scale: [N], `BREAKING_LOAD`, or None for a quantile."""


def variant_shades(color: Color) -> tuple[Color, ...]:
    """Palette of a variant's curves: four shades of its color."""
    return (color, _mixed_color(color, 0.38, 255), _mixed_color(color, 0.66, 255), _mixed_color(color, 0.15, 0))


def _mixed_color(color: Color, share: float, gray: int) -> Color:
    """Color mixed with a share of gray."""
    red, green, blue = (round(part + share * (gray - part)) for part in color)
    return red, green, blue


def curve_colors(parts: Drive | ChainModel, variant: Color | None = None) -> dict[str, Color]:
    """Palette of curves by part's name, shades of `variant` if given."""
    bodies = [*(s.name for s in parts.sprockets), *(g.name for g in parts.guides)]
    others = [part.name for kind in dict.fromkeys(row[0] for row in PART_SIGNALS) for part in getattr(parts, kind)]
    if variant is None:
        names = [*bodies, *parts.strand_names, *others]
        return EXTREME_COLORS | {name: CURVE_PALETTE[k % len(CURVE_PALETTE)] for k, name in enumerate(names)}
    own = variant_shades(variant)
    return {
        name: own[k % len(own)]
        for names in (EXTREME_COLORS, bodies, parts.strand_names, others)
        for k, name in enumerate(names)
    }


@lru_cache(maxsize=1)
def tension_color_table() -> NDArray[np.uint8]:
    """Palette (256, 4) of the tension scale."""
    return tension_colors(np.arange(256.0), 255.0)


def tension_color_steps(tension: NDArray[np.floating], top: float) -> NDArray[np.uint8]:
    """Steps, 0 to 255, of tensions [N] on the scale up to `top` [N]."""
    share = np.asarray(tension, dtype=np.float32) * np.float32(255.0 / top)
    share += np.float32(0.5)
    np.clip(share, 0.0, 255.0, out=share)
    return np.nan_to_num(share, copy=False).astype(np.uint8)


def packed_tension_colors(steps: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Colors of the tension scale's steps, as Rerun's integers."""
    return _packed_color_table()[steps]


@lru_cache(maxsize=1)
def _packed_color_table() -> NDArray[np.uint32]:
    """Palette (256,) of the tension scale, as Rerun's integers."""
    return tension_color_table().view(">u4")[:, 0].astype(np.uint32)


def tension_colormap() -> ListedColormap:
    """Color map of matplotlib for the tension scale."""
    from matplotlib.colors import ListedColormap

    return ListedColormap(tension_color_table() / 255.0)


def tension_scale_top(trajectories: Iterable[Trajectory], wanted: ScaleTop = None) -> float:
    """Tension [N] at the red end of the color scale of recordings.

    None takes `tension_colors.SCALE_PERCENTILE` of the latter half's link tensions.

    Raises:
        SimulationError: a limit that is no positive number, or the breaking load of a chain without a size.
    """
    if wanted is None:
        return max(_scale_quantile(trajectory) for trajectory in trajectories)
    if wanted == BREAKING_LOAD:
        loads = [trajectory.parts.chain.breaking_load for trajectory in trajectories]
        known = [load for load in loads if load is not None]
        if len(known) < len(loads):
            raise SimulationError(
                f"scale = {BREAKING_LOAD}: needs a chain by its size (chain.size), which has a breaking load"
            )
        return max(known)
    try:
        limit = float(wanted)
    except ValueError:
        limit = np.nan
    if not 0.0 < limit < np.inf:
        raise SimulationError(f"scale = {wanted}: allowed are a tension above 0 in newton, or {BREAKING_LOAD}")
    return limit


def _scale_quantile(trajectory: Trajectory) -> float:
    """Percentile of a recording's link tensions [N] for the color scale."""
    (tension,) = require_channels(trajectory, "tension")
    part = tension[latter_half_frames(trajectory)]
    return tension_scale_end(part[:: max(len(part) // QUANTILE_FRAMES, 1)])
