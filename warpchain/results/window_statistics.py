"""Statistics over a window of chaotic motion: quantiles from counts, standard error of a mean, drift of a mean.

With y_k the means of B batches and X_j = sum y_k exp(-i w_j k) / B, w_j = 2 pi j / B, each ordinate I_j = |X_j|^2 is
the spectrum S(w_j) times an exponential variate, and the variance of the mean is S(0) (Heidelberger and Welch 1981):

    log I_j + 0.577 = b_0 + b_1 j + b_2 j^2, j = 1 to 9,       standard error = c sqrt(exp(b_0)),             (a)

c by calibration (docs/chaotic-motion.md).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

ERROR_SUFFIX = "_se"

LOWEST_ORDINATES = 9

MEDIAN_ERROR_RATIO = 1.075
"""Median of sqrt(exp(b_0)) over the truth, 1 / c."""

LEAST_ERROR_SHARE = 0.5

INTERVAL_ERRORS = 3.5
"""Standard errors of a 95 % interval, as measured."""

SLOW_PERIODS = 7.5
"""Most periods in the window of slow sines."""
DETERMINATE_SHARE = 0.2
SINE_COUNT = 37

LEAST_CHAIN_TURNS = 3.95

LOG_BIAS = -0.577
LEAST_ORDINATE_SHARE = 1e-12

MOST_CORRELATION = 0.9

LEAST_PARTS_A_PERIOD = 2.2

SIGNIFICANT_CHANCE = 0.01
LARGE_DRIFT_SHARE = 0.01


def cumulative_counts(counts: NDArray[np.integer]) -> Array:
    """Cumulative counts (V, bins) of a histogram, nan for overflow."""
    below = np.cumsum(counts, axis=1, dtype=np.float64)
    below[counts.min(axis=1) < 0] = np.nan
    return below


def histogram_quantile(
    counts: NDArray[np.integer], edges: Array, low: ArrayLike, high: ArrayLike, share: float, below: Array | None = None
) -> Array:
    """Quantile (R,) of values from a histogram, or nan.

    Args:
        counts: (R, bins).
        edges: (V, bins + 1) ascending, each for R / V rows of `counts`.
        low, high: (R,) smallest and largest value.
        below: (R, bins) `cumulative_counts`, where known.
    """
    below = cumulative_counts(counts) if below is None else below
    wanted = share * below[:, -1]
    bins = _first_bins_reaching(below, wanted)
    row = np.arange(len(counts))
    edge = row * len(edges) // len(counts)
    inside = counts[row, bins]
    part = (wanted - (below[row, bins] - inside)) / np.where(inside > 0, inside, np.nan)
    least, most = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    from_, to = np.clip(edges[edge, bins], least, most), np.clip(edges[edge, bins + 1], least, most)
    from_ = np.where(bins == 0, least, from_)
    to = np.where(bins == counts.shape[1] - 1, most, to)
    return np.asarray(from_ + part * (to - from_))


def _first_bins_reaching(below: Array, wanted: Array) -> NDArray[np.int64]:
    """First bin (R,) whose cumulative count reaches the wanted."""
    row, count = np.arange(len(below)), below.shape[1]
    found, step = np.zeros(len(below), dtype=np.int64), 2 ** (count - 1).bit_length()
    while step > 1:
        step //= 2
        ahead = np.minimum(found + step, count - 1)
        found = np.where(below[row, ahead - 1] < wanted, ahead, found)
    return found


def histogram_share_below(
    counts: NDArray[np.integer], edges: Array, low: ArrayLike, high: ArrayLike, value: float, below: Array | None = None
) -> Array:
    """Share (R,) of values below a value, from a histogram."""
    below = cumulative_counts(counts) if below is None else below
    least, most = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    last = counts.shape[1] - 1
    row = np.arange(len(counts))
    edge = row * len(edges) // len(counts)
    begun = (1 + (edges[:, 1:-1] < value).sum(axis=1))[edge]  # bins that begin below the value
    begun = np.where(least < value, np.where(most < value, last + 1, begun), 0)
    bins = np.maximum(begun - 1, 0)  # the last of these
    from_ = np.where(bins == 0, least, np.clip(edges[edge, bins], least, most))
    to = np.where(bins == last, most, np.clip(edges[edge, bins + 1], least, most))
    width = to - from_
    part = np.where(width > 0.0, np.clip((value - from_) / np.where(width > 0.0, width, 1.0), 0.0, 1.0), 1.0)
    before = np.where(bins > 0, below[row, bins - 1], 0.0)
    total = below[:, -1]
    found = before + np.where(begun > 0, part, 0.0) * counts[row, bins]
    return np.asarray(found / np.where(total > 0, total, np.nan))


def lag_correlation(values: Array) -> Array:
    """Lag-one correlation of batch means along the last axis."""
    apart = values - values.mean(axis=-1, keepdims=True)
    square = (apart * apart).sum(axis=-1)
    lagged = (apart[..., 1:] * apart[..., :-1]).sum(axis=-1)
    return np.clip(lagged / np.where(square > 0.0, square, np.inf), 0.0, MOST_CORRELATION)


def mean_standard_error(means: Array, weights: ArrayLike = 1.0) -> Array:
    """Standard error of the mean of batch means, (a)."""
    weights, count = np.broadcast_to(weights, means.shape), means.shape[-1]
    total = weights.sum(axis=-1, keepdims=True)
    apart = means - (weights * means).sum(axis=-1, keepdims=True) / total
    apart *= weights
    apart /= total / count
    found = np.fft.rfft(apart, axis=-1)[..., 1 : LOWEST_ORDINATES + 1] / count
    ordinates = np.abs(found) ** 2
    usual = ordinates.mean(axis=-1)
    shares = np.maximum(ordinates / np.where(usual > 0.0, usual, 1.0)[..., None], LEAST_ORDINATE_SHARE)
    logarithms = np.log(shares) - LOG_BIAS
    least = 2.0 * np.log(LEAST_ERROR_SHARE) + logarithms.mean(axis=-1)
    error = (
        np.sqrt(usual * np.exp(np.maximum((logarithms * _extrapolation_weights()).sum(axis=-1), least)))
        / MEDIAN_ERROR_RATIO
    )
    explained = _sine_explained_power(found / np.sqrt(np.where(usual > 0.0, usual, 1.0))[..., None], count)
    return np.asarray(np.where(explained > (1.0 - DETERMINATE_SHARE) * LOWEST_ORDINATES, np.nan, error))


def _sine_explained_power(found: NDArray[np.complex128], count: int) -> NDArray[np.float32]:
    """Largest power of the lowest ordinates in one sine."""
    middle = found * np.exp(1j * np.pi * (count - 1) / count * np.arange(1, LOWEST_ORDINATES + 1))
    cosines, sines = (np.moveaxis(part, -1, 0).astype(np.float32) for part in (middle.real, middle.imag))
    along = np.zeros((2, SINE_COUNT, *found.shape[:-1]), dtype=np.float32)
    term = np.empty_like(along[0])
    for j, (cosine, sine) in enumerate(_sine_bases(count)):  # which, unlike a product of matrices, goes row by row
        along[0] += np.multiply.outer(cosine, cosines[j], out=term)
        along[1] += np.multiply.outer(sine, sines[j], out=term)
    along *= along
    along[0] += along[1]
    return np.asarray(along[0].max(axis=0))


@cache
def _sine_bases(count: int) -> NDArray[np.float32]:
    """Bases (`LOWEST_ORDINATES`, 2, `SINE_COUNT`) of slow sines' ordinates."""
    angle = 2.0 * np.pi * np.linspace(0.3, SLOW_PERIODS, SINE_COUNT)[:, None] * ((np.arange(count) + 0.5) / count - 0.5)
    found = np.fft.rfft(np.stack([np.cos(angle), np.sin(angle)], axis=1))[..., 1 : LOWEST_ORDINATES + 1]
    found *= np.exp(1j * np.pi * (count - 1) / count * np.arange(1, LOWEST_ORDINATES + 1))
    parts = np.stack([found[:, 0].real, found[:, 1].imag], axis=1)
    parts /= np.linalg.norm(parts, axis=-1, keepdims=True)
    return parts.T.astype(np.float32)


@cache
def _extrapolation_weights() -> Array:
    """Weights of the ordinates' logarithms in b_0 of (a)."""
    return np.asarray(np.linalg.pinv(np.vander(np.arange(1.0, LOWEST_ORDINATES + 1), 3))[-1])


def window_drift(means: Array) -> tuple[Array, Array]:
    """Drift of batch means over the window, and its chance.

    The variance is that of independent residuals, times (1 + r) / (1 - r), r >= 0 their lag correlation; drift over
    error is Student's t of P - 2.
    """
    count = means.shape[-1]
    place = np.arange(count) - 0.5 * (count - 1)
    square = float((place * place).sum())
    slope = (means * place).sum(axis=-1) / square  # which, unlike a product of matrices, goes row by row
    rest = means - means.mean(axis=-1, keepdims=True) - slope[..., None] * place
    r = lag_correlation(rest)
    variance = (rest * rest).sum(axis=-1) / (count - 2) / square * ((1.0 + r) / (1.0 - r))
    chance = np.where(slope == 0.0, 1.0, 0.0)
    if (variance > 0.0).any():
        from scipy.special import stdtr  # here, since it takes 0.3 s

        ratio = np.abs(slope) / np.sqrt(np.where(variance > 0.0, variance, np.nan))
        chance = np.where(variance > 0.0, 2.0 * stdtr(count - 2, -ratio), chance)
    return slope * count, np.where(np.isfinite(slope), chance, np.nan)


def window_change(means: Array, waves: Array) -> Array:
    """Change (V,) of batch means (V, P), ripple removed.

    Args:
        waves: (V,) periods of the ripple in the window, 0 for none.
    """
    found, _ = window_drift(means)
    count = means.shape[-1]
    place = (np.arange(count) + 0.5) / count
    for v in np.flatnonzero((waves >= 1.0) & (waves * LEAST_PARTS_A_PERIOD <= count) & np.isfinite(means).all(axis=-1)):
        angle = 2.0 * np.pi * waves[v] * place
        columns = np.stack([np.ones(count), place, np.cos(angle), np.sin(angle)], axis=1)
        found[v] = np.linalg.lstsq(columns, means[v], rcond=None)[0][1]
    return found


def is_steady(means: Array) -> NDArray[np.bool_]:
    """Whether batch means along the last axis do not drift."""
    change, chance = window_drift(means)
    return (chance >= SIGNIFICANT_CHANCE) | (np.abs(change) <= LARGE_DRIFT_SHARE * np.abs(means.mean(axis=-1)))
