"""What a study's results say: effects, correlations, surfaces, Sobol' indices, Pareto fronts."""

from warpchain.study.analysis.effects import (
    Correlation,
    Effect,
    correlation,
    main_effects,
)

__all__ = [
    "Correlation",
    "Effect",
    "correlation",
    "main_effects",
]
