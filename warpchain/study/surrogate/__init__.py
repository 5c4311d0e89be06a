"""Surrogates: a metric where nothing was run, with its standard deviation."""

from warpchain.study.surrogate.surrogate_model import (
    SURROGATE_KINDS,
    CrossValidation,
    Surrogate,
    best_surrogate,
    fit_surrogate,
)

__all__ = [
    "SURROGATE_KINDS",
    "CrossValidation",
    "Surrogate",
    "best_surrogate",
    "fit_surrogate",
]
