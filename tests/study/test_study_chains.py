"""Studies of drives with several chains."""

import chains
import pytest
from parts import part

from warpchain import Limits, Record, assemble, run_study, simulate
from warpchain.drive import load_drive, save_drive
from warpchain.drive.rings import rings_of
from warpchain.errors import StudyError
from warpchain.study.report.scatters import view_study
from warpchain.study.results import read_results
from warpchain.study.run.recordings import recorded_variants, with_recorded_objectives
from warpchain.study.run.row_drives import adjusted_all, placed
from warpchain.study.spec import load_study

RUN = """
[limits]
energy_residual = inf
energy_change = inf
[record]
variants = [0]
[run]
device = "cpu"
duration = {}
"""
FACTORIAL = '[study]\ndrive = "two.toml"\n[design]\nkind = "factorial"\n'
STUDY = (
    FACTORIAL
    + part("factors", "torque", path="sprockets.out.load.torque", levels=[100.0, 300.0])
    + part("factors", "teeth", path="sprockets.out.teeth", levels=[36, 60])
)


def studied(drive, study, folder):
    """A drive as its file has it, and the table of a study of it."""
    save_drive(drive, folder / "two.toml")
    (folder / "study.toml").write_text(study + RUN.format(0.005))
    return load_drive(folder / "two.toml"), run_study(folder / "study.toml", folder / "out", workers=1).table


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_a_study_has_the_metrics_of_each_chain(tmp_path):
    """As of `simulate`; a row whose second chain does not fit says why."""
    drive, table = studied(chains.two_stages(), STUDY, tmp_path)
    rows = read_results(table).table.to_pylist()
    drive = drive.with_values({"sprockets.out.load.torque": 100.0})
    alone = simulate(drive, device="cpu", duration=0.005, record=Record(variants="none"), limits=Limits())
    wanted = alone.metrics.to_pylist()[0]
    for name in ("first.tension_max", "second.mid out->out.tension_mean", "out.speed_mean", "energy_residual"):
        assert rows[0][name] == wanted[name], name
    judged = with_recorded_objectives(read_results(table), tmp_path / "out").table.to_pylist()
    assert judged[0]["out.transmission_error_rms"] is not None
    assert [row["status"] for row in rows] == ["ok", "infeasible", "ok", "infeasible"], [row["reason"] for row in rows]
    assert rows[1]["reason"].startswith('chain "second": ')


GEARED = (
    FACTORIAL
    + part("factors", "stiffness", path="chains.second.stiffness", levels=[4e7, 5e7])
    + part("factors", "twist", path="couplings.joint.stiffness", levels=[2e4, 4e4])
)


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_factors_of_one_of_geared_chains_and_of_a_coupling(tmp_path):
    """As of `simulate`, of which gears and couplings are metrics."""
    drive, table = studied(chains.geared_stages(), GEARED, tmp_path)
    rows = read_results(table).table.to_pylist()
    pairs = [(k, c) for k in (4e7, 5e7) for c in (2e4, 4e4)]
    assert [(row["stiffness"], row["twist"]) for row in rows] == pairs
    drives = [drive.with_values({"chains.second.stiffness": k, "couplings.joint.stiffness": c}) for k, c in pairs]
    alone = simulate(drives, device="cpu", duration=0.005, record=Record(variants="none")).metrics.to_pylist()
    for name in ("second.tension_max", "joint.torque_mean", "pair.tooth_force_max", "pump.speed_mean"):
        assert [row[name] for row in rows] == [row[name] for row in alone], name
    assert len({row["joint.torque_mean"] for row in rows}) == 4


ADJUSTED = FACTORIAL + part("factors", "teeth", path="sprockets.out.teeth", levels=[34, 36, 40])
ADJUSTED += '[adjust]\nsprocket = "out"\ndirection = [1.0, 0.0]\nlinks = "even"\npreload = 4000.0\n'


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_a_chain_is_adjusted_and_its_variants_play(tmp_path):
    """Each row's second chain has the wanted preload, with links for its teeth; the first stays as it is."""
    save_drive(chains.two_stages(), tmp_path / "two.toml")
    (tmp_path / "study.toml").write_text(ADJUSTED + RUN.format(0.002))
    study = load_study(tmp_path / "study.toml")
    base = load_drive(tmp_path / "two.toml")
    outcome = run_study(tmp_path / "study.toml", tmp_path / "out", workers=1)
    rows = read_results(outcome.table).table.to_pylist()
    assert [row["status"] for row in rows] == ["ok", "ok", "ok"], [row["reason"] for row in rows]
    assert len({row["adjusted_links"] for row in rows}) == 3
    made = adjusted_all([placed(study, base, row) for row in rows], study.adjust, rows)
    for (drive, _), row in zip(made, rows, strict=True):
        first, second = rings_of(drive)
        assert first.drive.chain.links == base.chains[0].links
        assert second.drive.chain.links == row["adjusted_links"]
        strain = 4000.0 / (second.drive.chain.mean_stiffness * second.drive.chain.pitch)
        assert assemble(second.drive).strain == pytest.approx(strain, abs=1e-7)
    results = read_results(outcome.table)
    view_study(results, recorded_variants(results, tmp_path / "out", [0]), save=tmp_path / "study.rrd")
    assert (tmp_path / "study.rrd").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("adjust", "line"),
    [
        ('links = "even"', "adjust.chain: missing; must be a chain of the drive: first, second"),
        ('links = "even"\nchain = "third"', 'adjust.chain = "third": must be a chain of the drive: first, second'),
        ('sprocket = "out"\ndirection = [1.0, 0.0]\nchain = "first"',
         'adjust.chain = "first": must be that of the sprocket, "second"'),
    ],
)  # fmt: skip
def test_adjust_names_a_chain(adjust, line, tmp_path):
    save_drive(chains.two_stages(), tmp_path / "two.toml")
    head, tail = (ADJUSTED + RUN.format(0.002)).split("[adjust]")
    (tmp_path / "study.toml").write_text(f"{head}[adjust]\n{adjust}\npreload{tail.partition('preload')[2]}")
    with pytest.raises(StudyError) as caught:
        run_study(tmp_path / "study.toml", tmp_path / "out", workers=1)
    assert str(caught.value).endswith(line)
