"""Tooth jump on few teeth against what they hold at rest."""

import argparse
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case
from matplotlib.figure import Figure

from warpchain.assembly import assemble
from warpchain.assembly.tooth_hold import held_tension_ratio
from warpchain.drive import Drive
from warpchain.engine.jump import find_jumps
from warpchain.fit import fit_links
from warpchain.model import Model

FORCE, TEETH = 4000.0, 20
HEIGHTS = (0.25, 0.35, 0.45, 0.6, 0.75, 0.9)
SEATS = (110.0, 118.0, 125.0)
COLORS = ("tab:blue", "tab:green", "tab:red")


def triangle_drive(height: float, seat: float) -> Drive:
    """Three sprockets of 20 teeth: a driver, a wheel on a slide with a constant force, a loaded one between them."""
    slope = -math.tan(0.5 * math.atan(height))
    slide = {"kind": "slider", "direction": (1.0, slope), "stiffness": 0.0, "damping": 1000.0, "preload": FORCE}
    common = {"teeth": TEETH, "wrap": "ccw"}
    contact = {"seat_angle": seat, "clearance": 1e-4, "restitution": 0.3, "impact_speed_floor": 0.02, "stiffness": 2e8}
    start = {
        "pitch": 0.05,
        "links": 106,
        "roller_mass": 0.2,
        "stiffness": 5e7,
        "damping": 500.0,
        "roller_radius": 0.015,
    }
    motion, load = {"speed": 5.0, "ramp_time": 0.3}, {"torque": 300.0, "ramp_time": 0.3}
    sprockets = [
        {"name": "driver", "center": (0.0, 0.0), "prescribed": motion, **common},
        {"name": "tensioner", "center": (2.0, 0.0), "mass": 5.0, "inertia": 0.05, "mount": slide, **common},
        {"name": "driven", "center": (1.0, height), "inertia": 0.5, "load": load, **common},
    ]
    run = {"duration": 2.0, "step": "auto", "sample_rate": 2000.0}
    values: Any = {"chain": start, "sprockets": sprockets, "contact": {"sprocket": contact}, "run": run}
    return fit_links(Drive(**values))


@case()
def jump(asked: argparse.Namespace) -> Iterator[Line]:
    """Torque at which a sprocket jumps, over the teeth in its wrap, for three seating angles.

    python scripts/figures.py jump

    Prints the table of docs/jump.md and draws its figure. Lines: M = R T (q^n - 1) of the teeth at rest.
    """
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    yield ("seating angle", "teeth in the wrap", "q", "holds", "jumps", "M / R T at rest")
    for seat, color in zip(SEATS, COLORS, strict=True):
        for height in HEIGHTS:
            drive = triangle_drive(height, seat)
            n = float(assemble(drive).path.wrap_angle[2]) * TEETH / math.tau
            pull = 0.5 * FORCE / math.cos(0.5 * math.atan(height)) * Model(drive).chain.pitch_radius(2)
            q = held_tension_ratio(Model(drive).chain, 2)
            (found,) = find_jumps(drive, directions=("forward",), most=pull * 4.0 * q**n, tolerance=0.05, device="cpu")
            assert found.jumps is not None
            held, jumped = found.holds / pull, found.jumps / pull
            axes.plot([n, n], [held, jumped], "_-", color=color)
            yield (f"{seat:g}", f"{n:.2f}", f"{q:.3f}", f"{held:.2f}", f"{jumped:.2f}", f"{q**n - 1.0:.2f}")
        teeth = np.linspace(1.0, 5.5, 50)
        axes.plot(teeth, q**teeth - 1.0, color=color, lw=1.0, label=f"seating angle {seat:g} degrees, q = {q:.2f}")
        axes.fill_between(teeth, q ** (teeth - 0.5) - 1.0, q ** (teeth + 0.5) - 1.0, color=color, alpha=0.1, lw=0.0)
    axes.set(yscale="log", xlabel="teeth in the wrap", ylabel="torque over R T of the slack strand", ylim=(0.3, 40.0))
    axes.legend(fontsize=8)
    yield {"jump": figure}
