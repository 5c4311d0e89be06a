"""Energy residuals of drives that start slowly, where the dampers of seated rollers are strongest."""

import argparse
import math
from collections.abc import Iterator
from itertools import product
from typing import Literal

from common.cases import Line, case, case_option
from common.drives import equal_sprocket_values, two_sprockets

from warpchain import Drive, Record, simulate

TEETH, STIFFNESS, RESTITUTION = (12, 19, 30), (6e6, 2.4e7), (0.2, 0.6)
LIGHTNESS = (0.2, 0.5, 1.0, 2.0, 3.5, 10.0)
PITCH, MASS, DURATION = 0.0127, 0.0088, 0.02


def slow_start(
    teeth: int, lightness: float, stiffness: float, restitution: float, integrator: str, speed: float
) -> Drive:
    """Two sprockets, the second of inertia z m R^2 / g, in the first half of a ramp."""
    radius = PITCH / (2.0 * math.sin(math.pi / teeth))
    values = equal_sprocket_values(teeth, 53 + teeth, PITCH, 0.106 * PITCH) | {
        "chain.roller_radius": 0.004255, "chain.roller_mass": MASS, "chain.stiffness": stiffness, "chain.damping": 30.0,
        "sprockets.driver.prescribed": {"speed": speed, "ramp_time": 2.0 * DURATION},
        "sprockets.driven.inertia": teeth * MASS * radius**2 / lightness,
        "sprockets.driven.load": {"torque": 2.0, "viscous": 0.02, "ramp_time": DURATION},
        "contact.sprocket": {"stiffness": 2.0 * stiffness, "restitution": restitution, "restitution_means": "rebound",
                             "clearance": 5e-5, "impact_speed_floor": 0.005},
        "run.duration": DURATION, "run.step": "auto", "run.settle": True, "run.integrator": integrator,
    }  # fmt: skip
    return two_sprockets(values)


@case(case_option("--speed", type=float, default=20.0, metavar="RAD_S", help="that the ramp leads to (default 20)"))
def starts(asked: argparse.Namespace) -> Iterator[Line]:
    """The largest energy residual of 12 slow starts each, of 12 to 30 teeth, two stiffnesses and two restitutions.

    python scripts/figures.py starts
    python scripts/figures.py starts --speed 200
    """
    ways: list[tuple[str, Literal["float64", "float32"]]]
    ways = [("leapfrog", "float64"), ("leapfrog", "float32"), ("rk4", "float64")]
    yield ("g", *(f"{integrator}, {precision}" for integrator, precision in ways))
    for lightness in LIGHTNESS:
        found = []
        for integrator, precision in ways:
            each = product(TEETH, STIFFNESS, RESTITUTION)
            drives = [slow_start(z, lightness, k, e, integrator, asked.speed) for z, k, e in each]
            run = simulate(drives, record=Record("none"), window=(0.0, DURATION), precision=precision, device="cpu")
            found.append(max(abs(row["energy_residual_relative"]) for row in run.metrics.to_pylist()))
        yield (f"{lightness:g}", *(f"{residual:.1e}" for residual in found))
