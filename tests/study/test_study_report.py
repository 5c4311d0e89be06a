"""The report of a study: one page that a browser shows without a network, and the command that writes it."""

import json
import re
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from study_helpers import LINKS, STUDY, write_study
from view.html_page import Page

from warpchain.errors import StudyError
from warpchain.results.units import distinguishing_decimals
from warpchain.study.analysis import main_effects
from warpchain.study.design import make_design
from warpchain.study.report import study_report_html, telling_metrics
from warpchain.study.report.decision_sections import ReportGoals
from warpchain.study.report.panels import surrogate_panels
from warpchain.study.results import export_table, read_results
from warpchain.study.spec import load_study
from warpchain.study.spec.study_tables import Bound, Objective
from warpchain.study.surrogate import best_surrogate
from warpchain.view.html import column_number, engineering_number, table_html

FACTORS = ("load.torque", "center.x", "law")


def study(rows=120):
    """A made study: tension follows the torque, energy falls with x; some variants did not end."""
    rng = np.random.default_rng(7)
    torque, x = rng.uniform(6e3, 14e3, rows), rng.uniform(1.1, 1.3, rows)
    status = np.where(x > 1.29, "infeasible", np.where(np.arange(rows) % 40 == 0, "diverged", "ok"))
    lost = status != "ok"
    return pa.table(
        {
            "variant": np.arange(rows),
            "load.torque": torque,
            "center.x": x,
            "law": rng.choice(["flores", "<b>hunt</b>"], rows),
            "tension_max": pa.array(3.0 * torque + 10.0 * rng.standard_normal(rows), mask=lost),
            "contact_energy_per_revolution": pa.array(50.0 - 20.0 * x, mask=lost),
            "status": status,
            "reason": np.where(lost, "why & how", ""),
        }
    )


OBJECTIVES = {"tension_max": "min", "center.x": "max"}


@pytest.fixture(scope="module")
def html():
    return study_report_html(read_results(study(), FACTORS), "A < B", objectives=OBJECTIVES)


def test_page_tells_what_happened_and_needs_no_network(html):
    page = Page(html)
    words = " ".join(page.words)
    named = "designs summary front explore inputs ends distributions effects correlation surface sobol extremes"
    assert page.sections == named.split()
    assert all(link.startswith("#") for link in page.links)
    outside = r"@import|url\(|<script[^>]* src|<link|fetch\(|XMLHttpRequest|https?://(?!www.w3.org/2000/svg)"
    assert not re.search(outside, html)
    assert len(page.charts) == 1 + 1 + 2 * 2 + 1 + 2 + 1  # with interactions of two numeric factors
    status = study()["status"].to_pylist()
    for word in ("ok", "infeasible", "diverged"):
        assert f"<b>{status.count(word)}</b>{word}" in html
    assert "<b>hunt</b>" in words  # as words, not as markup
    assert "why & how" in words
    assert re.search(r"tension_max: from .* kN \(variant \d+\).*load\.torque matters most, with 9\d %", words)


def test_same_study_same_page(html):
    assert study_report_html(read_results(study(), FACTORS), "A < B", objectives=OBJECTIVES) == html


def test_few_or_no_variants_are_told_not_analyzed():
    none_ok = study(1)  # its only variant diverged
    html = study_report_html(read_results(none_ok, FACTORS))
    assert "Fewer than three variants" in html
    assert "<b>1</b>diverged" in html
    with pytest.raises(StudyError, match="nothing to report"):
        study_report_html(read_results(none_ok.slice(0, 0), FACTORS))


def test_words_and_switches_alone_make_a_page():
    switches = pa.array([True, False, True, None, False, True])
    y = pa.array([1, 2, None, 4, 5, 6])
    table = pa.table({"law": list("ababab"), "settle": switches, "y": y, "e": pa.nulls(6)})
    for factors in (["law"], ["law", "settle"]):
        html = study_report_html(read_results(table, factors))
        assert "Effects and interactions" in html
        # switches count as the numbers 0 and 1, words do not
        assert ("no factor holds numbers that vary" in html) == ("settle" not in factors)


def test_a_factor_that_is_an_expression_of_others_is_no_cause(tmp_path):
    """torque and share decide; their product varies with both, not linearly with either."""
    both = 'name = "both"\nexpression = "torque * share"\npath = "sprockets.s1.inertia"'
    share = 'name = "share"\nrange = [0.0, 1.0]\npoints = 6'
    more = f"[[factors]]\n{both}\n[[factors]]\n{share}\n"
    source = write_study(tmp_path, more, text=STUDY.replace(LINKS, ""))
    table = make_design(load_study(source), source)
    torque, share = (np.array(table[name].to_pylist()) for name in ("torque", "share"))
    table = table.append_column("tension_max", pa.array(3.0 + torque + 2.0 * torque * share))
    results = read_results(table.drop_columns(["status", "reason"]))
    assert results.factors == ("torque", "both", "share") and results.independent_factors() == ("torque", "share")
    assert {effect.factor for effect in main_effects(results, "tension_max")} == {"torque", "share"}
    page = study_report_html(results)
    assert page.count("Left out, as expressions of other factors: both (of torque and share).") == 2


def test_scatter_without_a_cause_is_called_that():
    rng = np.random.default_rng(0)
    noise = pa.table({"a": rng.random(50), "y": rng.random(50)})
    assert "no factor stands out" in study_report_html(read_results(noise, ["a"]))


def test_a_share_is_not_told_where_each_group_has_one_variant():
    """Of three variants a factor of three values takes up all, whatever the metric: how much it explains is not known.

    Of nine in three groups it is 1 - S_w / 6 / (S / 8), S_w = 2 the squares within the groups and S all, by hand.
    """
    few, y = pa.table({"a": [1.0, 2.0, 3.0], "y": [0.0, 2.0, 4.0]}), [0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 5.0]
    html = study_report_html(read_results(few, ["a"]))
    assert "what each factor explains is not known from 3 variants in 3 groups of a" in html
    assert "3 variants: share not known" in html and "explains 100 %" not in html and "explains most" not in html
    nine = read_results(
        pa.table({"a": [1.0, 2.0, 3.0] * 3, "y": [y[3 * k + i] for i in range(3) for k in range(3)]}), ["a"]
    )
    (effect,) = main_effects(nine, "y")
    between, within = 3 * sum((m - 23 / 9) ** 2 for m in (2 / 3, 7 / 3, 14 / 3)), 2.0
    assert effect.explained == pytest.approx(between / (between + within), rel=1e-12)  # round-off
    assert effect.adjusted_share == pytest.approx(1.0 - within / (between + within) * 8 / 6, rel=1e-12)
    assert f"explains {100.0 * effect.adjusted_share:.0f} %" in study_report_html(nine)


def test_scatter_and_effect_are_one_verdict():
    """y = a b at the corners of a square: neither factor does anything alone, both together all but the scatter."""
    rng = np.random.default_rng(4)
    a, b = (np.tile(corner, 10) for corner in ([-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]))
    table = pa.table({"a": a, "b": b, "y": a * b + 0.15 * rng.standard_normal(40)})
    words = " ".join(Page(study_report_html(read_results(table, ["a", "b"]))).words)
    share = re.search(r"y: (\d+) % of its variance is scatter between equal runs", words).group(1)
    assert share == "2"
    verdict = re.search(r"y: from .*?\); (no factor.*?)\.(?!\d)", words).group(1)
    assert "stands out of the scatter" not in words
    assert re.fullmatch(
        r"no factor stands out alone: [ab] explains most, \d %, as chance may with 40 variants, but a and b act "
        rf"together: 9\d % of the variance; scatter between equal runs makes {share} % of the variance",
        verdict,
    )
    # where equal runs scatter as much as others, that is the verdict; where a factor acts, it is
    cases = {
        r"no factor stands out: scatter between equal runs makes \d+ %": rng.standard_normal(40),
        r"a matters most.*; scatter between equal runs makes 2 %": a + 0.15 * rng.standard_normal(40),
    }
    # of a parity of three no pair shows, and the page does not say that one does
    c = np.repeat([-1.0, 1.0, 1.0, -1.0], 10)[np.random.default_rng(1).permutation(40)]
    three = table.set_column(2, "y", pa.array(a * b * c + 0.15 * rng.standard_normal(40))).append_column("c", [c])
    told = "only, and no pair shows: three or more factors act together, or all in ways that so few variants"
    assert told in " ".join(Page(study_report_html(read_results(three, ["a", "b", "c"]))).words)
    for told, y in cases.items():
        page = study_report_html(read_results(table.set_column(2, "y", pa.array(y)), ["a", "b"]))
        assert re.search(told, " ".join(Page(page).words))


def test_indices_come_from_the_surrogate_that_the_page_draws():
    """y = sin(2 pi a) over a from -1 to 1: no quadratic follows it, a Gaussian process does; a makes all of it."""
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(5)
    a, b = rng.uniform(-1.0, 1.0, 60), rng.uniform(-1.0, 1.0, 60)
    smooth = pa.table({"a": a, "b": b, "y": np.sin(2.0 * np.pi * a), "z": rng.standard_normal(60)})
    html = study_report_html(read_results(smooth, ["a", "b"]))
    sobol = html[html.index('id="sobol"') : html.index('id="extremes"')]
    assert re.search(r"y: of the Gaussian process of 60 variants \(cross-validated Q² = (0.9|1.0)\d+: it misses", sobol)
    assert '"title":"y"' in sobol and '"title":"z"' not in sobol
    # of noise there is no surrogate to be trusted: what is missing, and what would bring it
    assert "the Gaussian process predicts too badly" in sobol and "0.8 is needed, and 60 variants are there" in sobol
    assert "raise design.count" in sobol and "--grow" in sobol and "saltelli_table" in sobol


def search():
    """A search's table as made by hand: two rounds of the least y, the best of them, at row 4, beyond the limit."""
    y = [5.0, 3.0, 4.0, 6.0, 1.0, 2.0, 2.5, 8.0]
    columns = {"variant": range(8), "a": np.linspace(0.0, 1.0, 8), "law": list("uvuvuvuv"), "y": y}
    return pa.table(columns | {"w": [0.0] * 4 + [9.0] + [0.0] * 3, "round": [0] * 4 + [1] * 4})


def test_a_search_tells_its_history():
    results = read_results(search(), ["a", "law"], ["y", "w"])
    wanted = ReportGoals((Objective(metric="y"),), (Bound(metric="w", max=1.0),))
    page = Page(study_report_html(results, wanted=wanted))
    assert page.sections[:3] == ["designs", "summary", "search"]
    words = " ".join(page.words)
    assert "8 variants in 2 rounds, 8 ok, 7 of which keep the limits" in words
    assert "lowest y: 2 (3 after the design), found at evaluation 6 of 8, round 2" in words
    (best,), (of_a, of_law) = (json.loads(word) for word in page.words if '"label":"evaluation"' in word)
    dotted, pale, blue, line = best["series"]
    assert dotted["x"] == [4.5]  # between the rounds
    assert (pale["x"], pale["y"]) == ([5], [1.0])
    assert blue["x"] == [1, 2, 3, 4, 6, 7, 8]
    assert line["x"] == [1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 8]  # steps
    assert line["y"] == [5, 5] + 8 * [3] + 5 * [2]
    drawn = {series["label"]: series["x"] for series in of_a["series"]}
    assert drawn["recommended"] and sorted(x for some in drawn.values() for x in some) == list(range(1, 9))
    assert set(drawn["design"]) <= {1, 2, 3, 4} and set(drawn["proposed"]) <= {5, 6, 7, 8}
    assert of_law["y"]["words"] == ["u", "v"]
    assert "search" not in Page(study_report_html(read_results(study(), FACTORS), objectives=OBJECTIVES)).sections


def test_telling_metrics_come_first_and_constants_not_at_all():
    columns = {name: [1.0, 2.0] for name in ("a", "z", "s.force_max", "tension_max")} | {"one": [1.0, 1.0]}
    assert telling_metrics(read_results(pa.table(columns), ["a"])) == ("tension_max", "s.force_max", "z")


def test_numbers_are_plain():
    written = {0.0: "0", 123456.0: "123456", 0.0041234567: "0.0041235", 1234567.0: "1.2346e+06", 3e-7: "3e-07"}
    written[2.5] = "2.5"
    assert {value: engineering_number(value) for value in written} == written
    assert engineering_number(float("nan")) == "\N{EN DASH}"
    assert '<td class="n">\N{EN DASH}</td>' in table_html(("a",), [(None,), (1.0,)])


@pytest.mark.parametrize(
    ("values", "digits", "words"),
    [
        ([93.4634, 1049.27, 12.0], 0, ["93", "1049", "12"]),
        ([20.00112, 20.00234], 6, ["20.00112", "20.00234"]),
        ([2.0, 1e-9, np.nan], 3, ["2", "1e-09", "\N{EN DASH}"]),
        ([5.0, 5.0 + 1e-15], 3, ["5", "5"]),
        ([3.2e-8, 1.23456e-8], 11, ["3.2e-08", "1.235e-08"]),
        ([512345.0, 12.0], -2, ["512345", "12"]),
        ([0.0, 0.0], 0, ["0", "0"]),
        ([np.nan, np.inf], 0, ["\N{EN DASH}", "inf"]),
        ([], 0, []),
    ],
)
def test_digits_are_those_of_the_range(values, digits, words):
    """Four digits of the range, of the value where all are alike, and two of each small value."""
    assert distinguishing_decimals(values) == digits
    assert [column_number(value, digits) for value in values] == words


def test_command_writes_page_and_table(tmp_path, capsys):
    export_table(study(), tmp_path / "results.parquet")
    text = '[study]\ndrive = "marine"\nname = "Load & place"\n[design]\nkind = "sobol"\ncount = 120\n'
    (tmp_path / "study.toml").write_text(text + '[[constraints]]\nrequire = "a < b"\n')
    output, copy = tmp_path / "r.html", tmp_path / "t.csv"
    report = ("study", "report", tmp_path)
    factors = [word for name in FACTORS for word in ("--factor", name)]
    assert "cannot be written" in refused(
        capsys, *report, "-o", tmp_path / "out" / "r.html", "--metric", "tension_max", *factors
    )
    status, out, _ = run(capsys, *report, "-o", output, "--table", copy, *factors)
    assert (status, out) == (0, [str(output), str(copy)])
    html = output.read_text()
    assert html.startswith("<!DOCTYPE html>")
    assert (
        "<h1>Load &amp; place</h1>" in html and "kind = &quot;sobol&quot;, count = 120" in html and "a &lt; b" in html
    )
    assert read_results(copy, FACTORS).table.num_rows == 120
    (tmp_path / "empty").mkdir()
    for name, told in (("absent", ""), ("", "factors: none given"), ("empty", "make it with: warpchain study merge")):
        assert told in refused(capsys, "study", "report", tmp_path / name, "-o", output)


def test_examples_of_the_documents_run(tmp_path, monkeypatch):
    pytest.importorskip("SALib")
    text = (Path(__file__).resolve().parents[2] / "docs" / "analysis.md").read_text()
    monkeypatch.chdir(tmp_path)
    for code in re.findall(r"```python\n(.*?)```", text, re.S):
        exec(compile(code, "analysis.md", "exec"), {})
    assert "Camshaft torque" in (tmp_path / "torques.html").read_text()
    assert read_results(tmp_path / "design.csv", ["torque", "speed"]).table.num_rows == 1024


def test_rows_that_are_not_ok_are_listed_with_their_reasons(html):
    words = " ".join(Page(html).words)
    lost = [row for row in study().to_pylist() if row["status"] != "ok"]
    assert "Each of them" in words
    for row in lost[:40]:
        assert re.search(rf">{row['variant']}</td><td>{row['status']}</td><td>why &amp; how<", html)


def test_rows_that_are_not_ok_are_drawn_but_not_fitted():
    """y = a; two suspect rows off the line: one within the picture, one far away. The surrogate stays y = a."""
    a = np.linspace(0.0, 1.0, 30)
    y, status = a.copy(), np.full(30, "ok", dtype=object)
    y[[4, 9]], status[[4, 9]] = [1.2, 1e6], "suspect"
    results = read_results(pa.table({"a": a, "y": y, "status": status}), ["a"], ["y"])
    found = best_surrogate(results, "y")
    assert found.predict({"a": [a[4], a[9]]})[0] == pytest.approx([a[4], a[9]], abs=0.01)
    cut = surrogate_panels(results, found, found.cross_validated())[0]
    (dots,) = (series for series in cut["series"] if series.get("label", "").startswith("not ok"))
    assert dots["label"] == "not ok, not fitted, 1 more beyond the picture"
    assert (dots["x"], dots["y"]) == (pytest.approx([a[4]], rel=1e-4), [1.2])
    fitted = next(series for series in cut["series"] if series.get("label") == "variants")
    assert len(fitted["x"]) == 28 and 1.2 not in fitted["y"]


def test_units_are_those_that_engineers_read(html):
    assert "tension_max [kN]" in html and "contact_energy_per_revolution [J]" in html
    front = html[html.index('id="front"') : html.index('id="explore"')]
    assert re.search(r"tension_<wbr>max \[kN\]", front)


def cells_of(page, section, column):
    """Head and texts of a section's column, of its first table that has one."""
    part = page[page.index(f'id="{section}"') :].replace("<wbr>", "")
    for found in re.findall(r"<table.*?</table>", part, re.DOTALL):
        heads, *rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>.*?</tr>", found)]
        for k, head in enumerate(heads):
            if head.split(" [")[0] == column:
                return head, [row[k] for row in rows]
    return pytest.fail(f"no {column}")


def test_columns_have_the_unit_and_the_digits_of_what_they_show():
    """A unit that suits what is shown, not a row that ran away, and four digits of the range."""
    power = np.concatenate([np.linspace(1.049, 98.7654321, 59), [4e6]])
    columns = {"a": np.linspace(0.123456789, 0.723456789, 60), "b": np.linspace(12.70010003, 12.70025007, 60)}
    made = pa.table(columns | {"loss": power, "status": ["ok"] * 59 + ["diverged"]})
    schema = pa.schema([field.with_metadata({"unit": "W"} if field.name == "loss" else {}) for field in made.schema])
    page = study_report_html(read_results(made.cast(schema), ["a", "b"], ["loss"]), metrics=("loss",))
    losses = ["1.05", "2.73", "4.42", "95.4", "97.08", "98.77"]
    assert cells_of(page, "extremes", "loss") == ("loss [W]", losses)
    assert cells_of(page, "extremes", "a")[1][0] == "0.1235" and cells_of(page, "extremes", "b")[1][0] == "12.7001"
    assert cells_of(page, "distributions", "least") == ("least", ["1.05"])
    assert cells_of(page, "inputs", "range")[1] == ["0.1235 to 0.7235", "12.7001 to 12.7002501"]


def large(rows):
    rng = np.random.default_rng(1)
    x = rng.random((rows, 6))
    columns = {f"f{k}": x[:, k] for k in range(6)}
    metrics = {f"s{k}.force_max": 1e4 * (3.0 + x @ rng.standard_normal(6) + 0.1 * rng.random(rows)) for k in range(30)}
    return read_results(pa.table({"variant": np.arange(rows)} | columns | metrics), list(columns))


@pytest.mark.long
def test_ten_thousand_rows_make_a_small_page_soon():
    results = large(10_000)
    objectives = {"s0.force_max": "min", "s1.force_max": "min"}
    study_report_html(large(100), objectives=objectives)  # imports are not the page's
    limits = pytest.importorskip("threadpoolctl").threadpool_limits
    with limits(limits=1):  # threads that wait for one another would count
        begin = time.process_time()
        page = study_report_html(results, objectives=objectives)
        # 3 s where it has a core alone; on a busy machine caches are others', too
        assert time.process_time() - begin < 8.0
    assert len(page.encode()) < 3e6  # 10 MB are allowed
