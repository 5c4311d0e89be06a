"""Surrogates with their uncertainty, pure error, and analysis that wild values do not upset."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import binom

from warpchain.errors import StudyError
from warpchain.study.analysis.effects import median_effects, median_interval, transform_metric
from warpchain.study.analysis.pure_error import scatter_share
from warpchain.study.results import read_results
from warpchain.study.surrogate import CrossValidation, fit_surrogate

pytest.importorskip("sklearn")

KINDS = ("gaussian", "quadratic")


def made(rows=80, noise=0.1, seed=3, errors=False):
    """y = 3 a - 2 b^2 + noise over a, b in 0 .. 2, -1 .. 1."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.0, 2.0, rows), rng.uniform(-1.0, 1.0, rows)
    y = 3.0 * a - 2.0 * b * b + noise * rng.standard_normal(rows)
    columns = {"a": a, "b": b, "y": y} | ({"y_se": np.full(rows, noise)} if errors else {})
    return read_results(pa.table(columns), ["a", "b"], ["y"])


GRID = {"a": [0.3, 1.0, 1.7, 1.0], "b": [-0.5, 0.0, 0.5, 0.8]}
TRUE = 3.0 * np.array(GRID["a"]) - 2.0 * np.array(GRID["b"]) ** 2


@pytest.mark.parametrize("kind", KINDS)
def test_prediction_meets_the_truth_within_its_deviation(kind):
    found = fit_surrogate(made(), "y", kind)
    mean, deviation = found.predict(GRID)
    # 4 places within 3.5 deviations: 0.2 % by chance; 80 rows of noise 0.1 pin 6 terms to about 0.1 sqrt(6/80) = 0.03
    assert (np.abs(mean - TRUE) < 3.5 * deviation).all()
    assert (deviation < 0.08).all() and (deviation > 0.005).all()
    _, of_run = found.predict(GRID, run=True)
    # the noise of a run: its variance stands on 74 degrees of freedom, 16 % are two deviations of its root
    assert np.sqrt(of_run**2 - deviation**2) == pytest.approx(0.1, rel=0.25)
    # rows in any shape are the same rows
    listed = [{"a": a, "b": b} for a, b in zip(GRID["a"], GRID["b"], strict=True)]
    for rows in (listed, pa.table(GRID)):
        assert (found.predict(rows)[0] == mean).all()
    with pytest.raises(StudyError, match="factor 'b' is missing"):
        found.predict({"a": [1.0]})


@pytest.mark.parametrize("kind", KINDS)
def test_left_out_rows_are_as_a_fit_without_them_has_them(kind):
    """The closed form of leaving out against doing so; of a process with its lengths kept."""
    results = made(24)
    found = fit_surrogate(results, "y", kind)
    mean, deviation = found.model.leave_one_out()
    for i in (0, 7):
        if kind == "quadratic":
            rest = read_results(pa.concat_tables([results.table.slice(0, i), results.table.slice(i + 1)]), ["a", "b"])
            surface = fit_surrogate(rest, "y", kind).model.surface
            expected = float(surface.predict(found.model.x[i]))
        else:
            from warpchain.study.surrogate.gaussian_process import _solved_process

            model, keep = found.model, np.arange(24) != i
            scaling = (model.center, model.scale)
            less = _solved_process(model.x[keep], model.z[keep], model.kernel, model.noise, model.errors[keep], scaling)
            expected, sd = (float(v[0]) for v in less.predict(model.x[[i]]))
            assert deviation[i] == pytest.approx(np.sqrt(sd**2 + model.noise), rel=1e-6)
        assert mean[i] == pytest.approx(expected, rel=1e-7, abs=1e-8)
    checked = found.cross_validated()
    assert checked.q2 > 0.97  # the noise is 0.1 of a deviation of 1.8
    assert checked.coverage > 0.8  # of 24 rows 95 %: fewer than 20 come by chance in 1 of 200


def test_known_errors_take_the_place_of_fitted_noise():
    with_errors = fit_surrogate(made(40, errors=True), "y").model
    assert (with_errors.errors == 0.1).all()
    assert with_errors.noise < 0.1**2  # what is left for v: the errors explain the scatter
    _, sd = fit_surrogate(made(40, errors=True), "y").predict(GRID)
    assert ((sd > 0.005) & (sd < 0.1)).all()


def test_rows_that_scatter_less_count_more_in_q2():
    """Rows of small errors decide: Q2 = 1 - sum w m^2 / sum w (y - y_w)^2, w = 1 / (t^2 + e^2); t = 0 explains m."""
    y, missed, errors = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.1, -3.0, 0.1, 3.0]), np.array([0.1, 3.0, 0.1, 3.0])
    checked = CrossValidation(y, y - missed, np.ones(4), errors)
    weight = errors**-2.0
    center = (weight @ y) / weight.sum()
    assert checked.q2 == pytest.approx(1.0 - (weight @ missed**2) / (weight @ (y - center) ** 2), rel=1e-9)
    assert checked.q2 > 0.95 and CrossValidation(y, y - missed, np.ones(4)).q2 < 0.0


def test_words_are_factors_of_a_process():
    rng = np.random.default_rng(0)
    law, x = np.array(["hunt", "flores"])[rng.integers(0, 2, 60)], rng.random(60)
    y = np.where(law == "hunt", 5.0, 1.0) + x
    found = fit_surrogate(read_results(pa.table({"law": law, "x": x, "y": y}), ["law", "x"]), "y")
    mean, _ = found.predict({"law": ["hunt", "flores"], "x": [0.5, 0.5]})
    assert mean == pytest.approx([5.5, 1.5], abs=0.01)  # no noise: what is left is the jitter of 1e-10 and the search
    with pytest.raises(StudyError, match="'kv' was not run"):
        found.predict({"law": ["kv"], "x": [0.5]})


def test_logarithm_keeps_predictions_above_zero():
    rng = np.random.default_rng(1)
    x = rng.random(60)
    results = read_results(pa.table({"x": x, "y": np.exp(6.0 * x) * np.exp(0.1 * rng.standard_normal(60))}), ["x"])
    for kind in KINDS:
        mean, sd = fit_surrogate(results, "y", kind, logarithm=True).predict({"x": [0.0, 1.0]})
        assert mean == pytest.approx([1.0, np.exp(6.0)], rel=0.2)  # 0.1 over the root of a few rows at the ends
        assert (mean - 3.0 * sd > 0.0).all()
    with pytest.raises(StudyError, match="above 0"):
        fit_surrogate(made(), "y", logarithm=True)


def test_rows_that_are_not_ok_take_no_part():
    table = made(30).table
    status = ["ok"] * 29 + ["suspect"]
    wild = table.set_column(2, "y", pa.array([*table["y"].to_pylist()[:29], 1e9])).append_column("status", [status])
    first = fit_surrogate(read_results(wild, ["a", "b"], ["y"]), "y", "quadratic")
    second = fit_surrogate(read_results(table.slice(0, 29), ["a", "b"], ["y"]), "y", "quadratic")
    assert (first.predict(GRID)[0] == second.predict(GRID)[0]).all()


def test_share_of_scatter_is_that_of_the_rows():
    """Repeated rows: s^2 = (2 + 2) / 3 on 3 degrees of freedom, over the variance of all six values."""
    results = read_results(pa.table({"a": [1, 1, 2, 2, 2, 3], "y": [1.0, 3.0, 4.0, 5.0, 6.0, 9.0]}), ["a"])
    assert scatter_share(results, "y") == pytest.approx(4.0 / 3.0 / np.var([1, 3, 4, 5, 6, 9], ddof=1))
    assert scatter_share(made(10), "y") is None


def test_ranks_are_of_the_rows_that_are_ok():
    table = pa.table({"a": [1, 2, 3, 4], "y": [5.0, -2.0, 1e9, 5.0], "status": ["ok", "ok", "suspect", "ok"]})
    results = read_results(table, ["a"], ["y"])
    assert transform_metric(results, "y", "rank").table["y"].to_pylist() == [2.5, 1.0, None, 2.5]
    with pytest.raises(StudyError, match="no logarithm"):
        transform_metric(results, "y", "log")
    with pytest.raises(StudyError, match="allowed are rank, log"):
        transform_metric(results, "y", "square")


@pytest.mark.parametrize("n", [6, 9, 30, 101])
def test_interval_of_a_median_holds_its_level(n):
    low, high = median_interval(np.arange(1.0, n + 1))
    k = int(low)
    assert (low, high) == (k, n + 1 - k)
    assert 2.0 * binom.cdf(k - 1, n, 0.5) <= 0.05 < 2.0 * binom.cdf(k, n, 0.5)  # the widest k that holds


def test_medians_are_not_upset_by_a_wild_value():
    y = np.r_[np.arange(10.0), 10.0 + np.arange(10.0)]
    y[0] = 1e12
    results = read_results(pa.table({"a": np.repeat([0, 1], 10), "y": y}), ["a"])
    (effect,) = median_effects(results, "y")
    assert effect.medians.tolist() == [5.5, 14.5]
    assert effect.median_span == 9.0
    assert median_interval(np.arange(5.0)) == (-np.inf, np.inf)
