"""The command `warpchain study report`."""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any

from warpchain.errors import StudyError

TABLES = ("results.parquet", "results.csv")
"""Where a study's folder keeps its table."""


def add_command(commands: Any) -> None:
    """Adds the command to the subparsers of `warpchain study`."""
    text = "write a study's report as one HTML page"
    parser = commands.add_parser(
        "report",
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog="example:\n  warpchain study report DIR -o report.html --minimize tension_max --minimize tension_std",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("study", metavar="DIR", type=Path, help="a study's folder, or its table (.parquet, .csv)")
    parser.add_argument("-o", "--output", metavar="report.html", type=Path, required=True, help="the page to write")
    parser.add_argument("--title", help="heading of the page")
    for name, words in (
        ("--factor", "a column that was varied; default those that the table marks"),
        ("--metric", "a metric to show; default the telling ones"),
        ("--minimize", "an objective of the Pareto front, low is good"),
        ("--maximize", "an objective of the Pareto front, high is good"),
    ):
        parser.add_argument(name, metavar="NAME", action="append", default=[], help=f"{words} (repeatable)")
    parser.add_argument("--table", metavar="FILE", type=Path, help="also write the table, as .csv or .parquet")
    parser.set_defaults(run=report, study_run=report)


def report(arguments: argparse.Namespace) -> int:
    """Body of the command."""
    from warpchain.study.report import write_report
    from warpchain.study.results import export_table, read_results

    path = table_path(arguments.study)
    results = read_results(path, arguments.factor or None)
    objectives = dict.fromkeys(arguments.minimize, "min") | dict.fromkeys(arguments.maximize, "max")
    notes = about(path.parent)
    title = arguments.title or notes.pop("name", None) or arguments.study.resolve().stem
    page = write_report(
        results, arguments.output, title, metrics=tuple(arguments.metric), objectives=objectives or None, notes=notes
    )
    print(page)
    if arguments.table is not None:
        print(export_table(results.table, arguments.table))
    return 0


def table_path(source: Path) -> Path:
    """The table that a study's folder holds, or the file itself.

    Raises:
        StudyError: a folder without a table.
    """
    if not source.is_dir():
        return source
    for name in TABLES:
        if (source / name).is_file():
            return source / name
    raise StudyError(f"{source}: holds no {TABLES[0]} yet; make it with: warpchain study merge {source}")


def about(folder: Path) -> dict[str, str]:
    """What a study's folder says of itself, in words: its name, design and run settings; nothing where it says none."""
    try:
        study = tomllib.loads((folder / "study.toml").read_text())
    except (OSError, ValueError):
        return {}
    found = {key: str(value) for key, value in study.get("study", {}).items() if key == "name"}
    for key in ("design", "run", "adjust"):
        if study.get(key):
            found[key] = ", ".join(f"{name} = {value}" for name, value in study[key].items())
    for number, constraint in enumerate(study.get("constraints", ())):
        found[f"constraint {number + 1}"] = str(constraint.get("require", ""))
    return found
