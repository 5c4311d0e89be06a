"""Metrics that are not taken every step."""

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example_drive

from warpchain import Drive, Record, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.strand_passing import strand_displacement

WINDOWS = {"industrial": (0.2, 40_000), "marine": (0.5, 30_000), "motorcycle": (0.1, 40_000)}
"""Where the window of each example begins [s], and its steps."""
SMOOTH = {f"contact.sprocket.{name}": None for name in ("friction", "static_friction", "stribeck_speed")}


def sampling_misses(drive: Drive, start: float, steps: int) -> dict[str, float]:
    """Differences of metrics of a window that begins at `start` [s] from those of its every step.

    Returns:
        `..._mean`: in standard deviations over time; `..._std`, `..._rms`, `..._max` and `impulse`: relative;
        `tension_min`, `speed_range`: of the range of tensions, of speeds. Of all sprockets, strands or guide-bars the
        worst.
    """
    step = resolve_step(drive)
    end = start + steps * step
    run = simulate(drive, device="cpu", duration=end, window=(start, end), record=Record(rate=1.0 / step))
    row, whole = run.metrics.to_pylist()[0], EngineeringReport(run[0], start - 0.25 * step, end)
    seen = whole.part
    tension, hubs = np.asarray(seen.tension, dtype=float), whole.hub_forces
    found: defaultdict[str, list[float]] = defaultdict(list)

    def note_miss(what: str, name: str, values: np.ndarray) -> None:
        """Notes by how many standard deviations a metric misses the mean of values."""
        found[what].append(float(abs(row[name] - values.mean()) / values.std()))

    note_miss("tension_mean", "tension_mean", tension)
    found["tension_std"].append(abs(row["tension_std"] / tension.std() - 1.0))
    found["tension_max"].append(1.0 - row["tension_max"] / tension.max())
    found["tension_min"].append((row["tension_min"] - tension.min()) / np.ptp(tension))
    for s, sprocket in enumerate(drive.sprockets):
        name, speed = sprocket.name, np.asarray(seen.sprocket_speed, dtype=float)[:, s]
        if sprocket.prescribed is None:
            note_miss("speed_mean", f"{name}.speed_mean", speed)
            found["speed_std"].append(abs(row[f"{name}.speed_std"] / speed.std() - 1.0))
            beyond = max(row[f"{name}.speed_min"] - speed.min(), speed.max() - row[f"{name}.speed_max"])
            found["speed_range"].append(beyond / np.ptp(speed))
        for c, axis in enumerate("xy"):
            note_miss("hub_force_mean", f"{name}.hub_force_{axis}_mean", hubs[:, s, c])
        found["hub_force_max"].append(1.0 - row[f"{name}.hub_force_max"] / np.hypot(*hubs[:, s].T).max())
    for s, name in enumerate(drive.strand_names):
        values = strand_displacement(seen, s)
        note_miss("displacement_mean", f"{name}.displacement_mean", values)
        found["displacement_rms"].append(abs(row[f"{name}.displacement_rms"] / np.sqrt((values**2).mean()) - 1.0))
    teeth = np.asarray(seen.sprocket_force, dtype=float)
    largest = max(row[f"{sprocket.name}.force_max"] for sprocket in drive.sprockets)
    impulse = sum(row[f"{sprocket.name}.impulse"] for sprocket in drive.sprockets)
    found["force_max"].append(1.0 - largest / teeth.max())
    found["impulse"].append(abs(impulse / np.trapezoid(teeth.sum(axis=1), seen.time) - 1.0))
    return {name: max(values) for name, values in found.items()}


@case()
def sampling(asked: argparse.Namespace) -> Iterator[Line]:
    """Metrics that are not taken every step, beside the same of every step: does it matter?

    python scripts/figures.py sampling

    Tensions of links are added up every 32nd or 64th step (`engine.simulation`); forces, speeds and the largest of all
    are of every step (`kernels.sums`). A window of each drive is recorded step by step. Of means: how far off they
    are, in standard deviations. Of largest values: the share that is missed; of the smallest tension and of speeds, of
    their range. Without friction on teeth, which the hub forces of frames leave out.
    """
    found = [sampling_misses(example_drive(name, SMOOTH), *window) for name, window in WINDOWS.items()]
    yield ("", *WINDOWS)
    for metric in found[0]:
        yield (metric, *(f"{values[metric]:.1e}" for values in found))
