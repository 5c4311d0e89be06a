"""Losses of joints: results of docs/validation-published.md."""

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line
from common.drives import example_drive
from matplotlib.figure import Figure

from drawings.closed_forms import ValidationRow
from warpchain import Drive, Record, load_drive, simulate
from warpchain.fit import fit_links, fit_position

BICYCLE = Path(__file__).with_name("bicycle.toml")
TENSIONS, COGS, FRICTIONS = (75.0, 100.0, 150.0, 300.0), (11, 16, 21), (0.05, 0.1, 0.2, 0.3)
"""Pull of a bicycle's chain [N], teeth, friction in the joints: no source states the last."""


CADENCES, MEASURED = (40, 50, 60, 70, 80, 90), (97.8, 95.9, 94.4, 92.8, 91.3, 89.9)
"""Of Spicer et al.: cadence [rpm] and efficiency [%] with 52 and 21 teeth at 100 W."""


def efficiency_line(efficiency: Any, tensions: Any = TENSIONS) -> tuple[float, float, float]:
    """Intercept, slope [N] and R^2 of an efficiency over 1/T."""
    x = 1.0 / np.array(tensions)
    slope, intercept = np.polyfit(x, efficiency, 1)
    return float(intercept), float(slope), float(np.corrcoef(x, efficiency)[0, 1] ** 2)


def geared_derailleur(teeth: int, tension: float, friction: float) -> Drive:
    """The example `derailleur` with another cog and load, links to fit."""
    torque = tension * 12.7e-3 / (2.0 * math.sin(math.pi / teeth))
    values = {"sprockets.cog.load.torque": torque, "chain.joint.friction": friction}
    return fit_links(example_drive("derailleur", {"sprockets.cog.teeth": teeth} | values))


def efficiency_over_tension(axes: Any) -> ValidationRow:
    """Efficiency of a bicycle's drive over the inverse of the pull, for three cogs and a band of friction."""
    lines = [(teeth, 0.1) for teeth in COGS] + [(COGS[1], mu) for mu in (0.05, 0.2)]
    drives = [geared_derailleur(teeth, tension, mu) for teeth, mu in lines for tension in TENSIONS]
    run = simulate(drives, record=Record("none"), device="cpu", duration=0.6, window=(0.3, 0.6))
    rows = run.metrics.to_pylist()
    whole = np.reshape([row["efficiency"] for row in rows], (len(lines), -1))
    joints = np.reshape([row["joints.friction"] / row["output_work"] for row in rows], (len(lines), -1))
    x = np.array([0.0, 1.0 / TENSIONS[0]])
    for (teeth, mu), values in zip(lines, whole, strict=True):
        intercept, slope, fit = efficiency_line(values)
        label = f"{teeth} teeth, friction {mu:g}: {intercept:.4f} {slope:+.2f} N / T, R^2 = {fit:.4f}"
        (drawn,) = axes.plot(1.0 / np.array(TENSIONS), values, "o", ms=4, label=label)
        axes.plot(x, intercept + slope * x, lw=0.8, color=drawn.get_color())
    axes.set(xlabel="1/T [1/N], T = load / radius of the cog", ylabel="efficiency", xlim=(0.0, None))
    at = ", ".join(f"{100.0 * values[-1]:.1f} %" for values in whole[: len(COGS)])
    least, of_joints = (min(efficiency_line(values)[2] for values in all_of) for all_of in (whole, joints))
    most = max(efficiency_line(values)[0] for values in whole)
    pulls = 100.0 / (52 * 12.7e-3 * np.array(CADENCES) / 60.0)
    source = efficiency_line(np.array(MEASURED) / 100.0, pulls)
    axes.plot(1.0 / pulls, np.array(MEASURED) / 100.0, "kx", label="52 and 21 teeth, measured by Spicer et al.")
    slopes = sorted(efficiency_line(values)[1] for values in whole)
    return ValidationRow(
        name="pin friction: tension, teeth",
        states="efficiency is a line of 1/T and rises with T; small wheels lose more; 52 and 21 teeth, 100 W, "
        f"{CADENCES[0]} to {CADENCES[-1]} rpm: {MEASURED[0]} to {MEASURED[-1]} %, a line of {100.0 * source[0]:.1f} % "
        f"and {source[1]:+.1f} N, R^2 = {source[2]:.3f}",
        gives=f"lines: R^2 of the joints' part at least {of_joints:.5f}, of the whole {least:.3f}; at 300 N {at}; "
        f"friction 0.2 to 0.05: {100.0 * whole[4, -1]:.1f} to {100.0 * whole[3, -1]:.1f} %; slopes {slopes[0]:+.1f} to "
        f"{slopes[-1]:+.1f} N",
        differs=f"their lines pass 100 % where 1/T = 0, those here end at {100.0 * most:.1f} % at most; slopes are "
        f"{source[1] / slopes[0]:.0f} to {source[1] / slopes[-1]:.0f} times flatter",
    )


def bicycle_drive(
    ring: int,
    cog: int,
    friction: float,
    stiffness: float = 7e7,
    sag: float = 4e-3,
    power: float = 250.0,
    cadence: float = 95.0,
    elongation: float = 0.0,
) -> Drive:
    """Two sprockets of a bicycle that put out a power [W] at a cadence [rpm]."""
    speed = cadence * math.tau / 60.0 * ring / cog
    values = {
        "chain.stiffness": stiffness,
        "chain.joint.friction": friction,
        "chain.elongation": elongation,
        "sprockets.ring.teeth": ring,
        "sprockets.cog.teeth": cog,
        "sprockets.ring.prescribed.speed": cadence * math.tau / 60.0,
        "sprockets.cog.load": {"torque": 0.5 * power / speed, "viscous": 0.5 * power / speed**2, "ramp_time": 0.5},
    }
    return fit_position(fit_links(load_drive(BICYCLE).with_values(values)), "cog", (1.0, 0.0), sag=sag)


def drive_losses(drives: list[Drive], power: float = 250.0) -> np.ndarray:
    """Losses [W] of drives that put out a power [W]."""
    run = simulate(drives, record=Record("none"), device="cpu", window=(1.5, 2.5))
    return power * (1.0 / np.array(run.metrics["efficiency"]) - 1.0)


def gear_losses() -> Iterator[ValidationRow]:
    """Losses of single gears, and the friction that each published one needs."""
    gears = ((53, 11), (39, 11), (53, 15))
    lost = {gear: drive_losses([bicycle_drive(*gear, mu) for mu in FRICTIONS]) for gear in gears}
    assumed = [bicycle_drive(53, 11, 0.2, stiffness, sag) for stiffness in (7e6, 7e7) for sag in (2e-3, 8e-3)]
    spread = drive_losses(assumed)
    more = lost[39, 11] - lost[53, 15]
    good, other = (float(np.interp(watts, lost[53, 11], FRICTIONS)) for watts in (6.7, 9.2))
    yield ValidationRow(
        name="pin friction: 53/11",
        gives=f"{lost[53, 11][0]:.1f} to {lost[53, 11][-1]:.1f} W",
        differs=f"6.7 W at friction {good:.2f}, 9.2 W at {other:.2f}; links of 7e6 to 7e7 N/m, sag of 2 to 8 mm, "
        f"friction 0.2: {spread.min():.1f} to {spread.max():.1f} W",
    )
    own = float(np.interp(1.5, more, FRICTIONS))
    first, second = np.interp((good, other), FRICTIONS, more)
    costs = float(np.interp(own, FRICTIONS, lost[53, 11]))
    yield ValidationRow(
        name="pin friction: 39/11, 53/15",
        gives=f"{more[0]:.1f} to {more[-1]:.1f} W more; {first:.1f} and {second:.1f} W with the two chains above",
        differs=f"{first - 1.5:+.1f} and {second - 1.5:+.1f} W; none at friction {own:.2f}",
        verdict=f"sign agrees; size not with those two chains, but with one that costs {costs:.1f} W on 53/11",
    )


RINGS, CASSETTE = (58, 60, 62), (13, 16, 24)


def large_rings() -> ValidationRow:
    """Losses at the rate of a time trial, over the teeth of ring and cog."""
    pairs = [(ring, cog) for ring in RINGS for cog in CASSETTE]
    drives = [bicycle_drive(*teeth, 0.2, power=450.0, cadence=100.0) for teeth in pairs]
    lost = np.reshape(drive_losses(drives, 450.0), (len(RINGS), len(CASSETTE)))
    by_ring, by_cog = lost.mean(axis=1), lost.mean(axis=0)
    return ValidationRow(
        name="pin friction: rings of 58 to 62",
        gives=f"cogs, mean of the rings: {by_cog[0]:.1f}, {by_cog[1]:.1f}, {by_cog[2]:.1f} W; rings, mean of the cogs: "
        f"{by_ring[0]:.2f}, {by_ring[1]:.2f}, {by_ring[2]:.2f} W",
        differs=f"62 for 58 teeth: {by_ring[2] - by_ring[0]:+.2f} W, {100.0 * (by_ring[2] / by_ring[0] - 1.0):+.1f} %",
    )


POWERS, SOLO = (100.0, 250.0, 400.0), ((53, 11), (53, 13))
"""Power [W] and teeth of a race bicycle."""


def race_losses() -> ValidationRow:
    """Losses of a race bicycle over power and gear."""
    drives = [bicycle_drive(*gear, mu, power=power) for mu, gear, power in product(FRICTIONS, SOLO, POWERS)]
    shares = np.reshape(drive_losses(drives, 100.0), (len(FRICTIONS), len(SOLO), -1))  # % of what they put out
    means, gears = shares.mean(axis=(1, 2)), shares.mean(axis=2)
    ratio = gears[:, 1] / gears[:, 0]
    own = float(np.interp(2.1, means, FRICTIONS))
    return ValidationRow(
        name="pin friction: race bicycle",
        gives=f"{means[0]:.1f} to {means[-1]:.1f} %, 2.1 % at friction {own:.2f}; 53/13 loses {ratio.min():.2f} to "
        f"{ratio.max():.2f} of 53/11",
    )


def worn_chain_losses() -> ValidationRow:
    """Losses of a chain that has grown longer."""
    frictions = FRICTIONS[:-1]
    drives = [bicycle_drive(53, 11, mu, elongation=share) for mu in frictions for share in (0.0, 0.01)]
    more = np.diff(np.reshape(drive_losses(drives), (len(frictions), 2)))
    return ValidationRow(
        name="worn chain",
        gives=f"{more.max():+.2f} to {more.min():+.2f} W for 1 %",
        differs=f"{more.max() - 2.02:+.1f} to {more.min() - 2.02:+.1f} W",
    )


WHEEL, DRAG, ROLLING = 0.32, 0.5 * 1.2 * 0.33, 100.0
"""A motorcycle: radius of its wheel [m], drag over the square of its speed [kg/m], and rolling resistance [N]."""
MPH = 0.44704
RATE = (35.0, 75.0, 150.0)
SIZES = {(13, 35): "C0", (16, 43): "C1", (20, 54): "C2"}
"""Teeth of gearbox and wheel, near one ratio."""


def motorcycle_drive(speed: float, teeth: tuple[int, int], size: str = "10B", friction: float = 0.1) -> Drive:
    """The example `motorcycle` at a steady speed [mph], with other teeth and another chain; drag and slip load it."""
    turn = MPH * speed / WHEEL
    torque = (ROLLING + DRAG * (MPH * speed) ** 2) * WHEEL
    values = {
        "chain.size": size,
        "chain.stiffness": "estimate",
        "chain.joint.friction": friction,
        "sprockets.gearbox.teeth": teeth[0],
        "sprockets.gearbox.prescribed": {"speed": turn * teeth[1] / teeth[0]},
        "sprockets.wheel.teeth": teeth[1],
        "sprockets.wheel.center": [-0.6, -0.03],
        "sprockets.wheel.load": {"torque": 0.5 * torque, "viscous": 0.5 * torque / turn, "ramp_time": 0.05},
    }
    return fit_position(fit_links(example_drive("motorcycle", values)), "wheel", (1.0, 0.0), sag=0.015)


def motorcycle_efficiencies(drives: list[Drive]) -> np.ndarray:
    """Efficiencies of motorcycles."""
    run = simulate(drives, record=Record("none"), device="cpu", duration=0.3, window=(0.15, 0.3))
    return np.array(run.metrics["efficiency"])


def efficiency_by_pitch(axes: Any) -> ValidationRow:
    """Efficiency of a motorcycle's chain over speed, teeth and pitch."""
    own = np.reshape(
        motorcycle_efficiencies([motorcycle_drive(v, teeth) for teeth in SIZES for v in RATE]), (len(SIZES), -1)
    )
    bounds = [motorcycle_efficiencies([motorcycle_drive(v, (16, 43), friction=mu) for v in RATE]) for mu in (0.05, 0.2)]
    sizes = {"08B": (20, 54), "10B": (16, 43), "12B": (13, 36)}
    fine, _, coarse = motorcycle_efficiencies([motorcycle_drive(75.0, teeth, size) for size, teeth in sizes.items()])
    for (teeth, color), values in zip(SIZES.items(), own, strict=True):
        axes.plot(RATE, 100.0 * values, "o-", ms=4, lw=0.8, color=color, label=f"10B, {teeth[0]} and {teeth[1]} teeth")
    low, high = (100.0 * bound for bound in bounds)
    axes.fill_between(RATE, high, low, color="C1", alpha=0.15, lw=0.0, label="16 and 43 teeth, friction 0.05 to 0.2")
    axes.set(xlabel="speed of the motorcycle [mph]", ylabel="efficiency [%]")
    gain = 100.0 * (own[2] - own[0])
    return ValidationRow(
        name="pin friction: motorcycle",
        gives=f"35 to 75 mph: {100.0 * bounds[1][:2].min():.1f} to {100.0 * bounds[0][:2].max():.1f} %; 150 mph: "
        f"{100.0 * bounds[1][2]:.1f} to {100.0 * bounds[0][2]:.1f} %; large for small sprockets {gain[0]:+.2f} % at "
        f"35 mph, {gain[2]:+.2f} % at 150; 75 mph: 08B {100.0 * fine:.2f} %, 12B {100.0 * coarse:.2f} %",
    )


def joint_losses() -> Iterator[Line]:
    """Losses of joints over tension, teeth, pitch and speed."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    yield efficiency_over_tension(left)
    yield from gear_losses()
    yield large_rings()
    yield race_losses()
    yield worn_chain_losses()
    yield efficiency_by_pitch(right)
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    yield {"validation-efficiency": figure}
