"""A silent chain beside a roller chain of as many links on the same wheels."""

import argparse
from collections.abc import Iterator
from functools import partial
from typing import Any

from common.cases import Line, case, case_option
from common.timing import run_in_turns, second_best_rate

from benches.chains import roller_step_rate
from warpchain import Drive

PITCH = 9.525e-3
LAW = {"restitution": 0.3, "impact_speed_floor": 0.02, "clearance": 4e-5, "stiffness": 5e7}
ROLLER: dict[str, Any] = {"roller_radius": 3.175e-3}
SILENT: dict[str, Any] = {"kind": "silent"}


def two_wheels(kind: dict[str, Any]) -> Drive:
    """Two wheels of 23 teeth and a chain of 70 links of a kind, pulled by a slider."""
    chain = {"pitch": PITCH, "links": 70, "mass_per_length": 1.0, "stiffness": 2e7, "damping_ratio": 0.02}
    slider = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 0.0, "damping": 50.0, "preload": 1000.0}
    load = {"torque": 5.0, "ramp_time": 0.02}
    driver = {"name": "drive", "center": [0.0, 0.0], "prescribed": {"speed": 200.0, "ramp_time": 0.02}}
    driven = {"name": "driven", "center": [0.222, 0.0], "inertia": 2e-4, "mass": 1.0, "mount": slider, "load": load}
    values: dict[str, Any] = {
        "chain": chain | kind,
        "sprockets": [{"teeth": 23, "wrap": "ccw"} | wheel for wheel in (driver, driven)],
        "contact": {"sprocket": LAW},
        "run": {"duration": 1.0, "step": 6e-6, "sample_rate": 2000.0},
    }
    return Drive(**values)


@case(
    case_option("--steps", type=int, default=100_000, help="of each timed run (default 100000)"),
    case_option("--rounds", type=int, default=7, help="of which the best but one counts (default 7)"),
    case_option("--device", default="cpu", help="cpu (one core, CPU time; default) or such as cuda:0"),
    case_option("--variants", type=int, default=1, help="how many at once"),
)
def silent(asked: argparse.Namespace) -> Iterator[Line]:
    """Link-steps a second of a silent and a roller chain.

    python scripts/bench.py silent
    python scripts/bench.py silent --device cuda:0 --variants 1056 --steps 5000

    Both take a step of 6 us. All are timed in turns, and the best but one is compared: ratios are what counts.
    """
    yield ("", "silent", "roller", "time of one over the other")
    for precision in ("float64", "float32"):
        for metrics in (False, True):
            fixed = {"device": asked.device, "count": asked.variants, "precision": precision, "metrics": metrics}
            timed = partial(roller_step_rate, steps=asked.steps, **fixed)
            jobs = {"silent": partial(timed, two_wheels(SILENT)), "roller": partial(timed, two_wheels(ROLLER))}
            best = {kind: second_best_rate(found) for kind, found in run_in_turns(jobs, asked.rounds).items()}
            words = f"{precision}{', metrics' if metrics else ''}"
            yield (words, best["silent"], best["roller"], f"{best['roller'] / best['silent']:.2f}")
