"""The commands `warpchain study run | plan | grow | status | merge | report | view | play`, `optimize` and `risk`."""

from __future__ import annotations

import argparse
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.arguments import (
    add_command,
    add_options,
    part,
    wanted_precision,
    whole_number,
    woehler_curve,
    workers,
)
from warpchain.cli.commands import DONE, UNFINISHED, interrupted
from warpchain.errors import StudyError
from warpchain.files import read_text
from warpchain.progress import clock

if TYPE_CHECKING:
    from warpchain.study.results import Results

SHARDS_A_WORKER = 2
"""Fewest shards of a new study for each worker of a cluster, so that none waits long for the last one."""
TABLES = ("results.parquet", "results.csv")
"""Where a study's folder keeps its table."""


def add_commands(commands: Any) -> None:
    """Adds the commands to a parser's subparsers; each sets `study_run`, the function that does it."""
    run = commands.add_parser("run", help="run a study, or go on with it", description="Run a study, or go on with it.")
    run.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    run.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="the study's folder")
    run.add_argument("--shard", metavar="I/N", type=part, help="only every N-th shard from the I-th, I from 0")
    run.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://10.0.0.1:8786")
    run.add_argument(
        "--grow",
        action="store_true",
        help="add to a folder of the same study more points, replicates or another window",
    )
    add_options(run, "--quiet")
    run.set_defaults(study_run=_run)

    text = "forecast a study's rows, cost and precision, without running it"
    plan = commands.add_parser("plan", help=text, description=text[0].upper() + text[1:] + ".")
    plan.add_argument("study", metavar="STUDY.toml", type=Path, help="study file")
    plan.add_argument(
        "--like", metavar="DIR", type=Path, help="an earlier study with replicates, or its table: how runs scatter"
    )
    plan.add_argument(
        "--precision",
        metavar="METRIC=VALUE",
        action="append",
        default=[],
        type=wanted_precision,
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
    plan.set_defaults(study_run=_plan)

    text = "double a study until its main effects are known well enough"
    grow = add_command(commands, "grow", text, "warpchain study grow DIR --until 'se(main effects) < 1 %%'")
    grow.add_argument("folder", metavar="DIR", type=Path, help="the study's folder")
    grow.add_argument(
        "--until",
        metavar="CONDITION",
        required=True,
        help="'se(main effects) < 1 %%' of each metric's mean, or 'se(main effects of METRIC) < VALUE'",
    )
    grow.add_argument("--most", metavar="ROWS", type=whole_number, default=10_000, help="rows at most (default 10000)")
    add_options(grow, "--quiet")
    grow.set_defaults(study_run=_grow)

    status = commands.add_parser("status", help="how far a study is", description="Print how far a study is.")
    status.add_argument("folder", metavar="DIR", type=Path, help="the study's folder")
    status.set_defaults(study_run=_status)

    text = "make the whole table of a study whose shards are done, or one study of several"
    merge = commands.add_parser("merge", help=text, description=text[0].upper() + text[1:] + ".")
    merge.add_argument("folder", metavar="DIR", type=Path, nargs="+", help="the study's folder, or several")
    merge.add_argument("-o", "--output", metavar="DIR", type=Path, help="folder to make of several, which stay")
    merge.set_defaults(study_run=_merge)

    for parser in (run, plan, grow, merge):
        parser.add_argument("--workers", metavar="N", type=workers, help="CPU threads of a shard; default all cores")
        add_options(parser, "--memory")


def _run(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.run import run_study

    start_warp(precompiled=False)
    try:
        with _executor(arguments.scheduler) as (executor, parts):
            outcome = run_study(
                arguments.study,
                arguments.output,
                executor=executor,
                part=arguments.shard,
                parts=parts,
                workers=arguments.workers,
                memory=arguments.memory,
                progress=not arguments.quiet,
                grow=arguments.grow,
            )
    except KeyboardInterrupt:
        return interrupted("the shards that are done are")
    status = _print_status(outcome)
    return status if outcome.left or outcome.counts["ok"] else UNFINISHED


@contextmanager
def _executor(scheduler: str | None) -> Iterator[tuple[Any, int]]:
    """The executor to run on, None for this process, and how many shards it should have at least."""
    if scheduler is None:
        yield None, 1
        return
    from warpchain.study.run.runner import dask_executor

    with dask_executor(scheduler) as (executor, workers):
        yield executor, max(1, SHARDS_A_WORKER * workers)


def _plan(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.plan import plan_lines, plan_study

    start_warp(precompiled=False)
    wanted = dict(arguments.precision)
    metrics = tuple(dict.fromkeys([*arguments.metric, *wanted]))
    if wanted and arguments.like is None:
        raise StudyError("--precision: needs --like, an earlier study with replicates that tells how runs scatter")
    plan = plan_study(
        arguments.study,
        like=arguments.like,
        metrics=metrics,
        calibrate=not arguments.stored,
        workers=arguments.workers,
        memory=arguments.memory,
    )
    for line in plan_lines(plan, wanted):
        print(line)
    return DONE


def _grow(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.grow_until import Reached, Until, grow_until

    until = Until.of(arguments.until)
    start_warp(precompiled=False)

    def say(now: Reached) -> None:
        if not arguments.quiet:
            of = f" ({now.metric} over {now.factor})" if now.factor else ""
            print(f"{now.rows} variants: largest standard error of main effects {until.words(now.error)}{of}")

    try:
        found = grow_until(
            arguments.folder,
            until,
            most=arguments.most,
            workers=arguments.workers,
            memory=arguments.memory,
            progress=not arguments.quiet and sys.stderr.isatty(),
            report=say,
        )
    except KeyboardInterrupt:
        return interrupted("the shards that are done are")
    if not found.done:
        print(f"not reached: twice as many rows would be more than --most {arguments.most}")
    print(f"design.count is {found.count} now; table: {arguments.folder / TABLES[0]}")
    return DONE if found.done else UNFINISHED


def _status(arguments: argparse.Namespace) -> int:
    from warpchain.study.run import study_status

    return _print_status(study_status(arguments.folder))


def _merge(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.run import join_studies, merge_study

    folders, output = arguments.folder, arguments.output
    options = {"workers": arguments.workers, "memory": arguments.memory}
    if (len(folders) > 1) != (output is not None):
        raise StudyError("merge: give one folder, or several and -o, the folder to make of them")
    start_warp(precompiled=False)
    if output is None:
        return _print_status(merge_study(folders[0], **options))
    joined = join_studies(folders, output, **options)
    rows = " + ".join(map(str, joined.rows))
    print(f"{rows} rows, {joined.together} of them different; which became which: {joined.mapping}")
    status = _print_status(joined.outcome)
    if joined.outcome.left:
        print(f"run what none of them had: warpchain study run {output}/study.toml -o {output}")
    return status


def _print_status(outcome: Any) -> int:
    """Prints the status of a study."""
    done, count = outcome.shards
    counts = ", ".join(f"{number} {status}" for status, number in outcome.counts.items())
    print(f"{done} of {count} shards are done; variants: {counts}")
    for reason, number in outcome.reasons:
        print(f"  {number} like this: {reason}")
    if outcome.went_on is not None:
        on, anew = outcome.went_on
        print(f"of longer runs, {on} went on from where the ones before stood, {anew} began anew")
    if outcome.left and outcome.rate is not None:
        left = clock(outcome.left / outcome.rate)
        print(f"{outcome.left} variants are left; at the latest {outcome.rate:.3g} variants/s they take {left}")
    if outcome.table is not None:
        print(f"table: {outcome.table}")
    elif done == count:
        print(f"make the whole table with: warpchain study merge {outcome.folder}")
    return DONE


def add_report_commands(commands: Any) -> None:
    """Adds the commands to the subparsers of `warpchain study`; each sets `study_run`, the function that does it."""
    page = _add_report(commands, "report", report, "write a study's report as one HTML page", "DIR -o report.html")
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

    scatter = _add_report(
        commands, "view", view, "show a study in Rerun, beside its recorded variants", "DIR --save study.rrd"
    )
    scatter.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    scatter.add_argument("--variant", metavar="I", type=int, action="append", help="a recorded variant (repeatable)")


def _add_report(commands: Any, name: str, run: Callable[[argparse.Namespace], int], text: str, example: str) -> Any:
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

    path, results = _read_table(arguments)
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

    path, results = _read_table(arguments)
    recorded, study = None, _study_in(path.parent)
    if arguments.variant is not None or "archive" in results.table.column_names:
        worst = None if study is None else study.record.worst
        recorded = recorded_variants(results, path.parent, arguments.variant, worst)
    objectives = _objectives(arguments)
    if (
        objectives is None
        and study is not None
        and {o.metric for o in study.objectives} <= set(results.table.column_names)
    ):
        objectives = {objective.metric: objective.sense for objective in study.objectives}
    view_study(results, recorded, arguments.factor, arguments.metric, objectives, arguments.save)
    return 0


def _read_table(arguments: argparse.Namespace) -> tuple[Path, Results]:
    from warpchain.study.results import read_results

    path = table_path(arguments.study)
    return path, read_results(path, arguments.factor or None)


def _study_in(folder: Path) -> Any:
    """The study of a folder, None of a table alone or of a folder without one."""
    from warpchain.study.spec import load_study

    try:
        return load_study(folder / "study.toml")
    except StudyError:
        return None


def _wanted(source: Path) -> Any:
    """Objectives and limits of the study in a folder, and the folder as it is named; None of a table alone."""
    from warpchain.study.report.decisions import Wanted
    from warpchain.study.spec.noise import Noise
    from warpchain.view.chosen import NEEDED

    study = _study_in(source)
    if study is None:
        return None
    most = study.optimize.recommend if study.optimize is not None else Wanted.most
    played = set(NEEDED) <= set(study.record.channels)
    keep = (study.noise or Noise()).keep
    return Wanted(study.objectives, study.bounds, str(source), most, played, keep)


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
        from warpchain.study.run.runner import partial_table

        return partial_table(source)
    raise StudyError(f"{source}: holds no {TABLES[0]} yet; make it with: warpchain study merge {source}")


def about(folder: Path) -> dict[str, str]:
    """Name, design and run settings of a study's folder, in words; empty where it has none."""
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


def add_play_command(commands: Any) -> None:
    """Adds the command to the subparsers of `warpchain study`."""
    text = "play one variant, which is run again if it was not recorded, by a command that is printed"
    parser = add_command(commands, "play", text, "warpchain study play DIR 12")
    parser.add_argument("folder", metavar="DIR", type=Path, help="a study's folder, or a search's")
    parser.add_argument("variant", metavar="VARIANT", type=int, help="its number in the table")
    parser.add_argument("--save", metavar="OUT.rrd", type=Path, help="write a Rerun recording instead of opening it")
    parser.add_argument(
        "--print", dest="print_only", action="store_true", help="print the command that does it, no more"
    )
    add_options(parser, "--workers", "--quiet")
    parser.set_defaults(study_run=_play)


def _play(arguments: argparse.Namespace) -> int:
    from warpchain.study.run.recordings import Rerun, recording_of

    found = recording_of(arguments.folder, arguments.variant)
    if isinstance(found, Rerun):
        print(f"not recorded; this runs it again, bitwise the same:\n{found.command()}", flush=True)
        if arguments.print_only:
            return DONE
        from warpchain.engine import start_warp

        start_warp(precompiled=False)
        found.run(workers=arguments.workers, progress=not arguments.quiet and sys.stderr.isatty())
        found = found.archive, found.variant
    archive, number = found
    print(f"{archive}, variant {number}")
    if arguments.print_only:
        print(f"warpchain view {shlex.quote(str(archive))} --variant {number}")
        return DONE
    from warpchain.view.rerun.run_playback import view

    view(archive, variant=number, save=arguments.save)
    return DONE


def add_optimize(commands: Any) -> None:
    """Adds the command to the parser's subparsers."""
    text = "look for the designs that a study's objectives and limits want"
    parser = add_command(commands, "optimize", text, "warpchain optimize STUDY.toml -o DIR")
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="study file with [[objectives]]")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of its rounds")
    parser.add_argument(
        "--known",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="a study's folder whose rows are not run again where they are asked for (repeatable)",
    )
    add_options(parser, "--workers", "--memory", "--quiet")
    parser.set_defaults(run=_optimize)


def _optimize(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize import optimize

    start_warp(precompiled=False)
    quiet = arguments.quiet
    try:
        found = optimize(
            arguments.study,
            arguments.output,
            workers=arguments.workers,
            memory=arguments.memory,
            known=arguments.known,
            progress=not quiet and sys.stderr.isatty(),
            report=None if quiet else lambda line: print(f"warpchain: {line}", file=sys.stderr),
        )
    except KeyboardInterrupt:
        return interrupted("what is done is")
    _print_found(found)
    return DONE


def add_risk(commands: Any) -> None:
    """Adds the command to the parser's subparsers."""
    text = "how likely a drive breaks a limit over its noise, and how it most likely does"
    parser = add_command(commands, "risk", text, "warpchain risk STUDY.toml -o DIR")
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="study file with noise factors and [[limits]]")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of its runs")
    add_options(parser, "--workers", "--memory", "--quiet")
    parser.set_defaults(run=_risk)


def _risk(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize.risk import estimate_risk

    start_warp(precompiled=False)
    options = {"workers": arguments.workers, "memory": arguments.memory}
    bar = not arguments.quiet and sys.stderr.isatty()
    try:
        found = estimate_risk(arguments.study, arguments.output, progress=bar, **options)
    except KeyboardInterrupt:
        return interrupted("what is done is")
    _print_risk(found)
    return DONE


def _print_risk(found: Any) -> None:
    """Prints both estimates, and the most likely way to fail."""
    from warpchain.results.units import quantity

    results = found.results
    row = results.variants.tolist().index(found.variant)
    values = {name: results.table[name][row].as_py() for name in results.factors}
    shown = {n: quantity(v, results.unit(n)) if isinstance(v, float) else str(v) for n, v in values.items()}
    held = ", ".join(f"{name} = {shown[name]}" for name in found.held if name in shown)
    print(f"over the noise of {', '.join(results.noise)}" + (f", at {held}" if held else ""))
    for bound in found.bounds:
        ends = [(word, end) for word, end in (("at least", bound.min), ("at most", bound.max)) if end is not None]
        print(
            f"limit: {bound.metric} {' and '.join(f'{w} {quantity(e, results.unit(bound.metric))}' for w, e in ends)}"
        )
    ways = (
        ("subset simulation", found.subset),
        (f"importance sampling about {found.points} design points", found.sampled),
    )
    for way, of in ways:
        if isinstance(of, str):
            print(f"{way}: {of}")
            continue
        interval = f"{of.low:.2g} to {of.high:.2g} with 95 % confidence"
        print(f"P(a limit is exceeded) = {of.probability:.2g}, {interval}: {way}, {of.evaluations} runs")
    if not isinstance(found.sampled, str) and not (
        found.sampled.low <= found.subset.high and found.subset.low <= found.sampled.high
    ):
        print("the two differ: a way to fail is missed, or runs scatter; take risk.count and risk.samples larger")
    lost = int((~results.ok).sum())
    if lost:
        print(f"{lost} of {len(results.status)} runs are not ok and count as failures: {results.reasons()[0][1]}")
    print(
        f"most likely way to fail: variant {found.variant}, {found.distance:.3g} standard deviations from the medians"
    )
    for name in results.noise:
        print(f"  {name} = {shown[name]}")
    for bound in found.bounds:
        print(f"  {bound.metric}: {quantity(float(results.values(bound.metric)[row]), results.unit(bound.metric))}")
    print(f"  play it: warpchain view {found.archive} --variant {found.variant}")


def _print_found(found: Any) -> None:
    """Prints the recommended designs, and how to play them."""
    from warpchain.results.units import quantity

    results, runs = found.designs, len(found.results.status)
    over = f" of {len(results.status)} designs over the same noise" if found.results.noise else ""
    print(f"{runs} variants{over} in {found.rounds} rounds, {int(found.results.ok.sum())} of them ok")
    for k, one in enumerate(found.recommended):
        print(f"\ndesign {k + 1}: variant {one.variant}" + (", its worst run" if one.spreads else ""))
        for line in one.reasons:
            print(f"  {line}")
        for name in results.factors:
            value = results.table[name][one.row].as_py()
            words = quantity(value, results.unit(name), digits=6) if isinstance(value, float) else str(value)
            print(f"  {name} = {words}")
        for name, (mean, deviation) in one.believed.items():
            if name not in results.factors:
                unit = results.unit(name)
                measured = f"its run{'s' if one.spreads else ''}: {quantity(one.measured[name], unit)}"
                print(f"  {name}: {quantity(mean, unit, deviation)} ({measured})")
        for of in one.spreads:
            print(f"  spread of {of.metric} over the noise comes of: {of.parts_words()}")
        print(f"  drive: {found.drives[k]}")
        if found.archives[k] is not None:
            archive, number = found.archives[k]
            way = "play it, with noise as the drive has it" if one.spreads else "play it"
            print(f"  {way}: warpchain view {archive} --variant {number}")
    print("\n± is one standard deviation of the metric itself, by a surrogate of all variants")
    print(f"report: warpchain study report {found.folder} -o report.html")
