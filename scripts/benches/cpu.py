"""One core beside plain C."""

import argparse
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from common.cases import Line, case, case_option
from common.timing import run_in_turns, second_best_rate

from benches.drives import JOINT_FRICTION, STRIBECK, without_valves
from benches.probe import endless_schedule, packed_copies, roller_step_rate
from benches.reference import c_program, run_program
from warpchain import Drive
from warpchain.engine.cpu import CpuEngine


def c_program_rate(program: Path, drive: Drive, steps: int) -> float:
    """1e6 roller-steps a second of the C program."""
    return drive.chain.links * steps / run_program(program, drive, steps)[0] / 1e6


def c_program_distance(drive: Drive, program: Path, steps: int = 2000) -> float:
    """Largest distance between the engine's rollers and the C program's after the same steps [m]."""
    engine = CpuEngine(packed_copies(drive, 1, "float64", endless_schedule(drive, False)), 1)
    for future in engine.advance(steps, engine.frame_buffer(1)):
        future.result()
    n = drive.chain.links
    ours = engine.state.rollers.numpy()[: 2 * n]
    engine.close()
    return float(np.abs(ours - run_program(program, drive, steps)[1][: 2 * n]).max())


def timing_jobs(drive: Drive, programs: Mapping[str, Path], steps: int) -> dict[str, Callable[[], float]]:
    """Jobs that time a drive, by title: rates in 1e6 roller-steps a second."""
    jobs: dict[str, Callable[[], float]] = {
        title: partial(c_program_rate, of, drive, steps) for title, of in programs.items()
    }
    jobs |= {
        "float64": partial(roller_step_rate, drive, steps, "float64", False, 1, "cpu"),
        "float64, metrics": partial(roller_step_rate, drive, steps, "float64", True, 1, "cpu"),
        "float32": partial(roller_step_rate, drive, steps, "float32", False, 1, "cpu"),
        "float64, 8 variants": partial(roller_step_rate, drive, steps, "float64", False, 8, "cpu"),
        "float64, 8 variants, 2 cores": partial(roller_step_rate, drive, steps, "float64", False, 8, "cpu", 2),
    }
    if drive.chain.joint is None:
        for precision, (word, values) in product(
            ("float64", "float32"), {"joint friction": JOINT_FRICTION, "Stribeck": STRIBECK}.items()
        ):
            rubbing = drive.with_values(values)
            jobs[f"{precision}, {word}"] = partial(roller_step_rate, rubbing, steps, precision, False, 1, "cpu")
    return jobs


@case(
    case_option("drives", nargs="*", default=["two", "smooth"], help="two, smooth, or examples (default two smooth)"),
    case_option("--steps", type=int, default=40_000, help="of each timed run (default 40000)"),
    case_option("--rounds", type=int, default=5, help="of which the best but one counts (default 5)"),
)
def cpu(asked: argparse.Namespace) -> Iterator[Line]:
    """Roller-steps a second and core, beside plain C doing the same work, compiled on the spot.

    python scripts/bench.py cpu
    python scripts/bench.py cpu car

    Each is timed in turns with the C program, and the best but one is compared: ratios are what counts. On one core the
    CPU time is taken, so that what else runs on the machine does not count. `two` and `smooth` (the marine drive) are
    without friction; their last lines have the part of the speed that joint friction leaves. The C program has
    friction, curved guides, arms and oil, but no mounts, shafts, tables or links that differ.
    """
    steps = asked.steps
    with tempfile.TemporaryDirectory() as name:
        flags = {"C": (), "C, -fno-math-errno": ("-fno-math-errno",)}
        found = {title: c_program(Path(name), *each) for title, each in flags.items()}
        programs = {title: program for title, program in found.items() if program}
        for title in asked.drives:
            drive = without_valves(title)
            timed = run_in_turns(timing_jobs(drive, programs, steps), asked.rounds)
            best = {word: second_best_rate(rates) for word, rates in timed.items()}
            yield f"\n{title}: {drive.chain.links} rollers, {steps} steps"
            yield ("", "us/step", "1e6 roller-steps/s", *(f"of {word}" for word in (*programs, "float64")))
            for word, speed in best.items():
                each = drive.chain.links / speed
                yield (word, f"{each:.3f}", speed, *(f"{speed / best[of]:.2f}" for of in (*programs, "float64")))
            if programs:
                apart = c_program_distance(drive, programs["C"])
                yield f"largest difference in position from C after 2000 steps: {apart:.1e} m"
