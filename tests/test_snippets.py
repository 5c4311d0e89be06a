"""Copied snippets run: the Python of every page, with the drive or study that it shows, or else the marine drive."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest
from drives import example

from warpchain import run_study, simulate, write_archive
from warpchain.drive.examples import drive_path, example_names
from warpchain.errors import WarpchainError

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
ELSEWHERE = ("dask_jobqueue", "optimize(", "rig.csv")
"""What no test has: a cluster's queue, time for a whole search, the drive of another page."""


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


def setting(page, folder, drive):
    """Lays out what the page's snippets read: drive and study files, an archive, a study's table."""
    code = "\n".join(blocks(page, "python"))
    for name in set(re.findall(r'load_drive\("([\w.]+)"\)', code)):
        (folder / name).write_text(drive)
    if '"marine.mcap"' in code:
        write_archive(simulate(example("marine"), duration=0.004), folder / "marine.mcap")
    study = shown(page, ("study", "design"))
    if study:
        (folder / "study.toml").write_text(re.sub(r"^duration = .*$", "duration = 0.004", study, flags=re.MULTILINE))
        for path in set(re.findall(r'"(\w+)/results\.parquet"', code)):
            run_study(folder / "study.toml", folder / path)


def left_out(code):
    """Whether a snippet reads a table of a study that its page does not show, or needs what no test has."""
    tables = re.findall(r'"(\w+/results\.parquet)"', code)
    if "import fmpy" in code and find_spec("fmpy") is None:  # of the extra fmu
        return True
    return any(word in code for word in ELSEWHERE) or not all(Path(path).exists() for path in tables)


def shortened(code):
    """A snippet whose own simulated time is that of a test."""
    return re.sub(r"^duration = .*$", "duration = 0.008", code, flags=re.MULTILINE)


def drives_for(page):
    """The drive that the page shows; else the marine one, and then the other examples."""
    own = shown(page, ("chain", "run"))
    names = sorted(example_names(), key=lambda name: name != "marine")
    return [own] if own else [drive_path(name).read_text() for name in names]


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_the_snippets_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    """Where the page shows no whole drive, with the first example that has the parts which its snippets name."""
    *others, last = drives_for(page)
    for k, drive in enumerate([*others, last]):
        folder = tmp_path / str(k)
        folder.mkdir()
        monkeypatch.chdir(folder)
        setting(page, folder, drive)
        try:
            names = {}
            for code in blocks(page, "python"):
                if not left_out(code):
                    exec(compile(shortened(code), page.name, "exec"), names)
            return
        except (WarpchainError, IndexError):
            if drive is last:
                raise


def test_the_drive_of_a_page_is_a_whole_one():
    """What a page shows as a drive can be run."""
    whole = [page for page in PAGES if shown(page, ("chain", "run"))]
    assert {page.stem for page in whole} >= {"drive-file"}
    for page in whole:
        from warpchain import loads_drive

        loads_drive(shown(page, ("chain", "run")))
