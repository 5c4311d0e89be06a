"""The commands `warpchain optimize | risk | calibrate`: runs in rounds, each chosen by those before."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from warpchain.cli.commands import DONE, interrupted
from warpchain.cli.shared_options import add_command, add_run_options, run_options, say_unless_quiet


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
    add_run_options(parser)
    parser.set_defaults(run=_optimize)


def _optimize(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize import optimize

    start_warp(precompiled=False)
    try:
        found = optimize(
            arguments.study,
            arguments.output,
            known=arguments.known,
            report=say_unless_quiet(arguments),
            **run_options(arguments),
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
    add_run_options(parser)
    parser.set_defaults(run=_risk)


def _risk(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize.risk import estimate_risk

    start_warp(precompiled=False)
    try:
        found = estimate_risk(arguments.study, arguments.output, **run_options(arguments))
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


def add_calibrate(commands: Any) -> None:
    """Adds the command to the parser's subparsers."""
    text = "what measured values and signals tell of a drive's unknowns"
    parser = add_command(commands, "calibrate", text, "warpchain calibrate CALIBRATION.toml -o DIR")
    words = "study file with [[measured]], whose noise factors are the unknowns"
    parser.add_argument("study", metavar="CALIBRATION.toml", type=Path, help=words)
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of its runs")
    add_run_options(parser)
    parser.set_defaults(run=_calibrate)


def _calibrate(arguments: argparse.Namespace) -> int:
    from warpchain.engine import start_warp
    from warpchain.study.optimize.calibrate import calibrate
    from warpchain.study.report.calibration_page import calibration_lines, write_calibration

    start_warp(precompiled=False)
    try:
        found = calibrate(
            arguments.study, arguments.output, report=say_unless_quiet(arguments), **run_options(arguments)
        )
    except KeyboardInterrupt:
        return interrupted("what is done is")
    print(*calibration_lines(found), sep="\n")
    print(f"drive: {found.drive}\nsamples: {found.folder / 'posterior.csv'}\npage: {write_calibration(found)}")
    return DONE
