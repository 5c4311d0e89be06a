"""Small probabilities of failure by subset simulation, and the likeliest ways to fail.

What is uncertain is u, standard normal (D,); it fails where g(u) <= 0. Subset simulation (Au and Beck 2001) goes
through thresholds b_1 > b_2 > ... > 0. Of the samples beyond one, the part p_j is at or beyond the next, a tenth, or
more where g has steps and many are equal:

    P = p_1 p_2 ... p_(m-1) (n_f / n),                                                                       (a)

n_f of n samples of the last level failing. Samples of a level are chains from those of the level before, drawn from all
that are at or beyond its threshold; while these all have the same g, more are drawn, and p_j is a part of all. Their
steps v = r u + sqrt(1 - r^2) x, x standard normal, keep the normal distribution; one is taken where g(v) <= b
(Papaioannou et al. 2015), r such that 44 % are. R independent repetitions, run side by side so that a step is one
batch, are log-normal; P is their mean, and with m and s the mean and deviation of their logarithms (Cox's interval,
Olsson 2005)

    log P = m + s^2 / 2 +- t sqrt(s^2 / R + s^4 / (2 (R - 1))),      t Student's of R - 1.                   (b)

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
MOST_BATCHES = 3
"""Batches of samples that may have the same g."""
LEVEL = (
    "the probability of failure is unknown: all {count} runs in one of {repeats} repetitions of subset simulation are "
    "equally far from the limit, so that nothing leads to failures; raise risk.count, or limit a metric that varies"
)
NOMINAL = 0.98
APART = 0.5
"""Cosine below which two directions are different ways to fail."""
BEYOND = 2.0
"""Design points that are farther out than the nearest by more than this add next to nothing."""
MOST_POINTS = 8
TURNS = 4
"""Steps towards a design point."""
NEARER = 0.001
"""Part of its distance by which a step must be nearer for another one."""


@dataclass(frozen=True)
class Estimate:
    """A probability of failure.

    Attributes:
        probability: P.
        low, high: its 95 % interval.
        evaluations: of g.
        failed: points that failed (F, D), of each repetition that came to failure.
    """

    probability: float
    low: float
    high: float
    evaluations: int
    failed: tuple[Array, ...]


def subset_simulation(margin: Margin, dimensions: int, count: int, repeats: int, seed: int) -> Estimate:
    """P by subset simulation, eq. (a) and (b).

    Args:
        margin: g; called with batches of up to repeats * count points.
        dimensions: D.
        count: samples of a level and repetition; a multiple of 10.
        repeats: R, at least 3.
        seed: of the draws.

    Raises:
        StudyError: there is no estimate, as a repetition does not come to failure within `MOST_LEVELS` levels, or as
            all samples of `MOST_BATCHES` have the same g.
    """
    rng, seeds = np.random.default_rng(seed), round(SHARE * count)
    u = rng.standard_normal((repeats, count, dimensions))
    g = margin(u.reshape(-1, dimensions)).reshape(repeats, count)
    evaluations, logs, left = g.size, np.zeros(repeats), np.arange(repeats)
    batches = np.ones(repeats)  # of samples at a threshold
    failed: list[Array] = []
    for _ in range(MOST_LEVELS):
        limit = _thresholds(g[left], seeds)
        ended = limit <= 0.0
        beyond = g[left] <= np.where(ended, 0.0, limit)[:, None]
        level = beyond.all(axis=1) & ~ended
        if (batches[left] * level).max() == MOST_BATCHES:
            raise StudyError(LEVEL.format(count=MOST_BATCHES * count, repeats=repeats))
        logs[left] += np.where(level, 0.0, np.log(beyond.mean(axis=1) / batches[left]))
        batches[left] = np.where(level, batches[left] + 1.0, 1.0)
        failed += [u[r][within] for r, within in zip(left[ended], beyond[ended], strict=True)]
        left, limit, beyond = left[~ended], limit[~ended], beyond[~ended]
        if not len(left):
            break
        chosen = np.array([_drawn(np.flatnonzero(within), seeds, rng) for within in beyond])
        start = np.take_along_axis(u[left], chosen[:, :, None], axis=1)
        of = np.take_along_axis(g[left], chosen, axis=1)
        u[left], g[left], more = _chains(margin, (start, of), limit, count // seeds, rng)
        evaluations += more
    if len(left):
        least = f"{SHARE**MOST_LEVELS:g}"
        if len(left) == repeats:
            raise StudyError(f"no failure within {MOST_LEVELS} levels: its probability is below {least}")
        raise StudyError(
            f"the probability of failure is unknown: {len(left)} of {repeats} repetitions of subset simulation come to "
            f"no failure within {MOST_LEVELS} levels, the others do; raise risk.count"
        )
    low, high = _interval(logs)
    return Estimate(float(np.clip(np.exp(logs).mean(), low, high)), low, high, evaluations, tuple(failed))


def _thresholds(g: Array, seeds: int) -> Array:
    """The next threshold (R,) of samples with g (R, n), which `seeds` of them are at or beyond.

    Where that is all of them, as g has a step there, the next lower value.
    """
    ordered = np.sort(g, axis=1)
    limit = ordered[:, seeds - 1]
    same = limit == ordered[:, -1]
    lower = np.where(g < limit[:, None], g, -np.inf).max(axis=1)
    return np.where(same & (ordered[:, 0] < limit), lower, limit)


def _drawn(places: NDArray[np.intp], count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """`count` of places by chance, each once where there are enough."""
    return rng.choice(places, count, replace=len(places) < count)


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
    Fiessler with slopes by differences, all in one batch; a step counts where it fails nearer to the origin. Steps to
    the same direction become one, and end where none is nearer by a thousandth.

    Args:
        margin: g.
        failed: (F, D) points that failed.
    """
    points, evaluations = apart(failed), 0
    for _ in range(TURNS):
        stepped, more = _stepped(margin, points)
        evaluations += more
        before, after = np.linalg.norm(points, axis=1), np.linalg.norm(stepped[0], axis=1)
        better = stepped[1] & (after < before)
        settled = not (better & (after < (1.0 - NEARER) * before)).any()
        points = apart(np.where(better[:, None], stepped[0], points))
        if settled:
            break
    return points, evaluations


def apart(points: Array) -> Array:
    """The nearest of points (N, D) in each direction, nearest to the origin first."""
    sizes = np.linalg.norm(points, axis=1)
    left = np.argsort(sizes, kind="stable")
    left = left[sizes[left] <= sizes.min() + BEYOND]
    found: list[int] = []
    while len(left) and len(found) < MOST_POINTS:
        first = left[0]
        found.append(first)
        left = left[points[left] @ points[first] < APART * sizes[left] * sizes[first]]
    return points[found]


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
