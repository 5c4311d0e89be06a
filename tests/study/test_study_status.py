"""How a study stands, told without what a run needs: from the notes of its tables, else from the tables themselves."""

import json
import shutil
import subprocess
import sys

import pyarrow as pa
import pytest
from pyarrow import parquet
from study_helpers import STUDY, write_study

from warpchain.errors import StudyError
from warpchain.study.run import run_study, study_status
from warpchain.study.store import NOTE, Ended, read_ended, write_table

REASONS = ["strain 1e-3 beyond 0.05", None, "no place", "strain 2e-3 beyond 0.05"]
TABLE = pa.table({"status": ["infeasible", "ok", "infeasible", "infeasible"], "reason": REASONS})
ENDED = Ended({"infeasible": 3, "ok": 1}, [("infeasible", "strain 1e-3 beyond 0.05", 2), ("infeasible", "no place", 1)])


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study's folder, all of whose rows are suspect: no energy residual is allowed."""
    home = tmp_path_factory.mktemp("study")
    source = write_study(home, points=2, text=STUDY.replace("energy_residual = inf", "energy_residual = 0.0"))
    run_study(source, home / "out", workers=1)
    return home / "out"


@pytest.fixture
def folder(done, tmp_path):
    """A copy of it, to be changed."""
    return shutil.copytree(done, tmp_path / "out")


def without_ended(path):
    """Takes from a table's note what earlier versions did not note."""
    table = parquet.read_table(path)
    held = dict(table.schema.metadata)
    note = {name: value for name, value in json.loads(held[NOTE]).items() if name not in ("ended", "mark")}
    parquet.write_table(table.replace_schema_metadata(held | {NOTE: json.dumps(note).encode()}), path)


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
    assert told[1].startswith("  4 like this: energy residual")
    assert "warpchain.study.run.folder" in loaded.split() and not heavy.intersection(loaded.split())


def test_folders_without_such_notes_stand_the_same(folder):
    noted = study_status(folder)
    for path in (folder / "shards").glob("*.parquet"):
        without_ended(path)
    assert study_status(folder) == noted
    assert noted.counts["suspect"] == 4 and noted.reasons[0][1] == 4


@pytest.fixture
def path(tmp_path):
    """A table that notes how its rows ended."""
    write_table(tmp_path / "00000.parquet", TABLE, study="a", ended=True)
    return tmp_path / "00000.parquet"


def test_how_rows_ended_is_noted(path):
    assert Ended.of(TABLE) == ENDED == read_ended(path, "a", 4)


@pytest.mark.parametrize(
    ("study", "rows", "match"), [("b", 4, "is another table"), ("a", 5, "has 4 rows, its shard 5")]
)
def test_the_note_of_another_table_does_not_count(path, study, rows, match):
    with pytest.raises(StudyError, match=match):
        read_ended(path, study, rows)


def test_a_note_that_was_changed_does_not_count(path):
    """Then the table itself is read, here one that is whole."""
    data = path.read_bytes()
    assert data.count(b'"infeasible": 3') == 1
    path.write_bytes(data.replace(b'"infeasible": 3', b'"infeasible": 9'))
    assert read_ended(path, "a", 4) == ENDED


def test_a_file_that_is_no_table_is_told(path):
    for data in (b"", b"PAR1", b"\xff\xff\xff\x7fPAR1"):
        path.write_bytes(data)
        with pytest.raises(StudyError, match="00000"):
            read_ended(path, "a", 4)
    path.unlink()
    with pytest.raises(StudyError, match="cannot be read"):
        read_ended(path, "a", 4)
