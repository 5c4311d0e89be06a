"""Sobol' indices: the part of a metric's variance that each factor causes, alone and with its interactions.

A Saltelli design gives them without a model (Saltelli et al. 2010). Of a response surface, with independent factors of
mean m_i and variance v_i,

    V_i = var[c_i x_i + b_ii x_i^2],   c_i = b_i + sum_j b_ij m_j,   V_ij = b_ij^2 v_i v_j,                     (a)

S_i = V_i / V, T_i = S_i + sum_j V_ij / V. Without the scatter s^2 of rows that are means of runs,

    S_i = V S_i / (V - s^2),    T_i = (V T_i - s^2) / (V - s^2).                                               (b)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.extras import require_extra
from warpchain.study.analysis.pure_error import row_standard_errors
from warpchain.study.analysis.surface import Surface
from warpchain.study.design.factor_values import lognormal_moments, quadrature_nodes
from warpchain.study.results import Array, Results
from warpchain.study.spec.factor import Factor

if TYPE_CHECKING:
    import pyarrow as pa

SobolProblem = dict[str, Any]

SALIB_DISTRIBUTIONS = {
    "uniform": "unif",
    "log-uniform": "logunif",
    "normal": "norm",
    "truncated-normal": "truncnorm",
    "lognormal": "lognorm",
}


@dataclass(frozen=True)
class SobolIndices:
    """Sobol' indices of one metric for A factors.

    Attributes:
        first: (A,) part of the variance by each factor alone.
        total: (A,) part with its interactions.
        first_error, total_error: (A,) half widths of 95 % intervals.
        rows: number of variants.
        dropped: variants of blocks left out.
    """

    metric: str
    factors: tuple[str, ...]
    first: Array
    total: Array
    first_error: Array
    total_error: Array
    rows: int
    dropped: int = 0


def problem_of_results(results: Results) -> SobolProblem:
    """SALib problem of a study's numeric factors over their ranges."""
    names = list(results.independent_factors())
    columns = [results.values(name) for name in names]
    bounds = [[float(np.nanmin(x)), float(np.nanmax(x))] for x in columns]
    return {"num_vars": len(names), "names": names, "bounds": bounds}


def problem_of_factors(factors: Iterable[Any]) -> SobolProblem:
    """SALib problem of a study's factors without expressions.

    Raises:
        StudyError: a factor of levels or choices, which SALib cannot state.
    """
    names, bounds, dists = [], [], []
    for factor in factors:
        kind = factor.value_source
        if kind == "expression":
            continue
        if kind not in SALIB_DISTRIBUTIONS:
            raise StudyError(f"factor {factor.name!r}: {kind or 'a table'} is not a distribution that SALib knows")
        names.append(factor.name)
        dists.append(SALIB_DISTRIBUTIONS[kind])
        ends = list(factor.range or ())
        if kind == "lognormal":
            bounds.append(list(lognormal_moments(factor)))  # SALib's are those of the logarithm
        else:
            bounds.append(ends if kind in ("uniform", "log-uniform") else [*ends, factor.mean, factor.std])
    return {"num_vars": len(names), "names": names, "bounds": bounds, "dists": dists}


def factors_of_problem(problem: Mapping[str, Any], paths: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Factors of a study file from a SALib problem.

    Args:
        paths: key path into the drive by name; None takes the names.

    Raises:
        StudyError: groups, or a distribution that studies do not have.
    """
    _check_problem(problem)
    words = {salib: own for own, salib in SALIB_DISTRIBUTIONS.items()}
    tables = []
    for name, bounds, dist in zip(problem["names"], problem["bounds"], _problem_distributions(problem), strict=True):
        if dist not in words:
            raise StudyError(f"problem: dists: {dist!r} of {name!r}: allowed are {', '.join(words)}")
        table: dict[str, Any] = {"name": name, "path": (paths or {}).get(name, name), "distribution": words[dist]}
        if dist == "lognorm":
            center, width = (float(value) for value in bounds)
            table["mean"] = math.exp(center + 0.5 * width**2)
            table["std"] = table["mean"] * math.sqrt(math.expm1(width**2))
        elif dist != "norm":
            table["range"] = [float(value) for value in bounds[:2]]
        if dist in ("norm", "truncnorm"):
            table["mean"], table["std"] = (float(value) for value in bounds[-2:])
        tables.append(table)
    return tables


def _problem_distributions(problem: Mapping[str, Any]) -> list[str]:
    """Names of a SALib problem's distributions."""
    return list(problem.get("dists") or ["unif"] * len(problem["names"]))


def _check_problem(problem: Mapping[str, Any]) -> None:
    """Raises StudyError for an incomplete or grouped SALib problem."""
    for key in ("names", "bounds"):
        if key not in problem:
            raise StudyError(f"problem: {key!r} is missing; SALib's problem has names and bounds")
    counts = {len(problem["names"]), len(problem["bounds"]), int(problem.get("num_vars", len(problem["names"])))}
    if len(counts) > 1 or len(problem["names"]) != len(_problem_distributions(problem)):
        raise StudyError("problem: num_vars, names, bounds and dists must be equally many")
    if problem.get("groups"):
        raise StudyError("problem: groups are not supported; use the study's own `group`")


def saltelli_table(problem: Mapping[str, Any], base: int, seed: int = 0, second_order: bool = False) -> pa.Table:
    """Table of a Saltelli design, base * (A + 2) rows.

    Args:
        base: a power of two.
        second_order: also the rows of second-order indices.

    Raises:
        StudyError: no SALib, another base, or a problem that SALib refuses.
    """
    import pyarrow as pa

    require_extra("salib", "Sobol' indices", StudyError)
    from SALib.sample import sobol

    _check_problem(problem)
    if base < 2 or base & (base - 1):
        raise StudyError(f"base = {base}: must be a power of two, at least 2")
    try:
        values = sobol.sample(
            {"num_vars": len(problem["names"]), **problem}, base, calc_second_order=second_order, seed=seed
        )
    except ValueError as error:
        raise StudyError(f"problem: {str(error).strip().splitlines()[0]}") from None
    return pa.table({name: values[:, k] for k, name in enumerate(problem["names"])})


def saltelli_block_size(results: Results, factors: Sequence[str]) -> int:
    """Number of rows in a Saltelli block, or 0."""
    count = len(factors)
    if count < 2:
        return 0
    order = np.argsort(results.variants, kind="stable")
    values = np.stack([results.values(name)[order] for name in factors], axis=1)
    for block in (count + 2, 2 * count + 2):
        if len(values) < 2 * block or len(values) % block:
            continue
        blocks = values.reshape(-1, block, count)
        own = np.eye(count, dtype=bool)
        mixed = np.where(own, blocks[:, -1:, :], blocks[:, :1, :])
        if np.allclose(blocks[:, 1 : count + 1], mixed, rtol=1e-12, atol=0.0):
            return block
    return 0


def sobol_indices(results: Results, metric: str, problem: Mapping[str, Any] | None = None) -> SobolIndices:
    """Sobol' indices of a metric from a study's Saltelli design.

    A variant that is not ok takes its block out.

    Args:
        results: of all rows of the design.
        problem: SALib's.

    Raises:
        StudyError: no SALib, another design, or fewer than two whole blocks.
    """
    require_extra("salib", "Sobol' indices", StudyError)
    from SALib.analyze import sobol

    chosen = dict(problem or problem_of_results(results))
    _check_problem(chosen)
    names = tuple(chosen["names"])
    chosen["num_vars"] = len(names)
    block = saltelli_block_size(results, names)
    if not block:
        raise StudyError(f"Sobol' indices of {metric!r}: the rows are no Saltelli design of {', '.join(names)}")
    order = np.argsort(results.variants, kind="stable")
    values = results.values(metric)[order].reshape(-1, block)
    whole = results.usable_rows(metric)[order].reshape(-1, block).all(axis=1)
    if whole.sum() < 2:
        raise StudyError(f"Sobol' indices of {metric!r}: {int(whole.sum())} whole blocks, at least 2 are needed")
    y = values[whole].ravel()
    if not np.ptp(y) > 0.0:
        raise StudyError(f"Sobol' indices of {metric!r}: it does not vary")
    second = block == 2 * len(names) + 2
    found = sobol.analyze(chosen, y, calc_second_order=second, num_resamples=200, seed=1)
    first, total, first_error, total_error = (
        np.asarray(found[key], dtype=float) for key in ("S1", "ST", "S1_conf", "ST_conf")
    )
    errors = row_standard_errors(results, metric) if results.has_replicates else None
    known = None if errors is None else errors[order].reshape(-1, block)[whole]
    if known is not None and np.isfinite(known).all():  # eq. (b)
        variance, chance = float(values[whole][:, [0, -1]].var()), float(np.mean(known**2))
        if not variance > chance:
            raise StudyError(f"Sobol' indices of {metric!r}: equal runs scatter as much as the variants differ")
        total = np.maximum(total - chance / variance, 0.0)
        first, total, first_error, total_error = (
            of * variance / (variance - chance) for of in (first, total, first_error, total_error)
        )
    dropped = int((~whole).sum()) * block
    return SobolIndices(metric, names, first, total, first_error, total_error, len(y), dropped)


RESAMPLES = 400


def surface_indices(surface: Surface, results: Results | None = None) -> SobolIndices:
    """Sobol' indices of a response surface, (a)."""
    moments = np.array([_scaled_moments(surface, a, results) for a in range(len(surface.factors))])
    first, total = _variance_shares(surface, surface.coefficients[None], moments)
    errors = np.zeros((2, len(surface.factors)))
    if surface.covariance is not None and surface.freedom and np.isfinite(surface.covariance).all():
        random = np.random.default_rng(0)
        size, axes = np.linalg.eigh(surface.covariance)
        drawn = random.standard_normal((RESAMPLES, len(size))) * np.sqrt(np.maximum(size, 0.0)) @ axes.T
        drawn += surface.coefficients
        errors = 1.96 * np.std(_variance_shares(surface, drawn, moments), axis=1)
    return SobolIndices(surface.metric, surface.factors, first[0], total[0], errors[0], errors[1], surface.rows)


def _scaled_moments(surface: Surface, a: int, results: Results | None) -> tuple[float, float, float, float]:
    """Moments of a scaled factor x: mean, variance, those of x^2."""
    given = results.distribution(surface.factors[a]) if results is not None else None
    found = quadrature_nodes(Factor(name="x", **given)) if given is not None else None
    if found is None:
        return 0.0, 1.0 / 3.0, 0.0, 4.0 / 45.0
    values, weight = found
    x = (2.0 * values - surface.low[a] - surface.high[a]) / (surface.high[a] - surface.low[a])
    mean, square = float(weight @ x), float(weight @ (x * x))
    off, wide = x - mean, x * x - square
    return mean, float(weight @ (off * off)), float(weight @ (off * wide)), float(weight @ (wide * wide))


def _variance_shares(surface: Surface, coefficients: Array, moments: Array) -> tuple[Array, Array]:
    """First and total Sobol' indices (D, A) of D surfaces."""
    powers, count = surface.powers, len(surface.factors)
    linear, square = (np.zeros((len(coefficients), count)) for _ in range(2))
    both = np.zeros((len(coefficients), count, count))
    for term, power in enumerate(powers):
        held = np.flatnonzero(power)
        if len(held) == 2:
            both[:, held[0], held[1]] = both[:, held[1], held[0]] = coefficients[:, term]
        elif len(held) == 1:
            (linear if power[held[0]] == 1 else square)[:, held[0]] = coefficients[:, term]
    mean, variance, skew, wide = moments.T
    linear = linear + both @ mean
    alone = linear**2 * variance + 2.0 * linear * square * skew + square**2 * wide
    shared = both**2 * (variance[:, None] * variance)
    whole = alone.sum(axis=1) + 0.5 * shared.sum(axis=(1, 2))
    whole = np.where(whole > 0.0, whole, 1.0)[:, None]
    return alone / whole, (alone + shared.sum(axis=2)) / whole
