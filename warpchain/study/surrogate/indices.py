"""Sobol' indices of a surrogate, by estimators, and the best way to a metric's indices.

With rows A and B drawn independently, A_i those of A with factor i from B, and f the surrogate's mean, less its own
mean over A (Saltelli et al. 2010, table 2),

    V S_i = mean f(B) (f(A_i) - f(A)),    V T_i = mean (f(A) - f(A_i))^2 / 2,    V = var f(A).               (a)

Rows are quasi-random, so (a) is good to some 1/100. What the surrogate misses of the metric is in no index: its
cross-validated Q2 is the part of the variance that the indices share out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.analysis.sensitivity import Indices, saltelli_block, sobol_indices, surface_indices
from warpchain.study.analysis.surface import TRUSTED, fit_surface
from warpchain.study.design.factor_values import from_unit
from warpchain.study.results import Array, Results
from warpchain.study.spec.factor import Factor
from warpchain.study.surrogate.model import Axis, Surrogate, best_surrogate, features_of, fit_surrogate

DRAWS = 1024
"""Rows A, a power of two."""


def best_indices(results: Results, metric: str, surrogate: Surrogate | None = None) -> tuple[Indices, str]:
    """Sobol' indices by the best way there is, and which that is, in words.

    Args:
        results: the study's results.
        metric: the metric.
        surrogate: of the metric, if it was fitted already.

    Raises:
        StudyError: neither a Saltelli design nor a surface or Gaussian process that can be trusted.
    """
    if saltelli_block(results, results.independent_factors()):
        found = sobol_indices(results, metric)
        lost = f", {found.dropped} left out with blocks that did not end well" if found.dropped else ""
        return found, f"by a Saltelli design of {found.rows} variants{lost}; bars are 95 % intervals"
    ways = [_of_surface, _of_process]
    if any(axis.words for axis in features_of(results).axes):
        ways.reverse()  # a surface leaves words out
    missing = []
    for way in ways:
        try:
            return way(results, metric, surrogate)
        except StudyError as error:
            missing.append(str(error))
    count = int(results.rows_for(metric).sum())
    needed = f"{TRUSTED:g} is needed, and {count} variant{'s are' if count != 1 else ' is'} there"
    raise StudyError(f"Sobol' indices of {metric!r}: {'; '.join(missing)}; {needed}")


def _of_surface(results: Results, metric: str, _: Surrogate | None) -> tuple[Indices, str]:
    surface = fit_surface(results, metric)
    quality = f"predicted R\u00b2 = {surface.r2_predicted:.3f}"
    if not surface.trusted:
        raise StudyError(f"the response surface predicts too badly ({quality})")
    words = f"of the response surface ({quality}), {_distributed(results, surface.factors)}"
    return surface_indices(surface, results), f"{words}; bars are 95 % intervals"


def _of_process(results: Results, metric: str, surrogate: Surrogate | None) -> tuple[Indices, str]:
    model = surrogate or best_surrogate(results, metric)
    if model.kind != "gaussian":
        model = fit_surrogate(results, metric)
    q2 = model.cross_validated().q2
    quality = f"cross-validated Q\u00b2 = {q2:.3f}"
    if q2 < TRUSTED:
        raise StudyError(f"the Gaussian process predicts too badly ({quality})")
    rest = f"it misses {100.0 * (1.0 - q2):.1f} % of the variance, which is in no bar"
    words = f"of the Gaussian process of {model.rows} variants ({quality}: {rest})"
    return surrogate_indices(model, results), f"{words}, {_distributed(results, model.factors)}"


def surrogate_indices(surrogate: Surrogate, results: Results, seed: int = 0) -> Indices:
    """Sobol' indices of a Gaussian process for independent factors, words among them, eq. (a); without intervals.

    Args:
        surrogate: a Gaussian process.
        results: whose table has the factors' distributions; factors without one are uniform over what was run.
        seed: of the draws.
    """
    from scipy.stats import qmc

    assert surrogate.features is not None  # of a process
    axes = surrogate.features.axes
    count = len(axes)
    units = qmc.Sobol(2 * count, seed=seed).random(DRAWS)
    first, second = (
        {axis.name: _drawn(results, axis, part[:, k]) for k, axis in enumerate(axes)}
        for part in (units[:, :count], units[:, count:])
    )
    mixed = [first | {axis.name: second[axis.name]} for axis in axes]
    values = [surrogate.predict(rows)[0] for rows in (first, second, *mixed)]
    a, b, *ones = (value - values[0].mean() for value in values)
    whole = float(a.var()) or 1.0
    alone = np.array([np.mean(b * (one - a)) for one in ones]) / whole
    total = np.array([0.5 * np.mean((a - one) ** 2) for one in ones]) / whole
    none = np.zeros(count)
    return Indices(surrogate.metric, surrogate.factors, np.clip(alone, 0.0, 1.0), total, none, none, surrogate.rows)


def _drawn(results: Results, axis: Axis, units: Array) -> Any:
    """Values of a factor at cumulated probabilities: of the study's distribution, else uniform over what was run."""
    given = results.distribution(axis.name)
    if given is not None:
        return from_unit(Factor(name="x", **given), units)
    if axis.words:
        return [axis.words[int(k)] for k in units * len(axis.words)]
    return axis.low + units * (axis.high - axis.low)


def _distributed(results: Results, factors: tuple[str, ...]) -> str:
    """The distributions that indices are for, in words."""
    known = [factor for factor in factors if results.distribution(factor) is not None]
    if len(known) == len(factors):
        return "factors distributed as in the study"
    some = f"{', '.join(known)} distributed as in the study, the others" if known else "factors"
    return f"{some} uniform over their range"
