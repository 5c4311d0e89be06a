"""The README's example prints what stands there; links, paths and names in the documents lead somewhere."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from warpchain.archive.archive_format import END_METADATA, MESSAGE_FIELDS

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").glob("*.md")), ROOT / "CONTRIBUTING.md"]


def test_example_prints_what_it_says(capsys, tmp_path, monkeypatch):
    text = README.read_text()
    code, printed = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", text, re.S).groups()
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    lines = [line for line in capsys.readouterr().out.splitlines() if re.fullmatch(r"[\d. ]+", line)]
    found, said = (np.array([line.split() for line in part], dtype=float) for part in (lines, printed.split("\n")[:3]))
    np.testing.assert_allclose(found[:, 0], said[:, 0])
    # copies 1e-9 apart agree to 1e-6; 1e-3 leaves room for other machines' compilers, and for what rounds tables
    np.testing.assert_allclose(found[:, 1:], said[:, 1:], rtol=1e-3)
    assert (tmp_path / "torques.mcap").exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def paths(text):
    """Paths within the tree that a document names, and names of files alone in backquotes."""
    found = re.findall(r"(?<![\w/.-])(?:warpchain|kernels|scripts|tests)/[\w/.*-]*[\w/]", text)
    return found, re.findall(r"`(\w+\.(?:py|c|cu))`", text)


def resolves(name):
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def names(text):
    """Dotted names of the package that a document gives in backquotes or imports; not those within archives."""
    within = (*MESSAGE_FIELDS, END_METADATA)
    found = [word for span in re.findall(r"`([^`\n]+)`", text) for word in re.findall(r"\bwarpchain(?:\.\w+)+", span)]
    for module, members in re.findall(r"^ *from (warpchain[\w.]*) import (.+)$", text, re.M):
        found += [f"{module}.{member.strip()}" for member in members.split("#")[0].split(",")]
    return [name for name in found if not any(f"{name}.".startswith(f"{other}.") for other in within)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_paths_lead_to_files(page):
    whole, alone = paths(page.read_text())
    homes = (ROOT, ROOT / "tests")  # docs/reliability.md names tests by their place there
    assert not [path for path in whole if not any(any(home.glob(path.rstrip("/"))) for home in homes)]
    assert not [name for name in alone if not any(any((ROOT / top).rglob(name)) for top in ("warpchain", "kernels"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_of_the_package_resolve(page):
    assert not [name for name in names(page.read_text()) if not resolves(name)]


def test_paths_and_names_that_lead_nowhere_would_be_found():
    text = """See `warpchain/laws.py`, kernels/*.py and `gone.py`; `python scripts/test x`, out/scripts/no.py.
    `warpchain.simulate(drives)` and `warpchain.gone.more(1)`, `warpchain.State.time`
    from warpchain.drive import load_drive, lode_drive  # two
    """
    assert paths(text) == (["warpchain/laws.py", "kernels/*.py", "scripts/test"], ["gone.py"])
    assert [name for name in names(text) if not resolves(name)] == ["warpchain.gone.more", "warpchain.drive.lode_drive"]
    assert "warpchain.simulate" in names(text) and not any("State" in name for name in names(text))
