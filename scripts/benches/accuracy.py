"""float32 beside float64, and one device beside the other."""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive
from numpy.typing import NDArray

from benches.drives import drive_by_name
from warpchain import Drive, Record, simulate
from warpchain.engine.recorder import RecordingOptions
from warpchain.engine.simulation import MEMORY, schedules_of
from warpchain.engine.subensemble import DeviceSettings, Subensemble, Variants
from warpchain.model.stacks import stacks_of_drives
from warpchain.progress import StopRequest
from warpchain.results.channels import frame_with_channels
from warpchain.results.metrics import metrics_table

SECONDS = {"two": 0.4, "rk4": 0.2, "marine": 0.6, "engine": 0.1, "car": 0.03, "industrial": 0.6, "motorcycle": 0.2}
"""Simulated time [s]; the metrics are of the second half."""
COLUMNS = ("tension_mean", "tension_std", "tension_max")


@case(
    case_option(
        "names", metavar="NAME", nargs="*", default=["two", "marine", "engine"], help=f"of {', '.join(SECONDS)}"
    ),
    case_option("--copies", type=int, default=64, help="of each drive (default 64)"),
    case_option("--device", default="cuda:0", help="such as cpu (default cuda:0)"),
)
def accuracy(asked: argparse.Namespace) -> Iterator[Line]:
    """Energy residual and tension at float32 beside float64: copies unlike by 0.1 % in the links' stiffness.

    python scripts/bench.py accuracy car rk4 --device cuda:0
    """
    yield ("drive", "precision", "ok", "residual", "its largest", *(f"{name} [N]" for name in COLUMNS))
    for name in asked.names:
        drive, factors = drive_by_name(name), 1.0 + 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, asked.copies)
        drives = [drive.with_values({"chain.stiffness": drive.chain.stiffness * factor}) for factor in factors]
        for precision in ("float32", "float64"):
            options = {"device": asked.device, "precision": precision, "record": Record("none")}
            run = simulate(drives, duration=SECONDS[name], **options)
            residual = np.abs(np.array(run.metrics["energy_residual_relative"].to_pylist(), dtype=float))
            means = (f"{np.mean(run.metrics[column].to_pylist()):.6g}" for column in COLUMNS)
            errors = (float(residual.mean()), float(residual.max()))
            yield (name, precision, int(run.ok.sum()), *errors, *means)


def _short_run(drive: Drive, device: str, rounding: float) -> tuple[NDArray[np.floating], dict[str, Any]]:
    """Rollers and metrics of 10 ms of a drive whose coordinates are off by `rounding` of them before settling."""
    record = Record("none")
    schedules = schedules_of((drive,), 0.01, None, record, (0.0, 0.01))
    share = Subensemble(
        Variants((drive,), schedules, stacks_of_drives((drive,)), np.arange(1)), frame_with_channels(())
    )
    share.packed.rollers *= 1.0 + rounding * np.random.default_rng(1).standard_normal(len(share.packed.rollers))
    recorder = share.make_recorder(RecordingOptions(record, "float64", MEMORY), 1)
    outcome = share.run(DeviceSettings(device, "float64", 1), recorder, None, lambda *_: None, StopRequest())
    return share.packed.rollers, metrics_table(outcome.ends, outcome.metric_blocks()).to_pylist()[0]


@case(
    case_option("names", metavar="NAME", nargs="*", default=["car", "marine", "engine", "v6", "balance_shafts"]),
    case_option(
        "--device", default="cpu", help="that is held against the CPU (default: the CPU after another rounding)"
    ),
)
def settled(asked: argparse.Namespace) -> Iterator[Line]:
    """Settled chains and the largest change of a mean tension over 10 ms, on a device beside the CPU, float64.

    python scripts/bench.py settled
    python scripts/bench.py settled --device cuda:0
    """
    yield ("drive", "steps", "its steps", "apart by [m]", "mean tension")
    for name in asked.names:
        drive = example_drive(name)
        first, row = _short_run(drive, "cpu", 0.0)
        second, its_row = _short_run(drive, asked.device, 1e-16 if asked.device == "cpu" else 0.0)
        apart = float(np.abs(first - second).max())
        means = [key for key in row if key.endswith("tension_mean") and "->" not in key]
        steps = [sum(value for key, value in of.items() if key.endswith("settle_steps")) for of in (row, its_row)]
        yield (name, *steps, f"{apart:.1e}", f"{max(abs(its_row[key] / row[key] - 1.0) for key in means):.0e}")
