"""Studies of drives with several chains."""

import chains
import pytest

from warpchain import Limits, Record, run_study, simulate
from warpchain.drive import load_drive, save_drive
from warpchain.study.results import read_results
from warpchain.study.run.recordings import with_recorded_objectives

STUDY = """
[study]
drive = "two.toml"
[design]
kind = "factorial"
[[factors]]
name = "torque"
path = "sprockets.out.load.torque"
levels = [100.0, 300.0]
[[factors]]
name = "teeth"
path = "sprockets.out.teeth"
levels = [36, 60]
[limits]
energy_residual = inf
energy_change = inf
[record]
variants = [0]
[run]
device = "cpu"
duration = 0.005
"""


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_a_study_has_the_metrics_of_each_chain(tmp_path):
    """As of `simulate`; a row whose second chain does not fit says why."""
    save_drive(chains.two_stages(), tmp_path / "two.toml")
    (tmp_path / "study.toml").write_text(STUDY)
    outcome = run_study(tmp_path / "study.toml", tmp_path / "out", workers=1)
    rows = read_results(outcome.table).table.to_pylist()
    drive = load_drive(tmp_path / "two.toml").with_values({"sprockets.out.load.torque": 100.0})
    alone = simulate(drive, device="cpu", duration=0.005, record=Record(variants="none"), limits=Limits())
    wanted = alone.metrics.to_pylist()[0]
    for name in ("first.tension_max", "second.mid out->out.tension_mean", "out.speed_mean", "energy_residual"):
        assert rows[0][name] == wanted[name], name
    judged = with_recorded_objectives(read_results(outcome.table), tmp_path / "out").table.to_pylist()
    assert judged[0]["out.transmission_error_rms"] is not None
    assert [row["status"] for row in rows] == ["ok", "infeasible", "ok", "infeasible"], [row["reason"] for row in rows]
    assert rows[1]["reason"].startswith('chain "second": ')
