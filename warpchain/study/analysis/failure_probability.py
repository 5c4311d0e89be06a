"""Probability of failure by subset simulation, and the likeliest ways to fail.

Unknowns u are standard normal (D,) and fail where g(u) <= 0. The part p_j of samples is beyond each next threshold (Au
and Beck 2001), n_f of the last n fail:

    P = p_1 p_2 ... p_(m-1) (n_f / n).                                                                       (a)

Samples are chains of steps v = r u + sqrt(1 - r^2) x (Papaioannou et al. 2015). With m and s mean and deviation of
log P in R repetitions, t Student's of R - 1, 98 % (Olsson 2005),

    log P = m + s^2 / 2 +- t sqrt(s^2 / R + s^4 / (2 (R - 1))).                                              (b)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.results import Array

Margin = Callable[[Array], Array]
"""Margin g (N,) at points (N, D), above 0 within limits."""
LEVEL_SHARE = 0.1
ACCEPTANCE_RATE = 0.44
MOST_LEVELS = 12
MOST_BATCHES = 3
LEVEL_MESSAGE = (
    "the probability of failure is unknown: all {count} runs in one of {repeats} repetitions of subset simulation are "
    "equally far from the limit, so that nothing leads to failures; raise risk.count, or limit a metric that varies"
)
NOMINAL_LEVEL = 0.98
WAY_COSINE = 0.5
"""Cosine of the angle between ways to fail."""
FARTHEST_BEYOND = 2.0
MOST_DESIGN_POINTS = 8
DESIGN_POINT_STEPS = 4
LEAST_GAIN = 0.001


@dataclass(frozen=True)
class FailureEstimate:
    """Probability of failure with its interval."""

    probability: float
    low: float  # of the 95 % interval
    high: float
    evaluations: int  # of g
    failed: tuple[Array, ...]  # points that failed (F, D) of each repetition


def subset_simulation(margin: Margin, dimensions: int, count: int, repeats: int, seed: int) -> FailureEstimate:
    """Probability of failure by subset simulation, (a) and (b).

    Args:
        margin: g, called with up to repeats * count points.
        count: samples of a level and repetition, a multiple of 10.
        repeats: R, at least 3.

    Raises:
        StudyError: no failure within `MOST_LEVELS`, or all of `MOST_BATCHES` have the same g.
    """
    rng, seeds = np.random.default_rng(seed), round(LEVEL_SHARE * count)
    u = rng.standard_normal((repeats, count, dimensions))
    g = margin(u.reshape(-1, dimensions)).reshape(repeats, count)
    evaluations, logs, left = g.size, np.zeros(repeats), np.arange(repeats)
    batches = np.ones(repeats)  # of samples at a threshold
    failed: list[Array] = []
    for _ in range(MOST_LEVELS):
        limit = _next_thresholds(g[left], seeds)
        ended = limit <= 0.0
        beyond = g[left] <= np.where(ended, 0.0, limit)[:, None]
        level = beyond.all(axis=1) & ~ended
        if (batches[left] * level).max() == MOST_BATCHES:
            raise StudyError(LEVEL_MESSAGE.format(count=MOST_BATCHES * count, repeats=repeats))
        logs[left] += np.where(level, 0.0, np.log(beyond.mean(axis=1) / batches[left]))
        batches[left] = np.where(level, batches[left] + 1.0, 1.0)
        failed += [u[r][within] for r, within in zip(left[ended], beyond[ended], strict=True)]
        left, limit, beyond = left[~ended], limit[~ended], beyond[~ended]
        if not len(left):
            break
        chosen = np.array([_chosen_seeds(np.flatnonzero(within), seeds, rng) for within in beyond])
        start = np.take_along_axis(u[left], chosen[:, :, None], axis=1)
        of = np.take_along_axis(g[left], chosen, axis=1)
        u[left], g[left], more = _level_samples(margin, (start, of), limit, count // seeds, rng)
        evaluations += more
    if len(left):
        least = f"{LEVEL_SHARE**MOST_LEVELS:g}"
        if len(left) == repeats:
            raise StudyError(f"no failure within {MOST_LEVELS} levels: its probability is below {least}")
        raise StudyError(
            f"the probability of failure is unknown: {len(left)} of {repeats} repetitions of subset simulation come to "
            f"no failure within {MOST_LEVELS} levels, the others do; raise risk.count"
        )
    low, high = _lognormal_interval(logs)
    return FailureEstimate(float(np.clip(np.exp(logs).mean(), low, high)), low, high, evaluations, tuple(failed))


def _next_thresholds(g: Array, seeds: int) -> Array:
    """Thresholds (R,) of subset simulation's next level, by margins g (R, n)."""
    ordered = np.sort(g, axis=1)
    limit = ordered[:, seeds - 1]
    same = limit == ordered[:, -1]
    lower = np.where(g < limit[:, None], g, -np.inf).max(axis=1)
    return np.where(same & (ordered[:, 0] < limit), lower, limit)


def _chosen_seeds(places: NDArray[np.intp], count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Random choice of `count` seeds of subset simulation."""
    return rng.choice(places, count, replace=len(places) < count)


def _level_samples(
    margin: Margin, start: tuple[Array, Array], limit: Array, length: int, rng: np.random.Generator
) -> tuple[Array, Array, int]:
    """Samples of subset simulation's next level, their g, and evaluations.

    Args:
        start: first sample of each chain (R, seeds, D), and its g.
        limit: (R,) threshold.
    """
    u, g = start
    repeats, seeds, dimensions = u.shape
    points, margins, width = [u], [g], np.full(repeats, 0.6)
    for step in range(1, length):
        far = np.minimum(1.0, width)[:, None, None]
        v = np.sqrt(1.0 - far**2) * u + far * rng.standard_normal(u.shape)
        at = margin(v.reshape(-1, dimensions)).reshape(repeats, seeds)
        taken = at <= limit[:, None]
        u, g = np.where(taken[:, :, None], v, u), np.where(taken, at, g)
        width = width * np.exp((taken.mean(axis=1) - ACCEPTANCE_RATE) / np.sqrt(step))
        points.append(u)
        margins.append(g)
    return np.concatenate(points, axis=1), np.concatenate(margins, axis=1), repeats * seeds * (length - 1)


def _lognormal_interval(logs: Array) -> tuple[float, float]:
    """Interval of a failure probability by repetitions' logarithms, (b)."""
    from scipy.stats import t

    count, variance = len(logs), float(logs.var(ddof=1))
    center = float(logs.mean()) + 0.5 * variance
    half = t.ppf(0.5 + 0.5 * NOMINAL_LEVEL, count - 1) * np.sqrt(variance / count + variance**2 / (2.0 * (count - 1)))
    return float(np.exp(center - half)), float(min(1.0, np.exp(center + half)))


def design_points(margin: Margin, failed: Array) -> tuple[Array, int]:
    """Design points (K, D) of failure (Hasofer and Lind 1974), and evaluations of g."""
    points, evaluations = nearest_failures(failed), 0
    for _ in range(DESIGN_POINT_STEPS):
        stepped, more = _points_after_step(margin, points)
        evaluations += more
        before, after = np.linalg.norm(points, axis=1), np.linalg.norm(stepped[0], axis=1)
        better = stepped[1] & (after < before)
        settled = not (better & (after < (1.0 - LEAST_GAIN) * before)).any()
        points = nearest_failures(np.where(better[:, None], stepped[0], points))
        if settled:
            break
    return points, evaluations


def nearest_failures(points: Array) -> Array:
    """Failed points (K, D) nearest to the origin, one a direction."""
    sizes = np.linalg.norm(points, axis=1)
    left = np.argsort(sizes, kind="stable")
    left = left[sizes[left] <= sizes.min() + FARTHEST_BEYOND]
    found: list[int] = []
    while len(left) and len(found) < MOST_DESIGN_POINTS:
        first = left[0]
        found.append(first)
        left = left[points[left] @ points[first] < WAY_COSINE * sizes[left] * sizes[first]]
    return points[found]


def _points_after_step(margin: Margin, points: Array) -> tuple[tuple[Array, NDArray[np.bool_]], int]:
    """Points (K, D) a step nearer to design points, failures, evaluations."""
    count, dimensions = points.shape
    reach = 0.1
    around = points[:, None, :] + reach * np.vstack([np.zeros(dimensions), np.eye(dimensions), -np.eye(dimensions)])
    g = margin(around.reshape(-1, dimensions)).reshape(count, -1)
    slope = (g[:, 1 : dimensions + 1] - g[:, dimensions + 1 :]) / (2.0 * reach)
    square = (slope**2).sum(axis=1)
    with np.errstate(all="ignore"):
        target = ((slope * points).sum(axis=1) - g[:, 0])[:, None] / square[:, None] * slope
    target = np.where(np.isfinite(target).all(axis=1)[:, None], target, points)
    parts = np.array([1.0, 1.02, 1.1])  # a little beyond, should it fall short of the limit
    tried = np.concatenate([target[:, None] * parts[None, :, None], 0.5 * (points + target)[:, None]], axis=1)
    fails = margin(tried.reshape(-1, dimensions)).reshape(count, -1) <= 0.0
    size = np.where(fails, np.linalg.norm(tried, axis=2), np.inf)
    best = size.argmin(axis=1)
    return (tried[np.arange(count), best], np.asarray(fails.any(axis=1))), g.size + fails.size
