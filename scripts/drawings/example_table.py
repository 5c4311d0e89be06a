"""The table of the example drives."""

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from common.cases import case, option

from warpchain import Drive, Record, Trajectory, load_drive, simulate
from warpchain.assembly import assemble
from warpchain.examples import drive_path

DRIVES = ("marine", "engine", "industrial", "motorcycle")
NUDGE = 1e-9
"""By which two neighboring copies' speeds differ, relative."""
METRICS = ("tension_mean", "tension_min", "tension_max", "efficiency", "energy_residual_relative")
QUANTILES = ("tension_q001", "tension_q50", "tension_q999")

NO_FRICTION: Mapping[str, Any] = {"chain.joint": None, "contact.sprocket.friction": 0.0}
SMOOTH_BARS: Mapping[str, Any] = {"contact.guide.friction": 0.0, "contact.guide.rolling": False}
OLD_TEETH: Mapping[str, Any] = {
    "contact.sprocket.restitution": 0.3,
    "contact.sprocket.restitution_means": "parameter",
    "contact.sprocket.bush_stiffness": None,
}
BEFORE: Mapping[str, Mapping[str, Any]] = {
    "marine": {
        "chain.damping": 3.0e4,
        "sprockets.tightener.center": [1.203057, 3.0],
        "sprockets.crankshaft.prescribed.ramp_time": None,
    },
    "engine": {"sprockets.crankshaft.prescribed.ramp_time": None},
    "industrial": {"sprockets.motor.prescribed.ramp_time": None},
    "motorcycle": {"sprockets.gearbox.prescribed.ramp_time": None},
}
"""What they had before they became real drives, friction and teeth aside."""


def without_friction(drive: Drive) -> Drive:
    """The drive with every coefficient of friction zero."""
    return drive.with_values({**NO_FRICTION, **(SMOOTH_BARS if drive.guides else {})})


def cases(name: str) -> Mapping[str, Drive]:
    """An example as it was and as it is, each without friction and with it; it was without."""
    drive = load_drive(drive_path(name))
    old = drive.with_values({**OLD_TEETH, **BEFORE[name]})
    return {
        "before": without_friction(old),
        "before, with friction": old,
        "now, without friction": without_friction(drive),
        "now": drive,
    }


def copies(drive: Drive, count: int) -> list[Drive]:
    """The drive `count` times, each a little faster than the one before."""
    path = f"sprockets.{drive.sprockets[drive.driver].name}.prescribed.speed"
    speed = drive.get_value(path)
    return [drive.with_values({path: speed * (1.0 + k * NUDGE)}) for k in range(count)]


def contact_share(trajectory: Trajectory) -> float:
    """The part of the run's second half that a roller in a sprocket's wrap, a pitch from its ends at least, touches."""
    assert trajectory.position is not None and trajectory.sprocket_force is not None
    assert trajectory.sprocket_center is not None
    path, later = assemble(trajectory.drive).path, trajectory.time >= 0.5 * trajectory.time[-1]
    position, force = trajectory.position[later], trajectory.sprocket_force[later]
    touching, inside = 0, 0
    for s, sprocket in enumerate(trajectory.drive.sprockets):
        arm = position - trajectory.sprocket_center[later, None, s]
        near = np.abs(np.hypot(arm[..., 0], arm[..., 1]) - path.radius[s]) < 0.5 * trajectory.drive.chain.pitch
        turned = sprocket.sign * (np.arctan2(arm[..., 1], arm[..., 0]) - path.arrival_angle[s]) % (2.0 * math.pi)
        margin = 2.0 * math.pi / sprocket.teeth
        on = near & (turned > margin) & (turned < path.wrap_angle[s] - margin)
        touching += int((force[on] > 0.0).sum())
        inside += int(on.sum())
    return touching / inside


def row(drive: Drive, count: int) -> list[float]:
    """What a drive's copies give: tension's mean, its scatter, quantiles, extremes; contact, efficiency, residual.

    Scatter is the standard deviation between copies over the mean.
    """
    run = simulate(copies(drive, count), record=Record(channels=("position", "sprocket_force", "sprocket_center")))
    values = {name: np.asarray(run.metrics[name], float) for name in (*METRICS, *QUANTILES)}
    mean, most = values["tension_mean"], values["tension_max"]
    return [
        mean.mean(),
        mean.std(ddof=1) / mean.mean(),
        *(values[name].mean() for name in QUANTILES),
        values["tension_min"].min(),
        most.max(),
        most.std(ddof=1) / most.mean(),
        float(np.mean([contact_share(run[k]) for k in range(count)])),
        values["efficiency"].mean(),
        np.abs(values["energy_residual_relative"]).max(),
    ]


HEAD = (
    "drive | tension [kN] | scatter | 0.1 % | 50 % | 99.9 % | least | most | scatter | in contact | efficiency"
    " | residual"
)


def line(name: str, values: Sequence[float]) -> str:
    """A row of the table."""
    mean, scatter, low, middle, high, least, most, of_most, share, efficiency, residual = values
    forces = [f"{v / 1e3:.3g}" for v in (mean, low, middle, high, least, most)]
    shares = [f"{100.0 * of_most:.2g} %", f"{share:.2f}", f"{efficiency:.4f}", f"{residual:.1e}"]
    return " | ".join([name, forces[0], f"{100.0 * scatter:.2g} %", *forces[1:], *shares])


def nearby(count: int) -> None:
    """Prints the marine drive's mean tensions at `count` loads from -1 to +1 %."""
    path = "sprockets.camshaft.load.torque"
    for name, drive in cases("marine").items():
        torques = drive.get_value(path) * np.linspace(0.99, 1.01, count)
        run = simulate([drive.with_values({path: float(torque)}) for torque in torques], record=Record("none"))
        print(
            f"{name}:", " ".join(f"{value:.0f}" for value in run.metrics["tension_mean"].to_pylist()), "N", flush=True
        )


@case(
    option("drives", nargs="*", metavar="DRIVE", help=f"of {', '.join(DRIVES)}; default: all"),
    option("--copies", type=int, default=8),
    option("--nearby", action="store_true", help="loads up to 1 %% apart instead of copies"),
)
def example_table(asked: argparse.Namespace) -> None:
    """Each example drive as it was, as it is, and without friction: copies that scatter.

    python scripts/figures.py example-table [--copies 8] [DRIVE ...]
    python scripts/figures.py example-table --nearby

    Copies would agree to nine digits if the motion were regular. Where impacts make it chaotic they are draws from one
    distribution, and their scatter is what a single run's number may be off by. --nearby prints mean tensions of marine
    drives with loads up to 1 % apart.
    """
    if asked.nearby:
        nearby(asked.copies)
        return
    print(f"| {HEAD} |")
    print("|" + "---|" * HEAD.count("|") + "---|")
    for name in asked.drives or DRIVES:
        for how, drive in cases(name).items():
            print(f"| {line(f'{name}, {how}', row(drive, asked.copies))} |", flush=True)
