"""Analysis of a study's table against closed forms: linear models, polynomials, known fronts."""

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from warpchain.errors import StudyError
from warpchain.study.analysis import correlation, main_effects
from warpchain.study.analysis.pareto import is_non_dominated, pareto_front
from warpchain.study.analysis.surface import fit_surface
from warpchain.study.results import export_table, read_results


def results(columns, factors):
    return read_results(pa.table({"variant": range(len(next(iter(columns.values())))), **columns}), factors)


def grid():
    """3 x 4 full factorial."""
    a, b = np.meshgrid([0.0, 1.0, 2.0], [10.0, 20.0, 30.0, 40.0], indexing="ij")
    return a.ravel(), b.ravel()


def test_main_effects_of_a_linear_model_are_its_slopes():
    a, b = grid()
    effects = main_effects(results({"a": a, "b": b, "y": 5.0 * a - 0.1 * b}, ["a", "b"]), "y")
    by = {effect.factor: effect for effect in effects}
    # a full factorial is balanced: the other factor's mean drops out, exactly
    assert np.allclose(np.diff(by["a"].means), 5.0, atol=1e-12)
    assert np.allclose(np.diff(by["b"].means), -1.0, atol=1e-12)
    assert [effect.factor for effect in effects] == ["a", "b"]
    # variances of the two terms, 25 * 2/3 and 0.01 * 125, add up to the whole
    assert by["a"].explained == pytest.approx((50 / 3) / (50 / 3 + 1.25), rel=1e-12)
    assert by["a"].explained + by["b"].explained == pytest.approx(1.0, abs=1e-12)


def test_words_and_many_values_are_grouped():
    rng = np.random.default_rng(1)
    x = rng.random(400)
    words = np.where(x < 0.25, "stiff", "soft")
    table = results({"x": x, "law": words, "y": x}, ["x", "law"])
    x_effect, law = main_effects(table, "y")
    assert (x_effect.factor, law.factor) == ("x", "law")
    assert (len(x_effect.counts), set(x_effect.counts)) == (8, {50})
    # quantile groups of a uniform factor: means 1/16, 3/16, ...; standard error of a group 1/8/sqrt(12)/sqrt(50)
    assert np.allclose(x_effect.means, (np.arange(8) + 0.5) / 8, atol=0.05)
    assert x_effect.errors == pytest.approx(np.full(8, 0.125 / np.sqrt(12 * 50)), rel=0.4)
    assert law.labels == ("soft", "stiff")
    assert law.means == pytest.approx([x[x >= 0.25].mean(), x[x < 0.25].mean()], rel=1e-12)


def test_variants_that_did_not_end_are_left_out():
    status = ["ok", "ok", "diverged", "infeasible"]
    table = results({"x": [1.0, 2.0, 3.0, 4.0], "y": [1.0, 2.0, 1e9, None], "status": status}, ["x"])
    (effect,) = main_effects(table, "y")
    assert effect.means.tolist() == [1.0, 2.0]
    assert table.reason_counts() == [("diverged", "no reason given", 1), ("infeasible", "no reason given", 1)]


def test_correlations_are_those_of_scipy():
    rng = np.random.default_rng(2)
    x, noise = rng.random(60), rng.random(60)
    y = np.exp(4.0 * x) + noise
    coarse = np.round(5.0 * x)
    both = correlation(results({"x": x, "coarse": coarse, "y": y, "one": np.ones(60)}, ["x", "coarse"]))
    assert both.metrics == ("y",)
    assert both.pearson[:, 0] == pytest.approx([stats.pearsonr(v, y)[0] for v in (x, coarse)], rel=1e-12)
    assert both.spearman[:, 0] == pytest.approx([stats.spearmanr(v, y)[0] for v in (x, coarse)], rel=1e-12)
    assert both.noise_level() == pytest.approx(1.96 / np.sqrt(59))


def test_a_monotone_curve_has_rank_correlation_one():
    x = np.linspace(0.0, 1.0, 30)
    both = correlation(results({"x": x, "y": x**9}, ["x"]))
    assert both.spearman[0, 0] == pytest.approx(1.0, abs=1e-14) and both.pearson[0, 0] < 0.9


def test_front_of_a_quarter_circle_is_the_circle():
    angle = np.linspace(0.0, np.pi / 2, 21)
    radius = np.array([1.0, 1.2, 1.5])
    x = 2.0 - np.outer(1.0 / radius, np.cos(angle)).ravel()
    y = 2.0 - np.outer(1.0 / radius, np.sin(angle)).ravel()
    table = results({"f": np.arange(63.0), "x": x, "y": y, "gain": -y}, ["f"])
    assert sorted(pareto_front(table, {"x": "min", "y": "min"})) == list(range(21))
    assert pareto_front(table, {"x": "min", "gain": "max"}).tolist() == list(range(21))


def test_front_is_what_its_definition_says():
    rng = np.random.default_rng(3)
    costs = rng.integers(0, 6, (120, 3)).astype(float)  # with ties and equal rows
    lower, nowhere_higher = costs[:, None] < costs[None], costs[:, None] <= costs[None]
    dominated = (nowhere_higher.all(axis=2) & lower.any(axis=2)).any(axis=0)
    assert np.array_equal(is_non_dominated(costs), ~dominated)


def test_surface_recovers_a_quadratic_exactly():
    rng = np.random.default_rng(4)
    a, b = rng.uniform(2.0, 5.0, 30), rng.uniform(-1e3, 1e3, 30)
    y = 3.0 + 2.0 * a - 0.5 * a**2 + 1e-3 * a * b + 1e-6 * b**2
    surface = fit_surface(results({"a": a, "b": b, "y": y}, ["a", "b"]), "y")
    assert surface.r2 == pytest.approx(1.0, abs=1e-12)
    assert surface.r2_predicted == pytest.approx(1.0, abs=1e-10)
    # least squares in float64 with a condition number of order 10
    assert surface.predict(np.array([3.0, 500.0])) == pytest.approx(3 + 6 - 4.5 + 1.5 + 0.25, rel=1e-12)
    values, along = surface.factor_slice("a")
    middle = 0.5 * (b.min() + b.max())
    assert along == pytest.approx(3 + 2 * values - 0.5 * values**2 + 1e-3 * values * middle + 1e-6 * middle**2)


def test_predicted_r2_is_that_of_leaving_one_out():
    rng = np.random.default_rng(5)
    a = rng.uniform(-1.0, 1.0, 12)
    y = np.sin(3.0 * a) + 0.3 * rng.standard_normal(12)
    surface = fit_surface(results({"a": a, "y": y}, ["a"]), "y")
    missed = [y[k] - np.polyval(np.polyfit(np.delete(a, k), np.delete(y, k), 2), a[k]) for k in range(12)]
    assert surface.r2_predicted == pytest.approx(1.0 - np.square(missed).sum() / np.square(y - y.mean()).sum())
    assert surface.r2_predicted < surface.r2


def test_two_levels_have_no_square_and_few_rows_give_a_plane():
    a, b = np.meshgrid([0.0, 1.0], [0.0, 1.0, 2.0])
    table = results({"a": a.ravel(), "b": b.ravel(), "y": (a + b**2 + a * b).ravel()}, ["a", "b"])
    surface = fit_surface(table, "y")
    assert len(surface.powers) == 5
    assert surface.r2 == pytest.approx(1.0, abs=1e-12)
    few = fit_surface(results({"a": [0.0, 0.3, 0.6, 1.0], "b": [0.0, 1.0, 0.2, 0.7], "y": [1.0, 2, 3, 5]}, "ab"), "y")
    assert len(few.powers) == 3


def test_tied_factors_count_once():
    a = np.linspace(0.0, 1.0, 9)
    table = results({"a": a, "tied": 5.0 - 2.0 * a, "word": ["x"] * 9, "y": a**2}, ["a", "tied", "word"])
    assert table.independent_factors() == ("a",)
    assert table.factor_ties() == {"tied": "a"}
    assert [effect.factor for effect in main_effects(table, "y")] == ["a"]
    assert [effect.factor for effect in main_effects(table, "y", ("tied",))] == ["tied"]
    assert correlation(table).factors == ("a",)
    assert fit_surface(table, "y").r2 == pytest.approx(1.0, abs=1e-12)


def test_rows_without_a_factors_value_are_left_out():
    a = [0.0, 1.0, None, 3.0, 4.0, 5.0]
    table = results({"a": a, "teeth": [20, 21, 22, 23, 21, 20], "y": [0.0, 2.0, 99.0, 6.0, 8.0, 10.0]}, ["a", "teeth"])
    assert fit_surface(table, "y", ("a",)).r2 == pytest.approx(1.0, abs=1e-12)
    assert fit_surface(table, "y", ("a",)).rows == 5
    assert correlation(table).pearson[0, 0] == pytest.approx(1.0, abs=1e-12)
    effects = {effect.factor: effect for effect in main_effects(table, "y")}
    assert effects["a"].means.tolist() == [0.0, 2.0, 6.0, 8.0, 10.0]
    assert effects["teeth"].means.tolist() == [5.0, 5.0, 99.0, 6.0]


def test_reasons_that_differ_in_numbers_are_one():
    status = ["infeasible"] * 3 + ["diverged", "ok"]
    reasons = ["strain 1e-3 beyond 0.05", "strain -0.2 beyond 0.05", "no place", "diverged at 0.1 s", None]
    table = results({"x": np.arange(5.0), "y": np.arange(5.0), "status": status, "reason": reasons}, ["x"])
    told = [("infeasible", "strain 1e-3 beyond 0.05", 2), ("infeasible", "no place", 1)]
    assert table.reason_counts() == [*told, ("diverged", "diverged at 0.1 s", 1)]


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_tables_come_back_from_files(tmp_path, ending):
    table = pa.table({"variant": [0, 1], "law": ["a", "b"], "y": [0.1, 1e300], "status": ["ok", "diverged"]})
    path = export_table(table, tmp_path / f"t.{ending}")
    assert [file.name for file in tmp_path.iterdir()] == [f"t.{ending}"]
    back = read_results(path, ["law"])
    assert back.table.to_pylist() == table.to_pylist()
    assert back.metrics == ("y",)


def test_units_come_back_from_a_head(tmp_path):
    """A name may end in brackets itself, but not in those of a unit behind a blank; ratios have none."""
    fields = [("variant", "1"), ("arm.angle_mean", "rad"), ("k[2]", "N m"), ("ratio", "1")]
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in fields])
    table = pa.table({name: [0.25, 1.0] for name, _ in fields}, schema=schema)
    path = export_table(table, tmp_path / "t.csv")
    assert path.read_text().splitlines()[0] == '"variant","arm.angle_mean [rad]","k[2] [N m]","ratio"'
    back = read_results(path, ["k[2]"])
    assert back.table.to_pylist() == table.to_pylist()
    assert [back.column_unit(name) for name, _ in fields[1:]] == ["rad", "N m", ""]


def test_roles_are_read_from_the_fields():
    factor = pa.field("a", pa.float64(), metadata={"role": "factor", "unit": "mm"})
    schema = pa.schema([factor, ("tension_max", pa.float64())])
    found = read_results(pa.table({"a": [1.0, 2.0], "tension_max": [3.0, None]}, schema=schema))
    assert (found.factors, found.metrics) == (("a",), ("tension_max",))
    assert (found.column_unit("a"), found.column_unit("tension_max")) == ("mm", "N")
    assert np.isnan(found.values("tension_max")[1])


def test_refusals_are_one_line(tmp_path):
    table = pa.table({"a": [1.0, 2.0], "law": ["x", "y"], "y": [1.0, 2.0]})
    ok = read_results(table, ["a", "law"])
    for name in ("bad.parquet", "t.xlsx"):
        (tmp_path / name).write_text("no")
    cases = [
        (lambda: read_results(table), "factors: none given"),
        (lambda: read_results(table, ["z"]), "factors: 'z' is not in the table"),
        (lambda: read_results(table, ["a"], ["z"]), "metrics: 'z' is not in the table"),
        (lambda: read_results(table.append_column("status", pa.array(["ok", "lost"])), ["a"]), "'lost' is unknown"),
        (lambda: read_results(tmp_path / "absent.csv", ["a"]), "absent.csv: cannot be read"),
        (lambda: read_results(tmp_path / "bad.parquet", ["a"]), "bad.parquet: not a table"),
        (lambda: read_results(tmp_path / "t.xlsx", ["a"]), "allowed are tables"),
        (lambda: export_table(table, tmp_path / "t.xlsx"), "allowed endings"),
        (lambda: export_table(table, tmp_path / "absent" / "t.csv"), "cannot be written"),
        (lambda: ok.values("law"), "numbers are needed"),
        (lambda: ok.values("b"), "not in the table"),
        (lambda: fit_surface(ok, "y"), "2 variants, 1 factors need 3"),
        (lambda: fit_surface(ok, "y", ("law",)), "numbers are needed"),
        (lambda: pareto_front(ok, {}), "at least one"),
        (lambda: pareto_front(ok, {"y": "min", "a": "low"}), "allowed are"),
        (lambda: correlation(ok), "at least 3"),
    ]
    for call, message in cases:
        with pytest.raises(StudyError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
