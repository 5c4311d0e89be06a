"""The command `warpchain better`: which of two drives is better under noise, with confidence."""

from __future__ import annotations

import argparse
import json
from math import isfinite
from typing import TYPE_CHECKING, Any

from warpchain.cli.commands import DONE, UNFINISHED, resumable_command
from warpchain.cli.search_commands import add_search_command
from warpchain.cli.shared_options import (
    OptionSettings,
    number_from_word,
    run_options_from_arguments,
    status_printer,
    whole_number_from_word,
)

if TYPE_CHECKING:
    from warpchain.study.optimize.better import DriveComparison


BETTER_OPTIONS: OptionSettings = {
    "drives": {"metavar": "DRIVE", "nargs": 2, "help": "A and B: drive files, or names of example drives"},
    "--metric": {"metavar": "NAME", "help": "what is compared; default the study's only objective"},
    "--sense": {"choices": ["min", "max"], "help": "which is better; default the objective's, or min"},
    "--level": {"type": number_from_word, "default": 0.95, "metavar": "P", "help": "confidence level (default 0.95)"},
    "--budget": {
        "type": whole_number_from_word,
        "default": 200,
        "metavar": "RUNS",
        "help": "runs of both at most (default 200)",
    },
    "--batch": {"type": whole_number_from_word, "default": 8, "metavar": "PAIRS", "help": "run at once (default 8)"},
    "--event": {
        "type": number_from_word,
        "metavar": "X",
        "help": "change of a difference by rare events that is reckoned with though no pair had it, in SI units "
        "(default 20 deviations of the differences; 0 leaves it at the largest that was there)",
    },
    "--json": {"action": "store_true", "help": "as JSON, in SI units"},
}
"""Arguments of `warpchain better`, as `add_argument` takes them."""


def add_better_command(commands: Any) -> None:
    """Adds `warpchain better` to the command line."""
    text = "which of two drives is better under noise, with confidence"
    words = "STUDY.toml today.toml proposed.toml --metric tension_q999"
    add_search_command(commands, better_command, text, "noise factors", words, BETTER_OPTIONS)


@resumable_command("what is done is")
def better_command(arguments: argparse.Namespace) -> int:
    """Body of `warpchain better`: compares two drives and prints the answer."""
    from warpchain.study.optimize.better import Comparison, find_better

    by = Comparison(*(getattr(arguments, name) for name in ("metric", "sense", "level", "budget", "batch", "event")))
    say = status_printer(arguments)
    report = None if say is None else lambda now: say(_progress_text(now))
    drives = tuple(arguments.drives)
    found = find_better(
        arguments.study, drives, arguments.output, by, report=report, **run_options_from_arguments(arguments)
    )
    lines = [json.dumps(_better_json(found), indent=2)] if arguments.json else _better_lines(found, arguments.drives)
    print(*lines, sep="\n")
    return UNFINISHED if found.sure_winner is None else DONE


def _progress_text(found: DriveComparison) -> str:
    """Line of `warpchain better` on the difference so far."""
    return f"{found.found.pairs} pairs: B less A {_difference_text(found)}"


def _difference_text(found: DriveComparison) -> str:
    """Text on how much better a drive is: mean difference with its interval."""
    from warpchain.results.units import quantity_words

    of = found.found
    mean, low, high = (
        quantity_words(value, found.metric_unit) for value in (of.mean, of.interval_low, of.interval_high)
    )
    if not isfinite(of.half):
        return f"{mean}, too few for an interval"
    return f"{mean}, {low} to {high} with {100.0 * of.level:g} % confidence"


def _better_lines(found: DriveComparison, drives: list[str]) -> list[str]:
    """Lines that answer `warpchain better`."""
    from warpchain.results.units import quantity_words

    of, left_out = found.found, len(found.differences) - found.found.pairs
    way = "less" if found.sense == "min" else "more"
    lines = [f"{found.metric} over the noise of {', '.join(found.results[0].noise_factors)}; {way} is better"]
    lines += [f"{name}: {quantity_words(m, found.metric_unit)} in the mean, better in {found.won_pairs(name)} of "
              f"{of.pairs} pairs: {drive}"
              for name, m, drive in zip("AB", found.means, drives, strict=True)]  # fmt: skip
    part = f" ({100.0 * of.mean / abs(found.means[0]):+.2g} %)" if found.means[0] else ""
    lines.append(f"B less A: {_difference_text(found)}{part}")
    cost = f"{found.run_count} runs of {found.budget}, {len(found.differences)} pairs"
    where = " where both runs are ok" if left_out else ""
    confidence = f"{100.0 * of.level:g} % confidence"
    if found.sure_winner is not None:
        lines.append(f"{found.sure_winner} is better{where} ({confidence}); cost: {cost}")
    else:
        lines.append(f"undecided which is better{where} ({confidence}); cost: {cost}")
        if found.shown_winner is not None:
            lines.append(f"  {found.shown_winner} is better as far as these pairs show ({confidence})")
        lines.append(f"  {_decision_text(found)}")
    if of.is_heavy_tailed:
        lines.append(f"  {of.carriers} of {of.pairs} pairs carry half of the scatter: the mean depends on few of them")
    lines.append(f"  {_rare_event_text(found)}")
    for name in "AB":
        count, reason = found.failed_runs(name)
        if count:
            lines.append(f"{count} pairs are left out, as the run of {name} is not ok, such as: {reason}")
    return [*lines, *(f"runs of {name}: {folder}" for name, folder in zip("AB", found.folders, strict=True))]


def _decision_text(found: DriveComparison) -> str:
    """Sentence on what would decide which drive is better."""
    from warpchain.results.units import quantity_words

    of = found.found
    if of.mean == of.deviation == 0.0:
        return "no pair differs: the noise sets what the drives differ in, or the metric does not see it"
    needed = of.pairs_needed()
    if needed is None:
        return (
            f"the means differ by at most "
            f"{quantity_words(max(abs(of.interval_low), abs(of.interval_high)), found.metric_unit)}"
        )
    every = len(found.differences) / of.pairs
    runs = round(2 * found.copies * needed * every)
    text = f"should mean and scatter stay, it takes about {needed} pairs; go on with --budget {runs} or more"
    return (
        f"{text}, or a lower --event if rare events are smaller"
        if of.largest < of.reversing_change < of.reckoned
        else text
    )


def _rare_event_text(found: DriveComparison) -> str:
    """Sentence of `warpchain better` on rare events that the pairs may have missed."""
    from warpchain.results.units import quantity_words

    of = found.found
    text = f"{of.pairs} pairs may miss an event rarer than 1 in {1.0 / of.missed_probability:.2g}"
    if of.reversing_change > 0.0:
        least = ("-" if of.mean > 0.0 else "+") + quantity_words(of.reversing_change, found.metric_unit)
        text += f": it reverses the sign if it changes the difference by more than {least}"
    deviations = f", {of.reckoned / of.deviation:.3g} deviations" if of.deviation else ""
    return f"{text}; reckoned with: {quantity_words(of.reckoned, found.metric_unit)}{deviations}"


def _better_json(found: DriveComparison) -> dict[str, Any]:
    """Values of `warpchain better --json`, in SI units."""
    of = found.found
    drives = {
        name: {
            "mean": mean,
            "better_in_pairs": found.won_pairs(name),
            "runs_not_ok": found.failed_runs(name)[0],
            "folder": str(folder),
        }
        for name, mean, folder in zip("AB", found.means, found.folders, strict=True)
    }
    return {
        "units": "SI",
        "metric": found.metric,
        "unit": found.metric_unit,
        "sense": found.sense,
        "better": found.sure_winner,
        "better_in_what_pairs_show": found.shown_winner,
        "level": of.level,
        "difference": of.mean,
        "interval": [
            of.interval_low if isfinite(of.interval_low) else None,
            of.interval_high if isfinite(of.interval_high) else None,
        ],
        "missed_rarer_than": of.missed_probability,
        "event_to_reverse": of.reversing_change,
        "event_reckoned_with": of.reckoned,
        "pairs": of.pairs,
        "pairs_with_half_of_the_scatter": of.carriers,
        "pairs_left_out": len(found.differences) - of.pairs,
        "runs": found.run_count,
        "budget": found.budget,
        **drives,
    }
