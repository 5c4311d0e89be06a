"""Drives, runs and trajectories as notebooks show them: an SVG picture beside tables with units and status."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path
from warpchain.drive import Drive
from warpchain.drive.rings import rings_of
from warpchain.errors import WarpchainError
from warpchain.results.chains import chain_trajectories
from warpchain.results.channels import CHANNEL
from warpchain.results.judgement import DIVERGED, OK, SUSPECT
from warpchain.results.metric_columns import title_of, unit_of
from warpchain.results.run import Run, Trajectory, need
from warpchain.results.scene import guide_outline, tooth_outline
from warpchain.results.units import display_unit
from warpchain.view.palette import scale_top, tension_scale, tension_steps

Array = NDArray[np.float64]

WIDE, TALL = 420.0, 380.0
"""Most pixels across and up."""
MARGIN = 12.0
STEEL, RUBBER, CHAIN = "#8a93a0", "#b9773c", "#3b78c2"
ROWS = 20
"""Most variants of a run, or rows of a table, that are shown."""
COLORS = {OK: "#2e9e4f", SUSPECT: "#d08700", DIVERGED: "#d1394b"}


def drive_svg(drive: Drive) -> str:
    """A drive as it is drawn: the chain along pitch circles and tangents.

    Raises:
        DriveError: a path that cannot be drawn.
    """
    path = chain_path(drive)
    line = []
    for s, sprocket in enumerate(drive.sprockets):
        angles = path.arrival_angle[s] + sprocket.sign * np.linspace(0.0, path.wrap_angle[s], 40)
        line.append(np.asarray(sprocket.center) + path.radius[s] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    chain = np.concatenate(line)
    centers = np.array([sprocket.center for sprocket in drive.sprockets])
    return _svg(drive, centers, np.zeros(len(centers)), [(np.vstack([chain, chain[:1]]), CHAIN)])


def frame_svg(trajectory: Trajectory, frame: int) -> str:
    """A drive at a frame, each link in the color of its tension where that was recorded."""
    drive = trajectory.drive
    (position,) = need(trajectory, "position")
    x = np.asarray(position[frame], dtype=float)
    pairs = np.stack([x, np.roll(x, -1, axis=0)], axis=1)
    colors = [CHAIN] * len(x)
    if trajectory.tension is not None:
        steps = tension_steps(trajectory.tension[frame], scale_top([trajectory]))
        colors = ["#{:02x}{:02x}{:02x}".format(*color[:3]) for color in tension_scale()[steps]]
    centers = np.array([sprocket.center for sprocket in drive.sprockets])
    angles = np.zeros(len(centers))
    if trajectory.sprocket_center is not None:
        centers = np.asarray(trajectory.sprocket_center[frame], dtype=float)
    if trajectory.sprocket_angle is not None:
        angles = np.asarray(trajectory.sprocket_angle[frame], dtype=float)
    return _svg(drive, centers, angles, list(zip(pairs, colors, strict=True)))


def _svg(drive: Drive, centers: Array, angles: Array, chain: list[tuple[Array, str]]) -> str:
    teeth = []
    for s, (center, angle) in enumerate(zip(centers, angles, strict=True)):
        c, d = np.cos(angle), np.sin(angle)
        teeth.append(tooth_outline(drive, s, 3) @ np.array([[c, d], [-d, c]]) + center)
    bars = [guide_outline(drive, g, 6) for g in range(len(drive.guides))]
    every = np.concatenate([*teeth, *bars, *(points for points, _ in chain)])
    every = every[np.isfinite(every).all(axis=1)]
    low, high = every.min(axis=0), every.max(axis=0)
    scale = min(WIDE / (high - low)[0], TALL / (high - low)[1])

    def spots(points: Array) -> str:
        at = np.stack([points[:, 0] - low[0], high[1] - points[:, 1]], axis=1) * scale + MARGIN
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in at.tolist())

    width, height = (high - low) * scale + 2.0 * MARGIN
    parts = [f'<polygon points="{spots(points)}" fill="{STEEL}33" stroke="{STEEL}"/>' for points in teeth]
    parts += [f'<polyline points="{spots(p)}" fill="none" stroke="{RUBBER}" stroke-width="3"/>' for p in bars]
    thick = max(0.25 * drive.chain.pitch * scale, 1.5)
    parts += [
        f'<polyline points="{spots(points)}" fill="none" stroke="{color}" stroke-width="{min(thick, 4.0):.1f}"/>'
        for points, color in chain
    ]
    parts += _names(
        drive, ((center - low) * [1.0, -1.0] * scale + [0.0, (high - low)[1] * scale] for center in centers)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img">{"".join(parts)}</svg>'
    )


def _names(drive: Drive, places: Iterable[Array]) -> list[str]:
    style = (
        'text-anchor="middle" dominant-baseline="middle" font-size="11" font-family="sans-serif" fill="currentColor"'
    )
    return [
        f'<text x="{x + MARGIN:.1f}" y="{y + MARGIN:.1f}" {style}>{escape(sprocket.name)}</text>'
        for sprocket, (x, y) in zip(drive.sprockets, places, strict=True)
    ]


class Markup(str):
    """A text that is HTML already."""


def html(thing: Any) -> str:
    """A drive, run or trajectory as HTML.

    Raises:
        TypeError: anything else.
    """
    if isinstance(thing, Drive):
        return _drive(thing)
    if isinstance(thing, Run):
        return _run(thing)
    if isinstance(thing, Trajectory):
        return _trajectory(thing)
    raise TypeError(f"{type(thing).__name__}: allowed are Drive, Run, Trajectory")


def table_html(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """A table; cells are escaped, but for those that are `Markup`."""

    def line(cells: Sequence[str], tag: str) -> str:
        words = [cell if isinstance(cell, Markup) else escape(cell) for cell in cells]
        sides = ["left", *["right"] * (len(words) - 1)]
        inner = (f'<{tag} style="text-align:{side}">{w}</{tag}>' for w, side in zip(words, sides, strict=True))
        return f"<tr>{''.join(inner)}</tr>"

    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "".join(line(row, "td") for row in rows)
    return f"<table>{title}<thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def status_html(status: str) -> Markup:
    """A status in its color."""
    return Markup(f'<b style="color:{COLORS.get(status, "inherit")}">{escape(status)}</b>')


def value_text(value: Any, unit: str) -> str:
    """A value with a unit that fits its size: 42.2 kN."""
    if value is None:
        return "-"
    if isinstance(value, bool | str):
        return str(value)
    if not math.isfinite(value):
        return str(value)
    shown, factor = display_unit(unit, value)
    return f"{factor * value:.4g}" + ("" if shown in ("", "1") else f" {shown}")


def _beside(left: str, right: str) -> str:
    return f'<div style="display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start">{left}<div>{right}</div></div>'


def _picture(drive: Drive) -> str:
    if drive.chains:
        return "".join(_picture(ring.drive) for ring in rings_of(drive))
    try:
        return drive_svg(drive)
    except WarpchainError as error:
        return f"<p>{escape(str(error))}</p>"


def _drive(drive: Drive) -> str:
    if drive.chains:
        return "".join(f"<p>{escape(ring.name)}</p>{_drive(ring.drive)}" for ring in rings_of(drive))
    chain = drive.chain
    size = f"{chain.size}, " if chain.size else ""
    about = f"{chain.links} links of {1e3 * chain.pitch:g} mm ({size}{value_text(chain.mass, 'kg')} a roller)"
    rows = []
    for s, sprocket in enumerate(drive.sprockets):
        travel, load = sprocket.prescribed, sprocket.load
        does = "turns freely"
        if travel is not None:
            does = f"driven, up to {travel.top_speed * 30.0 / math.pi:.4g} rpm"
        elif load is not None:
            does = f"load {value_text(load.torque, 'N m')}"
        radius = value_text(drive.pitch_radius(s), "m")
        rows.append([sprocket.name, str(sprocket.teeth), radius, does])
    run = f"{drive.run.duration:g} s, {drive.run.integrator}, step {drive.run.step}"
    right = table_html(("sprocket", "teeth", "pitch radius", ""), rows, about) + f"<p>{escape(run)}</p>"
    return _beside(_picture(drive), right)


def _first_metrics(drive: Drive) -> list[str]:
    """The metrics to show first."""
    chains = [f"{chain.name}." for chain in drive.chains] or [""]
    names = [*(f"{chain}tension_{of}" for chain in chains for of in ("mean", "max")), "efficiency"]
    for sprocket in drive.sprockets:
        names += [f"{sprocket.name}.speed_mean", f"{sprocket.name}.moment_mean", f"{sprocket.name}.force_max"]
    names += [f"{guide.name}.force_max" for guide in drive.guides]
    return [*names, *(f"{strand}.displacement_rms" for strand in drive.strand_names), "energy_residual_relative"]


def _run(run: Run) -> str:
    rows, names = run.metrics.to_pylist(), run.metrics.column_names
    info = f"{len(rows)} variants" if len(rows) != 1 else "1 variant"
    about = f"{info}, {len(run)} recorded; {run.info.device}, {run.info.precision}, {run.info.wall_time:.1f} s"
    shown = [name for name in _first_metrics(run.drives[0]) if name in names]
    if len(rows) == 1:
        held = [[title_of(name), value_text(rows[0][name], unit_of(name))] for name in shown]
        status = str(rows[0].get("status", ""))
        held.insert(0, ["status", status_html(status)])
        if rows[0].get("reason"):
            held.insert(1, ["why", str(rows[0]["reason"])])
        right = table_html(("metric", "value"), held, about)
    else:
        shown = shown[:6]
        held = [
            [
                str(v),
                status_html(str(row.get("status", ""))),
                *(value_text(row[name], unit_of(name)) for name in shown),
            ]
            for v, row in zip(run.numbers, rows[:ROWS], strict=False)
        ]
        right = table_html(("variant", "status", *shown), held, about)
        if len(rows) > ROWS:
            right += f"<p>and {len(rows) - ROWS} more: run.metrics has all {len(names)} columns</p>"
    return _beside(_picture(run.drives[0]), right)


def _trajectory(trajectory: Trajectory) -> str:
    frames = len(trajectory.time)
    spell = f"{trajectory.time[0]:g} to {trajectory.time[-1]:g} s" if frames else "empty"
    rows = [
        [name, CHANNEL[name].unit, " x ".join(map(str, values.shape)), str(values.dtype)]
        for name, values in trajectory.channels().items()
    ]
    right = table_html(("channel", "unit", "shape", "type"), rows, f"{frames} frames, {spell}")
    moving = trajectory.position is not None and frames > 0
    chains = chain_trajectories(trajectory).values()
    picture = "".join(frame_svg(chain, frames - 1) for chain in chains) if moving else _picture(trajectory.drive)
    return _beside(picture, right)
