"""The marine drive's tightener on a lever: what the example study gives."""

import argparse
import math
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case, table_head
from common.drives import example_drive, study_of_example
from matplotlib.figure import Figure

from warpchain import Record, simulate
from warpchain.model import Model
from warpchain.study.results import Results

COLORS = ("tab:red", "tab:blue", "tab:green")


def tooth_blow(teeth: float) -> float:
    """Force [N] with which a roller strikes a fixed tooth: 2 v sin(pi/z) sqrt(K m)."""
    model = Model(example_drive("marine_lever")).chain
    stiffness = model.sprocket_stiffness(1)
    return 2.0 * model.chain_speed * math.sin(math.pi / teeth) * math.sqrt(stiffness * model.chain.mass)


def lever_figure(results: Results, fixed: float) -> Figure:
    """Largest force of the tightener's teeth, and how far the lever swings, over the spring's stiffness."""
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    force, swing = figure.subplots(1, 2)
    names = ("stiffness", "damping", "teeth", "tightener.force_max", "lever.angle_std")
    stiffness, damping, teeth, most, angle = (results.values(name) for name in names)
    for z, color in zip(np.unique(teeth), COLORS, strict=True):
        for c, style in zip(np.unique(damping), (":", "--", "-"), strict=True):
            mine = (teeth == z) & (damping == c)
            label = f"{z:.0f} teeth, {1e-3 * c:g} kN s/m"
            force.semilogx(stiffness[mine], 1e-3 * most[mine], f"o{style}", color=color, ms=3, label=label)
            swing.semilogx(stiffness[mine], 1e3 * angle[mine], f"o{style}", color=color, ms=3)
        force.axhline(1e-3 * tooth_blow(float(z)), color=color, lw=0.8, alpha=0.5)
    force.axhline(1e-3 * fixed, color="black", lw=0.8, ls="-.", label="25 teeth, fixed center")
    force.set(xlabel="stiffness of the spring [N/m]", ylabel="largest force of its teeth [kN]", ylim=(0.0, None))
    swing.set(
        xlabel="stiffness of the spring [N/m]", ylabel="swing of the lever [mrad, mm at the wheel]", ylim=(0.0, None)
    )
    force.legend(fontsize=7, ncols=2, loc="lower center")
    return figure


@case()
def marine_lever(asked: argparse.Namespace) -> Iterator[Line]:
    """The marine drive's tightener on a lever, its spring, damper and teeth, beside the one on a fixed center.

    python scripts/figures.py marine-lever

    Prints the table of docs/examples.md and draws its figure, from the example study `marine-lever`. Thin lines: 2 v
    sin(pi/z) sqrt(K m).
    """
    run = simulate(example_drive("marine"), record=Record("none"), duration=1.5, window=(0.8, 1.5))
    fixed = run.metrics.to_pylist()[0]["tightener.force_max"]
    results = study_of_example("marine-lever")
    names = ("teeth", "stiffness", "tightener.force_max", "tightener.dissipated", "tension_max", "lever.angle_std")
    teeth, stiffness, force, lost, tension, angle = (results.values(name) for name in names)
    yield table_head(
        "teeth | v sqrt(K m) [kN] | spring [N/m] | force [kN] | lost in its teeth [W] | tension [kN] | swing [mm]"
    )
    for z, k in sorted({*zip(teeth, stiffness, strict=True)}):
        mine = (teeth == z) & (stiffness == k)
        yield (
            f"{z:.0f}",
            f"{1e-3 * tooth_blow(z):.0f}",
            f"{k:.0e}",
            *(f"{scale * of[mine].min():.{d}f} to {scale * of[mine].max():.{d}f}" for of, scale, d in (
                (force, 1e-3, 0), (lost, 1.0 / 0.7, 0), (tension, 1e-3, 0), (angle, 1e3, 2))),
        )  # fmt: skip
    worst = np.abs(results.values("energy_residual_relative")).max()
    yield f"{len(teeth)} runs, largest energy residual {worst:.1e}; with the center fixed {1e-3 * fixed:.0f} kN"
    yield {"marine-lever": lever_figure(results, fixed)}
