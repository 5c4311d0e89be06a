"""What a metric would be where nothing was run, and how sure that is."""

from warpchain.study.surrogate.model import KINDS, Surrogate, fit_surrogate
from warpchain.study.surrogate.validation import CrossValidation

__all__ = [
    "KINDS",
    "CrossValidation",
    "Surrogate",
    "fit_surrogate",
]
