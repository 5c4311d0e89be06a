"""Studies as a first user meets them: all mistakes at once, bars and lines, the worst variant first."""

import io
import sys

from command import run
from drives import two_sprockets
from pyarrow import csv, parquet
from study_helpers import write_study

from warpchain import Record, progress, simulate
from warpchain.study.results import read_results
from warpchain.study.run import run_study
from warpchain.study.run.recordings import recorded_variants
from warpchain.study.spec.study_tables import Worst


def test_all_mistakes_of_a_study_file_are_told_at_once(tmp_path, capsys):
    """Of the file alone, of what the drive lacks, and of metrics that there are not."""
    more = '[[factors]]\nname = "y"\npath = "sprockets.s9.teeth"\nlevels = [1, 2]\n[metrics]\nkeep = ["tensoin"]\n'
    source = write_study(tmp_path, more)
    source.write_text(source.read_text().replace("step = 1e-5", 'step = "fast"'))
    status, _, err = run(capsys, "study", "run", source, "-o", tmp_path / "out")
    assert status == 2 and len(err) == 3
    for line, words in zip(err, ("run.step", "factors.y.path", "metrics.keep.0"), strict=True):
        assert words in line
    assert not (tmp_path / "out").exists()
    lost = '[[objectives]]\nmetric = "tension_mx"\n'  # and a factor that is wrong in its place and in its values
    text = source.read_text().replace("levels = [1, 2]", "levels = [1, 1]")
    source.write_text(text.replace("[limits]\nenergy_residual = inf", lost))
    status, _, err = run(capsys, "study", "run", source, "-o", tmp_path / "out")
    assert status == 2 and len(err) == 5
    for words in ("run.step", "factors.y.levels", "factors.y.path", "metrics.keep.0", "objectives.0.metric"):
        assert any(words in line for line in err)


def test_where_there_is_no_terminal_progress_is_a_line_every_so_often(monkeypatch):
    clock, said = [0.0], io.StringIO()
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(sys, "stderr", said)
    with progress.bar(200.0, "study", " variants", 100.0) as bar:
        for clock[0] in (4.0, 9.9, 10.0, 19.0, 25.0):
            bar.update(10.0)
    assert said.getvalue().splitlines() == [
        "study: 65 % of 200 variants, 0:00:10 gone, 0:00:23 left",
        "study: 75 % of 200 variants, 0:00:25 gone, 0:00:25 left",
    ]


def test_the_second_pass_has_a_bar_of_its_own_and_none_goes_beyond_its_end(tmp_path, monkeypatch):
    bars = []

    class Noted(progress.Lines):
        def __init__(self, total, name, unit, initial=0.0, **_):
            super().__init__(total, name, unit, initial)
            bars.append(self)

    monkeypatch.setattr("warpchain.study.run.runner.bar_of", Noted)
    source = write_study(tmp_path, '[record]\nworst = { metric = "tension_max", count = 2 }\n')
    run_study(source, tmp_path / "out", progress=True)
    assert [(bar.name, bar.total) for bar in bars] == [("study", 12.0), ("recording the worst", 2.0)]
    assert all(bar.n <= bar.total + 1e-9 for bar in bars)


def test_the_worst_recorded_variant_is_the_first_to_be_shown(tmp_path):
    source = write_study(tmp_path, '[record]\nevery = 3\nworst = { metric = "tension_max", count = 2 }\n')
    run_study(source, tmp_path / "out")
    results = read_results(tmp_path / "out" / "results.parquet")
    worst = Worst(metric="tension_max", count=2)
    shown = list(recorded_variants(results, tmp_path / "out", worst=worst))
    tension = results.values("tension_max")
    assert shown[0] == int(tension.argmax())
    assert list(tension[shown]) == sorted(tension[shown], reverse=True)
    assert list(recorded_variants(results, tmp_path / "out")) == sorted(shown) or len(shown) == 4


def test_an_archives_metrics_come_as_a_table_and_endings_are_held_to(tmp_path, capsys):
    archive = tmp_path / "a.mcap"
    found = simulate(two_sprockets(duration=0.002), archive=archive, record=Record(rate=2e4))
    for ending, read in ((".csv", csv.read_csv), (".parquet", parquet.read_table)):
        status, out, _ = run(capsys, "export", archive, "--metrics", "-o", tmp_path / f"m{ending}")
        assert (status, out) == (0, [str(tmp_path / f"m{ending}")])
        assert read(tmp_path / f"m{ending}")["tension_max"].to_pylist() == found.metrics["tension_max"].to_pylist()
    for words in (("-o", tmp_path / "x.xlsx"), ("--metrics", "-o", tmp_path / "x.npz")):
        status, _, err = run(capsys, "export", archive, *words)
        assert status == 2 and len(err) == 1 and ".csv" in err[0] and ".parquet" in err[0]
    assert not list(tmp_path.glob("x.*"))
