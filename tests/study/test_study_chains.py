"""Studies of drives with several chains."""

import math

import chains
import pytest
from command import refused, run
from parts import part

from warpchain import Limits, Record, run_study, simulate
from warpchain.assembly.assembly import assemble_chain
from warpchain.drive import load_drive, save_drive
from warpchain.errors import StudyError
from warpchain.model import Model
from warpchain.study.optimize import open_study
from warpchain.study.report.rerun_scatters import view_study
from warpchain.study.results import export_table, read_results
from warpchain.study.run import join_studies
from warpchain.study.run.recordings import recorded_trajectories, results_with_objectives
from warpchain.study.run.row_drives import adjusted_drives, drive_of_row
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
    judged = results_with_objectives(read_results(table), tmp_path / "out").table.to_pylist()
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
    made = adjusted_drives([drive_of_row(study, base, row) for row in rows], study.adjust, rows)
    for (drive, _), row in zip(made, rows, strict=True):
        first, second = Model(drive).chains
        assert first.chain.links == base.chains[0].links
        assert second.chain.links == row["adjusted_links"]
        strain = 4000.0 / (second.chain.mean_stiffness * second.chain.pitch)
        assert assemble_chain(second).strain == pytest.approx(strain, abs=1e-7)
    results = read_results(outcome.table)
    view_study(results, recorded_trajectories(results, tmp_path / "out", [0]), save=tmp_path / "study.rrd")
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


BOTH = FACTORIAL + part("factors", "teeth", path="sprockets.out.teeth", levels=[34, 36])
BOTH += part("factors", "pull", levels=[3000.0, 5000.0]) + '[[constraints]]\nrequire = "pull > 0"\n'
MID = '[[adjust]]\nchain = "first"\nsprocket = "mid in"\ndirection = [2.0, 0.0]\npreload = "pull"\n'
END = '[[adjust]]\nchain = "second"\nsprocket = "out"\ndirection = [1.0, 0.5]\nlinks = "even"\nstrain = 4e-4\n'
COLUMNS = ["first.adjusted_travel", "second.adjusted_links", "second.adjusted_travel"]


def written(folder, text):
    """A study of two stages in a folder."""
    save_drive(chains.two_stages(), folder / "two.toml")
    (folder / "study.toml").write_text(text + RUN.format(0.001))
    return folder / "study.toml"


@pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
def test_two_chains_are_adjusted_one_after_the_other(tmp_path):
    """Both have what is wanted in the end, though the shaft between them, moved for the first, takes along the second.

    The search ends within 1e-10 of strain; its places are rounded to 1e-10 m, on some 2 m of strands.
    """
    source = written(tmp_path, BOTH + MID + END)
    table = run_study(source, tmp_path / "out", workers=1).table
    rows = read_results(table).table.to_pylist()
    assert [row["status"] for row in rows] == ["ok"] * 4, [row["reason"] for row in rows]
    assert [name for name in rows[0] if "adjusted" in name] == COLUMNS
    made = open_study(source).drives([{name: row[name] for name in ("teeth", "pull")} for row in rows])
    base = load_drive(tmp_path / "two.toml")
    for drive, row in zip(made, rows, strict=True):
        first, second = Model(drive).chains
        wanted = row["pull"] / (first.chain.mean_stiffness * first.chain.pitch)
        assert assemble_chain(first).strain == pytest.approx(wanted, abs=1e-9)
        assert assemble_chain(second).strain == pytest.approx(4e-4, abs=1e-9)
        assert (first.chain.links, second.chain.links) == (base.chains[0].links, row["second.adjusted_links"])
        travel, end = row["first.adjusted_travel"], row["second.adjusted_travel"]
        steps = {"crank": (0.0, 0.0), "mid in": (travel, 0.0), "mid out": (travel, 0.0)}
        steps["out"] = (end * 2.0 / math.sqrt(5.0), end / math.sqrt(5.0))  # along [1.0, 0.5]
        for before, after in zip(base.sprockets, drive.sprockets, strict=True):
            place = [x + step for x, step in zip(before.center, steps[after.name], strict=True)]
            assert after.center == pytest.approx(place, abs=2e-10)  # rounded as above


def test_an_adjusted_study_of_several_is_resumed_merged_and_reported(tmp_path, capsys):
    """The table is that of a run without a break; results that mark no metrics take no adjustment for one."""
    end = END + "travel = 0.005\n[metrics]\nkeep = ['first.tension_*']\n"  # too short for other teeth
    source = written(tmp_path, BOTH.replace("34, 36", "36, 60") + MID + end)
    source.write_text(source.read_text().replace("[run]", "[run]\nshard = 2"))
    whole = read_results(run_study(source, tmp_path / "whole", workers=1).table)
    run_study(source, tmp_path / "out", workers=1, part=(0, 2))
    again = read_results(run_study(source, tmp_path / "out", workers=1).table)
    assert again.table.equals(whole.table)
    rows = whole.table.to_pylist()
    assert [row["status"] for row in rows] == ["ok", "ok", "infeasible", "infeasible"]
    for row in rows[2:]:
        assert row["reason"].startswith('adjust.second: sprocket "out": no place along ')
        assert all(row[name] is None for name in COLUMNS)
    export_table(whole.table, tmp_path / "table.csv")
    read = read_results(tmp_path / "table.csv", factors=["teeth", "pull"])
    assert "first.tension_max" in read.metrics and not {*COLUMNS} & {*read.metrics}
    source.write_text(source.read_text().replace('preload = "pull"', 'preload = "pull + 1"'))
    run_study(source, tmp_path / "other", workers=1)
    with pytest.raises(StudyError, match=r'adjust\.first\.preload = "pull \+ 1", but "pull" in '):
        join_studies([tmp_path / "whole", tmp_path / "other"], tmp_path / "joined")
    join_studies([tmp_path / "whole", tmp_path / "out"], tmp_path / "joined")
    assert (tmp_path / "joined" / "study.toml").read_text().count("[[adjust]]") == 2
    assert run(capsys, "study", "report", tmp_path / "joined", "-o", tmp_path / "report.html")[0] == 0
    assert "adjust 2" in (tmp_path / "report.html").read_text()


OTHER = END.replace('"second"', '"first"').replace('"out"', '"crank"')
BACK = END.replace('"out"', '"mid out"')


@pytest.mark.parametrize(
    ("adjusts", "line"),
    [
        (MID + OTHER, 'adjustment 2: chain = "first": is that of adjustment 1 already'),
        (MID + END.replace('chain = "second"\n', ""),
         "adjustment 2: chain: missing; each of several adjustments must name a chain of its own"),
        (MID + END.replace('"second"', '"third"'),
         'adjust.third.chain = "third": must be a chain of the drive: first, second'),
        (MID + BACK, 'adjust.second.sprocket = "mid out": moves shaft "mid", which adjust.first moves already'),
        (END + MID, 'adjust.first.sprocket = "mid in": moves a sprocket of chain "second", which adjust.second has '
                    "adjusted; put it before adjust.second"),
        (MID + END.replace("4e-4", '"tork"'),
         'adjust.second.strain = "tork": tork is not a factor; factors are teeth, pull'),
        ("adjust = 3\n", "adjust = 3: must be a table, or a list of tables"),
    ],
)  # fmt: skip
def test_what_several_adjustments_cannot_be_is_one_line(adjusts, line, tmp_path, capsys):
    before, after = (adjusts, "") if adjusts.startswith("adjust =") else ("", adjusts)
    source = written(tmp_path, before + BOTH + after)
    said = refused(capsys, "study", "run", source, "-o", tmp_path / "out")
    assert said == f"warpchain: error: {source}: {line}"
