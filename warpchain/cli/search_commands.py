"""The commands `warpchain optimize | risk | calibrate`: runs in rounds, each chosen by those before."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.commands import DONE, resumable_command
from warpchain.cli.shared_options import (
    CommandBody,
    OptionSettings,
    add_command,
    add_run_options,
    run_options_from_arguments,
    status_printer,
)

if TYPE_CHECKING:
    from warpchain.study.optimize.recommend import RecommendedDesign
    from warpchain.study.results import Results


def add_search_command(
    commands: Any, run: CommandBody, text: str, needs: str, words: str = "STUDY.toml", own: OptionSettings | None = None
) -> None:
    """Adds a command that runs a study in rounds, named as its body begins.

    Args:
        text: its help.
        needs: what its study file has.
        words: its arguments before the folder.
        own: its further arguments, as `add_argument` takes them.
    """
    name = run.__name__.partition("_")[0]
    parser = add_command(commands, name, run, text, f"warpchain {name} {words} -o DIR")
    parser.add_argument("study", metavar=words.split()[0], type=Path, help=f"study file with {needs}")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of its runs")
    for option, settings in (own or {}).items():
        parser.add_argument(option, **settings)
    add_run_options(parser)


def add_optimize_command(commands: Any) -> None:
    """Adds `warpchain optimize`, a search in rounds, to the command line."""
    text = "look for the designs that a study's objectives and limits want"
    known = {"metavar": "DIR", "type": Path, "action": "append", "default": []}
    known["help"] = "a study's folder whose rows are not run again where they are asked for (repeatable)"
    add_search_command(commands, optimize_command, text, "[[objectives]]", own={"--known": known})


@resumable_command("what is done is")
def optimize_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain optimize`: searches for the best designs of a study."""
    from warpchain.study.optimize import optimize

    say = status_printer(arguments)
    known = arguments.known
    _print_recommended(
        optimize(arguments.study, arguments.output, known=known, report=say, **run_options_from_arguments(arguments))
    )
    return DONE


def add_risk_command(commands: Any) -> None:
    """Adds `warpchain risk`, a search in rounds, to the command line."""
    text = "how likely a drive breaks a limit over its noise, and how it most likely does"
    drive = {"metavar": "DRIVE", "nargs": "?"}
    drive["help"] = "drive file or name of an example, beside the study's own as today's design; default that alone"
    words = "STUDY.toml proposed.toml"
    add_search_command(commands, risk_command, text, "noise factors and [[limits]]", words, {"drive": drive})


@resumable_command("what is done is")
def risk_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain risk`: estimates how likely a drive breaks a limit."""
    from warpchain.study.optimize.risk import estimate_risk
    from warpchain.study.report.risk_page import risk_lines, write_risk_page

    say = status_printer(arguments)
    options = run_options_from_arguments(arguments)
    found = estimate_risk(arguments.study, arguments.output, arguments.drive, report=say, **options)
    if found.today is not None:
        write_risk_page(found.today)
    print(*risk_lines(found), f"page: {write_risk_page(found)}", sep="\n")
    return DONE


def _print_recommended(found: Any) -> None:
    """Prints designs that a search recommends, and how to play them."""
    from warpchain.assembly.summary import check_findings
    from warpchain.drive import load_drive

    results, runs = found.designs, len(found.results.status)
    over = f" of {len(results.status)} designs over the same noise" if found.results.noise_factors else ""
    print(f"{runs} variants{over} in {found.rounds} rounds, {int(found.results.ok.sum())} of them ok")
    if found.today is not None:
        _print_design(results, "today's design", found.today)
    for k, one in enumerate(found.recommended):
        _print_design(results, f"design {k + 1}", one)
        for line in check_findings(load_drive(found.drives[k])):
            print(f"  {line}")
        print(f"  drive: {found.drives[k]}")
        if found.archives[k] is not None:
            archive, number = found.archives[k]
            way = "play it, with noise as the drive has it" if one.spreads else "play it"
            print(f"  {way}: warpchain view {archive} --variant {number}")
    over_noise = "the standard error of a statistic over a design's runs; designs are compared over the same noise"
    of = over_noise if found.results.noise_factors else "one standard deviation of the metric itself, by a surrogate"
    print(f"\n± is {of}")
    print(f"report: warpchain study report {found.folder} -o report.html")


def _print_design(results: Results, name: str, one: RecommendedDesign) -> None:
    """Prints a search's design: reasons, factors, metrics, changes from today."""
    from warpchain.results.units import quantity_words
    from warpchain.study.report.decision_sections import change_texts

    print(f"\n{name}: variant {one.variant}" + (", its worst run" if one.spreads else ""))
    for line in one.reasons:
        print(f"  {line}")
    for factor in results.factors:
        value = results.table[factor][one.row].as_py()
        unit = results.column_unit(factor)
        print(f"  {factor} = {quantity_words(value, unit, digits=6) if isinstance(value, float) else value}")
    for metric, (mean, deviation) in one.believed.items():
        if metric in results.factors:
            continue
        unit = results.column_unit(metric)
        simulated = "" if one.spreads else f"model estimate; {quantity_words(one.measured[metric], unit)} "
        change = ", ".join(filter(None, change_texts(one.changes.get(metric), unit)))
        beside = f"; less today's {change}" if change else ""
        print(f"  {metric}: {quantity_words(mean, unit, deviation)} ({simulated}simulated{beside})")
    for of in one.spreads:
        print(f"  spread of {of.metric} over the noise comes from: {of.parts_text()}")


def add_calibrate_command(commands: Any) -> None:
    """Adds `warpchain calibrate`, a search in rounds, to the command line."""
    needs = "[[measured]], whose noise factors are the unknowns"
    text = "what measured values and signals tell of a drive's unknowns"
    add_search_command(commands, calibrate_command, text, needs, "CALIBRATION.toml")


@resumable_command("what is done is")
def calibrate_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain calibrate`: finds a drive's unknowns from measurements."""
    from warpchain.study.optimize.calibrate import calibrate
    from warpchain.study.report.calibration_page import calibration_lines, write_calibration_page

    say = status_printer(arguments)
    found = calibrate(arguments.study, arguments.output, report=say, **run_options_from_arguments(arguments))
    print(*calibration_lines(found), sep="\n")
    print(f"drive: {found.drive}\nsamples: {found.folder / 'posterior.csv'}\npage: {write_calibration_page(found)}")
    return DONE
