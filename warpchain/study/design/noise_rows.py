"""Noise rows, the same for every design, and designs crossed with them.

A Latin hypercube is reordered against chance correlations (Iman and Conover 1982): with scores S (n, d), normal
quantiles of random ranks, and T their correlation, values take the order of

    R = S chol(T)^-T.                                                                                        (a)

Factors whose ranks correlate as r are tied by a Gaussian copula (Pearson 1907), u in the unit cube:

    v = Phi(chol(C) Phi^-1(u)),   C = 2 sin(pi r / 6).                                                       (b)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.study.design.factor_values import (
    Array,
    design_dimensions,
    fill_tied_values,
    tied_factors,
    values_from_probabilities,
)
from warpchain.study.spec.noise_table import Noise, normal_from_rank_correlation

if TYPE_CHECKING:
    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor

Row = Mapping[str, Any]
DECORRELATION_TURNS = 4
LEAST_PROBABILITY = 1e-12


def noise_points(study: Study, count: int, seed: int) -> Array:
    """Noise points (count, D) in the unit cube, ranks correlated."""
    from scipy.stats import qmc

    rng, size = np.random.default_rng(seed), noise_dimensions(study)
    points = np.asarray(qmc.LatinHypercube(size, rng=rng).random(count))
    return _correlated_points(study, _decorrelated_points(points, rng) if count > size + 1 else points)


def noise_dimensions(study: Study) -> int:
    """Number of independent dimensions of a study's noise."""
    return len(design_dimensions(study.noise_study))


def noise_rows_of_normals(study: Study, u: Array) -> list[dict[str, Any]]:
    """Noise rows at standard normals (R, D)."""
    from scipy.stats import norm

    return noise_rows_of_points(study, np.asarray(norm.cdf(u @ noise_mixing(study).T)))


def noise_mixing(study: Study) -> Array:
    """Matrix (D, D) from standard normals to correlated noise, (b)."""
    places, root = _copula_factor(study)
    mixing = np.eye(noise_dimensions(study))
    mixing[np.ix_(places, places)] = root
    return mixing


def _copula_factor(study: Study) -> tuple[list[int], Array]:
    """Correlated noise dimensions (K,), and chol(C) (K, K) of (b)."""
    noise = study.noise or Noise()
    names = [axis.factors[0].group or axis.name for axis in design_dimensions(study.noise_study)]
    places = [names.index(name) for name in noise.correlated]
    wanted = normal_from_rank_correlation(np.array(noise.ranks, dtype=float).reshape(len(places), len(places)))
    return places, np.linalg.cholesky(wanted)


def _correlated_points(study: Study, points: Array) -> Array:
    """Noise points (n, D) with rank correlations, (b)."""
    from scipy.stats import norm

    places, root = _copula_factor(study)
    normals = norm.ppf(np.clip(points[:, places], LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY))
    correlated = points.copy()
    correlated[:, places] = norm.cdf(normals @ root.T)
    return correlated


def _decorrelated_points(points: Array, rng: np.random.Generator) -> Array:
    """Noise points (n, d) reordered to uncorrelated ranks, (a)."""
    from scipy.stats import norm, rankdata

    n, d = points.shape
    scores = np.asarray(norm.ppf(np.arange(1, n + 1) / (n + 1.0)))
    s = np.stack([rng.permutation(scores) for _ in range(d)], axis=1)
    found = points
    for _ in range(DECORRELATION_TURNS):
        try:
            own = np.linalg.cholesky(np.corrcoef(s, rowvar=False).reshape(d, d))
        except np.linalg.LinAlgError:
            break
        r = s @ np.linalg.inv(own).T
        order = np.stack([rankdata(column, "ordinal").astype(np.int64) - 1 for column in r.T], axis=1)
        s, found = scores[order], np.take_along_axis(np.sort(points, axis=0), order, axis=0)
    return found


def noise_rows(study: Study) -> list[dict[str, Any]]:
    """Noise rows, values by factor, that designs run with."""
    noise = study.noise or Noise()
    axes = design_dimensions(study.noise_study)
    if not axes:
        return [{}]
    return noise_rows_of_points(study, noise_points(study, noise.count, noise.seed))


def noise_rows_of_points(study: Study, points: Array) -> list[dict[str, Any]]:
    """Noise rows at unit-cube points (R, D)."""
    inner = np.clip(points, 0.0, 1.0 - 1e-12)
    columns = {
        factor.name: values_from_probabilities(factor, inner[:, k])
        for k, axis in enumerate(design_dimensions(study.noise_study))
        for factor in axis.factors
    }
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def crossed_rows(designs: Sequence[Row], noise: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of every design with every noise row."""
    return [{**design, **row} for design in designs for row in noise]


def nominal_row(study: Study, drive: Drive, design: Row) -> dict[str, Any]:
    """Design row with noise factors at nominal values."""
    row = dict(design) | {factor.name: nominal_value(factor, drive) for factor in study.noise_study.factors}
    fill_tied_values(study, tied_factors(study), row)
    return row


def nominal_value(factor: Factor, drive: Drive) -> Any:
    """Nominal value of a noise factor."""
    if factor.relative:
        return 1.0
    if factor.offset or factor.shift is not None:
        return 0.0
    own = [drive.get_value(path) for _, path in factor.target_paths()]
    if own and isinstance(own[0], (bool, int, float, str)) and all(value == own[0] for value in own):
        return own[0]
    return values_from_probabilities(factor, np.array([0.5]))[0]
