"""Suspect rows of a study: kept in the table, counted with their reasons, and out of every analysis."""

import numpy as np
import pyarrow as pa
from command import run
from pyarrow import parquet
from study_helpers import STUDY, tiny_drive, write_study

from warpchain import run_study
from warpchain.assembly.arm_balance import chain_path
from warpchain.study.analysis import main_effects
from warpchain.study.analysis.pareto import pareto_front
from warpchain.study.report import report_html
from warpchain.study.results import read_results
from warpchain.study.run import study_status

TIGHT = STUDY.replace("energy_residual = inf", "energy_residual = 0.0")


def test_suspect_rows_keep_their_metrics_and_are_counted_with_their_reason(tmp_path):
    """With no energy residual allowed every row is suspect; the study then ends with status 1."""
    outcome = run_study(write_study(tmp_path, points=2, text=TIGHT), tmp_path / "out", workers=1)
    assert outcome.counts == {"ok": 0, "suspect": 4, "diverged": 0, "infeasible": 0}
    rows = parquet.read_table(tmp_path / "out" / "results.parquet").to_pylist()
    assert all(row["status"] == "suspect" and row["reason"].startswith("energy residual") for row in rows)
    assert all(row["tension_mean"] is not None for row in rows)
    again = study_status(tmp_path / "out")
    assert [count for _, count in again.reasons] == [4]
    results = read_results(tmp_path / "out" / "results.parquet")
    assert not results.ok.any() and not results.rows_for("tension_mean").any()


def test_no_row_ok_is_status_1(tmp_path, capsys):
    source = write_study(tmp_path, points=2, text=TIGHT)
    status, out, _ = run(capsys, "study", "run", source, "-o", tmp_path / "out", "--quiet")
    assert status == 1
    assert out[0].endswith("variants: 0 ok, 4 suspect, 0 diverged, 0 infeasible")
    assert out[1].startswith("  4 like this: energy residual")
    assert run(capsys, "study", "status", tmp_path / "out")[0] == 0
    source = write_study(tmp_path / "good", points=2)
    assert run(capsys, "study", "run", source, "-o", tmp_path / "good" / "out", "--quiet")[0] == 0


WRAPS = STUDY.replace('kind = "factorial"', 'kind = "table"\nfile = "rows.csv"').replace("levels = [44, 45]\n", "")
WRAPS = WRAPS.replace('"torque"', '"wrap"').replace("s1.load.torque", "s1.wrap")
WRAPS = WRAPS.replace("range = [0.0, 1.0]\npoints = {points}\n", "")


def test_a_row_whose_strands_cross_is_suspect_and_says_so(tmp_path):
    crossed = tiny_drive().with_values({"sprockets.s1.wrap": "cw"})
    links = next(n for n in chain_path(crossed).fitting_links() if n % 2 == 0)
    (tmp_path / "rows.csv").write_text(f"wrap,links\nccw,44\ncw,{links}\n")
    outcome = run_study(write_study(tmp_path, text=WRAPS), tmp_path / "out", workers=1)
    assert outcome.counts == {"ok": 1, "suspect": 1, "diverged": 0, "infeasible": 0}
    good, bad = parquet.read_table(outcome.table).to_pylist()
    assert good["reason"] is None
    assert bad["reason"].startswith('strands "s0->s1" and "s1->s0" cross at (0.1, ')


def table(rows=60):
    """Made results: y = x but for every tenth row, which is suspect and far off."""
    x = np.linspace(0.0, 1.0, rows)
    bad = np.arange(rows) % 10 == 3
    judged = {"status": np.where(bad, "suspect", "ok")}
    judged["reason"] = np.where(bad, "energy residual +2 % of the energy turned over", "")
    return pa.table({"x": x, "y": np.where(bad, -1e9, x), "z": np.where(bad, -1e9, 1.0 - x)} | judged)


def test_suspect_rows_are_in_no_analysis():
    results = read_results(table(), ["x"])
    bad = set(np.flatnonzero(~results.ok).tolist())
    assert len(bad) == 6
    assert not bad & set(pareto_front(results, {"y": "min", "z": "min"}).tolist())
    assert min(effect.means.min() for effect in main_effects(results, "y")) > -1.0
    html = report_html(results, objectives={"y": "min", "z": "min"})
    assert "<b>6</b>suspect" in html and "energy residual +2 %" in html
    assert "1e+09" not in html and "-1000000000" not in html
