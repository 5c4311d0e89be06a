"""One face for all surrogates: rows in, mean and standard deviation out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.results import Array, Results
from warpchain.study.surrogate.features import Features, Rows, columns_of, features_of
from warpchain.study.surrogate.gaussian import Process, fit_process
from warpchain.study.surrogate.noise import standard_errors
from warpchain.study.surrogate.quadratic import Quadratic, fit_quadratic
from warpchain.study.surrogate.validation import CrossValidation

KINDS = ("gaussian", "quadratic")


@dataclass(frozen=True)
class Surrogate:
    """What stands for a metric between the variants that were run.

    Attributes:
        metric: its name.
        kind: of `KINDS`.
        model: the fit.
        features: how rows become its coordinates; None takes the factors as they are.
        logarithm: whether the fit is of the metric's logarithm.
    """

    metric: str
    kind: str
    model: Process | Quadratic
    features: Features | None
    logarithm: bool = False

    @property
    def factors(self) -> tuple[str, ...]:
        """The factors that rows must have."""
        return self.features.factors if self.features is not None else self.model.surface.factors  # type: ignore[union-attr]

    @property
    def rows(self) -> int:
        """Number of variants that it stands on."""
        return len(self.model.x)

    def predict(self, rows: Rows, run: bool = False) -> tuple[Array, Array]:
        """Mean (R,) and standard deviation (R,) of the metric, in its unit.

        Args:
            rows: a table, a column by name, or a mapping a row, with the `factors`.
            run: of what a single further run would give, with its noise; else of the metric itself.

        Raises:
            StudyError: a factor is missing, or a word that was not run.
        """
        if self.features is not None:
            x = self.features.of(rows)
        else:
            columns = columns_of(rows, self.factors)
            x = np.stack([np.asarray(columns[name], dtype=float) for name in self.factors], axis=1)
        mean, deviation = self.model.predict(x)
        if run:
            deviation = np.sqrt(deviation**2 + self.model.run_variance)
        return _unlog(mean, deviation) if self.logarithm else (mean, deviation)

    def cross_validated(self) -> CrossValidation:
        """Each row that it stands on, as the others predict it; what was fitted as a whole is kept."""
        mean, deviation = self.model.left_out()
        if isinstance(self.model, Process):
            observed = self.model.center + self.model.scale * self.model.z
        else:
            observed = self.model.y
        if self.logarithm:
            return CrossValidation(np.exp(observed), *_unlog(mean, deviation))
        return CrossValidation(observed, mean, deviation)


def _unlog(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of exp of a normal."""
    center = np.exp(mean + 0.5 * deviation**2)
    return center, center * np.sqrt(np.expm1(deviation**2))


def fit_surrogate(
    results: Results,
    metric: str,
    kind: str = "gaussian",
    factors: Sequence[str] | None = None,
    logarithm: bool = False,
) -> Surrogate:
    """Fits a surrogate to the variants that are ok.

    Args:
        results: the study's results; a column `METRIC_se` has the standard error of each value.
        metric: the metric.
        kind: "gaussian", of words and numbers, or "quadratic", of numbers.
        factors: of a Gaussian process; None takes all that vary.
        logarithm: fit the metric's logarithm, as errors that grow with the value ask for.

    Raises:
        StudyError: too few variants, an unknown column, values not above 0 with `logarithm`, no scikit-learn.
    """
    if kind not in KINDS:
        raise StudyError(f"surrogate: kind {kind!r}: allowed are {', '.join(KINDS)}")
    values, errors = results.values(metric), standard_errors(results, metric)
    rows = results.rows_for(metric)
    if logarithm and not (values[rows] > 0.0).all():
        raise StudyError(f"surrogate of {metric!r}: a logarithm needs values above 0")
    if kind == "quadratic":
        from warpchain.study.analysis.robust import transformed

        taken = transformed(results, metric, "log") if logarithm else results
        return Surrogate(metric, kind, fit_quadratic(taken, metric), None, logarithm)
    features = features_of(results, factors)
    rows &= results.rows_for(metric, features.factors)
    columns = {
        name: [v for v, r in zip(results.table[name].to_pylist(), rows, strict=True) if r] for name in features.factors
    }
    y = values[rows]
    known = None if errors is None else errors[rows]
    if logarithm:
        known = None if known is None else known / y
        y = np.log(y)
    return Surrogate(metric, kind, fit_process(features.of(columns), y, known), features, logarithm)
