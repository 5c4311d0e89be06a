"""Rows of noise, the same for every design, and designs crossed with them.

The noise of a study is a Latin hypercube of its noise factors, so that designs meet common random numbers: what tells
two of them apart is not in which noise they were run. Where there are rows enough, its columns are reordered so that
they do not correlate by chance, which leaves each factor's values as they are (Iman and Conover 1982). With scores
S (n, d), normal quantiles of ranks in random order, and T their correlation,

    R = S chol(T)^-T,                                                                                        (a)

whose columns do not correlate; each factor's values take the order of its column of R. As ranks of R do, a little, it
is done again with the scores of these.

Factors whose ranks shall correlate as r are tied by a Gaussian copula, at any number of rows: of points u of the unit
cube,

    v = Phi(chol(C) Phi^-1(u)),   C = 2 sin(pi r / 6),                                                       (b)

is as uniform in each coordinate, and its normal scores correlate as C, its ranks as r (Pearson 1907). The first that
the study names keeps its strata of the hypercube; the others are mixtures, and have none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.study.design.factor_values import Array, complete, dimensions, from_unit, tied
from warpchain.study.spec.noise_table import Noise, normal_from_rank_correlation

if TYPE_CHECKING:
    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor

Row = Mapping[str, Any]
TURNS = 4
"""Times that eq. (a) is taken."""
INMOST = 1e-12
"""Least distance from the ends of the unit interval, which have no normal value."""


def noise_points(study: Study, count: int, seed: int) -> Array:
    """Points (count, D) of the unit cube of a study's noise, with its rank correlations."""
    from scipy.stats import qmc

    rng, size = np.random.default_rng(seed), noise_dimensions(study)
    points = np.asarray(qmc.LatinHypercube(size, rng=rng).random(count))
    return _tied_by_copula(study, _without_correlation(points, rng) if count > size + 1 else points)


def noise_dimensions(study: Study) -> int:
    """Number of independent dimensions of a study's noise, D."""
    return len(dimensions(study.noise_study))


def at_normals(study: Study, u: Array) -> list[dict[str, Any]]:
    """Values of the noise factors at independent standard normals u (R, D)."""
    from scipy.stats import norm

    return rows_at(study, np.asarray(norm.cdf(u @ noise_mixing(study).T)))


def noise_mixing(study: Study) -> Array:
    """From independent standard normals (D,) to the scores of a study's noise (D,), eq. (b): a matrix (D, D)."""
    places, root = _copula(study)
    mixing = np.eye(noise_dimensions(study))
    mixing[np.ix_(places, places)] = root
    return mixing


def _copula(study: Study) -> tuple[list[int], Array]:
    """Dimensions of a study's noise that are correlated, as the study names them (K,), and chol(C) of these (K, K)."""
    noise = study.noise or Noise()
    names = [axis.factors[0].group or axis.name for axis in dimensions(study.noise_study)]
    places = [names.index(name) for name in noise.correlated]
    wanted = normal_from_rank_correlation(np.array(noise.ranks, dtype=float).reshape(len(places), len(places)))
    return places, np.linalg.cholesky(wanted)


def _tied_by_copula(study: Study, points: Array) -> Array:
    """Points (n, D) whose correlated dimensions are tied, eq. (b); the others are what they were."""
    from scipy.stats import norm

    places, root = _copula(study)
    normals = norm.ppf(np.clip(points[:, places], INMOST, 1.0 - INMOST))
    tied_points = points.copy()
    tied_points[:, places] = norm.cdf(normals @ root.T)
    return tied_points


def _without_correlation(points: Array, rng: np.random.Generator) -> Array:
    """Points (n, d) with each column reordered so that normal scores of its ranks do not correlate, eq. (a).

    Few rows may have two columns in one order, of which eq. (a) makes nothing: then as far as it went.
    """
    from scipy.stats import norm, rankdata

    n, d = points.shape
    scores = np.asarray(norm.ppf(np.arange(1, n + 1) / (n + 1.0)))
    s = np.stack([rng.permutation(scores) for _ in range(d)], axis=1)
    found = points
    for _ in range(TURNS):
        try:
            own = np.linalg.cholesky(np.corrcoef(s, rowvar=False).reshape(d, d))
        except np.linalg.LinAlgError:
            break
        r = s @ np.linalg.inv(own).T
        order = np.stack([rankdata(column, "ordinal") - 1 for column in r.T], axis=1)
        s, found = scores[order], np.take_along_axis(np.sort(points, axis=0), order, axis=0)
    return found


def noise_rows(study: Study) -> list[dict[str, Any]]:
    """The rows of noise that each design is run with, values by factor; one without any where there is no noise."""
    noise = study.noise or Noise()
    axes = dimensions(study.noise_study)
    if not axes:
        return [{}]
    return rows_at(study, noise_points(study, noise.count, noise.seed))


def rows_at(study: Study, points: Array) -> list[dict[str, Any]]:
    """Values of the noise factors at points (R, D)."""
    inner = np.clip(points, 0.0, 1.0 - 1e-12)
    columns = {
        factor.name: from_unit(factor, inner[:, k])
        for k, axis in enumerate(dimensions(study.noise_study))
        for factor in axis.factors
    }
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def crossed(designs: Sequence[Row], noise: Sequence[Row]) -> list[dict[str, Any]]:
    """Designs with every row of noise, design by design."""
    return [{**design, **row} for design in designs for row in noise]


def nominal(study: Study, drive: Drive, design: Row) -> dict[str, Any]:
    """A design's row with its noise factors where the base drive has them, or at their medians where it says nothing.

    Args:
        study: with noise.
        drive: the base drive.
        design: values of the design factors.
    """
    row = dict(design) | {factor.name: own_value(factor, drive) for factor in study.noise_study.factors}
    complete(study, tied(study), row)
    return row


def own_value(factor: Factor, drive: Drive) -> Any:
    """The value of a factor that leaves the base drive as it is, or its median where the drive says nothing."""
    if factor.relative:
        return 1.0
    if factor.offset or factor.shift is not None:
        return 0.0
    own = [drive.get_value(path) for _, path in factor.target_paths()]
    if own and isinstance(own[0], (bool, int, float, str)) and all(value == own[0] for value in own):
        return own[0]
    return from_unit(factor, np.array([0.5]))[0]
