"""Small probabilities of failure: subset simulation, and importance sampling about the likeliest ways to fail.

What is uncertain is u, standard normal (D,); it fails where g(u) <= 0. Subset simulation (Au and Beck 2001) goes
through thresholds b_1 > b_2 > ... > 0, each of which the p0-th part of the samples beyond the one before is beyond:

    P = p0^(m-1) (n_f / n),                                                                                  (a)

n_f of n samples of the last level failing. Samples of a level are chains from those of the level before, whose steps
v = r u + sqrt(1 - r^2) x, x standard normal, keep the normal distribution; one is taken where g(v) <= b (Papaioannou
et al. 2015), r such that 44 % are. R independent repetitions, run side by side so that a step is one batch, are
log-normal; P is their mean, and with m and s the mean and deviation of their logarithms (Cox's interval, Olsson 2005)

    log P = m + s^2 / 2 +- t sqrt(s^2 / R + s^4 / (2 (R - 1))),      t Student's of R - 1.                   (b)

Importance sampling draws from q, normal distributions of deviation 1 about design points, the likeliest failures in
directions that differ, and adds up P = mean(phi(u) / q(u), failing), whose interval is of the mean's logarithm.

Deviations that are estimated from few repetitions are uncertain, too: t is of 98 %, which covers 95 % on closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.results import Array

Margin = Callable[[Array], Array]
"""g of points (N, D), (N,): above 0 where limits are kept."""
SHARE = 0.1
"""p0."""
ACCEPTED = 0.44
MOST_LEVELS = 12
"""Levels after which a probability is below what is looked for."""
NOMINAL = 0.98
APART = 0.5
"""Cosine below which two directions are different ways to fail."""
BEYOND = 2.0
"""Design points that are farther out than the nearest by more than this add next to nothing."""
MOST_POINTS = 8
TURNS = 4
"""Steps towards a design point."""


@dataclass(frozen=True)
class Estimate:
    """A probability of failure.

    Attributes:
        probability: P.
        low, high: its 95 % interval.
        evaluations: of g.
        failed: (F, D) points that failed.
    """

    probability: float
    low: float
    high: float
    evaluations: int
    failed: Array


def subset_simulation(margin: Margin, dimensions: int, count: int, repeats: int, seed: int) -> Estimate:
    """P by subset simulation, eq. (a) and (b).

    Args:
        margin: g; called with batches of up to repeats * count points.
        dimensions: D.
        count: samples of a level and repetition; a multiple of 10.
        repeats: R, at least 3.
        seed: of the draws.

    Raises:
        StudyError: after `MOST_LEVELS` levels no repetition comes to failure.
    """
    rng, seeds = np.random.default_rng(seed), round(SHARE * count)
    u = rng.standard_normal((repeats, count, dimensions))
    g = margin(u.reshape(-1, dimensions)).reshape(repeats, count)
    evaluations, logs = g.size, np.full(repeats, np.nan)
    failed: list[Array] = []
    for level in range(MOST_LEVELS):
        order = np.argsort(g, axis=1, kind="stable")
        limit = np.take_along_axis(g, order, axis=1)[:, seeds - 1]
        ended = np.isnan(logs) & (limit <= 0.0)
        for r in np.flatnonzero(ended):
            logs[r] = level * np.log(SHARE) + np.log((g[r] <= 0.0).mean())
            failed.append(u[r][g[r] <= 0.0])
        left = np.flatnonzero(np.isnan(logs))
        if not len(left):
            break
        chosen = order[left, :seeds]
        start = np.take_along_axis(u[left], chosen[:, :, None], axis=1)
        of = np.take_along_axis(g[left], chosen, axis=1)
        u[left], g[left], more = _chains(margin, (start, of), limit[left], count // seeds, rng)
        evaluations += more
    if not failed:
        raise StudyError(f"no failure within {MOST_LEVELS} levels: its probability is below {SHARE**MOST_LEVELS:g}")
    logs = np.where(np.isnan(logs), MOST_LEVELS * np.log(SHARE), logs)
    low, high = _interval(logs)
    return Estimate(float(np.clip(np.exp(logs).mean(), low, high)), low, high, evaluations, np.vstack(failed))


def _chains(
    margin: Margin, start: tuple[Array, Array], limit: Array, length: int, rng: np.random.Generator
) -> tuple[Array, Array, int]:
    """Samples of the next level (R, seeds * length, D), their g, and how often g was evaluated.

    Args:
        start: the first sample of each chain (R, seeds, D), and g there.
        limit: (R,) threshold.
        length: of a chain.
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
        width = width * np.exp((taken.mean(axis=1) - ACCEPTED) / np.sqrt(step))
        points.append(u)
        margins.append(g)
    return np.concatenate(points, axis=1), np.concatenate(margins, axis=1), repeats * seeds * (length - 1)


def _interval(logs: Array) -> tuple[float, float]:
    """Interval of P by its logarithms in repetitions, eq. (b)."""
    from scipy.stats import t

    count, variance = len(logs), float(logs.var(ddof=1))
    center = float(logs.mean()) + 0.5 * variance
    half = t.ppf(0.5 + 0.5 * NOMINAL, count - 1) * np.sqrt(variance / count + variance**2 / (2.0 * (count - 1)))
    return float(np.exp(center - half)), float(min(1.0, np.exp(center + half)))


def design_points(margin: Margin, failed: Array) -> tuple[Array, int]:
    """The likeliest failures in directions that differ (K, D), nearest to the origin first, and evaluations of g.

    From the nearest of the points that failed in each direction, steps of the method of Hasofer, Lind, Rackwitz and
    Fiessler with slopes by differences, all in one batch; a step counts where it fails nearer to the origin.

    Args:
        margin: g.
        failed: (F, D) points that failed.
    """
    points, evaluations = _apart(failed), 0
    for _ in range(TURNS):
        stepped, more = _stepped(margin, points)
        evaluations += more
        better = stepped[1] & (np.linalg.norm(stepped[0], axis=1) < np.linalg.norm(points, axis=1))
        points = np.where(better[:, None], stepped[0], points)
        if not better.any():
            break
    return _apart(points), evaluations


def _apart(points: Array) -> Array:
    """The nearest of points (N, D) in each direction, nearest to the origin first."""
    order = points[np.argsort(np.linalg.norm(points, axis=1), kind="stable")]
    found: list[Array] = []
    nearest = float(np.linalg.norm(order[0]))
    for point in order:
        size = float(np.linalg.norm(point))
        if size > nearest + BEYOND or len(found) == MOST_POINTS:
            break
        if all(point @ other < APART * size * np.linalg.norm(other) for other in found):
            found.append(point)
    return np.array(found)


def _stepped(margin: Margin, points: Array) -> tuple[tuple[Array, NDArray[np.bool_]], int]:
    """Points (K, D) after a step towards the origin along the limit, whether they fail, and evaluations of g."""
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


def importance_sampling(margin: Margin, points: Array, count: int, seed: int) -> Estimate:
    """P by sampling about design points (K, D); `count` samples in one batch.

    Raises:
        StudyError: no sample failed.
    """
    from scipy.special import logsumexp
    from scipy.stats import norm

    rng, (several, dimensions) = np.random.default_rng(seed), points.shape
    place = np.arange(count) % several  # as many about each
    u = points[place] + rng.standard_normal((count, dimensions))
    fails = margin(u) <= 0.0
    if not fails.any():
        raise StudyError("importance sampling: no sample failed; give risk.samples more")
    each = -0.5 * ((u[:, None, :] - points[None]) ** 2).sum(axis=2)
    weight = np.where(fails, np.exp(-0.5 * (u**2).sum(axis=1) - logsumexp(each, axis=1) + np.log(several)), 0.0)
    mean = float(weight.mean())
    inside = sum(float(weight[place == k].var(ddof=1)) * float((place == k).mean()) for k in range(several))
    part = np.sqrt(inside / count) / mean
    half = norm.ppf(0.5 + 0.5 * NOMINAL) * np.sqrt(np.log1p(part**2))
    return Estimate(mean, mean * np.exp(-half), min(1.0, mean * np.exp(half)), count, u[fails])
