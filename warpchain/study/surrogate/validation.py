"""How well a surrogate meets what it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpchain.study.results import Array


@dataclass(frozen=True)
class CrossValidation:
    """Each row as the others predict it.

    Attributes:
        observed: (R,) the metric as it was run.
        predicted: (R,) what the surrogate of the other rows says.
        deviation: (R,) standard deviation of what a run would give there.
    """

    observed: Array
    predicted: Array
    deviation: Array

    @property
    def q2(self) -> float:
        """Part of the variance that is predicted [-]; 1 is perfect, 0 no better than the mean."""
        total = float(((self.observed - self.observed.mean()) ** 2).sum())
        return 1.0 - float(((self.observed - self.predicted) ** 2).sum()) / total if total > 0.0 else 1.0

    @property
    def rmse(self) -> float:
        """Root mean square error, in the metric's unit."""
        return float(np.sqrt(np.mean((self.observed - self.predicted) ** 2)))

    @property
    def coverage(self) -> float:
        """Part of the rows within 1.96 standard deviations [-]; 0.95 where these are right."""
        return float(np.mean(np.abs(self.observed - self.predicted) <= 1.96 * self.deviation))
