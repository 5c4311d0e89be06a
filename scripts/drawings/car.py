"""The car's timing drive over speed."""

import argparse
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import case, option
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from warpchain import Drive, Record, Run, Trajectory, load_drive, simulate
from warpchain.drive.examples import drive_path
from warpchain.results.shaft_signals import phase_error

SPEEDS = (600, 1000, 1500, 2000, 2500, 2800, 3000, 3500, 4000, 4500, 5000, 5500, 6000)
AT = (1500, 3000, 6000)
"""Speeds [rpm] of the sweep, and of what is changed."""
LIFT, OPEN = 9.2e-3, math.radians(60.0)
"""A valve's lift [m], and half of the camshaft's angle over which it is open [rad]."""
SEATED, RATE, MASS = 177.0, 24.5e3, 0.11
"""Force of a valve spring on its seat [N], its stiffness [N/m]; mass that moves with a valve [kg]."""
LEAD = {"intake cam": 0.0, "exhaust cam": math.radians(110.0)}
"""By how much a camshaft's valves open before those of the intake [rad of the camshaft]."""
GROUPS = ("joints", "blade", "fixed guide", "teeth")
COLORS = ("tab:blue", "tab:red", "tab:orange", "tab:green")
CHANGES: Mapping[str, tuple[str, Sequence[float], str]] = {
    "spring preload [N]": ("tensioners.tensioner.spring.preload", (10.0, 40.0, 70.0, 100.0), "preload"),
    "oil supply [bar]": ("tensioners.tensioner.oil.supply", (2e5, 3e5, 4e5, 5e5), "supply"),
    "inertia of the camshafts [%]": ("inertia", (0.5, 1.0, 1.5, 2.0), "inertia"),
    "friction of the guides [%]": ("friction", (0.5, 1.0, 1.5, 2.0), "guide friction"),
}
"""What is changed: its label, the key, the values that it takes, and what tables call it."""
UNIT = {"oil supply [bar]": 1e-5, "inertia of the camshafts [%]": 100.0, "friction of the guides [%]": 100.0}


def valve_train(rpm: float) -> Mapping[int, float]:
    """Sine amplitudes [N m] of a camshaft's torque by order of the camshaft: springs and inertia of 8 valves.

    Four pairs a quarter turn apart. Each lifts by l = (LIFT/2) (1 + cos(pi phi / OPEN)), which takes the torque
    2 l' (SEATED + RATE l + MASS omega^2 l''); what it takes to open comes back in closing, but for friction.
    """
    omega = 0.5 * rpm * 2.0 * math.pi / 60.0
    phi = np.linspace(-math.pi, math.pi, 7200, endpoint=False)
    q, open_ = math.pi * phi / OPEN, np.abs(phi) < OPEN
    lift = 0.5 * LIFT * (1.0 + np.cos(q))
    slope = -0.5 * LIFT * math.pi / OPEN * np.sin(q)
    bend = -0.5 * LIFT * (math.pi / OPEN) ** 2 * np.cos(q)
    torque = np.where(open_, 2.0 * slope * (SEATED + RATE * lift + MASS * omega**2 * bend), 0.0)
    return {order: 4.0 * 2.0 * float(np.mean(torque * np.sin(order * phi))) for order in (4, 8)}


def ripple(rpm: float) -> float:
    """Second order of the crankshaft's speed over its mean: 2 % at 1000 rpm, falling with the square; 0.5 to 3 %."""
    return min(max(0.02 * (1000.0 / rpm) ** 2, 0.005), 0.03)


def at_speed(drive: Drive, rpm: float) -> Drive:
    """The drive at a speed of the crankshaft, with that speed's ripple and valve train; half the run is cycles."""
    cycle = 120.0 / rpm
    duration = 2.0 * cycle * max(1, math.ceil(0.1 / cycle))
    ramp = 0.3 * duration
    values: dict[str, Any] = {
        "sprockets.crank.prescribed.speed": rpm * math.pi / 30.0,
        "sprockets.crank.prescribed.harmonics": [{"order": 2, "amplitude": ripple(rpm)}],
        "sprockets.crank.prescribed.ramp_time": ramp,
        "run.duration": duration,
    }
    for cam, lead in LEAD.items():
        values[f"sprockets.{cam}.load.harmonics"] = [
            {"order": order, "amplitude": amplitude, "phase": order * lead - 0.5 * math.pi}
            for order, amplitude in valve_train(rpm).items()
        ]
        values[f"sprockets.{cam}.load.ramp_time"] = ramp
    return drive.with_values(values)


def changed(drive: Drive, key: str, value: float) -> Drive:
    """The drive with one value changed; `inertia` and `friction` are factors."""
    if key == "inertia":
        paths = [f"sprockets.{cam}.inertia" for cam in LEAD]
    elif key == "friction":
        paths = ["contact.guide.friction", "contact.guide.static_friction"]
    else:
        return drive.with_values({key: value})
    # upwards the static friction first: it is never below the other
    values = {path: value * drive.get_value(path) for path in paths}
    return drive.with_values(values)


def powers(row: Mapping[str, Any]) -> dict[str, float]:
    """Friction power [W] by group, over the window."""
    span = row["window_end"] - row["window_start"]
    energy = {
        "joints": row["joints.friction"],
        "blade": row["blade.friction"],
        "fixed guide": row["fixed guide.friction"],
        "teeth": sum(row[f"{name}.friction"] for name in ("crank", *LEAD)),
    }
    return {name: energy[name] / span for name in GROUPS}


def share(power: Mapping[str, float]) -> float:
    """The part of the friction that arm and guide have."""
    return (power["blade"] + power["fixed guide"]) / sum(power.values())


def crank_degrees(trajectory: Trajectory, s: int) -> np.ndarray:
    """Phase error of sprocket s over the second half of a recording [degrees of the crankshaft]."""
    return np.degrees(phase_error(trajectory, s))[trajectory.time >= 0.5 * trajectory.time[-1]]


def sweep_table(run: Run, rows: Sequence[Mapping[str, Any]]) -> None:
    """Prints what the sweep over speed gave."""
    print(
        "| rpm | friction [W] | joints | blade | fixed guide | teeth | slack mean / max [N] | tight mean / max [N] | "
        "phase error [deg] | stroke [mm] | tensioner: least, mean, most [N] | pressure [bar] |"
    )
    print("|" + "---|" * 12)
    for rpm, row, k in zip(SPEEDS, rows, range(len(SPEEDS)), strict=False):
        power = powers(row)
        total = sum(power.values())
        parts = " | ".join(f"{100 * power[name] / total:.0f} %" for name in GROUPS)
        tension = " | ".join(
            f"{row[f'{strand}.tension_mean']:.0f} / {row[f'{strand}.tension_max']:.0f}" for strand in ENDS
        )
        error = [crank_degrees(run[k], s) for s in (1, 2)]
        phase = ", ".join(f"{e.mean():.2f} ± {0.5 * np.ptp(e):.2f}" for e in error)
        stroke = 1e3 * (row["tensioner.extension_max"] - row["tensioner.extension_min"])
        force = ", ".join(f"{row[f'tensioner.force_{part}']:.0f}" for part in ("min", "mean", "max"))
        pressure = " to ".join(f"{1e-5 * row[f'tensioner.pressure_{part}']:.1f}" for part in ("min", "max"))
        print(f"| {rpm} | {total:.0f} | {parts} | {tension} | {phase} | {stroke:.2f} | {force} | {pressure} |")


def force_orders(trajectory: Trajectory, count: int = 4) -> list[tuple[float, float]]:
    """The largest orders of the crankshaft in the tensioner's force over the window, and their amplitudes [N]."""
    assert trajectory.tensioner_force is not None
    force = np.asarray(trajectory.tensioner_force[trajectory.time >= 0.5 * trajectory.time[-1], 0], dtype=float)
    size = 2.0 / len(force) * np.abs(np.fft.rfft(force - force.mean()))
    speed = trajectory.drive.sprockets[0].prescribed
    assert speed is not None
    order = np.fft.rfftfreq(len(force), np.diff(trajectory.time).mean()) * 2.0 * math.pi / speed.top_speed
    return [(float(order[k]), float(size[k])) for k in np.argsort(size)[::-1][:count]]


def orders_table(run: Run) -> None:
    """Prints what the tensioner's force is made of."""
    print("\n| rpm | orders of the tensioner's force: amplitude [N] |")
    print("|---|---|")
    for k, rpm in enumerate(SPEEDS):
        print(f"| {rpm} | {', '.join(f'{order:.3g}: {size:.0f}' for order, size in force_orders(run[k]))} |")


ENDS = ("crank->intake cam", "exhaust cam->crank")
"""The slack and the tight strand."""


def sweep_figure(run: Run, rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Friction power by group, tensions, phase error, stroke, force and pressure over speed."""
    figure = Figure(figsize=(12, 7), constrained_layout=True)
    axes = figure.subplots(2, 3)
    power = [powers(row) for row in rows]
    axes[0, 0].stackplot(SPEEDS, *[[p[name] for p in power] for name in GROUPS], labels=GROUPS, colors=COLORS)
    axes[0, 0].set(ylabel="friction [W]")
    axes[0, 1].plot(SPEEDS, [100 * share(p) for p in power], "k-o", ms=3)
    axes[0, 1].axhspan(40, 60, color="0.9")
    axes[0, 1].set(ylabel="share of arm and guide [%]", ylim=(0, 100))
    for strand, color in zip(ENDS, ("tab:blue", "tab:red"), strict=True):
        for part, style in (("min", ":"), ("mean", "-"), ("max", "--")):
            name = strand if part == "mean" else None
            axes[0, 2].plot(SPEEDS, [row[f"{strand}.tension_{part}"] for row in rows], style, color=color, label=name)
    axes[0, 2].set(ylabel="tension: least, mean, most [N]")
    for s, color in ((1, "tab:blue"), (2, "tab:red")):
        error = [crank_degrees(run[k], s) for k in range(len(SPEEDS))]
        name = run[0].drive.sprockets[s].name
        axes[1, 0].plot(SPEEDS, [e.mean() for e in error], color=color, label=name)
        axes[1, 0].fill_between(SPEEDS, [e.min() for e in error], [e.max() for e in error], color=color, alpha=0.2)
    axes[1, 0].set(ylabel="phase error [deg of the crankshaft]")
    band(axes[1, 1], rows, "tensioner.extension", 1e3, "extension of the plunger [mm]")
    band(axes[1, 2], rows, "tensioner.pressure", 1e-5, "pressure of the chamber [bar]")
    for one in axes.flat:
        one.set(xlabel="crankshaft [rpm]")
        one.grid(alpha=0.3)
    for one in (axes[0, 0], axes[0, 2], axes[1, 0]):
        one.legend(fontsize=8)
    return figure


def band(axes: Axes, rows: Sequence[Mapping[str, Any]], name: str, scale: float, label: str) -> None:
    """A mean over speed with its range."""
    low, mean, high = ([scale * row[f"{name}_{part}"] for row in rows] for part in ("min", "mean", "max"))
    axes.fill_between(SPEEDS, low, high, color="tab:green", alpha=0.25)
    axes.plot(SPEEDS, mean, color="tab:green")
    axes.set(ylabel=label)


def trends(done: Mapping[tuple[str, int], Sequence[Mapping[str, Any]]]) -> Figure:
    """Friction over what was changed, a line a speed; prints it too."""
    print("\n| changed | rpm | friction [W] | of it arm and guide |")
    print("|---|---|---|---|")
    figure = Figure(figsize=(12, 3.6), constrained_layout=True)
    for axes, (label, (_, values, title)) in zip(figure.subplots(1, len(CHANGES)), CHANGES.items(), strict=True):
        x = [UNIT.get(label, 1.0) * value for value in values]
        for rpm, color in zip(AT, COLORS, strict=False):
            power = [powers(row) for row in done[label, rpm]]
            total = [sum(p.values()) for p in power]
            axes.plot(x, total, "o-", ms=3, color=color, label=f"{rpm} rpm")
            axes.plot(x, [p["blade"] + p["fixed guide"] for p in power], ":", color=color)
            cells = (
                ", ".join(f"{v:{form}}" for v in some) for form, some in ((".0f", total), (".2f", map(share, power)))
            )
            print(f"| {title} {', '.join(f'{v:g}' for v in x)} | {rpm} | {' | '.join(cells)} |")
        axes.set(xlabel=label, ylim=(0, None))
        axes.grid(alpha=0.3)
    figure.axes[0].set(ylabel="friction [W], dotted: arm and guide")
    figure.axes[0].legend(fontsize=8)
    return figure


def suspects(rows: Iterable[Mapping[str, Any]]) -> None:
    """Says which runs are not to be believed."""
    rows = list(rows)
    worst = max(abs(row["energy_residual_relative"]) for row in rows)
    bad = {row["reason"] for row in rows if row["status"] != "ok"}
    print(
        f"\n{len(rows)} runs, {sum(row['status'] == 'ok' for row in rows)} ok, largest energy residual {worst:.1e}",
        *bad,
    )


@case(option("folder", nargs="?", type=Path, help="where to save the figures; default: nowhere"))
def car(asked: argparse.Namespace) -> None:
    """The timing drive `car` from 600 to 6000 rpm, and how its friction answers to preload, oil pressure and inertia.

    python scripts/figures.py car [docs/images]

    Prints the tables of docs/car.md and draws its figures there. At each speed the camshafts' torque is that of their
    valve train (`valve_train`) and the crankshaft's ripple that of a four-cylinder engine (`ripple`). Every run takes
    its metrics over whole engine cycles, two revolutions of the crankshaft.
    """
    folder = asked.folder
    drive = load_drive(drive_path("car"))
    cases = [(label, rpm, value) for label, (_, values, _) in CHANGES.items() for rpm in AT for value in values]
    drives = [at_speed(drive, rpm) for rpm in SPEEDS]
    drives += [changed(at_speed(drive, rpm), CHANGES[label][0], value) for label, rpm, value in cases]
    record = Record(variants=range(len(SPEEDS)), rate=1e4, channels=("sprocket_angle", "tensioner_force"))
    run = simulate(drives, record=record, progress=True)
    rows = run.metrics.to_pylist()
    sweep, rest = rows[: len(SPEEDS)], rows[len(SPEEDS) :]
    done: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    for (label, rpm, _), row in zip(cases, rest, strict=True):
        done.setdefault((label, rpm), []).append(row)
    sweep_table(run, sweep)
    orders_table(run)
    figures = {"car-speed.png": sweep_figure(run, sweep), "car-trends.png": trends(done)}
    suspects(rows)
    if folder is not None:
        for name, figure in figures.items():
            figure.savefig(folder / name, dpi=100)
