"""The example studies."""

import argparse
from pathlib import Path

import numpy as np
from common.cases import case, option
from matplotlib.figure import Figure

from warpchain import load_drive
from warpchain.assembly.arm_balance import chain_path
from warpchain.drive.examples import drive_path
from warpchain.study.results import Results, read_results

BLUE, RED, GREEN = "#1f77b4", "#d1495b", "#2e8b57"
STRAND, GUIDE = "camshaft->crankshaft", "tight strand"


def panels(rows: int, height: float) -> tuple[Figure, list]:
    """Panels one above the other, with one axis across."""
    figure = Figure(figsize=(8.0, height), layout="constrained")
    axes = list(np.atleast_1d(figure.subplots(rows, 1, sharex=True)))
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def guide_indentation(results: Results) -> Figure:
    """Displacement of the strand and load of the bar over the bar's indentation."""
    x = 1e3 * results.values("indentation")
    mean, std, low, high = (1e3 * results.values(f"{STRAND}.displacement_{w}") for w in ("mean", "std", "min", "max"))
    seconds = results.values("window_end") - results.values("window_start")
    free = float(mean[0])  # the bar stands farthest back
    figure, (above, middle, below) = panels(3, 7.5)
    above.fill_between(x, low, high, color=BLUE, alpha=0.15, lw=0, label="least to largest")
    above.fill_between(x, mean - std, mean + std, color=BLUE, alpha=0.35, lw=0, label="mean and standard deviation")
    above.plot(x, mean, color=BLUE)
    above.plot(x, x, color="0.4", lw=0.9, ls="--", label="face of the bar")
    above.set_ylabel("mid-strand\ndisplacement [mm]")
    middle.plot(x, std, "o-", ms=3, color=BLUE, label="standard deviation of the displacement")
    middle.set_ylabel("vibration [mm]")
    middle.set_ylim(bottom=0.0)
    below.plot(
        x, 1e-3 * results.values(f"{GUIDE}.impulse") / seconds, "o-", ms=3, color=RED, label="mean load of the bar"
    )
    below.plot(
        x, 1e-3 * results.values(f"{GUIDE}.force_max"), "o-", ms=3, color=GREEN, label="largest force on a roller"
    )
    below.set_ylabel("force [kN]")
    below.set_xlabel("indentation of the bar into the straight strand [mm]")
    for axis in (above, middle, below):
        axis.axvline(free, color="black", lw=0.9, ls=":", label=f"mean without contact: {free:.1f} mm")
        axis.legend(fontsize=8)
    above.set_title("Tight strand of the marine drive against its guide-bar")
    return figure


def speed_sweep(results: Results) -> Figure:
    """Vibration of each strand over the crankshaft's speed, with the speeds at which its sixth order meets a mode."""
    drive = load_drive(drive_path("marine"))
    path, speed = chain_path(drive), results.values("speed")
    turns = speed / (2.0 * np.pi)
    travel = turns * drive.sprockets[0].teeth * drive.chain.pitch
    mass = drive.chain.mass / drive.chain.pitch
    figure, axes = panels(len(drive.strand_names), 7.5)
    for k, (axis, name) in enumerate(zip(axes, drive.strand_names, strict=True)):
        axis.plot(speed, 1e3 * results.values(f"{name}.displacement_std"), "o-", ms=3, color=BLUE)
        length = float(np.hypot(*(path.strand_end[k] - path.strand_start[k])))
        wave_square = results.values(f"{name}.tension_mean") / mass  # centrifugal tension is part of it
        wave = np.sqrt(wave_square)
        for n in range(1, 9):
            apart = n * (wave_square - travel**2) / (2.0 * length * wave) - 6.0 * turns
            for i in np.flatnonzero(apart[:-1] * apart[1:] < 0.0)[:1]:
                at = speed[i] - apart[i] * (speed[i + 1] - speed[i]) / (apart[i + 1] - apart[i])
                axis.axvline(at, color=RED, lw=0.9, ls="--")
                axis.annotate(
                    f"{n}", (at, 0.96), xycoords=("data", "axes fraction"), color=RED, fontsize=8, va="top", ha="right"
                )
        axis.set_ylabel("vibration [mm]")
        axis.set_ylim(bottom=0.0)
        axis.set_title(name.replace("->", " \N{RIGHTWARDS ARROW} "), loc="left", fontsize=10)
    axes[0].set_title("dashed: sixth order of the crankshaft meets mode n", loc="right", fontsize=8, color=RED)
    axes[-1].set_xlabel("crankshaft speed [rad/s]")
    return figure


def pitch_elongation(results: Results) -> Figure:
    """Tension and contact forces over the chain's elongation, colored by the camshaft's torque."""
    ok = results.ok
    x, torque = 100.0 * results.values("elongation")[ok], 1e-3 * results.values("torque")[ok]
    figure, axes = panels(3, 7.5)
    group = np.clip(np.digitize(x, np.quantile(x, np.linspace(0.0, 1.0, 9))) - 1, 0, 7)
    for axis, (metric, scale, label) in zip(
        axes,
        (
            ("tension_mean", 1e-3, "mean tension [kN]"),
            ("crankshaft.force_max", 1e-3, "largest contact force\nat the crankshaft [kN]"),
            ("contact_energy_per_revolution", 1.0, "contact energy\na revolution [J]"),
        ),
        strict=True,
    ):
        y = scale * results.values(metric)[ok]
        dots = axis.scatter(x, y, c=torque, s=14, cmap="viridis")
        groups = np.unique(group)
        axis.plot([x[group == g].mean() for g in groups], [y[group == g].mean() for g in groups], color=RED, lw=1.5)
        axis.set_ylabel(label)
    axes[-1].set_xlabel("elongation of the chain's pitch [%]")
    axes[0].set_title(
        f"Marine drive, tightener set to 48 kN at assembly; {int(ok.sum())} of {len(ok)} variants can be set"
    )
    figure.colorbar(dots, ax=axes, label="camshaft torque [kN m]", shrink=0.5)
    return figure


FIGURES = {"guide-indentation": guide_indentation, "speed-sweep": speed_sweep, "pitch-elongation": pitch_elongation}


@case(
    option("study", choices=FIGURES),
    option("table", type=Path, help="the study's results.parquet"),
    option("picture", type=Path),
)
def study(asked: argparse.Namespace) -> None:
    """Figures of the example studies, from their results.

    warpchain study run warpchain/study/examples/speed-sweep.toml -o out/speed-sweep
    python scripts/figures.py study speed-sweep out/speed-sweep/results.parquet docs/images/speed-sweep.png

    and the same for guide-indentation and pitch-elongation.
    """
    asked.picture.parent.mkdir(parents=True, exist_ok=True)
    FIGURES[asked.study](read_results(asked.table)).savefig(asked.picture, dpi=110)
    print(asked.picture)
