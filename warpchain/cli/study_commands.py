"""The commands `warpchain study run | plan | grow | status | merge | report | view | play`."""

from __future__ import annotations

import argparse
import shlex
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.commands import DONE, UNFINISHED, resumable_command
from warpchain.cli.shared_options import (
    CommandBody,
    add_command,
    add_run_options,
    add_shared_options,
    page_path_from_word,
    precision_from_word,
    run_options_from_arguments,
    shard_part_from_word,
    whole_number_from_word,
    woehler_curve_from_word,
)
from warpchain.errors import StudyError
from warpchain.files import read_text_file
from warpchain.progress import duration_text

if TYPE_CHECKING:
    from warpchain.study.results import Results

SHARDS_A_WORKER = 2
TABLE_NAMES = ("results.parquet", "results.csv")


def add_study_commands(commands: Any) -> None:
    """Adds `warpchain study run | plan | grow | status | merge` to the command line."""
    text, line = "run a study, or go on with it", "warpchain study run STUDY.toml -o DIR"
    run = add_command(commands, "run", study_run_command, text, line)
    run.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    run.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="the study's folder")
    run.add_argument(
        "--shard", metavar="I/N", type=shard_part_from_word, help="only every N-th shard from the I-th, I from 0"
    )
    run.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://10.0.0.1:8786")
    run.add_argument(
        "--grow",
        action="store_true",
        help="add to a folder of the same study more points, replicates or another window",
    )
    add_run_options(run)

    text = "forecast a study's rows, cost and precision, without running it"
    plan = add_command(commands, "plan", study_plan_command, text, "warpchain study plan STUDY.toml")
    plan.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    plan.add_argument(
        "--like", metavar="DIR", type=Path, help="an earlier study with replicates, or its table: how runs scatter"
    )
    plan.add_argument(
        "--precision",
        metavar="METRIC=VALUE",
        action="append",
        default=[],
        type=precision_from_word,
        help="how many replicates, or how long a window, knowing a metric to +-VALUE takes (repeatable; with --like)",
    )
    plan.add_argument(
        "--metric",
        metavar="NAME",
        action="append",
        default=[],
        help="a metric whose precision to forecast; default all, the noisiest first",
    )
    plan.add_argument(
        "--stored", action="store_true", help="take stored rates, without the short runs that measure them"
    )

    text = "double a study until its main effects are known well enough"
    grow = add_command(
        commands, "grow", study_grow_command, text, "warpchain study grow DIR --until 'se(main effects) < 1 %%'"
    )
    grow.add_argument("folder", metavar="DIR", type=Path, help="the study's folder")
    grow.add_argument(
        "--until",
        metavar="CONDITION",
        required=True,
        help="'se(main effects) < 1 %%' of each metric's mean, or 'se(main effects of METRIC) < VALUE'",
    )
    grow.add_argument(
        "--most", metavar="ROWS", type=whole_number_from_word, default=10_000, help="rows at most (default 10000)"
    )
    add_run_options(grow)

    status = add_command(
        commands, "status", study_status_command, "print how far a study is", "warpchain study status DIR"
    )
    status.add_argument("folder", metavar="DIR", type=Path, help="the study's folder")

    text = "make the whole table of a study whose shards are done, or one study of several"
    merge = add_command(commands, "merge", study_merge_command, text, "warpchain study merge DIR")
    merge.add_argument("folder", metavar="DIR", type=Path, nargs="+", help="the study's folder, or several")
    merge.add_argument("-o", "--output", metavar="DIR", type=Path, help="folder to make of several, which stay")

    for parser in (plan, merge):
        add_shared_options(parser, "--workers", "--memory")


@resumable_command("the shards that are done are")
def study_run_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study run`: runs a study or goes on with it."""
    from warpchain.study.run import run_study

    with _study_executor(arguments.scheduler) as (executor, parts):
        outcome = run_study(
            arguments.study,
            arguments.output,
            executor=executor,
            part=arguments.shard,
            parts=parts,
            grow=arguments.grow,
            **run_options_from_arguments(arguments) | {"progress": not arguments.quiet},
        )
    status = _print_study_status(outcome)
    return status if outcome.left or outcome.counts["ok"] else UNFINISHED


@contextmanager
def _study_executor(scheduler: str | None) -> Iterator[tuple[Any, int]]:
    """Context with the executor that runs a study, or None, and its least number of shards."""
    if scheduler is None:
        yield None, 1
        return
    from warpchain.study.run.runner import dask_executor

    with dask_executor(scheduler) as (executor, workers):
        yield executor, max(1, SHARDS_A_WORKER * workers)


def study_plan_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study plan`: forecasts a study's cost and precision."""
    from warpchain.engine import start_warp
    from warpchain.study.forecast import forecast_lines, forecast_study

    start_warp(precompiled=False)
    wanted = dict(arguments.precision)
    metrics = tuple(dict.fromkeys([*arguments.metric, *wanted]))
    if wanted and arguments.like is None:
        raise StudyError("--precision: needs --like, an earlier study with replicates that tells how runs scatter")
    plan = forecast_study(
        arguments.study,
        like=arguments.like,
        metrics=metrics,
        calibrate=not arguments.stored,
        workers=arguments.workers,
        memory=arguments.memory,
    )
    for line in forecast_lines(plan, wanted):
        print(line)
    return DONE


@resumable_command("the shards that are done are")
def study_grow_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study grow`: doubles a study until its main effects are known."""
    from warpchain.study.analysis.left_out import LeftOut
    from warpchain.study.grow_until import GrowthState, Until, grow_until
    from warpchain.study.results import read_results

    until = Until.of(arguments.until)

    def print_growth(now: GrowthState) -> None:
        """Prints how far a study's growth is."""
        if not arguments.quiet:
            of = f" ({now.metric} over {now.factor})" if now.factor else ""
            print(f"{now.rows} variants: largest standard error of main effects {until.error_text(now.error)}{of}")

    found = grow_until(
        arguments.folder, until, most=arguments.most, report=print_growth, **run_options_from_arguments(arguments)
    )
    if not found.done:
        print(f"not reached: twice as many rows would be more than --most {arguments.most}")
    for line in LeftOut(read_results(arguments.folder / TABLE_NAMES[0])).lines():
        print(line)
    print(f"design.count is {found.count} now; table: {arguments.folder / TABLE_NAMES[0]}")
    return DONE if found.done else UNFINISHED


def study_status_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study status`: prints how far a study is."""
    from warpchain.study.run import study_status

    return _print_study_status(study_status(arguments.folder))


def study_merge_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study merge`: makes one table, or one study of several."""
    from warpchain.engine import start_warp
    from warpchain.study.run import join_studies, merge_study

    folders, output = arguments.folder, arguments.output
    options = {"workers": arguments.workers, "memory": arguments.memory}
    if (len(folders) > 1) != (output is not None):
        raise StudyError("merge: give one folder, or several and -o, the folder to make of them")
    start_warp(precompiled=False)
    if output is None:
        return _print_study_status(merge_study(folders[0], **options))
    joined = join_studies(folders, output, **options)
    rows = " + ".join(map(str, joined.rows))
    print(f"{rows} rows, {joined.together} of them different; which became which: {joined.mapping}")
    status = _print_study_status(joined.outcome)
    if joined.outcome.left:
        print(f"run what none of them had: warpchain study run {output}/study.toml -o {output}")
    return status


def _print_study_status(outcome: Any) -> int:
    """Prints how far a study is; returns the exit status."""
    from warpchain.results.statuses import reason_of_count

    done, count = outcome.shards
    counts = ", ".join(f"{number} {status}" for status, number in outcome.counts.items())
    print(f"{done} of {count} shards are done; variants: {counts}")
    for reason, number in outcome.reasons:
        print(f"  {reason_of_count(number, reason)}")
    if outcome.went_on is not None:
        on, anew = outcome.went_on
        print(f"of longer runs, {on} continued from the end of shorter ones, {anew} started again")
    if outcome.left and outcome.rate is not None:
        left = duration_text(outcome.left / outcome.rate)
        print(f"{outcome.left} variants are left; at the latest {outcome.rate:.3g} variants/s they take {left}")
    if outcome.table is not None:
        print(f"table: {outcome.table}")
    elif done == count:
        print(f"make the whole table with: warpchain study merge {outcome.folder}")
    return DONE


def add_report_commands(commands: Any) -> None:
    """Adds `warpchain study report | view` to the command line."""
    page = _add_table_command(
        commands, "report", study_report_command, "write a study's report as one HTML page", "DIR -o report.html"
    )
    page.add_argument(
        "-o", "--output", metavar="report.html", type=page_path_from_word, required=True, help="the page to write"
    )
    page.add_argument("--title", help="heading of the page")
    page.add_argument("--recorded", action="store_true", help="with the objectives of recorded variants")
    page.add_argument(
        "--fatigue",
        metavar="M,RANGE,CYCLES",
        type=woehler_curve_from_word,
        help="with their fatigue too: Woehler exponent, and the range [N] that a link endures for so many cycles",
    )
    page.add_argument("--table", metavar="FILE", type=Path, help="also write the table, as .csv or .parquet")

    scatter = _add_table_command(
        commands,
        "view",
        study_view_command,
        "show a study in Rerun, beside its recorded variants",
        "DIR --save study.rrd",
    )
    scatter.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    scatter.add_argument("--variant", metavar="I", type=int, action="append", help="a recorded variant (repeatable)")


def _add_table_command(commands: Any, name: str, run: CommandBody, text: str, example: str) -> Any:
    """Adds a command on a study's table; returns its parser."""
    line = f"warpchain study {name} {example} --minimize tension_max --minimize tension_std"
    parser = add_command(commands, name, run, text, line)
    parser.add_argument("study", metavar="DIR", type=Path, help="a study's folder, or its table (.parquet, .csv)")
    for option, words in (
        ("--factor", "a column that was varied; default those that the table marks"),
        ("--metric", "a metric to show; default the telling ones"),
        ("--minimize", "an objective of the Pareto front, low is good"),
        ("--maximize", "an objective of the Pareto front, high is good"),
    ):
        parser.add_argument(option, metavar="NAME", action="append", default=[], help=f"{words} (repeatable)")
    return parser


def study_report_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study report`: writes a study's report."""
    from warpchain.study.report import write_report
    from warpchain.study.results import export_table

    path, results = _read_study_table(arguments)
    if arguments.study.is_dir() and results.search_target == "failures":
        return _write_risk_report(arguments, results)
    notes = study_setting_words(path.parent)
    if arguments.recorded or arguments.fatigue is not None:
        from warpchain.results.fatigue import Woehler
        from warpchain.study.run.recordings import results_with_objectives

        curve = None if arguments.fatigue is None else Woehler(*arguments.fatigue)
        results = results_with_objectives(results, path.parent, curve)
    title = arguments.title or notes.pop("name", None) or arguments.study.resolve().stem
    files = write_report(
        results,
        arguments.output,
        title,
        metrics=tuple(arguments.metric),
        objectives=_asked_objectives(arguments),
        notes=notes,
        wanted=_wanted_of_folder(arguments.study),
    )
    for file in files:
        print(file)
    if arguments.table is not None:
        print(export_table(results.table, arguments.table))
    return 0


def _write_risk_report(arguments: argparse.Namespace, results: Results) -> int:
    """Writes the report of a `warpchain risk` study; returns the exit status."""
    from warpchain.study.optimize.risk import read_risk
    from warpchain.study.report.risk_page import write_risk_page
    from warpchain.study.results import export_table

    asked = ("factor", "metric", "minimize", "maximize", "recorded", "fatigue")
    if given := [f"--{name}" for name in asked if getattr(arguments, name)]:
        raise StudyError(f"{given[0]}: the runs of {arguments.study} look for failures, their page compares none")
    print(write_risk_page(read_risk(arguments.study), arguments.output, arguments.title))
    if arguments.table is not None:
        print(export_table(results.table, arguments.table))
    return DONE


def study_view_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study view`: shows a study in Rerun."""
    from warpchain.study.report.rerun_scatters import view_study
    from warpchain.study.run.recordings import recorded_trajectories

    path, results = _read_study_table(arguments)
    recorded, study = None, _study_of_folder(path.parent)
    if arguments.variant is not None or "archive" in results.table.column_names:
        worst = None if study is None else study.record.worst
        recorded = recorded_trajectories(results, path.parent, arguments.variant, worst)
    objectives = _asked_objectives(arguments)
    if (
        objectives is None
        and study is not None
        and {o.metric for o in study.objectives} <= set(results.table.column_names)
    ):
        objectives = {objective.metric: objective.sense for objective in study.objectives}
    view_study(results, recorded, arguments.factor, arguments.metric, objectives, arguments.save)
    return 0


def _read_study_table(arguments: argparse.Namespace) -> tuple[Path, Results]:
    """Path and results of the study that arguments name."""
    from warpchain.study.results import read_results

    path = study_table_path(arguments.study)
    return path, read_results(path, arguments.factor or None)


def _study_of_folder(folder: Path) -> Any:
    """Study of a folder's study file, or None."""
    from warpchain.study.spec import load_study

    try:
        return load_study(folder / "study.toml")
    except StudyError:
        return None


def _wanted_of_folder(source: Path) -> Any:
    """Goals of a folder's study for its report, or None of a table alone."""
    from warpchain.study.report.decision_sections import ReportGoals
    from warpchain.study.spec.noise_table import Noise
    from warpchain.view.recorded_variants import DRIVE_CHANNELS

    study = _study_of_folder(source)
    if study is None:
        return None
    most = study.optimize.recommend if study.optimize is not None else ReportGoals.most
    played = set(DRIVE_CHANNELS) <= set(study.record.channels)
    keep = (study.noise or Noise()).keep
    return ReportGoals(study.objectives, study.bounds, str(source), most, played, keep)


def _asked_objectives(arguments: argparse.Namespace) -> dict[str, str] | None:
    """Objectives of a study command's --minimize and --maximize with senses, or None."""
    found = dict.fromkeys(arguments.minimize, "min") | dict.fromkeys(arguments.maximize, "max")
    return found or None


def study_table_path(source: Path) -> Path:
    """Path of the table of a study's folder, made of what is done if unfinished, or the file itself.

    Raises:
        StudyError: a folder without a table.
    """
    if not source.is_dir():
        return source
    for name in TABLE_NAMES:
        if (source / name).is_file():
            return source / name
    if (source / "plan.json").is_file():
        from warpchain.study.run.runner import write_partial_table

        return write_partial_table(source)
    raise StudyError(f"{source}: holds no {TABLE_NAMES[0]} yet; make it with: warpchain study merge {source}")


def study_setting_words(folder: Path) -> dict[str, str]:
    """Texts of name, design and run of a folder's study file, by heading."""
    from warpchain.drive.toml import value_text
    from warpchain.study.spec.study_tables import fields_from_file

    try:
        study = tomllib.loads(read_text_file(folder / "study.toml", "TOML", StudyError))
    except (StudyError, ValueError):
        return {}
    found = {key: str(value) for key, value in study.get("study", {}).items() if key == "name"}
    adjusts = fields_from_file(study).get("adjust", ())
    tables = {key: study.get(key) for key in ("design", "run")}
    tables |= {f"adjust {k + 1}" if len(adjusts) > 1 else "adjust": adjust for k, adjust in enumerate(adjusts)}
    for key, table in tables.items():
        if table:
            found[key] = ", ".join(f"{name} = {value_text(value)}" for name, value in table.items())
    for number, constraint in enumerate(study.get("constraints", ())):
        found[f"constraint {number + 1}"] = str(constraint.get("require", ""))
    return found


def add_play_command(commands: Any) -> None:
    """Adds `warpchain study play` to the command line."""
    text = "play one variant, which is run again if it was not recorded, by a command that is printed"
    parser = add_command(commands, "play", study_play_command, text, "warpchain study play DIR 12")
    parser.add_argument("folder", metavar="DIR", type=Path, help="a study's folder, or a search's")
    parser.add_argument("variant", metavar="VARIANT", type=int, help="its number in the table")
    parser.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    parser.add_argument(
        "--print", dest="print_only", action="store_true", help="print the command that does it, no more"
    )
    add_shared_options(parser, "--workers", "--quiet")


def study_play_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain study play`: plays one variant, run again if need be."""
    from warpchain.study.run.recordings import RepeatedRun, recording_of_variant

    found = recording_of_variant(arguments.folder, arguments.variant)
    if isinstance(found, RepeatedRun):
        print(f"not recorded; this runs it again, bitwise the same:\n{found.write_command()}", flush=True)
        if arguments.print_only:
            return DONE
        from warpchain.engine import start_warp

        start_warp(precompiled=False)
        found.run_again(workers=arguments.workers, progress=not arguments.quiet and sys.stderr.isatty())
        found = found.archive, found.variant
    archive, number = found
    print(f"{archive}, variant {number}")
    if arguments.print_only:
        print(f"warpchain view {shlex.quote(str(archive))} --variant {number}")
        return DONE
    from warpchain.view.rerun.run_playback import view

    view(archive, variant=number, save=arguments.save)
    return DONE
