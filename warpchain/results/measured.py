"""A measured signal compared with a run's simulated one: laid over it, statistics and orders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.frequencies import excitation_orders, tooth_orders
from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.model import Model
from warpchain.results.chains import chain_trajectories
from warpchain.results.channels import CHANNEL_BY_NAME, CHANNEL_UNITS, PartCounts
from warpchain.results.measured_file import SIGNAL_STATISTICS, MeasuredSignal
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import (
    TOOTH_PASSINGS,
    amplitude_spectrum,
    forward_values,
    largest_contact_forces,
    latter_half_frames,
    order_spectrum,
    part_signals,
    strand_tension,
)
from warpchain.results.strand_passing import strand_displacement

Array = NDArray[np.float64]

LINES_WITHIN = 2


class SignalSource(NamedTuple):
    """Source of a simulated signal, for comparison.

    Attributes:
        unit: SI unit.
        group: of curves in playback.
        values: function that returns the values (F,).
    """

    unit: str
    group: str
    values: Callable[[], Array]


@dataclass(frozen=True)
class SignalComparison:
    """Comparison of a measured signal with the simulated one.

    Attributes:
        group: of curves in playback.
        time, simulated: (F,) of the whole recording.
        statistics: simulated and measured value by name.
        orders: cause, simulated and measured amplitude by order.
        spectra: orders and amplitudes (2, L) of both signals, or None.
    """

    measured: MeasuredSignal
    group: str
    time: Array
    simulated: Array
    statistics: dict[str, tuple[float, float]]
    orders: dict[float, tuple[str, float, float]]
    spectra: tuple[tuple[Array, Array] | None, tuple[Array, Array] | None]


def signal_sources(trajectory: Trajectory) -> dict[str, SignalSource]:
    """Sources of a run's simulated signals by name, "STRAND.tension"."""
    found: dict[str, SignalSource] = {}
    for chain, own in chain_trajectories(trajectory).items():
        found |= _chain_signal_sources(own, f"{chain}." if chain else "")
    held = trajectory.channels()
    for name, signal, channel, group, i in part_signals(trajectory.drive):
        if channel in held:
            found[f"{name}.{signal}"] = SignalSource(
                CHANNEL_UNITS[channel], group, partial(_signal_column, held[channel], i)
            )
    return found


def signal_units(drive: Drive) -> dict[str, str]:
    """SI units of simulated signals, by name."""
    units: dict[str, str] = {}
    for before, chain in zip(drive.chain_prefixes, Model(drive).chains, strict=True):
        strands = {f"{before}{name}.{kind}": unit for name in chain.strand_names
                   for kind, unit in (("tension", "N"), ("displacement", "m"))}  # fmt: skip
        parts = [*(s.name for s in chain.sprockets), *(g.name for g in chain.guides)]
        sprockets = {f"{s.name}.{kind}": unit for s in chain.sprockets
                     for kind, unit in (("speed", "rad/s"), ("moment", "N m"))}  # fmt: skip
        links = {f"{before}link {i}.tension": "N" for i in range(chain.links)}
        units |= strands | {f"{name}.contact": "N" for name in parts} | sprockets | links
    sizes = PartCounts.of_drive(drive)
    recorded = [of for of in part_signals(drive) if sizes.count_of(CHANNEL_BY_NAME[of[2]].per)]
    return units | {f"{name}.{signal}": CHANNEL_UNITS[channel] for name, signal, channel, _, _ in recorded}


def _chain_signal_sources(trajectory: Trajectory, before: str) -> dict[str, SignalSource]:
    """Sources of a chain's simulated signals, by name."""
    model = trajectory.model
    found: dict[str, SignalSource] = {}
    for k, name in enumerate(model.strand_names):
        found[f"{before}{name}.tension"] = SignalSource("N", "strand tension", partial(strand_tension, trajectory, k))
        along = partial(strand_displacement, trajectory, k)
        found[f"{before}{name}.displacement"] = SignalSource("m", "displacement", along)
    parts = [*(s.name for s in model.sprockets), *(g.name for g in model.guides)]
    for p, name in enumerate(parts):
        found[f"{name}.contact"] = SignalSource("N", "contact", partial(_largest_contact_force, trajectory, p))
    for s, sprocket in enumerate(model.sprockets):
        if trajectory.sprocket_speed is not None:
            found[f"{sprocket.name}.speed"] = SignalSource(
                "rad/s", "speed", partial(_signal_column, trajectory.sprocket_speed, s)
            )
        if trajectory.sprocket_moment is not None:
            found[f"{sprocket.name}.moment"] = SignalSource(
                "N m", "moment", partial(_signal_column, trajectory.sprocket_moment, s)
            )
    for i in range(model.chain.links):
        found[f"{before}link {i}.tension"] = SignalSource(
            "N", "tension", partial(_signal_column, trajectory.tension, i)
        )
    return found


def _largest_contact_force(trajectory: Trajectory, part: int) -> Array:
    """Largest contact force (F,) [N] of a part, to compare."""
    return largest_contact_forces(trajectory)[part]


def _signal_column(values: NDArray[np.floating] | None, index: int) -> Array:
    """Values (F,) of one part in a channel."""
    assert values is not None
    return np.asarray(values[:, index], dtype=float)


def signal_source(trajectory: Trajectory, name: str, option: str = "") -> SignalSource:
    """Source of a run's simulated signal, by name.

    Args:
        option: what precedes the name in errors, such as "--as ".

    Raises:
        SimulationError: an unknown name, or a channel that was not recorded.
    """
    require_channels(
        trajectory, "tension", "position", "sprocket_angle", "sprocket_center", "sprocket_force", "guide_force"
    )
    found = signal_sources(trajectory)
    if name not in found:
        drive = trajectory.drive
        befores = {before: of.links for before, of in zip(drive.chain_prefixes, drive.each_chain, strict=True)}
        shown = [word for word in found if not any(word.startswith(f"{before}link ") for before in befores)]
        more = ", ".join(f'"{before}link I.tension" with I from 0 to {links - 1}' for before, links in befores.items())
        raise SimulationError(f"{option}{name!r}: allowed are {', '.join(shown)}, and {more}")
    return found[name]


def compare_signals(trajectory: Trajectory, measured: MeasuredSignal, offset: float | None = 0.0) -> SignalComparison:
    """Comparison of a measured signal with the simulated one.

    The recording's latter half counts; the rig turns at the run's mean speed.

    Args:
        offset: added to the measured time [s]; None takes the one of best correlation.

    Raises:
        SimulationError: as of `signal_source`.
    """
    of = signal_source(trajectory, measured.name)
    simulated = of.values()
    part = latter_half_frames(trajectory)
    if offset is None:
        offset = _best_time_offset(trajectory.time[part], simulated[part], measured)
    measured = MeasuredSignal(measured.name, measured.unit, measured.time + offset, measured.values)
    held = simulated[part][np.isfinite(simulated[part])]
    statistics = (
        {name: (form(held), form(measured.values)) for name, form in SIGNAL_STATISTICS.items()} if len(held) else {}
    )
    ours = order_spectrum(trajectory, simulated)
    theirs = _measured_order_spectrum(trajectory, measured)
    return SignalComparison(
        measured,
        of.group,
        trajectory.time,
        simulated,
        statistics,
        _excitation_order_amplitudes(trajectory, ours, theirs),
        (ours, theirs),
    )


def _measured_order_spectrum(trajectory: Trajectory, measured: MeasuredSignal) -> tuple[Array, Array] | None:
    """Spectrum of a measured signal over orders, or None."""
    (sprocket_angle,) = require_channels(trajectory, "sprocket_angle")
    part = latter_half_frames(trajectory)
    angle = forward_values(trajectory.parts, sprocket_angle[part], trajectory.parts.driver)
    seconds = float(trajectory.time[-1] - trajectory.time[part][0])
    turns = (angle[-1] - angle[0]) / (2.0 * np.pi)
    if turns <= 0.0 or seconds <= 0.0 or len(measured.time) < 8:
        return None
    even = np.linspace(measured.time[0], measured.time[-1], len(measured.time))
    values = np.interp(even, measured.time, measured.values)
    return amplitude_spectrum(values, float(even[1] - even[0]) * turns / seconds)


def _excitation_order_amplitudes(
    trajectory: Trajectory, ours: tuple[Array, Array] | None, theirs: tuple[Array, Array] | None
) -> dict[float, tuple[str, float, float]]:
    """Cause, simulated and measured amplitude of each excitation order."""
    if ours is None or theirs is None:
        return {}
    causes = {order.value: order.cause for order in excitation_orders(trajectory.drive)}
    for chain, teeth in tooth_orders(trajectory.drive).items():
        named = f" of {chain}" if chain else ""
        causes |= {k * float(teeth): f"{k} x tooth passing{named}" for k in range(1, TOOTH_PASSINGS + 1)}
    found = {}
    for value, cause in sorted(causes.items()):
        lines = [round(float(value / spectrum[0][1])) for spectrum in (ours, theirs)]
        if all(
            line > LINES_WITHIN and line + LINES_WITHIN < len(s[0])
            for line, s in zip(lines, (ours, theirs), strict=True)
        ):
            both = [
                float(s[1][line - LINES_WITHIN : line + LINES_WITHIN + 1].max())
                for line, s in zip(lines, (ours, theirs), strict=True)
            ]
            found[value] = (cause, both[0], both[1])
    return found


def _best_time_offset(time: Array, simulated: Array, measured: MeasuredSignal) -> float:
    """Offset of the measured time [s] that correlates best."""
    from scipy.signal import correlate

    step = max(float(np.diff(time).mean()), float(np.diff(measured.time).mean()))

    def even_samples(at: Array, values: Array) -> Any:
        """Samples of a signal at even times, less their mean."""
        where = np.arange(at[0], at[-1], step)
        held = np.interp(where, at, np.nan_to_num(values, nan=float(np.nanmean(values))))
        return held - held.mean()

    ours, theirs = even_samples(time, simulated), even_samples(measured.time, measured.values)
    products = correlate(ours, theirs, mode="full")
    # lags at which little overlaps have small products, so that they do not win
    lag = int(np.argmax(products)) - (len(theirs) - 1)
    return float(time[0] + lag * step - measured.time[0])
