"""Pictures and tables of the example drives."""

import argparse
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive, without_friction

from warpchain import Drive, Record, simulate
from warpchain.assembly import assemble
from warpchain.assembly.timestep import automatic_step, step_limit
from warpchain.drive.examples import example_names
from warpchain.view.figures.drive_figure import drive_figure


@case()
def examples(asked: argparse.Namespace) -> Iterator[Line]:
    """The pictures of the example drives: the drive and the forces on its chain at one instant of a run.

    python scripts/figures.py examples

    Prints a table of what each run came to, as docs/examples.md has it.
    """
    yield ("drive", "links", "simulated [s]", "slackest strand [N]", "tightest strand [N]", "least [N]", "most [N]")
    for name in example_names():
        run = simulate(example_drive(name))
        drive, (row,) = run[0].drive, run.metrics.to_pylist()
        strands = [row[f"{strand}.tension_mean"] for strand in drive.strand_names]
        chains = [f"{chain.name}." for chain in drive.chains] or [""]
        least, most = ([row[f"{chain}tension_{end}"] for chain in chains] for end in ("min", "max"))
        tensions = (min(strands), max(strands), min(least), max(most))
        links = sum(chain.links for chain in drive.each_chain)
        yield (f"`{name}`", links, f"{drive.run.duration:g}", *(f"{tension:.0f}" for tension in tensions))
        drive_figure(run[0]).savefig(asked.output / f"{name.replace('_', '-')}-drive.png", dpi=90)


@case()
def v6(_: argparse.Namespace) -> Iterator[Line]:
    """The chains of `v6` over speed, and that of `car` beside them.

    python scripts/figures.py v6
    """
    yield ("drive", "chain", "rpm", "mean [N]", "least [N]", "most [N]", "efficiency", "residual")
    for name in ("v6", "car"):
        base = example_drive(name)
        path = f"sprockets.{base.sprockets[base.driver].name}.prescribed.speed"
        speeds = [rpm * math.pi / 30.0 for rpm in (1000.0, 3000.0, 5000.0, 6500.0)]
        run = simulate([base.with_values({path: speed}) for speed in speeds], record=Record("none"))
        for speed, row in zip(speeds, run.metrics.to_pylist(), strict=True):
            for chain in [f"{chain.name}." for chain in base.chains] or [""]:
                tensions = (f"{row[f'{chain}tension_{of}']:.0f}" for of in ("mean", "min", "max"))
                whole = (f"{row['efficiency']:.3f}", f"{row['energy_residual_relative']:.1e}")
                yield (name, chain.removesuffix("."), f"{speed * 30.0 / math.pi:.0f}", *tensions, *whole)


FRICTION = ("marine", "engine", "industrial", "motorcycle")
"""Drives that run with and without friction."""


def nearby_copies(drive: Drive, count: int) -> list[Drive]:
    """The drive `count` times, each a part of 1e-9 faster than the one before."""
    path = f"sprockets.{drive.sprockets[drive.driver].name}.prescribed.speed"
    speed = drive.get_value(path)
    return [drive.with_values({path: speed * (1.0 + k * 1e-9)}) for k in range(count)]


def contact_share(trajectory: Any) -> float:
    """The part of the run's second half that a roller in a sprocket's wrap, a pitch from its ends at least, touches."""
    path, later = assemble(trajectory.drive).path, trajectory.time >= 0.5 * trajectory.time[-1]
    position, force = trajectory.position[later], trajectory.sprocket_force[later]
    touching, inside = 0, 0
    for s, sprocket in enumerate(trajectory.drive.sprockets):
        arm = position - trajectory.sprocket_center[later, None, s]
        near = np.abs(np.hypot(arm[..., 0], arm[..., 1]) - path.radius[s]) < 0.5 * trajectory.drive.chain.pitch
        turned = sprocket.sign * (np.arctan2(arm[..., 1], arm[..., 0]) - path.arrival_angle[s]) % (2.0 * np.pi)
        margin = 2.0 * np.pi / sprocket.teeth
        on = near & (turned > margin) & (turned < path.wrap_angle[s] - margin)
        touching += int((force[on] > 0.0).sum())
        inside += int(on.sum())
    return touching / inside


def scatter_row(drive: Drive, count: int) -> tuple[str, ...]:
    """A row of a drive's builds: tension's mean, its scatter, quantiles, extremes; contact, efficiency, residual."""
    record = Record(channels=("position", "sprocket_force", "sprocket_center"))
    run = simulate(drive, replicates=count, replicate_by="build", record=record)

    def metric_values(name: str, scale: float = 1.0) -> Any:
        """Values of a metric of all builds, times a scale."""
        return scale * np.asarray(run.metrics[name], float)

    def scatter_text(values: Any) -> str:
        """Scatter over the mean, in words."""
        return f"{100.0 * values.std(ddof=1) / values.mean():.2g} %"

    mean, most = metric_values("tension_mean", 1e-3), metric_values("tension_max", 1e-3)
    quantiles = [metric_values(f"tension_{q}", 1e-3).mean() for q in ("q001", "q50", "q999")]
    tensions = [
        f"{value:.3g}" for value in (mean.mean(), *quantiles, metric_values("tension_min", 1e-3).min(), most.max())
    ]
    share = np.mean([contact_share(run[k]) for k in range(count)])
    efficiency, residual = metric_values("efficiency").mean(), np.abs(metric_values("energy_residual_relative")).max()
    shares = (scatter_text(most), f"{share:.2f}", f"{efficiency:.4f}", f"{residual:.1e}")
    return (tensions[0], scatter_text(mean), *tensions[1:], *shares)


@case(
    case_option("--copies", type=int, default=8),
    case_option(
        "--nearby", action="store_true", help="mean tensions of marine drives with loads up to 1 %% apart instead"
    ),
)
def example_table(asked: argparse.Namespace) -> Iterator[Line]:
    """Example drives with and without friction: builds that scatter.

    python scripts/figures.py example-table [--copies 8]
    python scripts/figures.py example-table --nearby

    They begin at other phases of the driver within a tooth, their rollers elsewhere in the tooth gaps. The scatter is
    the error of a single run's number; where impacts make the motion chaotic they are draws from one distribution.
    """
    if asked.nearby:
        path, drive = "sprockets.camshaft.load.torque", example_drive("marine")
        torques = drive.get_value(path) * np.linspace(0.99, 1.01, asked.copies)
        for how, one in (("with friction", drive), ("without friction", without_friction(drive))):
            run = simulate([one.with_values({path: float(torque)}) for torque in torques], record=Record("none"))
            yield (how, *(f"{tension:.0f} N" for tension in run.metrics["tension_mean"].to_pylist()))
        return
    tensions = ("tension [kN]", "scatter", "0.1 %", "50 %", "99.9 %", "least", "most", "scatter")
    yield ("drive", *tensions, "in contact", "efficiency", "residual")
    for name, drive in ((name, example_drive(name)) for name in FRICTION):
        yield (f"{name}, without friction", *scatter_row(without_friction(drive), asked.copies))
        yield (name, *scatter_row(drive, asked.copies))


ENGINE_SCALE = 12.7 / 9.525
"""Of the engine example when an 08B chain runs on it."""


def drive_with_tooth_gap(drive: Drive, name: str) -> Drive:
    """The drive with a tooth gap of ISO 606, entered at 0.02 m/s at least."""
    return drive.with_values(
        {
            "contact.sprocket.profile": "iso606",
            "contact.sprocket.gap": name,
            "contact.sprocket.clearance": None,
            "contact.sprocket.seat_angle": None,
            "contact.sprocket.impact_speed_floor": 0.02,
        }
    )


def engine_08b() -> Drive:
    """The engine example a third larger, on 08B."""
    drive = example_drive("engine")
    values = {f"sprockets.{s.name}.center": [ENGINE_SCALE * x for x in s.center] for s in drive.sprockets}
    for guide in drive.guides:
        values[f"guides.{guide.name}.start"] = [ENGINE_SCALE * x for x in guide.bar.start]
        values[f"guides.{guide.name}.end"] = [ENGINE_SCALE * x for x in guide.bar.end]
    return drive.with_values(values | {"chain.size": "08B", "chain.stiffness": "estimate"})


@case(
    case_option("--copies", type=int, default=150, help="of each drive"),
    case_option("--device", help="as of simulate"),
)
def step(asked: argparse.Namespace) -> Iterator[Line]:
    """Copies of four drives, 1e-9 apart, at half, once and 1.5 times the automatic step: does `step = "auto"` hold?

    python scripts/figures.py step [--copies 150] [--device cuda]

    A copy is suspect where its status says so. The residual is the largest of the energy balance's over the turnover;
    the scatter of the mean tension says what the residual is to be compared with.
    """
    drives = {
        "engine on 08B, iso606 maximum": drive_with_tooth_gap(engine_08b(), "maximum"),
        "industrial, iso606 maximum": drive_with_tooth_gap(example_drive("industrial"), "maximum"),
        "motorcycle, iso606 minimum": drive_with_tooth_gap(example_drive("motorcycle"), "minimum"),
        "marine": example_drive("marine"),
    }
    yield ("drive", "step [s]", "of the limit", "suspect", "residual", "tension [N]", "scatter", "largest [N]")
    for name, drive in drives.items():
        for times in (0.5, 1.0, 1.5):
            step = times * automatic_step(drive)
            run = simulate(nearby_copies(drive, asked.copies), step=step, record=Record("none"), device=asked.device)
            found = [run.metrics[of] for of in ("energy_residual_relative", "tension_mean", "tension_max")]
            residual, mean, most = (np.ma.masked_invalid(np.asarray(values, float)) for values in found)
            share, suspect = f"{step / step_limit(drive):.2f}", f"{int((~run.ok).sum())} of {asked.copies}"
            scatter = f"{mean.std() / mean.mean():.2%}"
            tensions = (f"{mean.mean():.4g}", scatter, f"{most.max():.4g}")
            yield (name, f"{step:.3g}", share, suspect, f"{np.abs(residual).max():.1e}", *tensions)
