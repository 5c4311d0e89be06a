"""The table of metrics: one row a variant, from what the kernels added up over the window.

Beside means and extremes there are numbers that designs are judged by (`design_row`). With E the energy that a
partner's contacts dissipate in the window, n_d the driver's revolutions, n_s a sprocket's tooth passings, m a roller's
mass:

    peak factor    = largest over mean tension                                                                (a)
    contact energy per revolution = E / n_d, a wear index: what the contacts have to take up                  (b)
    impact impulse = sqrt(2 m E / n_s), of the blow that would lose E / n_s, a proxy of noise                 (c)

There is no friction in the model: (b) is the work of normal impacts, not of sliding in the bushings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.drive.mounts import moves
from warpchain.results.schedule import Schedule

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]

UNITS = {
    "tension": "N",
    "displacement": "m",
    "travel": "m",
    "speed": "rad/s",
    "moment": "N m",
    "force": "N",
    "impulse": "N s",
    "dissipated": "J",
    "work": "J",
    "energy": "J",
    "error": "rad",
    "hour": "1/h",
    "time": "s",
    "start": "s",
    "end": "s",
}
"""Unit by the first of these words that a column's own name holds."""


RUN_COLUMNS = ("diverged", "diverged_time", "window_start", "window_end")
"""Columns that tell how far a variant ran and which window its metrics are of."""
SETTLING_COLUMNS = ("settle_steps", "settle_residual")
"""Columns that tell how the start was settled, where it was."""


def unit_of(column: str) -> str:
    """Unit of a metric's column, "1" for a count, ratio or flag."""
    name = column.rsplit(".", 1)[-1]
    if name.endswith("_relative"):
        return "1"
    return next((unit for word, unit in UNITS.items() if word in name.split("_")), "1")


def _moments(total: float, square: float, weight: float) -> tuple[float, float]:
    """Mean and standard deviation from sums."""
    mean = total / weight
    return mean, float(np.sqrt(max(square / weight - mean * mean, 0.0)))


def _chain_row(sums: Any, rollers: int) -> Row:
    links = float(sums["samples"]) * rollers
    return {"tension_min": sums["tension_min"], "tension_max": sums["tension_max"]} | dict(
        zip(("tension_mean", "tension_std"), _moments(sums["tension"], sums["tension_square"], links), strict=True)
    )


def _strand_row(name: str, sums: Any) -> Row:
    row: Row = {}
    if sums["links"]:
        mean, std = _moments(sums["tension"], sums["tension_square"], float(sums["links"]))
        row |= {
            f"{name}.tension_min": sums["tension_min"],
            f"{name}.tension_mean": mean,
            f"{name}.tension_max": sums["tension_max"],
            f"{name}.tension_std": std,
        }
    if sums["samples"]:
        samples = float(sums["samples"])
        row |= {
            f"{name}.displacement_min": sums["displacement_min"],
            f"{name}.displacement_mean": sums["displacement"] / samples,
            f"{name}.displacement_max": sums["displacement_max"],
            f"{name}.displacement_rms": np.sqrt(sums["displacement_square"] / samples),
        }
    return row


def _sprocket_row(name: str, sums: Any, duration: float) -> Row:
    mean, std = _moments(sums["speed"], sums["speed_square"], duration)
    return {
        f"{name}.speed_min": sums["speed_min"],
        f"{name}.speed_mean": mean,
        f"{name}.speed_max": sums["speed_max"],
        f"{name}.speed_std": std,
        f"{name}.moment_mean": sums["moment"] / duration,
    }


def _mount_row(name: str, sums: Any, duration: float) -> Row:
    return {
        f"{name}.travel_x_mean": sums["travel"][0] / duration,
        f"{name}.travel_y_mean": sums["travel"][1] / duration,
        f"{name}.travel_max": sums["travel_max"],
        f"{name}.mount_force_mean": sums["force"] / duration,
        f"{name}.mount_dissipated": sums["dissipated"],
    }


def _contact_row(name: str, sums: Any) -> Row:
    return {
        f"{name}.force_max": sums["force_max"],
        f"{name}.impacts": int(sums["impacts"]),
        f"{name}.impulse": sums["impulse"],
        f"{name}.dissipated": sums["dissipated"],
    }


def _energy_row(drive: Drive, chain: Any, sprockets: Any, mounts: Any, contacts: Any) -> Row:
    """Work done and energy gone over the window; the residual is what the balance misses.

    What prescribes angles and centers does the input work; the loads take the output work.
    """
    driven = np.array([s.prescribed is not None for s in drive.sprockets])
    work_in = float(mounts["work"].sum()) - float(sprockets["contact_work"][driven].sum())
    work_out = -float(sprockets["load_work"][~driven].sum())
    dissipated = float(chain["dissipated"]) + float(contacts["dissipated"].sum())
    dissipated += float(mounts["dissipated"].sum())
    change = float(chain["energy_end"] - chain["energy_start"])
    residual = work_in - work_out - dissipated - change
    turnover = 0.5 * (abs(work_in) + abs(work_out) + dissipated + abs(change))
    return {
        "input_work": work_in,
        "output_work": work_out,
        "links.dissipated": chain["dissipated"],
        "energy_change": change,
        "energy_residual": residual,
        "energy_residual_relative": residual / turnover if turnover else 0.0,
    }


def design_row(drive: Drive, metrics: Row) -> Row:
    """What designs are judged by, from the other metrics of a variant; see the module's (a) to (c).

    What needs turning sprockets is left out where they stand still.
    """
    row: Row = {}
    if metrics["tension_mean"] > 0.0:
        row["peak_factor"] = metrics["tension_max"] / metrics["tension_mean"]
    for strand in drive.strand_names:
        mean = metrics.get(f"{strand}.tension_mean")
        if mean is not None and mean > 0.0:
            row[f"{strand}.peak_factor"] = metrics[f"{strand}.tension_max"] / mean
        mean, rms = metrics.get(f"{strand}.displacement_mean"), metrics.get(f"{strand}.displacement_rms")
        if mean is not None and rms is not None:
            row[f"{strand}.displacement_std"] = math.sqrt(max(rms * rms - mean * mean, 0.0))
    seconds = metrics["window_end"] - metrics["window_start"]
    turns = {s.name: abs(metrics[f"{s.name}.speed_mean"]) * seconds / (2.0 * math.pi) for s in drive.sprockets}
    driven_by = turns[drive.sprockets[drive.driver].name]
    names = [s.name for s in drive.sprockets] + [g.name for g in drive.guides]
    if driven_by > 0.0:
        for name in names:
            row[f"{name}.contact_energy_per_revolution"] = metrics[f"{name}.dissipated"] / driven_by
        row["contact_energy_per_revolution"] = sum(metrics[f"{name}.dissipated"] for name in names) / driven_by
    for sprocket in drive.sprockets:
        passings = sprocket.teeth * turns[sprocket.name]
        if passings > 0.0:
            lost = max(metrics[f"{sprocket.name}.dissipated"], 0.0)
            row[f"{sprocket.name}.impact_impulse"] = math.sqrt(2.0 * drive.chain.mass * lost / passings)
    return row


def row_of(drive: Drive, schedule: Schedule, sums: dict[str, Any], steps: int, diverged: bool) -> Row:
    """One variant's metrics.

    Args:
        sums: "chain", "strand", "sprocket", "mount" and "contact" sums of this variant alone.
        steps: the step that the variant came to.
    """
    row: Row = {"diverged": diverged, "diverged_time": steps * schedule.step if diverged else None}
    row |= {"window_start": schedule.window_start * schedule.step, "window_end": schedule.window_end * schedule.step}
    if steps <= schedule.window_end or diverged:
        return row
    duration = (schedule.window_end - schedule.window_start) * schedule.step
    row |= _chain_row(sums["chain"], drive.chain.links)
    for name, strand in zip(drive.strand_names, sums["strand"], strict=True):
        row |= _strand_row(name, strand)
    names = [s.name for s in drive.sprockets] + [g.name for g in drive.guides]
    for sprocket, values, mount in zip(drive.sprockets, sums["sprocket"], sums["mount"], strict=True):
        row |= _sprocket_row(sprocket.name, values, duration)
        if moves(sprocket):
            row |= _mount_row(sprocket.name, mount, duration)
    for name, values in zip(names, sums["contact"], strict=True):
        row |= _contact_row(name, values)
    row |= _energy_row(drive, sums["chain"], sums["sprocket"], sums["mount"], sums["contact"])
    return row | design_row(drive, row)


def table_of(rows: Sequence[Row]) -> pa.Table:
    """A pyarrow table of rows; a column that a row lacks is null there, and its field says its unit."""
    import pyarrow as pa

    names: dict[str, None] = {"variant": None}
    for row in rows:
        names |= dict.fromkeys(row)
    columns, fields = [], []
    for name in names:
        values = range(len(rows)) if name == "variant" else [row.get(name) for row in rows]
        kind = {"variant": pa.int64(), "diverged": pa.bool_(), "settle_steps": pa.int64()}.get(name, pa.float64())
        if name.endswith(".impacts"):
            kind = pa.int64()
        columns.append(pa.array(values, kind))
        fields.append(pa.field(name, kind, metadata={"unit": unit_of(name)}))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))
