"""The cage of the example `derailleur` when the rear axle moves, and its free swing with the chain on."""

import argparse
import math
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case, table_head
from common.drives import example_drive
from matplotlib.figure import Figure
from scipy.optimize import fsolve
from scipy.signal import find_peaks

import warpchain
from warpchain import Drive, Record, assemble, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.model import Model
from warpchain.results.outlines import chain_outline, pose_at_start
from warpchain.results.run import Trajectory

PIVOT = (-0.02, 0.114)
"""Of the lower link that carries the rear axle [m], on the idler's axle (published as `link_lwr_front_loc`)."""
RISE, TIME, BEGIN, END = 0.036, 0.036, 0.1, 0.7  # of the axle [m], in [s], from [s]; of the run [s]
LOWER_LINK = (PIVOT, (-0.385, 0.010))
ROCKER = ((0.025, 0.216), (-0.023, 0.229))
"""Front and rear ends of the lower link and the rocker [m] (published as `link_lwr_*`, `rocker_mid_loc` and
`rocker_rear_loc`): four bars with the frame and with the stay between their rear ends, which carries the axle."""
LATE = 0.05
"""Spell at the end of the run [s], in which the cage is at rest again."""
PATHS = {
    "about the idler": PIVOT,
    "30 mm above it": (PIVOT[0], PIVOT[1] + 0.03),
    "30 mm below it": (PIVOT[0], PIVOT[1] - 0.03),
    "30 mm before it": (PIVOT[0] + 0.03, PIVOT[1]),
    "30 mm behind it": (PIVOT[0] - 0.03, PIVOT[1]),
    "about the crank": (-0.004, 0.0),
    "straight up": None,
    "by the linkage": "linkage",
}
"""Where the rear end turns about while its axle rises [m]; None turns nowhere, "linkage" as four bars lead it."""
CASES = ((0.0, 1.0), (0.05, 1.0), (0.1, 1.0), (0.2, 1.0), (0.1, 0.0), (0.1, 2.0))
"""Friction in the joints, and the cage's damper over that of the example."""
COG, JOCKEYS = 3, ("sprockets.lower jockey.center", "sprockets.upper jockey.center")


Point = tuple[float, float]
Path = Point | str | None


def linkage_displacement(place: Point, cog: Point, rise: float) -> Point:
    """Displacement of a place of the stay [m] where the axle, at the cog, is higher by so much [m]."""
    if rise == 0.0:
        return 0.0, 0.0
    front, rear = (complex(*end) for end in LOWER_LINK)
    mid, end = (complex(*end) for end in ROCKER)

    def moved_place(point: complex, angles: np.ndarray) -> complex:
        """Place [m] of a point of the stay with the links turned by angles [rad]."""
        lower, stay = np.exp(1j * angles)
        return complex(front + lower * (rear - front) + stay * (point - rear))

    def linkage_errors(angles: np.ndarray) -> tuple[float, float]:
        """Errors of the rocker's length and of the cog's height [m]."""
        rocker, axle = moved_place(end, angles) - mid, moved_place(complex(*cog), angles)
        return abs(rocker) - abs(end - mid), axle.imag - cog[1] - rise

    angles = fsolve(linkage_errors, np.zeros(2), xtol=1e-12)
    moved = moved_place(complex(*place), angles) - complex(*place)
    return moved.real, moved.imag


def axle_table(place: Point, cog: Point, about: Path) -> dict[str, list[float]]:
    """The way of a place of the rear end until its axle, at the cog, is `RISE` higher, as a table: half a wave of a
    cosine, on a path of `PATHS`."""
    time = np.linspace(0.0, TIME, 37)
    part = 0.5 * (1.0 - np.cos(math.pi * time / TIME))
    if about is None:
        x, y = 0.0 * part, RISE * part
    elif isinstance(about, str):
        x, y = np.array([linkage_displacement(place, cog, RISE * share) for share in part]).T
    else:
        dx, dy = np.subtract(cog, about)
        radius = math.hypot(dx, dy)
        angle = part * (math.asin(dy / radius) - math.asin((dy + RISE) / radius))
        dx, dy = np.subtract(place, about)
        c, s = np.cos(angle) - 1.0, np.sin(angle)
        x, y = c * dx - s * dy, s * dx + c * dy
    return {"time": (BEGIN + time).tolist(), "x": x.tolist(), "y": y.tolist()}


def hit_drive(drive: Drive, about: Path = PIVOT) -> Drive:
    """The drive with its crank held and its cog free, whose rear end turns until its axle is `RISE` higher."""
    cog, pivot = drive.sprockets[COG].center, drive.arms[0].pivot
    return drive.with_values(
        {
            "sprockets.chainring.prescribed": {"speed": 0.0},
            "sprockets.cog.load": None,
            "sprockets.cog.mount": {"kind": "prescribed", "table": axle_table(cog, cog, about)},
            "arms.cage.pivot_table": axle_table(pivot, cog, about),
            "run.duration": END,
        }
    )


def cage_swings(run: Trajectory) -> tuple[np.ndarray, np.ndarray, float]:
    """Instants and heights of the cage's swings over where it comes to rest [s, deg], and that angle [deg]."""
    angle = np.degrees(np.asarray(run.arm_angle)[:, 0])
    after = run.time > BEGIN + TIME + 0.02
    level = float(angle[after].min())
    peaks, _ = find_peaks(angle[after], distance=120, prominence=0.03)
    time, height = run.time[after][peaks], angle[after][peaks] - level
    late = slice(int(height.argmax()), None)
    return time[late], height[late], level


def twitch_rate(run: Trajectory) -> str:
    """Rate at which the cage gives chain, once at each half swing of a strand [Hz], while none is too small."""
    angle = np.degrees(np.asarray(run.arm_angle)[:, 0])
    after = run.time > BEGIN + TIME + 0.02
    peaks, _ = find_peaks(angle[after], prominence=0.03)
    gaps = np.diff(run.time[after][peaks])
    gaps = gaps[: int(np.append(gaps > 1.5 * gaps.min(initial=np.inf), True).argmax())]
    return f"{1.0 / gaps.mean():.1f}" if len(gaps) > 1 else "-"


def drive_after_move(drive: Drive, about: Path = PIVOT) -> Drive:
    """The derailleur's drive after its axle has moved."""
    cog, places = drive.sprockets[COG].center, {}
    for keys in (("sprockets.cog.center",), ("arms.cage.pivot", "arms.cage.center", *JOCKEYS)):  # as their first
        way = axle_table(drive.get_value(keys[0]), cog, about)
        for key in keys:
            x, y = drive.get_value(key)
            places[key] = [x + way["x"][-1], y + way["y"][-1]]
    return drive.with_values(places)


def cage_figure(drive: Drive, runs: list[Trajectory]) -> Figure:
    """The drive before and after, the cage's angle, and the tension of the lower strand."""
    figure = Figure(figsize=(10.0, 9.0), layout="constrained")
    where, cage, lower = figure.subplots(3, 1, height_ratios=(1.3, 1.0, 1.0))
    for one, color, label in ((drive, "0.5", "before"), (drive_after_move(drive), "tab:orange", "axle 36 mm higher")):
        model = Model(one).chain
        pose = pose_at_start(model)
        where.plot(*(1e3 * chain_outline(model, chain_path(model)).T), color=color, label=label)
        for s in model.sprockets_on(0):
            where.plot(*(1e3 * np.array([one.arms[0].pivot, pose.center[s]]).T), "o-", color=color, ms=3)
    where.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    where.legend(fontsize=8)
    laid = assemble(drive)
    links = slice(laid.strand_first[0], laid.strand_first[0] + laid.strand_links[0])
    for (mu, damper), run in zip(CASES, runs, strict=True):
        if damper != 1.0:
            continue
        cage.plot(1e3 * run.time, np.degrees(np.asarray(run.arm_angle)[:, 0]), lw=1.0, label=f"{mu:g}")
        lower.plot(1e3 * run.time, np.asarray(run.tension)[:, links].mean(axis=1), lw=0.8)
    for axes, label in ((cage, "cage [deg]"), (lower, "mean tension, chainring\nto lower jockey [N]")):
        axes.axvspan(1e3 * BEGIN, 1e3 * (BEGIN + TIME), color="0.9")
        axes.set(xlabel="time [ms]", ylabel=label, xlim=(60.0, 1e3 * END))
    lower.set_ylim(25.0, 65.0)
    cage.legend(title="friction in the joints", fontsize=8)
    return figure


def path_table(drive: Drive) -> Iterator[Line]:
    """A table of the cage's motion by the path of the axle."""
    result = simulate(
        [hit_drive(drive, about) for about in PATHS.values()], record=Record(rate=2000.0), window=(0.08, 0.68)
    )
    yield table_head(
        "the rear end turns | back [mm] | before [deg] | largest [deg] | least [deg] | after [deg] | twitches [Hz] | "
        "most [N]"
    )
    for v, (name, about) in enumerate(PATHS.items()):
        run, cog = result[v], drive.sprockets[COG].center
        angle, tension = np.degrees(np.asarray(run.arm_angle)[:, 0]), np.asarray(run.tension)
        seen, late = run.time > BEGIN, run.time > END - LATE
        before, back = angle[~seen][-1], 0.0 - 1e3 * axle_table(cog, cog, about)["x"][-1]
        numbers = before, angle[seen].max(), angle[seen].min(), angle[late].mean()
        most = tension[run.time > BEGIN - 0.02].max()
        yield (name, f"{back:.1f}", *(f"{x:.2f}" for x in numbers), twitch_rate(run), f"{most:.0f}")


@case()
def derailleur(asked: argparse.Namespace) -> Iterator[Line]:
    """The rear axle of the example `derailleur` rises by 36 mm in 36 ms, crank held: what its cage does.

    python scripts/figures.py derailleur

    Prints the table of docs/derailleur.md and draws its figure.
    """
    drive = example_drive("derailleur")
    yield from path_table(drive)
    damping = drive.arms[0].damping
    drives = [
        hit_drive(drive).with_values({"chain.joint.friction": mu, "arms.cage.damping": part * damping})
        for mu, part in CASES
    ]
    drives[0] = drives[0].with_values({"contact.sprocket.friction": 0.0})
    result = simulate(drives, record=Record(rate=2000.0), window=(BEGIN - 0.02, END - 0.02))
    runs, rows = [result[v] for v in range(len(drives))], result.metrics.to_pylist()
    modes = warpchain.modes(hit_drive(drive))
    for k in range(2):
        yield f"mode {k + 1} at rest, linear, without friction: {modes.frequency[k]:.2f} Hz"
    yield table_head(
        "friction | damper | before [deg] | largest [deg] | at [ms] | after [deg] | twitches [Hz] | swing [Hz] | "
        "decay [1/s] | most [N]"
    )
    for (mu, part), run in zip(CASES, runs, strict=True):
        time, height, level = cage_swings(run)
        angle, tension = np.degrees(np.asarray(run.arm_angle)[:, 0]), np.asarray(run.tension)
        before = angle[np.searchsorted(run.time, BEGIN) - 1]
        top, found = angle.argmax(), [twitch_rate(run), "-", "-"]
        if len(time) > 2:
            frequency, decay = 1.0 / np.diff(time).mean(), -np.polyfit(time, np.log(height), 1)[0]
            found[1:] = f"{frequency:.1f}", f"{decay:.1f}"
        numbers = f"{before:.2f}", f"{angle[top]:.2f}", f"{1e3 * (run.time[top] - BEGIN):.0f}", f"{level:.2f}"
        yield (f"{mu:g}", f"{part:g}", *numbers, *found, f"{tension[run.time > BEGIN - 0.02].max():.0f}")
    worst = max(abs(row["energy_residual_relative"]) for row in rows)
    work = [f"{row['cage.pivot_work']:.3f}" for row in rows]
    yield f"largest energy residual {worst:.1e}; work of what leads the cage's pivot {', '.join(work)} J"
    yield {"derailleur": cage_figure(drive, runs)}
