"""The color scale of link tension, the same in archives, playback and figures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ANCHORS = np.array([(45, 85, 215), (0, 170, 220), (70, 195, 95), (245, 205, 50), (225, 45, 40)], dtype=np.float64)
"""Colors (RGB) at 0, 1/4, 1/2, 3/4 and all of the scale, linear between: blue, cyan, green, yellow, red."""
UNKNOWN = (150, 150, 150)
"""Color (RGB) where the tension is not recorded or not finite."""

PERCENTILE = 99.9
"""Percentile of the tensions that the scale ends at: rare impacts may reach further."""


def full_scale(tension: NDArray[np.floating]) -> float:
    """Where the scale of link tensions (...) ends [N], 1 N at least; what is not finite does not count."""
    finite = tension[np.isfinite(tension)]
    return max(float(np.percentile(finite, PERCENTILE)), 1.0) if finite.size else 1.0


def tension_color(tension: NDArray[np.floating], full_scale: float) -> NDArray[np.uint8]:
    """Colors of link tensions.

    Args:
        tension: (...) link tensions [N].
        full_scale: tension at the scale's red end [N]; its blue end is 0 N. Values beyond are clamped.

    Returns:
        (..., 4) red, green, blue, alpha.
    """
    share = np.clip(np.asarray(tension, dtype=np.float64) / full_scale, 0.0, 1.0) * (len(ANCHORS) - 1)
    known = np.isfinite(share)
    share = np.where(known, share, 0.0)
    left = np.minimum(share.astype(np.intp), len(ANCHORS) - 2)
    weight = (share - left)[..., None]
    rgb = ANCHORS[left] * (1.0 - weight) + ANCHORS[left + 1] * weight
    rgb[~known] = UNKNOWN
    colors = np.full((*share.shape, 4), 255, dtype=np.uint8)
    colors[..., :3] = np.rint(rgb)
    return colors
