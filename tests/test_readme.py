"""The README's example prints what stands there, and its links lead somewhere."""

import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).resolve().parent.parent / "README.md"


def test_example_prints_what_it_says(capsys, tmp_path, monkeypatch):
    text = README.read_text()
    code, printed = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", text, re.S).groups()
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    lines = [line for line in capsys.readouterr().out.splitlines() if re.fullmatch(r"[\d. ]+", line)]
    found, said = (np.array([line.split() for line in part], dtype=float) for part in (lines, printed.split("\n")[:3]))
    np.testing.assert_allclose(found[:, 0], said[:, 0])
    # chaotic motion: a mean over one second of it differs by some per cent between machines; the moment is the load's
    np.testing.assert_allclose(found[:, 1], said[:, 1], rtol=0.15)
    np.testing.assert_allclose(found[:, 2], said[:, 2], rtol=0.02)
    assert (tmp_path / "torques.mcap").exists()


@pytest.mark.parametrize(
    "page", [README, *sorted((README.parent / "docs").glob("*.md")), README.parent / "CONTRIBUTING.md"]
)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target
