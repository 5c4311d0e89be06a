"""The quadratic surface with its uncertainty, for where scikit-learn is not installed or rows are many.

By least squares on terms t(x) with residual variance s^2 (Montgomery 2017, 10.5), the surface at x is normal with

    mean t' b,      variance s^2 t' (T' T)^-1 t,                                                            (a)

and a run there has s^2 more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpchain.study.analysis.surface import Surface, _scaled, _terms, fit_surface
from warpchain.study.results import Array, Results


@dataclass(frozen=True)
class Quadratic:
    """A fitted surface with what its variance takes.

    Attributes:
        surface: the fit.
        x: (N, A) rows that it stands on.
        y: (N,) their values.
        factor: (T, T) upper triangle of T = Q R.
        run_variance: s^2, in the metric's unit squared.
    """

    surface: Surface
    x: Array
    y: Array
    factor: Array
    run_variance: float

    def _terms(self, x: Array) -> Array:
        low, high = self.surface.low, self.surface.high
        return _terms(_scaled(x, low, high), self.surface.powers)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and standard deviation of the surface at factor values (R, A), eq. (a)."""
        leverage = np.linalg.solve(self.factor.T, self._terms(x).T)
        return self.surface.predict(x), np.sqrt(self.run_variance * np.einsum("ij,ij->j", leverage, leverage))

    def left_out(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each row as the others have it (N,): y - r / (1 - h), s / sqrt(1 - h)."""
        inner = np.linalg.solve(self.factor.T, self._terms(self.x).T)
        left = np.maximum(1.0 - np.einsum("ij,ij->j", inner, inner), 1e-9)
        residual = self.y - self.surface.predict(self.x)
        return self.y - residual / left, np.sqrt(self.run_variance / left)


def fit_quadratic(results: Results, metric: str) -> Quadratic:
    """Fits a surface to a metric, over its numeric factors.

    Raises:
        StudyError: as `fit_surface`.
    """
    surface = fit_surface(results, metric)
    rows = results.rows_for(metric, surface.factors)
    x = np.stack([results.values(name)[rows] for name in surface.factors], axis=1)
    y = results.values(metric)[rows]
    found = Quadratic(surface, x, y, np.eye(len(surface.powers)), 0.0)
    residual = y - surface.predict(x)
    variance = float(residual @ residual) / max(len(y) - len(surface.powers), 1)
    return Quadratic(surface, x, y, np.linalg.qr(found._terms(x))[1], variance)
