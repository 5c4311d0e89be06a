"""Status of studies, told without what a run needs, by the tables' notes; suspect rows, which no analysis takes in."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from command import refused, run
from pyarrow import parquet
from study_helpers import STUDY, tiny_drive, write_study

from warpchain.assembly.arm_balance import chain_path
from warpchain.errors import StudyError
from warpchain.model import single_chain
from warpchain.study.analysis import main_effects
from warpchain.study.analysis.pareto import pareto_front
from warpchain.study.report import study_report_html
from warpchain.study.results import read_results
from warpchain.study.run import run_study, study_status
from warpchain.study.store import NOTE_KEY, RowOutcomes, read_row_outcomes, write_table

TIGHT = STUDY.replace("energy_residual = inf", "energy_residual = 0.0")
REASONS = ["strain 1e-3 beyond 0.05", None, "no place", "strain 2e-3 beyond 0.05"]
TABLE = pa.table({"status": ["infeasible", "ok", "infeasible", "infeasible"], "reason": REASONS})
ENDED = RowOutcomes(
    {"infeasible": 3, "ok": 1}, [("infeasible", "strain 1e-3 beyond 0.05", 2), ("infeasible", "no place", 1)]
)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study's folder, all of whose rows are suspect: no energy residual is allowed."""
    home = tmp_path_factory.mktemp("study")
    source = write_study(home, points=2, text=TIGHT)
    run_study(source, home / "out", workers=1)
    return home / "out"


def test_a_plan_nested_without_end_is_damaged(folder, capsys):
    (folder / "plan.json").write_text("[" * 300_000)
    assert "plan.json: damaged" in refused(capsys, "study", "status", folder)


@pytest.fixture
def folder(done, tmp_path):
    """A copy of it, to be changed."""
    return shutil.copytree(done, tmp_path / "out")


def without_ended(path):
    """Takes from a table's note what earlier versions did not note."""
    table = parquet.read_table(path)
    held = dict(table.schema.metadata)
    note = {name: value for name, value in json.loads(held[NOTE_KEY]).items() if name not in ("ended", "mark")}
    parquet.write_table(table.replace_schema_metadata(held | {NOTE_KEY: json.dumps(note).encode()}), path)


def test_a_status_loads_nothing_that_only_runs_need(folder):
    """Neither the command nor what it calls: these take from a tenth of a second to a second each."""
    heavy = {"numpy", "pyarrow", "pydantic", "scipy", "warp", "warpchain.drive", "warpchain.study.spec"}
    code = (
        "import sys\nfrom warpchain.cli import main\nsys.argv = ['warpchain', 'study', 'status', sys.argv[1]]\n"
        "assert main() == 0\nprint(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True)
    *told, loaded = done.stdout.splitlines()
    assert told[0].endswith("variants: 0 ok, 4 suspect, 0 diverged, 0 infeasible")
    assert told[1].startswith("  4 variants, e.g. energy residual")
    assert "warpchain.study.run.study_folder" in loaded.split() and not heavy.intersection(loaded.split())


def test_folders_without_such_notes_stand_the_same(folder):
    noted = study_status(folder)
    for path in (folder / "shards").glob("*.parquet"):
        without_ended(path)
    assert study_status(folder) == noted
    assert noted.counts["suspect"] == 4 and noted.reasons[0][1] == 4


@pytest.fixture
def path(tmp_path):
    """A table that notes how its rows ended."""
    write_table(tmp_path / "00000.parquet", TABLE, study="a", note_outcomes=True)
    return tmp_path / "00000.parquet"


def test_how_rows_ended_is_noted(path):
    assert RowOutcomes.of_table(TABLE) == ENDED == read_row_outcomes(path, "a", 4)


@pytest.mark.parametrize(
    ("study", "rows", "match"), [("b", 4, "is another table"), ("a", 5, "has 4 rows, its shard 5")]
)
def test_the_note_of_another_table_does_not_count(path, study, rows, match):
    with pytest.raises(StudyError, match=match):
        read_row_outcomes(path, study, rows)


def test_a_note_that_was_changed_does_not_count(path):
    """Then the table itself is read, here one that is whole."""
    data = path.read_bytes()
    assert data.count(b'"infeasible": 3') == 1
    path.write_bytes(data.replace(b'"infeasible": 3', b'"infeasible": 9'))
    assert read_row_outcomes(path, "a", 4) == ENDED


def test_a_file_that_is_no_table_is_told(path):
    for data in (b"", b"PAR1", b"\xff\xff\xff\x7fPAR1"):
        path.write_bytes(data)
        with pytest.raises(StudyError, match="00000"):
            read_row_outcomes(path, "a", 4)
    path.unlink()
    with pytest.raises(StudyError, match="cannot be read"):
        read_row_outcomes(path, "a", 4)


def test_suspect_rows_keep_their_metrics_and_a_study_of_them_alone_is_status_1(tmp_path, capsys):
    """With no energy residual allowed every row is suspect; each is counted with its reason."""
    source, folder = write_study(tmp_path, points=2, text=TIGHT), tmp_path / "out"
    status, out, _ = run(capsys, "study", "run", source, "-o", folder, "--quiet")
    assert status == 1
    assert out[0].endswith("variants: 0 ok, 4 suspect, 0 diverged, 0 infeasible")
    assert out[1].startswith("  4 variants, e.g. energy residual")
    assert run(capsys, "study", "status", folder)[0] == 0
    results = read_results(folder / "results.parquet")
    rows = results.table.to_pylist()
    assert all(row["status"] == "suspect" and row["reason"].startswith("energy residual") for row in rows)
    assert all(row["tension_mean"] is not None for row in rows)
    assert not results.ok.any() and not results.usable_rows("tension_mean").any()
    source = write_study(tmp_path / "good", points=2)
    assert run(capsys, "study", "run", source, "-o", tmp_path / "good" / "out", "--quiet")[0] == 0


WRAPS = STUDY.replace('kind = "factorial"', 'kind = "table"\nfile = "rows.csv"').replace("levels = [44, 45]\n", "")
WRAPS = WRAPS.replace('"torque"', '"wrap"').replace("s1.load.torque", "s1.wrap")
WRAPS = WRAPS.replace("range = [0.0, 1.0]\npoints = {points}\n", "")


def test_a_row_whose_strands_cross_is_suspect_and_says_so(tmp_path):
    crossed = tiny_drive().with_values({"sprockets.s1.wrap": "cw"})
    links = next(n for n in chain_path(single_chain(crossed)).fitting_links() if n % 2 == 0)
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
    html = study_report_html(results, objectives={"y": "min", "z": "min"})
    assert "<b>6</b>suspect" in html and "energy residual +2 %" in html
    assert "1e+09" not in html and "-1000000000" not in html
