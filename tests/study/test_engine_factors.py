"""Whatever an engine is given is a factor: each alone changes what it must, at both precisions, with units."""

import csv

import pytest
from fired import fired
from study_helpers import write_study

from warpchain import Drive, dumps_drive, read_archive
from warpchain.drive.path_units import path_unit
from warpchain.study.results import read_results
from warpchain.study.run import run_study

CHANGED = {
    "intake valves.cam_torque_mean": {
        "valves.intake valves": ("mass", "number", "phase", "phases.1"),
        "valves.intake valves.profile": ("lift", "rise", "dwell", "fall"),
        "valves.intake valves.spring": ("stiffness",),
    },
    "intake valves.cam_force_min": {"valves.intake valves.spring": ("preload",)},
    "flywheel.speed_mean": {
        "shafts.flywheel": ("inertia", "initial_speed", "load.torque", "motor.table.factor", "motor.table.torque.5"),
    },
    "tensioner.relieved": {"tensioners.tensioner.relief": ("pressure", "diameter", "stiffness", "lift", "discharge")},
    "tensioner.vented": {"tensioners.tensioner.vent": ("diameter", "discharge")},
    "tensioner.leaked": {
        "tensioners.tensioner.plunger": ("diameter", "gap", "length"),
        "tensioners.tensioner.oil": ("viscosity_40", "viscosity_100"),
    },
    "tensioner.supplied": {"tensioners.tensioner.oil.supply_table": ("factor", "pressure.1")},
    "tensioner.filling_time": {"tensioners.tensioner.chamber": ("drained",)},
    "tension_mean": {"expansion": ("block", "wheels", "chain")},
}
"""Keys of the parts of `fired`, by the metric that they must change."""
UNITS = {
    "valve_torque": "N m", "valve_force": "N", "shaft_speed": "rad/s", "chamber_pressure": "Pa",
    "tensioner_extension": "m", "tensioner_force": "N",
}  # fmt: skip


def paths():
    """Metric and path of each factor, the temperature last."""
    for metric, parts in CHANGED.items():
        for part, keys in parts.items():
            yield from ((metric, f"{part}.{key}") for key in keys)
    yield "tension_mean", "temperature"


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_each_factor_alone_changes_what_it_must(tmp_path, precision):
    drive, pairs = fired(**{"valves.intake valves.profile.dwell": 4.0}), [*paths()]
    base = [drive.get_value(path) for _, path in pairs]
    rows = [base] * (len(base) + 1)
    for k, value in enumerate(base):
        rows[k + 1] = [*base[:k], value + 1 if isinstance(value, int) else 1.1 * value or 5.0, *base[k + 1 :]]
    names = [f"f{k}" for k in range(len(base))]
    factors = "".join(f'[[factors]]\nname = "{n}"\npath = "{p}"\n' for n, (_, p) in zip(names, pairs, strict=True))
    text = f'[study]\ndrive = "fired.toml"\n[design]\nkind = "table"\nfile = "rows.csv"\n{factors}'
    text += f'[run]\nduration = 0.004\nwindow = [0.0, 0.004]\nprecision = "{precision}"\n'
    study = write_study(tmp_path, text=text + "[record]\nvariants = [1]\nrate = 1e4\n")
    (tmp_path / "fired.toml").write_text(dumps_drive(drive))
    with open(tmp_path / "rows.csv", "w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
    run_study(study, tmp_path / "out")
    table = read_results(tmp_path / "out" / "results.parquet").table
    first, *others = table.to_pylist()
    assert first["status"] in ("ok", "suspect")
    for (metric, path), row in zip(pairs, others, strict=True):
        assert row["status"] in ("ok", "suspect"), (path, row["reason"])
        assert abs(row[metric] - first[metric]) > 1e-5 * abs(first[metric]), path
    units = [table.schema.field(name).metadata[b"unit"].decode() for name in names]
    assert units == [path_unit(Drive, path) for _, path in pairs]
    for metric, _ in pairs:
        assert table.schema.field(metric).metadata[b"unit"].decode() not in ("", "1"), metric
    (archive,) = (tmp_path / "out" / "shards").glob("*.mcap")
    held = read_archive(archive)[1]
    for name, unit in UNITS.items():
        assert held.to_arrow().field(name).metadata[b"unit"].decode() == unit
