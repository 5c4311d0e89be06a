"""Modes in the spectrum of a run-up."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import case, option
from matplotlib.figure import Figure
from numpy.typing import NDArray

from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.assembly import assembled_path
from warpchain.assembly.frequencies import orders
from warpchain.assembly.timestep import step_limit
from warpchain.drive.examples import drive_path
from warpchain.modal.campbell import Campbell
from warpchain.modal.phases import over_a_pitch
from warpchain.results.run import Trajectory
from warpchain.view.figures.style import arrowed

Array = NDArray[np.float64]

BAND = 0.1
"""Peaks are sought so far on both sides of a mode's frequency, relative."""
AROUND = np.arange(0.75, 1.25, 0.0005)
"""Frequencies, relative to a mode's, at which spectra are averaged."""
OUTSTANDING = 5.0
"""A peak's power over the median of those."""
PLACE = 0.37
"""Of a strand's length: where no low mode has a node."""
PADDED = 8
STEP = 0.5
"""Of the step's limit: strands are slow beside links and contacts."""


@dataclass(frozen=True)
class RunUp:
    """A run-up of an example drive, and the modes that are looked for.

    Attributes:
        name: of the example.
        duration: of the run-up [s].
        rate: of the samples [Hz].
        window: of a spectrum [s].
        wanted: names of the modes, among the `count` lowest.
        top: highest frequency drawn [Hz].
    """

    name: str
    duration: float
    rate: float
    window: float
    wanted: tuple[str, ...]
    count: int
    top: float


RUNS = (
    RunUp("industrial", 8.0, 1000.0, 1.0, ("conveyor->motor 1", "conveyor->motor 2"), 18, 60.0),
    RunUp("motorcycle", 8.0, 2000.0, 0.5, ("wheel->gearbox 1", "wheel->gearbox 2"), 20, 110.0),
    RunUp(
        "engine",
        4.0,
        5000.0,
        0.25,
        (
            "crankshaft->tensioner 1",
            "tensioner->exhaust cam 1",
            "exhaust cam->intake cam 1",
            "tensioner->exhaust cam 2",
            "idler->crankshaft 1",
        ),
        10,
        240.0,
    ),
)
PARTS = 4
"""Of the range of speeds, whose spectra are averaged."""
LEAST = 3
"""Windows, a quarter of their length apart."""
SLOWEST, SPEEDS, PHASES = 0.2, 5, 4
"""Of the top speed, where modes are sought first; at how many speeds and phases of a tooth pitch."""


@dataclass(frozen=True)
class Seen:
    """A mode in a part of a run-up: when and at what speed of the driver [rad/s] in the mean, its frequency and the
    peak's [Hz], and in how many windows."""

    mode: str
    time: float
    speed: float
    frequency: float
    peak: float
    windows: int

    @property
    def off(self) -> float:
        """How far the peak is from the mode, relative."""
        return self.peak / self.frequency - 1.0


def run_up_drive(run: RunUp) -> Drive:
    """The example as its modes take it, without dry friction and harmonics; it runs up steadily from rest."""
    drive = load_drive(drive_path(run.name))
    own: dict[str, Any] = {"chain.joint": None, "contact.sprocket.friction": 0.0}
    if drive.guides:
        own["contact.guide.friction"] = 0.0
    for sprocket in drive.sprockets:
        place = f"sprockets.{sprocket.name}"
        if sprocket.prescribed is not None:
            table = {"time": [0.0, run.duration], "speed": [0.0, sprocket.prescribed.top_speed]}
            own[f"{place}.prescribed"] = {"table": table}
        if sprocket.load is not None:
            own[f"{place}.load.harmonics"] = []
    smooth = drive.with_values({**own, "run.duration": run.duration, "run.sample_rate": run.rate})
    return smooth.with_values({"run.step": STEP * step_limit(smooth)})


def loaded(run: RunUp, drive: Drive) -> Drive:
    """The drive whose loads have what its sprockets' inertia takes while it runs up."""
    driver = drive.sprockets[drive.driver]
    assert driver.prescribed is not None
    rise = driver.prescribed.top_speed / run.duration
    own = {}
    for sprocket in drive.sprockets:
        if sprocket.prescribed is None:
            assert sprocket.inertia is not None
            torque = sprocket.load.torque if sprocket.load is not None else 0.0
            more = sprocket.inertia * rise * driver.teeth / sprocket.teeth
            own[f"sprockets.{sprocket.name}.load.torque"] = torque + more
    return drive.with_values(own)


def recorded(drive: Drive) -> Trajectory:
    """The run-up."""
    result = simulate(drive, record=Record(channels=("position", "sprocket_speed")))
    return result.trajectories[0]


def displacement(trajectory: Trajectory, strand: int) -> Array:
    """(F,) of the chain across a strand's chord, at `PLACE` of its length [m]."""
    path = assembled_path(trajectory.drive)
    start, end = np.asarray(path.strand_start[strand]), np.asarray(path.strand_end[strand])
    length = float(np.hypot(*(end - start)))
    tx, ty = (end - start) / length
    off = np.asarray(trajectory.position, float) - start
    along, across = off @ (tx, ty) - PLACE * length, off @ (-ty, tx)
    along = np.where(np.abs(across) < 3.0 * trajectory.drive.chain.pitch, along, np.nan)
    frame = np.arange(len(along))
    before = np.nanargmax(np.where(along <= 0.0, along, -np.inf), axis=1)
    after = np.nanargmin(np.where(along > 0.0, along, np.inf), axis=1)
    part = -along[frame, before] / (along[frame, after] - along[frame, before])
    return np.asarray(across[frame, before] * (1.0 - part) + across[frame, after] * part)


def signal_of(trajectory: Trajectory, mode: str) -> Array:
    """(F,) where a mode shows: across its strand [m], or in the speed of its sprocket [rad/s]."""
    drive, part = trajectory.drive, mode.rpartition(" ")[0]
    if part in drive.strand_names:
        return displacement(trajectory, drive.strand_names.index(part))
    assert trajectory.sprocket_speed is not None
    sprocket = [one.name for one in drive.sprockets].index(part)
    return np.asarray(trajectory.sprocket_speed[:, sprocket], float)


def spectrum(signal: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and power of a window, without its cubic trend."""
    time = np.linspace(-1.0, 1.0, len(signal))
    flat = signal - np.polynomial.Polynomial.fit(time, signal, 3)(time)
    power = np.abs(np.fft.rfft(flat * np.hanning(len(flat)), PADDED * len(flat))) ** 2
    return np.asarray(np.fft.rfftfreq(PADDED * len(flat), 1.0 / rate)), np.asarray(power)


def disturbed(drive: Drive, speeds: Array, frequency: float, width: float) -> bool:
    """Whether an order comes within a band and the spectrum's width of a frequency [Hz] while the speed changes."""
    low, high = (1.0 - BAND) * frequency - width, (1.0 + BAND) * frequency + width
    turns = speeds / (2.0 * np.pi)
    teeth = drive.sprockets[drive.driver].teeth
    values = {order.value for order in orders(drive) if order.value >= 0.5} | {0.5 * teeth}
    return any(value * turns.max() > low and value * turns.min() < high for value in values)


def running(run: RunUp, drive: Drive) -> Campbell:
    """The modes of a drive over the speeds of its run-up, means over a tooth pitch."""
    prescribed = drive.sprockets[drive.driver].prescribed
    assert prescribed is not None
    speeds = prescribed.top_speed * np.linspace(SLOWEST, 1.0, SPEEDS)
    return over_a_pitch(loaded(run, drive), speeds.tolist(), run.count, PHASES)[0]


def seen(run: RunUp, found: Campbell, trajectory: Trajectory, least: int = LEAST) -> Iterator[Seen]:
    """Modes in parts of a run-up, where they are seen: by the mean of the spectra of a part's windows (at least so
    many), each over the frequency relative to the mode's at the window's speed."""
    assert trajectory.sprocket_speed is not None
    size, drive = int(run.window * run.rate), found.drive
    speeds = np.abs(np.asarray(trajectory.sprocket_speed[:, drive.driver], float))
    first = int(np.argmax(speeds > found.speed[0]))
    begins = np.arange(first, len(speeds) - size, size // 4)
    ends = found.speed[0] + (found.speed[-1] - found.speed[0]) * np.linspace(0.0, 1.0, PARTS + 1)
    for name in run.wanted:
        signal, mode = signal_of(trajectory, name), found.frequency[:, found.names.index(name)]
        kept: list[list[tuple[float, float, float, Array]]] = [[] for _ in range(PARTS)]
        for begin in begins:
            part = slice(begin, begin + size)
            speed = float(speeds[part].mean())
            frequency = float(np.interp(speed, found.speed, mode))
            if frequency > 0.0 and not disturbed(drive, speeds[part], frequency, 1.0 / run.window):
                places, power = spectrum(signal[part], run.rate)
                row = np.interp(AROUND * frequency, places, power)
                where = min(int(np.searchsorted(ends, speed)) - 1, PARTS - 1)
                kept[max(where, 0)].append((float(trajectory.time[part].mean()), speed, frequency, row / row.sum()))
        for rows in (rows for rows in kept if len(rows) >= least):
            power = np.mean([row for *_, row in rows], axis=0)
            peak = int(np.argmax(np.where(np.abs(AROUND - 1.0) < BAND, power, 0.0)))
            if power[peak] >= power[[peak - 1, peak + 1]].max() and power[peak] > OUTSTANDING * np.median(power):
                time, speed, frequency = (float(np.mean([row[k] for row in rows])) for k in range(3))
                yield Seen(name, time, speed, frequency, float(AROUND[peak]) * frequency, len(rows))


def draw(axis: Any, run: RunUp, trajectory: Trajectory, modes: Campbell, found: list[Seen]) -> None:
    """The spectrum of all signals over time, the modes' frequencies, and the peaks."""
    size = int(run.window * run.rate)
    rows = range(0, len(trajectory.time) - size, size // 8)
    total: Any = 0.0
    for name in run.wanted:
        signal = signal_of(trajectory, name)
        power = np.array([spectrum(signal[k : k + size], run.rate)[1] for k in rows])
        total = total + power / np.percentile(power, 99.9)
    places = np.fft.rfftfreq(PADDED * size, 1.0 / run.rate)
    shown = places < run.top
    times = [float(trajectory.time[k : k + size].mean()) for k in rows]
    image = 10.0 * np.log10(total[:, shown].T + 1e-12)
    axis.pcolormesh(times, places[shown], image, cmap="Greys", vmin=-50.0, vmax=5.0, rasterized=True)
    for k, name in enumerate(run.wanted):
        mine = [one for one in found if one.mode == name]
        color = f"C{k}"
        line = modes.frequency[:, modes.names.index(name)]
        axis.plot(run.duration * modes.speed / modes.speed[-1], line, "-", color=color, lw=1.0)
        peaks = [one.peak for one in mine]
        axis.plot([one.time for one in mine], peaks, "o", color=color, ms=5.0, mew=1.4, mfc="none", label=arrowed(name))
    axis.set_ylim(0.0, run.top)
    axis.set_title(f"{run.name}, to {modes.speed[-1]:.3g} rad/s", fontsize=10)
    axis.set_xlabel("time [s]")
    axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)


@case(option("folder", nargs="?", type=Path, help="where to save the figure; default: nowhere"))
def runup(asked: argparse.Namespace) -> None:
    """The spectrum of a slow run-up against the modes of the running drive.

    python scripts/figures.py runup [docs/images]

    Three example drives, without dry friction and harmonics (which modes leave out), run up steadily to their speed.
    What hits the chain at every tooth rings all modes; their frequencies stand in the spectrum beside the orders. For
    each part of the range of speeds the highest peak near each mode is told, of the mean of its windows' spectra. The
    modes are those of the drive at that speed, means over a tooth pitch, with what the sprockets' inertia takes in the
    run-up as load. Left out are windows in which an order passes by (the peak is then the order's), and parts in which
    no peak stands out. Writes modes-runup.png.
    """
    folder = asked.folder
    figure = Figure(figsize=(14.0, 5.6), layout="constrained")
    print(f"{'drive':<12}{'mode':<28}{'parts':>7}{'Hz':>16}{'mean off':>10}{'most off':>10}")
    for axis, run in zip(figure.subplots(1, len(RUNS)), RUNS, strict=True):
        drive = run_up_drive(run)
        trajectory = recorded(drive)
        modes = running(run, drive)
        found = list(seen(run, modes, trajectory))
        for name in run.wanted:
            mine = [one for one in found if one.mode == name]
            if mine:
                off = np.array([one.off for one in mine])
                span = f"{min(one.frequency for one in mine):.4g} to {max(one.frequency for one in mine):.4g}"
                worst = off[np.argmax(np.abs(off))]
                print(f"{run.name:<12}{name:<28}{len(mine):>7}{span:>16}{off.mean():>10.2%}{worst:>10.2%}")
        draw(axis, run, trajectory, modes, found)
        figure.axes[0].set_ylabel("frequency [Hz]")
    figure.suptitle("Spectra of run-ups: modes of the running drive (lines) and peaks (circles)", fontsize=11)
    if folder is not None:
        figure.savefig(folder / "modes-runup.png", dpi=80)
        print(folder / "modes-runup.png")
