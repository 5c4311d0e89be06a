"""Analysis of a study's results: effects, correlations, surfaces, Sobol' indices, Pareto fronts."""

from warpchain.study.analysis.effects import (
    Correlation,
    Effect,
    correlation,
    main_effects,
)
from warpchain.study.analysis.pure_error import PureError, pure_error, pure_errors

__all__ = [
    "Correlation",
    "Effect",
    "PureError",
    "correlation",
    "main_effects",
    "pure_error",
    "pure_errors",
]
