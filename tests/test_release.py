"""What a release needs beside its code: one version everywhere, formats told with their numbers."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from warpchain.archive.archive_format import FORMAT_VERSION, RUN_METADATA
from warpchain.study.run.shard_plan import PLAN_FORMAT

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = PROJECT["version"]


def test_one_version_everywhere():
    assert re.search(rf"^version: {re.escape(VERSION)}$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)


def test_the_citation_has_what_its_format_asks_for():
    """The required keys of Citation File Format 1.2.0."""
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    keys = {line.split(":")[0] for line in lines if line and not line.startswith((" ", "-"))}
    assert {"cff-version", "message", "title", "authors"} <= keys
    assert "cff-version: 1.2.0" in lines


def test_the_page_of_formats_tells_what_this_version_writes():
    text = (ROOT / "docs" / "formats.md").read_text()
    major = ".".join(VERSION.split(".")[:2])
    assert re.search(rf"^\| archive \(.*\| {FORMAT_VERSION} \| warpchain {major} \|", text, re.MULTILINE)
    assert re.search(rf"^\| study folder \(.*\| {PLAN_FORMAT} \| warpchain {major} \|", text, re.MULTILINE)
    assert f"`{RUN_METADATA}`" in text


def test_the_page_of_devices_tells_the_bounds_of_dependencies():
    """Oldest as pyproject.toml has it, newest within its bounds: `scripts/newest` says what to write."""
    text = (ROOT / "docs" / "devices.md").read_text().split("## Versions of dependencies")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([\w-]+) \| ([\d.]+) \| ([\d.]+) \|$", text, re.MULTILINE)
    bounds = [Requirement(line) for line in PROJECT["dependencies"]]
    assert [(name, f">={oldest}") for name, oldest, _ in rows] == [
        (bound.name, str(next(one for one in bound.specifier if one.operator == ">="))) for bound in bounds
    ]
    assert all(bound.specifier.contains(newest) for bound, (_, _, newest) in zip(bounds, rows, strict=True))


@pytest.mark.parametrize("script", ["oldest", "newest"])
def test_versions_are_asked_for_as_the_bounds_say(script, tmp_path):
    """The requirements that the script hands on: `==` the oldest, or the bare name."""
    (tmp_path / "scripts" / "common").mkdir(parents=True)
    for name in (f"scripts/{script}", "pyproject.toml"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    shared = (ROOT / "scripts" / "common" / "versions.sh").read_text()
    (tmp_path / "scripts" / "common" / "versions.sh").write_text(shared + "\ntry_with() { cat; }\n")
    words = ["bash", f"scripts/{script}"]
    done = subprocess.run(
        words, env=os.environ | {"PYTHON": sys.executable}, cwd=tmp_path, capture_output=True, text=True
    )
    bounds = [re.match(r"([\w-]+)>=([\d.]+)", line).groups() for line in PROJECT["dependencies"]]
    asked = [f"{name}=={oldest}" if script == "oldest" else name for name, oldest in bounds]
    assert done.stdout.split() == asked or (script == "oldest" and sys.version_info[:2] != (3, 11)), done.stderr


def test_a_release_is_made_of_what_is_committed(tmp_path):
    """In a copy whose tree has a change the script refuses before it builds."""
    (tmp_path / "scripts").mkdir()
    for name in ("scripts/release", "pyproject.toml"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    setup = tmp_path / "scripts" / "setup"
    setup.write_text('#!/bin/sh\nmkdir -p .venv/bin && ln -sf "$(command -v python3)" .venv/bin/python\n')
    for path in (setup, tmp_path / "scripts" / "release"):
        path.chmod(0o755)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    done = subprocess.run(["scripts/release"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert "not committed" in done.stderr
