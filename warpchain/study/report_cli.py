"""The command `warpchain study report`."""

from __future__ import annotations

import argparse
from pathlib import Path

from warpchain.errors import StudyError

TABLES = ("results.parquet", "results.csv")
"""Where a study's folder keeps its table."""


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
    raise StudyError(f"{source}: holds no {TABLES[0]}; finish the study with: warpchain study run")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("study", metavar="DIR", type=Path, help="a study's folder, or its table (.parquet, .csv)")
    parser.add_argument("-o", "--output", metavar="report.html", type=Path, required=True, help="the page to write")
    parser.add_argument("--title", help="heading of the page")
    for name, text in (
        ("--factor", "a column that was varied; default those that the table marks"),
        ("--metric", "a metric to show; default the telling ones"),
        ("--minimize", "an objective of the Pareto front, low is good"),
        ("--maximize", "an objective of the Pareto front, high is good"),
    ):
        parser.add_argument(name, metavar="NAME", action="append", default=[], help=f"{text} (repeatable)")
    parser.add_argument("--table", metavar="FILE", type=Path, help="also write the table, as .csv or .parquet")


def report(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study report`."""
    from warpchain.study.report import write_report
    from warpchain.study.results import export_table, read_results

    path = table_path(arguments.study)
    results = read_results(path, arguments.factor or None)
    objectives = dict.fromkeys(arguments.minimize, "min") | dict.fromkeys(arguments.maximize, "max")
    title = arguments.title or (arguments.study.resolve().name if arguments.study.is_dir() else path.stem)
    print(write_report(results, arguments.output, title, (), tuple(arguments.metric), objectives or None))
    if arguments.table is not None:
        print(export_table(results.table, arguments.table))
    return 0
