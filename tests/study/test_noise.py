"""Noise apart from design: its rows, statistics over it, searches and reports that recommend design factors only."""

import re

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from scipy.stats import kstest, norm, spearmanr
from study_helpers import LIMITS, SAMPLED, write_study

from warpchain.cli import main
from warpchain.drive import load_drive
from warpchain.errors import StudyError
from warpchain.study.analysis.over_noise import Designs, designs_over_noise, goals_of_designs, noise_spread
from warpchain.study.analysis.pareto import goals_of_study
from warpchain.study.design import make_design
from warpchain.study.design.noise_rows import noise_points, noise_rows, noise_rows_of_normals
from warpchain.study.optimize import Optimizer, optimize, recommend
from warpchain.study.report import study_report_html
from warpchain.study.report.decision_sections import ReportGoals
from warpchain.study.results import read_results
from warpchain.study.run import join_studies, run_study
from warpchain.study.spec import Study, dumps_study, load_study, loads_study

MU = {"name": "mu", "path": "x.mu", "kind": "noise", "range": [0.05, 0.25]}


def study_of(factors, count=8, **more):
    told = {"study": {"drive": "none"}, "design": {"kind": "sobol", "count": count}, "factors": factors}
    return Study.model_validate(told | more)


def designs(names, **more):
    return [{"name": name, "path": f"x.{name}", "range": [0.0, 1.0]} for name in names]


def run_of(study, functions, rows=None):
    """The study's rows, or given ones, with functions of them as metrics."""
    from warpchain.study.design.design_table import design_table_of_rows

    table = make_design(study, "s.toml") if rows is None else design_table_of_rows(study, rows)
    table = table.set_column(table.column_names.index("status"), "status", pa.array(["ok"] * table.num_rows))
    rows = [{f.name: row[f.name] for f in study.factors} for row in table.to_pylist()]
    for name, function in functions.items():
        table = table.append_column(name, pa.array([float(function(**row)) for row in rows]))
    return table


# ------------------------------------------------------------------------------------------------------- rows


def test_every_design_meets_the_same_noise():
    table = make_design(study_of([*designs("ab"), MU], 4, noise={"count": 16}), "s.toml")
    assert table.num_rows == 4 * 16
    mu = np.array(table["mu"]).reshape(4, 16)
    assert (mu == mu[0]).all()  # common random numbers
    assert np.array_equal(np.unique(((mu[0] - 0.05) / 0.2 * 16).astype(int)), np.arange(16))  # one a stratum
    assert len(set(table["a"].to_pylist())) == 4 and table["a"].to_pylist()[:16] == [table["a"][0].as_py()] * 16
    kinds = {field.name: (field.metadata or {}).get(b"kind") for field in table.schema}
    assert kinds["mu"] == b"noise" and kinds["a"] is None
    alone = make_design(study_of(designs("ab"), 4), "s.toml")
    assert table["b"].to_pylist()[::16] == alone["b"].to_pylist()  # the design is what it was


def test_ranks_correlate_as_wanted_and_distributions_stay():
    """Scores of ranks correlate as wanted within 0.01, what reordering leaves; Spearman's of 400 rows follows
    within 0.05: given that of scores, 1 - 0.955 of its variance 1 / n is open, a deviation of 0.011."""
    names = ["mu", "oil", "k"]
    factors = [
        *designs("a"),
        {"name": "mu", "path": "x.mu", "kind": "noise", "distribution": "lognormal", "mean": 0.1, "std": 0.03},
        {"name": "oil", "path": "x.oil", "kind": "noise", "distribution": "normal", "mean": 5.0, "std": 1.0},
        {"name": "k", "path": "x.k", "kind": "noise", "distribution": "empirical", "sample": [1.0, 2.0, 2.0, 7.0]},
    ]
    wanted = [[1.0, 0.7], [0.7, 1.0]]
    study = study_of(factors, noise={"count": 400, "correlated": ["oil", "mu"], "ranks": wanted})
    rows = noise_rows(study)
    columns = {name: np.array([row[name] for row in rows]) for name in names}
    points = noise_points(study, 400, 0)
    scores = norm.ppf((points.argsort(axis=0).argsort(axis=0) + 1.0) / 401.0)
    place = np.triu_indices(3, 1)
    true = 2.0 * np.sin(np.pi * 0.7 / 6.0)  # of normal variables whose ranks correlate as 0.7
    assert np.abs(np.corrcoef(scores, rowvar=False)[place] - [true, 0.0, 0.0]).max() < 0.01
    assert np.abs(spearmanr(points).statistic[place] - [0.7, 0.0, 0.0]).max() < 0.05
    both = spearmanr(columns["mu"], columns["oil"]).statistic
    assert both == pytest.approx(spearmanr(points).statistic[0, 1])  # distributions leave ranks as they are
    # a Latin hypercube: the i-th smallest of n lies between the quantiles of (i - 1) / n and i / n
    edges = norm.ppf(np.arange(401) / 400.0, 5.0, 1.0)
    ordered = np.sort(columns["oil"])
    assert (edges[:-1] <= ordered).all() and (ordered <= edges[1:]).all()
    values, counts = np.unique(columns["k"], return_counts=True)
    assert values.tolist() == [1.0, 2.0, 7.0] and counts.tolist() == [100, 200, 100]


def noises(names, **more):
    return [{"name": name, "path": f"x.{name}", "kind": "noise", "range": [0.0, 1.0]} | more for name in names]


CLOSE = {"correlated": ["m", "n"], "ranks": [[1, 0.95], [0.95, 1]]}


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("names", ["mn", "mnopq"])
def test_few_rows_correlate_as_wanted_in_the_mean_over_seeds(names, count):
    """12 E((u - 1/2)(v - 1/2)) is Spearman's correlation of the distribution; of independent rows it scatters by 0.9 at
    0.95 (of equal u and v by sqrt(1.8 - 1)), so by 0.9 / sqrt(400 count) of 400 seeds. Each stays uniform."""
    study = study_of([*designs("a"), *noises(names)], noise=CLOSE)
    points = np.array([noise_points(study, count, seed) for seed in range(400)])
    off = 12.0 * (points - 0.5)[..., :1] * (points - 0.5)[..., 1:]
    error = 4.0 * 0.9 / np.sqrt(400.0 * count)
    assert abs(off[..., 0].mean() - 0.95) < error
    assert np.abs(off[..., 1:].mean(axis=(0, 1))).max(initial=0.0) < error
    assert all(kstest(points[:, 0, k], "uniform").pvalue > 1e-4 for k in range(len(names)))


def test_rows_of_any_count_are_planned():
    """Four rows may have two columns in one order by chance, of which no reordering makes independent ones: seed 7."""
    for count in (4, 5, 6, 7, 8):
        for seed in range(20):
            table = make_design(
                study_of([*designs("a"), *noises("mnopq")], 2, noise={**CLOSE, "count": count, "seed": seed}), "s"
            )
            assert table.num_rows == 2 * count and all(0.0 <= value < 1.0 for value in table["n"].to_pylist())
    alone = noise_points(study_of([*designs("a"), *noises("mn")]), 4, 7)
    assert np.array_equal(np.sort((alone * 4).astype(int), axis=0), np.tile(np.arange(4)[:, None], (1, 2)))


def test_groups_correlate_by_their_names_as_one_variable():
    """A group of two, and a factor of its own, which is named first and so keeps a row in each of its strata; at
    Spearman's 0.6 of 1000 rows the error is below 1 / sqrt(1000), and the hypercube's is less: 3 of these."""
    pair = [{**factor, "group": "oil"} for factor in noises("mn")]
    noise = {"count": 1000, "correlated": ["p", "oil"], "ranks": [[1, -0.6], [-0.6, 1]]}
    study = study_of([*designs("a"), *pair, *noises("op")], noise=noise)
    rows = noise_rows(study)
    m, n, o, p = (np.array([row[name] for row in rows]) for name in "mnop")
    assert (m == n).all()
    assert abs(spearmanr(m, p).statistic + 0.6) < 3.0 / np.sqrt(1000.0)
    assert max(abs(spearmanr(o, other).statistic) for other in (m, p)) < 3.0 / np.sqrt(1000.0)
    assert np.array_equal(np.sort((p * 1000).astype(int)), np.arange(1000))
    drawn = noise_rows_of_normals(
        study, np.random.default_rng(0).standard_normal((4000, 3))
    )  # as `risk` and `better` ask for them
    m, n, o, p = (np.array([row[name] for row in drawn]) for name in "mnop")
    assert (m == n).all() and abs(spearmanr(m, p).statistic + 0.6) < 3.0 / np.sqrt(4000.0)
    assert abs(spearmanr(m, o).statistic) < 4.0 / np.sqrt(4000.0)


def test_a_sample_of_a_file_is_read_with_the_study(tmp_path):
    path = write_study(tmp_path, text=TINY)
    (tmp_path / "rig.csv").write_text("run,stiffness\n1,0.9\n2,1.1\n3,1.05\n")
    path.write_text(path.read_text().replace("range = [0.8, 1.2]", EMPIRICAL))
    study = load_study(path)
    assert study.factors[1].sample == (0.9, 1.1, 1.05) and study.factors[1].file is None
    assert loads_study(dumps_study(study)) == study
    for old, new, told in (
        ('"rig.csv"', '"rag.csv"', "rag.csv: cannot be read"),
        ('column = "stiffness"', 'column = "x"', "rig.csv: no column x; it has run, stiffness"),
        ('column = "stiffness"', "", "factors.stiff.column: missing; the column of the file"),
    ):
        wrong = tmp_path / "wrong.toml"
        wrong.write_text(path.read_text().replace(old, new))
        with pytest.raises(StudyError) as caught:
            load_study(wrong)
        assert told in str(caught.value) and "\n" not in str(caught.value)


EMPIRICAL = 'distribution = "empirical"\nfile = "rig.csv"\ncolumn = "stiffness"'


GROUPED = [{**factor, "group": "oil"} for factor in noises("mn")]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"factors": [*designs("a"), {**MU, "kind": "chance"}]}, 'kind = "chance": must be "design" or "noise"'),
        ({"factors": [*designs("a"), {**MU, "hidden": True}]}, 'hidden = true: not with kind "noise"'),
        ({"noise": {"count": 2}}, "noise.count = 2: must be an integer from 4"),
        ({"factors": designs("a"), "noise": {"count": 8}}, 'noise: needs at least one factor of kind "noise"'),
        ({"constraints": [{"require": "mu < a"}]}, "mu is noise, which nobody can choose"),
        ({"objectives": [{"metric": "mu"}]}, 'objective 1: metric = "mu": is noise'),
        ({"noise": {"correlated": ["mu", "a"], "ranks": [[1, 0.1], [0.1, 1]]}}, "a is not a noise factor"),
        ({"noise": {"correlated": ["mu", "b"], "ranks": [[1, 0.1]]}}, "must be a symmetric matrix of 2 rows"),
        (
            {"noise": {"correlated": ["m", "n", "o"], "ranks": [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]}},
            "not positive definite (eigenvalue -0.8)",
        ),
        (
            {"noise": {"correlated": ["m", "n"], "ranks": [[1, 1], [1, 1]]}},
            "m and n, correlated by 1, are one random variable: give their factors the same group",
        ),
        ({"noise": {"correlated": ["m", "n"], "ranks": [[1, -1], [-1, 1]]}}, "make one an expression of the other"),
        (
            {"noise": {"correlated": ["m", "n", "o"], "ranks": [[1, 0.7, 0.0], [0.7, 1, 0.7], [0.0, 0.7, 1]]}},
            "noise.ranks: the matrix is positive definite, but not 2 sin(pi r / 6) of its numbers r, by which normal "
            "variables must correlate for such ranks (eigenvalue -0.014): take at most 0.98 times",
        ),
        (
            {
                "factors": [*designs("a"), *GROUPED, MU],
                "noise": {"correlated": ["mu", "m"], "ranks": [[1, 0.1], [0.1, 1]]},
            },
            "m is of the group oil, which varies as one; allowed are oil, mu",
        ),
        (
            {
                "factors": [*designs("a"), *GROUPED, {**MU, "name": "oil"}],
                "noise": {"correlated": ["oil", "n"], "ranks": [[1, 0.1], [0.1, 1]]},
            },
            "oil is a noise factor and a group of others: rename one",
        ),
        (
            {"factors": designs("a"), "objectives": [{"metric": "q95(f)"}]},
            'objective 1: metric = "q95(f)": is a statistic over noise',
        ),
    ],
)
def test_mistakes_about_noise_are_said(more, told):
    from warpchain.errors import DriveError

    values = {"study": {"drive": "none"}, "design": {"kind": "sobol", "count": 4}, "factors": [*designs("a"), MU]}
    with pytest.raises(DriveError) as caught:
        Study(**{**values, **more})
    assert told in str(caught.value)


# ------------------------------------------------------------------------------------------------- statistics


def linear(count, ranks=0.0):
    """Runs of y = a + 2 u + v, u and v standard normal, correlated as asked."""
    factors = [
        {"name": "a", "path": "x.a", "levels": [0.0, 10.0]},
        *(
            {"name": n, "path": f"x.{n}", "kind": "noise", "distribution": "normal", "mean": 0.0, "std": 1.0}
            for n in "uv"
        ),
    ]
    noise = {"count": count, "correlated": ["u", "v"], "ranks": [[1.0, ranks], [ranks, 1.0]]}
    goals = {"objectives": [{"metric": "y"}, {"metric": "q90(y)"}], "limits": [{"metric": "y", "max": 4.0}]}
    study = study_of(factors, noise=noise, **goals)
    study = study.model_copy(update={"design": study.design.model_copy(update={"kind": "factorial", "count": None})})
    return study, read_results(run_of(study, {"y": lambda a, u, v: a + 2.0 * u + v}), ["a", "u", "v"], ["y"])


def test_means_deviations_and_quantiles_are_those_of_the_closed_form():
    """y is normal with deviation sqrt(5) about a; a statistic lies within four of its own standard errors, and these
    are those of independent samples: sigma / sqrt(n), sigma / sqrt(2 n), sqrt(p (1 - p) / n) / density."""
    study, results = linear(200)
    over, goals = designs_over_noise(results, goals_of_study(study))
    assert isinstance(over, Designs) and over.factors == ("a",) and over.table.num_rows == 2
    assert [o.metric for o in goals.objectives] == ["mean(y)", "q90(y)"]
    assert [(b.metric, b.max) for b in goals.bounds] == [("q95(y)", 4.0)]
    sigma, density = np.sqrt(5.0), norm.pdf(norm.ppf(0.9)) / np.sqrt(5.0)
    for name, true, error in (
        ("mean(y)", 0.0, sigma / np.sqrt(200)),
        ("std(y)", sigma, sigma / np.sqrt(400)),
        ("q90(y)", norm.ppf(0.9) * sigma, np.sqrt(0.09 / 200) / density),
    ):
        told = over.values(f"{name}_se")[0]
        assert abs(over.values(name)[0] - true) < 4.0 * error
        assert 0.6 * error < told < 1.6 * error, name  # estimated from 200 runs: by some 10 %, jackknife more
        # the second design differs by a alone: common random numbers
        shift = over.values(name)[1] - over.values(name)[0]
        assert abs(shift - (0.0 if name == "std(y)" else 10.0)) < 1e-9
    assert over.kept_counts(0)[1] == 200
    assert (
        abs(over.kept_counts(0)[0] / 200 - norm.cdf(4.0 / sigma)) < 0.03
    )  # a Latin hypercube: less than sqrt(p q / n) = 0.013
    assert over.kept_counts(1)[0] < 5


@pytest.mark.parametrize(("ranks", "part"), [(0.0, 4.0 / 5.0), (0.5, None)])
def test_parts_of_the_spread_are_those_of_the_noise(ranks, part):
    """cov(2 u, y) / var(y) = (4 + 2 r) / (5 + 4 r) with r = 2 sin(pi ranks / 6); to 0.03, as r of 400 rows is known."""
    r = 2.0 * np.sin(np.pi * ranks / 6.0)
    part = (4.0 + 2.0 * r) / (5.0 + 4.0 * r) if part is None else part
    study, results = linear(400, ranks)
    over, _ = designs_over_noise(results, goals_of_study(study))
    found = noise_spread(over, 0, "y")
    assert abs(found.parts["u"] - part) < 0.03 and abs(found.parts["v"] - (1.0 - part)) < 0.03
    assert found.unexplained_part < 1e-9 and found.parts_text().startswith("u ")
    rng = np.random.default_rng(0)
    table = results.table.set_column(results.table.column_names.index("y"), "y", pa.array(rng.standard_normal(800)))
    chance = noise_spread(
        designs_over_noise(read_results(table, ["a", "u", "v"], ["y"]), goals_of_study(study))[0], 0, "y"
    )
    assert max(chance.parts.values()) < 0.02  # mere scatter comes of neither: 2 / 400 each would by chance


def test_a_design_is_as_good_as_its_worst_run():
    study, results = linear(16)
    status = ["ok"] * 32
    status[5] = "diverged"
    table = results.table.set_column(results.table.column_names.index("status"), "status", pa.array(status))
    over, _ = designs_over_noise(read_results(table, ["a", "u", "v"], ["y"]), goals_of_study(study))
    assert over.status == ["diverged", "ok"] and over.variants.tolist()[0] == 5
    assert over.kept_counts(0)[0] <= 15
    few = read_results(table.slice(0, 3), ["a", "u", "v"], ["y"])
    with pytest.raises(StudyError, match="a design has 3 runs; to compare designs, each needs at least 4"):
        designs_over_noise(few, goals_of_study(study))


# --------------------------------------------------------------------------------------- the fault, and searches


def tension(spring, angle, mu):
    """A blow [N] that friction raises by 1400 N a unit, from 3254 N on: 3534 N at 0.20, 3604 N at 0.25."""
    return 3254.0 + 1400.0 * mu - 200.0 * spring + 100.0 * (angle - 0.5) ** 2


def loss(spring, angle, mu):
    return 10.0 + 5.0 * spring + (angle - 0.3) ** 2


def kept_of(spring, angle):
    """The share of mu from 0.05 to 0.25 at which the blow is at most 3500 N."""
    most = (3500.0 - tension(spring, angle, 0.0)) / 1400.0
    return float(np.clip((most - 0.05) / 0.2, 0.0, 1.0))


def fault(count=16, **more):
    factors = [*designs(["spring", "angle"]), MU]
    goals = {"objectives": [{"metric": "loss"}], "limits": [{"metric": "tension_max", "max": 3500.0}]}
    search = {"optimize": {"batch": 4, "count": count}, "noise": {"count": 32}}
    return study_of(factors, 8, **(goals | search | more))


def searched(study):
    optimizer, tables = Optimizer(study), []
    while optimizer.observed_count < study.optimize.count:
        tables.append(run_of(study, {"tension_max": tension, "loss": loss}, optimizer.ask()))
        optimizer.observe(tables[-1])
    table = pa.concat_tables(tables)
    index = table.column_names.index("variant")
    numbered = table.set_column(index, "variant", pa.array(range(table.num_rows)))
    return read_results(numbered, ["spring", "angle", "mu"], ["tension_max", "loss"])


@pytest.fixture(scope="module")
def found():
    pytest.importorskip("sklearn")
    study = fault()
    return study, searched(study)


def test_no_value_of_noise_is_recommended_and_limits_are_kept_over_it(found):
    study, results = found
    assert results.table.num_rows == 16 * 32  # `count` is of designs
    over, goals = designs_over_noise(results, goals_of_study(study))
    best, *_ = recommend(over, goals)
    spring, angle = (float(over.values(name)[best.row]) for name in ("spring", "angle"))
    assert over.factors == ("spring", "angle")
    # least loss within the limit in 95 % of the noise: mu 0.24 at spring 0.45, angle 0.3 of 12.27; none can be below
    assert kept_of(spring, angle) >= 0.93  # the 95 % quantile of 32 runs is known to 0.02 or so
    assert loss(spring, angle, 0.0) < 12.9
    assert abs(best.chance - kept_of(spring, angle)) <= 1.0 / 32.0  # one run a stratum
    assert any("over the noise" in line for line in best.reasons)
    (of,) = [of for of in best.spreads if of.metric == "tension_max"]
    assert of.parts["mu"] > 0.99  # all of the spread comes of mu
    width = 1400.0 * 0.2 / np.sqrt(12.0)  # of a uniform distribution
    assert abs(of.statistics["std"][0] - width) < 0.05 * width


def test_design_that_only_low_friction_saves_is_not_called_sure(found):
    """What the report called sure: spring 0, where mu up to 0.176 keeps the limit, 63 % of the noise."""
    study, _ = found
    rows = [{"spring": 0.0, "angle": 0.5} | noise for noise in noise_rows(study)]
    results = read_results(run_of(study, {"tension_max": tension, "loss": loss}, rows), ["spring", "angle", "mu"])
    over, goals = designs_over_noise(results, goals_of_study(study))
    (one,) = recommend(over, goals)
    assert abs(one.chance - kept_of(0.0, 0.5)) <= 1.0 / 32.0 and 0.6 < one.chance < 0.66
    assert "and no design has 95 %" in " ".join(one.reasons)


def test_quantiles_can_be_wanted(found):
    study = fault(objectives=[{"metric": "q95(tension_max)"}, {"metric": "loss"}], limits=[])
    goals = goals_of_designs(goals_of_study(study), ["spring", "angle"])
    assert [o.metric for o in goals.objectives] == ["q95(tension_max)", "mean(loss)"]
    over, goals = designs_over_noise(found[1], goals_of_study(study))
    best = {reason: one for one in recommend(over, goals) for reason in one.reasons}["lowest q95(tension_max)"]
    spring, angle = (float(over.values(name)[best.row]) for name in ("spring", "angle"))
    mean, _ = best.believed["q95(tension_max)"]
    assert abs(mean - tension(spring, angle, 0.24)) < 10.0  # of a spread of 280 N in 32 strata


def test_the_report_names_design_factors_only(found):
    study, results = found
    wanted = ReportGoals(study.objectives, study.bounds, "out", keep=0.95)
    page = study_report_html(results, "T", wanted=wanted)
    first = page[page.index('id="designs"') : page.index('id="explore"')]
    heads = re.findall(r"<h3[^>]*>([A-Z]: [^<]*)<", first)
    assert heads and all("spring" in head and "mu" not in head for head in heads)
    assert "over the noise: in" in first and "mu 100 %" in first and "which nobody can choose" in first
    assert "warpchain study play out" in first
    assert not re.search(r"<th[^>]*>mu", first)


def test_a_population_searches_designs_too():
    pytest.importorskip("pymoo")
    study = fault(24, optimize={"engine": "population", "batch": 8, "count": 24})
    results = searched(study)
    over, _ = designs_over_noise(results, goals_of_study(study))
    assert over.table.num_rows == 24 and results.table.num_rows == 24 * 32


# -------------------------------------------------------------------------------------------------- with a drive

TINY = (
    SAMPLED.replace("range = [0.0, 20.0]", 'range = [0.0, 20.0]\nunit = "N m"')
    .replace(
        'name = "links"\npath = "chain.links"\nlevels = [44, 45]',
        'name = "stiff"\nkind = "noise"\npath = "chain.stiffness"\nrelative = true\nrange = [0.8, 1.2]',
    )
    .replace(LIMITS, "")
    .replace("duration = 0.0005", "duration = 0.0003")
)
GOALS = """
objectives = [{ metric = "q90(tension_max)" }, { metric = "torque", sense = "max" }]
limits = [{ energy_residual = inf, energy_change = inf }, { metric = "tension_std", max = 900 }]
optimize = { count = 6, batch = 2, recommend = 2 }
noise = { count = 8 }
record = { rate = 1e5 }
"""


@pytest.mark.long
def test_optimize_builds_drives_that_leave_noise_alone(tmp_path, capsys):
    pytest.importorskip("sklearn")
    path = write_study(tmp_path)
    path.write_text(GOALS + TINY.format(shard=64))
    out, file = tmp_path / "out", tmp_path / "tiny.toml"
    file.write_text("# of the rig\n" + file.read_text())
    status, lines, _ = run(capsys, "optimize", path, "-o", out, "--quiet")
    text = "\n".join(lines)
    assert status == 0 and "48 variants of 6 designs over the same noise" in text
    assert "stiff =" not in text and "over the noise: in" in text and "comes from: stiff" in text
    base = load_drive(tmp_path / "tiny.toml")
    for file in sorted(out.rglob("design-*.toml")):
        drive = load_drive(file)
        assert file.read_text().startswith("# of the rig\n")
        assert drive.chain.stiffness == base.chain.stiffness
        assert drive.get_value("sprockets.s1.load.torque") != base.get_value("sprockets.s1.load.torque")
    found = optimize(path, out)
    assert found.designs.factors == ("torque",) and found.results.factors == ("torque", "stiff")
    status, lines, _ = run(capsys, "study", "report", out, "-o", tmp_path / "r.html")
    page, beside = (tmp_path / "r.html").read_text(), sorted(tmp_path.glob("r-?.toml"))
    assert status == 0 and lines == [str(tmp_path / "r.html"), *map(str, beside)] and len(beside) == 2
    assert "which nobody can choose" in page
    for file in beside:  # the page's designs are drives of design factors only, as the search writes them
        assert f"<code>{file.name}</code>" in page and "torque" in file.read_text().splitlines()[0]
        assert file.read_text().splitlines()[1] == "# of the rig"
        assert load_drive(file).chain.stiffness == base.chain.stiffness
    searched = {load_drive(file).get_value("sprockets.s1.load.torque") for file in out.rglob("design-*.toml")}
    assert {load_drive(file).get_value("sprockets.s1.load.torque") for file in beside} == searched
    wrong = path.read_text().replace("q90(tension_max)", "q90(tension_mix)")
    path.write_text(wrong)
    assert 'objective 1: metric = "q90(tension_mix)": no such metric' in refused(capsys, "optimize", path, "-o", out)


def test_studies_over_noise_are_run_grown_joined_and_viewed(tmp_path):
    path = write_study(tmp_path)
    text = GOALS + TINY.format(shard=64)
    path.write_text(text)
    run_study(path, tmp_path / "a")
    first = read_results(tmp_path / "a/results.parquet")
    assert first.table.num_rows == 4 * 8 and first.noise_factors == ("stiff",)
    path.write_text(text.replace("count = 4", "count = 8"))
    run_study(path, tmp_path / "a", grow=True)
    grown = read_results(tmp_path / "a/results.parquet")
    assert grown.table.num_rows == 8 * 8
    assert grown.table["tension_max"].to_pylist()[:32] == first.table["tension_max"].to_pylist()
    path.write_text(text.replace("count = 4", "count = 4\nseed = 1"))
    run_study(path, tmp_path / "b")
    join_studies([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    joined = read_results(tmp_path / "c/results.parquet")
    assert joined.table.num_rows == 12 * 8 and joined.noise_factors == ("stiff",)
    over, _ = designs_over_noise(joined, goals_of_study(load_study(tmp_path / "c/study.toml")))
    assert over.table.num_rows == 12
    assert main(["study", "view", str(tmp_path / "c"), "--save", str(tmp_path / "c.rrd")]) == 0
    assert main(["study", "report", str(tmp_path / "c"), "-o", str(tmp_path / "c.html")]) == 0
