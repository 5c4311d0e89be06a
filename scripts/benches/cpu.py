"""One core beside plain C."""

import argparse
import functools
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from common.cases import Line, case, option
from common.timing import best_but_one, in_turns

from benches.drives import JOINT_FRICTION, STRIBECK, named
from benches.probe import packed_of, schedule
from benches.reference import c_program, run
from warpchain import Drive
from warpchain.engine.cpu import CpuEngine


def engine_rate(drive: Drive, variants: int, workers: int, steps: int, metrics: bool, precision: str) -> float:
    """1e6 roller-steps a second, compilation and start apart; with one worker, a second of CPU time."""
    clock = time.process_time if workers == 1 else time.perf_counter
    engine = CpuEngine(packed_of(drive, variants, precision, schedule(drive, metrics)), workers)
    buffer = engine.frame_buffer(1)
    for future in engine.advance(64, buffer):
        future.result()
    begin = clock()
    for future in engine.advance(steps, buffer):
        future.result()
    seconds = clock() - begin
    engine.close()
    return variants * drive.chain.links * steps / seconds / 1e6


def difference(drive: Drive, program: Path, steps: int = 2000) -> float:
    """Largest distance between the engine's rollers and the C program's after the same steps [m]."""
    engine = CpuEngine(packed_of(drive, 1, "float64", schedule(drive, False)), 1)
    for future in engine.advance(steps, engine.frame_buffer(1)):
        future.result()
    n = drive.chain.links
    ours = engine.state.rollers.numpy()[: 2 * n]
    engine.close()
    return float(np.abs(ours - run(program, drive, steps)[1][: 2 * n]).max())


@case(
    option("--drives", nargs="+", default=["two", "smooth"], metavar="NAME", help="two, smooth, or examples"),
    option("--steps", type=int, default=40_000, help="of each timed run (default 40000)"),
    option("--rounds", type=int, default=5, help="of which the best but one counts (default 5)"),
)
def cpu(asked: argparse.Namespace) -> Iterator[Line]:
    """Roller-steps a second and core, beside plain C doing the same work, compiled on the spot.

    python scripts/bench.py cpu

    Each is timed in turns with the C program, and the best but one is compared: ratios are what counts. On one core the
    CPU time is taken, so that what else runs on the machine does not count. The last lines tell what joint friction
    leaves of the speed. C leaves friction out: `two` and `smooth` (the marine drive without it) can be compared.
    """
    with tempfile.TemporaryDirectory() as name:
        flags = {"C": (), "C, -fno-math-errno": ("-fno-math-errno",)}
        programs = {title: c_program(Path(name), *each) for title, each in flags.items()}
        if None in programs.values():
            yield "no C compiler (cc, gcc or clang) found: the reference is left out"
        for title in asked.drives:
            yield from lines(named(title), title, {k: p for k, p in programs.items() if p}, asked)


def lines(drive: Drive, title: str, programs: dict[str, Path], asked: argparse.Namespace) -> Iterator[Line]:
    """The table of a drive."""
    n, steps = drive.chain.links, asked.steps

    def c_rate(program: Path) -> float:
        return n * steps / float(run(program, drive, steps)[0]) / 1e6

    jobs: dict[str, Callable[[], float]] = {k: functools.partial(c_rate, program) for k, program in programs.items()}
    cases = {
        "float64": (1, 1, False, "float64"),
        "float64, metrics": (1, 1, True, "float64"),
        "float32": (1, 1, False, "float32"),
        "float64, 8 variants": (8, 1, False, "float64"),
        "float64, 8 variants, 2 cores": (8, 2, False, "float64"),
    }
    for word, (variants, workers, metrics, precision) in cases.items():
        jobs[word] = functools.partial(engine_rate, drive, variants, workers, steps, metrics, precision)
    rubbing = {"joint friction": JOINT_FRICTION, "Stribeck": STRIBECK}
    for precision in ("float64", "float32"):
        for word, values in rubbing.items():
            changed = drive.with_values(values)
            jobs[f"{precision}, {word}"] = functools.partial(engine_rate, changed, 1, 1, steps, False, precision)
    best = {word: best_but_one(found) for word, found in in_turns(jobs, asked.rounds).items()}
    yield f"\n{title}: {n} rollers, {len(drive.sprockets)} sprockets, {len(drive.guides)} guide-bars, {steps} steps"
    yield ("", "1e6 roller-steps/s", *(f"of {word}" for word in programs), "of float64, 1 variant")
    for word, rate in best.items():
        yield (word, rate, *(f"{rate / best[program]:.2f}" for program in programs), f"{rate / best['float64']:.2f}")
    if programs and title in ("two", "smooth"):
        apart = difference(drive, next(iter(programs.values())))
        yield f"largest difference in position from C after 2000 steps: {apart:.1e} m"
