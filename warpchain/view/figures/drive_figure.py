"""The picture of a drive: its parts in place, and forces on the chain."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.assembly import assemble_chain
from warpchain.drive import Drive
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model
from warpchain.results.chains import chain_trajectories
from warpchain.results.nearest_parts import contact_force_vectors
from warpchain.results.outlines import (
    DrivePose,
    OutlinePart,
    chain_outline,
    guide_arm_tensioner_parts,
    pose_at_frame,
    pose_at_start,
    teeth_parts,
    turn_points,
)
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import run_line
from warpchain.view.figures.label_placement import move_labels
from warpchain.view.palette import tension_colormap, tension_scale_top

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.floating]

STEEL, CHAIN, RUBBER = "0.45", "tab:blue", "tab:brown"
PART_STYLES: dict[str, dict[str, Any]] = {
    "teeth": {"fc": "0.88", "ec": STEEL, "lw": 0.7, "zorder": 0},
    "guide": {"color": RUBBER, "lw": 3, "zorder": 2},
    "arm": {"color": STEEL, "lw": 1.5, "zorder": 1},
    "spring": {"color": STEEL, "lw": 1.0, "zorder": 1},
    "housing": {"fc": "0.88", "ec": STEEL, "lw": 0.7, "zorder": 1},
    "plunger": {"fc": "0.65", "ec": STEEL, "lw": 0.7, "zorder": 0.5},
}
"""Styles of a drive picture's parts by kind; a face closes the outline."""


def drive_figure(
    of: Drive | Trajectory, frame: int | None = None, top: float | None = None, size: float = 8.5
) -> Figure:
    """Picture of a drive at its start, or of a trajectory at one instant with tensions and contact forces.

    Args:
        frame: None is three quarters through.
        top: tension at the red end of the color scale [N].
        size: of the drive's longer side [in].

    Raises:
        DriveError: a drive whose chain has no path.
        SimulationError: a trajectory without positions.
    """
    from warpchain.view.figures.plain_figure import PlainFigure

    arrows: list[Array] = []
    largest = 0.0
    if isinstance(of, Drive):
        title = "Layout at t = 0"
        chains = [_chain_at_start(chain) for chain in Model(of).chains]
    else:
        require_channels(of, "position")
        f = range(len(of.time))[len(of.time) * 3 // 4 if frame is None else frame]
        title = f"At {of.time[f]:.4g} s"
        each = list(chain_trajectories(of).values())
        chains = [
            _PosedChain(one.model, pose_at_frame(one, f), require_channels(one, "position")[0][f]) for one in each
        ]
        arrows, largest = _contact_force_arrows(each, f)
    line = np.concatenate([chain.line for chain in chains])
    reach = 0.12 * float(np.ptp(line, axis=0).max()) / largest if largest > 0.0 else 0.0
    parts = [
        [*teeth_parts(chain.model, chain.pose, 4), *guide_arm_tensioner_parts(chain.model, chain.pose)]
        for chain in chains
    ]
    travel = [arm_stop_lines(chain.model, chain.pose) if isinstance(of, Drive) else [] for chain in chains]
    points: list[Array] = [part.points for of_chain in parts for part in of_chain]
    points += [reached for of_chain in travel for reached in of_chain]
    low, high = _drawing_corners([line, *points, *(line + reach * force for force in arrows)])
    span = high - low
    unit, factor = display_unit("m", span)
    figure = PlainFigure(figsize=_figure_size(float(span[1] / span[0]), size), layout="constrained")
    axis = figure.subplots()
    for chain, mine, reached in zip(chains, parts, travel, strict=True):
        draw_parts(axis, chain.model, chain.pose, mine, factor)
        if isinstance(of, Drive):
            draw_dimensions(axis, chain.model, chain.pose, reached, factor)
    lines = [chain.line for chain in chains]
    if isinstance(of, Trajectory) and of.tension is not None:
        draw_tension_chain(axis, lines, of.tension[f], tension_scale_top([of]) if top is None else top, factor)
    else:
        for loop in lines:
            axis.plot(*factor * np.vstack([loop, loop[:1]]).T, color=CHAIN, lw=2, zorder=3)
    if arrows:
        draw_contact_arrows(axis, line, arrows, reach, factor)
        word, share = display_unit("N", largest)
        axis.plot([], [], " ", label=f"longest arrow {share * largest:.3g} {word}")
        title = title.replace("At", "Forces on the chain at")
        figure.legend(loc="outside lower center", ncols=1 if span[1] > span[0] else 3, fontsize=8, frameon=False)
    axis.set(xlim=factor * np.array([low[0], high[0]]), ylim=factor * np.array([low[1], high[1]]), aspect="equal")
    axis.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
    words = textwrap.fill(run_line(of), int(TITLE_LETTERS * figure.get_figwidth()))
    axis.set_title(f"{title}\n{words}", fontsize=11)
    if isinstance(of, Drive):
        move_labels(axis, factor * np.concatenate([chain.pose.center for chain in chains]))
    return figure


TITLE_LETTERS = 9.0
"""Letters of a drive picture's title in an inch of width."""


class _PosedChain(NamedTuple):
    """A chain to draw: model, bodies' pose, and rollers' centers [m]."""

    model: ChainModel
    pose: DrivePose
    line: Array


def _chain_at_start(model: ChainModel) -> _PosedChain:
    """A drive's chain to draw along its path, at the start."""
    path = chain_path(model)
    return _PosedChain(model, pose_at_start(model, path), chain_outline(model, path))


def draw_parts(axis: Any, model: ChainModel, pose: DrivePose, parts: list[OutlinePart], factor: float) -> None:
    """Draws a drive's parts and names into a picture, `factor` units a meter."""
    from matplotlib.patheffects import withStroke

    halo: Any = {"path_effects": [withStroke(linewidth=2.0, foreground="white")], "zorder": 5}
    middle = factor * float(np.mean(pose.center[:, 0]))
    for part in parts:
        style, points = PART_STYLES[part.kind], factor * part.points
        (axis.fill if "fc" in style else axis.plot)(*points.T, **style)
        below: Any = {"xytext": (0, -4), "textcoords": "offset points", "va": "top", "fontsize": 8, **halo}
        if part.kind == "guide":
            end = min(points[[0, -1]], key=lambda end: end[1])
            side = "left" if end[0] < middle else "right"  # inward
            axis.annotate(part.name, end, color=RUBBER, ha=side, **below)
        elif part.kind == "housing":
            axis.annotate(part.name, (points[:, 0].mean(), points[:, 1].min()), color=STEEL, ha="center", **below)
    for arm in model.arms:
        axis.plot(*np.multiply(factor, arm.pivot), "o", color=STEEL, ms=5, zorder=2)
    for sprocket, center in zip(model.sprockets, factor * pose.center, strict=True):
        below = {"xytext": (0, -TEXT_SPACE * text_count_at(axis, center)), "textcoords": "offset points"}
        axis.annotate(sprocket.name, center, fontsize=9, ha="center", va="center", **below, **halo)


def draw_tension_chain(axis: Any, chains: list[Array], tension: Array, top: float, factor: float) -> None:
    """Draws chains' links in the colors of tensions up to `top` [N]."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    newton, scale = display_unit("N", top)
    links = [link for line in chains for link in factor * np.stack([line, np.roll(line, -1, axis=0)], axis=1)]
    chain = LineCollection(links, cmap=tension_colormap(), norm=Normalize(0.0, scale * top), lw=3, zorder=3)
    chain.set_array(scale * tension)
    axis.add_collection(chain)
    axis.figure.colorbar(chain, ax=axis, label=f"link tension [{newton}]", shrink=0.6, extend="both")


def draw_contact_arrows(axis: Any, position: Array, arrows: list[Array], reach: float, factor: float) -> None:
    """Draws contact forces on rollers into a picture, `reach` [m] a newton."""
    kinds = (("black", "contact with sprockets"), ("tab:red", "contact with guide-bars"))
    straight: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002, "zorder": 4}
    for force, (color, label) in zip(arrows, kinds, strict=True):
        pressed = force.any(axis=1)
        if pressed.any():
            axis.quiver(*factor * position[pressed].T, *(factor * reach * force[pressed]).T, color=color, **straight)
            axis.plot([], [], color=color, lw=1.5, label=label)


def _contact_force_arrows(chains: list[Trajectory], f: int) -> tuple[list[Array], float]:
    """Contact forces (N, 2) [N] at a frame, of sprockets and of guides, and the largest."""
    needed = "sprocket_force", "guide_force", "sprocket_angle", "sprocket_center"
    if any(getattr(chain, channel) is None for chain in chains for channel in needed):
        return [], 0.0
    each = [contact_force_vectors(chain.at(slice(f, f + 1))) for chain in chains]
    arrows: list[Array] = [np.concatenate([forces[kind][0] for forces in each]) for kind in range(2)]
    return arrows, max(float(np.hypot(*force.T).max()) for force in arrows)


def _drawing_corners(lines: list[Array]) -> tuple[Array, Array]:
    """Lower left and upper right corner [m] of a drive's picture."""
    points = np.concatenate(lines)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.04 * float((high - low).max())
    return low - room, high + room


def _figure_size(tall: float, size: float) -> tuple[float, float]:
    """Width and height [in] of a figure of a drawing `tall` times as high as wide."""
    wide = float(np.clip(size / max(tall, 1e-9), 3.2, size + 0.5))
    return wide + 1.7, min(wide * tall, size + 1.0) + (1.9 if tall > 1.0 else 1.4)


TEXT_SPACE = 17.0
"""Height [pt] of a text at a sprocket in a drive's picture."""
TRAVEL_STYLE: dict[str, Any] = {"color": "0.3", "lw": 0.7, "ls": (0, (4, 3)), "zorder": 1.5}


def draw_dimensions(axis: Any, model: ChainModel, pose: DrivePose, travel: list[Array], factor: float) -> None:
    """Writes teeth, radii, wrap angles, links and arm angles into a drive's picture."""
    from matplotlib.patheffects import withStroke

    path = chain_path(model)
    middle = np.mean(pose.center, axis=0)

    def write_at(text: str, at: Any, x: float, y: float, **more: Any) -> None:
        """Writes a text at (x, y) [pt] from a point of the drive's picture."""
        halo = [withStroke(linewidth=2.0, foreground="white")]
        place: Any = {"xytext": (x, y), "textcoords": "offset points", "ha": "center", "va": "center"} | more
        axis.annotate(text, factor * np.asarray(at), fontsize=7, zorder=5, path_effects=halo, **place)

    for s, (sprocket, center) in enumerate(zip(model.sprockets, pose.center, strict=True)):
        wrap = math.degrees(float(path.wrap_angle[s]))
        text = f"{sprocket.teeth} teeth, r {_length_text(model.pitch_radius(s))}\nwrap {wrap:.1f}\N{DEGREE SIGN}"
        write_at(text, center, 0.0, -7.0 - TEXT_SPACE * (text_count_at(axis, factor * center) - 1), va="top")
    for g in range(len(model.guides)):
        face, a = model.profile(g), model.arm_of(g)
        radii = dict.fromkeys(_length_text(1.0 / abs(piece.curvature)) for piece in face.face if piece.curvature)
        place, heading = face.at(0.3 * face.face_length)
        at = np.array(place)
        if a is not None:
            at, heading = turn_points(at, model.arms[a].pivot, pose.arm[a]), heading + pose.arm[a]
        x, y = math.sin(heading), -math.cos(heading)  # to the right, where no chain is
        text = f"R {', '.join(radii)}" if radii else _length_text(face.face_length)
        write_at(text, at, 5.0 * x, 5.0 * y, color="tab:brown", ha="left" if x > 0.0 else "right")
    for k, text in enumerate(_strand_texts(model, path.strand_length / path.pitch)):
        mid = 0.5 * (path.strand_start[k] + path.strand_end[k])
        x, y = (middle - mid) / max(float(np.hypot(*(middle - mid))), 1e-12)
        write_at(text, mid, 24.0 * x, 10.0 * y, color="tab:blue")
    for arm, angle in zip(model.arms, pose.arm, strict=True):
        stops = "no stops" if arm.stops is None else "{:+g} to {:+g}\N{DEGREE SIGN}".format(*arm.stops)
        away = 1.0 if arm.pivot[0] > middle[0] else -1.0
        text = f"{arm.name} at {math.degrees(angle):+.1f}\N{DEGREE SIGN}\n{stops}"
        write_at(text, arm.pivot, 7.0 * away, 0.0, color="0.3", ha="left" if away > 0.0 else "right")
    for points in travel:
        axis.plot(*factor * points.T, **TRAVEL_STYLE)


def arm_stop_lines(model: ChainModel, pose: DrivePose) -> list[Array]:
    """Lines [m] of each arm and its guides, turned to either stop."""
    lines: list[Array] = []
    for a, arm in enumerate(model.arms):
        own = {arm.name, *(model.guides[g].name for g in model.guides_of(a))}
        for stop in arm.stops or ():
            angles = np.array(pose.arm, dtype=float)
            angles[a] = math.radians(stop)
            moved = guide_arm_tensioner_parts(model, pose._replace(arm=angles))
            lines += [part.points for part in moved if part.kind in ("arm", "guide") and part.name in own]
    return lines


def text_count_at(axis: Any, point: Any) -> int:
    """Number of texts that a drive's picture has at a point."""
    return sum(np.allclose(text.xy, point) for text in axis.texts)


def _strand_texts(model: ChainModel, pitches: Any) -> list[str]:
    """Words for each strand's number of links, or pitches where the chain does not fit."""
    try:
        return [f"{links} links" for links in assemble_chain(model).strand_links]
    except DriveError:
        return [f"{length:.2f} pitches" for length in pitches]


def _length_text(meters: float) -> str:
    """A length [m] as a picture's text with a fitting unit."""
    unit, factor = display_unit("m", meters)
    return f"{factor * meters:.4g} {unit}"
