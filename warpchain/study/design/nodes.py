"""A factor's distribution as values and weights, by which means of it are taken: of a polynomial exactly.

Gauss-Hermite nodes for normal and lognormal factors, Gauss-Legendre nodes for ranges, the values themselves for levels,
choices and whole numbers of a uniform range.
"""

from __future__ import annotations

import math

import numpy as np

from warpchain.study.design.values import Array, log_moments
from warpchain.study.spec.factor import Factor

NODES = 80
MOST_WHOLE = 100_000
"""Whole numbers that are taken one by one; a wider range counts as continuous."""
FARTHEST = 12.0
"""Standard deviations from the mean that a truncated normal distribution is followed to."""


def nodes(factor: Factor) -> tuple[Array, Array] | None:
    """Values and weights (Q,), (Q,), the weights adding up to 1; None for what is no distribution of numbers."""
    if factor.values is not None:
        if any(isinstance(value, (str, bool)) for value in factor.values):
            return None
        return np.array(factor.values, dtype=float), np.full(len(factor.values), 1.0 / len(factor.values))
    if factor.kind in ("normal", "lognormal"):
        z, weight = np.polynomial.hermite_e.hermegauss(NODES)
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        weight = weight / weight.sum()
        if factor.kind == "normal":
            return factor.mean + factor.std * z, weight
        center, width = log_moments(factor)
        return np.exp(center + width * z), weight
    if factor.range is None:
        return None
    low, high = factor.range
    if factor.kind == "uniform" and factor.integer and math.floor(high) - math.ceil(low) < MOST_WHOLE:
        whole = np.arange(math.ceil(low), math.floor(high) + 1, dtype=float)
        return whole, np.full(len(whole), 1.0 / len(whole))
    if factor.kind == "truncated-normal":
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        near = [factor.mean - FARTHEST * factor.std, factor.mean + FARTHEST * factor.std]
        inner = max(low, near[0]), min(high, near[1])
        if inner[0] < inner[1]:
            low, high = inner
    x, weight = np.polynomial.legendre.leggauss(NODES)
    share = 0.5 * (1.0 + x)
    if factor.kind == "log-uniform":
        return low ** (1.0 - share) * high**share, 0.5 * weight
    value = low * (1.0 - share) + high * share
    if factor.kind == "truncated-normal":
        assert factor.mean is not None and factor.std is not None
        z = (value - factor.mean) / factor.std
        weight = weight * np.exp(-0.5 * (z * z - (z * z).min()))
    return value, weight / weight.sum()
