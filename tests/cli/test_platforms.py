"""Where it runs: checkouts without symbolic links and Windows are refused in one line, odd paths are taken."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command import run as command

import warpchain
from warpchain import cli, read_archive
from warpchain.drive.examples import drive_path

PACKAGE = Path(warpchain.__file__).resolve().parent


@pytest.fixture
def without_links(tmp_path):
    """A copy of the package as git checks it out where there are no symbolic links."""
    ignored = shutil.ignore_patterns("__pycache__", "kernels")
    shutil.copytree(PACKAGE, tmp_path / "warpchain", ignore=ignored)
    (tmp_path / "warpchain" / "kernels").write_text("../kernels")
    return tmp_path


@pytest.mark.long
def test_a_link_that_is_a_text_file_is_told(without_links):
    def ran(*words):
        environment = os.environ | {"PYTHONPATH": str(without_links)}
        command = [sys.executable, "-m", "warpchain", *words]
        return subprocess.run(command, cwd=without_links, env=environment, capture_output=True, text=True)

    done = ran("run", "marine", "-o", "a.mcap")
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and not (without_links / "a.mcap").exists()
    assert line.startswith(f"warpchain: error: {without_links / 'warpchain' / 'kernels'}: is a text file, not a link")
    assert "core.symlinks" in line
    # what needs no kernels works
    assert ran("draw", "marine", "-o", "a.svg").returncode == 0


def test_windows_is_sent_to_wsl(monkeypatch, capsys):
    monkeypatch.setattr(sys, "platform", "win32")
    status = cli.main(["check", "marine"])
    assert status == 2
    assert capsys.readouterr().err == (
        "warpchain: error: runs on Linux and macOS; on Windows in WSL 2 (docs/devices.md)\n"
    )


def test_blanks_and_other_letters_in_paths(capsys, tmp_path):
    folder = tmp_path / "Kette für Prüfstand \N{GREEK SMALL LETTER OMEGA} 'a' #1"
    folder.mkdir()
    drive, archive = folder / "mein Antrieb.toml", folder / "Lauf 1.mcap"
    drive.write_text(drive_path("motorcycle").read_text())
    assert command(capsys, "draw", drive, "-o", folder / "Bild.svg")[0] == 0
    short = ["--duration", "0.002", "--set", "run.settle=false", "--limit", "energy_change=inf", "--quiet"]
    status, out, _ = command(capsys, "run", drive, "-o", archive, *short)
    assert status == 0
    assert shlex.split(out[-1].split("look at it with: ")[1]) == ["warpchain", "view", str(archive)]
    assert len(read_archive(archive)[0].time) > 1
