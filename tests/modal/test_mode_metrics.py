"""Modes as metrics: a variant's, by the base drive's names."""

import pyarrow.parquet as pq
import pytest
from drives import of_long, two_sprockets

from warpchain.drive import dumps_drive
from warpchain.engine import process_pool
from warpchain.modal.campbell import base_drive_modes, mode_metrics
from warpchain.study.run import run_study


@pytest.fixture(scope="module")
def base():
    """Unlike strands, so that each mode is of one strand: a load of 100 N m stretches one of them."""
    return two_sprockets(links=58, span=19.03, stiffness=2e7, inertia=40.0, torque=100.0)


def test_a_sprocket_of_other_inertia_keeps_its_name(base):
    """The turning mode's frequency falls with the root of the inertia, but for the chain's, 1.5 of 40 kg m^2: 2 %."""
    wanted = base_drive_modes(base, 6)
    turning = next(name for name in wanted.names if name.startswith("driven "))
    light = mode_metrics(wanted, base)
    heavy = mode_metrics(wanted, base.with_values({"sprockets.driven.inertia": 160.0}))
    ratio = heavy[f"modes.{turning}.frequency"] / light[f"modes.{turning}.frequency"]
    assert ratio == pytest.approx(0.5, rel=0.03)
    strand = (
        f"modes.{wanted.names[0]}.frequency" if wanted.names[0] != turning else f"modes.{wanted.names[1]}.frequency"
    )
    assert heavy[strand] == pytest.approx(light[strand], rel=0.05)


@pytest.mark.long
def test_other_links_are_told_by_name(base):
    wanted = base_drive_modes(base, 3)
    longer = base.with_values({"chain.links": 60, "sprockets.driven.center": [20.03 * 0.05, 0.0]})
    assert set(mode_metrics(wanted, longer)) <= set(mode_metrics(wanted, base))


@pytest.mark.parametrize("workers", [1, *of_long(2)])
def test_a_study_follows_modes(base, tmp_path, workers, monkeypatch):
    monkeypatch.setattr(process_pool, "FEWEST_THINGS", 1)
    (tmp_path / "drive.toml").write_text(dumps_drive(base))
    (tmp_path / "study.toml").write_text(
        """
        [study]
        drive = "drive.toml"
        [design]
        kind = "factorial"
        [[factors]]
        name = "inertia"
        path = "sprockets.driven.inertia"
        levels = [40.0, 80.0]
        [metrics]
        keep = ["modes.*"]
        modes = 3
        [run]
        duration = 1e-4
        """
    )
    run_study(tmp_path / "study.toml", tmp_path / "out", workers=workers)
    table = pq.read_table(tmp_path / "out" / "results.parquet")
    names = [f"modes.{name}.frequency" for name in base_drive_modes(base, 3).names]
    assert set(names) <= set(table.column_names)
    assert table.schema.field(names[0]).metadata[b"unit"] == b"Hz"
    assert table.num_rows == 2
    assert all(value > 0.0 for name in names for value in table[name].to_pylist() if value is not None)
