"""The commands `warpchain study run | plan | status | merge`: options and bodies."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from warpchain.cli.arguments import gibibytes, part, wanted_precision, whole_number
from warpchain.cli.commands import DONE, UNFINISHED
from warpchain.errors import StudyError

SHARDS_A_WORKER = 2
"""Fewest shards of a new study for each worker of a cluster, so that none waits long for the last one."""


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
    run.add_argument("--quiet", action="store_true", help="no progress bar")
    run.set_defaults(study_run=_run)

    text = "tell what a study will come to, without running it"
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
        help="a metric whose precision to tell; default all, the noisiest first",
    )
    plan.add_argument(
        "--stored", action="store_true", help="take stored rates, without the short runs that measure them"
    )
    plan.set_defaults(study_run=_plan)

    status = commands.add_parser("status", help="how far a study is", description="Tell how far a study is.")
    status.add_argument("folder", metavar="DIR", type=Path, help="the study's folder")
    status.set_defaults(study_run=_status)

    text = "make the whole table of a study whose shards are done, or one study of several"
    merge = commands.add_parser("merge", help=text, description=text[0].upper() + text[1:] + ".")
    merge.add_argument("folder", metavar="DIR", type=Path, nargs="+", help="the study's folder, or several")
    merge.add_argument("-o", "--output", metavar="DIR", type=Path, help="folder to make of several, which stay")
    merge.set_defaults(study_run=_merge)

    for parser in (run, plan, merge):
        parser.add_argument(
            "--workers", metavar="N", type=whole_number, help="CPU threads of a shard; default all cores"
        )
        parser.add_argument(
            "--memory", metavar="GIB", type=gibibytes, default="2", help="memory of a shard (default 2)"
        )


def _run(arguments: argparse.Namespace) -> int:
    from warpchain.engine.start import start_warp
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
        print("warpchain: interrupted; the shards that are done are kept: run again to go on", file=sys.stderr)
        return UNFINISHED
    told = _tell(outcome)
    return told if outcome.left or outcome.counts["ok"] else UNFINISHED


@contextmanager
def _executor(scheduler: str | None) -> Iterator[tuple[Any, int]]:
    """The executor to run on, None for this process, and how many shards it should have at least."""
    if scheduler is None:
        yield None, 1
        return
    from warpchain.study.run.dask import dask_executor

    with dask_executor(scheduler) as (executor, workers):
        yield executor, max(1, SHARDS_A_WORKER * workers)


def _plan(arguments: argparse.Namespace) -> int:
    from warpchain.engine.start import start_warp
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


def _status(arguments: argparse.Namespace) -> int:
    from warpchain.study.run import study_status

    return _tell(study_status(arguments.folder))


def _merge(arguments: argparse.Namespace) -> int:
    from warpchain.engine.start import start_warp
    from warpchain.study.run import join_studies, merge_study

    folders, output = arguments.folder, arguments.output
    options = {"workers": arguments.workers, "memory": arguments.memory}
    if (len(folders) > 1) != (output is not None):
        raise StudyError("merge: give one folder, or several and -o, the folder to make of them")
    start_warp(precompiled=False)
    if output is None:
        return _tell(merge_study(folders[0], **options))
    joined = join_studies(folders, output, **options)
    rows = " + ".join(map(str, joined.rows))
    print(f"{rows} rows, {joined.together} of them different; which became which: {joined.mapping}")
    told = _tell(joined.outcome)
    if joined.outcome.left:
        print(f"run what none of them had: warpchain study run {output}/study.toml -o {output}")
    return told


def _tell(outcome: Any) -> int:
    """Prints how a study stands."""
    done, count = outcome.shards
    counts = ", ".join(f"{number} {status}" for status, number in outcome.counts.items())
    print(f"{done} of {count} shards are done; variants: {counts}")
    for reason, number in outcome.reasons:
        print(f"  {number} like this: {reason}")
    if outcome.went_on is not None:
        on, anew = outcome.went_on
        print(f"of longer runs, {on} went on from where the ones before stood, {anew} began anew")
    if outcome.left and outcome.rate is not None:
        seconds = round(outcome.left / outcome.rate)
        left = f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
        print(f"{outcome.left} variants are left; at the latest {outcome.rate:.3g} variants/s they take {left}")
    if outcome.table is not None:
        print(f"table: {outcome.table}")
    elif done == count:
        print(f"make the whole table with: warpchain study merge {outcome.folder}")
    return DONE
