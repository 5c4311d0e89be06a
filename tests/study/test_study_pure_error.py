"""Scatter between equal runs: analysis of variance by its definition, intervals that hold as often as they say."""

import math

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from warpchain.errors import StudyError
from warpchain.study.analysis import main_effects, pure_error, pure_errors
from warpchain.study.analysis.pareto import front_chances
from warpchain.study.analysis.pure_error import row_standard_errors
from warpchain.study.analysis.surface import fit_surface, lack_of_fit
from warpchain.study.results import read_results


def replicated(x, runs, more=None):
    """Results of rows at x (R,) with runs (R, n), as a study has them."""
    runs = np.asarray(runs, dtype=float)
    count = runs.shape[1]
    columns = {"x": x, "y": runs.mean(axis=1), "y_se": runs.std(axis=1, ddof=1) / math.sqrt(count)}
    return read_results(pa.table({**columns, "n": [count] * len(runs), **(more or {})}), ["x"])


def test_scatter_is_that_of_an_analysis_of_variance():
    random = np.random.default_rng(1)
    level = np.array([0.0, 1.0, 5.0, 2.0])
    runs = level[:, None] + random.standard_normal((4, 6))
    found = pure_error(replicated(np.arange(4.0), runs), "y")
    assert (found.rows, found.runs, found.freedom) == (4, 24, 20)
    within = ((runs - runs.mean(axis=1, keepdims=True)) ** 2).sum() / 20
    assert found.deviation == pytest.approx(math.sqrt(within), rel=1e-12)
    between = 6 * ((runs.mean(axis=1) - runs.mean()) ** 2).sum() / 3
    assert found.share == pytest.approx(within / (within + (between - within) / 6), rel=1e-12)
    assert stats.f_oneway(*runs).statistic == pytest.approx(between / within)  # the F of (b)
    assert found.share_low < found.share < found.share_high
    square = stats.chi2.ppf([0.975, 0.025], 20)
    assert [found.low, found.high] == pytest.approx(np.sqrt(20 * within / square), rel=1e-9)


def test_repeated_rows_of_any_table_tell_the_same():
    random = np.random.default_rng(2)
    runs = np.array([0.0, 3.0, 1.0])[:, None] + random.standard_normal((3, 4))
    table = pa.table({"x": np.repeat([1.0, 2.0, 3.0], 4), "y": runs.ravel()})
    several, single = replicated([1.0, 2.0, 3.0], runs), read_results(table, ["x"])
    mine, theirs = pure_error(several, "y"), pure_error(single, "y")
    assert (mine.rows, mine.runs, mine.freedom) == (theirs.rows, theirs.runs, theirs.freedom)
    assert (mine.deviation, mine.share) == pytest.approx((theirs.deviation, theirs.share), rel=1e-12)
    line, same = (fit_surface(results, "y", ("x",)) for results in (several, single))
    assert line.coefficients[:2] is not None and len(same.coefficients) == 3  # a quadratic fits three unlike rows
    with pytest.raises(StudyError, match="as many terms as unlike variants"):
        lack_of_fit(single, same)


def test_intervals_hold_as_often_as_they_say():
    """95 % of 400 repetitions, within three standard deviations of such a count, 3 sqrt(0.95 0.05 / 400) = 3.3 %."""
    random = np.random.default_rng(3)
    held = np.zeros(3)
    for _ in range(400):
        runs = 2.0 * random.standard_normal((30, 1)) + random.standard_normal((30, 3))
        found = pure_error(replicated(np.arange(30.0), runs), "y")
        held[0] += found.share_low <= 0.2 <= found.share_high  # 1 / (1 + 4)
        held[1] += found.low <= 1.0 <= found.high
        held[2] += abs(random.standard_normal(5).mean()) <= found.interval(5)
    assert held / 400 == pytest.approx(np.full(3, 0.95), abs=0.033)


def test_how_many_runs_and_how_long_a_window_a_precision_takes():
    random = np.random.default_rng(4)
    found = pure_error(replicated(np.arange(50.0), 3.0 * random.standard_normal((50, 5))), "y")
    t = stats.t.ppf(0.975, 200)
    assert found.interval(4) == pytest.approx(t * found.deviation / 2.0, rel=1e-12)
    assert found.replicates_for(found.interval(4)) == 4
    assert found.replicates_for(0.999 * found.interval(4)) == 5
    assert found.replicates_for(1e9) == 1
    # half the interval takes four times the window
    assert found.window_for(0.5 * found.interval(3), 0.2, 3) == pytest.approx(0.8)
    with pytest.raises(StudyError, match="must be a positive number"):
        found.replicates_for(0.0)


def test_the_part_that_a_factor_explains_has_the_interval_of_noncentral_f():
    random = np.random.default_rng(5)
    x = np.repeat([0.0, 1.0, 2.0], 20)
    table = read_results(pa.table({"x": x, "y": x + random.standard_normal(60)}), ["x"])
    (effect,) = main_effects(table, "y")
    ratio = stats.f_oneway(*np.reshape(table.values("y"), (3, 20)))
    assert effect.chance == pytest.approx(ratio.pvalue, rel=1e-9)
    low, high = effect.explained_interval
    for end, share in ((low, 0.975), (high, 0.025)):
        assert stats.ncf.cdf(ratio.statistic, 2, 57, 60 * end / (1 - end)) == pytest.approx(share, abs=1e-6)
    assert low < effect.explained < high
    t = stats.t.ppf(0.975, 19)
    assert effect.intervals == pytest.approx(t * effect.errors, rel=1e-12)
    (whole,) = main_effects(read_results(pa.table({"x": x, "y": x}), ["x"]), "y")
    assert (whole.chance, whole.explained_interval) == (0.0, (1.0, 1.0))


def test_what_chance_explains_is_told_from_what_a_factor_does():
    """A factor that does nothing: its interval begins at 0 in 97.5 % of 300 repetitions (within 3 standard deviations,
    2.7 %), though it seems to explain 1/6 of 13 rows in two groups or more."""
    random = np.random.default_rng(6)
    zero = 0
    for _ in range(300):
        table = read_results(pa.table({"x": [0.0, 1.0, 2.0] * 5, "y": random.standard_normal(15)}), ["x"])
        zero += main_effects(table, "y")[0].explained_interval[0] == 0.0
    assert zero / 300 == pytest.approx(0.975, abs=0.027)


def test_a_groups_mean_scatters_by_its_runs():
    random = np.random.default_rng(7)
    runs = np.repeat([0.0, 4.0], 8)[:, None] + random.standard_normal((16, 3))
    results = replicated(np.repeat([0.0, 1.0], 8), runs)
    (effect,) = main_effects(results, "y")
    assert effect.scatter == pytest.approx(pure_error(results, "y").deviation / np.full(2, math.sqrt(24.0)), rel=1e-12)


def test_errors_of_a_line_are_those_of_its_formula():
    """Slope of y over x by least squares: error s / sqrt(sum (x - mean)^2), here with x on -1 .. 1."""
    random = np.random.default_rng(8)
    x = np.repeat([-1.0, 1.0], 10)
    table = read_results(pa.table({"x": x, "y": 2.0 * x + random.standard_normal(20)}), ["x"])
    line = fit_surface(table, "y")
    found = stats.linregress(x, table.values("y"))
    ((factor, effect, half),) = line.factor_effects()
    assert (factor, effect) == ("x", pytest.approx(2.0 * found.slope))
    assert half == pytest.approx(2.0 * stats.t.ppf(0.975, 18) * found.stderr, rel=1e-9)


def test_rows_of_more_runs_count_more():
    """A line through two places: each place's mean over its runs, where rows differ by no more than runs scatter."""
    table = pa.table({"x": [0.0, 0.0, 1.0, 1.0], "y": [1.0, 2.0, 2.0, 2.0], "y_se": [1.0, 1.0, 1.0, 1.0],
                      "n": [3, 1, 2, 2]})  # fmt: skip
    line = fit_surface(read_results(table, ["x"]), "y")
    assert line.predict(np.array([[0.0], [1.0]])) == pytest.approx([5.0 / 4.0, 2.0], rel=1e-12)


def test_errors_are_those_of_all_rows_unless_rows_scatter_unlike():
    """Rows that scatter alike have s / sqrt(n), whatever their own few runs say; rows that do not keep their own."""
    random = np.random.default_rng(12)
    alike = replicated(np.arange(6.0), np.array([[-1.0, 1.0]] * 6) + np.arange(6.0)[:, None])
    assert row_standard_errors(alike, "y") == pytest.approx(np.full(6, 1.0), rel=1e-12)  # s^2 = 2, of two runs
    single = read_results(alike.table.set_column(3, "n", pa.array([2, 2, 2, 2, 2, 1])), ["x"])
    assert row_standard_errors(single, "y")[5] == pytest.approx(math.sqrt(2.0), rel=1e-12)
    deviation = np.repeat([0.01, 3.0], 10)
    found = row_standard_errors(replicated(np.arange(20.0), deviation[:, None] * random.standard_normal((20, 9))), "y")
    # 8 degrees of freedom: a deviation is known to 1 / sqrt(16) = 25 %; four of these
    assert found == pytest.approx(deviation / 3.0, rel=1.0)


def test_rows_that_scatter_less_count_more():
    """Rows of deviations 0.05 and 3: with the best weights the slope's variance is that of (X' S^-1 X)^-1, 60 times
    less than by least squares. A deviation of 100 repetitions is good to 7 %; weights from 8 runs each cost some 10 %.
    """
    random = np.random.default_rng(13)
    x, deviation = np.linspace(-1.0, 1.0, 20), np.tile([0.05, 3.0], 10)
    terms = np.stack([np.ones(20), x, x * x], axis=1)
    ideal = np.linalg.inv(terms.T @ (terms / (deviation[:, None] ** 2 / 8.0)))[1, 1]
    slopes, halves = [], []
    for _ in range(100):
        runs = x[:, None] + deviation[:, None] * random.standard_normal((20, 8))
        ((_, effect, half),) = fit_surface(replicated(x, runs), "y").factor_effects()
        slopes.append(0.5 * effect)
        halves.append(0.5 * half)
    assert np.std(slopes) < 1.5 * math.sqrt(ideal)
    inside = np.mean(np.abs(np.array(slopes) - 1.0) < halves)
    assert inside > 0.88  # 95 % less three deviations of 2.2 %


def test_lack_of_fit_is_seen_and_is_not_seen_where_there_is_none():
    """A right surface is blamed in 5 % of 300 repetitions (within 3 standard deviations, 3.8 %), a wrong one always."""
    random = np.random.default_rng(9)
    x = np.linspace(-1.0, 1.0, 9)
    blamed = {"quadratic": 0, "cubic": 0}
    for _ in range(300):
        for form, y in (("quadratic", 1.0 + x + x**2), ("cubic", 3.0 * x**3)):
            results = replicated(x, y[:, None] + 0.3 * random.standard_normal((9, 4)))
            blamed[form] += lack_of_fit(results, fit_surface(results, "y")).chance < 0.05
    assert blamed["quadratic"] / 300 == pytest.approx(0.05, abs=0.038)
    assert blamed["cubic"] > 295


def test_chance_of_a_place_on_the_front():
    """Of two rows, one better by d in one metric that scatters, and better in another that does not: the other row is
    on the front with the probability Phi(-d / (sqrt(2) error)); 400 draws have a standard deviation below 2.5 %."""
    random = np.random.default_rng(10)
    runs = np.array([0.0, 1.0])[:, None] + random.standard_normal((2, 50))
    results = replicated([0.0, 1.0], runs, {"z": [0.0, 5.0]})
    pure = pure_error(results, "y")
    apart = results.values("y")[1] - results.values("y")[0]
    wanted = stats.norm.cdf(-apart / math.sqrt(2.0) / (pure.deviation / math.sqrt(50.0)))
    chances = front_chances(results, {"y": "min", "z": "min"})
    assert chances[0] == 1.0
    assert chances[1] == pytest.approx(wanted, abs=0.1)
    equal = replicated([0.0, 1.0, 2.0], np.array([[0.0, 2.0], [0.1, 2.1], [50.0, 52.0]]), {"z": [0.0, 0.0, 1.0]})
    chances = front_chances(equal, {"y": "min", "z": "min"})
    assert chances[0] == pytest.approx(0.53, abs=0.1)  # by 0.1 of an error of one
    assert chances[2] == 0.0


def test_metrics_are_listed_by_their_scatter_and_refusals_are_one_line():
    random = np.random.default_rng(11)
    runs = np.arange(6.0)[:, None] + random.standard_normal((6, 3))
    calm = np.arange(6.0)[:, None] + 0.01 * random.standard_normal((6, 3))
    results = replicated(np.arange(6.0), runs, {"z": calm.mean(axis=1), "z_se": calm.std(axis=1, ddof=1) / 3**0.5})
    assert [error.metric for error in pure_errors(results)] == ["y", "z"]
    assert "of its variance is scatter between equal runs" in str(pure_errors(results)[0])
    single = read_results(pa.table({"x": [1.0, 2.0], "y": [1.0, 2.0]}), ["x"])
    with pytest.raises(StudyError, match="no row was run several times"):
        pure_error(single, "y")
    same = read_results(pa.table({"x": [1.0, 1.0], "y": [1.0, 1.0]}), ["x"])
    with pytest.raises(StudyError, match="equal runs give equal values"):
        pure_error(same, "y")
