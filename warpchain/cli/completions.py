"""Shell completion of the command line, by shtab: a script made once, so that no key starts Python."""

from __future__ import annotations

import argparse
from pathlib import Path

from warpchain.errors import WarpchainError


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that makes a shell complete a parser's commands, options and file names.

    Raises:
        WarpchainError: without the package shtab.
    """
    try:
        import shtab
    except ImportError:
        raise WarpchainError('--completions: needs the package shtab: pip install "warpchain[completions]"') from None
    _mark(parser, {"DIR": shtab.DIRECTORY}, shtab.FILE)
    return str(shtab.complete(parser, shell))


def _mark(parser: argparse.ArgumentParser, folders: dict[str, object], file: object) -> None:
    """Marks the arguments of a parser and of those below it that are files or folders."""
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for inner in action.choices.values():
                _mark(inner, folders, file)
        elif action.type is Path or action.metavar == "DRIVE":
            action.complete = folders.get(str(action.metavar), file)  # type: ignore[attr-defined]
