"""Mean of paired differences with an interval that may be looked at after every pair.

The interval after n pairs is that of a confidence sequence: all of its intervals together hold the mean with the level
1 - alpha, so that one may stop at any of them. With mean m and deviation s of n differences, and the effect mu / sigma
normal with variance 1 / L beforehand, the likelihood of a mean mu against all others is a martingale of the statistic
t = (m - mu) sqrt(n) / s alone (Lai 1976; Lindon et al. 2022, arXiv:2210.08589; Wang and Ramdas 2024, arXiv:2310.03722),

    B = sqrt(k) ((1 + k x) / (1 + x))^(-n/2),   k = L / (L + n),   x = t^2 / (n - 1),                         (a)

which reaches 1 / alpha with a probability of alpha at most (Ville 1939). Solved for t,

    mean = m +- s / sqrt(n) sqrt((n - 1) (1 - r) / (r - k)),   r = (alpha^2 k)^(1/n).                         (b)

It is exact for normal differences, and asymptotic for others with a variance, for which (b) tends to the asymptotic
confidence sequence of Waudby-Smith et al. (2021, arXiv:2103.06476). Skewed ones are slow to get
there: below n = 25 G^2, G their skewness (Cochran 1977, sec. 2.15), the interval is wider by 25 G^2 / n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpchain.study.results import Array

BEFOREHAND = 1.0
"""L."""
LEAST = 16
"""Fewest pairs that tell a sign, since few differences do not show how they are distributed."""
SKEWED = 25.0
"""Pairs for a squared skewness of 1 from which on the interval is not wider."""
FARTHEST = 100_000
"""Most pairs that are forecast."""


@dataclass(frozen=True)
class MeanDifference:
    """Mean of paired differences.

    Attributes:
        pairs: number of them, n.
        mean: m.
        deviation: s.
        skewness: G.
        half: half width of the interval; infinite where n is too small for one.
        level: 1 - alpha.
    """

    pairs: int
    mean: float
    deviation: float
    skewness: float
    half: float
    level: float

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.mean - self.half

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.mean + self.half

    @property
    def sign(self) -> int:
        """-1 or 1 where the sign of the mean is sure, else 0."""
        return int(self.low > 0.0) - int(self.high < 0.0) if self.pairs >= LEAST else 0

    def pairs_needed(self) -> int | None:
        """Pairs after which the sign would be sure if mean and deviation stayed; None beyond `FARTHEST`."""
        count = np.arange(LEAST, FARTHEST + 1)
        enough = np.flatnonzero(half_width(count, self.deviation, self.skewness, self.level) < abs(self.mean))
        return int(count[enough[0]]) if len(enough) else None


def mean_difference(differences: Array, level: float) -> MeanDifference:
    """The mean of differences (n,), n >= 2, with its interval at a level, eq. (b)."""
    n, mean, deviation = len(differences), float(differences.mean()), float(differences.std(ddof=1))
    off = (differences - mean) / (deviation or 1.0)
    skewness = float((off**3).mean())
    return MeanDifference(n, mean, deviation, skewness, float(half_width(n, deviation, skewness, level)), level)


def half_width(n: Any, deviation: float, skewness: float, level: float) -> Array:
    """Half width of the interval after n pairs, n >= 2, of differences with a deviation and skewness, eq. (b)."""
    k = BEFOREHAND / (BEFOREHAND + n)
    power = (2.0 * np.log1p(-level) + np.log(k)) / n
    room = np.maximum(np.exp(power) - k, 0.0)
    with np.errstate(divide="ignore"):
        t = np.sqrt((n - 1) * -np.expm1(power) / room)
    wider = np.maximum(1.0, SKEWED * skewness**2 / n)
    return np.asarray(deviation * t / np.sqrt(n) * wider if deviation > 0.0 else np.zeros(np.shape(n)))
