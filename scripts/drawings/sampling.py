"""Metrics that are not taken every step."""

import argparse
from collections.abc import Mapping
from typing import Any

import numpy as np
from common.cases import case

from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.results.engineering_report import HandedIn
from warpchain.results.scene import strand_displacement

WINDOWS = {"industrial": (0.2, 40_000), "marine": (0.5, 30_000), "motorcycle": (0.1, 40_000)}
"""Where the window of each example begins [s], and its steps."""

SMOOTH = {f"contact.sprocket.{name}": None for name in ("friction", "static_friction", "stribeck_speed")}


def off_mean(row: Mapping[str, Any], name: str, values: np.ndarray) -> float:
    """How far a mean is from that of all values, in standard errors of its own."""
    return float(abs(row[name] - values.mean()) / row[f"{name}_se"])


def misses(drive: Drive, start: float, steps: int) -> dict[str, float]:
    """How far metrics of a window that begins at `start` [s] are from those of its every step.

    Returns:
        `..._mean`: in standard errors of the metric; `..._std`, `..._rms`, `..._max` and `impulse`: relative;
        `tension_min`, `speed_range`: of the range of tensions, of speeds. Of all sprockets, strands or guide-bars the
        worst.
    """
    step = resolve_step(drive)
    end = start + steps * step
    run = simulate(drive, device="cpu", duration=end, window=(start, end), record=Record(rate=1.0 / step))
    row, whole = run.metrics.to_pylist()[0], HandedIn(run[0], start - 0.25 * step, end)
    seen = whole.part
    tension, hubs = np.asarray(seen.tension, dtype=float), whole.hubs
    spread = tension.max() - tension.min()
    found = {
        "tension_mean": off_mean(row, "tension_mean", tension),
        "tension_std": abs(row["tension_std"] / tension.std() - 1.0),
        "tension_max": 1.0 - row["tension_max"] / tension.max(),
        "tension_min": (row["tension_min"] - tension.min()) / spread,
    }
    names = ("hub_force_mean", "hub_force_max", "speed_mean", "speed_std", "speed_range")
    worst = {name: [0.0] for name in (*names, "displacement_mean", "displacement_rms")}
    for s, sprocket in enumerate(drive.sprockets):
        speed = np.asarray(seen.sprocket_speed, dtype=float)[:, s]
        if sprocket.prescribed is None:
            worst["speed_mean"].append(off_mean(row, f"{sprocket.name}.speed_mean", speed))
            worst["speed_std"].append(abs(row[f"{sprocket.name}.speed_std"] / speed.std() - 1.0))
            least, most = row[f"{sprocket.name}.speed_min"], row[f"{sprocket.name}.speed_max"]
            worst["speed_range"].append(max(least - speed.min(), speed.max() - most) / np.ptp(speed))
        for c, axis in enumerate("xy"):
            worst["hub_force_mean"].append(off_mean(row, f"{sprocket.name}.hub_force_{axis}_mean", hubs[:, s, c]))
        worst["hub_force_max"].append(1.0 - row[f"{sprocket.name}.hub_force_max"] / np.hypot(*hubs[:, s].T).max())
    for s, name in enumerate(drive.strand_names):
        values = strand_displacement(seen, s)
        worst["displacement_mean"].append(off_mean(row, f"{name}.displacement_mean", values))
        worst["displacement_rms"].append(abs(row[f"{name}.displacement_rms"] / np.sqrt((values**2).mean()) - 1.0))
    teeth = np.asarray(seen.sprocket_force, dtype=float)
    largest = max(row[f"{sprocket.name}.force_max"] for sprocket in drive.sprockets)
    impulse = sum(row[f"{sprocket.name}.impulse"] for sprocket in drive.sprockets)
    found["force_max"] = 1.0 - largest / teeth.max()
    found["impulse"] = abs(impulse / np.trapezoid(teeth.sum(axis=1), seen.time) - 1.0)
    return found | {name: max(values) for name, values in worst.items()}


@case()
def sampling(asked: argparse.Namespace) -> None:
    """Metrics that are not taken every step, beside the same of every step: does it matter?

    python scripts/figures.py sampling

    Tensions of links are added up every 32nd or 64th step (`engine.sampling`), forces and speeds every fourth, at which
    they and the tensions are held against the largest so far too (`kernels.sums`). A window of each drive is recorded
    step by step. Of means: how far off they are, in standard errors of their own. Of largest values: the share that is
    missed; of the smallest tension and of speeds, of their range. Without friction on teeth, which the hub forces of
    frames leave out.
    """
    found = {
        name: misses(load_drive(drive_path(name)).with_values(SMOOTH), *window) for name, window in WINDOWS.items()
    }
    print(f"{'':18s}" + "".join(f"{name:>12s}" for name in found))
    for metric in next(iter(found.values())):
        print(f"{metric:18s}" + "".join(f"{values[metric]:12.1e}" for values in found.values()))
