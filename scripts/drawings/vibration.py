"""Vibration of a running strand: rows of docs/validation.md."""

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from common.cases import Line
from common.drives import equal, pair
from matplotlib.figure import Figure

from drawings.closed_forms import Row
from drawings.modes import spectrum, top_speed
from warpchain import Drive, Record, simulate
from warpchain.assembly.frequencies import moving_frequency
from warpchain.modal.phases import over_a_pitch
from warpchain.results.run import Trajectory
from warpchain.results.scene import strand_displacement
from warpchain.results.signals import strand_tension

SOURCE = "Sack (1954), Mahalingam (1957), Br. J. Appl. Phys. 8, 145"
SEEN = Record(channels=("position", "tension", "sprocket_speed"))
TAUT = {
    "chain.stiffness": 1e7,
    "chain.damping": 200.0,
    "sprockets.driven.load.torque": 0.0,
    "sprockets.driven.inertia": 2e4,  # that does not swing along
    "run.step": "auto",
}
RUNNING, TRAVELS, PLUCKED = (40, 120), (0.0, 6.0, 12.0, 18.0, 24.0), {"run.gravity": [0.0, -0.2]}
"""Teeth and links, speeds of the driver [rad/s], and a little weight, which plucks straight strands as a run begins."""
RESONANT, NEAR, WEIGHTLESS = (20, 61), np.linspace(1.60, 1.91, 13), {"run.gravity": [0.0, 0.0]}
"""Teeth and links, and speeds of the driver at which the tooth frequency is near the strand's first."""
BAND = 0.1


def taut(size: tuple[int, int], slack: float, values: dict[str, Any]) -> Drive:
    """Two equal sprockets, teeth and links of `size`, a little farther apart than the chain's straight strands [m]."""
    return pair(equal(*size, 0.05, slack) | TAUT | values)


def at_speed(drive: Drive, speed: float) -> Drive:
    """The drive with another speed of its driver [rad/s]."""
    return drive.with_values({"sprockets.driver.prescribed.speed": float(speed)})


def string(drive: Drive, tension: float) -> float:
    """First frequency of the moving string between the tangent points [Hz]."""
    driver, driven = drive.sprockets
    length, pitch = float(driven.center[0] - driver.center[0]), drive.chain.pitch
    return moving_frequency(drive, length, tension, top_speed(drive) / math.tau * driver.teeth * pitch)


def peak(trajectory: Trajectory, strand: int, near: float) -> float:
    """Frequency of the highest peak of a strand's displacement within `BAND` of another [Hz]."""
    rate = 1.0 / float(np.diff(trajectory.time).mean())
    places, power = spectrum(strand_displacement(trajectory, strand), rate)
    top = int(np.argmax(np.where(np.abs(places / near - 1.0) < BAND, power, 0.0)))
    low, high = np.log(power[top - 1] / power[top]), np.log(power[top + 1] / power[top])
    return float(places[top] + 0.5 * (low - high) / (low + high) * places[1])  # of the parabola through three


@cache
def running() -> tuple[list[float], list[float], list[float]]:
    """Of both strands at each speed: v/c, the string's frequency at the run's mean tension, the spectrum's peak."""
    own = {"run.settle": False, "run.sample_rate": 400.0, "run.duration": 16.0}
    drive = taut(RUNNING, 0.012, PLUCKED | own)
    drives = [at_speed(drive, speed) for speed in TRAVELS]
    share, exact, found = [], [], []
    for one, trajectory in zip(drives, simulate(drives, device="cpu", record=SEEN).values(), strict=True):
        for strand in (0, 1):
            tension = float(np.nanmean(strand_tension(trajectory, strand)))
            wave = math.sqrt(tension * one.chain.pitch / one.chain.mass)
            share.append(top_speed(one) / math.tau * RUNNING[0] * one.chain.pitch / wave)
            exact.append(string(one, tension))
            found.append(peak(trajectory, strand, exact[-1]))
    return share, exact, found


def first_modes(drive: Drive, speeds: Any) -> tuple[np.ndarray, np.ndarray]:
    """First mode of the tight strand at each speed, the mean over a tooth pitch, and the string's at the modes' own
    tension [Hz].
    """
    diagram, _ = over_a_pitch(drive, [float(speed) for speed in speeds], 4)
    first, count = drive.sprockets[0].teeth // 2 + 8, (drive.chain.links - drive.sprockets[0].teeth) // 2 - 16
    tensions = [float(one.tension[first : first + count].mean()) for one in diagram.modes]
    strings = [string(at_speed(drive, speed), tension) for speed, tension in zip(speeds, tensions, strict=True)]
    return np.asarray(diagram.frequency[:, diagram.names.index("driver->driven 1")]), np.array(strings)


def running_strand(axis: Any) -> Row:
    """The first frequency of a strand over its speed."""
    share, exact, found = running()
    shown, steady = first_modes(taut(RUNNING, 0.012, PLUCKED), TRAVELS)
    own = np.array(found) / np.array(exact) - 1.0
    axis.plot(share[::2], exact[::2], "-", color="black", lw=1.0, label="moving string, tension of the run")
    axis.plot(share[::2], steady, "--", color="C1", lw=1.0, label="moving string, tension of the modes")
    axis.plot(share[::2], shown, "x", color="C1", ms=7, label="modes")
    axis.plot(share, found, "o", color="C0", ms=4, mfc="none", label="peak of the run's spectrum")
    axis.set(xlabel="v / c", ylabel="first frequency of the strand [Hz]", ylim=(0.0, None))
    off = shown / steady - 1.0
    return Row(
        name="running strand",
        source=SOURCE,
        states=f"f_1 = (c^2 - v^2)/(2 L c); at v/c of 0 to {share[-1]:.2f}: {exact[0]:.3f} to {exact[-1]:.3f} Hz",
        drive="40 and 40 teeth, strands of 40 links, five speeds; the spectrum of mid-strand's displacement",
        gives=f"{found[0]:.3f} to {found[-1]:.3f} Hz; `modes` {shown[0]:.3f} to {shown[-1]:.3f} Hz",
        differs=f"{100.0 * own.min():+.1f} to {100.0 * own.max():+.1f} %; `modes` {100.0 * off.min():+.1f} to "
        f"{100.0 * off.max():+.1f} % at their own tension",
        verdict="agrees",
    )


def amplitude(trajectory: Trajectory, frequency: float) -> float:
    """Amplitude of the tight strand's displacement at a frequency [m], in the latter half."""
    part = trajectory.time > 0.5 * trajectory.time[-1]
    values, window = strand_displacement(trajectory, 0)[part], np.hanning(int(part.sum()))
    turned = np.exp(-2j * math.pi * frequency * trajectory.time[part])
    return float(2.0 * abs(np.sum((values - values.mean()) * window * turned)) / window.sum())


def critical_speed(axis: Any) -> Row:
    """The driver's speed at which the tooth frequency excites a strand most."""
    own = {"run.settle": True, "run.sample_rate": 200.0, "run.duration": 12.0}
    drive = taut(RESONANT, 0.006, WEIGHTLESS | own)
    rubbing = drive.with_values({"chain.joint": {"friction": 0.03, "pin_radius": 0.007}})
    drives = [at_speed(rubbing, speed) for speed in NEAR]
    runs = simulate(drives, device="cpu", record=SEEN)
    teeth = NEAR * RESONANT[0] / math.tau
    sizes = [amplitude(run, f) for run, f in zip(runs.values(), teeth, strict=True)]
    tensions = [float(np.nanmean(strand_tension(run, 0))) for run in runs.values()]
    strings = [string(one, tension) for one, tension in zip(drives, tensions, strict=True)]

    def coincidence(frequencies: Any) -> float:
        """Where the tooth frequency crosses these."""
        return float(np.interp(0.0, teeth - np.asarray(frequencies), NEAR))

    top = int(np.argmax(sizes))
    curve = np.polynomial.Polynomial.fit(NEAR[top - 2 : top + 3], sizes[top - 2 : top + 3], 2)
    found, exact, shown = (
        float(curve.deriv().roots()[0]),
        coincidence(strings),
        coincidence(first_modes(drive, NEAR)[0]),
    )
    axis.plot(NEAR, 1e3 * np.array(sizes), "o-", color="C0", ms=4, lw=0.8, label="run, at the tooth frequency")
    axis.axvline(exact, color="black", lw=1.0, label="moving string")
    axis.axvline(shown, color="C1", lw=1.0, ls="--", label="modes")
    axis.set(xlabel="speed of the driver [rad/s]", ylabel="amplitude at mid-strand [mm]", ylim=(0.0, None))
    return Row(
        name="critical speed",
        source=SOURCE,
        states=f"largest where the tooth frequency is f_1: {exact:.3f} rad/s of the driver",
        drive="20 and 20 teeth, strands of 20.5 links, 13 speeds, friction 0.03 in the joints",
        gives=f"largest at {found:.3f} rad/s; `modes` {shown:.3f} rad/s",
        differs=f"{100.0 * (found / exact - 1.0):+.1f} %; `modes` {100.0 * (shown / exact - 1.0):+.1f} %",
        verdict="agrees within half a link of the strand's length (below)",
    )


def vibration() -> Iterator[Line]:
    """Frequencies and a critical speed of running strands."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    yield running_strand(left)
    yield critical_speed(right)
    for axis in (left, right):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    yield {"validation-vibration": figure}
