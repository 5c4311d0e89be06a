"""The automatic step."""

import argparse
from collections.abc import Sequence

import numpy as np
from common.cases import case, option

from drawings.example_table import copies
from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.timestep import automatic_step, step_limit
from warpchain.examples import drive_path

ENGINE_SCALE = 12.7 / 9.525
"""Of the engine example when an 08B chain runs on it."""


def engine_08b() -> Drive:
    """The engine example a third larger, on 08B and the widest gaps of ISO 606."""
    drive = load_drive(drive_path("engine"))
    values = {f"sprockets.{s.name}.center": [ENGINE_SCALE * x for x in s.center] for s in drive.sprockets}
    for guide in drive.guides:
        values[f"guides.{guide.name}.start"] = [ENGINE_SCALE * x for x in guide.bar.start]
        values[f"guides.{guide.name}.end"] = [ENGINE_SCALE * x for x in guide.bar.end]
    return drive.with_values(values | {"chain.size": "08B", "chain.stiffness": "estimate"} | gap("maximum"))


def gap(name: str) -> dict[str, str | float | None]:
    """The values that give a drive's sprockets a tooth gap of ISO 606, entered at 0.02 m/s at least."""
    return {
        "contact.sprocket.profile": "iso606",
        "contact.sprocket.gap": name,
        "contact.sprocket.clearance": None,
        "contact.sprocket.seat_angle": None,
        "contact.sprocket.impact_speed_floor": 0.02,
    }


def drives() -> dict[str, Drive]:
    """The drives by name."""
    return {
        "engine on 08B, iso606 maximum": engine_08b(),
        "industrial, iso606 maximum": load_drive(drive_path("industrial")).with_values(gap("maximum")),
        "motorcycle, iso606 minimum": load_drive(drive_path("motorcycle")).with_values(gap("minimum")),
        "marine": load_drive(drive_path("marine")),
    }


def row(drive: Drive, count: int, times: float, device: str | None) -> Sequence[str]:
    """A row of the table: how many are suspect, and the worst of them."""
    step = times * automatic_step(drive)
    table = simulate(
        copies(drive, count), step=step, record=Record(variants="none"), device=device, progress=True
    ).metrics
    diverged = np.asarray(table["diverged"])
    residual = np.abs(np.ma.masked_invalid(np.asarray(table["energy_residual_relative"], float)))
    mean = np.ma.masked_invalid(np.asarray(table["tension_mean"], float))
    most = np.ma.masked_invalid(np.asarray(table["tension_max"], float))
    if "status" in table.column_names:
        suspect = sum(status != "ok" for status in table["status"].to_pylist())
    else:
        suspect = int((diverged | (residual.filled(1.0) > 0.01)).sum())
    return [
        f"{step:.3g}",
        f"{step / step_limit(drive):.2f}",
        f"{suspect} of {count}",
        f"{residual.max():.1e}",
        f"{mean.mean():.4g}",
        f"{mean.std() / mean.mean():.2%}",
        f"{most.max():.4g}",
    ]


@case(
    option("--copies", type=int, default=150, help="of each drive"),
    option("--times", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="multiples of the automatic step"),
    option("--device", help="as of simulate"),
)
def step(asked: argparse.Namespace) -> None:
    """Does `step = "auto"` hold? Copies of four drives, 1e-9 apart, at the automatic step and at multiples of it.

    python scripts/figures.py step [--copies 150] [--times 1 2 4] [--device cuda]

    A copy is suspect where its status says so. The residual is the largest of the energy balance's over the turnover;
    the scatter of the mean tension says what the residual is to be compared with.
    """
    print("| drive | step [s] | of the limit | suspect | residual | tension [N] | scatter | largest [N] |")
    print("|---|---|---|---|---|---|---|---|")
    for name, drive in drives().items():
        for times in asked.times:
            print("| " + " | ".join([name, *row(drive, asked.copies, times, asked.device)]) + " |", flush=True)
