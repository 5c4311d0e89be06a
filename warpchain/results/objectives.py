"""Objectives that need a recorded trajectory: transmission error, impact of engagement, fatigue (docs/metrics.md)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import SimulationError
from warpchain.results.chains import chain_trajectories
from warpchain.results.fatigue import Woehler, count_links, equivalent_range, miner_damage
from warpchain.results.nearest_parts import engaged_sprockets
from warpchain.results.run import Run, Trajectory, require_channels
from warpchain.results.signals import transmission_error

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, float]


def engagement_impulses(trajectory: Trajectory, s: int, start: float = 0.0) -> NDArray[np.float64]:
    """Impulses (P,) [N s] of rollers' first touches on a sprocket, over 2 pi sqrt(m / K).

    Args:
        start: time from which touches count [s].

    Raises:
        SimulationError: recorded without positions, sprocket centers or sprocket forces.
    """
    _, _, sprocket_force = require_channels(trajectory, "position", "sprocket_center", "sprocket_force")
    model, time = trajectory.model, trajectory.time
    length = 2.0 * math.pi * math.sqrt(model.chain.mass / model.sprocket_stiffness(s))
    near = engaged_sprockets(trajectory) == s
    force = np.where(near, np.asarray(sprocket_force, dtype=float), 0.0)
    steps = 0.5 * (force[1:] + force[:-1]) * np.diff(time)[:, None]
    summed = np.vstack([np.zeros(force.shape[1]), np.cumsum(steps, axis=0)])
    impulses: list[float] = []
    for roller in range(force.shape[1]):
        begins = np.flatnonzero(near[1:, roller] & ~near[:-1, roller]) + 1
        touches = np.flatnonzero((force[1:, roller] > 0.0) & (force[:-1, roller] == 0.0))
        first = np.searchsorted(touches, begins)
        at = np.unique(touches[first[first < len(touches)]])
        ends = time[at] + length
        counted = (time[at] >= start) & (ends <= time[-1])
        at, ends = at[counted], ends[counted]
        impulses += (np.interp(ends, time, summed[:, roller]) - summed[at, roller]).tolist()
    return np.array(impulses)


def trajectory_objectives(trajectory: Trajectory, start: float, end: float, woehler: Woehler | None = None) -> Row:
    """Objectives of a recorded window [s], by name.

    Args:
        woehler: curve of a link; None leaves fatigue out.

    Raises:
        SimulationError: fewer than three frames in the window.
    """
    row: Row = {}
    for name, chain in chain_trajectories(trajectory).items():
        parts = {sprocket.name for sprocket in chain.parts.sprockets}
        found = _chain_objectives(chain, start, end, woehler)
        row |= {key if not name or key.partition(".")[0] in parts else f"{name}.{key}": value
                for key, value in found.items()}  # fmt: skip
    return row


def _chain_objectives(trajectory: Trajectory, start: float, end: float, woehler: Woehler | None) -> Row:
    """Objectives of one chain's recording, by name."""
    inside = (trajectory.time >= start - 1e-12) & (trajectory.time <= end + 1e-12)
    if inside.sum() < 3:
        raise SimulationError(f"objectives: {int(inside.sum())} frames from {start:g} to {end:g} s, at least 3 needed")
    part, whole = trajectory.at(inside), trajectory.at(trajectory.time <= end + 1e-12)
    parts, d = trajectory.parts, trajectory.parts.driver
    row: Row = {}
    if part.sprocket_angle is not None:
        for s, sprocket in enumerate(parts.sprockets):
            if s != d:
                error = transmission_error(part, s)
                row[f"{sprocket.name}.transmission_error_rms"] = float(np.sqrt(np.mean(error * error)))
                row[f"{sprocket.name}.transmission_error_range"] = float(np.ptp(error))
    if part.position is not None and part.sprocket_center is not None and part.sprocket_force is not None:
        for s, sprocket in enumerate(parts.sprockets):
            impulses = engagement_impulses(whole, s, start)
            if len(impulses):
                row[f"{sprocket.name}.engagement_impulse"] = float(impulses.mean())
    if woehler is not None and part.tension is not None:
        row |= _fatigue_objectives(part, woehler)
    return row


def _fatigue_objectives(part: Trajectory, woehler: Woehler) -> Row:
    """Objectives of links' fatigue, by name."""
    (tension,) = require_channels(part, "tension")
    seconds = float(part.time[-1] - part.time[0])
    cycles = count_links(tension)
    found = miner_damage(tension, woehler, cycles)
    row = {
        "damage_per_hour_max": float(found.max()) * 3600.0 / seconds,
        "damage_per_hour_mean": float(found.mean()) * 3600.0 / seconds,
    }
    if part.sprocket_angle is not None:
        d = part.parts.driver
        turns = abs(float(part.sprocket_angle[-1, d] - part.sprocket_angle[0, d])) / (2.0 * math.pi)
        revolutions = turns * part.parts.sprockets[d].teeth / part.parts.chain.links
        if revolutions > 0.0:
            ranges = equivalent_range(tension, woehler.exponent, revolutions, cycles)
            row["tension_equivalent_range"] = float(ranges.max())
    return row


def add_objectives(run: Run, woehler: Woehler | None = None) -> pa.Table:
    """Metrics table of a run, with recorded variants' objectives.

    Args:
        woehler: curve of a link; None leaves fatigue out.
    """
    from warpchain.results.metrics import table_from_rows

    rows = run.metrics.to_pylist()
    for variant, ok, row in zip(run.numbers, run.ok, rows, strict=True):
        if row.get("input_work") is not None and ok and variant in run:
            row.update(trajectory_objectives(run[variant], row["window_start"], row["window_end"], woehler))
    return table_from_rows(rows)
