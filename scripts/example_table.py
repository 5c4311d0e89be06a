"""Each example drive with and without friction: copies that differ by 1e-9 in speed, and how far their answers scatter.

    python scripts/example_table.py [--copies 8] [DRIVE ...]

Copies would agree to nine digits if the motion were regular. Where impacts make it chaotic they are draws from one
distribution, and their scatter is what a single run's number may be off by.
"""

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warpchain
from warpchain import Drive, Record, Trajectory, load_drive, simulate
from warpchain.assembly import assemble
from warpchain.examples import drive_path

DRIVES = ("marine", "engine", "industrial", "motorcycle")
CHANNELS = ("position", "tension", "sprocket_force", "sprocket_center")
NUDGE = 1e-9
"""By which two neighboring copies' speeds differ, relative."""
QUANTILES = (0.001, 0.5, 0.999)

BEFORE: Mapping[str, Mapping[str, Any]] = {name: {} for name in DRIVES}
"""What the drives were before they had friction and the preload of real ones."""


def copies(drive: Drive, count: int) -> list[Drive]:
    """The drive `count` times, each a little faster than the one before."""
    path = f"sprockets.{drive.sprockets[drive.driver].name}.prescribed.speed"
    speed = drive.get_value(path)
    return [drive.with_values({path: speed * (1.0 + k * NUDGE)}) for k in range(count)]


def contact_share(trajectory: Trajectory) -> float:
    """The part of the time that a roller in a sprocket's wrap, a pitch from its ends at least, touches a tooth."""
    assert trajectory.position is not None and trajectory.sprocket_force is not None
    assert trajectory.sprocket_center is not None
    path = assemble(trajectory.drive).path
    touching, inside = 0, 0
    for s, sprocket in enumerate(trajectory.drive.sprockets):
        arm = trajectory.position - trajectory.sprocket_center[:, None, s]
        near = np.abs(np.hypot(arm[..., 0], arm[..., 1]) - path.radius[s]) < 0.5 * trajectory.drive.chain.pitch
        turned = sprocket.sign * (np.arctan2(arm[..., 1], arm[..., 0]) - path.arrival_angle[s]) % (2.0 * math.pi)
        margin = 2.0 * math.pi / sprocket.teeth
        on = near & (turned > margin) & (turned < path.wrap_angle[s] - margin)
        touching += int((trajectory.sprocket_force[on] > 0.0).sum())
        inside += int(on.sum())
    return touching / inside


def second_half(trajectory: Trajectory) -> NDArray[np.bool_]:
    """The frames of the window that metrics are taken over."""
    return trajectory.time >= 0.5 * trajectory.time[-1]


def row(drive: Drive, count: int) -> list[float]:
    """What a drive's copies give: tension's mean, its scatter, quantiles, extremes; contact, efficiency, residual.

    Scatter is the standard deviation between copies over the mean.
    """
    run = simulate(copies(drive, count), record=Record(channels=CHANNELS))
    table = run.metrics
    mean = np.asarray(table["tension_mean"], float)
    kept = [trajectory_of(run, k) for k in range(count)]
    spread = np.array([np.quantile(np.asarray(t.tension), QUANTILES) for t in kept])
    share = [contact_share(t) for t in kept]
    output, given = np.asarray(table["output_work"], float), np.asarray(table["input_work"], float)
    residual = np.abs(np.asarray(table["energy_residual_relative"], float)).max()
    low, high = np.asarray(table["tension_min"], float), np.asarray(table["tension_max"], float)
    return [
        mean.mean(),
        mean.std(ddof=1) / mean.mean(),
        *spread.mean(axis=0),
        low.min(),
        high.max(),
        high.std(ddof=1) / high.mean(),
        float(np.mean(share)),
        float((output / given).mean()),
        residual,
    ]


def trajectory_of(run: warpchain.Run, k: int) -> Trajectory:
    """Variant k's frames within the window."""
    whole = run[k]
    chosen = second_half(whole)
    values = {name: value[chosen] for name, value in whole.channels().items()}
    return Trajectory(drive=whole.drive, time=whole.time[chosen], **values)


HEAD = (
    "drive | tension [kN] | scatter | 0.1 % | 50 % | 99.9 % | least | most | scatter | in contact | efficiency"
    " | residual"
)


def line(name: str, values: Sequence[float]) -> str:
    """A row of the table."""
    mean, scatter, low, middle, high, least, most, of_most, share, efficiency, residual = values
    forces = [f"{v / 1e3:.3g}" for v in (mean, low, middle, high, least, most)]
    shares = [f"{of_most:.1%}", f"{share:.2f}", f"{efficiency:.4f}", f"{residual:.1e}"]
    return " | ".join([name, forces[0], f"{scatter:.2%}", *forces[1:], *shares])


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("drives", nargs="*", default=DRIVES, help="examples or drive files; default: all")
    made.add_argument("--copies", type=int, default=8)
    return made


def main() -> None:
    """Prints the table."""
    options = parser().parse_args()
    print(f"| {HEAD} |")
    print("|" + "---|" * HEAD.count("|") + "---|")
    for name in options.drives:
        drive = load_drive(drive_path(name))
        for when, values in (("before", BEFORE.get(name)), ("now", {})):
            if values is not None:
                print(f"| {line(f'{name}, {when}', row(drive.with_values(values), options.copies))} |", flush=True)


if __name__ == "__main__":
    main()
