"""Guides and tensioners."""

import argparse
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import ROOT, Line, case, table_head
from common.drives import example_drive
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tqdm import tqdm

from warpchain import Drive, Record, Run, load_drive, loads_drive, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.drive.examples import drive_path
from warpchain.drive.viscosity import walther_from_slope
from warpchain.engine.tensioner_bench import PlungerMotion, shake_tensioner
from warpchain.model import Model
from warpchain.model.oil import static_force, static_pressure, valve_flow
from warpchain.results.outlines import DrivePose, guide_arm_tensioner_parts, teeth_parts, turn_points
from warpchain.results.run import require_channels
from warpchain.results.strand_passing import strand_displacement
from warpchain.view.figures.drive_figure import draw_parts
from warpchain.view.figures.rig_figures import tensioner_loop_figure, tensioner_sweep_figure

STRAND = 2  # camshaft -> crankshaft: the tight one, "segment number one" of the paper
START, DURATION = 8.0, 14.0  # s
RAMPS = ("sprockets.crankshaft.prescribed.ramp_time", "sprockets.camshaft.load.ramp_time")
SLOWLY = {"run.duration": DURATION} | dict.fromkeys(RAMPS, 6.0)


def indented_bar_drive(drive: Drive, strand: int, indentation: float) -> Drive:
    """The drive with its bar's face where it presses the strand in by `indentation` [m], both ends alike."""
    path, (bar,) = chain_path(Model(drive).chain), drive.guides
    t = path.strand_end[strand] - path.strand_start[strand]
    t /= np.hypot(*t)
    n = np.array([-t[1], t[0]])
    values = {}
    for key, point in (("start", bar.start), ("end", bar.end)):
        along = (np.array(point) - path.strand_start[strand]) @ t
        face = path.strand_start[strand] + along * t + (indentation - drive.chain.roller_radius) * n
        values[f"guides.{bar.name}.{key}"] = [float(x) for x in face]
    return drive.with_values(values)


def strand_displacement_mm(run: Run) -> NDArray[np.float64]:
    """The strand's mid-span displacement from START on [mm], left of travel positive."""
    return 1e3 * strand_displacement(run[0], STRAND)[run[0].time >= START]


@case()
def guide_bar(asked: argparse.Namespace) -> Iterator[Line]:
    """The paper's Figures 9 and 10 side by side: the tight strand of the marine drive without guide-bar, and with it.

    python scripts/figures.py guide-bar

    As in the paper, the bar presses the strand in by the mean of the displacement that it has without the bar. The bar
    is the one of marine.toml, moved along its normal; it stands outside the loop and presses to the left of travel.
    Speed and load come on within 6 s, so that little is left of the swing of the start: joint friction takes a constant
    amount off it a cycle. Shown and averaged are the 6 s from 8 s on.
    """
    record, window = Record(channels=("position", "guide_force"), rate=1000.0), (START, DURATION)
    free = simulate(example_drive("marine_no_guides", SLOWLY), record=record, window=window)
    mean = float(strand_displacement_mm(free).mean())
    guided = simulate(
        indented_bar_drive(example_drive("marine", SLOWLY), STRAND, 1e-3 * mean), record=record, window=window
    )
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    titles = ("without guide-bar (Figure 9)", f"guide-bar indented by {mean:.1f} mm (Figure 10)")
    yield ("", "mean [mm]", "rms about it", "least", "most", "tension [N]", "largest", "largest on a roller [N]")
    for axis, run, title in zip(axes, (free, guided), titles, strict=True):
        values, force, (row,) = strand_displacement_mm(run), run[0].guide_force, run.metrics.to_pylist()
        assert force is not None
        tension = (row[f"{run[0].drive.strand_names[STRAND]}.tension_{part}"] for part in ("mean", "max"))
        yield (title, values.mean(), values.std(), values.min(), values.max(), *tension, float(force.max(initial=0.0)))
        axis.plot(run[0].time[run[0].time >= START], values, lw=0.8)
        axis.axhline(values.mean(), color="black", lw=0.9, ls="--", label=f"mean {values.mean():+.1f} mm")
        if run is guided:
            axis.axhline(mean, color="tab:brown", lw=1.5, label="roller on the bar's face")
        axis.set(title=title, xlabel="time [s]")
        axis.grid(alpha=0.3)
        axis.legend(loc="lower right" if run is free else "center right", fontsize=9)
    axes[0].set_ylabel("displacement at mid-span [mm]\n(left of travel +)")
    yield {"guide-bar": figure}


def drive_text_of_document(page: str) -> str:
    """The parts of a drive file that stand in a document."""
    found = re.search(r"```toml\n(\[(?:chain|\[tensioners)\].*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    assert found is not None
    return found.group(1)


def draw_guides(axes: Any, drive: Drive) -> None:
    """The drive as drawn, rollers' centers over the faces, joints of these, and arms at both stops."""
    model, centers = Model(drive).chain, np.array([sprocket.center for sprocket in drive.sprockets])
    pose = DrivePose(centers, np.zeros(len(centers)), np.zeros(len(drive.arms)))
    draw_parts(axes, model, pose, [*teeth_parts(model, pose), *guide_arm_tensioner_parts(model, pose)], 1.0)
    for g in range(len(drive.guides)):
        profile, a = model.profile(g), model.arm_of(g)
        face, centers = profile.points(5e-4), profile.offset_points(model.guide_offset(g), 5e-4)
        if a is not None:
            for stop in drive.arms[a].stops_rad:
                axes.plot(*turn_points(face, drive.arms[a].pivot, stop).T, color="tab:brown", alpha=0.4, linewidth=1.0)
        axes.plot(*centers.T, color="tab:orange", linewidth=0.8, linestyle="--")
        joints = np.array([piece.start for piece in (*profile.face, profile.pieces[-1])])
        axes.plot(*joints.T, "k.", markersize=4)


@case()
def guide_profiles(asked: argparse.Namespace) -> Iterator[Line]:
    """The drive of docs/guides-and-tensioners.md: faces, rollers' centers over them, its arm at both stops.

    python scripts/figures.py guide-profiles
    """
    figure = Figure(figsize=(5.0, 7.0), layout="constrained")
    axes = figure.subplots()
    draw_guides(axes, loads_drive(drive_text_of_document("guides-and-tensioners.md")))
    axes.margins(0.06)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    yield {"guide-profiles": figure}


AMPLITUDE, CYCLES = 2e-4, 10
FREQUENCIES = (50.0, 100.0, 200.0)
MICRO, DEGREES, SQUARE_MM = "\N{MICRO SIGN}m", "\N{DEGREE SIGN}C", "mm\N{SUPERSCRIPT TWO}/s"
SHAKEN = "\N{PLUS-MINUS SIGN}0.2 mm"
OIL = walther_from_slope(8e-5)
"""Of the tensioner: 80 mm^2/s at 40 degrees C."""
TRENDS = {
    f"gap [{MICRO}]": ("plunger.gap", np.linspace(20.0, 100.0, 17), lambda x: 1e-6 * x),
    f"oil temperature [{DEGREES}]": ("oil.viscosity", np.linspace(20.0, 140.0, 13), OIL.viscosity),
    "air at ambient pressure [%]": ("oil.air", np.linspace(0.0, 10.0, 11), lambda x: 1e-2 * x),
}
"""Label of each change, the key, its values, and the key's value."""


def tensioner_rides(drive: Drive, frequencies: Any, samples: bool = False, oil: float | None = None) -> Any:
    """Rides of the tensioner at frequencies [Hz]."""
    shakes = [PlungerMotion(AMPLITUDE, frequency, viscosity=oil) for frequency in frequencies]
    return shake_tensioner(drive, drive.tensioners[-1].name, shakes, CYCLES, samples)


def tensioner_trends(drive: Drive, figure: Figure) -> Iterator[Line]:
    """Rows and curves of the largest damping force and the work of a cycle over gap, temperature and air."""
    axes: Any = figure.subplots(2, 3, sharex="col", sharey="row")
    yield ("changed", "from", "to", "Hz", "force [N]", "falls all the way", "largest work [J]", "at")
    for (label, (key, values, given)), (upper, lower) in zip(tqdm(TRENDS.items()), axes.T, strict=True):
        forces, works = np.empty((2, len(values), len(FREQUENCIES)))
        for i, value in enumerate(values):
            changed = drive.with_values({f"tensioners.{drive.tensioners[-1].name}.{key}": float(given(value))})
            rides = tensioner_rides(changed, FREQUENCIES).rides
            forces[i] = np.asarray(rides["force_max"]) - static_force(changed.tensioners[-1])
            works[i] = np.asarray(rides["work"])
        for frequency, force, work in zip(FREQUENCIES, forces.T, works.T, strict=True):
            upper.plot(values, force, label=f"{frequency:g} Hz")
            lower.plot(values, work)
            ends, falls = f"{force[0]:.0f} to {force[-1]:.0f}", bool((np.diff(force) < 0.0).all())
            yield (label, values[0], values[-1], frequency, ends, falls, work.max(), values[work.argmax()])
        lower.set_xlabel(label)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("largest force above that at rest [N]")
    axes[1, 0].set_ylabel("work on the plunger [J/cycle]")
    axes[0, 0].legend(fontsize=9)


@case()
def tensioner(asked: argparse.Namespace) -> Iterator[Line]:
    """A hydraulic tensioner on its rig: loops, sweeps over frequency and temperature, published trends.

    python scripts/figures.py tensioner

    The tensioner is the one of docs/tensioners.md, on the slider of the example drive `engine`. Feng, Yang and Wang
    (Chin. J. Mech. Eng. 36, 2023) find that the largest damping force rises as the gap shrinks and falls with the oil's
    temperature and air; the last figure has that force, above the one at rest, and the work of a cycle.
    """
    drive = loads_drive(drive_path("engine").read_text() + drive_text_of_document("tensioners.md"))
    part = drive.tensioners[-1]
    rest = static_pressure(part)
    yield f"at rest {1e-5 * rest:.4f} bar, {static_force(part):.2f} N; leaks {1e9 * valve_flow(part, rest):.1f} mm^3/s"
    assert part.valve is not None
    yield ("lift [mm]", "curtain, of the hole", "effective [mm^2]", "with the hole [mm^2]")
    for lift in (1e-5, 1e-4, 2e-4, 1e-3):
        curtain, hole = part.valve.flow_area(lift), part.valve.hole_area
        flow = part.valve.discharge * curtain
        yield (1e3 * lift, curtain / hole, 1e6 * flow, float(1e6 * flow * hole / np.hypot(flow, hole)))
    loops = {f"{frequency:g} Hz": frequency for frequency in (10.0, 100.0, 400.0)}
    done = tensioner_rides(drive, loops.values(), samples=True)
    yield "the last cycles"
    yield table_head(
        "Hz | force [N] |  | pressure [Pa] |  | work [J] | leak [J] | valve [J] | supply [J] | leaked [m^3]"
    )
    columns = ("frequency", "force_min", "force_max", "pressure_min", "pressure_max", "work", "leak_loss")
    for row in done.rides.to_pylist():
        yield tuple(row[name] for name in (*columns, "valve_loss", "supply_work", "leaked"))
    x = np.geomspace(1.0, 500.0, 25).tolist()
    oils = {t: OIL.viscosity(t) for t in (40.0, 80.0, 120.0)}
    rides = {
        f"{t:g} {DEGREES}: {1e6 * oil:.3g} {SQUARE_MM}": tensioner_rides(drive, x, oil=oil).rides
        for t, oil in oils.items()
    }
    over = Figure(figsize=(12.0, 6.4), layout="constrained")
    yield from tensioner_trends(drive, over)
    yield {
        "tensioner-loops": tensioner_loop_figure(
            dict(zip(loops, done.samples, strict=True)), CYCLES, f"{SHAKEN}, 80 {SQUARE_MM}"
        ),
        "tensioner-frequency": tensioner_sweep_figure(rides, x, "frequency [Hz]", SHAKEN),
        "tensioner-trends": over,
    }


RANGES = {
    "diameter [mm]": ("plunger.diameter", np.linspace(13.0, 19.0, 13), 1e-3, (15.0, 17.0)),
    "gap [micrometers]": ("plunger.gap", np.linspace(35.0, 65.0, 13), 1e-6, (45.0, 55.0)),
    "length of the gap [mm]": ("plunger.length", np.linspace(4.0, 14.0, 11), 1e-3, (6.0, 10.0)),
}
"""Label of each size of the plunger, its key, its values, their unit, and its range."""


def damping_work_rows(figure: Figure) -> Iterator[Line]:
    """Rows and curves of the damping work of a cycle over the sizes of the plunger."""
    drive = loads_drive(drive_path("engine").read_text() + drive_text_of_document("tensioners.md"))
    axes: Any = figure.subplots(1, 3, sharey=True)
    yield ("size", "from", "to", "work [J]", "", "more of it")
    for (label, (key, values, unit, span)), axis in zip(RANGES.items(), axes, strict=True):
        path = f"tensioners.{drive.tensioners[-1].name}.{key}"
        changed = [drive.with_values({path: float(unit * value)}) for value in values]
        work = np.array([tensioner_rides(of, [100.0]).rides["work"][0].as_py() for of in changed])
        ends = np.interp(span, values, work)
        axis.plot(values, work, ".-")
        axis.axvspan(*span, alpha=0.15)
        more = f"+{100.0 * (ends.max() / ends.min() - 1.0):.0f} %"
        axis.set(xlabel=label, title=f"{more} from {span[0]:g} to {span[1]:g}")
        axis.grid(alpha=0.3)
        yield (label, *span, float(ends[0]), float(ends[1]), more)
    axes[0].set_ylabel("work on the plunger [J/cycle]")


SHARES = (0.0, 0.5, 1.0)
"""Shares of air in the chamber of `car` at the start."""


def drained_start_rows(figure: Figure) -> Iterator[Line]:
    """Rows and curves of `car` whose tensioner starts drained."""
    car = load_drive(drive_path("car"))
    drives = [car.with_values({"tensioners.tensioner.chamber.drained": share}) for share in SHARES]
    record = Record(rate=2e4, channels=("chamber_pressure", "tensioner_extension", "tension"))
    run = simulate(drives, duration=0.08, window=(0.0, 0.08), record=record, device="cpu")
    axes: Any = figure.subplots(3, 1, sharex=True)
    part = car.tensioners[0]
    assert part.oil is not None and part.chamber is not None
    still = 1e3 * part.chamber.volume / valve_flow(part, part.oil.ambient)
    yield ("drained", "filled after [ms]", "still [ms]", "largest tension [N]", "stroke [mm]", "peak [bar]")
    for k, (share, row) in enumerate(zip(SHARES, run.metrics.to_pylist(), strict=True)):
        pressure, extension, tension = require_channels(run[k], "chamber_pressure", "tensioner_extension", "tension")
        x, filled = extension[:, 0], row.get("tensioner.filling_time")
        panels = (1e-5 * pressure[:, 0], 1e3 * x, tension.max(axis=1))
        for axis, values in zip(axes, panels, strict=True):
            axis.plot(1e3 * run[k].time, values, lw=0.9, label=f"{100.0 * share:g} % air")
        times = ("-" if filled is None else 1e3 * filled, still * share)
        yield (share, *times, row["tension_max"], 1e3 * float(np.ptp(x)), 1e-5 * float(pressure[:, 0].max()))
    for axis, label in zip(axes, ("pressure [bar]", "extension [mm]", "largest tension [N]"), strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=9)
    axes[-1].set_xlabel("time [ms]")


@case()
def tensioner_start(asked: argparse.Namespace) -> Iterator[Line]:
    """Damping work of a tensioner over the sizes of its plunger, and `car` whose tensioner starts drained.

    python scripts/figures.py tensioner-start

    Sines of 0.2 mm at 100 Hz. Song (2015) found a damping energy 59.7 % larger within his ranges of these sizes.
    """
    work, start = (Figure(figsize=size, layout="constrained") for size in ((12.0, 4.0), (10.0, 8.0)))
    yield from damping_work_rows(work)
    yield from drained_start_rows(start)
    yield {"tensioner-work": work, "tensioner-start": start}
