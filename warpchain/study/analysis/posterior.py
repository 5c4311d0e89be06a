"""Posterior of unknowns given measurements: samples, directions that are not identified, residuals.

A priori the unknowns are D independent standard normals u. A model has numbers j = 1 .. J with mean m_j(u) and
variance s_j^2(u); measured were y_j, with standard deviation e_j. Then

    log p(u | y) = -|u|^2 / 2 - 1/2 sum_j [ (y_j - m_j)^2 / v_j + log v_j ] + const,    v_j = s_j^2 + e_j^2.       (a)

With C the covariance of the samples, an eigenvector w of C of value l is a combination of unknowns whose standard
deviation the measurements leave at sqrt(l) of the prior's: near 1, it is not identified. emcee's ensemble moves by
differences of its members (ter Braak 2006; Foreman-Mackey et al. 2013); other libraries: docs/calibration.md.
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
"""A model from u (R, D) to mean and variance (R, J) of the numbers."""
WALKERS, CHUNK_STEPS, MOST_STEPS = 64, 50, 10_000
"""Members of the ensemble, steps between checks of how many are enough, most steps."""
WARM_UP = 5.0
"""First steps that are dropped, in autocorrelation times."""
ENOUGH_SAMPLES = 1000
PRIOR_DRAWS = 2048
UNIDENTIFIED_SHARE = 0.7
"""Part of its prior standard deviation from which on a direction is not identified."""


@dataclass(frozen=True)
class Posterior:
    """Samples of unknowns from their posterior.

    Attributes:
        u: (S, D) samples, standard normals a priori.
        independent: number of independent samples that they are worth.
    """

    u: Array
    independent: float

    @property
    def sample_mean(self) -> Array:
        """Mean of the samples (D,)."""
        return np.asarray(self.u.mean(axis=0))


@dataclass(frozen=True)
class PosteriorDirection:
    """A combination of unknowns and its posterior deviation.

    Attributes:
        weights: (D,) share of each unknown, of length 1.
        left: posterior standard deviation in parts of the prior's.
    """

    weights: Array
    left: float


def log_posterior_density(model: NumbersModel, values: Array, errors: Array) -> Callable[[Array], Array]:
    """Function of u (R, D) to the log of the posterior density (R,), eq. (a)."""

    def log_density(u: Array) -> Array:
        """Log of the posterior density at u (R, D), eq. (a)."""
        mean, variance = model(u)
        whole = variance + errors**2
        misfit = ((values - mean) ** 2 / whole + np.log(whole)).sum(axis=1)
        return np.asarray(-0.5 * ((u**2).sum(axis=1) + misfit))

    return log_density


def sample_posterior(
    model: NumbersModel, values: Array, errors: Array, dimensions: int, seed: int = 0, enough: float = ENOUGH_SAMPLES
) -> Posterior:
    """Draws samples from the posterior of unknowns.

    Args:
        model: mean and variance of the numbers.
        values, errors: (J,) measured values and their standard deviations.

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
    """Principal directions of posterior samples u (S, D), the least identified first."""
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(u, rowvar=False)))
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        found.append(PosteriorDirection(sign * vector, float(np.sqrt(max(value, 0.0)))))
    return found


def standardized_residuals(model: NumbersModel, values: Array, errors: Array, u: Array) -> Array:
    """Measured less expected values at samples u (S, D), in standard deviations (J,)."""
    mean, variance = model(u)
    whole = variance.mean(axis=0) + mean.var(axis=0) + errors**2
    return np.asarray((values - mean.mean(axis=0)) / np.sqrt(whole))


def rank_of_value(samples: Array, true: float) -> int:
    """Number of samples (S,) below a true value: uniform on 0 .. S if drawn alike (Talts 2018)."""
    return int((samples < true).sum())
