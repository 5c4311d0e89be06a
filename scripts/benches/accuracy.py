"""float32 beside float64."""

import argparse
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case, option

from benches.drives import named
from warpchain import Record, simulate

SECONDS = {"two": 0.4, "rk4": 0.2, "marine": 0.6, "engine": 0.1, "car": 0.03, "industrial": 0.6, "motorcycle": 0.2}
"""Simulated time [s]; the metrics are of the second half."""
COLUMNS = ("tension_mean", "tension_std", "tension_max")


@case(
    option("names", metavar="NAME", nargs="*", default=["two", "marine", "engine"], help=f"of {', '.join(SECONDS)}"),
    option("--copies", type=int, default=64, help="of each drive (default 64)"),
    option("--device", default="cuda:0", help="such as cpu (default cuda:0)"),
)
def accuracy(asked: argparse.Namespace) -> Iterator[Line]:
    """Energy residual and tension at float32 beside float64: copies unlike by 0.1 % in the links' stiffness.

    python scripts/bench.py accuracy car rk4 --device cuda:0
    """
    yield ("drive", "precision", "ok", "residual", "its largest", *(f"{name} [N]" for name in COLUMNS))
    for name in asked.names:
        drive, factors = named(name), 1.0 + 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, asked.copies)
        drives = [drive.with_values({"chain.stiffness": drive.chain.stiffness * factor}) for factor in factors]
        for precision in ("float32", "float64"):
            options = {"device": asked.device, "precision": precision, "record": Record("none")}
            run = simulate(drives, duration=SECONDS[name], **options)
            residual = np.abs(np.array(run.metrics["energy_residual_relative"].to_pylist(), dtype=float))
            means = (f"{np.mean(run.metrics[column].to_pylist()):.6g}" for column in COLUMNS)
            errors = (float(residual.mean()), float(residual.max()))
            yield (name, precision, int(run.ok.sum()), *errors, *means)
