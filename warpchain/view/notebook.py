"""HTML that notebooks show of drives, runs and trajectories: a picture beside tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any

from warpchain.drive import Drive
from warpchain.errors import WarpchainError
from warpchain.model import ChainModel, Model
from warpchain.results.channels import CHANNEL_BY_NAME
from warpchain.results.judgement import DIVERGED, OK, SUSPECT
from warpchain.results.metric_columns import title_of_metric, unit_of_metric
from warpchain.results.run import Run, Trajectory
from warpchain.results.units import quantity_words
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.html import picture_html

PICTURE_SIZE = 4.0
"""Longer side of a drive's picture [in]."""
SHOWN_ROWS = 20
STATUS_COLORS = {OK: "#2e9e4f", SUSPECT: "#d08700", DIVERGED: "#d1394b"}


class Markup(str):
    """HTML that `notebook_table` does not escape."""


def notebook_html(thing: Any) -> str:
    """HTML of a drive, run or trajectory for notebooks; raises TypeError for others."""
    if isinstance(thing, Drive):
        return _drive_html(thing)
    if isinstance(thing, Run):
        return _run_html(thing)
    if isinstance(thing, Trajectory):
        return _trajectory_html(thing)
    raise TypeError(f"{type(thing).__name__}: allowed are Drive, Run, Trajectory")


def notebook_table(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """HTML of a table for notebooks; cells but `Markup` are escaped."""

    def row_html(cells: Sequence[str], tag: str) -> str:
        """HTML of a notebook table's row, in cells of a tag."""
        words = [cell if isinstance(cell, Markup) else escape(cell) for cell in cells]
        sides = ["left", *["right"] * (len(words) - 1)]
        inner = (f'<{tag} style="text-align:{side}">{w}</{tag}>' for w, side in zip(words, sides, strict=True))
        return f"<tr>{''.join(inner)}</tr>"

    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "".join(row_html(row, "td") for row in rows)
    return f"<table>{title}<thead>{row_html(head, 'th')}</thead><tbody>{body}</tbody></table>"


def status_html(status: str) -> Markup:
    """HTML of a variant's status for notebooks, in its color."""
    return Markup(f'<b style="color:{STATUS_COLORS.get(status, "inherit")}">{escape(status)}</b>')


def value_with_unit(value: Any, unit: str) -> str:
    """Text of a value [SI] for notebooks, such as 42.2 kN, or "-"."""
    if value is None:
        return "-"
    bare = isinstance(value, bool | str) or not math.isfinite(value)
    return str(value) if bare else quantity_words(value, unit)


def _side_by_side_html(left: str, right: str) -> str:
    """HTML of two elements side by side, for notebooks."""
    return f'<div style="display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start">{left}<div>{right}</div></div>'


def _drive_picture(of: Drive | Trajectory, frame: int | None = None) -> str:
    """HTML of a drive's picture for notebooks, or of the error."""
    try:
        return picture_html(drive_figure(of, frame, size=PICTURE_SIZE), "the drive", "png")
    except WarpchainError as error:
        return f"<p>{escape(str(error))}</p>"


def _drive_html(drive: Drive) -> str:
    """HTML of a drive for notebooks: picture, chains with sprockets, run settings."""
    warm = "" if drive.temperature is None else f"{drive.temperature:g} \N{DEGREE SIGN}C, "
    run = f"{warm}{drive.run.duration:g} s, {drive.run.integrator}, step {drive.run.step}"
    right = "".join(_chain_html(model) for model in Model(drive).chains) + f"<p>{escape(run)}</p>"
    return _side_by_side_html(_drive_picture(drive), right)


def _chain_html(model: ChainModel) -> str:
    """HTML of a chain and its sprockets for notebooks."""
    chain, named = model.chain, f"<p>{escape(model.name)}</p>" if model.name else ""
    size = f"{chain.size}, " if chain.size else ""
    about = f"{chain.links} links of {1e3 * chain.pitch:g} mm ({size}{value_with_unit(chain.mass, 'kg')} a roller)"
    rows = []
    for s, sprocket in enumerate(model.sprockets):
        travel, load = sprocket.prescribed, sprocket.load
        does = "turns freely"
        if travel is not None:
            does = f"driven, up to {travel.top_speed * 30.0 / math.pi:.4g} rpm"
        elif sprocket.shaft is not None:
            does = f"on shaft {sprocket.shaft}"
        elif load is not None:
            does = f"load {value_with_unit(load.torque, 'N m')}"
        radius = value_with_unit(model.pitch_radius(s), "m")
        rows.append([sprocket.name, str(sprocket.teeth), radius, does])
    return named + notebook_table(("sprocket", "teeth", "pitch radius", ""), rows, about)


def _notebook_metrics(drive: Drive) -> list[str]:
    """Names of the metrics that a notebook shows."""
    names = [*(f"{chain}tension_{of}" for chain in drive.chain_prefixes for of in ("mean", "max")), "efficiency"]
    for sprocket in drive.sprockets:
        names += [f"{sprocket.name}.speed_mean", f"{sprocket.name}.moment_mean", f"{sprocket.name}.force_max"]
    names += [f"{guide.name}.force_max" for guide in drive.guides]
    return [*names, *(f"{strand}.displacement_rms" for strand in drive.strand_names), "energy_residual_relative"]


def _run_html(run: Run) -> str:
    """HTML of a run for notebooks: picture, and metrics or a row a variant."""
    rows, names = run.metrics.to_pylist(), run.metrics.column_names
    info = f"{len(rows)} variants" if len(rows) != 1 else "1 variant"
    about = f"{info}, {len(run)} recorded; {run.info.device}, {run.info.precision}, {run.info.wall_time:.1f} s"
    shown = [name for name in _notebook_metrics(run.drives[0]) if name in names]
    if len(rows) == 1:
        held = [[title_of_metric(name), value_with_unit(rows[0][name], unit_of_metric(name))] for name in shown]
        status = str(rows[0].get("status", ""))
        held.insert(0, ["status", status_html(status)])
        if rows[0].get("reason"):
            held.insert(1, ["why", str(rows[0]["reason"])])
        right = notebook_table(("metric", "value"), held, about)
    else:
        shown = shown[:6]
        held = [
            [
                str(v),
                status_html(str(row.get("status", ""))),
                *(value_with_unit(row[name], unit_of_metric(name)) for name in shown),
            ]
            for v, row in zip(run.numbers, rows[:SHOWN_ROWS], strict=False)
        ]
        right = notebook_table(("variant", "status", *shown), held, about)
        if len(rows) > SHOWN_ROWS:
            right += f"<p>and {len(rows) - SHOWN_ROWS} more: run.metrics has all {len(names)} columns</p>"
    return _side_by_side_html(_drive_picture(run.drives[0]), right)


def _trajectory_html(trajectory: Trajectory) -> str:
    """HTML of a trajectory for notebooks: picture, channels with unit and shape."""
    frames = len(trajectory.time)
    spell = f"{trajectory.time[0]:g} to {trajectory.time[-1]:g} s" if frames else "empty"
    rows = [
        [name, CHANNEL_BY_NAME[name].unit, " x ".join(map(str, values.shape)), str(values.dtype)]
        for name, values in trajectory.channels().items()
    ]
    right = notebook_table(("channel", "unit", "shape", "type"), rows, f"{frames} frames, {spell}")
    moving = trajectory.position is not None and frames > 0
    return _side_by_side_html(
        _drive_picture(trajectory, frames - 1) if moving else _drive_picture(trajectory.drive), right
    )
