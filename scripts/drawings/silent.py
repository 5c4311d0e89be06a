"""Figures of docs/silent-chains.md: a silent chain at work, and silent chains beside a roller chain."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line, case
from common.drives import Values, example_drive

from drawings.car import CAMS, COLORS, TIGHT, Metrics, crankshaft_order_amplitudes, drive_at_speed
from drawings.closed_forms import ValidationRow
from warpchain import Drive, Record, Trajectory, load_drive, simulate
from warpchain.results.losses import losses
from warpchain.results.signals import strand_tension
from warpchain.results.strand_passing import passing_link
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.figures.figure_style import panel_grid

DRIVE = Path(__file__).with_name("silent.toml")
AROUND = 0.048
"""Half the height of the picture [m]."""
SPEEDS = tuple(range(1000, 6001, 500))
"""Speeds at which the chains of a car run [rpm]."""
STEP = 1.25e-6
"""Step of these runs [s], for steel flanks."""
ON_SHAFTS: Values = {
    "chain.size": "SC302",
    "contact.sprocket.profile": None,
    "contact.sprocket.clearance": None,
    "contact.sprocket.width": None,
    "contact.sprocket.friction": 0.08,
    "guides.blade.offset": None,
    "guides.fixed guide.offset": None,
}
"""Changes of `car` for a silent chain on its shafts: of the same pitch, flanks that slide, guides on backs."""
DRAWN = 4
"""Chains in the figure, the first ones."""


@case()
def silent(_: argparse.Namespace) -> Iterator[Line]:
    """Driving wheel of a silent chain at work: plates, teeth, tensions and contact forces.

    python scripts/figures.py silent

    Prints the largest tension and contact force, and the losses.
    """
    drive = load_drive(DRIVE)
    run = simulate(drive, record=Record(rate=5000.0), device="cpu")
    (row,) = run.metrics.to_pylist()
    yield ("metric", "value")
    for name in ("tension_max", "driver.force_max", "driven.force_max", "efficiency"):
        yield (f"`{name}`", f"{row[name]:.4g}")
    figure = drive_figure(run[0])
    axis = figure.axes[0]
    box, place = axis.get_window_extent(), 1e3 * AROUND * np.array([-1.0, 1.0])
    axis.set(xlim=box.width / box.height * (place + 1e3 * AROUND) - 1e3 * AROUND, ylim=place)
    for text in axis.texts:
        text.set_clip_on(True)
    yield {"silent": figure}


def chains_of_car() -> dict[str, list[Drive]]:
    """The timing drive `car` over speed with its roller chain and with silent chains, by what is shown."""
    step: Values = {"run.step": STEP}
    car = [drive_at_speed(rpm).with_values(step) for rpm in SPEEDS]
    silent = [drive.with_values(ON_SHAFTS) for drive in car]
    plates, pins = silent[0].chain, car[0].chain.pin_radius
    links: Values = {"chain.stiffness": plates.stiffness, "chain.mass_per_length": plates.mass_per_length}
    return {
        "06B, 19 and 38 teeth": car,
        "SC302, 19 and 38 teeth": silent,
        "the same, steel on steel": [drive.with_values({"contact.sprocket.bush_stiffness": None}) for drive in silent],
        "silent-8, 23 and 46 teeth": [drive_at_speed(rpm, "silent_timing").with_values(step) for rpm in SPEEDS],
        "06B, links as stiff and heavy as of SC302": [drive.with_values(links) for drive in car],
        "SC302, pins as thick as of 06B": [drive.with_values({"chain.joint.pin_radius": pins}) for drive in silent],
    }


def compared_values(trajectory: Trajectory, row: Metrics) -> tuple[float, float, float, float]:
    """Amplitude of the tight strand's tension at the tooth frequency [N], largest contact force [N], loss [W] and
    efficiency."""
    drive = trajectory.drive
    tension = strand_tension(trajectory, TIGHT, passing_link(trajectory, TIGHT))
    (ripple,) = crankshaft_order_amplitudes(trajectory, tension, [drive.sprockets[drive.driver].teeth])
    force = max(row[f"{name}.force_max"] for name in ("crank", *CAMS))
    lost = sum(losses(drive, row).values()) / (row["window_end"] - row["window_start"])
    return float(ripple), force, lost, row["efficiency"]


@case()
def silent_car(_: argparse.Namespace) -> Iterator[Line]:
    """The timing drive `car` from 1000 to 6000 rpm with its roller chain and with silent chains.

    python scripts/figures.py silent-car

    Ripple is the amplitude of the tight strand's tension at the frequency at which teeth pass. A contact is a roller's,
    or one end of a flank.
    """
    figure, axes = panel_grid(4, 2, 5.0, 3.4)
    words = ("ripple [N]", "largest contact force [N]", "lost [W]", "efficiency")
    found: dict[str, list[Sequence[float]]] = {}
    worst, count, good = 0.0, 0, 0
    for number, (name, drives) in enumerate(chains_of_car().items()):
        run = simulate(drives, record=Record(rate=1e4, channels=("position", "tension", "sprocket_angle")))
        rows: list[dict[str, Any]] = run.metrics.to_pylist()
        found[name] = [compared_values(run[k], row) for k, row in enumerate(rows)]
        worst = max(worst, *(abs(row["energy_residual_relative"]) for row in rows))
        count, good = count + len(rows), good + int(run.ok.sum())
        for axis, curve, label in zip(axes, zip(*found[name], strict=True), words, strict=True):
            if number < DRAWN:
                axis.plot(SPEEDS, curve, "o-", ms=3, color=COLORS[number], label=name)
            axis.set(xlabel="crankshaft [rpm]", ylabel=label)
    for axis in axes[:3]:
        axis.set_ylim(0.0, None)
    axes[0].legend(fontsize=8)
    yield ("rpm", "chain", *words)
    for k, rpm in enumerate(SPEEDS):
        for name, values in found.items() if rpm % 1000 == 0 else ():
            ripple, force, lost, efficiency = values[k]
            yield (rpm, name, f"{ripple:.0f}", f"{force:.0f}", f"{lost:.0f}", f"{efficiency:.3f}")
    yield f"{count} runs, {good} ok, largest energy residual {worst:.1e}"
    yield {"silent-car": figure}


def silent_beside_roller() -> Iterator[ValidationRow]:
    """Contacts of a silent chain over those of a roller chain, and its efficiency over friction."""
    speeds = (1000, 3000, 6000)
    car = [drive_at_speed(rpm).with_values({"run.step": STEP}) for rpm in speeds]
    silent = [drive.with_values(ON_SHAFTS) for drive in car]
    steel = [drive.with_values({"contact.sprocket.bush_stiffness": None}) for drive in silent]
    roller, *others = (simulate(drives, record=Record("none")).metrics.to_pylist() for drives in (car, silent, steel))

    def ratios(metric: str) -> str:
        """Ratios of a metric of the crankshaft's contacts, silent over roller chain, as compliant and with steel."""
        cells = (
            [f"{mine[metric] / its[metric]:.2f}" for its, mine in zip(roller, rows, strict=True)] for rows in others
        )
        return " (steel on steel ".join(map(", ".join, cells)) + ")"

    yield ValidationRow(
        name="silent beside roller chain",
        gives=f"silent over roller at {', '.join(map(str, speeds))} rpm: energy of contacts a turn "
        f"{ratios('crank.contact_energy_per_revolution')}, largest contact force {ratios('crank.force_max')}",
    )
    case_drive, friction = example_drive("transfer_case"), (0.05, 0.08, 0.15)
    keys = "chain.joint.friction", "contact.sprocket.friction"
    drives = [case_drive.with_values(dict.fromkeys(keys, mu)) for mu in friction]
    run = simulate(drives, window=(0.35, 0.5), record=Record("none"))
    found = ", ".join(f"{100.0 * efficiency:.2f}" for efficiency in run.metrics["efficiency"].to_pylist())
    yield ValidationRow(name="efficiency of a silent chain", gives=f"{found} %")
