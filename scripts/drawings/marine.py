"""The paper's figures 9 to 12 beside the marine example: results of docs/validation-published.md."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from common.cases import ROOT, Line
from common.drives import example_drive, without_friction
from matplotlib.figure import Figure

from drawings.closed_forms import ValidationRow
from drawings.guides import DURATION, SLOWLY, START, STRAND, indented_bar_drive, strand_displacement_mm
from warpchain import Drive, Record, Run, Trajectory, simulate
from warpchain.results.nearest_parts import engaged_sprockets
from warpchain.results.run import require_channels
from warpchain.results.signals import last_round_frames
from warpchain.view.figures.chain_figures import hardest_pressed_roller

CASES = ("with friction", "without friction")
STEEL = {"contact.guide.partner": {"youngs_modulus": 210e9, "poissons_ratio": 0.3}}
SEEN = Record(channels=("position", "tension", "sprocket_force", "guide_force", "sprocket_angle", "sprocket_center"))
LENGTH, FROM = {"run.duration": 4.2}, 2.1
"""Of the runs with a bar, and where the swing of the start has gone [s]; a round of the chain takes 1.9 s."""


class BareMarine(NamedTuple):
    """The marine drive without its bar.

    Attributes:
        mean, rms: of the tight strand's displacement at mid-span, and of its swing about the mean [mm].
        tension: mean of the links [kN].
    """

    mean: float
    rms: float
    tension: float


class MarineForces(NamedTuple):
    """Forces of the marine drive with its bar [kN].

    Attributes:
        strands, sprockets: mean tension of links that are on no sprocket, and on one, in a round of the chain.
        teeth, bar, steel: largest force on a roller of crankshaft and camshaft, of the bar, and of a bar of steel.
    """

    strands: float
    sprockets: float
    teeth: float
    bar: float
    steel: float


def bare_marine(drive: Drive) -> BareMarine:
    """The drive that starts slowly without a bar, as docs/examples.md has it."""
    record = Record(channels=("position",), rate=1000.0)
    run = simulate(drive.with_values(SLOWLY), record=record, window=(START, DURATION))
    seen = strand_displacement_mm(run)
    return BareMarine(float(seen.mean()), float(seen.std()), 1e-3 * run.metrics["tension_mean"][0].as_py())


def largest_force(run: Run, *parts: str) -> float:
    """Largest force of parts on a roller [kN]."""
    return 1e-3 * max(run.metrics[f"{part}.force_max"][0].as_py() for part in parts)


def guided_displacement(drive: Drive, indentation: float) -> tuple[Trajectory, MarineForces]:
    """The last round of the drive with its bar indented [mm]."""
    drive = indented_bar_drive(drive.with_values(LENGTH), STRAND, 1e-3 * indentation)
    window, (bar,) = (FROM, LENGTH["run.duration"]), drive.guides
    run = simulate(drive, record=SEEN, window=window)
    steel = simulate(drive.with_values(STEEL), record=Record("none"), window=window)
    seen = run[0].at(last_round_frames(run[0]))
    (tension,), on = require_channels(seen, "tension"), engaged_sprockets(seen) >= 0
    return seen, MarineForces(
        strands=1e-3 * float(tension[~on].mean()),
        sprockets=1e-3 * float(tension[on].mean()),
        teeth=largest_force(run, "crankshaft", "camshaft"),
        bar=largest_force(run, bar.name),
        steel=largest_force(steel, bar.name),
    )


def draw_marine_forces(axes: Any, trajectory: Trajectory, title: str) -> None:
    """Tension of a link, and contact forces on a roller, over a round."""
    roller = hardest_pressed_roller(trajectory)
    tension, teeth, bar = require_channels(trajectory, "tension", "sprocket_force", "guide_force")
    near = engaged_sprockets(trajectory, np.array([roller]))[:, 0]
    turned = np.linspace(0.0, 1.0, len(near))
    axes[0].set_title(title)
    axes[-1].set_xlabel("share of the chain's round")
    for axis, force in zip(axes, (tension, teeth, bar), strict=True):
        axis.plot(turned, 1e-3 * force[:, roller], lw=0.7, color="black")
        for s, sprocket in enumerate(trajectory.drive.sprockets):
            upright = {"transform": axis.get_xaxis_transform(), "color": f"C{s}", "alpha": 0.2, "lw": 0.0}
            axis.fill_between(turned, 0.0, 1.0, where=near == s, label=f"on the {sprocket.name}", **upright)
        axis.grid(alpha=0.3)


def mean_tensions() -> tuple[float, float]:
    """Mean tension of the links with and without friction [kN], of eight builds: from docs/friction.md."""
    page = (ROOT / "docs" / "friction.md").read_text()
    found = [re.search(rf"^\| marine{more} \| ([\d.]+) ", page, re.M) for more in ("", ", without friction")]
    assert found[0] is not None and found[1] is not None
    return float(found[0][1]), float(found[1][1])


def displacement_row(own: BareMarine, smooth: BareMarine) -> ValidationRow:
    """Displacement of the tight strand without its bar."""
    return ValidationRow(
        name="marine drive: displacement",
        gives=f"{own.mean:.1f} mm ([with the bar](examples.md#the-guide-bar-figures-9-and-10-of-the-paper)); without "
        f"friction {smooth.mean:.1f} mm, swinging by {smooth.rms:.1f} mm rms, links at {smooth.tension:.0f} kN",
        differs=f"{own.mean - 2.7:+.1f} mm; without friction {smooth.mean - 2.7:+.1f} mm",
    )


def forces_row(own: MarineForces, smooth: MarineForces) -> ValidationRow:
    """Tension of links and contact forces of rollers."""
    mean, smooth_mean = mean_tensions()
    return ValidationRow(
        name="marine drive: forces",
        gives=f"mean of the links {mean} kN, without friction {smooth_mean} kN. Off and on sprockets {own.strands:.0f} "
        f"and {own.sprockets:.0f}, {smooth.strands:.0f} and {smooth.sprockets:.0f} kN. Largest on a roller: crankshaft "
        f"and camshaft {own.teeth:.0f} and {smooth.teeth:.0f} kN, bar {own.bar:.2f} and {smooth.bar:.1f} kN, bar of "
        f"steel {own.steel:.1f} and {smooth.steel:.0f} kN",
        differs=f"{mean - 20.0:+.1f} and {smooth_mean - 20.0:+.1f} kN",
    )


def marine() -> Iterator[Line]:
    """The paper's drive, with and without friction."""
    figure = Figure(figsize=(12.0, 7.0), layout="constrained")
    axes: Any = figure.subplots(3, 2, sharex=True, sharey="row")
    unguided, drive = example_drive("marine_no_guides"), example_drive("marine")
    free = [bare_marine(unguided), bare_marine(without_friction(unguided))]
    forces = []
    for column, title, made, one in zip(axes.T, CASES, (drive, without_friction(drive)), free, strict=True):
        seen, found = guided_displacement(made, one.mean)
        forces.append(found)
        draw_marine_forces(column, seen, title)
    labels = ("tension of a link", "sprockets on a roller", "guide-bar on a roller")
    for axis, label in zip(axes[:, 0], labels, strict=True):
        axis.set_ylabel(f"{label} [kN]")
    axes[1, 0].legend(fontsize=9, loc="upper right")
    yield displacement_row(*free)
    yield forces_row(*forces)
    yield {"validation-marine": figure}
