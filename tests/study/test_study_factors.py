"""Factors as engineers think: relative, offset, shifts, hidden, lognormal, "auto"; indices by their distributions."""

import math

import numpy as np
import pyarrow as pa
import pytest
from drives import example
from pyarrow import parquet
from scipy import stats
from study_helpers import STUDY, write_study

from warpchain.errors import StudyError
from warpchain.study.analysis.sensitivity import factors_of_problem, problem_of_factors, surface_indices
from warpchain.study.analysis.surface import fit_surface
from warpchain.study.design import make_design
from warpchain.study.design.factor_values import quadrature_nodes
from warpchain.study.results import read_results
from warpchain.study.run import run_study
from warpchain.study.run.row_drives import drive_of_row
from warpchain.study.spec import check_base_drive, dumps_study, loads_study
from warpchain.study.spec.factor import Factor
from warpchain.study.surrogate.indices import best_indices

HEAD = '[study]\ndrive = "marine"\n[design]\nkind = "{}"\n'


def study_of(factors, design="factorial"):
    return loads_study(HEAD.format(design) + "".join(f"[[factors]]\n{factor}\n" for factor in factors))


def errors_of(factors):
    with pytest.raises(StudyError) as caught:
        study = study_of(factors)
        check_base_drive(study, example("marine"), "s")
    return str(caught.value)


def test_relative_and_offset_factors_go_by_the_drives_own_values():
    drive = example("marine")
    study = study_of([
        'name = "load"\npath = "sprockets.camshaft.load.torque"\nrelative = true\nlevels = [0.5, 2.0]',
        'name = "aside"\npath = "sprockets.tightener.center.0"\noffset = true\nlevels = [-0.01, 0.02]',
        'name = "more"\npath = "sprockets.tightener.teeth"\noffset = true\nlevels = [-2, 2]',
        'name = "all"\npaths = ["sprockets.tightener.inertia", "chain.stiffness"]\nrelative = true\nlevels = [1.0, 1.1]',  # noqa: E501
    ])  # fmt: skip
    check_base_drive(study, drive, "s")
    made = drive_of_row(study, drive, {"load": 2.0, "aside": 0.02, "more": -2, "all": 1.1})
    for path, factor, offset in (
        ("sprockets.camshaft.load.torque", 2.0, 0.0),
        ("sprockets.tightener.center.0", 1.0, 0.02),
        ("sprockets.tightener.inertia", 1.1, 0.0),
        ("chain.stiffness", 1.1, 0.0),
        ("sprockets.tightener.teeth", 1, -2),
    ):
        assert made.get_value(path) == pytest.approx(factor * drive.get_value(path) + offset, rel=1e-15)


def test_a_bar_is_shifted_along_its_normal_as_one_factor():
    """By d towards the chain, which rides on the left: start and end move by d (-sin a, cos a), a the bar's angle."""
    drive = example("marine")
    bar = drive.guides[0]
    study = study_of([
        f'name = "press"\nshift = "guides.{bar.name}"\nlevels = [0.0, 0.004]',
        f'name = "slide"\nshift = "guides.{bar.name}"\nalong = [3.0, 4.0]\nlevels = [0.0, 0.01]',
        'name = "tighten"\nshift = "sprockets.tightener"\nalong = [0.0, -2.0]\nlevels = [0.0, 0.003]',
    ])  # fmt: skip
    check_base_drive(study, drive, "s")
    made = drive_of_row(study, drive, {"press": 0.004, "slide": 0.01, "tighten": 0.003})
    (x, y), (u, v) = bar.start, bar.end
    angle = math.atan2(v - y, u - x)
    moved = np.array([-math.sin(angle), math.cos(angle)]) * 0.004 + np.array([0.6, 0.8]) * 0.01
    assert np.array(made.guides[0].start) - bar.start == pytest.approx(moved, abs=1e-15)
    assert np.array(made.guides[0].end) - bar.end == pytest.approx(moved, abs=1e-15)
    down = np.subtract(made.get_value("sprockets.tightener.center"), drive.get_value("sprockets.tightener.center"))
    assert down == pytest.approx([0.0, -0.003], abs=1e-15)


def test_hidden_factors_vary_and_are_no_factors_of_the_results(tmp_path):
    text = STUDY.replace('name = "links"', 'name = "links"\nhidden = true')
    results = read_results(run_study(write_study(tmp_path, points=3, text=text), tmp_path / "out").table)
    assert results.factors == ("torque",)
    assert results.table["links"].to_pylist() == [44, 45] * 3
    assert "links" not in results.metrics


def test_lognormal_factors_have_the_mean_and_deviation_of_their_value():
    factor = Factor(name="x", distribution="lognormal", mean=5.0, std=2.0)
    study = study_of(['name = "x"\npath = "chain.stiffness"\ndistribution = "lognormal"\nmean = 5.0\nstd = 2.0'],
                     'sobol"\ncount = 4096\n#')  # fmt: skip
    x = make_design(study, "s")["x"].to_numpy()
    # 4,096 points of a sequence: far better than the 2 / sqrt(4096) = 3 % of so many by chance
    assert (x.mean(), x.std()) == (pytest.approx(5.0, rel=3e-3), pytest.approx(2.0, rel=2e-2))
    assert stats.kstest(x, "lognorm", (math.sqrt(math.log(1.16)), 0.0, 5.0 / math.sqrt(1.16))).statistic < 2e-3
    values, weight = quadrature_nodes(factor)
    assert (weight @ values, weight @ (values - 5.0) ** 2) == (pytest.approx(5.0), pytest.approx(4.0))
    problem = problem_of_factors([factor])
    assert problem["bounds"][0] == pytest.approx([math.log(5.0 / math.sqrt(1.16)), math.sqrt(math.log(1.16))])
    (back,) = factors_of_problem(problem)
    assert (back["distribution"], back["mean"], back["std"]) == ("lognormal", pytest.approx(5.0), pytest.approx(2.0))
    assert loads_study(dumps_study(study)) == study


@pytest.mark.parametrize(("keys", "frozen"), [
    ({"range": [2.0, 8.0]}, stats.uniform(2.0, 6.0)),
    ({"range": [2.0, 8.0], "distribution": "log-uniform"}, stats.loguniform(2.0, 8.0)),
    ({"mean": 3.0, "std": 0.5, "distribution": "normal"}, stats.norm(3.0, 0.5)),
    ({"mean": 3.0, "std": 0.5, "distribution": "lognormal"}, None),
    ({"mean": 3.0, "std": 2.0, "range": [2.0, 4.0], "distribution": "truncated-normal"},
     stats.truncnorm(-0.5, 0.5, 3.0, 2.0)),
    ({"mean": 3.0, "std": 1.0, "range": [2.5, 1e9], "distribution": "truncated-normal"},
     stats.truncnorm(-0.5, 1e9, 3.0, 1.0)),
    ({"range": [1.0, 6.0], "integer": True}, stats.randint(1, 7)),
    ({"levels": [1.0, 2.0, 6.0]}, None),
])  # fmt: skip
def test_nodes_have_the_moments_of_their_distribution(keys, frozen):
    if frozen is None and "levels" not in keys:
        square = math.log1p((0.5 / 3.0) ** 2)
        frozen = stats.lognorm(math.sqrt(square), 0.0, 3.0 * math.exp(-0.5 * square))
    values, weight = quadrature_nodes(Factor(name="x", **keys))
    for power in (1, 2, 3, 4):
        wanted = np.mean(np.power(keys["levels"], power)) if frozen is None else frozen.moment(power)
        assert weight @ values**power == pytest.approx(wanted, rel=1e-9)
    assert weight.sum() == pytest.approx(1.0, rel=1e-14)


def table_of(columns, distributions):
    fields = []
    for name, values in columns.items():
        facts = {"role": "factor" if name in distributions else "metric"}
        if distributions.get(name):
            facts["distribution"] = distributions[name]
        fields.append(pa.field(name, pa.array(values).type, metadata=facts))
    return read_results(pa.Table.from_arrays([pa.array(v) for v in columns.values()], schema=pa.schema(fields)))


def test_indices_of_a_sum_of_a_normal_and_a_uniform_factor_of_equal_variance_are_one_half():
    """y = a + b, a normal with deviation 1, b uniform on +-sqrt(3): both have the variance 1. Uniform over what was
    run, a would have some 3.3^2 / 3 of it, 0.78 of the whole."""
    random = np.random.default_rng(1)
    a, b = random.standard_normal(400), math.sqrt(3.0) * np.append(random.uniform(-1.0, 1.0, 398), [-1.0, 1.0])
    normal = '{"distribution": "normal", "mean": 0.0, "std": 1.0}'
    results = table_of({"a": a, "b": b, "y": a + b}, {"a": normal, "b": None})
    found, words = best_indices(results, "y")
    assert found.first == pytest.approx([0.5, 0.5], abs=1e-9)
    assert found.total == pytest.approx([0.5, 0.5], abs=1e-9)
    assert "a distributed as in the study, the others uniform over their range" in words
    assert surface_indices(fit_surface(results, "y")).first[0] > 0.7


def test_indices_of_a_quadratic_of_normal_factors_are_in_closed_form():
    """y = 2 a + a^2 + 3 b + a b with a, b normal, means 1 and 2, deviations 1/2 and 1/4. With a = 1 + s, b = 2 + t,
    y = ... + (2 + 2 + 2) s + s^2 + (3 + 1) t + s t: variances 36 / 4 + 2 / 16 (that of s^2), 16 / 16, 1 / 64."""
    random = np.random.default_rng(2)
    a, b = 1.0 + 0.5 * random.standard_normal(60), 2.0 + 0.25 * random.standard_normal(60)
    told = {name: f'{{"distribution": "normal", "mean": {mean}, "std": {std}}}'
            for name, mean, std in (("a", 1.0, 0.5), ("b", 2.0, 0.25))}  # fmt: skip
    results = table_of({"a": a, "b": b, "y": 2.0 * a + a**2 + 3.0 * b + a * b}, told)
    found = surface_indices(fit_surface(results, "y"), results)
    alone, both = np.array([9.0 + 0.125, 1.0]), 1.0 / 64.0
    whole = alone.sum() + both
    assert found.first == pytest.approx(alone / whole, abs=1e-9)
    assert found.total == pytest.approx((alone + both) / whole, abs=1e-9)
    assert found.first_error == pytest.approx([0.0, 0.0], abs=1e-6)


def test_errors_of_indices_hold_as_often_as_they_say():
    """y = a + b / 2 + noise, uniform: S = 0.8, 0.2. Of 200 repetitions 95 %, within 3 standard deviations of such a
    count, 4.6 %, and what 400 draws and a linear error leave, 2 %."""
    random = np.random.default_rng(3)
    held = 0
    for _ in range(200):
        a, b = (np.append(random.uniform(-1.0, 1.0, 58), [-1.0, 1.0]) for _ in range(2))
        y = a + 0.5 * b + 0.2 * random.standard_normal(60)
        results = table_of({"a": a, "b": b, "y": y}, {"a": None, "b": None})
        found = surface_indices(fit_surface(results, "y"), results)
        held += abs(found.first[0] - 0.8) <= found.first_error[0]
    assert held / 200 == pytest.approx(0.95, abs=0.066)


def test_a_studys_table_tells_distributions(tmp_path):
    factor = 'name = "torque"\npath = "sprockets.s1.load.torque"\ndistribution = "normal"\nmean = 1.0\nstd = 0.1\n'
    text = HEAD.format('sobol"\ncount = 4\n#').replace("marine", "tiny.toml") + "[[factors]]\n" + factor
    source = write_study(tmp_path, text=text + "[run]\nduration = 0.0005\nstep = 1e-5\n")
    results = read_results(run_study(source, tmp_path / "out").table)
    assert results.distribution("torque") == {"distribution": "normal", "mean": 1.0, "std": 0.1}


def test_the_step_can_be_auto_in_settings_and_in_a_choice(tmp_path):
    own = STUDY.replace("step = 1e-5", 'step = "auto"')
    choice = '[[factors]]\nname = "step"\npath = "run.step"\nchoice = [1e-5, "auto"]\n'
    both = STUDY.replace("step = 1e-5", "")
    sources = write_study(tmp_path / "a", points=2, text=own), write_study(tmp_path / "b", choice, points=2, text=both)
    tables = [parquet.read_table(run_study(source, source.parent / "out").table) for source in sources]
    assert tables[1]["step"].to_pylist() == ["1e-05", "auto"] * 4
    assert tables[1]["tension_max"].to_pylist()[1::2] == tables[0]["tension_max"].to_pylist()
    assert tables[1]["tension_max"].to_pylist()[0] != tables[0]["tension_max"].to_pylist()[0]


def test_refusals():
    path = 'path = "sprockets.camshaft.load.torque"\nlevels = [1.0, 2.0]'
    cases = {
        f'name = "a"\nrelative = true\noffset = true\n{path}': "factors.a.offset = true: not together with relative",
        'name = "a"\nrelative = true\nlevels = [1.0, 2.0]': "factors.a.relative = true: only together with path",
        'name = "a"\nrelative = true\npath = "chain.links"\nchoice = ["x", "y"]': "factors.a.relative = true: needs",
        f'name = "a"\nshift = "guides.x"\n{path}': 'factors.a.shift = "guides.x": not together with path',
        'name = "a"\nshift = "chain"\nlevels = [1.0, 2.0]': 'factors.a.shift = "chain": must be a guide-bar or a spr',
        'name = "a"\nshift = "sprockets.camshaft"\nlevels = [1.0, 2.0]': "factors.a.along: must be two numbers",
        f'name = "a"\nalong = [1.0, 0.0]\n{path}': "factors.a.along = [1.0, 0.0]: only together with shift",
        'name = "a"\nshift = "guides.uper"\nlevels = [1.0, 2.0]': "factors.a.shift = \"guides.uper\": unknown path",
        'name = "a"\noffset = true\npath = "sprockets.camshaft.load"\nlevels = [1.0, 2.0]':
            "factors.a.offset = true: needs a number at sprockets.camshaft.load",
        'name = "a"\nrelative = true\npath = "chain.play"\nlevels = [1.0, 2.0]':
            "factors.a.relative = true: needs a number at chain.play, which is nothing in the drive",
        'name = "a"\npath = "chain.stiffness"\ndistribution = "lognormal"\nmean = -1.0\nstd = 1.0\npoints = 2':
            "factors.a.mean = -1.0: must be a positive number with a lognormal distribution",
        'name = "a"\npath = "run.step"\nchoice = [1e-5, "slow"]': "must be a list of at least 2 different values",
    }  # fmt: skip
    for factor, line in cases.items():
        assert line in errors_of([factor]), factor
