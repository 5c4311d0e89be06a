"""Copied snippets run: the Python of every page, with the drive or study that it shows, or else the marine drive."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from warpchain import load_drive, run_study, simulate, write_archive
from warpchain.drive.examples import drive_path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
ELSEWHERE = ("dask_jobqueue",)
"""What no test machine has: a cluster's queue."""


def blocks(page, kind):
    """The fenced blocks of one kind on a page."""
    return re.findall(rf"^```{kind}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def shown(page, needed):
    """The page's own TOML that has all the tables needed, or None."""
    for text in blocks(page, "toml"):
        if all(re.search(rf"^\[{table}\]", text, re.MULTILINE) for table in needed):
            return text
    return None


RUN = [page for page in PAGES[1:] if blocks(page, "python")]
"""The README has a test of its own (`test_readme.py`)."""


def setting(page, folder):
    """Lays out what the page's snippets read: drive and study files, an archive, a study's table."""
    code = "\n".join(blocks(page, "python"))
    drive = shown(page, ("chain", "run"))
    text = drive or drive_path("marine").read_text()
    for name in set(re.findall(r'load_drive\("([\w.]+)"\)', code)):
        (folder / name).write_text(text)
    if '"marine.mcap"' in code:
        write_archive(simulate(load_drive(drive_path("marine")), duration=0.004), folder / "marine.mcap")
    for path in set(re.findall(r'"(\w+)/results\.parquet"', code)):
        study = shown(page, ("study", "design"))
        assert study, f"{page.name} reads a study that it does not show"
        values = tomllib.loads(study)
        (folder / "study.toml").write_text(re.sub(r"^duration = .*$", "duration = 0.004", study, flags=re.MULTILINE))
        assert values["study"]["drive"] == "marine"
        run_study(folder / "study.toml", folder / path)


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_the_snippets_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    setting(page, tmp_path)
    names = {}
    for code in blocks(page, "python"):
        if not any(word in code for word in ELSEWHERE):
            exec(compile(code, page.name, "exec"), names)
    shutil.rmtree(tmp_path)


def test_the_drive_of_a_page_is_a_whole_one():
    """What a page shows as a drive can be run."""
    whole = [page for page in PAGES if shown(page, ("chain", "run"))]
    assert {page.stem for page in whole} >= {"drive-file"}
    for page in whole:
        from warpchain import loads_drive

        loads_drive(shown(page, ("chain", "run")))
