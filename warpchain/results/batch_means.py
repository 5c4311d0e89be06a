"""Statistics of chaotic motion: quantiles from counts, the standard error of a mean, and whether a mean drifts.

With B batches of about equal length, x_k their means and X_j = sum x_k exp(-2 pi i j k / B), the variance of the mean
is the spectrum at no frequency, for which its lowest ordinates stand (Heidelberger and Welch 1981):

    standard error^2 = (|X_1|^2 + ... + |X_4|^2) / (4 B^2)                                                    (a)

Of independent batches this is s^2 / B on the average; batches that resemble their neighbors raise it, and an
oscillation of more than four periods in the window, which averages out of the mean, does not. It has 8 degrees of
freedom: an error is itself uncertain by a quarter.

A drift is the slope of the line through x_k by least squares, times B: its change over the window. Its variance is that
of independent residuals, times (1 + r) / (1 - r), r their correlation with the next but not below 0; drift over error
is Student's t with B - 2 degrees of freedom.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

ORDINATES = 4
"""Of the spectrum of the batches' means, that (a) takes."""

MOST_CORRELATED = 0.9
"""Residuals are taken to be no more alike than this: r of so few is uncertain, and 1 / (1 - r) without bound."""

SIGNIFICANT = 0.01
"""A drift counts if so large a one comes about by chance less often than this,"""
LARGE = 0.01
"""and if it is more than this of the mean."""


def counted_below(counts: NDArray[np.integer]) -> Array:
    """(V, bins) how many were counted in each bin and those before it; nan where a bin has overflowed."""
    below = np.cumsum(counts, axis=1, dtype=np.float64)
    below[counts.min(axis=1) < 0] = np.nan
    return below


def quantile(
    counts: NDArray[np.integer], edges: Array, low: ArrayLike, high: ArrayLike, share: float, below: Array | None = None
) -> Array:
    """The value that a share of what was counted lies below, (V,); nan where nothing was counted.

    Within a bin values count as evenly spread; bins end at the smallest and the largest value there is.

    Args:
        counts: (V, bins) in each bin.
        edges: (V, bins + 1) ascending.
        low, high: (V,) the smallest and the largest value.
        share: from 0 to 1.
        below: (V, bins) `counted_below`, where it is known.
    """
    below = counted_below(counts) if below is None else below
    wanted = share * below[:, -1]
    bins = (below >= wanted[:, None]).argmax(axis=1)
    row = np.arange(len(counts))
    inside = counts[row, bins]
    part = (wanted - (below[row, bins] - inside)) / np.where(inside > 0, inside, np.nan)
    least, most = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    from_, to = np.clip(edges[row, bins], least, most), np.clip(edges[row, bins + 1], least, most)
    from_ = np.where(bins == 0, least, from_)
    to = np.where(bins == counts.shape[1] - 1, most, to)
    return np.asarray(from_ + part * (to - from_))


def share_below(
    counts: NDArray[np.integer], edges: Array, low: ArrayLike, high: ArrayLike, value: float, below: Array | None = None
) -> Array:
    """The share of what was counted that lies below a value, (V,); nan where nothing was counted.

    Within a bin values count as evenly spread, as in `quantile`, whose arguments these are.
    """
    below = counted_below(counts) if below is None else below
    least, most = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    last = counts.shape[1] - 1
    begun = 1 + (edges[:, 1:-1] < value).sum(axis=1)  # bins that begin below the value
    begun = np.where(least < value, np.where(most < value, last + 1, begun), 0)
    row, bins = np.arange(len(counts)), np.maximum(begun - 1, 0)  # the last of these
    from_ = np.where(bins == 0, least, np.clip(edges[row, bins], least, most))
    to = np.where(bins == last, most, np.clip(edges[row, bins + 1], least, most))
    width = to - from_
    part = np.where(width > 0.0, np.clip((value - from_) / np.where(width > 0.0, width, 1.0), 0.0, 1.0), 1.0)
    found = np.where(np.arange(last + 1) < bins[:, None], counts, 0.0)
    found[row, bins] = np.where(begun > 0, part, 0.0) * counts[row, bins]
    total = below[:, -1]
    return np.asarray(found.sum(axis=1) / np.where(total > 0, total, np.nan))


def correlation(values: Array) -> Array:
    """Correlation of each value less the mean with the next one along the last axis, from 0 to `MOST_CORRELATED`."""
    apart = values - values.mean(axis=-1, keepdims=True)
    square = (apart * apart).sum(axis=-1)
    lagged = (apart[..., 1:] * apart[..., :-1]).sum(axis=-1)
    return np.clip(lagged / np.where(square > 0.0, square, np.inf), 0.0, MOST_CORRELATED)


def standard_error(means: Array) -> Array:
    """(a), of means of batches along the last axis."""
    count = means.shape[-1]
    spectrum = np.abs(np.fft.rfft(means - means.mean(axis=-1, keepdims=True), axis=-1))[..., 1 : ORDINATES + 1]
    return np.sqrt((spectrum * spectrum).mean(axis=-1)) / count


def drift(means: Array) -> tuple[Array, Array]:
    """Change over the window of means of batches along the last axis, and how probable so large a one is by chance."""
    count = means.shape[-1]
    place = np.arange(count) - 0.5 * (count - 1)
    square = float((place * place).sum())
    slope = (means * place).sum(axis=-1) / square  # which, unlike a product of matrices, goes row by row
    rest = means - means.mean(axis=-1, keepdims=True) - slope[..., None] * place
    r = correlation(rest)
    variance = (rest * rest).sum(axis=-1) / (count - 2) / square * ((1.0 + r) / (1.0 - r))
    chance = np.where(slope == 0.0, 1.0, 0.0)
    if (variance > 0.0).any():
        from scipy.special import stdtr  # here, since it takes 0.3 s

        ratio = np.abs(slope) / np.sqrt(np.where(variance > 0.0, variance, np.nan))
        chance = np.where(variance > 0.0, 2.0 * stdtr(count - 2, -ratio), chance)
    return slope * count, np.where(np.isfinite(slope), chance, np.nan)


def steady(means: Array) -> NDArray[np.bool_]:
    """Whether means of batches along the last axis do not drift: not by more than `LARGE` of their mean, or by chance.

    Not steady where they are not numbers.
    """
    change, chance = drift(means)
    return (chance >= SIGNIFICANT) | (np.abs(change) <= LARGE * np.abs(means.mean(axis=-1)))
