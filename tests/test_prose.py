"""The linter of prose finds what it is for, and nothing in formulas, code and names of pages."""

from pathlib import Path

import pytest
from loading import load_script

pytest.importorskip("proselint")
pytest.importorskip("markdown_it")

WORDS = "One chain runs over two sprockets of nineteen teeth each"  # ten words


def found(path):
    """Line and rule of each fault of a page."""
    for fault in load_script("pages.lint").page_faults(path):
        line, rule = fault.removeprefix(f"{path}:").split(": ")[:2]
        yield int(line), rule


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (f"{WORDS}, {WORDS},\n{WORDS}.", []),
        (f"{WORDS}, {WORDS},\n{WORDS}: 1 to 2, 3, 4.5 and 67.", [(1, "house.sentences")]),
        (f"{WORDS}, {WORDS}\n{WORDS}: 1, 2, 3, 4.5, 67.", []),
        (f"Short.\n\nShort. {WORDS}, {WORDS},\n{WORDS} again.", [(3, "house.sentences")]),
        (f"| a | b |\n|---|---|\n| 1 | {WORDS} {WORDS} {WORDS} again |", [(3, "house.sentences")]),
        ("- one\n- it is told (twice)", [(2, "house.words")]),
        ("## What it does\n\nWhat it does is so.", [(1, "headings")]),
        ("A word\n(of mine (or yours)).", [(2, "house.parentheses")]),
        ("The teeth of of it.", [(1, "lexical_illusions")]),
        ("A force K p (1 + 8/5 (1 - e)/e v), up to 1 000 000 times.", []),
        (f"`told`, [{WORDS} {WORDS}](x.md), [{WORDS} {WORDS}](y.md)\n\n    anew\n\n```\ntold\n```", []),
    ],
)
def test_faults_are_found_where_they_are(tmp_path, text, faults):
    page = tmp_path / "page.md"
    page.write_text(text)
    assert list(found(page)) == faults


def test_a_page_too_long_is_found(tmp_path):
    """By its words, of which code has none; a list of all keys may be longer."""
    whole = f"{WORDS}.\n\n" * 250
    for name, text, faults in (
        ("page.md", whole, []),
        ("page.md", f"{whole}One more.", [(1, "house.pages")]),
        ("page.md", f"{whole}\n\n    one more\n", []),
        ("drive-file.md", whole * 2, []),
    ):
        (tmp_path / name).write_text(text)
        assert list(found(tmp_path / name)) == faults


def test_pages_lead_to_the_glossary():
    """Those on which its words stand; it says each in a line."""
    docs = Path(__file__).resolve().parent.parent / "docs"
    for name in ("drive-file", "check", "studies", "analysis", "metrics", "judged-runs", "model", "examples", "report"):
        assert "](glossary.md" in (docs / f"{name}.md").read_text(), name
    for name in ("own-drive", "first-study"):
        assert "](../glossary.md" in (docs / "tutorials" / f"{name}.md").read_text(), name


def test_cells_of_notebooks_are_read(tmp_path):
    import nbformat.v4 as book

    page = tmp_path / "page.ipynb"
    page.write_text(book.writes(book.new_notebook(cells=[book.new_code_cell("told"), book.new_markdown_cell("told")])))
    assert [fault.split(": ")[0] for fault in load_script("pages.lint").page_faults(page)] == [f"{page}, cell 2:1"]
