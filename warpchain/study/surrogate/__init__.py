"""Surrogates: a metric where nothing was run, with its standard deviation."""

from warpchain.study.surrogate.model import KINDS, CrossValidation, Surrogate, best_surrogate, fit_surrogate

__all__ = [
    "KINDS",
    "CrossValidation",
    "Surrogate",
    "best_surrogate",
    "fit_surrogate",
]
