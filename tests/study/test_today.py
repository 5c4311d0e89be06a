"""Today's design, the base drive as it is: run beside the others, shown beside recommended ones, judged by its runs."""

import json
import re
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from scipy.stats import norm
from study_helpers import LIMITS, NOISY, SAMPLED, STUDY, tiny_drive
from study_helpers import write_study as write_tiny_study
from view.html_page import Page

from warpchain import run_study
from warpchain.drive import dumps_drive
from warpchain.errors import StudyError
from warpchain.study.analysis.over_noise import designs_over_noise
from warpchain.study.analysis.pareto import Goals
from warpchain.study.optimize import open_study, optimize, recommend
from warpchain.study.optimize.recommend import design_of_today, judge_rows
from warpchain.study.optimize.risk import read_risk
from warpchain.study.report import study_report_html
from warpchain.study.report.decision_sections import ReportGoals, change_texts
from warpchain.study.report.risk_page import today_lines
from warpchain.study.results import TODAY_COLUMN, added_rows, read_results
from warpchain.study.run.prepare import read_study
from warpchain.study.run.today import row_of_drive
from warpchain.study.spec import loads_study
from warpchain.study.spec.study_tables import Bound, Objective
from warpchain.study.store import read_table

TODAY = SAMPLED.replace("count = 4", "count = 4\ntoday = true")
OWN = {"torque": 0.0, "links": 44}
"""Torque and links of the base drive."""


def write_study(folder, more="", points=6, shard=2, text=STUDY):
    """As that of `study_helpers`, of a drive that has a load."""
    path = write_tiny_study(folder, more, points, shard, text)
    drive = tiny_drive().with_values({"sprockets.s1.load.torque": 0.0})
    (folder / "tiny.toml").write_text(dumps_drive(drive))
    return path


def asked(text):
    """A study's text that asks for today's design."""
    found = re.sub(r'(kind = "[^"]+"\n)', r"\1today = true\n", text, count=1)
    assert found != text
    return found


def test_its_row_comes_first_and_is_no_part_of_the_sample(tmp_path):
    plain, _, sample = read_study(write_study(tmp_path / "a", text=SAMPLED))
    study, drive, design = read_study(write_study(tmp_path / "b", text=TODAY))
    assert row_of_drive(plain, drive, "tiny") == OWN == design.select(list(OWN)).slice(0, 1).to_pylist()[0]
    assert design[TODAY_COLUMN].to_pylist() == [True] + 4 * [None]
    assert design.select(list(OWN)).slice(1).equals(sample.select(list(OWN)))
    results = read_results(run_study(tmp_path / "b" / "study.toml", tmp_path / "b" / "out").table)
    assert results.row_of_today == 0 and TODAY_COLUMN not in results.metrics
    assert results.sampled_rows().table.equals(results.table.slice(1))
    words = " ".join(Page(study_report_html(results)).words)
    assert "are of the 4 variants of the study's design. Those of today's design, 1, are no part of it." in words


def test_a_design_that_has_it_is_marked_and_not_changed(tmp_path):
    """The base drive's torque is 0, an end of the range, and its 44 links are a level."""
    text = asked(STUDY)
    _, _, plain = read_study(write_study(tmp_path / "a"))
    _, _, design = read_study(write_study(tmp_path / "b", text=text))
    assert design.drop_columns([TODAY_COLUMN]).equals(plain)
    rows = [row[TODAY_COLUMN] for row in design.to_pylist() if {name: row[name] for name in OWN} == OWN]
    assert rows == [False] and design[TODAY_COLUMN].null_count == design.num_rows - 1
    assert not added_rows(design).any()


def test_it_grows_with_the_study(tmp_path):
    path, out = write_study(tmp_path, text=TODAY), tmp_path / "out"
    run_study(path, out)
    write_study(tmp_path, text=TODAY.replace("count = 4", "count = 8"))
    table = read_table(run_study(path, out, grow=True).table)
    assert table[TODAY_COLUMN].to_pylist() == [True] + 8 * [None]


def test_what_leaves_no_drive_as_it_is_is_refused(tmp_path, capsys):
    away = asked(SAMPLED.replace("levels = [44, 45]", "levels = [45, 46]\nrelative = false"))
    _, _, design = read_study(write_study(tmp_path / "away", text=away))
    assert design["links"].to_pylist()[0] == 44  # today's need not be among the levels
    nowhere = asked(SAMPLED) + '\n[[factors]]\nname = "free"\nrange = [0.0, 1.0]\n'
    nowhere += '[[constraints]]\nrequire = "free > -1.0"\n'
    line = refused(capsys, "study", "plan", write_study(tmp_path / "nowhere", text=nowhere))
    assert "design.today: factor free has no place in a drive file" in line
    line = refused(capsys, "study", "plan", write_study(tmp_path / "noise", text=asked(NOISY)))
    assert 'design.today = true: not with kind "noise", whose rows are all of the drive as it is' in line


SEARCH = """
objectives = [{{ metric = "tension_max", sense = "max" }}]
limits = [{{ energy_residual = inf, energy_change = inf }}, {{ metric = "tension_std", max = 900 }}]
optimize = {{ count = 7, batch = 3 }}
record = {{ rate = 1e5 }}
""" + SAMPLED.replace(LIMITS, "").replace("duration = 0.0005", "duration = 0.0003")


def test_a_search_asks_for_the_same_rows_with_and_without_it(tmp_path, capsys):
    """It is shown beside what is recommended, on the page and by the command, and does not lead the search."""
    pytest.importorskip("sklearn")
    plain = optimize(write_study(tmp_path / "a", text=SEARCH), tmp_path / "a" / "out")
    path, out = write_study(tmp_path / "b", text=asked(SEARCH)), tmp_path / "b" / "out"
    found = optimize(path, out)
    assert plain.today is None and found.today.row == 0
    table = found.results.table
    assert table.slice(1).select(list(OWN)).equals(plain.results.table.select(list(OWN)))
    assert {name: table[name][0].as_py() for name in OWN} == OWN
    again = optimize(path, out)  # resumed
    assert again.results.table.equals(table) and again.today == found.today
    _, lines, _ = run(capsys, "optimize", path, "-o", out, "--quiet")
    assert "today's design: variant 0" in lines and "  today's design, the base drive as it is" in lines
    assert any(re.search(r"simulated; less today's [+-]?[\d.]+.* N, (better|worse|not known)\)", s) for s in lines)
    assert run(capsys, "study", "report", out, "-o", tmp_path / "page.html")[0] == 0
    page = Page((tmp_path / "page.html").read_text())
    assert "less today's, two standard deviations" in page.words
    data = json.loads(next(word for word in page.words if '"recommended":' in word))
    assert [0, "today"] in data["recommended"] or any(row == 0 and "today" in word for row, word in data["recommended"])
    assert not (tmp_path / "page-today.toml").exists()


def test_a_page_says_that_it_was_not_run(tmp_path, capsys):
    pytest.importorskip("sklearn")
    optimize(write_study(tmp_path, text=SEARCH), tmp_path / "out")
    assert run(capsys, "study", "report", tmp_path / "out", "-o", tmp_path / "page.html")[0] == 0
    words = " ".join(Page((tmp_path / "page.html").read_text()).words)
    assert "With today = true in the study's [design] it is" in words


MU = np.linspace(0.05, 0.25, 16)
GOALS = Goals((Objective(metric="y", sense="max"),), (Bound(metric="t", max=110.0),))


def over_noise(shifts, scatter, status="ok", seed=0):
    """Designs over the noise: y of the k-th is higher than today's, the first, by `shifts` and a scatter of its own."""
    rng, count = np.random.default_rng(seed), len(shifts)
    noise, own = np.tile(MU, count), np.repeat(np.arange(count, dtype=float), 16)
    y = 100.0 * noise + np.repeat(shifts, 16) + scatter * rng.standard_normal(16 * count)
    facts = [{"role": "factor"}, {"role": "factor", "kind": "noise"}]
    fields = [pa.field(name, pa.float64(), metadata=of) for name, of in zip(("a", "mu"), facts, strict=True)]
    words = [status] + (16 * count - 1) * ["ok"]
    columns = {"variant": range(16 * count), "y": y, "t": 100.0 + 0.0 * y, "status": words}
    table = pa.Table.from_arrays([pa.array(own), pa.array(noise)], schema=pa.schema(fields))
    for name, values in columns.items():
        table = table.append_column(name, pa.array(values))
    table = table.append_column("reason", pa.array(["its reason" if word != "ok" else "" for word in words]))
    marks = pa.array([True] * 16 + [None] * (16 * count - 16), pa.bool_())
    return read_results(table.append_column(TODAY_COLUMN, marks), ["a", "mu"], ["y", "t"])


@pytest.mark.parametrize(("shift", "scatter", "verdict"), [(3.0, 0.5, "better"), (0.05, 0.5, "not known")])
def test_a_change_is_judged_in_pairs_over_the_same_noise(shift, scatter, verdict):
    """The noise spreads y by 6; what is left in pairs scatters by 0.7, whose mean over 16 is known to some 0.6."""
    results = over_noise([0.0, shift], scatter)
    designs, over = designs_over_noise(results, GOALS)
    (best, *_) = recommend(designs, over)
    y = results.values("y").reshape(2, 16)
    if best.row == 1:
        change = best.changes["mean(y)"]
        assert change.difference == pytest.approx(float((y[1] - y[0]).mean()), abs=1e-9)
        assert change.verdict == verdict and abs(change.difference - shift) < change.half < 1.0
        assert change.pairs == (int((np.sign(y[1] - y[0]) == np.sign(change.difference)).sum()), 16)
    assert (best.row == 1) or verdict == "not known"
    page = " ".join(Page(study_report_html(results, wanted=ReportGoals(GOALS.objectives, GOALS.bounds))).words)
    assert "today" in page and verdict in page


def test_where_all_pairs_agree_no_interval_says_otherwise():
    """The 5 % quantile of 16 runs is known badly, but each run of the second is 3 above that of the first."""
    goals = Goals((Objective(metric="q5(y)", sense="max"),), ())
    designs, over = designs_over_noise(over_noise([0.0, 3.0], 0.5), goals)
    change = recommend(designs, over)[0].changes["q5(y)"]
    assert change.pairs == (16, 16) and change.verdict == "better"
    assert change_texts(replace(change, half=9.0), "N")[0] == f"+{change.difference:.4g} N, in 16 of 16 pairs"
    assert " ± " in change_texts(replace(change, half=9.0, sign=0), "N")[0]


def test_today_may_be_what_is_recommended_or_not_ok():
    designs, over = designs_over_noise(over_noise([5.0, 0.0], 0.5), GOALS)
    (best, *_) = recommend(designs, over)
    assert best.row == 0 and not best.changes and "today's design, the base drive as it is" in best.reasons
    results = over_noise([5.0, 0.0], 0.5, "suspect")
    designs, over = designs_over_noise(results, GOALS)
    today = design_of_today(designs, judge_rows(designs, over))
    assert "suspect: its reason" in today.reasons
    page = study_report_html(results, wanted=ReportGoals(GOALS.objectives, GOALS.bounds))
    assert "suspect: its reason" in page and "nan" not in " ".join(Page(page).words)


RISK = """
limits = [{{ energy_residual = inf, energy_change = inf }}, {{ metric = "tension_std", min = {least} }}]
risk = {{ count = 50, repeats = 3, samples = 100 }}
record = {{ rate = 1e5 }}
"""
TINY = NOISY.replace(LIMITS, "")


def risk_study(folder):
    """A limit that the tiny drive breaks with a torque of 1.2 deviations above its mean, which is 11.5 %."""
    bench = open_study(write_tiny_study(folder, shard=1000, text=TINY + LIMITS))
    torques = [{"torque": torque} for torque in (2.0, 5.0, 6.2, 8.0)]
    spread = np.array(bench.evaluate(torques)["tension_std"].to_pylist())
    assert (np.diff(spread) < 0.0).all(), spread
    path = folder / "study.toml"
    path.write_text(RISK.format(least=repr(float(spread[2]))) + TINY.format(shard=1000))
    return path


def test_risk_of_a_drive_beside_todays(tmp_path, capsys):
    """Slightly heavier rollers break the limit from some 2.8 deviations on, 0.3 %: the intervals do not overlap."""
    path, out = risk_study(tmp_path), tmp_path / "out"
    drive = tmp_path / "proposed.toml"
    drive.write_text(dumps_drive(tiny_drive().with_values({"chain.roller_mass": 1.0002 * tiny_drive().chain.mass})))
    status, lines, told = run(capsys, "risk", path, drive, "-o", out)
    assert status == 0, told
    found = read_risk(out)
    assert lines[0].startswith(f"drive: {drive}, over the noise of torque")
    assert found.today.drive == "tiny.toml" and found.today.folder == out / "today"
    assert any(line.startswith("warpchain: today's design: ") for line in told)
    here, there = found.joint, found.today.joint
    assert there.low < norm.sf(1.2) < there.high and here.high < there.low and found.sign_beside_today == -1
    verdict = "surely fails less often than today's design: the 95 % intervals do not overlap"
    assert any(verdict in line for line in lines)
    words = " ".join(Page((out / "risk.html").read_text()).words)
    assert verdict in words and f"{there.probability:.3g}" in words and "today's design, tiny.toml" in words
    swapped, unknown = replace(found.today, today=found), replace(found, joint="unknown: why")
    assert swapped.sign_beside_today == 1 and "surely fails more often" in today_lines(swapped)[-1]
    assert unknown.sign_beside_today == 0 and "is not known" in today_lines(unknown)[-1]
    assert (out / "today" / "risk.html").exists()
    alone = run(capsys, "risk", path, "-o", tmp_path / "alone", "--quiet")[1]
    assert read_risk(tmp_path / "alone").joint == there  # today's is what it is alone
    assert not any("today's" in line for line in alone)


def test_the_drive_of_a_risk_may_be_the_studys_own(tmp_path, capsys):
    path = risk_study(tmp_path)
    assert run(capsys, "risk", path, tmp_path / "tiny.toml", "-o", tmp_path / "out", "--quiet")[0] == 0
    assert read_risk(tmp_path / "out").today is None and not (tmp_path / "out" / "today").exists()
    assert "absent.toml" in refused(capsys, "risk", path, tmp_path / "absent.toml", "-o", tmp_path / "other")


def test_a_study_file_says_it():
    with pytest.raises(StudyError, match=r"design.today = 1: must be true or false"):
        loads_study(SAMPLED.format(shard=2).replace("count = 4", "count = 4\ntoday = 1"))
