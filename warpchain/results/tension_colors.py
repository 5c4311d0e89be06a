"""Color scale of link tension, for archives, playback and figures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLOR_ANCHORS = np.array([(45, 85, 215), (0, 170, 220), (70, 195, 95), (245, 205, 50), (225, 45, 40)], dtype=np.float64)
UNKNOWN_COLOR = (150, 150, 150)

SCALE_PERCENTILE = 99.9


def tension_scale_end(tension: NDArray[np.floating]) -> float:
    """Tension [N] at which the color scale ends."""
    finite = tension[np.isfinite(tension)]
    return max(float(np.percentile(finite, SCALE_PERCENTILE)), 1.0) if finite.size else 1.0


def tension_colors(tension: NDArray[np.floating], full_scale: float) -> NDArray[np.uint8]:
    """Colors RGBA (..., 4) of link tensions (...) [N].

    Args:
        full_scale: tension at the scale's red end [N]; 0 is blue.
    """
    share = np.clip(np.asarray(tension, dtype=np.float64) / full_scale, 0.0, 1.0) * (len(COLOR_ANCHORS) - 1)
    known = np.isfinite(share)
    share = np.where(known, share, 0.0)
    left = np.minimum(share.astype(np.intp), len(COLOR_ANCHORS) - 2)
    weight = (share - left)[..., None]
    rgb = COLOR_ANCHORS[left] * (1.0 - weight) + COLOR_ANCHORS[left + 1] * weight
    rgb[~known] = UNKNOWN_COLOR
    colors = np.full((*share.shape, 4), 255, dtype=np.uint8)
    colors[..., :3] = np.rint(rgb)
    return colors
