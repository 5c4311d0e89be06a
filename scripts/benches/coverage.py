"""Standard errors of means, held against how far means of windows are from the long-run mean."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from unittest.mock import patch

import numpy as np
from common.cases import Line, case, case_option
from common.drives import Values, equal_sprocket_values, example_drive, two_sprockets, without_friction

from warpchain import Drive, Record, simulate
from warpchain.engine.checkpoint import States
from warpchain.kernels.statistics import BATCHES
from warpchain.results import metric_formulas
from warpchain.results.window_statistics import INTERVAL_ERRORS, Array, mean_standard_error

TURNS = 4.0
"""Of the chain in a window."""
JOINED = (1, 2, 4)
"""Windows one after the other that are also taken for one, its batches as many of theirs."""
LEAST = 4
"""Windows that tell what lies behind them."""
SAME = 1e-5
"""A mean that scatters by less than this of itself is the same in all windows, or prescribed."""
CHATTERING: Values = equal_sprocket_values(17, 50, 0.05) | {
    "sprockets.driver.prescribed": {"speed": 30.0, "ramp_time": 0.1},
    "run.settle": True,
    "run.gravity": [0.0, 0.0],
}


AUTO: Values = CHATTERING | {"run.step": "auto"}
TWO: dict[str, Values] = {
    "two": CHATTERING,
    "two, automatic step": AUTO,
    "two, pulsing load": AUTO
    | {"sprockets.driven.load": {"torque": 300.0, "harmonics": [{"order": 1.5, "amplitude": 150.0}]}},
    "two, sagging": AUTO
    | {"run.gravity": [0.0, -9.81], "sprockets.driven.center": [0.822, 0.0], "chain.damping": 500.0},
    "two, fast": AUTO
    | {"sprockets.driver.prescribed": {"speed": 50.0, "ramp_time": 0.1}, "sprockets.driven.load": {"torque": 600.0}},
    "two, light load": AUTO | {"sprockets.driven.load": {"torque": 100.0}},
    "two, light damping": AUTO | {"chain.damping": 300.0, "sprockets.driven.inertia": 5.0},
    "two, taut": AUTO | equal_sprocket_values(25, 70, 0.05),
    "two, friction": AUTO | {"chain.joint": {"friction": 0.1, "pin_radius": 0.007}, "contact.sprocket.friction": 0.1},
}
"""The values of two equal sprockets."""
LONG: Values = AUTO | equal_sprocket_values(17, 150, 0.05)

MEMORIES = (0.025, 0.05, 0.1, 0.125, 0.2, 0.25, 0.5, 1.0, 2.0)
"""Over the window, of sequences whose correlation falls by e within one."""


@dataclass(frozen=True)
class CoverageSample:
    """A drive for coverage of errors: turns of the chain left out at the start, windows that follow, and copies."""

    drive: Drive
    start: int = 5
    windows: int = 16
    copies: int = 8


SAMPLES: dict[str, Callable[[], CoverageSample]] = {
    **{
        name: partial(lambda values: CoverageSample(two_sprockets(values), 10, copies=16), values)
        for name, values in TWO.items()
    },
    "two, long": lambda: CoverageSample(two_sprockets(LONG), 10, 8),
    "motorcycle without friction": lambda: CoverageSample(without_friction(example_drive("motorcycle"))),
    "marine without friction": lambda: CoverageSample(
        without_friction(example_drive("marine")), 32, 8
    ),  # whose waves take so long to grow
    "industrial without friction": lambda: CoverageSample(without_friction(example_drive("industrial")), 10, 8),
    "engine without friction": lambda: CoverageSample(without_friction(example_drive("engine")), 10),
    "car without friction": lambda: CoverageSample(without_friction(example_drive("car")), 10),
    "motorcycle": lambda: CoverageSample(example_drive("motorcycle")),
    "marine": lambda: CoverageSample(example_drive("marine"), windows=8),
    "engine": lambda: CoverageSample(example_drive("engine"), 10),
    "car": lambda: CoverageSample(example_drive("car"), 10),
}


def window_batches(sample: CoverageSample) -> tuple[Array, Array]:
    """Means of batches, and their weights (W, M, copies, batches), of the M means that have errors."""
    driver = sample.drive.sprockets[sample.drive.driver]
    assert driver.prescribed is not None and driver.prescribed.speed is not None
    turn = 2.0 * np.pi * sample.drive.chain.links / (driver.teeth * abs(driver.prescribed.speed))
    states, noted, found = States(), [], []

    def noted_standard_error(means: Array, weights: Array) -> Array:
        """Standard error of batch means, which it notes."""
        noted.append((means, weights))
        return mean_standard_error(means, weights)

    for w in range(-1, sample.windows):
        begin, end = (sample.start + TURNS * k for k in (w, w + 1))
        window = (turn * begin if w >= 0 else 0.0, turn * end)
        following = States(begin=states.kept)
        with patch.object(metric_formulas, "mean_standard_error", noted_standard_error):
            simulate(
                sample.drive, device="cpu", duration=window[1], window=window, replicates=sample.copies,
                record=Record("none"), states=following,
            )  # fmt: skip
        states = following
        if w >= 0:
            found.append(np.array(noted))
        noted.clear()
    means, weights = np.moveaxis(np.array(found), 2, 0)
    return means, weights


def joined_windows(values: Array, count: int) -> Array:
    """Batches (W, M, copies, batches) of `count` windows that follow one another, as those of one window."""
    whole = len(values) // count
    split = np.moveaxis(values[: whole * count].reshape(whole, count, *values.shape[1:]), 1, -2)
    return split.reshape(whole, *values.shape[1:], count).mean(axis=-1)


def long_run_means(means: Array) -> Array:
    """(M, copies) means of all windows, weighted by a Hann window against ripple, over all copies.

    Where copies differ by more than their windows do, as friction holds a chain in one of many states, each has its
    own.
    """
    whole = np.moveaxis(means, 0, -2).reshape(*means.shape[1:-1], -1)
    taper = np.hanning(whole.shape[-1] + 2)[1:-1]
    own = whole @ taper / taper.sum()
    within = (means.mean(axis=-1) - own).std(axis=0).mean(axis=1, keepdims=True)
    return np.where(own.std(axis=1, keepdims=True) > within, own, own.mean(axis=1, keepdims=True))


def window_length_rows(name: str, means: Array, weights: Array) -> Iterator[Line]:
    """A row of coverage for windows of each length."""
    truth = long_run_means(means)
    for count in (count for count in JOINED if len(means) >= LEAST * count):
        heavy = joined_windows(weights, count)
        batches = joined_windows(means * weights, count) / heavy
        errors = mean_standard_error(batches, heavy)
        off = (batches * heavy).sum(axis=-1) / heavy.sum(axis=-1) - truth
        spread = np.sqrt((off * off).mean(axis=(0, 2)))
        reported = (spread > SAME * np.abs(truth.mean(axis=1))) & np.isfinite(errors).any(axis=(0, 2))
        errors, off, spread = errors[:, reported], off[:, reported], spread[reported]
        known = np.isfinite(errors)
        covered = (np.abs(off) <= INTERVAL_ERRORS * errors).sum(axis=(0, 2)) / known.sum(axis=(0, 2))
        widths = np.nanmedian(errors, axis=(0, 2)) / spread
        shares = (f"{100.0 * share:.0f} %" for share in (1.0 - known.mean(), covered.mean(), covered.min()))
        sizes = (f"{size:.2g}" for size in (np.median(widths), widths.min(), widths.max()))
        yield (name, int(count * TURNS), off[:, 0].size, *shares, *sizes)


@case(case_option("names", metavar="NAME", nargs="*", default=list(SAMPLES), help=f"of {', '.join(SAMPLES)}"))
def coverage(asked: argparse.Namespace) -> Iterator[Line]:
    """Do standard errors cover? Windows of drives whose long-run means are those of all their windows together.

    python scripts/bench.py coverage two marine

    Copies begin at other phases within a tooth. Unknown is the share of errors that are; covered that of windows whose
    mean is within `INTERVAL_ERRORS` errors of the long-run mean, where they are known, of all means of the drive and of
    the mean that is covered least; the width is the median error over the means' own scatter, of the median mean, and
    its range.
    """
    yield ("drive", "turns", "windows", "unknown", "covered", "least", "width", "from", "to")
    for name in asked.names:
        yield from window_length_rows(name, *window_batches(SAMPLES[name]()))


def correlated_windows(memory: float, count: int = 4000, length: int = 400) -> Array:
    """(count, length) windows of a random sequence of mean 0 and deviation 1 whose correlation falls by e within
    `memory`."""
    random, keep = np.random.default_rng(1), np.exp(-1.0 / (memory * length))
    x = random.normal(size=(count, length))
    for t in range(1, length):
        x[:, t] = keep * x[:, t - 1] + np.sqrt(1.0 - keep * keep) * x[:, t]
    return x


@case()
def memory(_: argparse.Namespace) -> Iterator[Line]:
    """Standard errors of sequences that forget exponentially, by their memory over the window.

    python scripts/bench.py memory

    Their long-run mean is 0. The columns are those of `coverage`.
    """
    yield ("memory", "unknown", "covered", "width")
    for share in MEMORIES:
        x = correlated_windows(share)
        error, mean = mean_standard_error(x.reshape(len(x), int(BATCHES), -1).mean(axis=-1)), x.mean(axis=-1)
        known = np.isfinite(error)
        covered = (np.abs(mean) <= INTERVAL_ERRORS * error)[known].mean()
        width = np.median(error[known]) / np.sqrt((mean * mean).mean())
        yield (f"{share:g}", f"{100.0 * (1.0 - known.mean()):.0f} %", f"{100.0 * covered:.0f} %", f"{width:.2g}")
