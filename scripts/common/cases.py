"""Cases that a script lists and runs: functions of a folder's modules, each with options of its own.

A case yields what is printed: a text as it stands, anything else as a row of a Markdown table, the first row its head.
"""

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpchain.errors import WarpchainError

SCRIPTS = Path(__file__).resolve().parents[1]
Option = tuple[tuple[str, ...], dict[str, Any]]
Line = str | tuple[Any, ...] | list[Any]


@dataclass(frozen=True)
class Case:
    """A function that prints lines, by the name of its command."""

    run: Callable[[argparse.Namespace], Iterable[Line] | None]
    options: tuple[Option, ...]

    @property
    def name(self) -> str:
        """The word that runs it."""
        return self.run.__name__.strip("_").replace("_", "-")

    @property
    def words(self) -> str:
        """The description."""
        return (self.run.__doc__ or "").replace("\n    ", "\n")

    def __call__(self, asked: argparse.Namespace) -> Iterable[Line]:
        return self.run(asked) or ()


def option(*names: str, **settings: Any) -> Option:
    """An option of a case, as argparse has it."""
    return names, settings


def case(*options: Option) -> Callable[[Callable[[argparse.Namespace], Iterable[Line] | None]], Case]:
    """Makes a function a case."""
    return lambda run: Case(run, options)


def cases_of(folder: str) -> Mapping[str, Case]:
    """The cases in the modules of a folder, by name."""
    found: dict[str, Case] = {}
    for name in sorted(info.name for info in pkgutil.iter_modules([str(SCRIPTS / folder)])):
        try:
            module = importlib.import_module(f"{folder}.{name}")
        except ModuleNotFoundError as error:
            if str(error.name).split(".")[0] in ("warpchain", "common", folder):
                raise
            print(f"{folder}/{name}.py is left out: {error}", file=sys.stderr)  # a machine may have less installed
            continue
        found |= {one.name: one for one in vars(module).values() if isinstance(one, Case)}
    return found


def parser_of(words: str | None, cases: Mapping[str, Case]) -> argparse.ArgumentParser:
    """The command line: a case and its options."""
    shape: Any = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    made = argparse.ArgumentParser(description=words, **shape)
    below = made.add_subparsers(dest="case", metavar="CASE")
    for name, one in cases.items():
        brief = one.words.splitlines()[0].replace("%", "%%")
        inner = below.add_parser(name, help=brief, description=one.words, **shape)
        for names, settings in one.options:
            inner.add_argument(*names, **settings)
    return made


def listed(cases: Mapping[str, Case]) -> Iterator[str]:
    """A line for each case."""
    width = max(map(len, cases))
    yield from (f"{name:{width}}  {one.words.splitlines()[0]}" for name, one in cases.items())


def cell(value: object) -> str:
    """A table's cell: four digits of a number that is not whole."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def show(lines: Iterable[Line]) -> None:
    """Prints a case's lines as they come."""
    head = True
    for line in lines:
        if isinstance(line, str):
            print(line, flush=True)
        else:
            rule = "\n|" + "---|" * len(line) if head else ""
            print(f"| {' | '.join(map(cell, line))} |{rule}", flush=True)
        head = isinstance(line, str)


def run(words: str | None, cases: Mapping[str, Case], before: Callable[[], Iterable[Line]] = tuple) -> None:
    """Runs the case that the command line names, after the lines `before`; without a name it lists them."""
    asked = parser_of(words, cases).parse_args()
    if asked.case is None:
        show(listed(cases))
        sys.exit(0)
    show(before())
    try:
        show(cases[asked.case](asked))
    except WarpchainError as error:
        sys.exit(str(error))
