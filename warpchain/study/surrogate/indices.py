"""Sobol' indices of a surrogate, by estimators, and the best way to a metric's indices.

With rows A and B drawn independently, A_i those of A with factor i from B, f the process's centered mean (Saltelli et
al. 2010, table 2),

    V S_i = mean f(B) (f(A_i) - f(A)),    V T_i = mean (f(A) - f(A_i))^2 / 2,    V = var f(A, B).            (a)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.analysis.left_out import LeftOut
from warpchain.study.analysis.pure_error import scatter_share
from warpchain.study.analysis.sensitivity import SobolIndices, saltelli_block_size, sobol_indices, surface_indices
from warpchain.study.analysis.surface import TRUSTED_R2, fit_surface
from warpchain.study.design.factor_values import values_from_probabilities
from warpchain.study.results import Array, Results
from warpchain.study.spec.factor import Factor
from warpchain.study.surrogate.gaussian_process import GaussianProcess
from warpchain.study.surrogate.surrogate_model import (
    FactorAxis,
    Surrogate,
    best_surrogate,
    coordinates_of_results,
    fit_surrogate,
)

SOBOL_ROWS = 1024
NO_EFFECT_SCATTER = 0.95
"""Scatter's share of the variance that hides all effects."""
ROW_SETS, SET_DRAWS = 4, 25


def best_indices(results: Results, metric: str, surrogate: Surrogate | None = None) -> tuple[SobolIndices, str]:
    """Sobol' indices of a metric by the best way, and its name.

    Raises:
        StudyError: no Saltelli design nor trusted surrogate, or rows selected by their results.
    """
    if (left_out := LeftOut(results)).is_unranked(metric):
        lost = f"{int(left_out.left_out_rows.sum())} of {int((~left_out.unbuilt_rows).sum())} variants that ran"
        raise StudyError(
            f"Sobol' indices of {metric!r}: {lost} are left out by their own results, and the others are no sample of "
            "what was varied"
        )
    if saltelli_block_size(results, results.independent_factors()):
        found = sobol_indices(results, metric)
        lost = f", {found.dropped} left out with blocks that did not end well" if found.dropped else ""
        return found, f"by a Saltelli design of {found.rows} variants{lost}; bars are 95 % intervals"
    ways = [_indices_of_surface, _indices_of_process]
    if any(axis.words for axis in coordinates_of_results(results).axes):
        ways.reverse()  # a surface leaves words out
    missing = []
    for way in ways:
        try:
            return way(results, metric, surrogate)
        except StudyError as error:
            missing.append(str(error))
    raise StudyError(f"Sobol' indices of {metric!r}: {'; '.join(missing)}; {_advice_text(results, metric)}")


def _advice_text(results: Results, metric: str) -> str:
    """Advice on runs if no surrogate gives Sobol' indices."""
    rows = results.usable_rows(metric)
    count = int(rows.sum())
    needed = f"{TRUSTED_R2:g} is needed, and {count} variant{'s are' if count != 1 else ' is'} there"
    chance = scatter_share(results, metric)
    if chance is None:
        return f"{needed}: more variants help, or, where equal runs scatter much, replicates"
    scatter = f"{needed}: scatter between equal runs makes {100.0 * chance:.0f} % of the variance"
    if chance <= 1.0 - TRUSTED_R2:
        return f"{scatter} only, so more variants help"
    if chance >= NO_EFFECT_SCATTER:
        return f"{scatter}, so no factor has an effect that shows"
    runs = math.ceil(results.run_counts[rows].mean() * chance / (1.0 - chance) / (1.0 - TRUSTED_R2) * 2.0)
    return f"{scatter}, so Q\u00b2 stays below {1.0 - chance:.2f}: replicates help, some {runs} a row"


def _indices_of_surface(results: Results, metric: str, _: Surrogate | None) -> tuple[SobolIndices, str]:
    """Sobol' indices by a trusted response surface, and its name."""
    surface = fit_surface(results, metric)
    quality = f"predicted R\u00b2 = {surface.r2_predicted:.3f}"
    if not surface.is_trusted:
        raise StudyError(f"the response surface predicts too badly ({quality})")
    words = f"of the response surface ({quality}), {_distributions_text(results, surface.factors)}"
    return surface_indices(surface, results), f"{words}; bars are 95 % intervals"


def _indices_of_process(results: Results, metric: str, surrogate: Surrogate | None) -> tuple[SobolIndices, str]:
    """Sobol' indices by a trusted Gaussian process, and its name."""
    model = surrogate or best_surrogate(results, metric)
    if model.kind != "gaussian":
        model = fit_surrogate(results, metric)
    q2 = model.cross_validated().q2
    quality = f"cross-validated Q\u00b2 = {q2:.3f}"
    if q2 < TRUSTED_R2:
        raise StudyError(f"the Gaussian process predicts too badly ({quality})")
    rest = f"it misses {100.0 * (1.0 - q2):.1f} % of the variance, which is in no bar"
    words = f"of the Gaussian process of {model.row_count} variants ({quality}: {rest})"
    words = f"{words}, {_distributions_text(results, model.factors)}; bars are 95 % intervals"
    return surrogate_indices(model, results), words


def surrogate_indices(surrogate: Surrogate, results: Results) -> SobolIndices:
    """Sobol' indices of a metric's Gaussian process, (a)."""
    from scipy.stats import qmc

    features, process = surrogate.features, surrogate.model
    assert features is not None and isinstance(process, GaussianProcess)
    axes = features.axes
    count = len(axes)
    found = []
    for number in range(ROW_SETS):
        units = qmc.Sobol(2 * count, seed=number).random(SOBOL_ROWS)
        first, second = (
            {axis.name: _sampled_factor(results, axis, part[:, k]) for k, axis in enumerate(axes)}
            for part in (units[:, :count], units[:, count:])
        )
        mixed = (first | {axis.name: second[axis.name]} for axis in axes)
        drawn = process.metric_draws(SET_DRAWS, number)
        values = [drawn(features.of_rows(rows)) for rows in (first, second, *mixed)]  # (R, 1 + DRAWS) each
        if surrogate.logarithm:
            values = [np.exp(value) for value in values]
        a, b, *ones = (value - values[0].mean(axis=0) for value in values)
        whole = 0.5 * (a.var(axis=0) + b.var(axis=0))
        whole[whole == 0.0] = 1.0
        alone = [np.mean(b * (one - a), axis=0) / whole for one in ones]
        total = [0.5 * np.mean((a - one) ** 2, axis=0) / whole for one in ones]
        found.append(np.array([alone, total]))
    of_sets = np.array(found)  # (SETS, 2, A, 1 + DRAWS)
    mean = of_sets[..., 0].mean(axis=0)
    off = of_sets[..., 1:] - mean[..., None]
    first_error, total_error = 1.96 * np.sqrt((off**2).mean(axis=(0, 3)))
    first, total = np.clip(mean[0], 0.0, 1.0), mean[1]
    return SobolIndices(
        surrogate.metric, surrogate.factors, first, total, first_error, total_error, surrogate.row_count
    )


def _sampled_factor(results: Results, axis: FactorAxis, units: Array) -> Any:
    """Factor values at cumulated probabilities, for Sobol' indices."""
    given = results.distribution(axis.name)
    if given is not None:
        return values_from_probabilities(Factor(name="x", **given), units)
    if axis.words:
        return [axis.words[int(k)] for k in units * len(axis.words)]
    return axis.low + units * (axis.high - axis.low)


def _distributions_text(results: Results, factors: tuple[str, ...]) -> str:
    """Text on factors' distributions for which Sobol' indices hold."""
    known = [factor for factor in factors if results.distribution(factor) is not None]
    if len(known) == len(factors):
        return "factors distributed as in the study"
    some = f"{', '.join(known)} distributed as in the study, the others" if known else "factors"
    return f"{some} uniform over their range"
