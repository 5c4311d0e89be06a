"""A study in Rerun: its scatters and recorded variants are in the recording, and the viewer shows them."""

import numpy as np
import pyarrow as pa
import pytest
from command import refused
from command import run as command
from drives import two_sprockets
from loading import load_script
from PIL import Image

from warpchain import Record, simulate, write_archive
from warpchain.errors import StudyError
from warpchain.results.fatigue import Woehler
from warpchain.results.objectives import trajectory_objectives
from warpchain.study.report.rerun_scatters import log_study_scatters, view_study
from warpchain.study.results import export_table, read_results
from warpchain.study.run.recordings import recorded_trajectories, results_with_objectives

render = load_script("drawings.pictures")

TORQUES = (100.0, 200.0, 300.0, 400.0, 500.0)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Five torques, the second and the fourth recorded in an archive; results and folder."""
    drives = [two_sprockets(duration=0.05, torque=torque) for torque in TORQUES]
    folder = tmp_path_factory.mktemp("study")
    run = simulate(drives, record=Record(variants=[1, 3], rate=4000.0))
    write_archive(run, folder / "shard-0.mcap")
    columns = {
        "torque": pa.array(TORQUES),
        "law": pa.array(["a", "b", "a", "b", "a"]),
        "status": pa.array(["ok", "ok", "ok", "ok", "diverged"]),
        "archive": pa.array([None, "shard-0.mcap", None, "shard-0.mcap", None]),
        "archive_variant": pa.array([None, 1, None, 3, None], pa.int64()),
    }
    table = run.metrics.drop_columns(["status", "reason"])
    for name, values in columns.items():
        table = table.append_column(name, values)
    return read_results(table, ["torque", "law"]), folder


class Stream:
    """Takes what would go to a recording."""

    def __init__(self):
        self.dots = {}

    def log(self, path, *what, static):
        assert static
        if path.rsplit("/", 1)[-1].replace("\\ ", " ") in ("variants", "Pareto front", "best", "recorded variants"):
            self.dots[path] = [str(label) for label in what[0].labels.as_arrow_array().to_pylist()]


def test_scatters_hold_every_variant_that_is_ok(study):
    results, _ = study
    stream = Stream()
    metrics, objectives = ("tension_max", "tension_mean"), {"tension_max": "min", "torque": "max"}
    charts, columns = log_study_scatters(stream, results, [3], metrics=metrics, objectives=objectives)
    assert columns == 2
    assert [chart.path for chart in charts] == [("study", "torque", f"{metric} [N]") for metric in metrics]
    of_max = {p.rsplit("/", 1)[-1].replace("\\ ", " "): words for p, words in stream.dots.items() if "max" in p}
    drawn = sorted(word.split(":")[0] for words in of_max.values() for word in words)
    assert drawn == [f"variant {v}" for v in range(4)]  # each once; the fifth diverged
    assert len(of_max["recorded variants"]) == 1
    assert of_max["recorded variants"][0].startswith("variant 3: torque = 400, tension_max = ")
    assert any(word.startswith("variant 0:") for word in of_max["Pareto front"])  # the lowest tension


def test_objectives_have_panels_whatever_else_is_shown(study):
    results, _ = study
    stream = Stream()
    shown = {"metrics": ("tension_max",), "objectives": {"driven.force_max": "min"}}
    charts, _ = log_study_scatters(stream, results, [], **shown)
    assert [chart.path[-1].split(" ")[0] for chart in charts] == ["driven.force_max", "tension_max"]
    best = [words for path, words in stream.dots.items() if path.endswith("/best")]
    least = int(np.argmin(np.where(results.ok, results.values("driven.force_max"), np.inf)))
    assert [word.split(":")[0] for words in best for word in words] == [f"variant {least}"] * 2
    noise = pa.field("torque", pa.float64(), metadata={"role": "factor", "kind": "noise"})
    table = results.table.set_column(results.table.column_names.index("torque"), noise, results.table["torque"])
    stream = Stream()
    log_study_scatters(stream, read_results(table, ["torque", "law"]), [], **shown)
    assert not any(words for path, words in stream.dots.items() if path.endswith("/best"))  # it has the luckiest noise


def test_recorded_variants_come_from_the_archives(study):
    results, folder = study
    found = recorded_trajectories(results, folder)
    assert list(found) == [1, 3]
    assert found[3].drive.sprockets[1].load.torque == 400.0
    assert list(recorded_trajectories(results, folder, [3])) == [3]
    with pytest.raises(StudyError, match=r"variant 2 was not recorded \(recorded: 1, 3\)"):
        recorded_trajectories(results, folder, [2])
    bare = read_results(results.table.drop_columns(["archive"]), ["torque"])
    with pytest.raises(StudyError, match="recorded no variant"):
        recorded_trajectories(bare, folder)


def test_objectives_of_recorded_variants_join_the_table(study, tmp_path, capsys):
    results, folder = study
    curve = Woehler(5.0, 1e4, 1e6)
    more = results_with_objectives(results, folder, curve)
    column = more.table["damage_per_hour_max"].to_pylist()
    assert [value is not None for value in column] == [False, True, False, True, False]
    window = (more.values("window_start")[3], more.values("window_end")[3])
    (trajectory,) = recorded_trajectories(results, folder, [3]).values()
    assert column[3] == trajectory_objectives(trajectory, *window, curve)["damage_per_hour_max"]
    assert "driven.transmission_error_rms" in more.metrics
    assert more.column_unit("damage_per_hour_max") == "1/h"
    export_table(results.table, folder / "results.parquet")
    table = tmp_path / "t.parquet"
    words = ["study", "report", folder, "-o", tmp_path / "r.html", "--factor", "torque", "--fatigue"]
    assert command(capsys, *words, "5,1e4,1e6", "--metric", "tension_max", "--table", table)[0] == 0
    assert read_results(table, ["torque"]).table["damage_per_hour_max"].to_pylist() == column
    for wrong, told in (("5", "must be three numbers"), ("0,1e4,1e6", "fatigue.exponent")):
        assert told in refused(capsys, *words, wrong)


def test_recording_is_whole_and_alone(study, tmp_path):
    results, folder = study
    view_study(results, recorded_trajectories(results, folder, [1]), save=tmp_path / "s.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["s.rrd"]
    assert (tmp_path / "s.rrd").stat().st_size > 100_000
    with pytest.raises(StudyError, match="cannot be written"):
        view_study(results, save=tmp_path / "absent" / "s.rrd")
    with pytest.raises(StudyError, match="nothing to draw"):
        view_study(read_results(results.table, ["law"]), save=tmp_path / "t.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["s.rrd"]


STUDY = """
[study]
drive = "marine"
[design]
kind = "sobol"
count = 5
[[factors]]
name = "torque"
path = "sprockets.camshaft.load.torque"
range = [100.0, 500.0]
[[objectives]]
metric = "driven.force_max"
"""


def test_objectives_of_the_study_file_are_drawn(study, tmp_path, capsys, monkeypatch):
    results, _ = study
    export_table(results.table.drop_columns(["archive"]), tmp_path / "results.parquet")
    (tmp_path / "study.toml").write_text(STUDY)
    drawn = []
    monkeypatch.setattr("warpchain.study.report.rerun_scatters.view_study", lambda *args: drawn.append(args[-2]))
    words = ["study", "view", tmp_path, "--save", tmp_path / "s.rrd", "--factor", "torque"]
    assert command(capsys, *words)[0] == 0
    assert command(capsys, *words, "--maximize", "tension_mean")[0] == 0
    assert drawn == [{"driven.force_max": "min"}, {"tension_mean": "max"}]


def test_command_saves_a_recording(study, tmp_path, capsys):
    results, folder = study
    export_table(results.table, folder / "results.parquet")
    words = ["study", "view", folder, "--save", tmp_path / "s.rrd", "--factor", "torque", "--variant"]
    assert command(capsys, *words, "3")[0] == 0
    assert (tmp_path / "s.rrd").stat().st_size > 100_000
    assert "variant 2 was not recorded" in refused(capsys, *words, "2")


@pytest.mark.viewer
@pytest.mark.skipif(render.missing_vulkan_reason() is not None, reason=str(render.missing_vulkan_reason()))
def test_the_viewer_shows_scatters_beside_a_variant(study, tmp_path):
    results, folder = study
    view_study(results, recorded_trajectories(results, folder), save=tmp_path / "s.rrd")
    render.save_screenshot(tmp_path / "s.rrd", tmp_path / "s.png", 0.02)
    pixels = np.asarray(Image.open(tmp_path / "s.png").convert("RGB")).astype(int)[60:-60]
    left, right = np.split(pixels, [int(0.6 * pixels.shape[1])], axis=1)
    assert (np.abs(left - (240, 90, 60)).max(axis=2) < 30).sum() > 200  # dots of recorded variants
    rows, columns = np.nonzero(np.ptp(right[: int(0.7 * len(right))], axis=2) > 60)  # the colored chain
    assert len(rows) > 500
    assert np.ptp(columns) > 0.5 * right.shape[1]
