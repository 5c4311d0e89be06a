"""Time over the length of the chain and over the number of variants."""

import argparse
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from common.cases import Line, case, case_option
from common.timing import run_in_turns, second_best_rate
from matplotlib.figure import Figure

from benches.drives import drive_by_name, two_sprockets_of_length
from benches.probe import roller_step_rate
from warpchain.view.figures.figure_style import panel_grid

LENGTHS = (50, 100, 200, 500, 1000, 2000)
VARIANTS = (1, 4, 16, 64, 256, 1024, 4096)
WORK = 1_000_000
"""Roller-steps of a timed launch, where that is at least `FEWEST` steps: a launch itself takes some 0.1 ms."""
FAR = 20.0
"""Ratio from which the times of a figure are drawn on a logarithmic scale."""
FEWEST = {"cpu": 200, "cuda": 4000}


def step_rate(links: int, variants: int, precision: str, device: str) -> float:
    """Steps a second of so many variants of two equal sprockets; on the CPU of one core."""
    drive = drive_by_name("two") if links == drive_by_name("two").chain.links else two_sprockets_of_length(links)
    steps = max(FEWEST[device.partition(":")[0]], WORK // (links * variants))
    return 1e6 * roller_step_rate(drive, steps, precision, False, variants, device) / (links * variants)


def fitted_line(sizes: Sequence[float], seconds: Sequence[float]) -> tuple[float, float]:
    """A fixed part and a part for each [s]: a straight line, by least squares of relative errors."""
    terms = np.column_stack([np.ones(len(sizes)), sizes]) / np.asarray(seconds)[:, None]
    fixed, each = np.linalg.lstsq(terms, np.ones(len(sizes)), rcond=None)[0]
    return float(fixed), float(each)


def growth_figure(found: dict[str, tuple[Sequence[int], Sequence[float]]], rollers: int, where: str) -> Figure:
    """Nanoseconds a roller-step over either; a line that is flat is linear growth."""
    figure, axes = panel_grid(2, 2, 5.0, 3.6)
    for axis, (title, (sizes, seconds)) in zip(axes, found.items(), strict=True):
        sizes_all = np.asarray(sizes, float)
        per = sizes_all * (rollers if title == "variants" else 1)
        taken = 1e9 * np.asarray(seconds) / per
        axis.semilogx(sizes_all, taken, "o-", label="measured")
        fixed, each = fitted_line(sizes, seconds)
        axis.semilogx(sizes_all, 1e9 * (fixed + each * sizes_all) / per, "--", label="fixed part and a part for each")
        axis.set(xlabel=title, ylabel="ns a roller-step")
        if taken.max() > FAR * taken.min():
            axis.set_yscale("log")
        else:
            axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
        axis.legend()
    figure.suptitle(f"Two equal sprockets, {where}: one variant by rollers; {rollers} rollers by variants")
    return figure


@case(
    case_option("--device", default="cpu", help="cpu (one core, CPU time; default) or such as cuda:0"),
    case_option("--precision", default="float64", help="float64 (default) or float32"),
    case_option(
        "--lengths", type=int, nargs="+", default=list(LENGTHS), help="rollers of a chain, even numbers from 50"
    ),
    case_option("--variants", type=int, nargs="+", default=list(VARIANTS), help="how many at once"),
    case_option("--rounds", type=int, default=5, help="of which the best but one counts (default 5)"),
)
def growth(asked: argparse.Namespace) -> Iterator[Line]:
    """Time of a step over the rollers of one chain and over the number of variants, as a table and a figure.

    python scripts/bench.py growth

    Two equal sprockets. Growth is linear where a roller-step takes the same time. The lines below a table say what a
    step takes whatever the size, and from which size on that is less than half. Writes growth-cpu.png, or the device's.
    """
    rollers = drive_by_name("two").chain.links
    kinds = {
        "rollers": {links: (links, 1) for links in asked.lengths},
        "variants": {count: (rollers, count) for count in asked.variants},
    }
    found: dict[str, tuple[Sequence[int], Sequence[float]]] = {}
    for title, cases in kinds.items():
        jobs = {str(size): partial(step_rate, *of, asked.precision, asked.device) for size, of in cases.items()}
        seconds = [1.0 / second_best_rate(rates) for rates in run_in_turns(jobs, asked.rounds).values()]
        found[title] = list(cases), seconds
        yield (title, "us a step", "ns a roller-step")
        for (size, (links, count)), each in zip(cases.items(), seconds, strict=True):
            yield (size, f"{1e6 * each:.3f}", f"{1e9 * each / (links * count):.3f}")
        fixed, more = fitted_line(*found[title])
        half = f"half is fixed at {max(fixed, 0.0) / more:.1f} {title}"
        yield f"{1e6 * fixed:.3f} us and {1e9 * more:.3f} ns for each; {half}\n"
    where = asked.device.partition(":")[0]
    yield {f"growth-{where}": growth_figure(found, rollers, f"{where}, {asked.precision}")}
