"""The command `warpchain better`: which of two drives is better over noise, by how much, at what cost in runs."""

from __future__ import annotations

import argparse
import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.commands import DONE, UNFINISHED, interrupted
from warpchain.cli.shared_options import (
    add_command,
    add_run_options,
    number,
    run_options,
    say_unless_quiet,
    whole_number,
)

if TYPE_CHECKING:
    from warpchain.study.optimize.better import Better


def add_better(commands: Any) -> None:
    """Adds the command to the parser's subparsers."""
    text = "which of two drives is better over noise, by pairs of runs until it is sure"
    line = "warpchain better STUDY.toml today.toml proposed.toml --metric tension_q999 -o DIR"
    parser = add_command(commands, "better", text, line)
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="study file with noise factors")
    parser.add_argument("drives", metavar="DRIVE", nargs=2, help="A and B: drive files, or names of example drives")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of its runs")
    parser.add_argument("--metric", metavar="NAME", help="what is compared; default the study's only objective")
    parser.add_argument("--sense", choices=["min", "max"], help="which is better; default the objective's, or min")
    parser.add_argument("--level", type=number, default=0.95, metavar="P", help="how sure (default 0.95)")
    parser.add_argument(
        "--budget", type=whole_number, default=200, metavar="RUNS", help="runs of both at most (default 200)"
    )
    parser.add_argument("--batch", type=whole_number, default=8, metavar="PAIRS", help="run at once (default 8)")
    parser.add_argument("--json", action="store_true", help="as JSON, in SI units")
    add_run_options(parser)
    parser.set_defaults(run=_better)


def _better(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize.better import Comparison, find_better

    by = Comparison(*(getattr(arguments, name) for name in ("metric", "sense", "level", "budget", "batch")))
    start_warp(precompiled=False)
    say = say_unless_quiet(arguments)
    try:
        found = find_better(
            arguments.study,
            tuple(arguments.drives),
            arguments.output,
            by,
            report=None if say is None else lambda now: say(_status(now)),
            **run_options(arguments),
        )
    except KeyboardInterrupt:
        return interrupted("what is done is")
    lines = [json.dumps(_values(found), indent=2)] if arguments.json else _lines(found, arguments.drives)
    print(*lines, sep="\n")
    return UNFINISHED if found.better is None else DONE


def _status(found: Better) -> str:
    """The difference so far in one line."""
    return f"{found.found.pairs} pairs: B less A {_difference(found)}"


def _difference(found: Better) -> str:
    from warpchain.results.units import quantity

    of = found.found
    mean, low, high = (quantity(value, found.unit) for value in (of.mean, of.low, of.high))
    if not isfinite(of.half):
        return f"{mean}, too few for an interval"
    return f"{mean}, {low} to {high} with {100.0 * of.level:g} % confidence"


def _lines(found: Better, drives: list[str]) -> list[str]:
    """The answer in words."""
    from warpchain.results.units import quantity

    of, left_out = found.found, len(found.differences) - found.found.pairs
    way = "less" if found.sense == "min" else "more"
    lines = [f"{found.metric} over the noise of {', '.join(found.results[0].noise)}; {way} is better"]
    lines += [f"{name}: {quantity(m, found.unit)} in the mean, better in {found.won(name)} of {of.pairs} pairs: {drive}"
              for name, m, drive in zip("AB", found.means, drives, strict=True)]  # fmt: skip
    part = f" ({100.0 * of.mean / abs(found.means[0]):+.2g} %)" if found.means[0] else ""
    lines.append(f"B less A: {_difference(found)}{part}")
    cost = f"{found.runs} runs of {found.budget}, {len(found.differences)} pairs"
    where = " where both runs are ok" if left_out else ""
    if found.better is not None:
        lines.append(f"{found.better} is better{where}, surely: {100.0 * of.level:g} %; cost: {cost}")
    else:
        lines.append(f"not sure which is better{where}; cost: {cost}")
        lines.append(f"  {_what_would_help(found)}")
    for name in "AB":
        count, reason = found.lost(name)
        if count:
            lines.append(f"{count} pairs are left out, as the run of {name} is not ok, such as: {reason}")
    return [*lines, *(f"runs of {name}: {folder}" for name, folder in zip("AB", found.folders, strict=True))]


def _what_would_help(found: Better) -> str:
    """A line on why no sign is sure."""
    from warpchain.results.units import quantity

    of = found.found
    if of.mean == of.deviation == 0.0:
        return "no pair differs: the noise sets what the drives differ in, or the metric does not see it"
    needed = of.pairs_needed()
    if needed is None:
        return f"the means differ by at most {quantity(max(abs(of.low), abs(of.high)), found.unit)}"
    every = len(found.differences) / of.pairs
    runs = round(2 * found.copies * needed * every)
    return f"should mean and scatter stay, it takes about {needed} pairs; go on with --budget {runs} or more"


def _values(found: Better) -> dict[str, Any]:
    """The answer as JSON."""
    of = found.found
    drives = {
        name: {
            "mean": mean,
            "better_in_pairs": found.won(name),
            "runs_not_ok": found.lost(name)[0],
            "folder": str(folder),
        }
        for name, mean, folder in zip("AB", found.means, found.folders, strict=True)
    }
    return {
        "units": "SI",
        "metric": found.metric,
        "unit": found.unit,
        "sense": found.sense,
        "better": found.better,
        "level": of.level,
        "difference": of.mean,
        "interval": [of.low if isfinite(of.low) else None, of.high if isfinite(of.high) else None],
        "pairs": of.pairs,
        "pairs_left_out": len(found.differences) - of.pairs,
        "runs": found.runs,
        "budget": found.budget,
        **drives,
    }
