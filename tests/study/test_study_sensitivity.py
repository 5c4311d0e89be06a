"""Sobol' indices against the Ishigami function's closed form and a polynomial's, and SALib's problem dictionary."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import qmc

from warpchain.errors import StudyError
from warpchain.study.analysis.sensitivity import (
    factors_of_problem,
    problem_of_factors,
    problem_of_results,
    saltelli_block_size,
    saltelli_table,
    sobol_indices,
    surface_indices,
)
from warpchain.study.analysis.surface import fit_surface
from warpchain.study.results import export_table, read_results
from warpchain.study.surrogate import fit_surrogate
from warpchain.study.surrogate.indices import best_indices, surrogate_indices

pytest.importorskip("SALib")

A, B = 7.0, 0.1
PROBLEM = {"num_vars": 3, "names": ["x1", "x2", "x3"], "bounds": [[-np.pi, np.pi]] * 3}
"""Ishigami and Homma 1990: y = sin x1 + a sin^2 x2 + b x3^4 sin x1."""


def ishigami(table):
    x1, x2, x3 = (table[name].to_numpy() for name in PROBLEM["names"])
    return np.sin(x1) + A * np.sin(x2) ** 2 + B * x3**4 * np.sin(x1)


def closed_form():
    one = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    two = A**2 / 8.0
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = one + two + both
    return np.array([one, two, 0.0]) / whole, np.array([one + both, two, both]) / whole


@pytest.mark.parametrize("second_order", [False, True])
def test_ishigami(second_order, tmp_path):
    design = saltelli_table(PROBLEM, 2048, seed=3, second_order=second_order)
    assert design.num_rows == 2048 * (8 if second_order else 5)
    table = design.append_column("y", pa.array(ishigami(design)))
    results = read_results(export_table(table, tmp_path / "r.csv"), PROBLEM["names"])  # through text and back
    found = sobol_indices(results, "y", PROBLEM)
    first, total = closed_form()
    # quasi-random estimators of 2,048 blocks: errors of some 1/100
    assert found.first == pytest.approx(first, abs=0.02)
    assert found.total == pytest.approx(total, abs=0.02)
    assert (np.abs(found.first - first) < 2.0 * found.first_error + 1e-3).all()
    assert (found.rows, found.dropped) == (design.num_rows, 0)


def test_a_bad_variant_takes_its_block_out():
    design = saltelli_table(PROBLEM, 1024)
    y, status = ishigami(design), np.full(design.num_rows, "ok", dtype=object)
    y[[7, 503, 504]], status[[7, 503, 504]] = 1e9, "diverged"  # blocks 1 and 100
    table = design.append_column("y", pa.array(y)).append_column("status", pa.array(status))
    shuffled = np.random.default_rng(0).permutation(design.num_rows)  # rows come in any order, with their numbers
    table = table.append_column("variant", pa.array(np.arange(design.num_rows))).take(shuffled)
    found = sobol_indices(read_results(table, PROBLEM["names"]), "y")
    assert (found.rows, found.dropped) == (1022 * 5, 10)
    first, total = closed_form()
    assert found.first == pytest.approx(first, abs=0.04)
    assert found.total == pytest.approx(total, abs=0.04)


def test_indices_of_a_polynomial_surface_are_exact():
    """y = 3 u + v^2 + 2 u v on -1 .. 1: variances 3, 4/45, 4/9."""
    rng = np.random.default_rng(2)
    u, v = np.append(rng.uniform(-1, 1, 38), [-1, 1]), np.append(rng.uniform(-1, 1, 38), [1, -1])
    table = pa.table({"a": 5.0 + 2.0 * u, "b": 1e4 * v, "c": rng.random(40), "y": 3.0 * u + v**2 + 2.0 * u * v})
    found = surface_indices(fit_surface(read_results(table, ["a", "b", "c"]), "y"))
    whole = 3.0 + 4.0 / 45.0 + 4.0 / 9.0
    assert found.first == pytest.approx(np.array([3.0, 4.0 / 45.0, 0.0]) / whole, abs=1e-12)
    assert found.total == pytest.approx(np.array([3.0 + 4.0 / 9.0, 24.0 / 45.0, 0.0]) / whole, abs=1e-12)


def test_the_better_way_is_taken():
    design = saltelli_table(PROBLEM, 256)
    table = read_results(design.append_column("y", pa.array(ishigami(design))), PROBLEM["names"])
    found, words = best_indices(table, "y")
    assert words.startswith("by a Saltelli design of 1280 variants")
    assert found.first_error.min() > 0.0
    loose = read_results(table.table.slice(3), PROBLEM["names"])
    found, words = best_indices(loose, "y")  # sin x1 is no quadratic
    assert re.match(r"of the Gaussian process of 1000 variants \(cross-validated Q² = 0\.9", words)
    first, total = closed_form()
    # what the process misses of the variance is below 1 %, and 1,024 quasi-random rows are good to some 1/100
    assert found.first == pytest.approx(first, abs=0.02)
    assert found.total == pytest.approx(total, abs=0.02)
    line = read_results(loose.table.append_column("z", loose.table["x1"]), PROBLEM["names"])
    found, words = best_indices(line, "z")
    assert words.startswith("of the response surface")
    assert found.first == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_indices_of_a_process_are_of_the_study_s_distributions_and_of_words():
    """y = a + [w = "v"] with a normal of deviation 1/2 and w a word of two: variances 1/4 and 1/4."""
    rng = np.random.default_rng(6)
    a, w = rng.uniform(-2.0, 2.0, 120), rng.choice(["u", "v"], 120)
    normal = {"role": "factor", "distribution": '{"distribution": "normal", "mean": 0.0, "std": 0.5}'}
    fields = [pa.field("a", pa.float64(), metadata=normal), pa.field("w", pa.string()), pa.field("y", pa.float64())]
    table = pa.Table.from_arrays([pa.array(a), pa.array(w), pa.array(a + (w == "v"))], schema=pa.schema(fields))
    results = read_results(table, ["a", "w"], ["y"])
    found = surrogate_indices(fit_surrogate(results, "y"), results)
    assert found.factors == ("a", "w")
    assert found.first == pytest.approx([0.5, 0.5], abs=0.02)
    assert found.total == pytest.approx([0.5, 0.5], abs=0.02)
    _, words = best_indices(results, "y")
    assert "a distributed as in the study, the others uniform over their range" in words


@pytest.mark.long
def test_intervals_of_a_process_s_indices_hold():
    """y = 3 u + 2 v^2 + 2 u w on -1 .. 1 with a scatter of 0.3 deviations in each of 4 runs of 40 rows: variances 3,
    16/45 and 4/9. Lengths and noise are taken as fitted: so 95 % intervals hold in some 90 %, 66 of these 72; fewer
    than 55 would come by chance in 1 of 1000, if they were independent."""
    held = []
    whole = 3.0 + 16.0 / 45.0 + 4.0 / 9.0
    first, total = np.array([3.0, 16.0 / 45.0, 0.0]) / whole, np.array([31.0 / 9.0, 16.0 / 45.0, 4.0 / 9.0]) / whole
    for seed in range(12):
        random = np.random.default_rng(seed)
        u, v, w = 2.0 * qmc.LatinHypercube(3, seed=seed).random(40).T - 1.0
        runs = (3.0 * u + 2.0 * v * v + 2.0 * u * w)[:, None] + 0.3 * random.standard_normal((40, 4))
        columns = {
            "u": u,
            "v": v,
            "w": w,
            "y": runs.mean(axis=1),
            "y_se": runs.std(axis=1, ddof=1) / 2.0,
            "n": [4] * 40,
        }
        results = read_results(pa.table(columns), ["u", "v", "w"], ["y"])
        found = surrogate_indices(fit_surrogate(results, "y"), results)
        held += [np.abs(found.first - first) <= found.first_error, np.abs(found.total - total) <= found.total_error]
        assert found.total_error.max() < 0.15  # a fifteenth of the variance is not told
    assert np.sum(held) >= 55


def test_scatter_between_equal_runs_is_in_no_index():
    """y = a + 0 b with four runs of a row that scatter as much as a does: a makes all of what is not scatter."""
    problem = {"names": ["a", "b"], "bounds": [[-1.0, 1.0]] * 2}
    design = saltelli_table(problem, 1024, seed=1)
    random = np.random.default_rng(2)
    runs = design["a"].to_numpy()[:, None] + math.sqrt(1.0 / 3.0) * random.standard_normal((design.num_rows, 4))
    table = design.append_column("y", pa.array(runs.mean(axis=1)))
    table = table.append_column("y_se", pa.array(runs.std(axis=1, ddof=1) / 2.0)).append_column("n", [[4] * len(runs)])
    found = sobol_indices(read_results(table, ["a", "b"], ["y"]), "y")
    # of the rows' means scatter makes a fifth: uncorrected a would do 0.8, and b 0.2 with interactions
    assert found.first == pytest.approx([1.0, 0.0], abs=0.06)
    assert found.total == pytest.approx([1.0, 0.0], abs=0.06)
    assert (np.abs(found.first - [1.0, 0.0]) < 2.0 * found.first_error).all()
    same = table.set_column(2, "y", pa.array(random.standard_normal(len(runs)))).set_column(
        3, "y_se", pa.array(np.ones(len(runs)))
    )
    with pytest.raises(StudyError, match="scatter as much as the variants differ"):
        sobol_indices(read_results(same, ["a", "b"], ["y"]), "y")


def test_a_refusal_says_q2_and_what_would_help():
    """Rows whose variance is scatter to three quarters: Q2 cannot be above 1/4; more replicates bring it."""
    random = np.random.default_rng(3)
    a = random.uniform(-1.0, 1.0, 60)
    runs = a[:, None] + math.sqrt(2.0) * random.standard_normal((60, 2))
    columns = {"a": a, "b": random.random(60), "y": runs.mean(axis=1), "n": [2] * 60}
    columns["y_se"] = np.abs(runs[:, 0] - runs[:, 1]) / 2.0
    with pytest.raises(
        StudyError, match=r"Q² = 0\.\d+.*0\.8 is needed.*Q² stays below 0\.\d.*replicates help, some \d+ a row"
    ):
        best_indices(read_results(pa.table(columns), ["a", "b"], ["y"]), "y")
    wild = {"a": a, "b": random.random(60), "y": np.sin(40.0 * a) + 1e-3 * runs[:, 0]}
    with pytest.raises(StudyError, match="60 variants are there: more variants help, or"):
        best_indices(read_results(pa.table(wild), ["a", "b"], ["y"]), "y")


def test_saltelli_designs_are_told_from_others():
    design = saltelli_table(PROBLEM, 8)
    names = PROBLEM["names"]
    assert saltelli_block_size(read_results(design, names), names) == 5
    assert saltelli_block_size(read_results(saltelli_table(PROBLEM, 8, second_order=True), names), names) == 8
    other = pa.table(dict(zip(names, np.random.default_rng(1).random((3, 40)), strict=True)))
    assert saltelli_block_size(read_results(other, names), names) == 0
    with pytest.raises(StudyError, match="no Saltelli design of x1, x2, x3"):
        sobol_indices(read_results(other.append_column("y", other["x1"]), names), "y")


def test_problems_and_factors_turn_into_each_other():
    factors = [
        SimpleNamespace(name="a", value_source="uniform", range=(1.0, 2.0), mean=None, std=None),
        SimpleNamespace(name="b", value_source="log-uniform", range=(1e3, 1e6), mean=None, std=None),
        SimpleNamespace(name="c", value_source="normal", range=None, mean=5.0, std=0.5),
        SimpleNamespace(name="d", value_source="truncated-normal", range=(0.0, 1.0), mean=0.5, std=0.2),
        SimpleNamespace(name="e", value_source="expression", range=None, mean=None, std=None),
    ]
    problem = problem_of_factors(factors)
    assert problem == {
        "num_vars": 4,
        "names": ["a", "b", "c", "d"],
        "bounds": [[1.0, 2.0], [1e3, 1e6], [5.0, 0.5], [0.0, 1.0, 0.5, 0.2]],
        "dists": ["unif", "logunif", "norm", "truncnorm"],
    }
    design = saltelli_table(problem, 16)  # SALib takes it
    assert np.ptp(np.log10(design["b"].to_numpy())) > 2.0
    tables = factors_of_problem(problem, {"a": "chain.roller_mass"})
    assert tables[0] == {"name": "a", "path": "chain.roller_mass", "distribution": "uniform", "range": [1.0, 2.0]}
    empty = {"range": None, "mean": None, "std": None}
    assert (
        problem_of_factors([SimpleNamespace(**empty | {"value_source": t["distribution"]} | t) for t in tables])
        == problem
    )
    results = read_results(design.append_column("y", design["a"]), problem["names"])
    assert problem_of_results(results)["names"] == problem["names"]


def test_refusals():
    design, names = saltelli_table(PROBLEM, 4), PROBLEM["names"]
    lost = design.append_column("y", pa.array([None] * design.num_rows, pa.float64()))
    same = design.append_column("y", pa.array(np.ones(design.num_rows)))
    one = {"names": ["a"], "bounds": [[0, 1]]}
    for match, call in {
        "power of two": lambda: saltelli_table(PROBLEM, 100),
        "'bounds' is missing": lambda: saltelli_table({"names": ["a"]}, 8),
        "equally many": lambda: saltelli_table({"names": ["a"], "bounds": [[0, 1], [0, 1]]}, 8),
        "groups": lambda: factors_of_problem(one | {"groups": ["g"]}),
        "'triang' of 'a'": lambda: factors_of_problem(one | {"dists": ["triang"]}),
        "choice is not a distribution": lambda: problem_of_factors([SimpleNamespace(name="a", value_source="choice")]),
        "0 whole blocks": lambda: sobol_indices(read_results(lost, names), "y"),
        "does not vary": lambda: sobol_indices(read_results(same, names), "y"),
    }.items():
        with pytest.raises(StudyError, match=match):
            call()
