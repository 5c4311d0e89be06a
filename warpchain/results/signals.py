"""Signals that engineers read off a recorded drive: of strands, shafts, arms, tensioners and probes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import assembled_path
from warpchain.drive import Drive
from warpchain.model import ChainModel
from warpchain.results.nearest_parts import nearest_guides_of_rollers, nearest_sprockets_of_rollers
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.strand_passing import FRAMES_AT_ONCE, PassingLink, passing_link

Array = NDArray[np.float64]

FEWEST_TEETH = 16

TOOTH_PASSINGS = 4
SPECTRUM_FLOOR = 1e-4
SPECTRUM_SPELLS = 2000
STRAND_TENSION_TITLE, TRANSMISSION_ERROR_TITLE = "tension at mid-strand [N]", "transmission error [degrees]"


PART_SIGNALS = (
    ("shafts", "speed", "shaft_speed", "speed"),
    ("couplings", "torque", "coupling_torque", "coupling"),
    ("couplings", "twist", "coupling_twist", "twist"),
    ("arms", "angle", "arm_angle", "arm"),
    ("tensioners", "force", "tensioner_force", "push"),
    ("tensioners", "extension", "tensioner_extension", "extension"),
    ("tensioners", "pressure", "chamber_pressure", "pressure"),
    ("valves", "torque", "valve_torque", "valves"),
)
"""Signals of parts without rollers: list, signal, channel, group."""


def part_signals(of: Drive | ChainModel) -> Iterator[tuple[str, str, str, str, int]]:
    """Part's name, signal, channel, group, column of each part signal."""
    for parts, signal, channel, group in PART_SIGNALS:
        for i, part in enumerate(getattr(of, parts)):
            if signal != "pressure" or part.hydraulic:
                yield part.name, signal, channel, group, i


def driver_speed_and_window(trajectory: Trajectory) -> tuple[float, float, float] | None:
    """Driver's mean speed [rad/s] and window's ends [s], or None."""
    time, angle, parts = trajectory.time, trajectory.sprocket_angle, trajectory.parts
    start, end = trajectory.window or (0.5 * float(time[-1]), float(time[-1]))
    start, end = max(start, float(time[0])), min(end, float(time[-1]))
    if angle is None or start >= end:
        return None
    before, after = np.interp([start, end], time, angle[:, parts.driver])
    return float(parts.sprockets[parts.driver].sign * (after - before) / (end - start)), start, end


def latter_half_frames(trajectory: Trajectory) -> slice:
    """Frames of the second half of a recording."""
    return slice(int(np.searchsorted(trajectory.time, 0.5 * trajectory.time[-1])), None)


def last_round_frames(trajectory: Trajectory) -> slice:
    """Frames of the chain's last round in a recording."""
    (sprocket_angle,) = require_channels(trajectory, "sprocket_angle")
    model = trajectory.model
    angle = forward_values(model, sprocket_angle, model.driver)
    passed = (angle[-1] - angle) * model.sprockets[model.driver].teeth / (2.0 * np.pi)
    earlier = np.flatnonzero(passed >= model.chain.links)
    return slice(int(earlier[-1]) if len(earlier) else 0, None)


def forward_values(parts: Drive | ChainModel, values: NDArray[np.floating], s: int) -> Array:
    """Angles or speeds (F,) of a sprocket, positive in travel."""
    return np.asarray(values[:, s], dtype=float) * parts.sprockets[s].sign


def strand_tension(trajectory: Trajectory, strand: int, passing: PassingLink | None = None) -> Array:
    """Tension (F,) [N] at the middle of a strand."""
    (tension,) = require_channels(trajectory, "tension")
    link = (passing or passing_link(trajectory, strand)).link
    values = np.asarray(tension, dtype=float)[np.arange(len(link)), np.maximum(link, 0)]
    return np.where(link >= 0, values, np.nan)


def speed_ratio_to_driver(trajectory: Trajectory, s: int) -> Array:
    """Speed ratio (F,) of a sprocket to the driver, 1 ideally."""
    (sprocket_speed,) = require_channels(trajectory, "sprocket_speed")
    parts = trajectory.parts
    own, driver = (forward_values(parts, sprocket_speed, k) for k in (s, parts.driver))
    moving = np.abs(driver) > 1e-6 * max(float(np.abs(driver).max()), 1e-300)
    gear = parts.sprockets[s].teeth / parts.sprockets[parts.driver].teeth
    return np.where(moving, gear * own / np.where(moving, driver, 1.0), np.nan)


def angle_ahead_of_driver(trajectory: Trajectory, s: int) -> Array:
    """Angle (F,) [rad] of a sprocket ahead of the driver.

    Raises:
        SimulationError: recorded without sprocket angles.
    """
    (sprocket_angle,) = require_channels(trajectory, "sprocket_angle")
    parts = trajectory.parts
    own, driver = (forward_values(parts, sprocket_angle, k) for k in (s, parts.driver))
    ideal = (driver - driver[0]) * parts.sprockets[parts.driver].teeth / parts.sprockets[s].teeth
    return np.asarray(own - own[0] - ideal)


def transmission_error(trajectory: Trajectory, s: int) -> Array:
    """Transmission error (F,) [rad]: angle ahead less its mean.

    Raises:
        SimulationError: recorded without sprocket angles.
    """
    ahead = angle_ahead_of_driver(trajectory, s)
    return ahead - ahead.mean()


def strand_transverse_frequency(trajectory: Trajectory, strand: int) -> float:
    """First transverse frequency [Hz] of a moving strand.

    Raises:
        SimulationError: recorded without sprocket speeds.
    """
    from warpchain.assembly.frequencies import moving_frequency

    (sprocket_speed,) = require_channels(trajectory, "sprocket_speed")
    model, path, part = trajectory.model, assembled_path(trajectory.model), latter_half_frames(trajectory)
    tension = float(np.nanmean(strand_tension(trajectory, strand)[part]))
    turns = abs(float(np.mean(sprocket_speed[part, model.driver]))) / (2.0 * np.pi)
    speed = turns * model.sprockets[model.driver].teeth * path.pitch
    return moving_frequency(model, max(path.free_lengths(strand)), tension, speed)


def guide_forces_and_rollers(trajectory: Trajectory) -> list[tuple[Array, Array]]:
    """Force (F,) [N] and number (F,) of rollers on each guide."""
    (guide_force,) = require_channels(trajectory, "guide_force")
    frame, roller = np.nonzero(guide_force > 0.0)
    force = np.asarray(guide_force, dtype=float)[frame, roller]
    nearest, _ = nearest_guides_of_rollers(trajectory, frame, roller)
    found: list[tuple[Array, Array]] = []
    for g in range(len(trajectory.parts.guides)):
        mine, count = nearest == g, len(trajectory.time)
        total = np.bincount(frame[mine], force[mine], minlength=count)
        found.append((np.asarray(total, float), np.asarray(np.bincount(frame[mine], minlength=count), float)))
    return found


def largest_contact_forces(trajectory: Trajectory) -> list[Array]:
    """Largest contact force (F,) [N] of each sprocket, then guide."""
    sprocket_force, guide_force = require_channels(trajectory, "sprocket_force", "guide_force")
    parts, count = trajectory.parts, len(trajectory.time)
    largest = np.zeros((len(parts.sprockets) + len(parts.guides), count))
    frame, roller = np.nonzero(sprocket_force > 0.0)
    force = np.asarray(sprocket_force, dtype=float)[frame, roller]
    np.maximum.at(largest, (nearest_sprockets_of_rollers(trajectory, frame, roller)[0], frame), force)
    frame, roller = np.nonzero(guide_force > 0.0)
    force = np.asarray(guide_force, dtype=float)[frame, roller]
    np.maximum.at(
        largest, (len(parts.sprockets) + nearest_guides_of_rollers(trajectory, frame, roller)[0], frame), force
    )
    return list(largest)


class ContactAngles(NamedTuple):
    """Contact forces of rollers on a sprocket, over angle.

    Attributes:
        angle: (K,) past the chain's arrival [rad].
        force: (K,) [N].
        wrap: wrapped angle [rad].
        pitch: of the teeth [rad].
    """

    angle: Array
    force: Array
    wrap: float
    pitch: float


def contact_angles(trajectory: Trajectory, s: int) -> ContactAngles:
    """Contact forces of rollers on a sprocket, over angle."""
    position, sprocket_center, sprocket_force = require_channels(
        trajectory, "position", "sprocket_center", "sprocket_force"
    )
    model, part, path = trajectory.model, latter_half_frames(trajectory), assembled_path(trajectory.model)
    step = 2.0 * np.pi / model.sprockets[s].teeth
    r = np.asarray(position[part], dtype=float) - sprocket_center[part, None, s]
    apart = np.abs(np.hypot(r[..., 0], r[..., 1]) - model.pitch_radius(s))
    polar = model.sprockets[s].sign * (np.arctan2(r[..., 1], r[..., 0]) - path.arrival_angle[s])
    wrap = float(path.wrap_angle[s])
    spare = 0.5 * (2.0 * np.pi - wrap)
    angle = np.mod(polar + spare, 2.0 * np.pi) - spare
    on = (apart < model.engagement(s)) & (angle > -2.0 * step) & (angle < wrap + 2.0 * step)
    return ContactAngles(angle[on], np.asarray(sprocket_force[part], dtype=float)[on], wrap, step)


def amplitude_spectrum(values: Array, interval: float) -> tuple[Array, Array]:
    """Frequencies and amplitudes (K // 2 + 1,) of a signal (K,).

    Args:
        interval: between samples, in seconds, or in revolutions for orders.
    """
    values = np.asarray(values, dtype=float)
    window = np.hanning(len(values) + 1)[:-1]
    amplitude: Array = np.abs(np.fft.rfft((values - values.mean()) * window)) * 2.0 / window.sum()
    return np.asarray(np.fft.rfftfreq(len(values), interval)), amplitude


def order_spectrum(trajectory: Trajectory, values: Array) -> tuple[Array, Array] | None:
    """Driver's orders and amplitudes of a signal, or None."""
    (sprocket_angle,) = require_channels(trajectory, "sprocket_angle")
    parts, part = trajectory.parts, latter_half_frames(trajectory)
    turns = forward_values(parts, sprocket_angle[part], parts.driver) / (2.0 * np.pi)
    if len(turns) < 8 or not np.all(np.diff(turns) > 0.0):
        return None
    if (turns[-1] - turns[0]) * parts.sprockets[parts.driver].teeth < FEWEST_TEETH:
        return None
    if not np.isfinite(values[part]).all():
        return None
    even: Array = np.linspace(turns[0], turns[-1], len(turns), endpoint=False)
    return amplitude_spectrum(np.interp(even, turns, values[part]), float(even[1] - even[0]))


class OrderSpectrum(NamedTuple):
    """Order spectrum of a signal, as drawn.

    Attributes:
        name: of the strand or sprocket.
        orders: (K,) of the driver's revolution, ascending from above 0.
        amplitude: (K,) in the signal's unit.
    """

    name: str
    orders: Array
    amplitude: Array


def order_spectra(trajectory: Trajectory) -> dict[str, list[OrderSpectrum]]:
    """Order spectra of tensions and transmission errors."""
    parts = trajectory.parts
    signals = [(STRAND_TENSION_TITLE, name, strand_tension(trajectory, k)) for k, name in enumerate(parts.strand_names)]
    signals += [
        (TRANSMISSION_ERROR_TITLE, sprocket.name, np.degrees(transmission_error(trajectory, s)))
        for s, sprocket in enumerate(parts.sprockets)
        if s != parts.driver
    ]
    last = (TOOTH_PASSINGS + 0.5) * parts.sprockets[parts.driver].teeth
    found: dict[str, list[OrderSpectrum]] = {}
    for title, name, values in signals:
        spectrum = order_spectrum(trajectory, values)
        if spectrum is not None:
            orders, amplitude = (part[1 : int(np.searchsorted(spectrum[0], last)) + 1] for part in spectrum)
            kept = peak_frames(amplitude, SPECTRUM_SPELLS)
            found.setdefault(title, []).append(OrderSpectrum(name, orders[kept], amplitude[kept]))
    return found


def peak_frames(values: NDArray[np.floating], buckets: int) -> NDArray[np.intp]:
    """Frames that draw a signal with its peaks kept."""
    count = len(values)
    if count <= 2 * buckets:
        return np.arange(count)
    first = _spell_starts(count, buckets)
    width = int(np.diff(first, append=count).max())
    at = np.minimum(first[:, None] + np.arange(width), np.append(first[1:], count)[:, None] - 1)
    spells = np.asarray(values, dtype=float)[at]
    lowest = np.where(np.isnan(spells), np.inf, spells).argmin(axis=1)
    highest = np.where(np.isnan(spells), -np.inf, spells).argmax(axis=1)
    rows = np.arange(buckets)
    return np.unique(np.concatenate([at[rows, lowest], at[rows, highest]]))


def peaks_over_time(values: NDArray[np.floating], buckets: int) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
    """First frames of a signal's spells, and peaks (spells, ...)."""
    count = len(values)
    if count <= buckets:
        return np.arange(count), values
    first = _spell_starts(count, buckets)
    return first, np.maximum.reduceat(values, first, axis=0)


def _spell_starts(count: int, buckets: int) -> NDArray[np.intp]:
    """First frames of a signal's spells, for its peaks."""
    return (np.arange(buckets) * count // buckets).astype(np.intp)


class QuantityRange(NamedTuple):
    """Range and path of a signal.

    Attributes:
        low, mean, high: smallest, mean, largest.
        path: way back and forth in a second.
    """

    low: float
    mean: float
    high: float
    path: float

    @property
    def range_width(self) -> float:
        """Largest less smallest value of a signal."""
        return self.high - self.low


class OpeningEvents(NamedTuple):
    """Openings of a valve or contact over a window.

    Attributes:
        openings: number.
        rate: of openings [1/s].
        share: of the time that it is open.
        longest: time open [s].
    """

    openings: int
    rate: float
    share: float
    longest: float


def range_and_path(time: Array, values: Array) -> QuantityRange:
    """Range and path of a signal (F,)."""
    seconds = float(time[-1] - time[0])
    path = float(np.abs(np.diff(values)).sum()) / seconds if seconds > 0.0 else 0.0
    return QuantityRange(float(values.min()), float(values.mean()), float(values.max()), path)


def opening_events(time: Array, values: Array, threshold: float = 0.0) -> OpeningEvents:
    """Openings of a signal (F,): spells above a threshold."""
    open_ = np.concatenate([[False], np.asarray(values) > threshold, [False]])
    begins, ends = np.flatnonzero(open_[1:] & ~open_[:-1]), np.flatnonzero(~open_[1:] & open_[:-1])
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    count = len(begins) - int(bool(len(begins)) and begins[0] == 0)
    seconds = step * len(time)
    longest = step * int((ends - begins).max()) if len(begins) else 0.0
    return OpeningEvents(
        count, count / seconds if seconds > 0.0 else 0.0, float((ends - begins).sum()) / len(time), longest
    )


class ProbeSignals(NamedTuple):
    """Signals of a probe, nan without a chain.

    Attributes:
        link: (F,) that passes, -1 for none.
        tension: (F,) of that link [N].
        speed: (F,) of the chain along itself [m/s].
        displacement: (F,) of the chain from the probe's place, left positive [m].
        normal_speed: (F,) to the left [m/s].
    """

    link: NDArray[np.intp]
    tension: Array
    speed: Array
    displacement: Array
    normal_speed: Array


def probe_signals(trajectory: Trajectory, at: tuple[float, float], radius: float) -> ProbeSignals:
    """Signals of a probe within a radius [m].

    Raises:
        SimulationError: recorded without positions, velocities or tensions.
    """
    position, velocity, tension = require_channels(trajectory, "position", "velocity", "tension")
    count = len(trajectory.time)
    link, values = np.full(count, -1, dtype=np.intp), np.full((4, count), np.nan)
    place = np.asarray(at, dtype=float)
    for first in range(0, count, FRAMES_AT_ONCE):
        part = slice(first, first + FRAMES_AT_ONCE)
        x = np.asarray(position[part], dtype=float)
        across = np.roll(x, -1, axis=1) - x
        square = (across**2).sum(axis=-1)
        share = np.clip(((place - x) * across).sum(axis=-1) / square, 0.0, 1.0)
        foot = x + share[..., None] * across
        apart = np.hypot(*np.moveaxis(foot - place, -1, 0))
        rows, nearest = np.arange(len(x)), apart.argmin(axis=1)
        near = apart[rows, nearest] <= radius
        rows, nearest = rows[near], nearest[near]
        t = across[rows, nearest] / np.sqrt(square[rows, nearest])[:, None]
        left = np.stack([-t[:, 1], t[:, 0]], axis=-1)
        v = np.asarray(velocity[part], dtype=float)
        part_of = share[rows, nearest][:, None]
        moving = (1.0 - part_of) * v[rows, nearest] + part_of * v[rows, (nearest + 1) % x.shape[1]]
        link[first + rows] = nearest
        seen = (
            np.asarray(tension[part], dtype=float)[rows, nearest],
            (moving * t).sum(axis=-1),
            ((foot[rows, nearest] - place) * left).sum(axis=-1),
            (moving * left).sum(axis=-1),
        )
        values[:, first + rows] = seen
    return ProbeSignals(link, *values)
