"""The command line as a user meets it: what it prints, its exit status, and one line for each mistake."""

import argparse
import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import refused, run
from drives import example, two_sprockets
from silent_chains import pulled_silent_drive
from waiting import bytes_in, wait_for

from warpchain import cli, read_archive
from warpchain.assembly.summary import derived_quantities, strand_frequency
from warpchain.cli.commands import _run_status_lines
from warpchain.cli.parser import command_line_parser
from warpchain.cli.shared_options import message_with_options
from warpchain.cli.study_commands import study_setting_words
from warpchain.drive import dumps_drive
from warpchain.drive.examples import drive_path

RUN = ["run", "marine", "-o", "x.mcap"]


def test_check_prints_the_drive(capsys):
    status, out, err = run(capsys, "check", "marine")
    assert (status, err) == (0, [])
    told = ["162 links", "once seated", "crankshaft", "1.03744 m", "tight strand", "86.45 Hz"]
    told += [
        "step: 1.654e-05 s; the largest that keeps 1 % in means and losses is 1.654e-05 s",
        "half of that, 8.272e-06 s",
    ]
    told += ["double the step is not stable: no step from 2.757e-05 s on is, because of the dampers of the links"]
    assert not [words for words in told if words not in "\n".join(out)]


def test_check_as_json_in_si(capsys):
    status, out, _ = run(capsys, "check", "marine", "--json")
    values = json.loads("\n".join(out))
    assert status == 0
    assert values["sprockets"][1]["name"] == "tightener"
    # around a loop that does not cross itself the wraps, signed, add up to a full turn
    wraps = [sprocket["wrap"] for sprocket in values["sprockets"]]
    assert wraps[0] - wraps[1] + wraps[2] == pytest.approx(2 * np.pi)
    assert values["tooth_passing_frequency"] == pytest.approx(9.53 * 57 / (2 * np.pi))


def test_derived_tensions_balance_the_loads():
    """Without weight; z links a turn: the lever is z p / (2 pi), links strained 1e-4. Four states within a tooth pitch
    average the polygon's ripple, (pi / z)^2 / 2 = 1.5e-3."""
    drive = example("marine").with_values({"run.gravity": (0.0, 0.0)})
    slack, same, tight = derived_quantities(drive)["strands"]
    load = 2.0 * np.pi * (9000.0 + 50.0 * 9.53) / (57 * 0.1143)
    assert tight["working_tension"] - same["working_tension"] == pytest.approx(load, rel=2e-3)
    assert slack["working_tension"] == pytest.approx(same["working_tension"], rel=2e-3)
    centrifugal = 6.95 * 0.1143 * (9.53 * 57 / (2.0 * np.pi)) ** 2
    assert slack["centrifugal_tension"] == pytest.approx(centrifugal)


def test_strand_frequency_is_the_closed_form():
    drive = example("marine")
    # many links: the string's f = sqrt(T / mu) / (2 L)
    string = np.sqrt(2e4 / (6.95 / 0.1143)) / (2 * 400 * 0.1143)
    assert strand_frequency(drive, 400, 2e4) == pytest.approx(string, rel=1e-5)
    assert strand_frequency(drive, 400, 0.0) == 0.0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["check", "marin"],
            "marin: neither a drive file nor an example drive (balance_shafts, bucket_elevator, car, chain_conveyor, ",
        ),
        (["check", "marime"], 'v6); did you mean "marine"?'),
        (["check", "absent.toml"], "absent.toml: "),
        (["check", "marine", "--set", "chain.links"], "--set chain.links: must be PATH=VALUE"),
        (["check", "marine", "--set", "chain.lins=3"], "chain.lins: unknown path; did you mean chain.links?"),
        (["check", "marine", "--set", "chain.links=190"], "chain.links = 190: does not fit"),
        ([*RUN, "--step", "1e-3", "--quiet"], "run.step = 0.001: must be above 0 and below"),
        ([*RUN, "--device", "tpu"], "--device tpu"),
        ([*RUN, "--duration", "-1"], "--duration -1.0"),
        ([*RUN, "--step", "short"], "argument --step: 'short' is not a number"),
        ([*RUN, "--memory", "nan"], "argument --memory: 'nan': must be a finite number"),
        ([*RUN, "--memory", "inf"], "argument --memory: 'inf': must be a finite number"),
        ([*RUN, "--memory", "-1"], "argument --memory: '-1': must be a finite number"),
        ([*RUN, "--channels", "default", "force"], "--channels: 'force' is unknown; allowed are default, posi"),
        (["run", "marine"], "the following arguments are required: -o/--output; see warpchain run --help"),
        (["fly"], "invalid choice: 'fly'"),
        (["check", "marine", "--set", "run.step=1e-5\nother=1"], "run.step"),
    ],
)
def test_mistakes_are_one_line_and_status_2(capsys, tmp_path, monkeypatch, words, line):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *words)
    assert (status, out) == (2, [])
    assert len(err) == 1
    assert err[0].startswith("warpchain: error: ")
    assert line in err[0]
    assert list(tmp_path.iterdir()) == []


def test_all_errors_of_a_file_come_at_once(capsys, tmp_path):
    text = drive_path("marine").read_text().replace("pitch = 0.1143", "pitch = -1.0")
    (tmp_path / "bad.toml").write_text(text.replace("links = 162", 'links = "many"'))
    status, _, err = run(capsys, "check", tmp_path / "bad.toml")
    assert (status, len(err)) == (2, 2)
    assert "chain.pitch = -1.0" in err[0] and "chain.links" in err[1]


def test_no_command_prints_the_help_with_status_2(capsys):
    status, out, _ = run(capsys)
    assert status == 2
    assert any(line.startswith("usage: warpchain") for line in out)


@pytest.mark.parametrize("command", ["check", "run", "view", "plot", "export", "recover"])
def test_every_command_has_help_with_an_example(capsys, command):
    status, out, _ = run(capsys, command, "--help")
    assert status == 0
    assert any(line.startswith(f"  warpchain {command} ") for line in out)


def test_run_export_round_trip(capsys, tmp_path):
    archive, arrays = tmp_path / "short.mcap", tmp_path / "short.npz"
    settings = "--duration 0.004 --step 1e-5 --rate 1000 --set run.settle=false --quiet"
    words = ["run", "marine", "-o", archive, *settings.split()]
    status, out, _ = run(capsys, *words)
    assert status == 0
    assert any(line.startswith("tension: mean") for line in out)
    assert archive.exists()
    assert "--overwrite" in refused(capsys, *words)
    assert run(capsys, *words, "--overwrite")[0] == 0
    assert run(capsys, "export", archive, "-o", arrays)[0] == 0
    with np.load(arrays) as held:
        assert held["position"].shape == (5, 162, 2)
        assert held["tension"].dtype == np.float64
        assert "joint_friction_power" not in held
    assert run(capsys, *words, "--overwrite", "--channels", "default", "joint_friction_power", "hub_force")[0] == 0
    assert read_archive(archive)[0].joint_friction_power.shape == (5, 162)
    assert read_archive(archive)[0].position.shape == (5, 162, 2)


def test_a_run_that_diverges_is_status_1(capsys, tmp_path):
    words = ["run", "marine", "-o", tmp_path / "mad.mcap", "--quiet", "--duration", "0.05", "--step", "2.7e-5"]
    mad = ["--set", "contact.sprocket.impact_speed_floor=1e-9", "--set", "sprockets.camshaft.load.viscous=1e12"]
    status, out, _ = run(capsys, *words, *mad)
    assert status == 1
    assert any("diverged at" in line for line in out)


def test_a_run_tells_what_it_is_judged_to_be(capsys, tmp_path):
    words = ["run", "marine", "-o", tmp_path / "a.mcap", "--quiet", "--duration", "0.004", "--set", "run.settle=false"]
    words += ["--limit", "energy_change=inf"]
    status, out, err = run(capsys, *words)
    assert status == 0 and "status: ok" in out and err == []
    (told,) = [line for line in out if line.startswith("losses: ")]
    assert all(re.search(rf"{group} [\d.e-]+ [mk]?W", told) for group in ("joints", "sprocket contacts", "links"))
    status, out, err = run(capsys, *words, "--overwrite", "--limit", "energy_residual=0", "--limit", "slips=inf")
    assert status == 0
    assert sum(line.startswith("status: suspect: energy residual") for line in out) == 1
    # what to do stands behind each reason, a line each
    lines = _run_status_lines(
        {"status": "suspect", "reason": "energy residual 2 %: take a smaller step; slipped: preload"}
    )
    assert lines == ["status: suspect: energy residual 2 %: take a smaller step", "  and: slipped: preload"]
    assert len(err) == 1 and err[0].startswith("warpchain: warning: suspect: energy residual")
    strict = [*words, "--overwrite", "--strict"]
    assert run(capsys, *strict)[0] == 0
    assert run(capsys, *strict, "--limit", "energy_residual=0")[0] == 3
    assert "--limit energy=0: unknown key; did you mean energy_change?" in refused(
        capsys, *words, "--overwrite", "--limit", "energy=0"
    )
    assert run(capsys, *words, "--overwrite", "--limit", "energy")[0] == 2


def test_ctrl_c_in_the_first_imports_is_one_line(monkeypatch, capsys):
    class Interrupted:
        def find_spec(self, name, *_):
            if name == "warpchain.cli.parser":
                raise KeyboardInterrupt

    monkeypatch.setattr(sys, "meta_path", [Interrupted(), *sys.meta_path])
    monkeypatch.delitem(sys.modules, "warpchain.cli.parser")
    monkeypatch.delattr(cli, "parser")
    assert run(capsys, "check", "marine") == (1, [], ["warpchain: interrupted"])


def test_ctrl_c_ends_cleanly_and_keeps_the_archive(tmp_path):
    archive = tmp_path / "long.mcap"
    command = [sys.executable, "-m", "warpchain", "run", "marine", "-o", str(archive)]
    command += ["--duration", "3000", "--rate", "50", "--quiet"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    # frames have come to the file, compressed to some 6 kB each
    wait_for(lambda: bytes_in(tmp_path) > 300_000 or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "interrupted: the archive holds what was recorded" in out
    assert err == ""
    back = read_archive(archive)
    assert back.info.ended == "interrupted"
    assert len(back[0].time) > 10


def test_messages_name_the_options_of_a_command(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("warpchain.engine.devices._gpu_architectures", dict)
    status, _, err = run(capsys, *RUN, "--device", "cuda", "--quiet")
    assert status == 2
    assert err[0].startswith("warpchain: error: --device cuda: no NVIDIA GPU")
    assert err[0].endswith("or use --device cpu")
    archive = tmp_path / "a.mcap"
    archive.write_bytes(b"kept")
    status, _, err = run(capsys, "run", "marine", "-o", str(archive), "--quiet")
    assert (status, archive.read_bytes()) == (2, b"kept")
    assert err == [f"warpchain: error: {archive}: exists already; give another name, or --overwrite"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--rate", "-1"], "--rate -1.0: must be a finite number above 0"),
        (["--exact-positions"], "--exact-positions: goes with --values float32; else positions are exact already"),
        (["--limit", "slip=1"], "--limit slip=1: unknown key; did you mean slips?"),
        (["--memory", "1e-9", "--duration", "0.01"], "simulate fewer variants at a time, or raise --memory"),
    ],
)
def test_no_message_of_the_command_line_speaks_python(capsys, tmp_path, words, line):
    assert refused(capsys, "run", "marine", "-o", tmp_path / "a.mcap", "--quiet", *words).endswith(line)
    _, _, err = run(capsys, "check", "marine", "--set", 'sprockets.crankshaft.prescribed.table={file="a.csv"}')
    assert err[-1].endswith(
        '"a.csv": only drive files name a file; give the columns themselves, such as time and speed'
    )


def test_what_is_no_option_of_a_command_is_named_as_its_file_has_it():
    """`study run` has --memory, but device and precision are keys of its file; other words stay."""
    known = argparse.Namespace(study="s.toml", memory=1)
    text = 'lower memory=, or use precision="float32"; x=True\nchain.links = 9: use device="cpu"'
    told = 'lower --memory, or use run.precision = "float32"; x=True\nchain.links = 9: use run.device = "cpu"'
    assert message_with_options(text, known) == told
    assert (
        message_with_options("device = 'cuda': none", argparse.Namespace(folder="out")) == "run.device = 'cuda': none"
    )


SIZES = {"mJ": 1e-3, "J": 1.0, "kJ": 1e3, "N": 1.0, "kN": 1e3}


def run_of(capsys, tmp_path, duration, *words):
    """Lines of a run of two sprockets that begin at their speed, by their heads."""
    (tmp_path / "two.toml").write_text(dumps_drive(two_sprockets(duration=duration)))
    line = ["run", str(tmp_path / "two.toml"), "-o", str(tmp_path / "a.mcap"), "--quiet", "--device", "cpu"]
    _, out, err = run(capsys, *line, *words)
    return {line.partition(":")[0]: line for line in out}, err


def test_a_summary_has_a_whole_balance_and_rollers_that_engaged(capsys, tmp_path):
    """In = out + lost + stored, to the digits printed; in 0.1 s at 10 rad/s 20 teeth pass 3.2 rollers."""
    lines, _ = run_of(capsys, tmp_path, 0.2, "--limit", "energy_change=inf")
    found = re.findall(r"(in|out|lost|springs) (-?[\d.e+]+) (\w*J)", lines["energy"])
    terms = {word: float(value) * SIZES[unit] for word, value, unit in found}
    size = max(map(abs, terms.values()))
    assert list(terms) == ["in", "out", "lost", "springs"]
    assert terms["in"] == pytest.approx(terms["out"] + terms["lost"] + terms["springs"], abs=2e-3 * size)
    assert re.search(r", [2-5] rollers engaged$", lines["driver"]) and "impacts" not in lines["driver"]


def test_a_summary_of_a_silent_chain_counts_links(capsys, tmp_path):
    """In 0.02 s at 200 rad/s 23 teeth pass 14.6 links."""
    (tmp_path / "silent.toml").write_text(dumps_drive(pulled_silent_drive(**{"run.duration": 0.04})))
    words = ["--quiet", "--device", "cpu", "--window", "0.02", "0.04"]
    _, out, _ = run(capsys, "run", str(tmp_path / "silent.toml"), "-o", str(tmp_path / "a.mcap"), *words)
    (line,) = [line for line in out if line.startswith("drive: ")]
    assert re.search(r", 1[3-6] links engaged$", line)


def test_a_start_names_what_judges_it_and_gives_no_efficiency(capsys, tmp_path):
    """The start of a drive from rest stores more than it loses; with the word that its message names, it may."""
    ramp = ["--set", "sprockets.driver.prescribed.ramp_time=0.02"]
    lines, _ = run_of(capsys, tmp_path, 0.02, *ramp)
    assert "energy_change" not in lines["energy"] and "efficiency" not in lines["energy"]
    assert lines["status"].startswith("status: suspect") and "run.start = true" in lines["status"]
    lines, _ = run_of(capsys, tmp_path, 0.02, *ramp, "--set", "run.start=true", "--overwrite")
    assert "energy changes" not in "".join(lines.values())
    assert "window 0.01 to 0.02 s, of a start; the run took" in "".join(lines.values())


def test_a_page_tells_settings_as_the_study_file_has_them(tmp_path):
    """TOML's words, not Python's."""
    (tmp_path / "study.toml").write_text('[design]\nkind = "sobol"\n[run]\nkeep_states = false\nwindow = [0.1, 0.3]\n')
    words = {"design": 'kind = "sobol"', "run": "keep_states = false, window = [0.1, 0.3]"}
    assert study_setting_words(tmp_path) == words


def test_commands_read_arguments_that_the_parser_knows():
    """Names that nothing checks, as they are attributes of a namespace."""
    known = {"self"}

    def visit(parser):
        known.update(action.dest for action in parser._actions)
        known.update(parser._defaults)
        for action in parser._actions:
            for inner in action.choices.values() if isinstance(action.choices, dict) else ():
                visit(inner)

    visit(command_line_parser())
    sources = (Path(cli.__file__).parent).glob("*.py")
    read = {name for source in sources for name in re.findall(r"\barguments\.(\w+)", source.read_text())}
    assert len(read) > 50 and read <= known
