"""Plug-ins: loaded once, told by digest, by entry points too; what is wrong with one is a line with its line number."""

import hashlib
import os
import re
import subprocess
import sys
import time

import pytest
from command import refused, run
from own_files import LAW, METRICS, write_plugin
from pyarrow import parquet
from study_helpers import LIMITS, STUDY, tiny_drive, write_study

from warpchain import load_plugin, read_archive, simulate
from warpchain.archive import write_archive
from warpchain.drive import dumps_drive, plugins
from warpchain.errors import PluginError, SimulationError, StudyError
from warpchain.results.own_metrics import OWN_METRICS
from warpchain.study.run.shards import run_shard

pytestmark = [
    pytest.mark.usefixtures("own_plugins"),
    pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning"),
]
SHORT = {"device": "cpu", "step": 1e-5, "duration": 5e-4}


def fast_drive():
    """A drive of a few milliseconds, with frames in its window."""
    return tiny_drive().with_values({"run.sample_rate": 1e5})


HEAD = "import warpchain\n"
METRIC = HEAD + '@warpchain.metric("own", title="one\'s own")\ndef own(run):\n    {}\n'
OBJECTIVE = '[[objectives]]\nmetric = "{}"\nsense = "min"\n'


def test_a_metric_is_its_formula_of_other_metrics_and_of_frames_in_the_window(tmp_path):
    load_plugin(write_plugin(tmp_path, METRICS))
    run = simulate(fast_drive(), **SHORT)
    row = run.metrics.to_pylist()[0]
    assert row["tension_swing"] == (row["tension_max"] - row["tension_min"]) / row["tension_mean"]
    inside = run[0].time >= row["window_start"] - 1e-12
    assert row["tension_step"] == abs(run[0].tension[inside][1:] - run[0].tension[inside][:-1]).max() > 0.0
    facts = run.metrics.schema.field("tension_step").metadata
    assert facts[b"unit"] == b"N"
    assert facts[b"plugin"].decode() == hashlib.sha256(METRICS.encode()).hexdigest()


@pytest.mark.parametrize("variants", ["none", [1]])
def test_frames_for_a_metric_are_those_of_every_variant_and_are_not_kept(tmp_path, variants):
    from warpchain import Record

    drives = [fast_drive(), fast_drive().with_values({"sprockets.s1.load.torque": 5.0})]
    plain = simulate(drives, **SHORT, record=Record(variants, channels=["position"]))
    load_plugin(write_plugin(tmp_path, METRICS))
    run = simulate(drives, **SHORT, record=Record(variants, channels=["position"]))
    whole = simulate(drives, **SHORT)
    assert list(run) == list(plain)
    assert all(set(run[v].channels()) == {"position"} for v in run)
    assert run.metrics["tension_step"].to_pylist() == whole.metrics["tension_step"].to_pylist()
    assert run.metrics["tension_max"] == plain.metrics["tension_max"]


def test_an_archive_says_which_plugins_it_had_and_is_read_without_them_in_one_line(tmp_path, own_plugins):
    path = tmp_path / "a.mcap"
    plugin = load_plugin(write_plugin(tmp_path, METRICS))
    streamed = simulate(fast_drive(), **SHORT, archive=path)
    assert streamed.info.plugins == f"own.py sha256:{hashlib.sha256(METRICS.encode()).hexdigest()}"
    archive = read_archive(path)
    assert archive.info.plugins == plugin.words
    assert archive.metrics.schema.metadata == {b"plugins": plugin.words.encode()}
    assert archive.metrics["tension_step"][0].as_py() > 0.0
    plugins._LOADED.clear()
    with pytest.warns(UserWarning, match=r"a\.mcap: made with a plug-in that is not here: own\.py \(sha256 \w{8}\) is"):
        again = read_archive(path)
    assert again.metrics.equals(archive.metrics)
    load_other = write_plugin(tmp_path, HEAD)
    load_plugin(load_other)
    with pytest.warns(UserWarning, match=r"own\.py has changed \(sha256 \w{8}, now \w{8}\)"):
        read_archive(path)
    write_archive(again, tmp_path / "b.mcap")
    with pytest.warns(UserWarning, match="has changed"):
        assert read_archive(tmp_path / "b.mcap").info.plugins == plugin.words


def test_commands_take_a_plugin_and_name_its_metrics(tmp_path, capsys):
    own, drive = write_plugin(tmp_path, METRICS), tmp_path / "d.toml"
    drive.write_text(dumps_drive(fast_drive()))
    run_words = ("run", drive, "-o", tmp_path / "a.mcap", "--duration", "5e-4", "--device", "cpu", "--quiet")
    status, out, _ = run(capsys, *run_words, "--plugin", own)
    assert status == 0
    assert any(line.startswith("plug-ins: own.py (sha256 ") for line in out)
    assert any(line.startswith("tension_step: ") and line.endswith("largest change between frames") for line in out)
    status, out, _ = run(capsys, "metrics", drive, "--plugin", own)
    assert " ".join(out[-2].split()) == "tension_swing 1 tension from least to largest, over its mean"
    run(capsys, "report", tmp_path / "a.mcap", "-o", tmp_path / "a.html")
    assert "with plug-ins: own.py (sha256 " in (tmp_path / "a.html").read_text()


HOSTILE = {
    "raises at import": ("\n\n1 / 0\n", r"own\.py, line 3: ZeroDivisionError: division by zero"),
    "is no Python": ("x = 1\nx = = 2\n", r"own\.py, line 2: SyntaxError: invalid syntax"),
    "ends Python": ("import sys\nsys.exit(0)\n", r"own\.py, line 2: SystemExit: 0"),
    "lacks a module": ("import no_such_module\n", r"line 1: ModuleNotFoundError: No module named 'no_such_module'"),
    "a name that is taken": (
        HEAD + '@warpchain.metric("tension_max", title="x")\ndef x(run): return 1.0\n',
        r"own\.py, line 2: metric 'tension_max': there is one of this name already",
    ),
    "a name that is none": (HEAD + "@warpchain.metric('A b', title='x')\ndef x(run): ...\n", "must be a word of small"),
    "an unknown channel": (
        HEAD + "@warpchain.metric('own', title='x', channels=['tensions'])\ndef x(run): ...\n",
        r"own\.py, line 2: metric 'own': no channel 'tensions'; allowed are position, ",
    ),
    "no function": (HEAD + "warpchain.metric('own', title='x')(3)\n", r"own\.py, line 2: metric 'own': must be a func"),
    "a law that is no wp.func": (
        HEAD + "@warpchain.contact_law('own', factor=abs, rebound=abs)\ndef x(a, b, c): ...\n",
        r"own\.py, line 2: contact law 'own': must be a function with @warp\.func below",
    ),
    "a law's name that is taken": (LAW.replace('"approach"', '"flores"'), "contact law 'flores': there is one of this"),
    "a law of two arguments": (
        LAW.replace("impact_speed: Any, ", ""),
        r"own\.py, line \d+: contact law 'approach': has 2 arguments; must be elastic, speed, damping",
    ),
    "a law whose rebound fails": (
        LAW.replace("root = ", "return None\n    root = "),
        r"own\.py, line 14: contact law 'approach': rebound of 0\.1: gives None; must be a number",
    ),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_plugin_is_refused_in_one_line_and_leaves_nothing(tmp_path, capsys, what):
    text, said = HOSTILE[what]
    own = write_plugin(tmp_path, text)
    before = set(OWN_METRICS)
    with pytest.raises(PluginError, match=said) as caught:
        load_plugin(own)
    assert "\n" not in str(caught.value)
    assert set(OWN_METRICS) == before
    assert plugins.loaded_plugins() == ()
    assert refused(capsys, "check", "marine", "--plugin", own) == f"warpchain: error: {caught.value}"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "return run['no_such']",
            r"line 4: metric 'own' of variant 0: 'no_such' is no metric of this drive, and no channel",
        ),
        ("return 1 / 0", r"line 4: metric 'own' of variant 0: ZeroDivisionError: division by zero"),
        ("return [1.0, 2.0]", r"line 2: metric 'own' of variant 0: gives list; must be one number"),
        ("import numpy; return numpy.ones(3)", r"metric 'own' of variant 0: gives an array of shape \(3,\)"),
        ("return 'a'", "gives str; must be one number, or None"),
        ("return float('nan')", "gives nan; must be finite, or None where there is no value"),
        ("return 1e400", "gives inf; must be finite"),
        ("raise SystemExit(0)", "line 4: metric 'own' of variant 0: SystemExit: 0"),
    ],
)
def test_a_metric_that_fails_says_its_line(tmp_path, capsys, body, said):
    own, drive = write_plugin(tmp_path, METRIC.format(body)), tmp_path / "d.toml"
    drive.write_text(dumps_drive(fast_drive()))
    words = ("run", drive, "-o", tmp_path / "a.mcap", "--duration", "5e-4", "--device", "cpu", "--quiet")
    status, out, err = run(capsys, *words, "--plugin", own)
    errors = [line for line in err if "error: " in line]
    assert (status, len(errors)) == (2, 1), err
    assert re.search(said, errors[0]), errors[0]
    assert "own.py" in errors[0]


@pytest.mark.parametrize("text", [METRIC.format("while True: pass"), "while True: pass\n"])
def test_what_never_ends_is_ended(tmp_path, monkeypatch, text):
    for name in ("LOADING_SECONDS", "METRIC_SECONDS"):
        monkeypatch.setattr(plugins, name, 0.2)
    own, begin = write_plugin(tmp_path, text), time.monotonic()
    with pytest.raises(PluginError, match=r"own\.py, line \d(: metric 'own' of variant 0)?: takes longer than 0\.2 s"):
        load_plugin(own)
        simulate(fast_drive(), **SHORT)
    assert time.monotonic() - begin < 30.0


def test_no_value_is_missing_and_other_variants_have_theirs(tmp_path):
    text = METRIC.format('return None if run.drive.sprockets[1].load else run["tension_max"]')
    load_plugin(write_plugin(tmp_path, text))
    drives = [fast_drive(), fast_drive().with_values({"sprockets.s1.load.torque": 5.0})]
    run = simulate(drives, **SHORT)
    assert run.metrics["own"].to_pylist() == [run.metrics["tension_max"][0].as_py(), None]


def test_a_file_is_loaded_once_and_must_stay_as_it_is(tmp_path):
    own = write_plugin(tmp_path, METRICS)
    assert load_plugin(own) is load_plugin(str(own))
    own.write_text(METRICS + "# more\n")
    with pytest.raises(PluginError, match=r"own\.py: has changed since it was loaded; start Python anew"):
        load_plugin(own)
    with pytest.raises(PluginError, match=r"no\.py: cannot be read \(No such file or directory\)"):
        load_plugin(tmp_path / "no.py")
    with pytest.raises(PluginError, match=r"own\.txt: a plug-in is a Python file"):
        load_plugin(write_plugin(tmp_path, METRICS, "own.txt"))


def test_a_script_that_defines_a_metric_itself_is_named_too(tmp_path):
    script = write_plugin(tmp_path, METRICS, "script.py")
    exec(compile(METRICS, str(script), "exec"), {})
    run = simulate(fast_drive(), **SHORT)
    assert run.info.plugins == f"script.py sha256:{hashlib.sha256(METRICS.encode()).hexdigest()}"
    assert run.metrics["tension_step"][0].as_py() > 0.0
    assert plugins.loaded_plugins() == ()  # no other process is to run it


def test_states_are_not_kept_where_a_metric_reads_frames(tmp_path):
    from warpchain.engine.checkpoint import States

    load_plugin(write_plugin(tmp_path, METRICS))
    with pytest.raises(SimulationError, match="keep_states: not with a plug-in's metric that reads frames"):
        simulate(fast_drive(), **SHORT, states=States(True, [None]))


def test_installed_packages_are_plugins_by_their_entry_points(tmp_path):
    write_plugin(tmp_path, METRICS, "own_package.py")
    folder = tmp_path / "own_package-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[warpchain.metrics]\nown = own_package\n")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([*filter(None, sys.path), str(tmp_path)])}

    def command(*words):
        return subprocess.run(
            [sys.executable, "-m", "warpchain", *words], capture_output=True, text=True, env=environment, check=False
        )

    assert command("metrics", "marine").stdout.splitlines()[-1].startswith("tension_step ")
    (tmp_path / "own_package.py").write_text("\nraise ValueError('no licence')\n")
    done = command("metrics", "marine")
    assert done.returncode == 2
    assert done.stderr == (
        "warpchain: error: own_package of the installed package own-package, line 2: ValueError: no licence\n"
    )


def write_own_study(folder):
    """A study whose objective and limit are the metrics of a plug-in; its file, and the plug-in's."""
    limits = LIMITS.replace("[limits]", "[[limits]]") + '[[limits]]\nmetric = "tension_swing"\nmax = 1e9\n'
    text = STUDY.replace(LIMITS, limits).replace("shard = {shard}", "shard = {shard}\n[record]\nrate = 1e5")
    return write_study(folder, OBJECTIVE.format("tension_step"), 2, text=text), write_plugin(folder, METRICS)


def test_a_study_has_an_own_metric_as_objective_and_limit(tmp_path, capsys):
    text, own = write_own_study(tmp_path)
    words = ("study", "run", text, "-o", tmp_path / "out", "--quiet")
    status, _, err = run(capsys, *words)
    assert status == 2
    assert sorted(re.search(r'"(tension_\w+)": no such metric', line)[1] for line in err) == sorted(
        ["tension_step", "tension_swing"]
    )
    assert run(capsys, *words, "--plugin", own)[0] == 0
    table = parquet.read_table(tmp_path / "out" / "results.parquet")
    assert table.num_rows == 4
    assert min(table["tension_step"].to_pylist()) > 0.0
    digest = hashlib.sha256(METRICS.encode()).hexdigest()
    assert table.schema.field("tension_swing").metadata[b"plugin"].decode() == digest
    assert table.schema.metadata[b"plugins"].decode() == f"own.py sha256:{digest}"
    report = tmp_path / "r.html"
    assert run(capsys, "study", "report", tmp_path / "out", "-o", report)[0] == 0
    assert "tension_step" in report.read_text()


def test_a_study_goes_on_only_with_the_plugin_that_it_was_begun_with(tmp_path, capsys):
    text, own = write_own_study(tmp_path)
    out = tmp_path / "out"
    words = ("study", "run", text, "-o", out, "--quiet")
    assert run(capsys, *words, "--shard", "0/2", "--plugin", own)[0] == 0
    plugins._LOADED.clear()
    said = rf"{out}: was begun with a plug-in that is not here: own\.py \(sha256 \w{{8}}\) is not loaded; give it"
    assert re.search(said, refused(capsys, *words))
    with pytest.raises(StudyError, match=said):
        run_shard(out, 1)
    changed = write_plugin(tmp_path, HEAD)
    assert "own.py has changed (sha256 " in refused(capsys, *words, "--plugin", changed)
    plugins._LOADED.clear()


def test_worker_processes_of_a_study_load_its_plugins(tmp_path):
    text, own = write_own_study(tmp_path)
    code = f"""
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import warpchain
if __name__ == "__main__":
    warpchain.load_plugin({str(own)!r})
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        print(warpchain.run_study({str(text)!r}, {str(tmp_path / "out")!r}, executor=pool).counts["ok"])
"""
    script = write_plugin(tmp_path, code, "script.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, check=False)
    assert done.stdout.splitlines()[-1:] == ["4"], done.stderr
    assert min(parquet.read_table(tmp_path / "out" / "results.parquet")["tension_step"].to_pylist()) > 0.0
