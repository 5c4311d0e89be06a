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

What no pair had, no statistic of the pairs sees. An event of probability p is missing from all n with (1 - p)^n. With
1 - alpha, none is missing that is likelier than

    q = 1 - alpha^(1/n),                                                                                     (c)

at all n together, as what was there stays there; q is near 3 / n at alpha = 0.05 (Hanley and Lippman-Hand 1983). If
rare events change a difference by e at most, those that are missing shift the mean by q e at most. So its sign is sure
where abs(m) is more than the half width of (b) and q e together, each at alpha / 2. Nothing in the pairs says e, but it
is no less than the largest deviation of a difference from m, as that was there; with this e, the pairs show the sign.
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
EVENT = 20.0
"""Deviations of the differences by which rare events are reckoned to change one, where nothing else is known."""
HEAVY = 16
"""Tails are heavy where fewer than one of so many pairs makes up half of the scatter; of normal ones it is one of 8."""
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
        largest: largest deviation of a difference from the mean.
        carriers: fewest pairs that make up half of the scatter, the sum of squared deviations.
        reckoned: change of a difference by rare events that a sure sign reckons with, e; at least `largest`.
    """

    pairs: int
    mean: float
    deviation: float
    skewness: float
    half: float
    level: float
    largest: float
    carriers: int
    reckoned: float

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
        """-1 or 1 where the pairs show the sign of the mean, else 0: sure but for events larger than all they had."""
        return self._sign(self.largest, self.level)

    @property
    def sure(self) -> int:
        """-1 or 1 where the sign of the mean is sure, also if pairs missed events as large as `reckoned`; else 0."""
        return self._sign(self.reckoned, _half_each(self.level))

    @property
    def rarest(self) -> float:
        """Probability of the likeliest event that the pairs may have missed, q of eq. (c), as `sure` reckons."""
        return float(missing(self.pairs, _half_each(self.level)))

    @property
    def reversal(self) -> float:
        """Change of a difference beyond which missed events could reverse the sign; 0 where it is open without."""
        return max(abs(self.mean) - float(self._margin(self.pairs, 0.0, _half_each(self.level))), 0.0) / self.rarest

    def _sign(self, event: float, level: float) -> int:
        beyond = abs(self.mean) > self._margin(self.pairs, event, level)
        return int(np.sign(self.mean)) if self.pairs >= LEAST and beyond else 0

    def _margin(self, count: Any, event: float, level: float) -> Array:
        """Least distance from 0 of a sure mean of so many pairs, with this scatter and events of such a size."""
        return half_width(count, self.deviation, self.skewness, level) + missing(count, level) * event

    @property
    def heavy(self) -> bool:
        """Whether few of the pairs make up half of the scatter."""
        return self.deviation > 0.0 and self.carriers * HEAVY <= self.pairs

    def pairs_needed(self) -> int | None:
        """Pairs after which the sign would be sure if mean and scatter stayed; None beyond `FARTHEST`."""
        count = np.arange(LEAST, FARTHEST + 1)
        margin = self._margin(count, self.reckoned, _half_each(self.level))
        enough = np.flatnonzero(margin < abs(self.mean))
        return int(count[enough[0]]) if len(enough) else None


def mean_difference(differences: Array, level: float, event: float | None = None) -> MeanDifference:
    """The mean of differences, with its interval.

    Args:
        differences: (n,), n >= 2.
        level: of the interval, eq. (b), and of what is told of the sign.
        event: change of a difference by rare events that a sure sign reckons with, at least; None takes `EVENT`
            deviations.
    """
    n, mean, deviation = len(differences), float(differences.mean()), float(differences.std(ddof=1))
    off = differences - mean
    skewness = float(((off / (deviation or 1.0)) ** 3).mean())
    squares, largest = np.cumsum(np.sort(off**2)[::-1]), float(np.abs(off).max())
    return MeanDifference(
        pairs=n,
        mean=mean,
        deviation=deviation,
        skewness=skewness,
        half=float(half_width(n, deviation, skewness, level)),
        level=level,
        largest=largest,
        carriers=int((squares < 0.5 * squares[-1]).sum()) + 1,
        reckoned=max(largest, EVENT * deviation if event is None else event),
    )


def _half_each(level: float) -> float:
    """The level at half of alpha."""
    return 0.5 * (1.0 + level)


def missing(n: Any, level: float) -> Array:
    """Probability of the likeliest event that n pairs may have missed, eq. (c)."""
    return np.asarray(-np.expm1(np.log1p(-level) / n))


def half_width(n: Any, deviation: float, skewness: float, level: float) -> Array:
    """Half width of the interval after n pairs, n >= 2, of differences with a deviation and skewness, eq. (b)."""
    k = BEFOREHAND / (BEFOREHAND + n)
    power = (2.0 * np.log1p(-level) + np.log(k)) / n
    room = np.maximum(np.exp(power) - k, 0.0)
    with np.errstate(divide="ignore"):
        t = np.sqrt((n - 1) * -np.expm1(power) / room)
    wider = np.maximum(1.0, SKEWED * skewness**2 / n)
    return np.asarray(deviation * t / np.sqrt(n) * wider if deviation > 0.0 else np.zeros(np.shape(n)))
