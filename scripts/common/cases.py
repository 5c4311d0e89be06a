"""Cases that a script lists and runs: functions of a folder's modules, each with options of its own.

A case yields what is shown: a text as it stands, figures by name, which are saved as files, anything else as a row of a
Markdown table, the first row its head.
"""

import argparse
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpchain.errors import WarpchainError

SCRIPTS = Path(__file__).resolve().parents[1]
ROOT = SCRIPTS.parent
Option = tuple[tuple[str, ...], dict[str, Any]]
Line = str | Mapping[str, Any] | tuple[Any, ...]


@dataclass(frozen=True)
class Case:
    """A function that gives lines, and its options."""

    run: Callable[[argparse.Namespace], Iterable[Line]]
    options: tuple[Option, ...]


def case_option(*names: str, **settings: Any) -> Option:
    """An option of a case, as argparse takes it."""
    return names, settings


def case(*options: Option) -> Callable[[Callable[[argparse.Namespace], Iterable[Line]]], Case]:
    """Decorator: makes a function a case that a script lists and runs."""
    return lambda run: Case(run, options)


def described_parser(words: str | None) -> argparse.ArgumentParser:
    """An argument parser whose help is a script's description as it is."""
    return argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)


def cases_of(folder: str) -> dict[str, Case]:
    """The cases in the modules of a folder, by name."""
    names = sorted(info.name for info in pkgutil.iter_modules([str(SCRIPTS / folder)]))
    modules = [importlib.import_module(f"{folder}.{name}") for name in names]
    held = [one for module in modules for one in vars(module).values() if isinstance(one, Case)]
    return {one.run.__name__.replace("_", "-"): one for one in held}


def cases_parser(words: str | None, cases: Mapping[str, Case]) -> argparse.ArgumentParser:
    """The argument parser of a script's cases, each with its options."""
    made = described_parser(words)
    below = made.add_subparsers(dest="case", metavar="CASE")
    for name, one in cases.items():
        text = inspect.getdoc(one.run) or ""
        brief = text.splitlines()[0].replace("%", "%%")
        inner = below.add_parser(name, help=brief, description=text, formatter_class=made.formatter_class)
        for names, settings in one.options:
            inner.add_argument(*names, **settings)
        inner.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "images", help="folder of figures")
    return made


def table_head(words: str) -> tuple[str, ...]:
    """Cells of a table's head from a row of Markdown."""
    return tuple(words.split(" | "))


def cell_text(value: object) -> str:
    """A table's cell as text, to four digits of a number that is not whole."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def print_lines(lines: Iterable[Line], folder: Path) -> None:
    """Prints a case's lines as they come, and saves its figures to a folder."""
    first = True
    for line in lines:
        if isinstance(line, Mapping):
            from warpchain.view.figures.figure_style import save_figures

            print(*save_figures(line, folder, "png"), sep="\n", flush=True)
        elif isinstance(line, str):
            print(line, flush=True)
        else:
            rule = "\n|" + "---|" * len(line) if first else ""
            print(f"| {' | '.join(map(cell_text, line))} |{rule}", flush=True)
        first = not isinstance(line, tuple)


def run_case(words: str | None, cases: Mapping[str, Case], before: Callable[[], Iterable[Line]] = tuple) -> None:
    """Runs the case that the command line names, after the lines `before`; without a name lists all cases."""
    made = cases_parser(words, cases)
    asked = made.parse_args()
    if asked.case is None:
        made.print_help()
        return
    try:
        print_lines(before(), asked.output)
        print_lines(cases[asked.case].run(asked), asked.output)
    except WarpchainError as error:
        sys.exit(str(error))
