"""The car's timing drive over speed."""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from common.cases import Line, case
from common.drives import Values, example_drive
from matplotlib.figure import Figure

from drawings.closed_forms import ValidationRow
from warpchain import Drive, Record, Run, simulate
from warpchain.results.order_tracking import driver_turns, order_amplitudes
from warpchain.results.shaft_signals import phase_error
from warpchain.results.signals import strand_tension
from warpchain.results.strand_passing import passing_link
from warpchain.view.figures.figure_style import panel_grid

SPEEDS = (600, 1000, 1500, 2000, 2500, 2800, 3000, 3500, 4000, 4500, 5000, 5500, 6000)
AT = (1500, 3000, 6000)
"""Speeds [rpm] of the sweep, and of what is changed."""
CAMS = ("intake cam", "exhaust cam")
PARTS = {"joints": ("joints",), "blade": ("blade",), "fixed guide": ("fixed guide",), "teeth": ("crank", *CAMS)}
"""Groups of what rubs."""
ENDS = ("crank->intake cam", "exhaust cam->crank")
"""The slack and the tight strand."""
COLORS = ("tab:blue", "tab:red", "tab:orange", "tab:green")
CHANGES: Mapping[str, tuple[str, Sequence[float], float]] = {
    "spring preload [N]": ("tensioners.tensioner.spring.preload", (10.0, 40.0, 70.0, 100.0), 1.0),
    "oil supply [bar]": ("tensioners.tensioner.oil.supply", (2e5, 3e5, 4e5, 5e5), 1e-5),
    "inertia of the camshafts [%]": ("inertia", (0.5, 1.0, 1.5, 2.0), 100.0),
    "friction of the guides [%]": ("friction", (0.5, 1.0, 1.5, 2.0), 100.0),
}
"""The label of each change, the key, its values, and what they are shown times."""
FACTORS = {
    "inertia": [f"sprockets.{cam}.inertia" for cam in CAMS],
    "friction": ["contact.guide.friction", "contact.guide.static_friction"],
}
"""Keys that are changed together by a factor."""
ORDERS, TIGHT = (2, 4, 6, 8), 2
"""Orders of the crankshaft beside the published ones, and the strand in which they are: exhaust cam to crankshaft."""
Metrics = Mapping[str, Any]


def crankshaft_ripple(rpm: float) -> float:
    """Second order of the crankshaft's speed over its mean: 2 % at 1000 rpm, falling with the square; 0.5 to 3 %."""
    return min(max(0.02 * (1000.0 / rpm) ** 2, 0.005), 0.03)


def drive_at_speed(rpm: float, name: str = "car") -> Drive:
    """The drive, or another with its shafts, at a speed of the crankshaft, with that speed's ripple.

    Half the run is cycles, two at least: a line through the four waves of one is inclined by more than `Limits.start`
    allows.
    """
    cycle = 120.0 / rpm
    duration = 2.0 * cycle * max(2, math.ceil(0.1 / cycle))
    ramp = 0.3 * duration
    values: Values = {
        "sprockets.crank.prescribed.speed": rpm * math.pi / 30.0,
        "sprockets.crank.prescribed.harmonics": [{"order": 2, "amplitude": crankshaft_ripple(rpm)}],
        "sprockets.crank.prescribed.ramp_time": ramp,
        "run.duration": duration,
        "run.step": 2.5e-6,  # of which frames are a whole number: the automatic step's last comes short of the cycle
    }
    for cam in CAMS:
        values[f"sprockets.{cam}.load.ramp_time"] = ramp
    return example_drive(name, values)


def changed_drive(drive: Drive, key: str, value: float) -> Drive:
    """The drive with one value changed; `inertia` and `friction` are factors."""
    return drive.with_values({path: value * drive.get_value(path) for path in FACTORS.get(key, ())} or {key: value})


def friction_powers(row: Metrics) -> np.ndarray:
    """Friction power [W] of each group, over the window."""
    span = row["window_end"] - row["window_start"]
    return np.array([sum(row[f"{name}.friction"] for name in names) / span for names in PARTS.values()])


def second_half_frames(trajectory: Any) -> np.ndarray:
    """The frames of the second half of a recording."""
    return np.asarray(trajectory.time >= 0.5 * trajectory.time[-1])


def phase_error_degrees(trajectory: Any, s: int) -> np.ndarray:
    """Phase error of sprocket s over the second half of a recording [degrees of the crankshaft]."""
    return np.degrees(phase_error(trajectory, s))[second_half_frames(trajectory)]


def sweep_table(run: Run, rows: Sequence[Metrics]) -> Iterator[Line]:
    """The table over speed."""
    tension = (f"{strand} mean / max [N]" for strand in ("slack", "tight"))
    force = ("stroke [mm]", "tensioner: least, mean, most [N]", "pressure [bar]")
    yield ("rpm", "friction [W]", *PARTS, *tension, "phase error [deg]", *force)
    for k, (rpm, row) in enumerate(zip(SPEEDS, rows, strict=True)):
        power = friction_powers(row)
        shares = (f"{100 * part / power.sum():.0f} %" for part in power)
        tension = (f"{row[f'{end}.tension_mean']:.0f} / {row[f'{end}.tension_max']:.0f}" for end in ENDS)
        phase = ", ".join(
            f"{e.mean():.2f} ± {0.5 * np.ptp(e):.2f}" for e in (phase_error_degrees(run[k], s) for s in (1, 2))
        )
        stroke = f"{1e3 * (row['tensioner.extension_max'] - row['tensioner.extension_min']):.2f}"
        forces = ", ".join(f"{row[f'tensioner.force_{part}']:.0f}" for part in ("min", "mean", "max"))
        pressure = " to ".join(f"{1e-5 * row[f'tensioner.pressure_{part}']:.1f}" for part in ("min", "max"))
        yield (rpm, f"{power.sum():.0f}", *shares, *tension, phase, stroke, forces, pressure)


def orders_table(run: Run) -> Iterator[Line]:
    """The largest orders of the crankshaft in the tensioner's force over the window, and their amplitudes."""
    yield ("rpm", "orders of the tensioner's force: amplitude [N]")
    orders = np.arange(0.5, 60.0, 0.5)
    for k, rpm in enumerate(SPEEDS):
        part, force = second_half_frames(run[k]), run[k].channels()["tensioner_force"][:, 0].astype(float)
        size: Any = order_amplitudes(driver_turns(run[k])[part], force[part], orders.tolist())
        yield (rpm, ", ".join(f"{orders[i]:g}: {size[i]:.0f}" for i in np.argsort(size)[:-5:-1]))


def crankshaft_order_amplitudes(trajectory: Any, values: np.ndarray, orders: Sequence[float]) -> np.ndarray:
    """Amplitudes of orders of the crankshaft over the second half of a recording."""
    part = second_half_frames(trajectory)
    return np.asarray(order_amplitudes(driver_turns(trajectory)[part], values[part].astype(float), list(orders)))


def published_table(run: Run, rows: Sequence[Metrics], light: Run, soft: Run) -> Iterator[Line]:
    """The tight span's largest link load, its torsion beside that of a softer chain, and orders of its tension beside
    those without valves' mass.
    """
    words = tuple(f"order {order}" for order in ORDERS)
    torsions = ("torsion [deg]", "torsion, a third of the stiffness [deg]")
    yield ("rpm", "largest link load [N]", *torsions, *words, *(f"{word}, no mass" for word in words))
    for k, (rpm, row) in enumerate(zip(SPEEDS, rows, strict=True)):
        cells = [f"{np.ptp(phase_error_degrees(part[k], 2)):.2f}" for part in (run, soft)]
        for part in (run[k], light[k]):
            pull = strand_tension(part, TIGHT, passing_link(part, TIGHT))
            cells += [f"{size:.0f}" for size in crankshaft_order_amplitudes(part, pull, ORDERS)]
        yield (rpm, f"{row[f'{ENDS[1]}.tension_max']:.0f}", *cells)


def sweep_figure(run: Run, rows: Sequence[Metrics]) -> Figure:
    """Friction power by group, tensions, phase error, stroke, force and pressure over speed."""
    figure, (friction, share, tension, phase, stroke, pressure) = panel_grid(6, 3, 4.0, 3.5)
    power = np.array([friction_powers(row) for row in rows]).T
    friction.stackplot(SPEEDS, *power, labels=PARTS, colors=COLORS)
    friction.set(ylabel="friction [W]")
    share.plot(SPEEDS, 100 * power[1:3].sum(axis=0) / power.sum(axis=0), "k-o", ms=3)
    share.axhspan(40, 60, color="0.9")
    share.set(ylabel="share of arm and guide [%]", ylim=(0, 100))

    def least_mean_largest(name: str, scale: float = 1.0) -> list[list[float]]:
        """Columns of a metric's least, mean and largest value, times a scale."""
        return [[scale * row[f"{name}_{part}"] for row in rows] for part in ("min", "mean", "max")]

    for s, (strand, color) in enumerate(zip(ENDS, COLORS, strict=False), 1):
        for values, style in zip(least_mean_largest(f"{strand}.tension"), (":", "-", "--"), strict=True):
            tension.plot(SPEEDS, values, style, color=color, label=strand if style == "-" else None)
        error = [phase_error_degrees(run[k], s) for k in range(len(SPEEDS))]
        phase.plot(SPEEDS, [e.mean() for e in error], color=color, label=run[0].drive.sprockets[s].name)
        phase.fill_between(SPEEDS, [e.min() for e in error], [e.max() for e in error], color=color, alpha=0.2)
    tension.set(ylabel="tension: least, mean, most [N]")
    phase.set(ylabel="phase error [deg of the crankshaft]")
    for axes, name, scale, label in (
        (stroke, "extension", 1e3, "extension of the plunger [mm]"),
        (pressure, "pressure", 1e-5, "pressure of the chamber [bar]"),
    ):
        low, mean, high = least_mean_largest(f"tensioner.{name}", scale)
        axes.fill_between(SPEEDS, low, high, color="tab:green", alpha=0.25)
        axes.plot(SPEEDS, mean, color="tab:green")
        axes.set(ylabel=label)
    for axes in figure.axes:
        axes.set(xlabel="crankshaft [rpm]")
    for axes in (friction, tension, phase):
        axes.legend(fontsize=8)
    return figure


def friction_trends(rows: Iterator[Metrics], panels: Sequence[Any]) -> Iterator[Line]:
    """Rows and curves of friction over what was changed, a line a speed."""
    yield ("changed", "", "rpm", "friction [W]", "of it arm and guide")
    for axes, (label, (_, values, scale)) in zip(panels, CHANGES.items(), strict=True):
        x = [scale * value for value in values]
        for rpm, color in zip(AT, COLORS, strict=False):
            power = np.array([friction_powers(next(rows)) for _ in values]).T
            total, guides = power.sum(axis=0), power[1:3].sum(axis=0)
            axes.plot(x, total, "o-", ms=3, color=color, label=f"{rpm} rpm")
            axes.plot(x, guides, ":", color=color)
            cells = (", ".join(map("{:.0f}".format, total)), ", ".join(map("{:.2f}".format, guides / total)))
            yield (label, ", ".join(f"{v:g}" for v in x), rpm, *cells)
        axes.set(xlabel=label, ylim=(0, None))
    panels[0].set(ylabel="friction [W], dotted: arm and guide")
    panels[0].legend(fontsize=8)


@case()
def car(asked: argparse.Namespace) -> Iterator[Line]:
    """The timing drive `car` from 600 to 6000 rpm, and its friction over preload, oil pressure and inertia.

    python scripts/figures.py car

    Prints the tables of docs/car.md and draws its figures. At each speed the crankshaft's ripple is that of a
    four-cylinder engine (`crankshaft_ripple`). Every run takes its metrics over whole engine cycles, two revolutions of
    the crankshaft.
    """
    drives = [drive_at_speed(rpm) for rpm in SPEEDS]
    drives += [
        changed_drive(drive_at_speed(rpm), key, value)
        for key, values, _ in CHANGES.values()
        for rpm in AT
        for value in values
    ]
    channels = ("position", "tension", "sprocket_angle", "tensioner_force")
    record = Record(variants=range(len(SPEEDS)), rate=1e4, channels=channels)
    run = simulate(drives, record=record, progress=True)
    rows = run.metrics.to_pylist()
    sweep, (over, panels) = rows[: len(SPEEDS)], panel_grid(4, 4, 3.0, 3.6)
    yield from sweep_table(run, sweep)
    yield ""
    yield from orders_table(run)
    yield ""
    no_mass = {f"valves.{name}.mass": 0.0 for name in ("intake valves", "exhaust valves")}
    third = {"chain.stiffness": drives[0].chain.stiffness / 3.0}
    light, soft = (
        simulate([drive.with_values(values) for drive in drives[: len(SPEEDS)]], record=record, progress=True)
        for values in (no_mass, third)
    )
    yield from published_table(run, sweep, light, soft)
    yield ""
    yield from friction_trends(iter(rows[len(SPEEDS) :]), panels)
    worst = max(abs(row["energy_residual_relative"]) for row in rows)
    yield f"{len(rows)} runs, {int(run.ok.sum())} ok, largest energy residual {worst:.1e}"
    yield {"car-speed": sweep_figure(run, sweep), "car-trends": over}


def engines() -> ValidationRow:
    """Timing chains of engines: largest link load, and how far the camshafts lag, over speed."""
    record = Record(rate=1e4, channels=("sprocket_angle",))
    run = simulate([drive_at_speed(rpm) for rpm in range(1000, 6001, 1000)], record=record)
    largest = [row["tension_max"] for row in run.metrics.to_pylist()]
    lags = [(part, np.degrees(phase_error(part, s))) for part in run.values() for s in (1, 2)]
    torsion = [np.ptp(lag[second_half_frames(part)]) for part, lag in lags]
    sizes = np.max([crankshaft_order_amplitudes(part, lag, ORDERS) for part, lag in lags], axis=0)
    orders = ", ".join(f"{order}: {size:.3f}" for order, size in zip(ORDERS, sizes, strict=True))
    return ValidationRow(
        "timing chains of three engines",
        gives=f"{min(largest):.0f} to {max(largest):.0f} N; camshafts swing by {min(torsion):.2f} to "
        f"{max(torsion):.2f} degrees; largest amplitudes of orders {orders} degrees",
    )
