"""Running a study: rows and their reasons, metrics equal to `simulate`, recording, commands, one line a mistake."""

import io
import math
import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from command import refused, run
from drives import example
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet
from study_helpers import STUDY, tiny_drive, write_study

from warpchain import Limits, Record, progress, read_archive, simulate
from warpchain.assembly import assemble
from warpchain.drive import load_drive
from warpchain.engine import simulation
from warpchain.errors import SimulationError, StudyError, WarpchainError
from warpchain.results.fatigue import Woehler
from warpchain.results.metric_columns import column_of_metric
from warpchain.results.objectives import trajectory_objectives
from warpchain.study.results import BOOKKEEPING_COLUMNS, read_results
from warpchain.study.run import merge_study, run_study, study_status
from warpchain.study.run.prepare import preferred_shard_size, prepare_folder
from warpchain.study.run.recordings import recorded_trajectories, results_with_objectives
from warpchain.study.run.shard_plan import RunBlock, ShardPlan
from warpchain.study.run.study_folder import StudyFolder, open_folder
from warpchain.study.spec import Study
from warpchain.study.spec.factor import FORBIDDEN_NAMES
from warpchain.study.spec.study_tables import Keep, Worst

ANY_ENERGY = Limits(energy_residual=math.inf, energy_change=math.inf)
PATHS = {"teeth": "sprockets.s0.teeth", "links": "chain.links", "step": "run.step"}
PATHS["torque"] = "sprockets.s1.load.viscous"
ROWS = (
    '[study]\ndrive = "tiny.toml"\n[design]\nkind = "table"\nfile = "rows.csv"\n'
    + "".join(f'[[factors]]\nname = "{name}"\npath = "{path}"\n' for name, path in PATHS.items())
    + 'unit = "N m s"\n[[constraints]]\nrequire = "teeth != 13"\n[limits]\nenergy_residual = inf\nenergy_change = inf\n'
    + "[run]\nduration = 0.0005\nshard = 3\n"
)
TABLE = """teeth,links,step,torque
12,44,1e-5,1.0
13,44,1e-5,1.0
12,60,1e-5,1.0
12,44,1e-3,1.0
4,44,1e-5,1.0
12,44,1e-5,1e30
20,48,1e-5,1.0
12,43,5e-6,1.0
90,100,1e-5,1.0
"""
FACTOR = '[[factors]]\nname = "{}"\npath = "{}"\nlevels = [1, 2]\n'
RECORD = """
[record]
variants = [1]
every = 5
worst = { metric = "tension_max", count = 4 }
rate = 20000.0
channels = ["position", "tension"]
[metrics]
keep = ["*.impacts", "tension_m*n"]
"""


def table_of(folder):
    return parquet.read_table(folder / "results.parquet")


@pytest.fixture(scope="module")
def tabled(tmp_path_factory):
    """A study of the rows of `TABLE`: its folder, and how it ended."""
    home = tmp_path_factory.mktemp("tabled")
    (home / "rows.csv").write_text(TABLE)
    return home, run_study(write_study(home, text=ROWS), home / "out")


def test_every_row_ends_with_a_status_and_a_reason(tabled):
    home, outcome = tabled
    assert outcome.counts == {"ok": 3, "suspect": 0, "diverged": 1, "infeasible": 5}
    rows = table_of(home / "out").to_pylist()
    assert [row["variant"] for row in rows] == list(range(9))
    assert [row["status"] for row in rows] == ["ok", *4 * ["infeasible"], "diverged", "ok", "ok", "infeasible"]
    begins = {
        1: "constraint teeth != 13 is not met",
        2: "chain.links = 60: does not fit the path, strain -",
        3: "run.step = 0.001: must be above 0 and below ",
        4: "sprockets.s0.teeth = 4: must be an integer of at least 5",
        5: "diverged at 0.00032 s: ",
        8: 'sprockets "s0" and "s1": pitch circles overlap',
    }
    for number, row in enumerate(rows):
        assert (row["reason"] or "").startswith(begins.get(number, "")), row["reason"]
        assert (row["reason"] is None) == (number not in begins)
        assert (row["tension_mean"] is None) == (row["status"] != "ok")


def test_metrics_are_those_of_simulate_bitwise_also_with_other_teeth_and_links(tabled):
    table, drive = table_of(tabled[0] / "out"), load_drive(tabled[0] / "tiny.toml")
    for number, row in ((n, row) for n, row in enumerate(table.to_pylist()) if row["status"] == "ok"):
        changed = drive.with_values({path: row[name] for name, path in PATHS.items()})
        alone = simulate(changed, duration=0.0005, record=Record("none"), limits=ANY_ENERGY).metrics.to_pylist()[0]
        names = [name for name in alone if name not in ("variant", "diverged", "reason") and alone[name] is not None]
        assert len(names) > 30
        for name in names:
            assert row[name] == alone[name], (number, name)
    assert table.schema.field("torque").metadata == {b"role": b"factor", b"unit": b"N m s"}
    assert table.schema.field("tension_max").metadata == {b"role": b"metric", b"unit": b"N"}


@pytest.mark.parametrize("memory", [2**31, 150_000], ids=["held", "streamed"])
def test_recorded_variants_are_archived_as_simulate_gives_them(tmp_path, memory, monkeypatch):
    # a trajectory takes 11 frames of 44 * 7 + 2 * 5 values of 8 bytes, 28 kB: two are more than half of what the sums
    # leave of 150 kB
    streamed = []
    monkeypatch.setattr(simulation, "simulate", lambda *a, **k: streamed.append(k["archive"]) or simulate(*a, **k))
    out = tmp_path / "out"
    run_study(write_study(tmp_path, RECORD), out, memory=memory)
    assert any(streamed) == (memory == 150_000)
    table = table_of(out)
    rows = table.to_pylist()
    metrics = [f.name for f in table.schema if (f.metadata or {}).get(b"role") == b"metric"]
    assert metrics == ["tension_min", "tension_max", "tension_mean", "s0.impacts", "s1.impacts"]
    highest = sorted(range(12), key=lambda v: (-rows[v]["tension_max"], v))[:4]
    assert {v for v, row in enumerate(rows) if row["archive"]} == {0, 1, 5, 10} | set(highest)
    assert any(row["archive"] == "shards/worst.mcap" for row in rows)
    for v in sorted({0, 1, 5, 10, *highest}):
        kept = read_archive(out / rows[v]["archive"])[rows[v]["archive_variant"]]
        values = {"sprockets.s1.load.torque": rows[v]["torque"], "chain.links": rows[v]["links"]}
        drive = tiny_drive().with_values(values)
        wanted = Record(rate=20000.0, channels=("position", "tension"))
        alone = simulate(drive, duration=0.0005, step=1e-5, record=wanted, limits=ANY_ENERGY)[0]
        assert kept.velocity is None and len(kept.time) == 11
        assert np.array_equal(kept.tension, alone.tension) and np.array_equal(kept.position, alone.position)


def test_an_adjusted_study_stays_assembled(tmp_path):
    adjust = '[adjust]\nsprocket = "s1"\ndirection = [2.0, 0.0]\nlinks = "even"\nstrain = "0.001 * torque"\n'
    text = STUDY.replace("energy_residual = inf", "energy_residual = inf\nsettle_residual = inf")  # one does not settle
    run_study(write_study(tmp_path, adjust, points=3, text=text), tmp_path / "out")
    for row in table_of(tmp_path / "out").to_pylist():
        assert row["status"] == "ok", row["reason"]
        assert row["adjusted_links"] == 44
        center = (0.2 + row["adjusted_travel"], 0.0)
        drive = tiny_drive().with_values({"sprockets.s1.center": center, "chain.links": row["adjusted_links"]})
        assert assemble(drive).strain == pytest.approx(0.001 * row["torque"], abs=1e-9)


def test_a_study_says_that_its_runs_are_starts(tmp_path, capsys):
    text = STUDY.replace("energy_change = inf\n", "")
    run_study(write_study(tmp_path / "a", text=text, points=2), tmp_path / "a" / "out")
    reasons = [row["reason"] for row in table_of(tmp_path / "a" / "out").to_pylist()]
    assert sum("run.start = true" in (reason or "") for reason in reasons) == 3
    source = write_study(tmp_path / "b", "start = true\n", text=text, points=2)
    out = run_study(source, tmp_path / "b" / "out")
    assert out.counts["ok"] == 4 and load_drive(tmp_path / "b" / "out" / "drive.toml").run.start
    with source.open("a") as file:
        file.write('[[factors]]\nname = "kind"\npath = "run.start"\nchoice = [true, false]\n')
    assert 'run.start = true: not together with factor "kind", which sets it' in refused(
        capsys, "study", "plan", source
    )


def test_progress_counts_variants_of_the_whole_study(tmp_path):
    calls, source = [], write_study(tmp_path)
    run_study(source, tmp_path / "out", part=(0, 2))
    run_study(source, tmp_path / "out", progress=lambda *told: calls.append(told))
    assert calls[-1] == ("running", 12.0, 12.0)
    done = [d for phase, d, _ in calls if phase == "running"]
    assert done == sorted(done) and 6.0 <= done[0] <= 8.0  # the half that was there, and the first shard's progress


def test_a_refusal_of_all_variants_is_the_studys_own(tmp_path):
    source = write_study(tmp_path, 'device = "nowhere"\n')
    with pytest.raises(WarpchainError, match="device"):
        run_study(source, tmp_path / "out")
    assert study_status(tmp_path / "out").shards == (0, 6)


def test_a_refusal_of_one_variant_is_a_row(tmp_path, monkeypatch):
    def refusing(drives, **settings):
        if any(drive.chain.links == 44 and drive.sprockets[1].load.torque == 0.0 for drive in drives):
            raise SimulationError("too little memory")
        return simulate(drives, **settings)

    monkeypatch.setattr(simulation, "simulate", refusing)
    run_study(write_study(tmp_path, shard=12), tmp_path / "out")
    rows = table_of(tmp_path / "out").to_pylist()
    assert [row["status"] for row in rows] == ["infeasible", *11 * ["ok"]]
    assert rows[0]["reason"] == "too little memory"


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (
            '[metrics]\nkeep = ["tensoin*"]',
            'value 1 of metrics.keep = "tensoin*": no such metric; did you mean tension_min?',
        ),
        (
            '[metrics]\nkeep = ["tension_*"]\nmodes = 2',
            'metrics.modes = 2: metrics.keep keeps none; add "modes.*"',
        ),
        ('[record]\nworst = { metric = "peak", count = 1 }', 'record.worst.metric = "peak": no such metric; allowed'),
        ("[record]\nvariants = [12]", "record.variants = 12: must be below the number of rows, 12"),
        (FACTOR.format("tension_max", "chain.damping"), "must not be the name of a metric"),
        (FACTOR.format("t", "run.step"), 'run.step = 1e-05: not together with factor "t", which sets it'),
        (FACTOR.format("t", "chain.dampin"), 'factors.t.path = "chain.dampin": unknown path'),
    ],
)
def test_what_the_drive_does_not_have_is_told(tmp_path, more, line):
    source = write_study(tmp_path, more)
    with pytest.raises(StudyError) as caught:
        run_study(source, tmp_path / "out")
    assert str(caught.value).startswith(f"{source}: ") and line in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_drives_are_found_beside_the_study_or_among_the_examples(tmp_path):
    source = write_study(tmp_path, text='[study]\ndrive = "no.toml"\n[design]\nkind = "table"\nfile = "a.csv"\n'
                         '[[factors]]\nname = "a"\npath = "chain.links"\n')  # fmt: skip
    with pytest.raises(StudyError, match=r'study.drive = "no.toml": .*no.toml: cannot be read'):
        run_study(source, tmp_path / "out")
    source.write_text(source.read_text().replace("no.toml", "marin"))
    with pytest.raises(StudyError, match=r'study.drive = "marin": marin: neither .* did you mean "marine"'):
        run_study(source, tmp_path / "out")


def test_the_documented_study_is_one_that_can_be_run(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "studies.md"
    source = tmp_path / "study.toml"
    source.write_text(re.search(r"```toml\n(.*?)```", page.read_text(), re.S)[1])
    folder = prepare_folder(source, tmp_path / "out", 1, 1, 2**30)
    reasons = folder.read_design()["reason"].to_pylist()
    assert folder.rows == 64 and set(reasons) == {None, "constraint torque < 11e3 or teeth > 23 is not met"}


def test_a_study_without_a_feasible_row_ends_with_its_reasons(tmp_path, capsys):
    source = write_study(tmp_path, RECORD, text=STUDY.replace("levels = [44, 45]", "range = [44.5, 45.5]\npoints = 2"))
    status, out, err = run(capsys, "study", "run", source, "-o", tmp_path / "out", "--quiet")
    assert (status, err) == (1, []) and out == [
        "6 of 6 shards are done; variants: 0 ok, 0 suspect, 0 diverged, 12 infeasible",
        "  12 variants, e.g. chain.links = 44.5: must be an integer of at least 3",
        f"table: {tmp_path / 'out' / 'results.parquet'}",
    ]
    assert table_of(tmp_path / "out")["archive"].to_pylist() == [None] * 12


def test_of_processes_that_begin_at_once_the_first_decides(tmp_path):
    source = write_study(tmp_path, text=STUDY.replace("shard = {shard}", ""))
    with ThreadPoolExecutor(8) as pool:
        begun = [pool.submit(prepare_folder, source, tmp_path / "out", parts, 1, 2**30) for parts in range(1, 13)]
        sizes = {future.result().shard_size for future in begun}
    assert len(sizes) == 1
    assert not list(tmp_path.glob("out/**/.*"))


def test_a_folder_belongs_to_one_study(tmp_path):
    out = tmp_path / "out"
    run_study(write_study(tmp_path), out)
    run_study(write_study(tmp_path, shard=5), out)  # another size of shards changes nothing
    assert open_folder(out).shard_size == 2
    with pytest.raises(StudyError, match="out: holds another study, which differs in factors; give another folder"):
        run_study(write_study(tmp_path, points=5), out)
    source = write_study(tmp_path)
    (tmp_path / "tiny.toml").write_text((tmp_path / "tiny.toml").read_text().replace("damping = 10.0", "damping = 9.0"))
    with pytest.raises(StudyError, match="differs in its base drive"):
        run_study(source, out)
    rows = tmp_path / "rows.csv"
    rows.write_text(TABLE)
    source = write_study(tmp_path, text=ROWS)
    prepare_folder(source, tmp_path / "of_table", 1, 1, 2**30)
    prepare_folder(source, tmp_path / "of_table", 1, 1, 2**30)
    rows.write_text(TABLE.replace("13,44,1e-5,1.0", "13,44,1e-5,2.0"))
    with pytest.raises(StudyError, match="of_table: holds another study, which differs in its design table"):
        prepare_folder(source, tmp_path / "of_table", 1, 1, 2**30)
    (out / "plan.json").write_text("{")
    with pytest.raises(StudyError, match=r"plan.json: damaged"):
        study_status(out)
    with pytest.raises(StudyError, match="nothing: not a study's folder"):
        study_status(tmp_path / "nothing")


def study_of(seconds):
    """A study of so long runs on the CPU; only `run` is looked at for the size of shards."""
    table = {"study": {"drive": "tiny.toml"}, "design": {"kind": "factorial"}}
    table |= {"factors": [{"name": "torque", "path": "sprockets.s1.load.torque", "levels": [0.0, 1.0]}]}
    return Study.model_validate(table | {"run": {"duration": seconds, "step": 1e-5, "device": "cpu"}})


@pytest.mark.parametrize(
    ("seconds", "rows", "parts", "memory", "size"),
    [
        # half a minute of two cores, 1e8 roller-steps a second each: 44 links x (50 + 30,000 steps) and 2 ms a row
        (5e-4, 10**9, 1, 2**40, 3_941),
        (5e-4, 10**9, 1, 2**28, 2_200),  # 22 kB for 44 links and 100 kB a row
        (5e-4, 100, 8, 2**30, 13),  # seven shards of 13 and one of 9
        (5e-4, 100, 1, 10, 1),  # too little memory for a single row: it is tried all the same
        (1e6, 10**9, 1, 2**30, 16),  # runs of hours: eight for each core at once
    ],
)
def test_shards_fill_the_device_and_fit_the_memory(seconds, rows, parts, memory, size):
    assert preferred_shard_size(study_of(seconds), tiny_drive(), rows, parts, 2, memory) == size


def test_a_shard_of_short_runs_is_half_a_minute_too():
    """Runs of 0.5 ms take next to no steps, 1.1e-5 s of two cores: what a row takes besides sets the size. It is 2 ms
    of a core without settling, 152 ms with modes, and 51 ms for the marine drive of 162 links."""
    study, drive = study_of(5e-4), tiny_drive()
    still = drive.with_values({"run.settle": False})
    assert preferred_shard_size(study, still, 10**9, 1, 2, 2**40) == 29_673  # 30 s / (1 ms + 1.1e-5 s)
    modes = study.model_copy(update={"metrics": Keep(modes=2)})
    assert preferred_shard_size(modes, still, 10**9, 1, 2, 2**40) == 394  # 30 s / (76 ms + 1.1e-5 s)
    assert 8 < 10_000 / preferred_shard_size(study, example("marine"), 10_000, 1, 2, 2**31) < 9


@given(st.floats(1e-4, 10.0), st.integers(1, 500), st.integers(1, 64), st.integers(1, 64), st.integers(1, 10**9))
def test_shards_hold_every_row_once(seconds, rows, parts, cores, memory):
    size = preferred_shard_size(study_of(seconds), tiny_drive(), rows, parts, cores, memory)
    folder = StudyFolder(Path("out"), rows, (ShardPlan((RunBlock((0, rows)),), size),))
    sizes = [folder.shard_run_count(shard) for shard in folder.shard_numbers]
    assert sum(sizes) == rows and min(sizes) >= 1
    assert len(set(sizes[:-1])) <= 1 and sizes[-1] <= sizes[0]  # alike, but for what is left for the last one
    assert (sizes[0] - 1) * parts < rows  # no more than an equal share for each part
    assert sizes[0] == 1 or 44 * 500 * sizes[0] < memory  # 500 bytes a roller
    assert size == preferred_shard_size(study_of(seconds), tiny_drive(), rows, parts, cores, memory)
    assert size <= preferred_shard_size(study_of(seconds), tiny_drive(), rows, parts, cores, 2 * memory)


def test_commands_of_a_job_array(tmp_path, capsys):
    source, out, whole = write_study(tmp_path, RECORD), tmp_path / "out", tmp_path / "whole"
    run_study(source, whole)
    line = "2 of 6 shards are done; variants: 4 ok, 0 suspect, 0 diverged, 0 infeasible"
    words = ("study", "run", source, "-o", out, "--quiet", "--shard")
    assert run(capsys, *words, "1/3", "--workers", "1") == (0, [line], [])
    assert "4 of 6 shards are missing (0, 2, 3, 5); finish with" in refused(capsys, "study", "merge", out)
    for part in ("0/3", "2/3"):
        assert run(capsys, *words, part)[0] == 0
    assert run(capsys, "study", "status", out)[1][1] == f"make the whole table with: warpchain study merge {out}"
    assert run(capsys, "study", "merge", out)[1][1] == f"table: {out / 'results.parquet'}"
    assert (out / "results.parquet").read_bytes() == (whole / "results.parquet").read_bytes()
    assert merge_study(out).shards == (6, 6)


def test_status_tells_rate_and_time_left(tmp_path, capsys):
    source, out = write_study(tmp_path, shard=1), tmp_path / "out"
    run_study(source, out, part=(0, 3))
    for number, shard in enumerate((0, 3, 6, 9)):  # 4 of 12 variants, one in 1000 s
        os.utime(out / "shards" / f"{shard:05d}.parquet", (1000.0 * number, 1000.0 * number))
    assert run(capsys, "study", "status", out)[1] == [
        "4 of 12 shards are done; variants: 4 ok, 0 suspect, 0 diverged, 0 infeasible",
        "8 variants are left; at the latest 0.001 variants/s they take 2 h 13 min",
    ]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["run", "no.toml", "-o", "out"], "no.toml: cannot be read: no such file or directory"),
        (["run", "a.toml", "-o", "out", "--shard", "3/3"], "'3/3': must be I/N, whole numbers with 0 <= I < N"),
        (["run", "a.toml", "-o", "out", "--workers", "0"], "'0': must be a whole number from 1 to 1024"),
        (["run", "a.toml", "-o", "out", "--workers", "1025"], "'1025': must be a whole number from 1 to 1024"),
        (["status", "no"], "no: not a study's folder; make one with: warpchain study run"),
        (["run", "a.toml"], "the following arguments are required: -o/--output"),
        ([], "the following arguments are required: COMMAND"),
    ],
)
def test_mistakes_get_one_line(tmp_path, monkeypatch, capsys, words, text):
    monkeypatch.chdir(tmp_path)
    assert text in refused(capsys, "study", *words)


def test_fatigue_of_recorded_variants_is_in_the_table(tmp_path):
    """The table says of each variant what its archived trajectory gives; variants that were not recorded have none."""
    more = "[record]\nevery = 3\nrate = 5e4\n[fatigue]\nexponent = 5\nrange = 100\n"
    run_study(write_study(tmp_path, more, points=2), tmp_path / "out")
    results = read_results(table_of(tmp_path / "out"))
    damage = results.table["damage_per_hour_max"].to_pylist()
    assert [value is not None for value in damage] == [True, False, False, True]
    assert "s1.transmission_error_rms" in results.metrics
    (trajectory,) = recorded_trajectories(results, tmp_path / "out", [3]).values()
    window = results.values("window_start")[3], results.values("window_end")[3]
    assert damage[3] == trajectory_objectives(trajectory, *window, Woehler(5.0, 100.0))["damage_per_hour_max"] > 0.0
    again = results_with_objectives(results, tmp_path / "out", Woehler(5.0, 50.0))
    assert sorted(again.table.column_names) == sorted(results.table.column_names)
    assert again.table["damage_per_hour_max"][3].as_py() == pytest.approx(32.0 * damage[3])  # (100 / 50)^5


def test_all_mistakes_of_a_study_file_are_told_at_once(tmp_path, capsys):
    """Of the file alone, of what the drive lacks, and of metrics that there are not."""
    more = '[[factors]]\nname = "y"\npath = "sprockets.s9.teeth"\nlevels = [1, 2]\n[metrics]\nkeep = ["tensoin"]\n'
    source = write_study(tmp_path, more, text=STUDY.replace("step = 1e-5", 'step = "fast"'))
    status, _, err = run(capsys, "study", "run", source, "-o", tmp_path / "out")
    assert status == 2
    for line, words in zip(err, ("run.step", "factors.y.path", "value 1 of metrics.keep"), strict=True):
        assert words in line
    assert not (tmp_path / "out").exists()
    lost = '[[objectives]]\nmetric = "tension_mx"\n'  # and a factor that is wrong in its place and in its values
    text = source.read_text().replace("levels = [1, 2]", "levels = [1, 1]")
    source.write_text(text.replace("[limits]\nenergy_residual = inf\nenergy_change = inf", lost))
    status, _, err = run(capsys, "study", "run", source, "-o", tmp_path / "out")
    assert status == 2 and len(err) == 5
    for words in ("run.step", "factors.y.levels", "factors.y.path", "value 1 of metrics.keep", "objective 1: metric"):
        assert any(words in line for line in err)


def test_where_there_is_no_terminal_progress_is_a_line_every_so_often(monkeypatch):
    clock, said = [0.0], io.StringIO()
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(sys, "stderr", said)
    with progress.progress_bar(200.0, "study", "variants", 100.0) as bar:
        for clock[0] in (4.0, 9.9, 10.0, 19.0, 25.0):
            bar.update(10.0)
    assert said.getvalue().splitlines() == [
        "study: 65 % of 200 variants, 10 s elapsed, about 23 s left",
        "study: 75 % of 200 variants, 25 s elapsed, about 25 s left",
    ]


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (59.6, "1 min 0 s"), (125.0, "2 min 5 s"), (4678.0, "1 h 17 min")]
)
def test_durations_are_told_in_words(seconds, words):
    assert progress.duration_text(seconds) == words


def test_the_second_pass_has_a_bar_of_its_own_and_none_goes_beyond_its_end(tmp_path, monkeypatch):
    bars = []

    class Noted(progress.ProgressLines):
        def __init__(self, total, name, unit, initial=0.0, **_):
            super().__init__(total, name, unit, initial)
            bars.extend([self] if unit == "variants" else [])  # and not of kernels, where some are compiled

    monkeypatch.setattr(progress, "progress_bar", Noted)
    source = write_study(tmp_path, '[record]\nworst = { metric = "tension_max", count = 2 }\n')
    run_study(source, tmp_path / "out", progress=True)
    assert [(bar.name, bar.total) for bar in bars] == [("study", 12.0), ("recording the worst", 2.0)]
    assert all(bar.n <= bar.total + 1e-9 for bar in bars)


def test_a_function_hears_of_the_second_pass_and_of_kernels_too(tmp_path, monkeypatch):
    compiled = [("compiling", 0, 2), ("compiling", 2, 2)]

    def simulate(*arguments, progress, **options):
        for told in compiled:
            progress(*told)
        return simulated(*arguments, progress=progress, **options)

    simulated = simulation.simulate
    monkeypatch.setattr(simulation, "simulate", simulate)
    source = write_study(tmp_path, '[record]\nworst = { metric = "tension_max", count = 2 }\n', shard=12)
    told = []
    run_study(source, tmp_path / "out", progress=lambda *of: told.append(of))
    assert told[:2] == compiled
    recording = told.index(compiled[0], 2)
    assert {phase for phase, _, _ in told[2:recording]} <= {"running", "compiling"}
    assert ("running", 12.0, 12.0) in told[:recording] and told[-1] == ("recording", 2.0, 2.0)


def test_the_worst_recorded_variant_is_the_first_to_be_shown(tmp_path):
    source = write_study(tmp_path, '[record]\nevery = 3\nworst = { metric = "tension_max", count = 2 }\n')
    results = read_results(run_study(source, tmp_path / "out").table)
    worst = Worst(metric="tension_max", count=2)
    shown = list(recorded_trajectories(results, tmp_path / "out", worst=worst))
    tension = results.values("tension_max")
    assert shown[0] == int(tension.argmax())
    assert list(tension[shown]) == sorted(tension[shown], reverse=True)
    assert list(recorded_trajectories(results, tmp_path / "out")) == sorted(shown) or len(shown) == 4


ALL = """
[adjust]
sprocket = "s1"
direction = [1.0, 0.0]
links = "even"
strain = 1e-4
[record]
variants = [0]
rate = 5e4
worst = { metric = "tension_max", count = 1 }
[fatigue]
exponent = 5
range = 100
"""


def test_every_column_of_a_table_is_of_one_kind(tmp_path):
    """A study that does all it can: adjusts, settles, records, records the worst, counts fatigue."""
    text = STUDY.replace('"links"', '"damping"').replace("chain.links", "chain.damping").replace("44, 45", "10.0, 20.0")
    outcome = run_study(write_study(tmp_path, ALL, points=2, text=text), tmp_path / "out", workers=1)
    results = read_results(outcome.table)
    names = results.table.column_names
    aside = {name for name in names if (column := column_of_metric(name)) and column.is_aside}
    kinds = [results.factors, results.metrics, set(BOOKKEEPING_COLUMNS) & set(names), aside]
    assert sorted(name for kind in kinds for name in kind) == sorted(names)  # none is of two kinds
    # the status says the first; none diverged; "today" is there where the design of today runs beside
    assert set(BOOKKEEPING_COLUMNS) - set(names) == {"diverged", "diverged_time", "today"}


def test_no_factor_can_be_called_like_bookkeeping():
    assert set(BOOKKEEPING_COLUMNS) <= FORBIDDEN_NAMES
