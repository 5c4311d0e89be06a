"""Studies that grow in their folder end in the table that a new one of that size has, and lose nothing on the way."""

from contextlib import suppress

import numpy as np
import pytest
from command import run
from drives import of_long
from pyarrow import parquet
from stopping import Killed, killed_at_file_operation
from study_helpers import STUDY, rows_of, write_study

from warpchain.errors import StudyError
from warpchain.study.design.design_table import extended_latin_hypercube
from warpchain.study.run import run_study, study_status
from warpchain.study.run.runner import write_partial_table

SAMPLED = STUDY.replace('kind = "factorial"', 'kind = "KIND"\ncount = 4\nreplicates = 1')
SAMPLED = SAMPLED.replace("points = {points}\n", "")
RECORD = '[record]\nworst = { metric = "tension_max", count = 1 }\n'


def table_of(folder):
    return parquet.read_table(folder / "results.parquet").to_pylist()


def edit(source, *changes):
    text = source.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    source.write_text(text)


def begun(folder, more="", *changes, part=None, kind=None, **settings):
    """A study that was run in `folder`, sampled where a kind is named, its text changed: its file, and what it made."""
    text = SAMPLED.replace("KIND", kind) if kind else STUDY
    source, out = write_study(folder, more, text=text, **settings), folder / "out"
    edit(source, *changes)
    run_study(source, out, part=part)
    return source, out


MORE, TWICE = ("count = 4", "count = 8"), ("replicates = 1", "replicates = 2")


@pytest.mark.parametrize("kind", ["sobol", *of_long("halton")])
def test_more_points_and_more_replicates_give_the_table_of_a_new_study(tmp_path, kind):
    source, out = begun(tmp_path, RECORD, kind=kind, shard=3)
    before = {path: path.stat().st_mtime_ns for path in (out / "shards").glob("0*")}
    for changes in ([MORE], [TWICE]):
        edit(source, *changes)
        with pytest.raises(StudyError, match="or --grow where it is the same with more points"):
            run_study(source, out)
        run_study(source, out, grow=True)
        assert all(path.stat().st_mtime_ns == time for path, time in before.items())
    run_study(source, out)  # it is done, and known again
    run_study(source, tmp_path / "new")
    assert rows_of(out) == rows_of(tmp_path / "new")
    assert study_status(out).left == 0


def test_another_window_runs_all_again_and_the_old_table_stays_until_then(tmp_path):
    source, out = begun(tmp_path, points=2)
    old = table_of(out)
    edit(source, ("duration = 0.0005", "duration = 0.0008"))
    run_study(source, out, grow=True, part=(0, 2))
    assert table_of(out) == old
    run_study(source, out)
    run_study(source, tmp_path / "new")
    assert table_of(out) == table_of(tmp_path / "new") != old
    assert parquet.read_table(out / "results.before-1.parquet").to_pylist() == old
    assert study_status(out).went_on == (0, 4) and study_status(tmp_path / "new").went_on is None


STEADY = [("step = 1e-5", "step = 1e-5\nwindow = [0.0, 0.0032]\nkeep_states = true")]
STEADY += [("duration = 0.0005", "duration = 0.0032")]
LONGER = ("window = [0.0, 0.0032]", "window = [0.0, 0.0064]"), ("duration = 0.0032", "duration = 0.0064")


def test_a_longer_window_goes_on_from_where_runs_stood(tmp_path, capsys):
    """320 steps become 640: what is not recorded goes on, to the very table that a new study has; and once more."""
    source, out = begun(tmp_path, "[record]\nevery = 5\n", TWICE, *STEADY, kind="sobol", shard=3)
    first = table_of(out)
    assert len(list((out / "shards").glob("*.states.parquet"))) == 3
    edit(source, *LONGER)
    status, told, _ = run(capsys, "study", "run", source, "-o", out, "--grow", "--quiet")
    assert status == 0 and "of longer runs, 7 continued from the end of shorter ones, 1 started again" in told
    run_study(source, tmp_path / "new")
    assert rows_of(out) == rows_of(tmp_path / "new")
    assert rows_of(out, name="replicates") == rows_of(tmp_path / "new", name="replicates")
    assert parquet.read_table(out / "results.before-1.parquet").to_pylist() == first
    edit(source, ("window = [0.0, 0.0064]", "window = [0.0064, 0.0096]"), ("duration = 0.0064", "duration = 0.0096"))
    edit(source, ("keep_states = true", "keep_states = false"))
    run_study(source, out, grow=True)  # a later window takes the states without their sums
    assert study_status(out).went_on == (7, 1)
    run_study(source, tmp_path / "newest")
    assert rows_of(out) == rows_of(tmp_path / "newest")
    assert len(list((out / "shards").glob("*.states.parquet"))) == 9


def test_states_that_are_damaged_or_of_another_window_are_no_help(tmp_path):
    source, out = begun(tmp_path, "", *STEADY, kind="sobol", shard=2)
    (out / "shards" / "00001.states.parquet").write_bytes(b"no table")
    edit(source, *LONGER)
    run_study(source, out, grow=True)
    assert study_status(out).went_on == (2, 2)
    edit(source, ("window = [0.0, 0.0064]", "window = [0.0016, 0.0096]"), ("duration = 0.0064", "duration = 0.0096"))
    run_study(source, out, grow=True)  # another start, before where runs stood
    assert study_status(out).went_on == (0, 4)
    run_study(source, tmp_path / "new")
    assert table_of(out) == table_of(tmp_path / "new")


@pytest.mark.long
def test_killed_at_any_file_operation_it_grows_on_to_the_same_table(tmp_path, monkeypatch):
    source = write_study(tmp_path, shard=4, text=SAMPLED.replace("KIND", "sobol"))
    for operation in (1, 3, 5, 6, 8, 10):
        edit(source, *((new, old) for old, new in (MORE, TWICE) if new in source.read_text()))
        out = tmp_path / str(operation)
        run_study(source, out)
        edit(source, MORE, TWICE)
        with monkeypatch.context() as patch:
            left = killed_at_file_operation(patch)
            left[0] = operation
            with suppress(Killed):
                run_study(source, out, grow=True)
            assert left[0] <= 0
        run_study(source, out, grow=True)
        assert len(table_of(out)) == 8
    run_study(source, tmp_path / "new")
    for operation in (1, 3, 5, 6, 8, 10):
        assert table_of(tmp_path / str(operation)) == table_of(tmp_path / "new")


def test_a_latin_hypercube_grows_to_one(tmp_path):
    source, out = begun(tmp_path, kind="latin-hypercube", shard=4)
    before = rows_of(out)
    edit(source, ("count = 4", "count = 6"))
    with pytest.raises(StudyError, match="a Latin hypercube of 4 points grows to multiples of that"):
        run_study(source, out, grow=True)
    edit(source, ("count = 6", "count = 8"))
    run_study(source, out, grow=True)
    rows = table_of(out)
    assert rows_of(out)[:4] == before
    assert sorted(int(8 * row["torque"]) for row in rows) == list(range(8))  # uniform from 0 to 1: one a stratum
    points = extended_latin_hypercube(
        extended_latin_hypercube(np.array([[0.1, 0.9], [0.6, 0.3]]), 6, 0, "s"), 18, 0, "s"
    )
    assert [sorted((18 * column).astype(int)) for column in points.T] == [list(range(18))] * 2


def test_what_is_no_growth_is_refused(tmp_path):
    source, out = begun(tmp_path, kind="sobol")
    other_range = ("range = [0.0, 1.0]", "range = [0.0, 2.0]")
    for change in (("count = 4", "count = 2"), ("step = 1e-5", "step = 5e-6"), other_range):
        edit(source, change)
        with pytest.raises(StudyError, match="holds another study"):
            run_study(source, out, grow=True)
        edit(source, change[::-1])


def test_an_unfinished_study_has_a_table_and_a_report(tmp_path, capsys):
    _, out = begun(tmp_path, part=(0, 2), shard=3)
    assert parquet.read_table(write_partial_table(out))["variant"].to_pylist() == [0, 1, 2, 6, 7, 8]
    status, _, err = run(capsys, "study", "report", out, "-o", tmp_path / "r.html")
    assert (status, err) == (0, [])
    assert not (out / "results.parquet").exists()
