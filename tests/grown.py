"""The package with lines put in, in a folder and a process of its own: what it takes to extend it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import warpchain

ROOT = Path(warpchain.__file__).resolve().parent


def grown(folder, lines):
    """A copy of the package and its kernels in which lines follow others.

    Args:
        lines: {path: {line that stands there once: line that is to follow it}}.
    """
    for part in ("warpchain", "kernels"):
        source = ROOT if part == "warpchain" else ROOT.parent / part
        shutil.copytree(source, folder / part, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for path, pairs in lines.items():
        text = (folder / path).read_text()
        for before, added in pairs.items():
            assert text.count(before + "\n") == 1, before
            indent = next(line for line in text.splitlines() if line.endswith(before.strip()))
            indent = indent[: len(indent) - len(indent.lstrip())]
            text = text.replace(before + "\n", f"{before}\n{indent}{added}\n")
        (folder / path).write_text(text)
    return folder


def run_in(folder, code, *words):
    """Runs Python code with the package of a folder; what it prints."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout
