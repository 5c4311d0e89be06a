"""The scripts can be imported, do nothing until they are run, and take the words that the documents give them."""

import ast
import re
import shlex
import sys
from pathlib import Path

import pytest
from loading import load_script

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMAND = re.compile(r"\bpython ((?:\./)?scripts/[^\s`]+)([^`\n#]*)")


def words_of(path):
    """A page, or the descriptions in a script or in a case."""
    if path.suffix == ".md":
        return path.read_text()
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Module | ast.FunctionDef)]
    return "\n".join(ast.get_docstring(node) or "" for node in nodes)


def commands():
    """Each `python scripts/X.py words` of the documents and of the scripts' own descriptions: where, script, words."""
    for page in [*PAGES, *sorted((ROOT / "scripts").rglob("*.py"))]:
        for line in words_of(page).splitlines():
            for found in COMMAND.finditer(line):
                # a line by itself is a command to its end; within a sentence, one in backquotes
                yield page.name, found[1], found[2]


FOUND = list(commands())


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_can_be_imported_and_does_nothing_then(path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(path), "--no-such-option"])  # who parses this while imported is ended
    module = load_script(path.stem)
    assert capsys.readouterr().out == ""
    assert callable(module.main)
    last = ast.parse(path.read_text()).body[-1]
    assert isinstance(last, ast.If) and ast.unparse(last.test) == "__name__ == '__main__'"
    assert "main()" in ast.unparse(last.body[0])


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_tells_what_it_is_for(path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    with pytest.raises(SystemExit) as left:
        load_script(path.stem).main()
    assert left.value.code == 0
    assert ast.get_docstring(ast.parse(path.read_text())).splitlines()[0] in capsys.readouterr().out


def test_documents_name_commands():
    """Without any the test below would pass. Every script is named, if only in its own description."""
    named = {(page, script) for page, script, _ in FOUND}
    assert {
        ("teeth.md", "scripts/figures.py"),
        ("wear.md", "scripts/figures.py"),
        ("solving.md", "scripts/figures.py"),
        ("performance.md", "scripts/bench.py"),
    } <= named
    assert {script for _, script in named} == {f"scripts/{path.name}" for path in SCRIPTS}


@pytest.mark.parametrize(("page", "script", "words"), FOUND, ids=lambda value: str(value).strip() or "alone")
def test_named_commands_are_taken(page, script, words):
    path = ROOT / script
    assert path in SCRIPTS
    # words in brackets may be left out; those in capitals stand for others
    given = [word for word in shlex.split(words) if not re.fullmatch(r"\[?[A-Z]+\]?|\.\.\.\]?", word)]
    load_script(path.stem).parser().parse_args([word.strip("[]") for word in given])


def test_words_that_a_script_does_not_know_are_refused(capsys):
    for name, words in (
        ("bench", ["gpu", "tables"]),
        ("figures", ["study", "a", "b"]),
    ):
        with pytest.raises(SystemExit) as left:
            load_script(name).parser().parse_args(words)
        assert left.value.code == 2
    assert "'tables': allowed are table, joints, rollers, car, runs, headline" in capsys.readouterr().err
