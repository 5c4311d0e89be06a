"""Mean of paired differences with an interval that may be looked at after every pair.

After each of n pairs the interval holds the mean, at the level 1 - alpha for all n together. With mean m and deviation
s of n differences, and mu / sigma a priori normal with variance 1 / L, the likelihood of mu against others is a
martingale of t = (m - mu) sqrt(n) / s (Wang and Ramdas 2024, arXiv:2310.03722),

    B = sqrt(k) ((1 + k x) / (1 + x))^(-n/2),   k = L / (L + n),   x = t^2 / (n - 1),                         (a)

which reaches 1 / alpha with probability alpha at most (Ville 1939):

    mean = m +- s / sqrt(n) sqrt((n - 1) (1 - r) / (r - k)),   r = (alpha^2 k)^(1/n),                         (b)

wider below n = 25 G^2, G the skewness (Cochran 1977, sec. 2.15). At 1 - alpha, the pairs miss no event likelier than
(Hanley and Lippman-Hand 1983)

    q = 1 - alpha^(1/n).                                                                                     (c)

If rare events change a difference by e at most, the sign is sure where abs(m) exceeds (b) plus q e.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpchain.study.results import Array

PRIOR_PRECISION = 1.0
FEWEST_PAIRS = 16
SKEWNESS_PAIRS = 25.0
EVENT_DEVIATIONS = 20.0
"""Change by rare events, in deviations, if not given."""
HEAVY_TAIL_PAIRS = 16
MOST_FORECAST_PAIRS = 100_000


@dataclass(frozen=True)
class MeanDifference:
    """Mean of paired differences, with its interval and sign."""

    pairs: int  # n
    mean: float  # m
    deviation: float  # s
    skewness: float  # G
    half: float  # half width of the interval; infinite if n is too small
    level: float  # 1 - alpha
    largest: float  # deviation of a difference from the mean
    carriers: int  # fewest pairs that make up half of the squared deviations
    reckoned: float  # change e by rare events that a sure sign allows for, at least `largest`

    @property
    def interval_low(self) -> float:
        """Lower end of the mean difference's interval, (b)."""
        return self.mean - self.half

    @property
    def interval_high(self) -> float:
        """Upper end of the mean difference's interval, (b)."""
        return self.mean + self.half

    @property
    def shown_sign(self) -> int:
        """Sign of the mean difference that pairs show, or 0."""
        return self._sign_beyond(self.largest, self.level)

    @property
    def sure_sign(self) -> int:
        """Sign of the mean difference despite rare events, or 0."""
        return self._sign_beyond(self.reckoned, _level_of_half(self.level))

    @property
    def missed_probability(self) -> float:
        """Probability of the likeliest event that pairs miss, (c)."""
        return float(missed_event_probability(self.pairs, _level_of_half(self.level)))

    @property
    def reversing_change(self) -> float:
        """Change by missed events that reverses the mean difference."""
        return (
            max(abs(self.mean) - float(self._sure_margin(self.pairs, 0.0, _level_of_half(self.level))), 0.0)
            / self.missed_probability
        )

    def _sign_beyond(self, event: float, level: float) -> int:
        """Sign of the mean difference beyond its sure margin, or 0."""
        beyond = abs(self.mean) > self._sure_margin(self.pairs, event, level)
        return int(np.sign(self.mean)) if self.pairs >= FEWEST_PAIRS and beyond else 0

    def _sure_margin(self, count: Any, event: float, level: float) -> Array:
        """Mean difference whose sign is sure for `count` pairs."""
        return (
            interval_half_width(count, self.deviation, self.skewness, level)
            + missed_event_probability(count, level) * event
        )

    @property
    def is_heavy_tailed(self) -> bool:
        """Whether few pairs make half of the differences' scatter."""
        return self.deviation > 0.0 and self.carriers * HEAVY_TAIL_PAIRS <= self.pairs

    def pairs_needed(self) -> int | None:
        """Number of pairs for a sure sign, or None."""
        count = np.arange(FEWEST_PAIRS, MOST_FORECAST_PAIRS + 1)
        margin = self._sure_margin(count, self.reckoned, _level_of_half(self.level))
        enough = np.flatnonzero(margin < abs(self.mean))
        return int(count[enough[0]]) if len(enough) else None


def mean_difference(differences: Array, level: float, event: float | None = None) -> MeanDifference:
    """Mean of paired differences (n,), with its interval.

    Args:
        level: of the interval, (b), and of the sign.
        event: change of a difference by rare events.
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
        half=float(interval_half_width(n, deviation, skewness, level)),
        level=level,
        largest=largest,
        carriers=int((squares < 0.5 * squares[-1]).sum()) + 1,
        reckoned=max(largest, EVENT_DEVIATIONS * deviation if event is None else event),
    )


def _level_of_half(level: float) -> float:
    """Confidence level whose alpha is half a level's."""
    return 0.5 * (1.0 + level)


def missed_event_probability(n: Any, level: float) -> Array:
    """Probability of the likeliest event that n pairs miss, (c)."""
    return np.asarray(-np.expm1(np.log1p(-level) / n))


def interval_half_width(n: Any, deviation: float, skewness: float, level: float) -> Array:
    """Half width of a mean difference's interval, (b)."""
    k = PRIOR_PRECISION / (PRIOR_PRECISION + n)
    power = (2.0 * np.log1p(-level) + np.log(k)) / n
    room = np.maximum(np.exp(power) - k, 0.0)
    with np.errstate(divide="ignore"):
        t = np.sqrt((n - 1) * -np.expm1(power) / room)
    wider = np.maximum(1.0, SKEWNESS_PAIRS * skewness**2 / n)
    return np.asarray(deviation * t / np.sqrt(n) * wider if deviation > 0.0 else np.zeros(np.shape(n)))
