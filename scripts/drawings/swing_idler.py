"""The spring of the auger drive's swing arm: what the example study gives."""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case
from common.drives import example_drive, study_of_example
from matplotlib.figure import Figure

from warpchain import Drive
from warpchain.assembly.arm_balance import chain_path
from warpchain.model import Model
from warpchain.results.outlines import chain_outline
from warpchain.study.results import Results

STRAND, COLORS = "idler->auger", ("tab:blue", "tab:green", "tab:red")


def drawn_path(axes: Any, drive: Drive, color: str, label: str) -> None:
    """The chain's path and its arm."""
    model = Model(drive).chain
    path, turn = chain_path(model), np.linspace(0.0, 2.0 * np.pi, 60)
    for center, radius in zip(path.center, path.radius, strict=True):
        around = center + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        axes.plot(*(1e3 * around).T, color=color, lw=0.6, alpha=0.6)
    axes.plot(*(1e3 * chain_outline(model, path)).T, color=color, label=label)
    axes.plot(*(1e3 * np.array([drive.arms[0].pivot, path.center[1]])).T, "o-", color=color, ms=4)


def spring_figure(results: Results) -> Figure:
    """Tension and slack of the slack strand, where the arm stands, and the loss, over the spring's moment."""
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    (where, tension), (slack, loss) = figure.subplots(2, 2)
    for part, color in ((0.0, "0.4"), (0.02, "tab:orange")):
        drawn_path(where, example_drive("swing_idler", {"chain.elongation": part}), color, f"{100 * part:g} % worn")
    where.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    moment, stiffness, wear = (results.values(name) for name in ("moment", "stiffness", "wear"))
    shown = (
        (tension, results.values(f"{STRAND}.tension_mean"), "mean tension of the slack strand [N]"),
        (slack, 100.0 * results.values(f"{STRAND}.slack"), "its links without tension [%]"),
        (loss, 100.0 * (1.0 - results.values("efficiency")), "losses [% of the input]"),
    )
    for axes, values, label in shown:
        for k, color in zip(np.unique(stiffness), COLORS, strict=True):
            for worn, style in ((0.0, "-"), (0.02, "--")):
                mine = (stiffness == k) & (wear == worn)
                name = f"{k:g} N m/rad" if worn == 0.0 else None
                axes.plot(moment[mine], values[mine], f"o{style}", color=color, ms=3, label=name)
        axes.set(xlabel="moment of the spring at angle 0 [N m]", ylabel=label, ylim=(0.0, None))
    tension.legend(title="dashed: 2 % worn", fontsize=8)
    where.legend(fontsize=8, loc="lower right")
    return figure


@case()
def swing_idler(asked: argparse.Namespace) -> Iterator[Line]:
    """The torsion spring of the swing arm of the example `swing_idler`, new and with a chain worn by 2 %.

    python scripts/figures.py swing-idler

    Prints the table of docs/swing-idler.md and draws its figure, from the example study `swing-idler`.
    """
    results = study_of_example("swing-idler")
    columns = ("swing arm.angle_mean", f"{STRAND}.tension_mean", f"{STRAND}.slack", f"{STRAND}.displacement_std")
    values = [results.values(name) for name in ("moment", "stiffness", "wear", *columns, "efficiency")]
    head = ("moment [N m]", "stiffness [N m/rad]", "wear", "arm [deg]", "slack strand [N]", "of it slack", "swing [mm]")
    yield (*head, "losses")
    for moment, stiffness, wear, angle, tension, slack, swing, efficiency in zip(*values, strict=True):
        numbers = (f"{np.degrees(angle):.1f}", f"{tension:.0f}", f"{100 * slack:.1f} %", f"{1e3 * swing:.1f}")
        yield (f"{moment:g}", f"{stiffness:g}", f"{100 * wear:g} %", *numbers, f"{100 * (1 - efficiency):.2f} %")
    worst = np.abs(results.values("energy_residual_relative")).max()
    yield f"{len(values[0])} runs, largest energy residual {worst:.1e}"
    yield {"swing-idler": spring_figure(results)}
