"""Studies put together: each row once, nothing lost or run again, what they were made of left as it was."""

import hashlib
from pathlib import Path

import pytest
from command import refused, run
from pyarrow import parquet
from study_helpers import STUDY, rows_of, write_study

import warpchain
from warpchain.archive import read_archive
from warpchain.errors import StudyError
from warpchain.study.analysis import pure_error
from warpchain.study.results import read_results
from warpchain.study.run import join_studies, run_study, study_status
from warpchain.study.run.recordings import recording_of_variant
from warpchain.study.spec import load_study

SOBOL = STUDY.replace('kind = "factorial"', 'kind = "sobol"\ncount = {points}\nseed = 1').replace(
    "points = {points}\n", ""
)
RECORD = '[record]\nevery = 3\nworst = {{ metric = "tension_max", count = 2 }}\n'


def studied(folder, *changes, part=None, **values):
    """A study that was run in `folder`, or a part of it, its text and its drive changed: its file, and what it made."""
    text = SOBOL + RECORD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    source = write_study(folder, "", points=8, shard=3, text=text)
    drive = warpchain.load_drive(folder / "tiny.toml").with_values({k.replace("__", "."): v for k, v in values.items()})
    (folder / "tiny.toml").write_text(warpchain.dumps_drive(drive))
    run_study(source, folder / "out", part=part)
    return source, folder / "out"


def content(folder):
    files = [path for path in Path(folder).rglob("*") if path.is_file()]
    return {path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


SEED = ("seed = 1", "seed = 2")
MORE = ("count = {points}", "count = 12")


def test_two_designs_become_one_and_stay_as_they_were(tmp_path):
    _, a = studied(tmp_path / "a")
    _, b = studied(tmp_path / "b", SEED)
    before = content(a), content(b)
    joined = join_studies([a, b], tmp_path / "c")
    assert (content(a), content(b)) == before
    assert joined.rows == (8, 8) and joined.together == 16 and not joined.outcome.left
    table, first, second = rows_of(tmp_path / "c", "variant"), rows_of(a, "variant"), rows_of(b, "variant")
    assert table == first + second
    mapping = parquet.read_table(joined.mapping).to_pylist()
    assert [m["variant"] for m in mapping] == list(range(16)) and mapping[8]["before"] == 0
    assert {m["folder"] for m in mapping} == {str(a), str(b)}
    run_study(tmp_path / "c" / "study.toml", tmp_path / "c")  # it is done, and known again
    assert rows_of(tmp_path / "c", "variant") == table
    results = read_results(tmp_path / "c" / "results.parquet")
    assert results.factors == ("torque", "links")
    assert results.table["variant"].to_pylist() == list(range(16))


def test_recordings_come_along_under_the_new_numbers(tmp_path):
    """Every third row of each, and the worst of each: no run of theirs is lost, and none is run again."""
    folders = [studied(tmp_path / name, *changes)[1] for name, changes in (("a", ()), ("b", (SEED,)))]
    join_studies(folders, tmp_path / "c")
    table = parquet.read_table(tmp_path / "c" / "results.parquet").to_pylist()
    parts = [parquet.read_table(folder / "results.parquet").to_pylist() for folder in folders]
    recorded = 0
    for row, (f, old) in zip(table, [(f, row) for f, part in enumerate(parts) for row in part], strict=True):
        assert (row["archive"] is None) == (old["archive"] is None)
        if row["archive"] is not None:
            recorded += 1
            assert row["archive_variant"] == row["variant"]
            new = read_archive(tmp_path / "c" / row["archive"])[row["variant"]]
            kept = read_archive(folders[f] / old["archive"])[old["archive_variant"]]
            assert new.drive == kept.drive and (new.position == kept.position).all()
    assert recorded >= 6
    last = max(row["variant"] for row in table if row["archive"])
    assert recording_of_variant(tmp_path / "c", last)[1] == last
    missing = next(row["variant"] for row in table if not row["archive"])
    again = recording_of_variant(tmp_path / "c", missing)
    again.run_again()
    assert recording_of_variant(tmp_path / "c", missing) == (again.archive, missing)
    assert read_archive(again.archive)[missing].drive.chain.links == table[missing]["links"]


def test_rows_that_both_have_are_taken_once(tmp_path):
    """A Sobol' sequence of 12 begins with the 8 of one of 8 points (SciPy scrambles it by the seed alone)."""
    with pytest.warns(UserWarning, match="balanced"):
        _, b = studied(tmp_path / "b", MORE)
    _, a = studied(tmp_path / "a")
    joined = join_studies([a, b], tmp_path / "c")
    assert joined.rows == (8, 12) and joined.together == 12
    assert rows_of(tmp_path / "c") == rows_of(b)


def test_what_is_unfinished_is_gone_on_with(tmp_path):
    """Of two halves of one study, run apart: shards 0, 2 and 1; nothing is left to run. Of one half alone, the rest."""
    source, a = studied(tmp_path / "a", part=(0, 2))
    other, b = studied(tmp_path / "b", SEED, part=(1, 2))
    joined = join_studies([a, b], tmp_path / "c")
    assert joined.together == 16 and joined.outcome.left == 3 + 5 and joined.outcome.table is None
    stamps = {p: p.stat().st_mtime_ns for p in (tmp_path / "c" / "shards").iterdir()}
    run_study(tmp_path / "c" / "study.toml", tmp_path / "c")
    assert study_status(tmp_path / "c").left == 0
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())
    run_study(source, a)
    run_study(other, b)
    assert rows_of(tmp_path / "c", "variant") == rows_of(a, "variant") + rows_of(b, "variant")
    _, whole = studied(tmp_path / "d", part=(1, 2))
    assert not join_studies([a, whole], tmp_path / "e").outcome.left  # a has what the other lacks
    assert rows_of(tmp_path / "e") == rows_of(a)


@pytest.mark.long
def test_copies_of_both_are_kept(tmp_path):
    _, a = studied(tmp_path / "a", ("seed = 1", "seed = 1\nreplicates = 2"))
    _, b = studied(tmp_path / "b", ("seed = 1", "seed = 2\nreplicates = 2"))
    join_studies([a, b], tmp_path / "c")
    aside = ("variant", "reason")
    assert rows_of(tmp_path / "c", *aside) == [row for folder in (a, b) for row in rows_of(folder, *aside)]
    copies = parquet.read_table(tmp_path / "c" / "replicates.parquet")
    assert copies.num_rows == 32 and copies["replicate"].to_pylist() == [0, 1] * 16
    _, one = studied(tmp_path / "one")
    joined = join_studies([one, b], tmp_path / "d")  # rows of `one` lack their second copy
    assert joined.outcome.left == 8


def test_drives_that_begin_elsewhere_give_replicates(tmp_path):
    """Equal rows of drives turned on by part of a tooth: runs of one design, told apart by a hidden factor."""
    _, a = studied(tmp_path / "a")
    _, b = studied(tmp_path / "b", run__phase=0.5)
    join_studies([a, b], tmp_path / "c")
    results = read_results(tmp_path / "c" / "results.parquet")
    assert results.factors == ("torque", "links") and results.table["phase"].to_pylist() == [0.0] * 8 + [0.5] * 8
    assert rows_of(tmp_path / "c", "variant", "phase") == rows_of(a, "variant") + rows_of(b, "variant")
    assert pure_error(results, "tension_max").freedom == int((results.ok[:8] & results.ok[8:]).sum())
    assert recording_of_variant(tmp_path / "c", 9).drive.run.phase == 0.5


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (("duration = 0.0005", "duration = 0.001"), "run.duration = 0.001, but 0.0005 in"),
        (("step = 1e-5", 'step = 1e-5\nprecision = "float32"'), 'run.precision = "float32", but "float64" in'),
        (("step = 1e-5", "step = 1e-5\nwindow = [0.0, 0.0005]"), "run.window = "),
        (("energy_residual = inf", "energy_residual = 0.5"), "limits.energy_residual = 0.5"),
        (('path = "chain.links"', 'path = "chain.links"\nunit = "1"'), 'factors.links.unit = "1", but nothing in'),
        (("range = [0.0, 1.0]", 'mean = 0.5\nstd = 0.1\ndistribution = "normal"'), "factors.torque: not distributed"),
    ],
)
def test_studies_that_run_otherwise_are_refused(tmp_path, change, line):
    _, a = studied(tmp_path / "a")
    _, b = studied(tmp_path / "b", SEED, change)
    with pytest.raises(StudyError) as caught:
        join_studies([a, b], tmp_path / "c")
    assert str(caught.value).startswith(f"{b}: ") and line in str(caught.value)
    assert not (tmp_path / "c").exists() and not list(tmp_path.glob(".c*"))


def test_another_drive_is_refused(tmp_path):
    _, a = studied(tmp_path / "a")
    _, b = studied(tmp_path / "b", sprockets__s1__inertia=9.0)
    with pytest.raises(StudyError, match=r"b/out: drive\.sprockets\.s1\.inertia = 9\.0, but .* in .*a/out; only"):
        join_studies([a, b], tmp_path / "c")


def test_a_wider_and_a_narrower_range_are_put_together(tmp_path):
    _, a = studied(tmp_path / "a")
    changes = (("range = [0.0, 1.0]", "range = [0.5, 2.0]"), ("levels = [44, 45]", "levels = [43, 44]"))
    _, b = studied(tmp_path / "b", *changes)
    join_studies([a, b], tmp_path / "c")
    torque, links = load_study(tmp_path / "c" / "study.toml").factors
    assert torque.range == (0.0, 2.0) and links.levels == (43, 44, 45)


def test_on_the_command_line_and_what_follows(tmp_path, capsys):
    goals = '[[objectives]]\nmetric = "tension_max"\n[optimize]\ncount = 20\nbatch = 4\n'
    text = (SOBOL + goals).replace("[limits]\nenergy_residual = inf", "[[limits]]\nenergy_residual = inf")
    for name, seed in (("a", 1), ("b", 2)):
        source = write_study(tmp_path / name, "", points=8, shard=8, text=text.replace("seed = 1", f"seed = {seed}"))
        run_study(source, tmp_path / name / "out")
    a, b, c = tmp_path / "a" / "out", tmp_path / "b" / "out", tmp_path / "c"
    status, said, _ = run(capsys, "study", "merge", a, b, "-o", c)
    assert status == 0
    assert said[0] == f"8 + 8 rows, 16 of them different; which became which: {c / 'merged.parquet'}"
    for wrong in ((a, b), (a, "-o", c)):
        assert "several and -o" in refused(capsys, "study", "merge", *wrong)
    assert "is there already" in refused(capsys, "study", "merge", a, b, "-o", c)
    assert run(capsys, "study", "report", c, "-o", tmp_path / "report.html")[0] == 0
    assert (tmp_path / "report.html").stat().st_size > 10_000
    bench = warpchain.open_study(c / "study.toml", c)
    mean, _ = bench.surrogate("tension_max").predict(bench.design_rows()[:2])
    assert mean.shape == (2,)
    bench.observe(bench.results().table)
    assert len(bench.ask(3)) == 3
    status, said, told = run(capsys, "optimize", c / "study.toml", "-o", tmp_path / "search", "--known", c)
    assert status == 0, told
    assert said[0].startswith("20 variants in 2 rounds")
    assert not (tmp_path / "search" / "rounds" / "0000" / "plan.json").exists()  # all of them were known
    (tmp_path / "a" / "tiny.toml").write_text((tmp_path / "a" / "tiny.toml").read_text().replace("0.2", "0.201"))
    status, _, told = run(capsys, "optimize", tmp_path / "a" / "study.toml", "-o", tmp_path / "other", "--known", c)
    assert status == 2 and told[0].endswith(f"{c}: another drive than {tmp_path / 'a' / 'study.toml'} has")


@pytest.mark.long
def test_states_come_along_and_a_longer_window_goes_on_from_them(tmp_path):
    """Windows of 320 steps become 640; `b` has none of its states kept."""
    changes = [("duration = 0.0005", "duration = 0.0032"), ("step = 1e-5", "step = 1e-5\nwindow = [0.0, 0.0032]")]
    kept = ("shard = {shard}", "shard = {shard}\nkeep_states = true")
    plain = (RECORD, "")
    _, a = studied(tmp_path / "a", *changes, kept, plain)
    _, b = studied(tmp_path / "b", SEED, *changes, plain)
    c = tmp_path / "c"
    join_studies([a, b], c)
    longer = tmp_path / "longer"
    longer.mkdir()
    for name in ("study.toml", "drive.toml", "rows.parquet"):
        (longer / name).write_bytes((c / name).read_bytes())
    text = (longer / "study.toml").read_text()
    assert "duration = 0.0032" in text and "window = [0.0, 0.0032]" in text
    (longer / "study.toml").write_text(text.replace("0.0032", "0.0064"))
    run_study(longer / "study.toml", c, grow=True)
    assert study_status(c).went_on == (8, 8)
    run_study(longer / "study.toml", tmp_path / "new")
    assert rows_of(c) == rows_of(tmp_path / "new")


def test_a_foreign_folder_leads_nowhere_else(capsys, tmp_path):
    """Neither its links, when it is written to, nor its names of archives, when they are read."""
    _, folder = studied(tmp_path / "a")
    mine, results = tmp_path / "mine", folder / "results.parquet"
    mine.write_text("kept")
    results.rename(folder / "whole")
    results.symlink_to(mine)
    assert "results.parquet: is a symbolic link" in refused(capsys, "study", "merge", folder)
    assert mine.read_text() == "kept"
    table = parquet.read_table(folder / "whole")
    outside = [None if name is None else f"../../{name}" for name in table["archive"].to_pylist()]
    k = table.column_names.index("archive")
    results.unlink()
    parquet.write_table(table.set_column(k, "archive", [outside]).replace_schema_metadata(None), results)
    assert "is no file in the study's folder" in refused(capsys, "study", "report", folder, "-o", tmp_path / "a.html")
