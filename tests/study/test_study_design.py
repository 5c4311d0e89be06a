"""Designs: each one's defining property, the values of factors, tied factors, constraints, tables."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm

from warpchain.errors import StudyError
from warpchain.study.design import make_design
from warpchain.study.design.design_table import central_composite_points, hadamard_matrix, plackett_burman_points
from warpchain.study.spec import loads_study


def design(text, source="study.toml"):
    return make_design(loads_study('[study]\ndrive = "marine"\n' + text, str(source)), source)


NORMAL = 'normal"\nmean = 5.0\nstd = 2.0'


def factor(name, text, path=None):
    return f'[[factors]]\nname = "{name}"\npath = "{path or f"sprockets.camshaft.load.{name}"}"\n{text}\n'


def sampled(kind, text, count=64, name="torque"):
    table = design(f'[design]\nkind = "{kind}"\ncount = {count}\nseed = 3\n' + factor(name, text))
    return np.array(table[name].to_pylist())


@pytest.mark.parametrize(("low", "high", "points"), [(5.0, 80.0, 16), (0.1, 0.4, 4), (1.0, 2.0, 11)])
def test_grid_points_are_round_numbers(low, high, points):
    # 20, not 19.999999999999996
    table = design('[design]\nkind = "factorial"\n' + factor("torque", f"range = [{low}, {high}]\npoints = {points}"))
    expected = [float(f"{low + (high - low) * k / (points - 1):.6g}") for k in range(points)]
    assert table["torque"].to_pylist() == expected


def test_factorial_has_every_combination_once_and_exact_ends():
    table = design(
        '[design]\nkind = "factorial"\n'
        + factor("torque", "range = [0.1, 0.3]\npoints = 3")
        + factor("viscous", "levels = [1, 5]")
        + factor("wrap", 'choice = ["cw", "ccw"]', "sprockets.tightener.wrap")
    )
    rows = list(zip(*(table[name].to_pylist() for name in ("torque", "viscous", "wrap")), strict=True))
    assert len(rows) == len(set(rows)) == 12
    assert {row[0] for row in rows} == {0.1, 0.2, 0.3}  # bitwise: the ends and their mean
    assert rows[0] == (0.1, 1, "cw") and rows[1] == (0.1, 1, "ccw") and rows[-1] == (0.3, 5, "ccw")
    assert table.schema.field("torque").metadata[b"role"] == b"factor"


def test_latin_hypercube_has_one_value_in_each_stratum():
    values = sampled("latin-hypercube", "range = [0.0, 64.0]")
    assert sorted(np.floor(values)) == list(range(64))


@pytest.mark.parametrize("kind", ["sobol", "halton"])
def test_low_discrepancy_points_are_more_even_than_random_ones(kind):
    # the largest deviation of the empirical distribution is of order log(n)/n, of random points 1/sqrt(n) = 0.125
    assert kstest(sampled(kind, "range = [0.0, 1.0]"), "uniform").statistic < 0.05


def test_designs_repeat_with_their_seed_alone():
    first, again = (sampled("sobol", "range = [0.0, 1.0]") for _ in range(2))
    assert np.array_equal(first, again)
    other = design('[design]\nkind = "sobol"\ncount = 64\nseed = 4\n' + factor("torque", "range = [0.0, 1.0]"))
    assert not np.array_equal(first, other["torque"].to_pylist())


@pytest.mark.parametrize(
    ("text", "cdf"),
    [
        (f'distribution = "{NORMAL}', norm(5, 2).cdf),
        (f'distribution = "truncated-{NORMAL}\nrange = [4.0, 10.0]', truncnorm(-0.5, 2.5, 5, 2).cdf),
        ('distribution = "log-uniform"\nrange = [1.0, 100.0]', lambda x: np.log(x) / math.log(100)),
        ("range = [2.0, 4.0]", lambda x: (np.asarray(x) - 2) / 2),
    ],
    ids=["normal", "truncated", "log", "uniform"],
)
def test_distributions_follow_their_law(text, cdf):
    # one value in each of 64 strata: the empirical distribution is within 1/64 of the law
    assert kstest(sampled("latin-hypercube", text), cdf).statistic <= 1 / 64 + 1e-12


@pytest.mark.parametrize("text", ["range = [3, 6]\ninteger = true", "choice = [3, 4, 5, 6]"])
def test_whole_numbers_and_choices_are_equally_likely(text):
    values = sampled("latin-hypercube", text)
    assert np.bincount(values).tolist() == [0, 0, 0, 16, 16, 16, 16]
    assert values.dtype == np.int64


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_central_composite(count):
    face = central_composite_points(count, "face", 2)
    assert len(face) == 2**count + 2 * count + 2
    assert np.abs(face).max() == 1.0
    assert np.array_equal(face[-2:], np.zeros((2, count)))
    for axial, corner, arm in (("circumscribed", 1.0, 2 ** (count / 4)), ("inscribed", 2 ** (-count / 4), 1.0)):
        points = central_composite_points(count, axial, 0)
        assert np.abs(points[: 2**count]).min() == np.abs(points[: 2**count]).max() == pytest.approx(corner)
        assert np.abs(points[2**count :]).max() == pytest.approx(arm)
        # rotatable: pure fourth moments are three times the mixed ones (Box and Hunter 1957)
        if count > 1:
            pure, mixed = (points[:, 0] ** 4).sum(), (points[:, 0] ** 2 * points[:, 1] ** 2).sum()
            assert pure == pytest.approx(3 * mixed)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 11, 14, 15, 16, 23, 28])
def test_plackett_burman_is_orthogonal_and_balanced(count):
    points = plackett_burman_points(count)
    rows = len(points)
    assert np.array_equal(np.abs(points), np.ones((rows, count)))
    assert np.array_equal(points.T @ points, rows * np.eye(count))
    assert np.array_equal(points.sum(axis=0), np.zeros(count))
    # the least multiple of four above the number of factors, but for 28 (27 = 3^3 is no prime, and 14 is no size)
    assert rows == {28: 32}.get(count, 4 * (count // 4 + 1))


def test_hadamard_knows_where_it_ends():
    assert hadamard_matrix(92) is None  # 91 = 7 * 13, and 46 is no size


def test_plackett_burman_takes_two_levels_and_center_rows():
    table = design(
        '[design]\nkind = "plackett-burman"\ncenter = 1\n'
        + factor("torque", "range = [1.0, 3.0]")
        + factor("viscous", "levels = [7, 9]")
    )
    assert sorted(table["torque"].to_pylist()[:4]) == [1.0, 1.0, 3.0, 3.0]
    assert table["torque"].to_pylist()[4] == 2.0
    assert set(table["viscous"].to_pylist()) == {7, 9}


def test_tied_factors_groups_and_constraints():
    table = design(
        '[design]\nkind = "factorial"\n'
        + factor("b", 'expression = "a ** 2 + 1"', "chain.damping")
        + factor("c", 'expression = "10 / (b - 5)"\ninteger = true', "chain.links")
        + '[[factors]]\nname = "a"\nlevels = [1, 2, 3]\ngroup = "size"\n'
        + factor("d", 'levels = [10, 20, 30]\ngroup = "size"', "chain.stiffness")
        + '[[constraints]]\nrequire = "d < 30 and a >= 1"\n'
    )
    reasons = [None, "c = 10 / (b - 5): division by zero", "constraint d < 30 and a >= 1 is not met"]
    assert table.select([*"adbc", "status", "reason"]).to_pydict() == {
        **{"a": [1, 2, 3], "d": [10, 20, 30], "b": [2, 5, 10], "c": [-3, None, 2]},
        **{"status": ["planned", "infeasible", "infeasible"], "reason": reasons},
    }


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_table_design(tmp_path, ending):
    import pyarrow as pa
    from pyarrow import csv, parquet

    table = pa.table({"torque": [1.5, 2.5], "wrap": ["cw", "ccw"], "teeth": [20, 22]})
    path = tmp_path / f"rows.{ending}"
    (csv.write_csv if ending == "csv" else parquet.write_table)(table, path)
    text = f'[design]\nkind = "table"\nfile = "rows.{ending}"\n' + factor("torque", "")
    text += "".join(factor(name, "", f"sprockets.tightener.{name}") for name in ("wrap", "teeth"))
    made = design(text, tmp_path / "study.toml")
    assert made.select(["torque", "wrap", "teeth"]).to_pylist() == table.to_pylist()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "cannot be read"),
        ("speed\n1\n", "no column for factor torque; it has speed"),
        ("torque,speed\n1,2\n", "column speed: no factor of that name"),
        ("torque\n", "no rows"),
        ("torque\n1\nnan\n", "column torque, row 1: empty"),
    ],
)
def test_wrong_tables_are_told_in_one_line(tmp_path, content, text):
    if content is not None:
        (tmp_path / "rows.csv").write_text(content)
    with pytest.raises(StudyError) as caught:
        design('[design]\nkind = "table"\nfile = "rows.csv"\n' + factor("torque", ""), tmp_path / "study.toml")
    assert str(tmp_path / "rows.csv") in str(caught.value) and text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_too_many_rows_are_refused():
    with pytest.raises(StudyError, match=r"study.toml: design: 4000000000 rows; allowed are at most 10000000"):
        design(
            '[design]\nkind = "factorial"\n'
            + factor("torque", "range = [0, 1]\npoints = 100000")
            + factor("viscous", "range = [0, 1]\npoints = 40000")
        )
