"""A hydraulic tensioner on its rig."""

import argparse
import sys
from pathlib import Path

import numpy as np
from common.cases import case, option
from matplotlib.figure import Figure
from tqdm import tqdm

from warpchain import Drive, loads_drive
from warpchain.drive.examples import drive_path
from warpchain.drive.oil import static_force, static_pressure, valve_flow, viscosity_at
from warpchain.engine.rig import Shake, shake
from warpchain.view.figures.rig_figures import loop_figure, sweep_figure

NAME = "element"
TENSIONER = f"""
[[tensioners]]
name = "{NAME}"
on = "tensioner"
at = [0.038317, 0.18]
direction = [-1.0, 0.0]
kind = "hydraulic"
spring = {{ stiffness = 3500.0, preload = 90.0 }}
plunger = {{ diameter = 0.016, mass = 0.033, gap = 5.0e-5, length = 0.007, eccentricity = 0.9 }}
chamber = {{ volume = 1.0e-6 }}
valve = {{ ball_radius = 0.003, seat_diameter = 0.0014, lift = 0.001, stiffness = 75.0, preload = 0.075 }}
oil = {{ density = 800.0, viscosity = 8.0e-5, bulk_modulus = 8.0e8, air = 0.01, supply = 3.0e5, ambient = 1.0e5 }}
"""
AMPLITUDE, CYCLES = 2e-4, 10
FREQUENCIES = (50.0, 100.0, 200.0)
TRENDS = {
    "gap [\N{MICRO SIGN}m]": ("plunger.gap", np.linspace(20.0, 100.0, 17), lambda x: 1e-6 * x),
    "oil temperature [\N{DEGREE SIGN}C]": (
        "oil.viscosity",
        np.linspace(20.0, 140.0, 13),
        lambda x: viscosity_at(8e-5, x),
    ),
    "air at ambient pressure [%]": ("oil.air", np.linspace(0.0, 10.0, 11), lambda x: 1e-2 * x),
}
"""What is changed: its label, the key, its values, and what the key is given."""


def loops(drive: Drive, picture: Path) -> None:
    """The loops at three frequencies, and what the last cycles' books say."""
    shakes = [Shake(AMPLITUDE, frequency) for frequency in (10.0, 100.0, 400.0)]
    done = shake(drive, NAME, shakes, CYCLES, samples=True)
    print("     Hz   force [N]          pressure [bar]   work [J]  leak [J]  valve [J]  supply [J]  leaked [mm^3]")
    for row in done.rides.to_pylist():
        print(
            f"{row['frequency']:7g} {row['force_min']:8.1f} {row['force_max']:8.1f} {1e-5 * row['pressure_min']:8.3f} "
            f"{1e-5 * row['pressure_max']:8.2f} {row['work']:9.4f} {row['leak_loss']:9.4f} {row['valve_loss']:9.4f} "
            f"{row['supply_work']:9.4f} {1e9 * row['leaked']:12.1f}"
        )
    labels = [f"{one.frequency:g} Hz" for one in shakes]
    title = "\N{PLUS-MINUS SIGN}0.2 mm, oil of 80 mm\N{SUPERSCRIPT TWO}/s"
    _save(loop_figure(dict(zip(labels, done.samples, strict=True)), CYCLES, title), picture)


def frequencies(drive: Drive, picture: Path) -> None:
    """Over frequency, with oil as at 40, 80 and 120 degrees C."""
    x = np.geomspace(1.0, 500.0, 25).tolist()
    oils = {f"{t:g} \N{DEGREE SIGN}C": viscosity_at(8e-5, t) for t in (40.0, 80.0, 120.0)}
    parts = {}
    for label, oil in tqdm(oils.items(), desc="frequencies", file=sys.stderr):
        shakes = [Shake(AMPLITUDE, frequency, viscosity=oil) for frequency in x]
        parts[f"{label}: {1e6 * oil:.3g} mm\N{SUPERSCRIPT TWO}/s"] = shake(drive, NAME, shakes, CYCLES).rides
    _save(sweep_figure(parts, x, "frequency [Hz]", "\N{PLUS-MINUS SIGN}0.2 mm"), picture)


def trends(drive: Drive, picture: Path) -> None:
    """Largest damping force and work of a cycle over gap, temperature and air."""
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    axes = figure.subplots(2, 3, sharex="col", sharey="row")
    for (label, (key, values, given)), (upper, lower) in tqdm(
        zip(TRENDS.items(), axes.T, strict=True), desc="trends", total=3, file=sys.stderr
    ):
        forces, works = np.empty((2, len(values), len(FREQUENCIES)))
        for i, value in enumerate(values):
            changed = drive.with_values({f"tensioners.{NAME}.{key}": float(given(value))})
            rides = shake(changed, NAME, [Shake(AMPLITUDE, frequency) for frequency in FREQUENCIES], CYCLES).rides
            forces[i] = np.asarray(rides["force_max"]) - static_force(changed.tensioners[-1])
            works[i] = np.asarray(rides["work"])
        for k, frequency in enumerate(FREQUENCIES):
            upper.plot(values, forces[:, k], label=f"{frequency:g} Hz")
            lower.plot(values, works[:, k])
            ends = f"{forces[0, k]:.0f} to {forces[-1, k]:.0f} N"
            even = "falls all the way" if (np.diff(forces[:, k]) < 0.0).all() else "does not fall all the way"
            print(f"{label}, {values[0]:g} to {values[-1]:g}, {frequency:g} Hz: {ends}, {even}; largest work "
                  f"{works[:, k].max():.3f} J at {values[works[:, k].argmax()]:g}")  # fmt: skip
        lower.set_xlabel(label)
        for axis in (upper, lower):
            axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("largest force above that at rest [N]")
    axes[1, 0].set_ylabel("work on the plunger [J/cycle]")
    axes[0, 0].legend(fontsize=9)
    _save(figure, picture)


def valve(drive: Drive) -> None:
    """Prints what the valve's curtain would pass, and what its hole lets through."""
    part = drive.tensioners[-1]
    assert part.valve is not None and part.oil is not None
    rest = static_pressure(part)
    print(f"at rest {1e-5 * rest:.4f} bar, {static_force(part):.2f} N; leaks {1e9 * valve_flow(part, rest):.1f} mm^3/s")
    for lift in (1e-5, 1e-4, 2e-4, 1e-3):
        curtain = part.valve.flow_area(lift)
        flow = part.valve.discharge * curtain
        both = flow * part.valve.hole_area / np.hypot(flow, part.valve.hole_area)
        print(
            f"lift {1e3 * lift:g} mm: curtain {1e6 * curtain:.3f} mm^2, {curtain / part.valve.hole_area:.2f} holes; "
            f"effective {1e6 * flow:.4f} mm^2, with the hole {1e6 * both:.4f}"
        )


def _save(figure: Figure, picture: Path) -> None:
    figure.savefig(picture, dpi=100)
    print(picture)


@case(option("folder", nargs="?", type=Path, default=Path("docs/images")))
def tensioner(asked: argparse.Namespace) -> None:
    """A hydraulic tensioner on its rig: loops, sweeps over frequency and temperature, published trends.

    python scripts/figures.py tensioner [docs/images]

    The tensioner is the one of docs/tensioners.md, on the slider of the example drive `engine`. Feng, Yang and Wang
    (Chin. J. Mech. Eng. 36, 2023) find that the largest damping force rises as the gap shrinks and falls with the oil's
    temperature and air; the last figure has that force, above the one at rest, and the work of a cycle.
    """
    folder = asked.folder
    drive = loads_drive(drive_path("engine").read_text() + TENSIONER)
    valve(drive)
    loops(drive, folder / "tensioner-loops.png")
    frequencies(drive, folder / "tensioner-frequency.png")
    trends(drive, folder / "tensioner-trends.png")
