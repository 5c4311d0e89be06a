"""The marine drive with its guide-bar and without."""

import argparse
from pathlib import Path

import numpy as np
from common.cases import case, option
from matplotlib.figure import Figure
from numpy.typing import NDArray

from warpchain import Drive, Record, Run, load_drive, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.drive.examples import drive_path
from warpchain.results.scene import strand_displacement

STRAND = 2  # camshaft -> crankshaft: the tight one, "segment number one" of the paper
RAMP, START, DURATION = 6.0, 8.0, 14.0  # s


def indented(drive: Drive, strand: int, indentation: float) -> Drive:
    """The drive with its bar's face where it presses the strand in by `indentation` [m], both ends alike."""
    path, (bar,) = chain_path(drive), drive.guides
    t = path.strand_end[strand] - path.strand_start[strand]
    t /= np.hypot(*t)
    n = np.array([-t[1], t[0]])
    values = {}
    for key, point in (("start", bar.start), ("end", bar.end)):
        along = (np.array(point) - path.strand_start[strand]) @ t
        face = path.strand_start[strand] + along * t + (indentation - drive.chain.roller_radius) * n
        values[f"guides.{bar.name}.{key}"] = [float(x) for x in face]
    return drive.with_values(values)


def displacement(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times from START on [s], and the strand's mid-span displacement [m], left of travel positive."""
    later = run[0].time >= START
    return run[0].time[later], strand_displacement(run[0], STRAND)[later]


def started_slowly(name: str) -> Drive:
    """An example drive whose speed and load come on within RAMP, for DURATION."""
    ramps = ("sprockets.crankshaft.prescribed.ramp_time", "sprockets.camshaft.load.ramp_time")
    return load_drive(drive_path(name)).with_values({"run.duration": DURATION} | dict.fromkeys(ramps, RAMP))


@case(option("picture", nargs="?", type=Path, default=Path("docs/images/guide-bar.png")))
def guide_bar(asked: argparse.Namespace) -> None:
    """The paper's Figures 9 and 10 side by side: the tight strand of the marine drive without guide-bar, and with it.

    python scripts/figures.py guide-bar [docs/images/guide-bar.png]

    As in the paper, the bar presses the strand in by the mean of the displacement that it has without the bar. The bar
    is the one of marine.toml, moved along its normal; it stands outside the loop and presses to the left of travel.
    Speed and load come on within 6 s, so that little is left of the swing of the start: joint friction takes a constant
    amount off it a cycle. Shown and averaged are the 6 s from 8 s on.
    """
    picture = asked.picture
    record = Record(channels=("position", "guide_force"), rate=1000.0)
    window = (START, DURATION)
    free = simulate(started_slowly("marine_no_guides"), record=record, window=window)
    mean = float(displacement(free)[1].mean())
    guided = simulate(indented(started_slowly("marine"), STRAND, mean), record=record, window=window)

    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    titles = ("without guide-bar (Figure 9)", f"guide-bar indented by {1e3 * mean:.1f} mm (Figure 10)")
    for axis, run, title in zip(axes, (free, guided), titles, strict=True):
        time, values = displacement(run)
        values = 1e3 * values
        axis.plot(time, values, lw=0.8)
        axis.axhline(values.mean(), color="black", lw=0.9, ls="--", label=f"mean {values.mean():+.1f} mm")
        if run is guided:
            axis.axhline(1e3 * mean, color="tab:brown", lw=1.5, label="roller on the bar's face")
        axis.set(title=title, xlabel="time [s]")
        axis.grid(alpha=0.3)
        axis.legend(loc="lower right" if run is free else "center right", fontsize=9)
        row = run.metrics.to_pylist()[0]
        name = run[0].drive.strand_names[STRAND]
        force = run[0].guide_force
        assert force is not None
        print(
            f"{title}: mean {values.mean():+.2f} mm, rms about it {values.std():.2f} mm, {values.min():+.2f} to "
            f"{values.max():+.2f} mm; strand tension mean {1e-3 * row[f'{name}.tension_mean']:.1f} kN, largest "
            f"{1e-3 * row[f'{name}.tension_max']:.1f} kN; largest guide force on a roller {1e-3 * force.max():.2f} kN"
        )
    axes[0].set_ylabel("displacement at mid-span [mm]\n(left of travel +)")
    figure.savefig(picture, dpi=100)
    print(picture)
