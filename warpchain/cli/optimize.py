"""The command `warpchain optimize`: options, body, and what it prints."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from warpchain.cli.arguments import add_command, gibibytes, whole_number
from warpchain.cli.commands import DONE, UNFINISHED


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
    parser.add_argument("--workers", metavar="N", type=whole_number, help="CPU threads; default all cores")
    parser.add_argument("--memory", metavar="GIB", type=gibibytes, default="2", help="memory of a shard (default 2)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    parser.set_defaults(run=_optimize)


def _optimize(arguments: argparse.Namespace) -> int:
    from warpchain.engine.start import start_warp
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
            tell=None if quiet else lambda line: print(f"warpchain: {line}", file=sys.stderr),
        )
    except KeyboardInterrupt:
        print("warpchain: interrupted; what is done is kept: run again to go on", file=sys.stderr)
        return UNFINISHED
    _print(found)
    return DONE


def _print(found: Any) -> None:
    """What is recommended, and how to play it."""
    from warpchain.results.quantities import quantity

    results = found.results
    print(f"{len(results.status)} variants in {found.rounds} rounds, {int(results.ok.sum())} of them ok")
    for k, one in enumerate(found.recommended):
        print(f"\ndesign {k + 1}: variant {one.variant}")
        for line in one.reasons:
            print(f"  {line}")
        for name in results.factors:
            value = results.table[name][one.row].as_py()
            words = quantity(value, results.unit(name), digits=6) if isinstance(value, float) else str(value)
            print(f"  {name} = {words}")
        for name, (mean, deviation) in one.believed.items():
            if name not in results.factors:
                unit = results.unit(name)
                print(f"  {name}: {quantity(mean, unit, deviation)} (its run: {quantity(one.measured[name], unit)})")
        print(f"  drive: {found.drives[k]}")
        if found.archives[k] is not None:
            archive, number = found.archives[k]
            print(f"  play it: warpchain view {archive} --variant {number}")
    print("\n± is one standard deviation of the metric itself, by a surrogate of all variants")
    print(f"report: warpchain study report {found.folder} -o report.html")
