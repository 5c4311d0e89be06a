"""Intervals of probabilities of failure, counted on limit states whose probability is known in closed form."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from common.cases import Line, case, case_option, table_head

from warpchain.errors import StudyError
from warpchain.study.analysis.failure_probability import FailureEstimate, Margin, design_points, subset_simulation
from warpchain.study.analysis.importance_sampling import combined_estimate, fit_mixture, importance_sampling
from warpchain.study.results import Array


@dataclass(frozen=True)
class LimitState:
    """g of points (N, D), below 0 where it fails, with its dimensions D and its probability P."""

    margin: Margin
    dimensions: int
    probability: float


def plane_limit(probability: float, dimensions: int) -> LimitState:
    """g = beta - a u, |a| = 1: P is that of a standard normal below -beta."""
    from scipy.stats import norm

    beta = -norm.ppf(probability)
    return LimitState(lambda u: beta - u.sum(axis=1) / np.sqrt(dimensions), dimensions, probability)


def stepped_plane_limit(probability: float, dimensions: int, steps: float) -> LimitState:
    """The plane with g rounded up to whole 1 / steps: no slope, and the same failures."""
    smooth = plane_limit(probability, dimensions).margin
    return LimitState(lambda u: np.ceil(steps * smooth(u)) / steps, dimensions, probability)


def exponential_sum_limit(probability: float, dimensions: int) -> LimitState:
    """The sum of n exponentials is beyond its quantile, that of a gamma distribution of shape n."""
    from scipy.special import log_ndtr
    from scipy.stats import gamma

    most = gamma.isf(probability, dimensions)
    return LimitState(lambda u: most + log_ndtr(-u).sum(axis=1), dimensions, probability)


def sphere_limit(probability: float, dimensions: int) -> LimitState:
    """Fails outside a sphere: |u|^2 is chi-square of D degrees of freedom."""
    from scipy.stats import chi2

    radius = np.sqrt(chi2.isf(probability, dimensions))
    return LimitState(lambda u: radius - np.linalg.norm(u, axis=1), dimensions, probability)


def two_planes_limit(probability: float, dimensions: int) -> LimitState:
    """Two design points: fails beyond either of two parallel planes, half of P each."""
    from scipy.stats import norm

    beta = -norm.ppf(0.5 * probability)
    return LimitState(lambda u: beta - np.abs(u[:, 0]), dimensions, probability)


def corner_limit(probability: float, dimensions: int) -> LimitState:
    """Two design points: fails beyond either of two planes at a right angle, P = 1 - (1 - p)^2."""
    from scipy.stats import norm

    beta = -norm.ppf(1.0 - np.sqrt(1.0 - probability))
    return LimitState(lambda u: beta - u[:, :2].max(axis=1), dimensions, probability)


def four_branches_limit() -> LimitState:
    """The series system of four branches (Waarts 2000), k = 3 and 6.

    P is the integral over x along (x + y) / sqrt 2, in closed form across, by quadrature.
    """
    from scipy.stats import norm

    def margin(u: Array) -> Array:
        """Margin (N,) to the nearest of four branches at places u (N, 2); failure below 0."""
        x, y = u.T
        along, across = (x + y) / np.sqrt(2.0), 0.1 * (x - y) ** 2
        far = 6.0 / np.sqrt(2.0)
        return np.asarray(np.min([3.0 + across - along, 3.0 + across + along, x - y + far, y - x + far], axis=0))

    t = np.linspace(-9.0, 9.0, 200_001)  # (x - y) / sqrt 2
    kept = norm.cdf(3.0 + 0.2 * t**2) - norm.cdf(-3.0 - 0.2 * t**2)
    probability = 1.0 - float(np.trapezoid(np.where(np.abs(t) < 3.0, kept, 0.0) * norm.pdf(t), t))
    return LimitState(margin, 2, probability)


SHAPES = {
    "plane, D = 2": partial(plane_limit, dimensions=2),
    "plane, D = 5": partial(plane_limit, dimensions=5),
    "plane, D = 20": partial(plane_limit, dimensions=20),
    "plane in steps of 0.5, D = 5": partial(stepped_plane_limit, dimensions=5, steps=2.0),
    "plane in steps of 1, D = 5": partial(stepped_plane_limit, dimensions=5, steps=1.0),
    **{f"sum of {n} exponentials": partial(exponential_sum_limit, dimensions=n) for n in (2, 5, 10, 20)},
    **{f"sphere, D = {n}": partial(sphere_limit, dimensions=n) for n in (2, 5, 10)},
    "two planes, opposite, D = 5": partial(two_planes_limit, dimensions=5),
    "two planes, right angle, D = 5": partial(corner_limit, dimensions=5),
}
"""Limit states of any probability, by name."""
PROBABILITIES = (1e-3, 1e-5)
LIMIT_STATES: dict[str, Callable[[], LimitState]] = {
    f"{name}; {p:g}": partial(shape, p) for p in PROBABILITIES for name, shape in SHAPES.items()
}
LIMIT_STATES |= {f"plane, D = 5; {p:g}": partial(plane_limit, p, 5) for p in (1e-2, 1e-4, 1e-6)}
LIMIT_STATES["four branches"] = four_branches_limit
"""All of them, by name."""


@dataclass(frozen=True)
class Trial:
    """Result of one seed: both estimates and the joint one, each in words where there is none, and the runs of the
    search for design points, with the number of these."""

    subset: FailureEstimate | str
    sampled: FailureEstimate | str
    joint: FailureEstimate | str
    search: int = 0
    points: int = 0


def risk_trial(state: LimitState, seed: int, count: int = 200, repeats: int = 8, samples: int = 1000) -> Trial:
    """The estimates of `warpchain risk` for a limit state."""
    try:
        subset = subset_simulation(state.margin, state.dimensions, count, repeats, seed)
    except StudyError as error:
        return Trial(str(error), str(error), str(error))
    sampled: FailureEstimate | str
    try:
        sampled = importance_sampling(state.margin, fit_mixture(subset.failed), samples, seed)
    except StudyError as error:
        sampled = str(error)
    found = subset.failed if isinstance(sampled, str) else (*subset.failed, *sampled.failed)
    points, search = design_points(state.margin, np.vstack(found))
    return Trial(subset, sampled, combined_estimate(subset, sampled), search, len(points))


def coverage_row(found: list[FailureEstimate | str], probability: float) -> tuple[int, int, float]:
    """Intervals that hold P, estimates that are unknown, and the median of high over low."""
    known = [one for one in found if not isinstance(one, str)]
    inside = sum(one.low <= probability <= one.high for one in known)
    width = float(np.median([one.high / one.low for one in known])) if known else float("nan")
    return inside, len(found) - len(known), width


@case(
    case_option(
        "names", metavar="NAME", nargs="*", default=list(LIMIT_STATES), help="limit states, all if none is given"
    ),
    case_option("--seeds", type=int, default=200),
    case_option("--count", type=int, default=200, help="risk.count"),
    case_option("--repeats", type=int, default=8, help="risk.repeats"),
    case_option("--samples", type=int, default=1000, help="risk.samples"),
)
def failure(asked: argparse.Namespace) -> Iterator[Line]:
    """Do intervals of a probability of failure hold the true one? Limit states whose probability is known.

    python scripts/bench.py failure --seeds 200

    Of each method: intervals that hold P / estimates that are known, and the median of the intervals' high / low.
    """
    words = "limit state; P | subset simulation | high / low | importance sampling | high / low | "
    yield table_head(f"{words}P as reported | high / low | runs: subset | samples | design points")
    for name in asked.names:
        state = LIMIT_STATES[name]()
        trials = [risk_trial(state, seed, asked.count, asked.repeats, asked.samples) for seed in range(asked.seeds)]
        cells: list[str] = []
        for found in ([t.subset for t in trials], [t.sampled for t in trials], [t.joint for t in trials]):
            inside, unknown, width = coverage_row(list(found), state.probability)
            cells += [f"{inside} of {len(found) - unknown}", f"{width:.3g}"]
        runs = np.mean([t.subset.evaluations for t in trials if not isinstance(t.subset, str)])
        yield (name, *cells, f"{runs:.0f}", asked.samples, f"{np.mean([t.search for t in trials]):.0f}")
