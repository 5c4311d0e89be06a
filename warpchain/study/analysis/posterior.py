"""Posterior of unknowns given measurements: samples, directions that are not identified, residuals.

The D unknowns u are a priori standard normal. A model has J numbers of mean m_j(u) and variance s_j^2(u); measured were
y_j, of deviation e_j:

    log p(u | y) = -|u|^2 / 2 - 1/2 sum_j [ (y_j - m_j)^2 / v_j + log v_j ] + const,    v_j = s_j^2 + e_j^2.       (a)

An eigenvector of the samples' covariance, of value near 1, is not identified.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warpchain.errors import StudyError
from warpchain.extras import require_extra
from warpchain.progress import raise_if_stopped
from warpchain.study.results import Array

NumbersModel = Callable[[Array], tuple[Array, Array]]
"""Model from unknowns (R, D) to mean and variance (R, J)."""
WALKERS, CHUNK_STEPS, MOST_STEPS = 64, 50, 10_000
WARM_UP = 5.0
ENOUGH_SAMPLES = 1000
PRIOR_DRAWS = 2048
UNIDENTIFIED_SHARE = 0.7
"""Least posterior over prior deviation of unidentified directions."""


@dataclass(frozen=True)
class Posterior:
    """Posterior samples of unknowns."""

    u: Array  # (S, D), standard normals a priori
    independent: float  # number of independent samples that they are worth

    @property
    def sample_mean(self) -> Array:
        """Mean (D,) of the posterior samples."""
        return np.asarray(self.u.mean(axis=0))


@dataclass(frozen=True)
class PosteriorDirection:
    """Combination of unknowns with its posterior deviation."""

    weights: Array  # (D,) of length 1
    left: float  # posterior deviation over the prior's


def log_posterior_density(model: NumbersModel, values: Array, errors: Array) -> Callable[[Array], Array]:
    """Function from unknowns (R, D) to log posterior density (R,), (a)."""

    def log_density(u: Array) -> Array:
        """Log posterior density (R,) of unknowns (R, D), (a)."""
        mean, variance = model(u)
        whole = variance + errors**2
        misfit = ((values - mean) ** 2 / whole + np.log(whole)).sum(axis=1)
        return np.asarray(-0.5 * ((u**2).sum(axis=1) + misfit))

    return log_density


def sample_posterior(
    model: NumbersModel, values: Array, errors: Array, dimensions: int, seed: int = 0, enough: float = ENOUGH_SAMPLES
) -> Posterior:
    """Random samples from the posterior of unknowns.

    Args:
        values, errors: (J,) measured values and deviations.

    Raises:
        StudyError: emcee is not installed, or the posterior is nowhere a number.
    """
    require_extra("calibrate", "calibrate", StudyError)
    import emcee

    density, rng = log_posterior_density(model, values, errors), np.random.default_rng(seed)
    walkers = max(WALKERS, 4 * dimensions)
    drawn = rng.standard_normal((PRIOR_DRAWS, dimensions))
    known = density(drawn)
    if not np.isfinite(known).any():
        raise StudyError("calibrate: the posterior is nowhere a number")
    start = drawn[np.argsort(-np.nan_to_num(known, nan=-np.inf), kind="stable")[:walkers]]
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.StretchMove(), 0.1)]
    sampler = emcee.EnsembleSampler(walkers, dimensions, density, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    state = sampler.run_mcmc(start, CHUNK_STEPS)
    sampler.reset()
    steps, lag, independent = 0, 1.0, 0.0
    while steps < MOST_STEPS and independent < enough:
        raise_if_stopped()
        state = sampler.run_mcmc(state, CHUNK_STEPS)
        steps += CHUNK_STEPS
        lag = max(1.0, float(np.max(sampler.get_autocorr_time(tol=0))))
        independent = walkers * (steps / lag - WARM_UP)
    return Posterior(sampler.get_chain(flat=True, thin=max(1, int(lag / 2.0)), discard=int(WARM_UP * lag)), independent)


def posterior_directions(u: Array) -> list[PosteriorDirection]:
    """Principal directions of posterior samples, least identified first."""
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(u, rowvar=False)))
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        found.append(PosteriorDirection(sign * vector, float(np.sqrt(max(value, 0.0)))))
    return found


def standardized_residuals(model: NumbersModel, values: Array, errors: Array, u: Array) -> Array:
    """Standardized residuals (J,) of measurements over posterior samples."""
    mean, variance = model(u)
    whole = variance.mean(axis=0) + mean.var(axis=0) + errors**2
    return np.asarray((values - mean.mean(axis=0)) / np.sqrt(whole))


def rank_of_value(samples: Array, true: float) -> int:
    """Rank of a true value among posterior samples (Talts 2018)."""
    return int((samples < true).sum())
