"""Probability of failure by importance sampling from a mixture that is fitted to failures.

Failures u, standard normal (D,) of density phi, are those of a subset simulation. Samples are from

    q(u) = a phi(u) [|u| > r] / P(|u| > r) + (1 - a) sum_k s_k N(u; m_k, C_k),                               (a)

P = mean(w(u), failing), w = phi / q (Kurtz and Song 2013), r just below the nearest failure (Harbitz 1986), m_k and C_k
mean and covariance of failures in a direction. Shrinkage of C_k, directions, and a make least, outside the fit,

    E_q[w^2, failing] = P E[w | failure].                                                                    (b)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.analysis.failure_probability import FailureEstimate, Margin, nearest_failures
from warpchain.study.results import Array

RADIUS_SHARE = 0.95
OUTSIDE_SHARES = (0.1, 0.2, 0.5)
SHRINKAGES = (0.0, 0.3, 0.6, 0.8, 0.9, 1.0)
DIRECTION_TURNS = 5
NORMAL_LEVEL = 0.99
FOLDS = 8
LEAST_SAMPLES = 5.0


@dataclass(frozen=True)
class _FailureGroup:
    """Failures in a direction: share, mean, axes, variances."""

    share: float
    mean: Array
    axes: Array
    variances: Array

    def axis_deviations(self, shrinkage: float) -> Array:
        """Deviations (D,) of failures along axes, shrunk."""
        return np.sqrt(np.maximum((1.0 - shrinkage) * self.variances + shrinkage * self.variances.mean(), 1.0))


@dataclass(frozen=True)
class FailureMixture:
    """Failure mixture of normal densities, q of (a)."""

    radius: float  # r
    beyond: float  # P(|u| > r)
    parts: tuple[_FailureGroup, ...]
    shrinkage: float = 1.0  # of covariances towards a multiple of the unit matrix, 0 to 1
    outside: float = 0.5  # a
    held_out: Array = field(default_factory=lambda: np.array([np.inf]))  # weights w of failures outside the fit, (b)

    def draw_samples(self, count: int, rng: np.random.Generator) -> Array:
        """Random samples (count, D) of the failure mixture."""
        from scipy.stats import chi2

        shares = [self.outside, *((1.0 - self.outside) * part.share for part in self.parts)]
        of = rng.choice(len(shares), count, p=shares)
        u = rng.standard_normal((count, len(self.parts[0].mean)))
        far = of == 0
        size = np.sqrt(chi2.isf(self.beyond * rng.random(int(far.sum())), u.shape[1]))
        u[far] *= (size / np.linalg.norm(u[far], axis=1))[:, None]
        for k, part in enumerate(self.parts, 1):
            u[of == k] = part.mean + (u[of == k] * part.axis_deviations(self.shrinkage)) @ part.axes.T
        return u

    def importance_weights(self, u: Array) -> Array:
        """Importance weights w (N,) of points (N, D)."""
        size = (u**2).sum(axis=1)
        logs = [np.where(size > self.radius**2, np.log(self.outside / self.beyond) - 0.5 * size, -np.inf)]
        for part in self.parts:
            deviations = part.axis_deviations(self.shrinkage)
            z = ((u - part.mean) @ part.axes) / deviations
            logs.append(np.log((1.0 - self.outside) * part.share / deviations.prod()) - 0.5 * (z**2).sum(axis=1))
        return np.asarray(np.exp(-0.5 * size - np.logaddexp.reduce(logs)))


def fit_mixture(failed: Sequence[Array]) -> FailureMixture:
    """Failure mixture fitted to failures (F, D) of repetitions."""
    every, count = np.vstack(failed), min(FOLDS, len(failed))
    folds = [np.vstack(failed[k::count]) for k in range(count)]
    others = [np.vstack([fold for j, fold in enumerate(folds) if j != k]) for k in range(count)]
    best: FailureMixture | None = None
    for directions in _group_directions(every):
        fits = [_mixture_of_groups(other, directions) for other in others]
        for shrinkage, outside in product(SHRINKAGES, OUTSIDE_SHARES):
            chosen = [replace(fit, shrinkage=shrinkage, outside=outside) for fit in fits]
            held_out = np.concatenate([fit.importance_weights(u) for fit, u in zip(chosen, folds, strict=True)])
            if best is None or held_out.mean() < best.held_out.mean():
                best = replace(
                    _mixture_of_groups(every, directions), shrinkage=shrinkage, outside=outside, held_out=held_out
                )
    assert best is not None
    return best


def _group_directions(failed: Array) -> list[Array]:
    """Unit vectors (K, D) to group failures by."""
    directions = nearest_failures(failed)
    for _ in range(DIRECTION_TURNS):
        group = (failed @ directions.T).argmax(axis=1)
        directions = np.array([_unit_vector(failed[group == k].mean(axis=0)) for k in np.unique(group)])
    return [_unit_vector(failed.mean(axis=0))[None], *([directions] if len(directions) > 1 else [])]


def _unit_vector(vector: Array) -> Array:
    """Vector scaled to length 1."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def _mixture_of_groups(failed: Array, directions: Array) -> FailureMixture:
    """Failure mixture of failures (F, D) by directions (K, D)."""
    from scipy.stats import chi2

    count, dimensions = failed.shape
    group, parts = (failed @ directions.T).argmax(axis=1), []
    for k in np.unique(group):
        inside = failed[group == k]
        mean = inside.mean(axis=0)
        variances, axes = np.linalg.eigh((inside - mean).T @ (inside - mean) / len(inside))
        parts.append(_FailureGroup(len(inside) / count, mean, axes, variances))
    radius = RADIUS_SHARE * float(np.linalg.norm(failed, axis=1).min())
    return FailureMixture(radius, float(chi2.sf(radius**2, dimensions)), tuple(parts))


def importance_sampling(margin: Margin, mixture: FailureMixture, count: int, seed: int) -> FailureEstimate:
    """Failure probability by `count` samples of a failure mixture.

    Raises:
        StudyError: no sample failed, or few have nearly all the weight.
    """
    from scipy.stats import norm

    u = mixture.draw_samples(count, np.random.default_rng(seed))
    fails = margin(u) <= 0.0
    if not fails.any():
        raise StudyError("unknown: no sample failed; raise risk.samples")
    weights = np.where(fails, mixture.importance_weights(u), 0.0)
    mean = float(weights.mean())
    variance = max(float(weights.var(ddof=1)) / mean**2, float(mixture.held_out.mean()) / mean - 1.0)
    if count < LEAST_SAMPLES * variance:
        raise StudyError(
            f"unknown: the weights scatter as if there were {count / variance:.0f} samples, fewer than "
            f"{LEAST_SAMPLES:.0f}; "
            "raise risk.count, which tells where failures are, or risk.samples"
        )
    half = norm.ppf(0.5 + 0.5 * NORMAL_LEVEL) * np.sqrt(np.log1p(variance / count))
    return FailureEstimate(mean, mean * np.exp(-half), min(1.0, mean * np.exp(half)), count, (u[fails],))


def combined_estimate(subset: FailureEstimate, sampled: FailureEstimate | str) -> FailureEstimate | str:
    """Failure probability by both methods, or why they disagree."""
    if isinstance(sampled, str):
        return subset
    if sampled.low > subset.high or subset.low > sampled.high:
        return (
            "unknown: the two intervals do not overlap, as where a way to fail is missed or runs scatter; "
            "raise risk.count and risk.samples"
        )
    return sampled
