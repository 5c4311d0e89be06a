"""Recipes of CONTRIBUTING.md, followed in a copy of the package, in a folder and a process of its own."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import warpchain

ROOT = Path(warpchain.__file__).resolve().parent
TESTS = Path(__file__).resolve().parent
CONTRIBUTING = TESTS.parent / "CONTRIBUTING.md"


def recipe(title):
    """The changes in the section of CONTRIBUTING.md with this title.

    Each is (path, lines that stand there once, lines that a `diff` block puts in their place); @@ begins another one.
    """
    section = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", CONTRIBUTING.read_text(), re.M | re.S).group(1)
    found, path = [], ""
    for block in re.findall(r"^```diff\n(.*?)^```", section, re.M | re.S):
        for part in re.split(r"^(?=\+\+\+ )|^@@\n", block, flags=re.M):
            lines = part.splitlines(keepends=True)
            if lines and lines[0].startswith("+++ "):
                path = lines.pop(0)[4:].strip()
            if lines:
                old, new = ("".join(line[1:] for line in lines if line[0] in kept) for kept in (" -", " +"))
                found.append((path, old, new))
    return found


def recipe_code(title, name, **names):
    """The function `name` that a recipe adds, given the names that it uses."""
    code = next(new for _, _, new in recipe(title) if f"def {name}(" in new)
    exec(
        compile(re.search(rf"^def {name}\(.*?(?=^\S|\Z)", code, re.M | re.S).group(0), CONTRIBUTING.name, "exec"), names
    )
    return names[name]


def grown(folder, changes):
    """A copy of the package, its kernels and tests with changes as from `recipe`."""
    for part in ("warpchain", "kernels", "tests"):
        source = ROOT if part == "warpchain" else TESTS if part == "tests" else ROOT.parent / part
        shutil.copytree(source, folder / part, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for path, old, new in changes:
        text = (folder / path).read_text()
        assert text.count(old) == 1, (path, old)
        (folder / path).write_text(text.replace(old, new))
    return folder


def followed(folder, title, paths):
    """A copy of the package with the changes of a recipe, which are in these files, in this order."""
    changes = recipe(title)
    assert [path for path, _, _ in changes] == paths
    return grown(folder, changes)


def run_in(folder, code, *words):
    """Runs Python code, or a module if it is named with -m, with the package of a folder; what it prints."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(folder), str(folder / "tests")))}
    command = [sys.executable, *(code.split() if code.startswith("-m ") else ("-c", code)), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
