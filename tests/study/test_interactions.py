"""Interactions of factors against closed forms, and against how often chance alone makes one."""

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from warpchain.study.analysis.interactions import interactions
from warpchain.study.results import read_results


def test_a_product_is_found_with_its_part_of_the_variance():
    """y = 2 a + b^2 + 3 a c on a grid of -1, 0, 1: variances 4 * 2/3, 2/9, 9 * 4/9; c does nothing alone."""
    a, b, c = (axis.ravel() for axis in np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3))
    table = pa.table({"a": a, "b": b, "c": c, "y": 2.0 * a + b * b + 3.0 * a * c})
    first, *others = interactions(read_results(table, ["a", "b", "c"], ["y"]), "y")
    assert (first.first, first.second, first.is_sure) == ("a", "c", True)
    assert first.explained == pytest.approx(4.0 / (8.0 / 3.0 + 2.0 / 9.0 + 4.0), rel=1e-9)
    assert len(others) == 2 and max(one.explained for one in others) < 1e-12
    assert str(first) == "a and c act together: 58 % of the variance"


def test_words_act_together_with_numbers_and_with_words():
    """x counts for one word only; of two words' four pairs one differs: F is that of the analysis of variance."""
    random = np.random.default_rng(1)
    law, oil = (np.array(words)[random.integers(0, 2, 60)] for words in (["flores", "hunt"], ["thick", "thin"]))
    x = random.uniform(-1.0, 1.0, 60)
    y = np.where(law == "hunt", x, 0.0) + 0.05 * random.standard_normal(60)
    columns = {"law": law, "oil": oil, "x": x, "y": y}
    first, *others = interactions(read_results(pa.table(columns), ["law", "oil", "x"], ["y"]), "y")
    assert (first.first, first.second) == ("law", "x") and first.is_sure
    assert not any(one.is_sure for one in others)
    columns["y"] = np.where((law == "hunt") & (oil == "thin"), 1.0, 0.0) + 0.1 * random.standard_normal(60)
    only = interactions(
        read_results(pa.table({k: v for k, v in columns.items() if k != "x"}), ["law", "oil"], ["y"]), "y"
    )
    whole = np.stack([np.ones(60), law == "hunt", oil == "thin", (law == "hunt") & (oil == "thin")], axis=1).astype(
        float
    )
    squares = [float(np.linalg.lstsq(whole[:, :k], columns["y"], rcond=None)[1][0]) for k in (3, 4)]
    ratio = (squares[0] - squares[1]) / (squares[1] / 56)
    assert only[0].chance == pytest.approx(stats.f.sf(ratio, 1, 56), rel=1e-6)


def test_chance_is_taken_for_an_interaction_as_often_as_told():
    """Without any, one of 15 pairs is beyond chance in at most 5 % of tables: of 200, 10; 19 are three deviations."""
    random, names = np.random.default_rng(2), list("uvwxyz")
    wrong = 0
    for _ in range(200):
        table = {name: random.random(40) for name in names}
        table["t"] = table["u"] + table["v"] ** 2 + random.standard_normal(40)
        wrong += any(one.is_sure for one in interactions(read_results(pa.table(table), names, ["t"]), "t"))
    assert wrong <= 19


def test_few_rows_tell_nothing():
    table = pa.table({"a": [0.0, 1.0, 2.0], "b": [1.0, 0.0, 2.0], "y": [1.0, 2.0, 4.0]})
    assert interactions(read_results(table, ["a", "b"], ["y"]), "y") == []
