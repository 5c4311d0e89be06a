"""The registry of metrics: it names all that `simulate` returns, and what a new metric takes."""

import json

import pytest
from drives import STARTING, example, two_sprockets
from grown import followed, run_in

from warpchain import Record, dumps_drive, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.examples import example_names
from warpchain.results.metric_columns import (
    ALL_METRICS,
    COLUMN_BY_NAME,
    RECORDED_METRICS,
    RUN_METRICS,
    column_of_metric,
    metric_names,
    title_of_metric,
    unit_of_metric,
)
from warpchain.results.objectives import add_objectives
from warpchain.results.window_statistics import ERROR_SUFFIX

USED = """
import json, sys
import numpy as np
from warpchain import Record, load_drive, simulate
from warpchain.results.metric_columns import metric_names, title_of_metric

drive = load_drive(sys.argv[1])
run = simulate(drive, duration=0.005, step=5e-6, device="cpu", record=Record(rate=2e5))
inside = run[0].time >= run.metrics["window_start"][0].as_py() - 1e-12
for s, sprocket in enumerate(drive.sprockets):
    name = f"{sprocket.name}.moment_max"
    assert name in metric_names(drive)
    assert title_of_metric(name) == f"{sprocket.name}: largest moment of the contact forces"
    assert run.metrics[name][0].as_py() == run[0].sprocket_moment[inside, s].max()
    assert run.metrics.schema.field(name).metadata == {b"unit": b"N m"}
print(json.dumps(run.metrics.to_pylist()[0]))
"""


def drives():
    """Every example that turns from the start, and a drive with a moving sprocket and one that does not settle."""
    shaken = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 40.0}
    moving = two_sprockets().with_values({"sprockets.driver.mount": shaken})
    turning = [example(name) for name in example_names() if name not in ("fork_lift", "hoist", "transfer_case")]
    return [*turning, moving, two_sprockets(settle="false")]


@pytest.mark.long
def test_the_recipe_of_a_metric(tmp_path):
    paths = ["warpchain/results/metric_columns.py", "kernels/structs.py", "kernels/sums.py"]
    drive = two_sprockets(settle="false")
    (tmp_path / "drive.toml").write_text(dumps_drive(drive))
    printed = run_in(followed(tmp_path, "A new metric", paths), USED, tmp_path / "drive.toml")
    theirs = json.loads(printed.splitlines()[-1])
    mine = simulate(drive, duration=0.005, step=5e-6, device="cpu", record=Record("none")).metrics.to_pylist()[0]
    others = {name: value for name, value in theirs.items() if not name.endswith(".moment_max")}
    assert others == mine


@pytest.mark.parametrize("drive", drives(), ids=lambda drive: f"{len(drive.sprockets)}-{drive.links}")
def test_the_registry_has_every_column(drive):
    whole = 700 * resolve_step(drive)  # enough steps for batches
    table = simulate(drive, duration=whole, window=(0.0, whole), device="cpu", record=Record("none")).metrics
    facts = [column.name for column in RUN_METRICS.columns]
    names = [name for name in metric_names(drive) if not name.endswith(ERROR_SUFFIX)]  # the window is short
    if table["status"][0].as_py() and "efficiency" not in table.column_names:  # where the driver is driven
        names.remove("efficiency")
    untouched = [name for name in table.column_names if name.endswith(".force_max") and table[name][0].as_py() == 0.0]
    names = [name for name in names if name.replace(".resolution", ".force_max") not in untouched or name in untouched]
    assert table.column_names == [*facts, *names]
    kinds = {float: "double", int: "int64", bool: "bool", str: "string"}
    for field in table.schema:
        column = column_of_metric(field.name)
        assert field.metadata == {b"unit": column.unit.encode()}
        assert str(field.type) == kinds[column.kind]
        assert title_of_metric(field.name).endswith(column.title)


def test_the_registry_has_what_recorded_variants_have():
    run = simulate(two_sprockets(duration=0.1), device="cpu", limits=STARTING)
    added = set(add_objectives(run).column_names) - set(run.metrics.column_names)
    assert added
    assert {name.split(".")[-1] for name in added} <= {c.name for group in RECORDED_METRICS for c in group.columns}


def test_one_name_has_one_unit_and_one_title():
    rows = [c for groups in (*ALL_METRICS, (RUN_METRICS,), RECORDED_METRICS) for group in groups for c in group.columns]
    assert all(COLUMN_BY_NAME[row.name] == row for row in rows)
    ends = {(row.name.rsplit(".", 1)[-1], row.unit, row.kind) for row in rows}
    assert len({name for name, *_ in ends}) == len(ends)


def test_words_for_a_column():
    assert title_of_metric("tension_max") == "largest link tension"
    assert title_of_metric("a->b.tension_max") == "a->b: largest link tension"
    assert title_of_metric("links.dissipated") == "energy dissipated in the links"
    assert title_of_metric("bar.dissipated") == "bar: energy dissipated in the contacts"
    assert (title_of_metric("price"), unit_of_metric("price"), column_of_metric("price")) == ("price", "1", None)
    assert unit_of_metric("bar.pv_max") == "W/m"
