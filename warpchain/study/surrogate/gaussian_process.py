"""Gaussian process with noise (Rasmussen and Williams 2006, ch. 2 and 5), by scikit-learn.

Values of mean m and deviation s, z = (y - m) / s, have the covariance

    K = c^2 k(x, x') + (v + e_i^2) delta,      k: Matern 5/2 with a length for each coordinate,              (a)

v a fitted noise, e_i the standard error of row i. The metric, without a run's noise, is normal with

    mean k_x' K^-1 z,      variance c^2 - k_x' K^-1 k_x.                                                     (b)

Row i from the others (Dubrule 1983), and draws (Wilson et al. 2020), f a sum of cosines, e of noise:

    z_i - [K^-1 z]_i / [K^-1]_ii,      variance 1 / [K^-1]_ii,                                               (c)
    f(x) + k_x' K^-1 (z - f(X) - e).                                                                         (d)
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from warpchain.errors import StudyError
from warpchain.extras import require_extra
from warpchain.study.results import Array

MOST_ROWS, FIT_ROWS = 1000, 150
RESTARTS, MOST_RESTART_ROWS = 2, 60
COSINES = 512
ALLOWED_LENGTHS, ALLOWED_NOISES = (0.05, 50.0), (1e-7, 2.0)


@cache
def _linear_algebra_libraries() -> Any:
    """Controller of threads in linear algebra libraries."""
    import sklearn.gaussian_process  # noqa: F401  loads what it calls
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_linear_algebra_thread() -> Iterator[None]:
    """Context with one linear algebra thread, for reproducible sums."""
    require_extra("surrogate", "a Gaussian process", StudyError)
    with _linear_algebra_libraries().limit(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # lengths at their bound: a factor without effect
        yield


@dataclass(frozen=True)
class GaussianProcess:
    """Gaussian process fitted to a metric."""

    x: Array
    z: Array  # (N,) scaled values
    kernel: Any
    factor: Array  # (N, N) Cholesky factor of K
    weights: Array  # (N,) K^-1 z
    center: float  # m
    scale: float  # s
    noise: float  # v s^2, variance of a run beyond the errors, in the unit squared
    errors: Array  # (N,) e_i, in the metric's unit

    @property
    def run_variance(self) -> float:
        """Variance of a further run about the process's metric."""
        return self.noise + float(np.mean(self.errors**2))

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and deviation (R,) of the process at rows, (b)."""
        with one_linear_algebra_thread():
            mean, variance = self.mean_and_variance(x)
        return mean, np.sqrt(variance)

    def mean_and_variance(self, x: Array) -> tuple[Array, Array]:
        """Mean and variance (R,) of the process at rows, (b)."""
        across = self.kernel(x, self.x)
        inner = solve_triangular(self.factor, across.T, lower=True, check_finite=False)
        variance = np.maximum(self.kernel.diag(x) - np.einsum("ij,ij->j", inner, inner), 0.0)
        return self.center + self.scale * (across @ self.weights), self.scale**2 * variance

    def metric_draws(self, count: int, seed: int) -> Callable[[Array], Array]:
        """Function from rows to the process's mean and draws, (d)."""
        random = np.random.default_rng(seed)
        size, lengths = self.kernel.k1.constant_value, self.kernel.k2.length_scale
        width = self.x.shape[1]
        frequencies = random.standard_normal((width, COSINES)) / np.sqrt(random.chisquare(5.0, COSINES) / 5.0)
        frequencies /= np.broadcast_to(lengths, width)[:, None]
        phases = 2.0 * np.pi * random.random(COSINES)
        parts = np.sqrt(2.0 * size / COSINES) * random.standard_normal((COSINES, count))
        noise = np.sqrt(self.noise + self.errors**2) / self.scale

        def prior_draws(x: Array) -> Array:
            """Draws (R, count) of the process's prior at rows."""
            return np.asarray(np.cos(x @ frequencies + phases) @ parts)

        with one_linear_algebra_thread():
            missed = (
                self.z[:, None] - prior_draws(self.x) - noise[:, None] * random.standard_normal((len(self.x), count))
            )
            pull = np.column_stack([self.weights, cho_solve((self.factor, True), missed)])

        def posterior_draws(x: Array) -> Array:
            """Mean and draws (R, 1 + count) of the process at rows."""
            with one_linear_algebra_thread():
                z = self.kernel(x, self.x) @ pull
                z[:, 1:] += prior_draws(x)
            return np.asarray(self.center + self.scale * z)

        return posterior_draws

    def leave_one_out(self) -> tuple[Array, Array]:
        """Mean and deviation (N,) of rows by the others, (c)."""
        with one_linear_algebra_thread():
            inverse = np.diag(cho_solve((self.factor, True), np.eye(len(self.x))))
            mean = self.z - self.weights / inverse
        return self.center + self.scale * mean, self.scale / np.sqrt(inverse)

    def process_with_row(self, x: Array, y: float) -> GaussianProcess:
        """Gaussian process with one further row."""
        rows = np.vstack([self.x, x[None]])
        z = np.append(self.z, (y - self.center) / self.scale)
        return _solved_process(rows, z, self.kernel, self.noise, np.append(self.errors, 0.0), (self.center, self.scale))


def _evenly_spaced_rows(rows: int, most: int) -> NDArray[np.intp]:
    """Row numbers evenly spaced, at most `most`."""
    return np.unique(np.linspace(0, rows - 1, min(rows, most)).astype(int))


def _solved_process(
    x: Array, z: Array, kernel: Any, noise: float, errors: Array, scaling: tuple[float, float]
) -> GaussianProcess:
    """Gaussian process with a known kernel and noise."""
    center, scale = scaling
    with one_linear_algebra_thread():
        k = kernel(x)
        k[np.diag_indices(len(x))] += (noise + errors**2) / scale**2 + 1e-10
        factor = np.linalg.cholesky(k)
        weights = cho_solve((factor, True), z)
    return GaussianProcess(x, z, kernel, factor, weights, center, scale, noise, errors)


def fit_gaussian_process(x: Array, y: Array, errors: Array | None = None, isotropic: bool = False) -> GaussianProcess:
    """Gaussian process fitted to rows.

    Args:
        x: (R, D) coordinates, about 0 to 1.
        errors: (R,) standard errors; NaN takes the mean of those known.

    Raises:
        StudyError: no scikit-learn, or fewer than 4 rows.
    """
    if len(y) < 4:
        raise StudyError(f"Gaussian process: {len(y)} rows, at least 4 are needed")
    chosen = _evenly_spaced_rows(len(y), MOST_ROWS)
    x, y = x[chosen], y[chosen]
    known = np.zeros(len(y)) if errors is None else errors[chosen]
    if np.isnan(known).any():
        known = np.where(np.isnan(known), np.nanmean(known) if np.isfinite(known).any() else 0.0, known)
    center, scale = float(y.mean()), float(y.std()) or 1.0
    z = (y - center) / scale
    fit = _evenly_spaced_rows(len(y), FIT_ROWS)
    with one_linear_algebra_thread():
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        lengths = 0.7 if isotropic else np.full(x.shape[1], 0.7)
        signal = ConstantKernel(1.0, (0.05, 100.0)) * Matern(lengths, ALLOWED_LENGTHS, nu=2.5)
        fitted = GaussianProcessRegressor(
            signal + WhiteKernel(0.05, ALLOWED_NOISES),
            alpha=(known[fit] / scale) ** 2 + 1e-10,
            n_restarts_optimizer=RESTARTS if len(fit) <= MOST_RESTART_ROWS else 0,
            random_state=0,
        ).fit(x[fit], z[fit])
    noise = float(fitted.kernel_.k2.noise_level) * scale**2
    return _solved_process(x, z, fitted.kernel_.k1, noise, known, (center, scale))
