"""The commands `warpchain study report | view`: options and bodies."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.arguments import add_command, woehler_curve
from warpchain.errors import StudyError, WarpchainError
from warpchain.files import read_text

if TYPE_CHECKING:
    from warpchain.study.results import Results

TABLES = ("results.parquet", "results.csv")
"""Where a study's folder keeps its table."""


def add_report_commands(commands: Any) -> None:
    """Adds the commands to the subparsers of `warpchain study`; each sets `study_run`, the function that does it."""
    page = _add(commands, "report", report, "write a study's report as one HTML page", "DIR -o report.html")
    page.add_argument("-o", "--output", metavar="report.html", type=Path, required=True, help="the page to write")
    page.add_argument("--title", help="heading of the page")
    page.add_argument("--recorded", action="store_true", help="with the objectives of recorded variants")
    page.add_argument(
        "--fatigue",
        metavar="M,RANGE,CYCLES",
        type=woehler_curve,
        help="with their fatigue too: Woehler exponent, and the range [N] that a link endures for so many cycles",
    )
    page.add_argument("--table", metavar="FILE", type=Path, help="also write the table, as .csv or .parquet")

    scatter = _add(
        commands, "view", view, "show a study in Rerun, beside its recorded variants", "DIR --save study.rrd"
    )
    scatter.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    scatter.add_argument("--variant", metavar="I", type=int, action="append", help="a recorded variant (repeatable)")


def _add(commands: Any, name: str, run: Callable[[argparse.Namespace], int], text: str, example: str) -> Any:
    line = f"warpchain study {name} {example} --minimize tension_max --minimize tension_std"
    parser = add_command(commands, name, text, line)
    parser.add_argument("study", metavar="DIR", type=Path, help="a study's folder, or its table (.parquet, .csv)")
    for option, words in (
        ("--factor", "a column that was varied; default those that the table marks"),
        ("--metric", "a metric to show; default the telling ones"),
        ("--minimize", "an objective of the Pareto front, low is good"),
        ("--maximize", "an objective of the Pareto front, high is good"),
    ):
        parser.add_argument(option, metavar="NAME", action="append", default=[], help=f"{words} (repeatable)")
    parser.set_defaults(study_run=run)
    return parser


def report(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study report`."""
    from warpchain.study.report import write_report
    from warpchain.study.results import export_table

    path, results = _read(arguments)
    notes = about(path.parent)
    if arguments.recorded or arguments.fatigue is not None:
        from warpchain.results.fatigue import Woehler
        from warpchain.study.run.recordings import with_recorded_objectives

        curve = None if arguments.fatigue is None else Woehler(*arguments.fatigue)
        results = with_recorded_objectives(results, path.parent, curve)
    title = arguments.title or notes.pop("name", None) or arguments.study.resolve().stem
    page = write_report(
        results,
        arguments.output,
        title,
        metrics=tuple(arguments.metric),
        objectives=_objectives(arguments),
        notes=notes,
        wanted=_wanted(arguments.study),
    )
    print(page)
    if arguments.table is not None:
        print(export_table(results.table, arguments.table))
    return 0


def view(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study view`."""
    from warpchain.study.report.scatters import view_study
    from warpchain.study.run.recordings import recorded_variants

    path, results = _read(arguments)
    asked = arguments.variant is not None
    recorded = (
        recorded_variants(results, path.parent, arguments.variant, worst_of(path.parent))
        if asked or "archive" in results.table.column_names
        else None
    )
    view_study(results, recorded, arguments.factor, arguments.metric, _objectives(arguments), arguments.save)
    return 0


def _read(arguments: argparse.Namespace) -> tuple[Path, Results]:
    from warpchain.study.results import read_results

    path = table_path(arguments.study)
    return path, read_results(path, arguments.factor or None)


def _wanted(source: Path) -> Any:
    """What the study in a folder wants, and the folder as it is named; None of a table alone."""
    from warpchain.study.report.decisions import Wanted
    from warpchain.study.spec import load_study
    from warpchain.view.chosen import NEEDED

    if not source.is_dir():
        return None
    try:
        study = load_study(source / "study.toml")
    except StudyError:
        return None  # a table in a folder without its study
    most = study.optimize.recommend if study.optimize is not None else Wanted.most
    played = set(NEEDED) <= set(study.record.channels)
    return Wanted(study.objectives, study.bounds, str(source), most, played)


def _objectives(arguments: argparse.Namespace) -> dict[str, str] | None:
    found = dict.fromkeys(arguments.minimize, "min") | dict.fromkeys(arguments.maximize, "max")
    return found or None


def table_path(source: Path) -> Path:
    """The table that a study's folder holds, or the file itself.

    Raises:
        StudyError: a folder without a table. An unfinished study's is made of what is done (`partial.parquet`).
    """
    if not source.is_dir():
        return source
    for name in TABLES:
        if (source / name).is_file():
            return source / name
    if (source / "plan.json").is_file():
        from warpchain.study.run.merge import partial_table

        return partial_table(source)
    raise StudyError(f"{source}: holds no {TABLES[0]} yet; make it with: warpchain study merge {source}")


def worst_of(folder: Path) -> Any:
    """What a study's folder calls the worst variants; None where it does not say."""
    from warpchain.study.run.folder import open_folder

    try:
        return open_folder(folder).study.record.worst
    except WarpchainError:
        return None


def about(folder: Path) -> dict[str, str]:
    """What a study's folder says of itself, in words: its name, design and run settings; nothing where it says none."""
    try:
        study = tomllib.loads(read_text(folder / "study.toml", "TOML", StudyError))
    except (StudyError, ValueError):
        return {}
    found = {key: str(value) for key, value in study.get("study", {}).items() if key == "name"}
    for key in ("design", "run", "adjust"):
        if study.get(key):
            found[key] = ", ".join(f"{name} = {value}" for name, value in study[key].items())
    for number, constraint in enumerate(study.get("constraints", ())):
        found[f"constraint {number + 1}"] = str(constraint.get("require", ""))
    return found
