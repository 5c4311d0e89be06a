"""What the performance page aims at, item by item, beside what a benchmark found."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

TWO, MARINE = "two equal 30-tooth sprockets", "marine drive"
FIVE = "that differ in five values"
SMOOTH = f"{FIVE}, without friction"

Got = Callable[[str, str], float]
"""A figure of a case by its name, NaN where that has not been measured."""

Rows = Iterator[tuple[str, float, str]]
"""A figure in words, what was found, and what is aimed at."""


@dataclass(frozen=True)
class Aim:
    """A figure that is aimed at."""

    item: int
    words: str
    value: float  # NaN where a case has not been measured
    aim: str
    cases: tuple[str, ...]  # that it hangs on


def packing(got: Got) -> Rows:
    """Item 1: assembly in batches."""
    yield "10,000 different marine drives packed, one core [s]", got("packing", "packed"), "under 0.7"
    yield "    adjusted by a place, over Drive.with_values", got("packing", "adjusted"), ""


def whole(got: Got) -> Rows:
    """Item 2: from drives to the table of metrics."""
    for precision, seconds in (("float64", 12), ("float32", 9)):
        for how in (FIVE, SMOOTH):
            case = f"headline {how} {precision}"
            yield f"10,000 marine variants {how}, {precision} [s]", got(case, "seconds"), f"under {seconds}"
            yield "    of which packing and the table [s]", got(case, "before and after"), ""
    for precision in ("float64", "float32"):
        yield f"8,000 of 224 kinds beside one kind, {precision}", got(f"kinds {precision}", "times"), "at most 1.5"
        yield f"the study command beside the run, {precision}", got(f"study {precision}", "overhead"), "at most 0.15"


def single(got: Got) -> Rows:
    """Item 3: float32."""
    loop = got("float64", "loop")
    yield "operations on float64 in a step at float32, of the kind of drive with most", loop, "0"
    for variants, rate in ((16896, "80"), (1056, "65")):
        case = f"table {TWO} float32 {variants}"
        yield f"two sprockets, {variants:,} variants, float32 [1e9/s]", got(case, "bare"), rate
        yield "    the CUDA reference", got(case, "cuda"), ""
    ratios = []
    for title in (TWO, MARINE):
        for variants in (1, 1056, 16896):
            rates = [got(f"table {title} {precision} {variants}", "bare") for precision in ("float32", "float64")]
            ratios.append(rates[0] / rates[1])
    yield "float32 beside float64, where it gains least", float(np.min(ratios)), "at least 1"


def measuring(got: Got) -> Rows:
    """Item 4: metrics."""
    for precision, least in (("float64", 0.9), ("float32", 0.85)):
        for title in (TWO, MARINE):
            case = f"table {title} {precision} 16896"
            part = got(case, "metrics") / got(case, "bare")
            yield f"{title} in the window, part of bare, {precision}", part, f"at least {least}"
            run = got(f"runs {title} {precision}", "of bare")
            yield "    whole runs with metrics of the second half, as is usual", run, f"at least {least}"


def few(got: Got) -> Rows:
    """Item 5: few variants."""
    for title in (TWO, MARINE):
        alone, crowd = f"table {title} float64 1", f"table {title} float64 1056"
        yield f"{title}, one variant alone, float64 [us a step]", got(alone, "us"), "1.2"
        yield f"{title}, 1,056 variants, part of CUDA", got(crowd, "bare") / got(crowd, "cuda"), "at least 0.9"
    yield "the device that is chosen over the faster one, 1 to 512 variants [times]", got("choice", "times"), "1"


def long(got: Got) -> Rows:
    """Item 6: long chains."""
    usual = got("rollers 510 float64", "bare")
    yield "1,022 links beside 510", got("rollers 1022 float64", "bare") / usual, "1"
    yield "4,000 links beside 510", got("rollers 4000 float64", "bare") / usual, "1"


def several(got: Got) -> Rows:
    """Item 7: several GPUs."""
    count = got("gpus", "count")
    name = "GPUs" if math.isnan(count) else f"{count:.0f} GPUs"
    yield f"{name} beside one, the run", got("gpus", "times"), "3.8 of 4"
    yield "    from drives to table", got("gpus", "whole"), ""


def processor(got: Got) -> Rows:
    """Item 8: the CPU."""
    for title in (TWO, MARINE):
        yield f"{title} on a core, part of C with -fno-math-errno", got(f"cpu {title}", "bare"), "at least 1"
        yield "    with metrics, part of plain C", got(f"cpu {title}", "metrics"), "at least 0.95"


def start(got: Got) -> Rows:
    """Item 9: how long until something runs."""
    yield "run industrial, nearly nothing simulated [s]", got("start warm", "seconds"), "1.6 beside the simulation"
    yield "    with no kernel compiled [s]", got("start cold", "seconds"), "12 beside the simulation"
    yield "study status [s]", got("start status", "seconds"), "0.3"


ITEMS = (packing, whole, single, measuring, few, long, several, processor, start)
"""What is aimed at, by the number of its item less one."""


def aims(found: Mapping[str, Mapping[str, float]]) -> Iterator[Aim]:
    """What is aimed at, beside what was found (figures by the names of cases)."""
    asked: list[str] = []

    def got(case: str, name: str) -> float:
        asked.append(case)
        return found.get(case, {}).get(name, math.nan)

    for item, rows in enumerate(ITEMS, 1):
        for words, value, aim in rows(got):
            yield Aim(item, words, value, aim, tuple(dict.fromkeys(asked)))
            asked.clear()
