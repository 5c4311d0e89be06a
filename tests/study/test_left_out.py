"""Rows left out by their own results: the lost parts of the factors' ranges are named, and no factor is ranked."""

import re

import numpy as np
import pyarrow as pa
import pytest
from command import run
from view.html_page import Page

from warpchain.errors import StudyError
from warpchain.study.analysis.left_out import LeftOut
from warpchain.study.report import study_report_html
from warpchain.study.report.rerun_scatters import _telling_inputs
from warpchain.study.results import read_results
from warpchain.study.surrogate.indices import best_indices

REASON = "largest tension 0.2 of the chain's breaking load"


def table_of(status=None, **columns):
    """Results with factors a, b and, where given, law; the rest are metrics."""
    count = len(columns["a"])
    words = np.full(count, "ok", dtype=object) if status is None else np.asarray(status, dtype=object)
    columns |= {"status": words, "reason": np.where(words == "ok", "", REASON)}
    factors = [name for name in ("a", "b", "law") if name in columns]
    return read_results(pa.table(columns), factors, [n for n in columns if n not in (*factors, "status", "reason")])


def pairs_of(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.permutation(count) / (count - 1.0), rng.permutation(count) / (count - 1.0), rng


def words_of(results):
    return " ".join(Page(study_report_html(results)).words)


def test_a_limit_on_the_metric_itself_ranks_no_factor_and_says_what_is_lost():
    """y = 100 max(a - 0.5, 0) + b: of all rows a makes nearly all, and of those with y below 1.5 all but b is cut off.
    Left out are the rows with a above 0.5 + (1.5 - b) / 100, so from 0.505 to 0.515 on: 30 of 61 and no other."""
    a, b, _ = pairs_of(61)
    y = 100.0 * np.maximum(a - 0.5, 0.0) + b
    fair = table_of(a=a, b=b, y=y)
    assert re.search(r"y: from .*?; a matters most, with 9\d %", words_of(fair))
    results = table_of(np.where(y > 1.5, "suspect", "ok"), a=a, b=b, y=y)
    left_out, words = LeftOut(results), words_of(results)
    assert left_out.is_unranked("y") and not LeftOut(fair).is_unranked("y") and LeftOut(fair).lines() == []
    lost = int((y > 1.5).sum())
    assert re.search(
        rf"{lost} of 61 variants are left out by their own results: {lost} variants, e.g. suspect, .*0\.2", words
    )
    low = float(a[y > 1.5].min())
    told = f"Lost, by factor: a: {lost} of {lost} from {low:.5g} to 1, 0 of {61 - lost} elsewhere."
    assert told in words and "b: " not in told
    assert "matters most" not in words and "explains" not in words.replace("A factor explains the part", "")
    assert "y: from 0.0" in words and "variants that are left out may lie beyond, so no factor is ranked." in words
    with pytest.raises(StudyError, match=rf"{lost} of 61 variants that ran are left out by their own"):
        best_indices(results, "y")
    assert _telling_inputs(results) == ("a", "b")


def test_few_rows_that_chance_takes_change_nothing_and_many_do():
    a, b, rng = pairs_of(100)
    y = 10.0 * a + rng.standard_normal(100)
    for lost, ranked in ((3, True), (12, False)):
        status = np.full(100, "ok", dtype=object)
        status[np.random.default_rng(1).permutation(100)[:lost]] = "diverged"
        words = words_of(table_of(status, a=a, b=b, y=y))
        assert ("a matters most" in words) == ranked
        assert f"{lost} of 100 variants are left out by their own results: {lost} variants, e.g. diverged" in words


def test_few_rows_at_the_end_of_a_factor_or_of_the_metric_are_not_chance():
    """4 of 100: at random, a side of 0.05 of three tests has a chance of C(96, 0) / C(100, 4) and the like."""
    a, b, rng = pairs_of(100)
    y, z = rng.standard_normal(100), rng.standard_normal(100)
    status = np.where(a > 0.965, "diverged", "ok")
    left_out = LeftOut(table_of(status, a=a, b=b, y=y))
    assert left_out.left_out_rows.sum() == 4 and left_out.is_unranked("y")
    assert [(part.factor, part.is_sure) for part in left_out.lost_parts] == [("a", True), ("b", False)]
    assert str(left_out.lost_parts[0]).startswith("a: 4 of 4 from 0.9697 to 1, 0 of 96 elsewhere")
    status = np.where(np.argsort(np.argsort(y)) > 95, "suspect", "ok")  # the four largest y, whatever a and b
    left_out = LeftOut(table_of(status, a=a, b=b, y=y, z=z))
    assert left_out.is_unranked("y") and not left_out.is_unranked("z")
    assert not any(part.is_sure for part in left_out.lost_parts)


def test_chance_is_seldom_taken_for_a_cause():
    """Of 4 rows of 100 lost at random, at most 5 % of tables are told selected; 200 of them: 10 + 3 sqrt(9.5) = 19."""
    wrong = 0
    for seed in range(200):
        a, b, rng = pairs_of(100, seed)
        status = np.full(100, "ok", dtype=object)
        status[rng.permutation(100)[:4]] = "suspect"
        wrong += LeftOut(table_of(status, a=a, b=b, y=rng.standard_normal(100))).is_unranked("y")
    assert wrong <= 19


def test_words_are_parts_too():
    a, b, _ = pairs_of(90)
    law = np.array(["u", "v", "w"] * 30)
    status = np.where((law == "v") & (a > 0.3), "suspect", "ok")
    first, *others = LeftOut(table_of(status, a=a, b=b, law=law, y=b)).lost_parts
    lost = int((status != "ok").sum())
    assert str(first) == f"law: {lost} of 30 at v, 0 of 60 elsewhere" and first.is_sure
    assert not [part.factor for part in others if part.factor == "b" and part.is_sure]


def test_drives_that_cannot_be_built_are_told_and_the_others_ranked():
    a, b, rng = pairs_of(100)
    status = np.where(a > 0.8, "infeasible", "ok")
    y = np.where(status == "ok", 10.0 * b + 0.1 * rng.standard_normal(100), np.nan)
    words = words_of(table_of(status, a=a, b=b, y=y))
    assert (
        "20 of 100 variants could not be built and have no result. Lost, by factor: a: 20 of 20 from 0.80808" in words
    )
    assert "b matters most" in words


STUDY = """
[study]
drive = "chain.toml"
[design]
kind = "sobol"
count = 16
[[factors]]
name = "torque"
path = "sprockets.driven.load.torque"
range = [2.0, 20.0]
unit = "N m"
[[factors]]
name = "center"
path = "sprockets.driven.center.0"
range = [0.399, 0.4012]
unit = "m"
[limits]
breaking_load = 0.1
energy_change = inf
start = inf
[run]
duration = 0.02
"""


def test_a_study_whose_limit_leaves_out_its_tightest_chains(tmp_path, capsys):
    """Chains of 100 links on centers up to 1.2 mm too far apart: tension rises by the stretch alone, and the limit on
    it takes the far centers. What is left says nothing of the center, and the page does not rank by it."""
    drive = tmp_path / "chain.toml"
    sizes = ["--size", "06C", "--teeth", "16", "16", "--centers", "0", "0", "0.4", "0", "--keep-centers"]
    assert run(capsys, "new", drive, *sizes, "--speed", "300rpm", "--torque", "10")[0] == 0
    (tmp_path / "study.toml").write_text(STUDY)
    assert run(capsys, "study", "run", tmp_path / "study.toml", "-o", tmp_path / "out", "--quiet")[0] == 0
    results = read_results(tmp_path / "out/results.parquet")
    lost = int((~results.ok).sum())
    assert lost > 2 and set(results.status) == {"ok", "suspect"}
    assert run(capsys, "study", "report", tmp_path / "out", "-o", tmp_path / "r.html")[0] == 0
    words = " ".join(Page((tmp_path / "r.html").read_text()).words)
    assert f"{lost} of 16 variants are left out by their own results" in words and "matters most" not in words
    part = re.search(rf"Lost, by factor: center: {lost} of \d+ from (\S+) mm to 401\.\d+ mm, 0 of \d+ elsewhere", words)
    assert 400.0 < float(part[1]) < 401.0
