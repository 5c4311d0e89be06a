"""Vibration of a running strand: results of docs/validation.md."""

import math
from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from common.cases import Line
from common.drives import equal_sprocket_values, two_sprockets
from matplotlib.figure import Figure
from scipy.optimize import brentq

from drawings.closed_forms import ValidationRow
from drawings.modes import top_speed, window_spectrum
from warpchain import Drive, Record, simulate
from warpchain.assembly.frequencies import moving_frequency
from warpchain.modal.campbell import pitch_averaged_campbell
from warpchain.model import Model
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import strand_tension
from warpchain.results.strand_passing import strand_displacement

SEEN = Record(channels=("position", "tension", "sprocket_speed"))
TAUT = {
    "chain.stiffness": 1e7,
    "chain.damping": 200.0,
    "sprockets.driven.load.torque": 0.0,
    "sprockets.driven.inertia": 2e4,  # that does not swing along
    "run.step": "auto",
}
RUNNING, TRAVELS, PLUCKED = (40, 120), (0.0, 6.0, 12.0, 18.0, 24.0, 27.0, 30.0), {"run.gravity": [0.0, -0.2]}
"""Teeth and links, speeds of the driver [rad/s], and a little weight, which plucks straight strands as a run begins."""
QUIET = {"chain.damping": 5000.0}
"""Damping of the links with which they hardly ring [N s/m]: for the fastest run once more."""
MODES = (1, 3)
"""Of a strand, that a pluck over all of its length excites, and that its middle shows."""
RESONANT, NEAR, WEIGHTLESS = (20, 61), np.linspace(1.60, 2.00, 17), {"run.gravity": [0.0, 0.0]}
"""Teeth and links, and speeds of the driver at which the tooth frequency is near the strand's first."""
RUBBING = (0.01, 0.02, 0.03, 0.06)
"""Friction in the joints, which ends the growth of strands that the tooth frequency excites."""
FAST, SHORT, CALMING = TRAVELS[-3:], {"run.settle": False, "run.sample_rate": 2000.0, "run.duration": 6.0}, 0.03
"""Speeds of the driver [rad/s] at which strands are full of waves, runs that show these, and friction against them."""
BAND = 0.15
"""Of the string's frequency on both sides, in which peaks are sought."""
NOTABLE = 0.09
"""Power of a second peak over that of the highest, from which it is shown."""


def taut_drive(size: tuple[int, int], slack: float, values: dict[str, Any]) -> Drive:
    """Two equal sprockets, teeth and links of `size`, a little farther apart than the chain's straight strands [m]."""
    return two_sprockets(equal_sprocket_values(*size, 0.05, slack) | TAUT | values)


def running_drive(drive: Drive, speed: float) -> Drive:
    """The drive with another speed of its driver [rad/s]."""
    return drive.with_values({"sprockets.driver.prescribed.speed": float(speed)})


def strand_size(drive: Drive) -> tuple[float, float]:
    """Length of the strands between the tangent points [m], and speed of the chain [m/s]."""
    driver, driven = drive.sprockets
    speed = top_speed(drive) / math.tau * driver.teeth * drive.chain.pitch
    return float(driven.center[0] - driver.center[0]), speed


def string_frequency(drive: Drive, tension: float, mode: int = 1) -> float:
    """Frequency of a moving string between the tangent points [Hz], in closed form."""
    length, speed = strand_size(drive)
    return moving_frequency(Model(drive).chain, length, tension, speed, mode)


def mass_chain_frequency(drive: Drive, tension: float, mode: int) -> float:
    """Frequency of a moving chain of masses on strings [Hz], in closed form.

    Waves of w_0(k) = 2 sqrt(T/(m p)) sin(k p/2) travel with the chain and against it: w = w_0(k) + v k and w_0(k) - v
    k. As on the string, the phases of both add up to n turns over a strand: (k_1 + k_2) L = 2 pi n. At rest this is
    equation (b) of `warpchain.assembly.frequencies`.
    """
    (length, speed), chain = strand_size(drive), drive.chain
    rate = 2.0 * math.sqrt(tension / (chain.mass * chain.pitch))

    def frequency_against_travel(wave: float) -> float:
        """Angular frequency [rad/s] of a wave number [rad/m] against the chain's travel."""
        return rate * math.sin(0.5 * wave * chain.pitch) - speed * wave

    def frequency_difference(wave: float) -> float:
        """Angular frequency [rad/s] of the wave with the travel less that of the one against it."""
        other = math.tau * mode / length - wave
        return rate * math.sin(0.5 * other * chain.pitch) + speed * other - frequency_against_travel(wave)

    turns = math.pi * mode / length  # of both waves at rest; that against the chain has more as it travels
    return frequency_against_travel(brentq(frequency_difference, 0.9 * turns, 2.0 * turns)) / math.tau


class StrandPeaks(NamedTuple):
    """The peaks of a strand about a mode, and the closed forms at the run's mean tension.

    Attributes:
        share: v/c.
        string, masses: frequencies of the moving string and of the chain of masses [Hz].
        found: frequencies of the spectrum's peaks, the highest first [Hz].
        ringing: standard deviation of a link's tension over the mean less m v^2/p.
    """

    share: float
    string: float
    masses: float
    found: list[float]
    ringing: float


def strand_peaks(trajectory: Trajectory, strand: int, near: float) -> list[float]:
    """Frequencies of the peaks of a strand's displacement within `BAND` of another, the highest first [Hz]."""
    rate = 1.0 / float(np.diff(trajectory.time).mean())
    places, power = window_spectrum(strand_displacement(trajectory, strand), rate)
    inner = power[1:-1]
    tops = 1 + np.flatnonzero((inner > power[:-2]) & (inner > power[2:]) & (np.abs(places[1:-1] / near - 1.0) < BAND))
    tops = tops[np.argsort(-power[tops])]
    tops = tops[power[tops] > NOTABLE * power[tops[0]]]
    low, high = np.log(power[tops - 1] / power[tops]), np.log(power[tops + 1] / power[tops])
    return list(places[tops] + 0.5 * (low - high) / (low + high) * places[1])  # of the parabola through three


@cache
def running_peaks() -> dict[int, list[StrandPeaks]]:
    """Peaks of both strands for each mode and speed, and at the fastest once more with `QUIET`."""
    own = {"run.settle": False, "run.sample_rate": 400.0, "run.duration": 16.0}
    drive = taut_drive(RUNNING, 0.012, PLUCKED | own)
    drives = [running_drive(drive, speed) for speed in TRAVELS]
    drives.append(drives[-1].with_values(QUIET))
    found: dict[int, list[StrandPeaks]] = {mode: [] for mode in MODES}
    for one, trajectory in zip(drives, simulate(drives, device="cpu", record=SEEN).values(), strict=True):
        for strand, mode in product((0, 1), MODES):
            tensions = strand_tension(trajectory, strand)
            tension, speed = float(np.nanmean(tensions)), strand_size(one)[1]
            wave = math.sqrt(tension * one.chain.pitch / one.chain.mass)
            net = tension * (1.0 - (speed / wave) ** 2)
            exact, likely = string_frequency(one, tension, mode), mass_chain_frequency(one, tension, mode)
            tops = strand_peaks(trajectory, strand, likely)
            found[mode].append(StrandPeaks(speed / wave, exact, likely, tops, float(np.nanstd(tensions)) / net))
    return found


def strand_modes(drive: Drive, speeds: Any, mode: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A mode of the tight strand at each speed, the mean over a tooth pitch [Hz], and the tension that it has [N]."""
    diagram, _ = pitch_averaged_campbell(drive, [float(speed) for speed in speeds], 2 + 2 * mode)
    first, count = drive.sprockets[0].teeth // 2 + 8, (drive.chain.links - drive.sprockets[0].teeth) // 2 - 16
    tensions = [float(one.tension[first : first + count].mean()) for one in diagram.modes]
    return np.asarray(diagram.frequency[:, diagram.names.index(f"driver->driven {mode}")]), np.array(tensions)


def spread_text(values: Any) -> str:
    """Range of relative differences, as text in percent."""
    return f"{100.0 * min(values):+.1f} to {100.0 * max(values):+.1f} %"


def draw_running_modes(axis: Any, row: list[StrandPeaks], quiet: list[StrandPeaks], shown: Any, name: str) -> None:
    """Closed forms, modes and peaks of one mode over v/c."""
    share = [one.share for one in row]
    axis.plot(share[::2], [one.string for one in row[::2]], color="black", lw=1.0, label="moving string")
    axis.plot(share[::2], [one.masses for one in row[::2]], ":", color="black", lw=1.6, label="moving masses")
    axis.plot(share[::2], shown, "x", color="C1", ms=7, label="modes, at their lower tension")
    others = [(one.share, place) for one in row for place in one.found[1:]]
    axis.plot(*np.array(others).reshape(-1, 2).T, ".", color="C0", ms=4, label="second peaks of it")
    for some, color, label in ((row, "C0", "peak of the run's spectrum"), (quiet, "C2", "links damped more")):
        found = [one.found[0] for one in some]
        axis.plot([one.share for one in some], found, "o", color=color, ms=4, mfc="none", label=label)
    axis.set(xlabel="v / c", ylabel=f"{name} frequency of the strand [Hz]", ylim=(0.0, None))


def running_strand(axes: Any) -> Iterator[Line]:
    """The first and the third frequency of a strand over its speed."""
    drive, names = taut_drive(RUNNING, 0.012, PLUCKED), {1: "first", 3: "third"}
    for axis, (mode, found) in zip(axes, running_peaks().items(), strict=True):
        row, quiet = found[:-2], found[-2:]
        shown, tensions = strand_modes(drive, TRAVELS, mode)
        draw_running_modes(axis, row, quiet, shown, names[mode])
        at = [(running_drive(drive, speed), tension, mode) for speed, tension in zip(TRAVELS, tensions, strict=True)]
        own = {
            form: shown / np.array([form(*one) for one in at]) - 1.0
            for form in (string_frequency, mass_chain_frequency)
        }
        off = [[one.found[0] / one.masses - 1.0 for one in part] for part in (row[:-2], row[-2:], quiet)]
        late = [place / one.masses - 1.0 for one in row[-2:] for place in one.found[1:]]
        slow, fast, times = row[0], row[-2], mode if mode > 1 else ""
        yield ValidationRow(
            name=f"running strand, {names[mode]} mode",
            states=f"f_{mode} = {times}(c^2 - v^2)/(2 L c); at v/c of 0 to {fast.share:.2f}: {slow.string:.3f} to "
            f"{fast.string:.3f} Hz; as a chain of masses {slow.masses:.3f} to {fast.masses:.3f} Hz",
            gives=f"{slow.found[0]:.3f} to {fast.found[0]:.3f} Hz; `modes` {shown[0]:.3f} to {shown[-1]:.3f} Hz",
            differs=f"from the masses: up to v/c = {row[-3].share:.2f} {spread_text(off[0])}. At {fast.share:.2f} "
            f"{spread_text(off[1])}, second peaks {spread_text(late)}, with links damped more {spread_text(off[2])}. "
            f"`modes` at their own tension {spread_text(own[mass_chain_frequency])}, from the string "
            f"{spread_text(own[string_frequency])}",
        )


def strand_amplitude(trajectory: Trajectory, frequency: float) -> float:
    """Amplitude of the tight strand's displacement at a frequency [m], in the latter half."""
    part = trajectory.time > 0.5 * trajectory.time[-1]
    values, window = strand_displacement(trajectory, 0)[part], np.hanning(int(part.sum()))
    turned = np.exp(-2j * math.pi * frequency * trajectory.time[part])
    return float(2.0 * abs(np.sum((values - values.mean()) * window * turned)) / window.sum())


def list_text(values: Any, form: str) -> str:
    """Values with commas between."""
    return ", ".join(format(value, form) for value in values)


def drive_with_joint_friction(drive: Drive, friction: float) -> Drive:
    """The drive with friction in its joints."""
    return drive.with_values({"chain.joint": {"friction": friction, "pin_radius": 0.007}})


def coincidence_speed(frequencies: Any) -> float:
    """The speed near which the tooth frequency crosses these."""
    return float(np.interp(0.0, NEAR * RESONANT[0] / math.tau - np.asarray(frequencies), NEAR))


def resonance_speeds(axis: Any, drive: Drive, friction: float) -> tuple[float, float]:
    """The driver's speeds at which a strand swings most, and at which it would as a string [rad/s]."""
    drives = [running_drive(drive_with_joint_friction(drive, friction), speed) for speed in NEAR]
    runs = simulate(drives, device="cpu", record=SEEN).values()
    teeth = NEAR * RESONANT[0] / math.tau
    sizes = [strand_amplitude(run, f) for run, f in zip(runs, teeth, strict=True)]
    tensions = [float(np.nanmean(strand_tension(run, 0))) for run in runs]
    top = int(np.argmax(sizes))
    curve = np.polynomial.Polynomial.fit(NEAR[top - 2 : top + 3], sizes[top - 2 : top + 3], 2)
    axis.plot(NEAR, 1e3 * np.array(sizes), "o-", ms=4, lw=0.8, label=f"run, friction {friction:g}")
    strings = [string_frequency(one, tension) for one, tension in zip(drives, tensions, strict=True)]
    return float(curve.deriv().roots()[0]), coincidence_speed(strings)


def critical_speed(axis: Any) -> ValidationRow:
    """The driver's speed at which the tooth frequency excites a strand most."""
    own = {"run.settle": True, "run.sample_rate": 200.0, "run.duration": 12.0}
    drive = taut_drive(RESONANT, 0.006, WEIGHTLESS | own)
    found, strings = zip(*(resonance_speeds(axis, drive, friction) for friction in RUBBING), strict=True)
    exact, shown = strings[0], coincidence_speed(strand_modes(drive, NEAR)[0])
    off = 100.0 * (np.array(found) / np.array(strings) - 1.0)
    axis.axvline(exact, color="black", lw=1.0, label="moving string")
    axis.axvline(shown, color="gray", lw=1.4, ls="--", label="modes")
    axis.set(xlabel="speed of the driver [rad/s]", ylabel="amplitude at mid-strand [mm]", ylim=(0.0, None))
    return ValidationRow(
        name="critical speed",
        states=f"largest where the tooth frequency is f_1: {exact:.3f} rad/s of the driver",
        gives=f"largest at {list_text(found, '.3f')} rad/s; `modes` {shown:.3f} rad/s",
        differs=f"{list_text(off, '+.1f')} %; `modes` {100.0 * (shown / exact - 1.0):+.1f} %",
    )


def wave_slopes(trajectory: Trajectory) -> tuple[float, float]:
    """Mean square of the slope of the strands' links, and mean tension of all [N], in the latter two thirds."""
    part = trajectory.time > trajectory.time[-1] / 3.0
    position, tension = (channel[part] for channel in require_channels(trajectory, "position", "tension"))
    along = np.roll(position, -1, axis=1) - position
    inside = (position[..., 0] > 0.0) & (position[..., 0] < trajectory.drive.sprockets[1].center[0])
    inside &= np.roll(inside, -1, axis=1)
    return float(np.mean((along[..., 1] / along[..., 0])[inside] ** 2)), float(tension.mean())


def wave_tension() -> ValidationRow:
    """Tension that the waves of running strands add, which friction in the joints takes away."""
    drive = taut_drive(RUNNING, 0.012, PLUCKED | SHORT)
    versions = (drive_with_joint_friction(drive, CALMING), drive)
    runs = simulate(
        [running_drive(one, speed) for one in versions for speed in FAST], device="cpu", record=SEEN
    ).values()
    calm, wavy = np.reshape([wave_slopes(run) for run in runs], (2, len(FAST), 2))
    pulls = np.reshape([np.nanmean(strand_tension(run, 0)) for run in runs], (2, -1))
    calm_over, wavy_over = 100.0 * (pulls / strand_modes(drive, (0.0, *FAST))[1][1:] - 1.0)
    slope, more = (wavy - calm).T
    stated = drive.chain.stiffness * strand_size(drive)[0] * slope / drive.chain.links
    return ValidationRow(
        name="running strand, tension",
        states="waves of rms slope s make strands longer by s^2/2 of their length L; between fixed centers all links "
        f"then pull k L s^2/N more: {list_text(stated, '.0f')} N",
        gives=f"{list_text(more, '.0f')} N",
        differs=f"{list_text(more - stated, '+.0f')} N; strands pull {list_text(wavy_over, '+.1f')} % more than in "
        f"`modes`, with the friction {list_text(calm_over, '+.1f')} %",
    )


def vibration() -> Iterator[Line]:
    """Frequencies and a critical speed of running strands."""
    figure = Figure(figsize=(13.0, 4.0), layout="constrained")
    *left, right = figure.subplots(1, 3)
    yield from running_strand(left)
    yield wave_tension()
    yield critical_speed(right)
    for axis in (*left, right):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    yield {"validation-vibration": figure}
