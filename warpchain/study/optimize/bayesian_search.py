"""Bayesian search of a study's next rows: costly runs that scatter, several objectives, limits, rows that fail.

Each metric has a Gaussian process, costs f are scaled to 0 .. 1 over the front. With random directions l, rows dominate
the volume up to r = 1.2 (Golovin and Zhang 2020)

    V ~ E_l max_rows s_l(f),      s_l(f) = min_i (max(0, r - f_i) / l_i)^M.                                       (a)

The expected gain of a row at x, times the chance that it counts, is

    a(x) = E[max(0, s_l(f(x)) - s_l*)] P(limits kept) P(ok).                                                      (b)

Within a batch, the mean at each row counts as measured (Ginsbourger et al. 2010).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from warpchain.progress import raise_if_stopped
from warpchain.study.analysis.pareto import Goals, GoalValues, is_non_dominated, keeping_probability
from warpchain.study.design.factor_values import DesignCube
from warpchain.study.results import Array
from warpchain.study.surrogate.gaussian_process import GaussianProcess, fit_gaussian_process

GLOBAL_POINTS, LOCAL_POINTS = 1024, 96
LOCAL_DEVIATIONS = (0.15, 0.04, 0.01)
BEST_ROWS = 6
GAIN_DRAWS = 128
REFERENCE_COST = 1.2


@dataclass(frozen=True)
class SearchModel:
    """Surrogates of a Bayesian search: metrics, success."""

    goals: Goals
    processes: dict[str, GaussianProcess]  # by metric, also of a factor that is an objective
    ok: GaussianProcess | None  # process of 1 for rows that are ok and 0 for others; None if none failed

    def predictions_at(self, x: Array) -> tuple[dict[str, tuple[Array, Array]], Array]:
        """Predictions by metric, and success probability, at coordinates (C, D)."""
        found = {name: process.predict(x) for name, process in self.processes.items()}
        chance = np.ones(len(x))
        if self.ok is not None:
            chance = np.clip(self.ok.predict(x)[0], 0.01, 1.0)
        for bound in self.goals.bounds:
            chance = chance * keeping_probability(bound, *found[bound.metric])
        return found, chance

    def model_with_row(self, x: Array) -> SearchModel:
        """Search model with a row's means as measured."""
        more = {n: p.process_with_row(x, float(p.predict(x[None])[0][0])) for n, p in self.processes.items()}
        return replace(self, processes=more)


def fit_search_model(measured: GoalValues, x: Array) -> SearchModel:
    """Search model fitted to goal values at coordinates (R, D)."""
    rows = measured.ok
    processes = {}
    for name, column in measured.columns.items():
        raise_if_stopped()
        errors = measured.errors.get(name)
        processes[name] = fit_gaussian_process(x[rows], column[rows], None if errors is None else errors[rows])
    failed = None if rows.all() else fit_gaussian_process(x, rows.astype(float), isotropic=True)
    return SearchModel(measured.goals, processes, failed)


def propose_points(cube: DesignCube, measured: GoalValues, points: Array, count: int, seed: int) -> Array:
    """Next points (count, D) of a Bayesian search.

    Args:
        measured: goal values of the rows that were run.
        points: (R, D) of these rows.
    """
    rng = np.random.default_rng(seed)
    if measured.ok.sum() < 4:
        return _new_feasible_points(cube, _sobol_points(cube, rng, GLOBAL_POINTS), points)[:count]
    belief = fit_search_model(measured, cube.model_coordinates(points))
    chosen: list[Array] = []
    known = points
    for _ in range(count):
        raise_if_stopped()
        about = _best_points(belief, measured, cube, points)
        candidates = np.vstack(
            [_sobol_points(cube, rng, GLOBAL_POINTS), *(_local_points(p, LOCAL_POINTS, rng) for p in about)]
        )
        ways = np.abs(rng.standard_normal((GAIN_DRAWS, len(measured.goals.objectives))))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        normal = rng.standard_normal((GAIN_DRAWS, len(measured.goals.named_metrics)))
        best = None
        for spread in (None, 0.02):  # then once more about the best of these
            if spread is not None and best is not None:
                candidates = np.vstack([best[None], best + spread * rng.standard_normal((128, len(best)))])
            candidates = _new_feasible_points(cube, candidates, known)
            if not len(candidates):
                break
            values = _acquisition_values(belief, measured, cube, (points, candidates), ways, normal)
            best = candidates[int(np.argmax(values))]
        if best is None:
            break
        chosen.append(best)
        known = np.vstack([known, best])
        belief = belief.model_with_row(cube.model_coordinates(best[None])[0])
    return np.array(chosen).reshape(-1, points.shape[1])


def _sobol_points(cube: DesignCube, rng: np.random.Generator, count: int) -> Array:
    """Sobol' points (count, D) as search candidates."""
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(len(cube.axes), rng=rng).random(count), dtype=float)


def _local_points(point: Array, count: int, rng: np.random.Generator) -> Array:
    """Search candidates (count, D) about a point."""
    spreads = np.repeat(LOCAL_DEVIATIONS, count // len(LOCAL_DEVIATIONS))[:, None]
    moved = rng.random((len(spreads), len(point))) < max(0.3, 2.0 / len(point))
    return np.asarray(point + spreads * moved * rng.standard_normal(moved.shape))


def _new_feasible_points(cube: DesignCube, candidates: Array, known: Array) -> Array:
    """Search candidates that are feasible and new."""
    snapped = cube.snapped_points(candidates)
    seen = {tuple(row) for row in np.round(known, 9).tolist()}
    new = []
    for i, row in enumerate(np.round(snapped, 9).tolist()):
        if tuple(row) not in seen:
            seen.add(tuple(row))
            new.append(i)
    return np.asarray(snapped[new][cube.is_feasible(snapped[new])]) if new else snapped[:0]


def _volume_scalars(costs: Array, ways: Array) -> Array:
    """Volume scalars s_l of costs (..., M), (a)."""
    return np.asarray((np.maximum(REFERENCE_COST - costs, 0.0) / ways).min(axis=-1) ** costs.shape[-1])


def _cost_scaling(belief: SearchModel, measured: GoalValues, x: Array) -> tuple[Array, Array, Array]:
    """Mean costs (R, M) of rows, and the front's ends (M,)."""
    means = np.stack(
        [
            sign * belief.processes[o.metric].predict(x)[0]
            for o, sign in zip(measured.goals.objectives, measured.goals.cost_signs, strict=True)
        ],
        axis=1,
    )
    _, chance = belief.predictions_at(x)
    likely = measured.ok & (chance > 0.5)
    held = means[likely if likely.any() else measured.ok]
    front = held[is_non_dominated(held)]
    low, high = front.min(axis=0), front.max(axis=0)
    width = np.where(high - low > 1e-12 * np.abs(high), high - low, held.std(axis=0) + 1e-12)
    return np.where((likely if likely.any() else measured.ok)[:, None], means, np.inf), low, low + width


def _best_points(belief: SearchModel, measured: GoalValues, cube: DesignCube, points: Array) -> Array:
    """Points (K, D) of a search's best rows."""
    x = cube.model_coordinates(points)
    means, low, high = _cost_scaling(belief, measured, x)
    scaled = (means - low) / (high - low)
    finite = np.flatnonzero(np.isfinite(scaled).all(axis=1))
    front = finite[is_non_dominated(scaled[finite])]
    order = front[np.argsort(scaled[front].sum(axis=1), kind="stable")]
    if len(order) < BEST_ROWS:
        rest = np.setdiff1d(finite, order)
        order = np.append(order, rest[np.argsort(scaled[rest].sum(axis=1), kind="stable")])
    ends = [int(front[int(np.argmin(scaled[front, m]))]) for m in range(scaled.shape[1])]
    return points[list(dict.fromkeys([*ends, *order.tolist()]))[:BEST_ROWS]]


def _acquisition_values(
    belief: SearchModel, measured: GoalValues, cube: DesignCube, places: tuple[Array, Array], ways: Array, normal: Array
) -> Array:
    """Expected gain a(x) (C,) of search candidates, (b)."""
    points, candidates = places
    means, low, high = _cost_scaling(belief, measured, cube.model_coordinates(points))
    found, chance = belief.predictions_at(cube.model_coordinates(candidates))
    if not measured.limits_kept.any():
        return chance  # first a row within the limits
    held = (means[np.isfinite(means).all(axis=1)] - low) / (high - low)
    reached = _volume_scalars(held[:, None, :], ways[None]).max(axis=0)
    names = list(found)
    draws = []
    for objective, sign in zip(measured.goals.objectives, measured.goals.cost_signs, strict=True):
        mean, deviation = found[objective.metric]
        draws.append(sign * (mean + deviation * normal[:, [names.index(objective.metric)]]))
    costs = (np.stack(draws, axis=-1) - low) / (high - low)
    gain = np.maximum(_volume_scalars(costs, ways[:, None, :]) - reached[:, None], 0.0).mean(axis=0)
    return np.asarray((gain + 1e-12 * gain.max(initial=1e-300)) * chance)
