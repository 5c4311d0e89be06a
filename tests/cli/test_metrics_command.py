"""`warpchain metrics` lists what a run gives; a misspelt metric is answered with the one that was meant."""

import json

import pytest
from command import refused
from command import run as command
from drives import example
from study_helpers import write_study

from warpchain import simulate
from warpchain.errors import StudyError
from warpchain.results.metric_columns import column_of_metric, metric_table_names
from warpchain.study.results import read_results


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", ["car", "v6", "conveyor"])
def test_the_list_is_the_table_of_a_run(capsys, name):
    """Every column in its order, and no other, with the unit of the table's field. So short a run has no column of
    standard errors, drifts, the efficiency and ramps that it does not come to."""
    drive = example(name).with_values({"run.duration": 0.002, "run.settle": False})
    table = simulate(drive, window=(0.001, 0.002)).metrics
    status, out, err = command(capsys, "metrics", name, "--set", "run.settle=false", "--json")
    listed = json.loads("\n".join(out))
    assert (status, err) == (0, [])
    held, names = table.column_names, metric_table_names(drive)
    assert [row["name"] for row in listed] == names and [name for name in names if name in held] == held
    long = ("_se", "tension_drift", "tension_drift_p", "steady", "efficiency", "resolution")
    assert all(name.endswith(long) for name in names if name not in held)
    for row in (row for row in listed if row["name"] in held):
        assert row["unit"] == table.schema.field(row["name"]).metadata[b"unit"].decode()
        assert row["title"] == column_of_metric(row["name"]).title


def test_lines_for_a_terminal(capsys):
    status, out, _ = command(capsys, "metrics", "motorcycle")
    assert status == 0 and len(out) == len(metric_table_names(example("motorcycle")))
    (line,) = [line for line in out if line.startswith("wheel.speed_mean ")]
    assert line.split(maxsplit=2) == ["wheel.speed_mean", "rad/s", "mean angular velocity"]


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (
            '[metrics]\nkeep = ["tension_mx"]',
            'value 1 of metrics.keep = "tension_mx": no such metric; did you mean tension_max?',
        ),
        (
            '[record]\nworst = { metric = "tenson_max", count = 1 }',
            'record.worst.metric = "tenson_max": no such metric; did you mean tension_max?',
        ),
        (
            '[[objectives]]\nmetric = "tension_sdt"',
            'objective 1: metric = "tension_sdt": no such metric; did you mean tension_std?',
        ),
        ('[[limits]]\nmetric = "slck"\nmax = 1', 'limit 1: metric = "slck": no such metric; did you mean slack?'),
    ],
)
def test_a_misspelt_metric_of_a_study_is_answered(capsys, tmp_path, more, line):
    study = write_study(tmp_path / "s", f"\n{more}\n")
    study.write_text(study.read_text().replace("\n[limits]\n", "\n[[limits]]\n"))
    assert line in refused(capsys, "study", "plan", study, "--stored")


def test_a_misspelt_column_of_a_table_is_answered(capsys, tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("a,tension_max,status\n1.0,2.0,ok\n2.0,3.0,ok\n3.0,1.0,ok\n")
    with pytest.raises(StudyError, match=r"^metrics: 'tension_mux' is not in the table; did you mean tension_max\?$"):
        read_results(path, ["a"], ["tension_mux"])
    with pytest.raises(StudyError, match=r"^column 'tension_mux': not in the table; did you mean tension_max\?$"):
        read_results(path, ["a"]).values("tension_mux")
    page = ["study", "report", path, "-o", tmp_path / "page.html", "--factor", "a"]
    assert "did you mean tension_max?" in refused(capsys, *page, "--minimize", "tension_mux")
    # nothing near: what there is
    assert "allowed are a, tension_max, status" in refused(capsys, *page, "--metric", "zzz")
