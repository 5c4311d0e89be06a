"""The price of stepping a run in pieces: set, advance, get, against the same steps in long pieces."""

import argparse
import time
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive

from warpchain import Drive, stepping

LONG = 2000
"""Steps of a long piece."""


def ports_of_load(drive: Drive) -> tuple[str, str]:
    """Input of the first load of a drive, and the speed of its part."""
    for kind, parts in (("sprocket", drive.sprockets), ("shaft", drive.shafts)):
        for part in parts:
            if part.load is not None:
                return f"{part.name}.load_torque", f"{part.name}.{kind}_speed"
    raise SystemExit("the drive has no load")


def fastest_pieces(drives: Drive | list[Drive], device: str, steps: int, turns: int) -> tuple[float, float]:
    """Shortest times [s] of `LONG` steps: in pieces of `steps` with input and output, and in one."""
    load, speed = ports_of_load(drives if isinstance(drives, Drive) else drives[0])
    found: dict[int, list[float]] = {steps: [], LONG: []}
    clock = time.thread_time if device == "cpu" else time.perf_counter  # which others on the machine do not lengthen
    with stepping(drives, inputs=[load], outputs=[speed], device=device, workers=1, duration=10.0) as run:
        step = float(np.min(run.step))
        run.advance(LONG * step)
        for turn in range(turns):
            for count, times in found.items():
                begin = clock()
                for piece in range(LONG // count):
                    run.set({load: 1.0 + 1e-3 * (turn + piece)})
                    run.advance(count * step)
                    run.get()
                times.append(clock() - begin)
    return min(found[steps]), min(found[LONG])


@case(
    case_option("--device", default="cpu"),
    case_option("--drives", nargs="+", default=["industrial", "marine", "car", "v6"], metavar="NAME", help="examples"),
    case_option("--variants", type=int, default=1, help="of each drive (default 1)"),
    case_option("--steps", type=int, default=100, help="of a piece (default 100)"),
    case_option("--turns", type=int, default=20, help="alternations, the fastest of which counts (default 20)"),
)
def pieces(asked: argparse.Namespace) -> Iterator[Line]:
    """The time of a stepped run in pieces of 100 steps, with an input and an output, over that in pieces of 2000.

    python scripts/bench.py pieces
    python scripts/bench.py pieces --variants 64
    python scripts/bench.py pieces --device cuda:0 --variants 1056
    """
    yield ("drive", "us a step", "in pieces")
    for name in asked.drives:
        drive = example_drive(name)
        drives = drive if asked.variants == 1 else [drive] * asked.variants
        short, long = fastest_pieces(drives, asked.device, asked.steps, asked.turns)
        yield (name, f"{1e6 * long / LONG:.3g}", f"{short / long:.3f}")
