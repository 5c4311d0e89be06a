"""Modes of drives at rest, over speed, and in the spectrum of a run-up."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from common.cases import Line, case
from common.drives import Values, example_drive
from matplotlib.figure import Figure
from numpy.typing import NDArray

from warpchain import Drive, Record, simulate
from warpchain.assembly.assembly import assembled_path
from warpchain.assembly.frequencies import excitation_orders
from warpchain.assembly.timestep import step_limit
from warpchain.modal.campbell import Campbell, campbell, pitch_averaged_campbell
from warpchain.modal.eigenmodes import modes
from warpchain.modal.mode_figures import mode_campbell_figure, mode_shapes_figure
from warpchain.model import Model
from warpchain.results.run import Trajectory
from warpchain.results.signals import probe_signals
from warpchain.view.figures.figure_style import strand_label

Array = NDArray[np.float64]
CAR = ("intake cam->exhaust cam 1", "crank->intake cam 1", "intake cam 1", "arm 1")
"""Modes of `car` that are drawn, among its 30 lowest."""


@case()
def mode_shapes(asked: argparse.Namespace) -> Iterator[Line]:
    """Modes of the timing drives at rest, and over the crankshaft's speed of one.

    python scripts/figures.py mode-shapes

    Writes modes-engine.png, campbell-engine.png and modes-car.png.
    """
    found = campbell(example_drive("engine"), np.linspace(0.0, 600.0, 25).tolist(), 10)
    car = modes(example_drive("car"), 30)
    yield {
        "modes-engine": mode_shapes_figure(found.modes[0].first(8)),
        "campbell-engine": mode_campbell_figure(found),
        "modes-car": mode_shapes_figure(car.select_modes(np.array([car.names.index(name) for name in CAR]))),
    }


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
PARTS, LEAST = 4, 3
"""Parts of the range of speeds whose spectra are averaged, each of at least so many windows."""
SLOWEST, SPEEDS, PHASES = 0.2, 5, 4
"""Of the top speed, where modes are sought first; at so many speeds and phases of a tooth pitch."""


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


ENGINE = ("crankshaft->tensioner 1", "tensioner->exhaust cam 1", "exhaust cam->intake cam 1")
RUNS = (
    RunUp("industrial", 8.0, 1000.0, 1.0, ("conveyor->motor 1", "conveyor->motor 2"), 18, 60.0),
    RunUp("motorcycle", 8.0, 2000.0, 0.5, ("wheel->gearbox 1", "wheel->gearbox 2"), 20, 110.0),
    RunUp("engine", 4.0, 5000.0, 0.25, (*ENGINE, "tensioner->exhaust cam 2", "idler->crankshaft 1"), 10, 240.0),
)


class SeenMode(NamedTuple):
    """A mode in a part of a run-up: mean time and speed of the driver [rad/s], its frequency and the peak's [Hz]."""

    mode: str
    time: float
    speed: float
    frequency: float
    peak: float

    @property
    def off(self) -> float:
        """The peak's distance from the mode, relative."""
        return self.peak / self.frequency - 1.0


def run_up_drive(run: RunUp) -> Drive:
    """The example as its modes take it, without dry friction and harmonics; it runs up steadily from rest."""
    drive = example_drive(run.name)
    own: Values = {"chain.joint": None, "contact.sprocket.friction": 0.0, "run.duration": run.duration}
    own["run.sample_rate"] = run.rate
    if drive.guides:
        own["contact.guide.friction"] = 0.0
    for sprocket in drive.sprockets:
        place = f"sprockets.{sprocket.name}"
        if sprocket.prescribed is not None:
            table = {"time": [0.0, run.duration], "speed": [0.0, sprocket.prescribed.top_speed]}
            own[f"{place}.prescribed"] = {"table": table}
        if sprocket.load is not None:
            own[f"{place}.load.harmonics"] = []
    smooth = drive.with_values(own)
    return smooth.with_values({"run.step": STEP * step_limit(smooth)})


def run_up_loads(run: RunUp, drive: Drive) -> Drive:
    """A drive with loads that include the torque of its sprockets' inertia while it runs up."""
    driver = drive.sprockets[drive.driver]
    rise = top_speed(drive) / run.duration
    own = {}
    for sprocket in drive.sprockets:
        if sprocket.prescribed is None:
            torque = sprocket.load.torque if sprocket.load is not None else 0.0
            more = (sprocket.inertia or 0.0) * rise * driver.teeth / sprocket.teeth
            own[f"sprockets.{sprocket.name}.load.torque"] = torque + more
    return drive.with_values(own)


def top_speed(drive: Drive) -> float:
    """Top speed of the driver [rad/s]."""
    prescribed = drive.sprockets[drive.driver].prescribed
    assert prescribed is not None
    return prescribed.top_speed


def recorded_run_up(drive: Drive) -> Trajectory:
    """The recorded run of a run-up."""
    return simulate(drive, record=Record(channels=("position", "velocity", "tension", "sprocket_speed")))[0]


def mode_signal(trajectory: Any, mode: str) -> Array:
    """(F,) displacement of a mode's strand at `PLACE` of its length [m]."""
    drive, path = trajectory.drive, assembled_path(Model(trajectory.drive).chain)
    strand = drive.strand_names.index(mode.rpartition(" ")[0])
    x, y = (1.0 - PLACE) * path.strand_start[strand] + PLACE * path.strand_end[strand]
    return probe_signals(trajectory, (x, y), 3.0 * drive.chain.pitch).displacement


def window_spectrum(signal: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and power of a window, without its cubic trend."""
    time = np.linspace(-1.0, 1.0, len(signal))
    flat = signal - np.polynomial.Polynomial.fit(time, signal, 3)(time)
    power = np.abs(np.fft.rfft(flat * np.hanning(len(flat)), PADDED * len(flat))) ** 2
    return np.asarray(np.fft.rfftfreq(PADDED * len(flat), 1.0 / rate)), np.asarray(power)


def is_disturbed(drive: Drive, speeds: Array, frequency: float, width: float) -> bool:
    """Whether an order comes within a band and the spectrum's width of a frequency [Hz] while the speed changes."""
    low, high = (1.0 - BAND) * frequency - width, (1.0 + BAND) * frequency + width
    turns = speeds / (2.0 * np.pi)
    teeth = drive.sprockets[drive.driver].teeth
    values = {order.value for order in excitation_orders(drive) if order.value >= 0.5} | {0.5 * teeth}
    return any(value * turns.max() > low and value * turns.min() < high for value in values)


def running_modes(run: RunUp, drive: Drive) -> Campbell:
    """The modes of a drive over the speeds of its run-up, means over a tooth pitch."""
    speeds = top_speed(drive) * np.linspace(SLOWEST, 1.0, SPEEDS)
    return pitch_averaged_campbell(run_up_loads(run, drive), speeds.tolist(), run.count, PHASES)[0]


def seen_modes(run: RunUp, found: Campbell, trajectory: Any, least: int = LEAST) -> Iterator[SeenMode]:
    """Modes that show in parts of a run-up, in the mean of the spectra of a part's windows (at least so many).

    Spectra are over the frequency relative to the mode's at the window's speed.
    """
    size, drive = int(run.window * run.rate), found.drive
    speeds = np.abs(np.asarray(trajectory.sprocket_speed[:, drive.driver], float))
    first = int(np.argmax(speeds > found.speed[0]))
    begins = np.arange(first, len(speeds) - size, size // 4)
    ends = found.speed[0] + (found.speed[-1] - found.speed[0]) * np.linspace(0.0, 1.0, PARTS + 1)
    for name in run.wanted:
        signal, mode = mode_signal(trajectory, name), found.frequency[:, found.names.index(name)]
        kept: list[list[tuple[float, float, float, Array]]] = [[] for _ in range(PARTS)]
        for begin in begins:
            part = slice(begin, begin + size)
            speed = float(speeds[part].mean())
            frequency = float(np.interp(speed, found.speed, mode))
            if frequency > 0.0 and not is_disturbed(drive, speeds[part], frequency, 1.0 / run.window):
                places, power = window_spectrum(signal[part], run.rate)
                row = np.interp(AROUND * frequency, places, power)
                where = min(int(np.searchsorted(ends, speed)) - 1, PARTS - 1)
                kept[max(where, 0)].append((float(trajectory.time[part].mean()), speed, frequency, row / row.sum()))
        for rows in (rows for rows in kept if len(rows) >= least):
            power = np.mean([row for *_, row in rows], axis=0)
            peak = int(np.argmax(np.where(np.abs(AROUND - 1.0) < BAND, power, 0.0)))
            if power[peak] >= power[[peak - 1, peak + 1]].max() and power[peak] > OUTSTANDING * np.median(power):
                time, speed, frequency = (float(np.mean([row[k] for row in rows])) for k in range(3))
                yield SeenMode(name, time, speed, frequency, float(AROUND[peak]) * frequency)


def draw_run_up(axis: Any, run: RunUp, trajectory: Any, modes: Campbell, found: list[SeenMode]) -> None:
    """The spectrum of all signals over time, the modes' frequencies, and the peaks."""
    size = int(run.window * run.rate)
    rows = range(0, len(trajectory.time) - size, size // 8)
    total: Any = 0.0
    for name in run.wanted:
        signal = mode_signal(trajectory, name)
        power = np.array([window_spectrum(signal[k : k + size], run.rate)[1] for k in rows])
        total = total + power / np.percentile(power, 99.9)
    places = np.fft.rfftfreq(PADDED * size, 1.0 / run.rate)
    shown = places < run.top
    times = [float(trajectory.time[k : k + size].mean()) for k in rows]
    image = 10.0 * np.log10(total[:, shown].T + 1e-12)
    axis.pcolormesh(times, places[shown], image, cmap="Greys", vmin=-50.0, vmax=5.0, rasterized=True)
    for k, name in enumerate(run.wanted):
        line = modes.frequency[:, modes.names.index(name)]
        axis.plot(run.duration * modes.speed / modes.speed[-1], line, "-", color=f"C{k}", lw=1.0)
        mine = [(one.time, one.peak) for one in found if one.mode == name]
        circles: Any = {"color": f"C{k}", "ms": 5.0, "mew": 1.4, "mfc": "none", "label": strand_label(name)}
        axis.plot(*np.reshape(mine, (-1, 2)).T, "o", **circles)
    axis.set_title(f"{run.name}, to {modes.speed[-1]:.3g} rad/s", fontsize=10)
    axis.set(ylim=(0.0, run.top), xlabel="time [s]")
    axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)


@case()
def runup(asked: argparse.Namespace) -> Iterator[Line]:
    """The spectrum of a slow run-up against the modes of the running drive.

    python scripts/figures.py runup

    Three example drives, without dry friction and harmonics (which modes leave out), run up steadily to their speed.
    What hits the chain at every tooth rings all modes; their frequencies stand in the spectrum beside the orders. For
    each part of the range of speeds the highest peak near each mode is printed, of the mean of its windows' spectra.
    The modes are those of the drive at that speed, means over a tooth pitch, with what the sprockets' inertia takes in
    the run-up as load. Left out are windows in which an order passes by (the peak is then the order's), and parts in
    which no peak stands out. Writes modes-runup.png.
    """
    figure = Figure(figsize=(14.0, 5.6), layout="constrained")
    yield ("drive", "mode", "parts", "Hz", "mean off", "most off")
    for axis, run in zip(figure.subplots(1, len(RUNS)), RUNS, strict=True):
        drive = run_up_drive(run)
        trajectory, found_modes = recorded_run_up(drive), running_modes(run, drive)
        found = list(seen_modes(run, found_modes, trajectory))
        for name in run.wanted:
            mine = [one for one in found if one.mode == name]
            if mine:
                off = np.array([one.off for one in mine])
                frequencies = [one.frequency for one in mine]
                span = f"{min(frequencies):.4g} to {max(frequencies):.4g}"
                yield (run.name, name, len(mine), span, f"{off.mean():.2%}", f"{off[np.argmax(np.abs(off))]:.2%}")
        draw_run_up(axis, run, trajectory, found_modes, found)
    figure.axes[0].set_ylabel("frequency [Hz]")
    figure.suptitle("Spectra of run-ups: modes of the running drive (lines) and peaks (circles)", fontsize=11)
    yield {"modes-runup": figure}
