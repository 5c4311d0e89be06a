"""What `check` says beside runs."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from common.cases import case, option

from warpchain import Record, Trajectory, load_drive, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.statics import running
from warpchain.drive.examples import drive_path

RUNS = {"engine": (0.1, 0.2), "industrial": (0.5, 1.0), "marine": (1.0, 2.0), "motorcycle": (0.15, 0.3)}
"""Window of each run's metrics [s]."""

SMOOTH = {"chain.joint": None, "contact.sprocket.friction": 0.0, "contact.guide": None, "guides": ()}
MARINE: dict[str, dict[str, Any]] = {
    "as it is": {},
    "joints rub twice as much": {"chain.joint.friction": 0.14},
    "crankshaft at 1 rad/s": {"sprockets.crankshaft.prescribed.speed": 1.0},
    "nothing rubs, no guide-bar": SMOOTH,
}


def bent(trajectory: Trajectory) -> tuple[float, float]:
    """How much longer than straight all strands are in the run's second half [m]: whole, and what is not standing.

    Half of the slopes' squares along the strand; the mean slope at each place, a pitch long, stands.
    """
    drive, path = trajectory.drive, chain_path(trajectory.drive)
    assert trajectory.position is not None
    x = trajectory.position[trajectory.time >= 0.5 * trajectory.time[-1]].astype(float)
    whole, waves = 0.0, 0.0
    for begin, end in zip(path.strand_start, path.strand_end, strict=True):
        length = float(np.hypot(*(end - begin)))
        u = (end - begin) / length
        along, off = (x - begin) @ u, (x - begin) @ np.array([-u[1], u[0]])
        next_along, next_off = np.roll(along, -1, axis=1), np.roll(off, -1, axis=1)
        on = (along > 0.0) & (next_along < length) & (np.abs(off) < 3.0 * drive.chain.pitch)
        step = (next_along - along)[on]
        slope, place = (next_off - off)[on] / step, (along[on] / drive.chain.pitch).astype(int)
        standing = np.bincount(place, slope) / np.maximum(np.bincount(place), 1)
        whole += 0.5 * float(slope**2 @ step) / len(x)
        waves += 0.5 * float((slope - standing[place]) ** 2 @ step) / len(x)
    return whole, waves


def marine() -> None:
    """Prints the second table."""
    base = load_drive(drive_path("marine"))
    drives = [base.with_values(changes) for changes in MARINE.values()]
    run = simulate(drives, record=Record(channels=("position",), rate=1000.0))
    print("| marine | runs above `check` by | strands' way longer than straight | of it waves |\n|---|---|---|---|")
    for k, (name, row) in enumerate(zip(MARINE, run.metrics.to_pylist(), strict=True)):
        found = np.array([row[f"{strand}.tension_mean"] for strand in base.strand_names])
        above, (whole, waves) = 1e-3 * (found - running(drives[k]).tension), bent(run[k])
        print(f"| {name} | {above.min():.1f} to {above.max():.1f} kN | {1e3 * whole:.2f} mm | {1e3 * waves:.2f} mm |")


@case(
    option("name", nargs="*", help="example drives; all of them if none is named"),
    option("--marine", action="store_true", help="the second table instead"),
)
def check(asked: argparse.Namespace) -> None:
    """The tables of docs/check.md: mean strand tensions that `warpchain check` prints, and those of runs.

    python scripts/figures.py check [NAME ...]
    python scripts/figures.py check --marine

    The second: the marine drive, what its run has above `check`, and how much longer its bent strands are.
    """
    if asked.marine:
        marine()
        return
    names = asked.name or list(RUNS)
    print("| strand | `check` | a run | off, of the tightest |\n|---|---|---|---|")
    for name in names:
        drive, window = load_drive(drive_path(name)), RUNS[name]
        (row,) = simulate(drive, record=Record("none"), duration=window[1], window=window).metrics.to_pylist()
        found = np.array([row[f"{strand}.tension_mean"] for strand in drive.strand_names])
        for strand, said, seen in zip(drive.strand_names, running(drive).tension, found, strict=True):
            off = 100.0 * (said - seen) / found.max()
            print(f"| {name}: {strand} | {said:.4g} N | {seen:.4g} N | {off:+.1f} % |", flush=True)
