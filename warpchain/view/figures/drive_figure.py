"""The picture of a drive: its parts in place, and forces on the chain."""

from __future__ import annotations

import math
import textwrap
from contextlib import suppress
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
    chain_line,
    chain_outline,
    guide_arm_tensioner_parts,
    pose_at_frame,
    pose_at_start,
    teeth_parts,
    turn_points,
)
from warpchain.results.plate_outlines import pin_outlines, plate_outlines
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import CHAIN_COLORS, FIGURE_STYLE, LEGEND_SIZE, TICK_SIZE, run_line
from warpchain.view.figures.label_placement import Label, place_labels
from warpchain.view.palette import tension_colormap, tension_scale_top

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.floating]

STEEL, RUBBER, ARROW = "0.45", "tab:brown", "0.45"
PART_STYLES: dict[str, dict[str, Any]] = {
    "teeth": {"fc": "0.88", "ec": STEEL, "lw": 0.7, "zorder": 0},
    "guide": {"color": RUBBER, "lw": 3, "zorder": 2},
    "arm": {"color": STEEL, "lw": 1.5, "zorder": 1},
    "spring": {"color": STEEL, "lw": 1.0, "zorder": 1},
    "housing": {"fc": "0.88", "ec": STEEL, "lw": 0.7, "zorder": 1},
    "plunger": {"fc": "0.65", "ec": STEEL, "lw": 0.7, "zorder": 0.5},
    "plate": {"facecolors": ("0.8", "0.7"), "edgecolors": STEEL, "linewidths": 0.5, "zorder": 2.8},
    "pin": {"facecolors": "white", "edgecolors": STEEL, "linewidths": 0.5, "zorder": 2.85},
}
"""Styles of a drive picture's parts, by kind."""


def drive_figure(
    of: Drive | Trajectory, frame: int | None = None, top: float | None = None, size: float = 8.5
) -> Figure:
    """Picture of a drive at its start, or of a trajectory at an instant with tensions and contact forces.

    Args:
        frame: None is three quarters through.
        top: tension at the red end of the color scale [N].
        size: of the drive's longer side [in].

    Raises:
        DriveError: a drive whose chain has no path.
        SimulationError: a trajectory without positions.
    """
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
    lines = [chain.line for chain in chains]
    line = np.concatenate(lines)
    reach = 0.12 * float(np.ptp(line, axis=0).max()) / largest if largest > 0.0 else 0.0
    parts = [
        [*teeth_parts(chain.model, chain.pose, 4), *guide_arm_tensioner_parts(chain.model, chain.pose)]
        for chain in chains
    ]
    travel = [arm_stop_lines(chain.model, chain.pose) if isinstance(of, Drive) else [] for chain in chains]
    points: list[Array] = [part.points for of_chain in parts for part in of_chain]
    points += [reached for of_chain in travel for reached in of_chain]
    low, high = _drawing_corners([line, *points, *(line + reach * force for force in arrows)])
    unit, factor = display_unit("m", high - low)
    tension = None if isinstance(of, Drive) or of.tension is None else of.tension[f]
    colored = tension is not None
    title = title.replace("At", "Forces on the chain at") if arrows else title
    figure, axis = _drawing_figure(factor * low, factor * high, size, f"{title}\n{run_line(of)}", colored)
    axis.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
    labels: list[Label] = []
    for chain, mine, reached, color in zip(chains, parts, travel, _chain_colors(len(chains)), strict=True):
        own_color = color if len(chains) > 1 else None
        named = draw_parts(axis, chain.model, chain.pose, mine, factor, own_color)
        if isinstance(of, Drive):
            draw_dimensions(axis, chain.model, chain.pose, reached, factor, named, own_color)
        labels += named.values()
        loop = factor * chain_line(chain.model, chain.line)
        plates = chain.model.chain.is_silent and len(chain.line) == chain.model.chain.links
        if plates:
            draw_plates(axis, chain.model, chain.line, factor)
        if len(chains) > 1 or not colored:
            width = 5.5 if colored else 0.8 if plates else 2
            axis.plot(*loop.T, color=color, lw=width, zorder=2.9, label=chain.model.name or None)
    if isinstance(of, Trajectory) and tension is not None:
        drawn = [chain_line(chain.model, chain.line) for chain in chains]
        draw_tension_chain(axis, drawn, tension, tension_scale_top([of]) if top is None else top, factor)
    draw_rotations(axis, of if isinstance(of, Drive) else of.drive, chains, factor)
    if arrows:
        draw_contact_arrows(axis, line, arrows, reach, factor)
        word, share = display_unit("N", largest)
        axis.plot([], [], " ", label=f"longest arrow {share * largest:.3g} {word}")
    _draw_drawing_legend(figure, axis)
    place_labels(axis, labels)
    return figure


def _chain_colors(count: int) -> list[str]:
    """Colors of a drive's chains in its picture."""
    return [CHAIN_COLORS[k % len(CHAIN_COLORS)] for k in range(count)]


def _drawing_figure(low: Array, high: Array, size: float, title: str, has_bar: bool) -> tuple[Figure, Any]:
    """Empty figure and axes for a drive's picture from corner to corner, `size` [in] the longer side."""
    from matplotlib import rc_context

    from warpchain.view.figures.plain_figure import PlainFigure

    span = np.maximum(high - low, 1e-12)
    inches = np.maximum(span * size / span.max(), LEAST_SIDE)
    scale = float((span / inches).max())  # units an inch
    middle, half = 0.5 * (low + high), 0.5 * scale * inches
    letters = int(TITLE_LETTERS * (inches[0] + SIDES[0] + 0.3))
    words = "\n".join(textwrap.fill(part, letters) for part in title.split("\n"))
    left, right = SIDES[0], SIDES[1] if has_bar else 0.3
    below, above = LEGEND_STRIP, 0.24 + 0.19 * (words.count("\n") + 1)
    width, height = inches[0] + left + right, inches[1] + below + above
    with rc_context(FIGURE_STYLE):
        figure = PlainFigure(figsize=(width, height))
        axis = figure.add_axes((left / width, below / height, inches[0] / width, inches[1] / height), aspect="equal")
    axis.grid(False)
    axis.tick_params(labelsize=TICK_SIZE)
    axis.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    axis.set_title(words, fontsize=11)
    return figure, axis


def _draw_drawing_legend(figure: Figure, axis: Any) -> None:
    """Draws the legend below a drive's picture."""
    handles, words = axis.get_legend_handles_labels()
    if not words:
        return
    width = figure.get_figwidth()
    each = 0.45 + 0.0085 * LEGEND_SIZE * max(map(len, words))
    columns = max(1, min(len(words), int(width / each)))
    rows = -(-len(words) // columns)
    extra = max(0.0, 0.18 * rows + 0.6 - LEGEND_STRIP)
    if extra:
        height = figure.get_figheight()
        box = axis.get_position()
        figure.set_figheight(height + extra)
        for one in figure.axes:
            box = one.get_position()
            ends = [(end * height + extra) / (height + extra) for end in (box.y0, box.y1)]
            one.set_position((box.x0, ends[0], box.width, ends[1] - ends[0]))
    figure.legend(
        handles, words, loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=columns, fontsize=LEGEND_SIZE,
        frameon=False, borderaxespad=0.15, columnspacing=1.2, labelspacing=0.25,
    )  # fmt: skip


TITLE_LETTERS = 9.0
"""Letters of a drive picture's title an inch."""
SIDES = (0.8, 1.1)
"""Room left of a drive's picture, and right with a color bar [in]."""
LEGEND_STRIP = 0.85
"""Room below a drive's picture for axis and legend [in]."""
LEAST_SIDE = np.array([3.2, 1.6])
"""Least width and height of a drive's picture [in]."""


class _PosedChain(NamedTuple):
    """Chain of a drive's picture: model, bodies' pose, rollers' centers [m]."""

    model: ChainModel
    pose: DrivePose
    line: Array


def _chain_at_start(model: ChainModel) -> _PosedChain:
    """Chain of a drive's picture at the start, along its path."""
    path = chain_path(model)
    line = chain_outline(model, path)
    if model.chain.is_silent:
        with suppress(DriveError):
            line = assemble_chain(model).position
    return _PosedChain(model, pose_at_start(model, path), line)


def draw_plates(axis: Any, model: ChainModel, position: Array, factor: float) -> None:
    """Draws plates and pins of a silent chain into a drive's picture, at places (N, 2) [m]."""
    from matplotlib.collections import PolyCollection

    plates = plate_outlines(model, position)
    for row, behind in ((0, 0.02), (1, 0.0)):
        style = PART_STYLES["plate"]
        own = {"facecolors": style["facecolors"][row], "zorder": style["zorder"] - behind}
        axis.add_collection(PolyCollection(list(factor * plates[row::2]), **style | own))
    axis.add_collection(PolyCollection(list(factor * pin_outlines(model, position)), **PART_STYLES["pin"]))


def draw_parts(
    axis: Any,
    model: ChainModel,
    pose: DrivePose,
    parts: list[OutlinePart],
    factor: float,
    color: str | None = None,
) -> dict[str, Label]:
    """Draws parts and names into a drive's picture, `factor` units a meter; returns labels by name.

    Args:
        color: of the sprockets' outlines and names; None is steel and black.
    """
    from matplotlib.patheffects import withStroke

    halo: Any = {"path_effects": [withStroke(linewidth=2.0, foreground="white")], "zorder": 5}
    middle = factor * float(np.mean(pose.center[:, 0]))
    labels: dict[str, Label] = {}
    for part in parts:
        style, points = PART_STYLES[part.kind], factor * part.points
        if part.kind == "teeth" and color is not None:
            style = style | {"ec": color, "lw": 1.1}
        (axis.fill if "fc" in style else axis.plot)(*points.T, **style)
        below: Any = {"xytext": (0, -4), "textcoords": "offset points", "va": "top", "fontsize": 8, **halo}
        if part.kind == "guide":
            end = min(points[[0, -1]], key=lambda end: end[1])
            side = "left" if end[0] < middle else "right"  # inward
            labels[part.name] = Label([axis.annotate(part.name, end, color=RUBBER, ha=side, **below)])
        elif part.kind == "housing":
            at = (points[:, 0].mean(), points[:, 1].min())
            labels[part.name] = Label([axis.annotate(part.name, at, color=STEEL, ha="center", **below)])
    for arm in model.arms:
        axis.plot(*np.multiply(factor, arm.pivot), "o", color=STEEL, ms=5, zorder=2)
    for s, (sprocket, center) in enumerate(zip(model.sprockets, factor * pose.center, strict=True)):
        below = {"xytext": (0, -TEXT_SPACE * text_count_at(axis, center)), "textcoords": "offset points"}
        own = {"color": color or "black", "fontsize": 9, "ha": "center", "va": "center"}
        text = axis.annotate(sprocket.name, center, **own, **below, **halo)
        labels[sprocket.name] = Label([text], factor * model.pitch_radius(s))
    return labels


def draw_rotations(axis: Any, drive: Drive, chains: list[_PosedChain], factor: float) -> None:
    """Draws shafts' ways of turning into a drive's picture, and marks driver and loads."""
    sprockets = {
        sprocket.name: (sprocket, factor * center, factor * chain.model.pitch_radius(s))
        for chain in chains
        for s, (sprocket, center) in enumerate(zip(chain.model.sprockets, chain.pose.center, strict=True))
        if not sprocket.is_end
    }
    driver = drive.sprockets[drive.driver].name
    loaded = {shaft.name for shaft in drive.shafts if shaft.load is not None}
    driven = {name for name, (part, *_) in sprockets.items() if part.load is not None or part.shaft in loaded}
    driven = (driven or set(sprockets)) - {driver}
    mark: Any = {"ms": 6.5, "color": "0.15", "zorder": 2.5}
    turning: list[Array] = []
    for name, (sprocket, center, _) in sprockets.items():
        if not any(np.allclose(center, one) for one in turning):
            turning.append(center)
            least = min(radius for _, other, radius in sprockets.values() if np.allclose(center, other))
            _draw_rotation(axis, center, 0.6 * least, sprocket.sign)
        if name == driver:
            axis.plot(*center, "o", **mark)
        elif name in driven:
            axis.plot(*center, "o", mfc="white", **mark)
    axis.plot([], [], "o", label="driver", **mark)
    if driven:
        axis.plot([], [], "o", mfc="white", label="driven", **mark)


def _draw_rotation(axis: Any, center: Array, radius: float, sign: float) -> None:
    """Draws an arrow around a sprocket into a drive's picture, counter-clockwise for `sign` +1."""
    angle = math.radians(90.0) + sign * np.radians(np.linspace(-50.0, 50.0, 21))
    arc = center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    axis.plot(*arc.T, color=ARROW, lw=1.1, zorder=1)
    way, tip = np.diff(arc[-2:], axis=0)[0], arc[-1]
    way = way / np.hypot(*way)
    across, size = np.array([-way[1], way[0]]), 0.22 * radius
    axis.fill(*np.array([tip + size * way, tip + 0.6 * size * across, tip - 0.6 * size * across]).T, fc=ARROW, lw=0)


def draw_tension_chain(axis: Any, chains: list[Array], tension: Array, top: float, factor: float) -> None:
    """Draws chains' lines into a drive's picture in the colors of tensions up to `top` [N]."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    newton, scale = display_unit("N", top)
    links = [link for line in chains for link in factor * np.stack([line[:-1], line[1:]], axis=1)]
    chain = LineCollection(links, cmap=tension_colormap(), norm=Normalize(0.0, scale * top), lw=3, zorder=3)
    chain.set_array(scale * tension)
    axis.add_collection(chain)
    place, width = axis.get_position(), axis.figure.get_figwidth()
    box = (place.x1 + 0.18 / width, place.y0 + 0.15 * place.height, 0.18 / width, 0.7 * place.height)
    bar = axis.figure.colorbar(chain, cax=axis.figure.add_axes(box), extend="both")
    bar.set_label(f"link tension [{newton}]", fontsize=9.5)
    bar.ax.tick_params(labelsize=TICK_SIZE)


def draw_contact_arrows(axis: Any, position: Array, arrows: list[Array], reach: float, factor: float) -> None:
    """Draws contact forces into a drive's picture as arrows, `reach` [m] a newton."""
    kinds = (("black", "contact with sprockets"), ("tab:red", "contact with guide-bars"))
    straight: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002, "zorder": 4}
    for force, (color, label) in zip(arrows, kinds, strict=True):
        pressed = force.any(axis=1)
        if pressed.any():
            axis.quiver(*factor * position[pressed].T, *(factor * reach * force[pressed]).T, color=color, **straight)
            axis.plot([], [], color=color, lw=1.5, label=label)


def _contact_force_arrows(chains: list[Trajectory], f: int) -> tuple[list[Array], float]:
    """Contact forces (N, 2) [N] in a frame, of sprockets and guides, and the largest."""
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
    room = 0.07 * float((high - low).max())
    return low - room, high + room


TEXT_SPACE = 17.0
"""Height of a text at a sprocket [pt]."""
TRAVEL_STYLE: dict[str, Any] = {"color": "0.3", "lw": 0.7, "ls": (0, (4, 3)), "zorder": 1.5}


def draw_dimensions(
    axis: Any,
    model: ChainModel,
    pose: DrivePose,
    travel: list[Array],
    factor: float,
    labels: dict[str, Label],
    color: str | None = None,
) -> None:
    """Writes teeth, radii, wrap angles, links and arm angles into a drive's picture.

    Args:
        labels: by name; a sprocket's dimensions are added below its name, others by themselves.
        color: of the strands' texts; None is blue.
    """
    path = chain_path(model)

    def write_at(text: str, at: Any, **more: Any) -> Any:
        """Writes a text into a drive's picture, to be placed; returns it."""
        return axis.annotate(
            text, factor * np.asarray(at), xytext=(0.0, 0.0), textcoords="offset points", fontsize=7, zorder=5, **more
        )

    for s, (sprocket, center) in enumerate(zip(model.sprockets, pose.center, strict=True)):
        wrap = math.degrees(float(path.wrap_angle[s]))
        text = f"{sprocket.teeth} teeth, r {_length_text(model.pitch_radius(s))}\nwrap {wrap:.1f}\N{DEGREE SIGN}"
        if sprocket.is_end:
            text = "end" if sprocket.mass is None else f"end, {sprocket.mass:g} kg"
        texts = labels[sprocket.name].texts
        texts.append(write_at(text, center, color=texts[0].get_color()))
    for g, guide in enumerate(model.guides):
        face, a = model.profile(g), model.arm_of(g)
        radii = dict.fromkeys(_length_text(1.0 / abs(piece.curvature)) for piece in face.face if piece.curvature)
        place, _ = face.at(0.3 * face.face_length)
        at = np.array(place)
        if a is not None:
            at = turn_points(at, model.arms[a].pivot, pose.arm[a])
        text = f"R {', '.join(radii)}" if radii else _length_text(face.face_length)
        labels[f"{guide.name}.face"] = Label([write_at(text, at, color=RUBBER)])
    for k, text in enumerate(_strand_texts(model, path.strand_length / path.pitch)):
        mid = 0.5 * (path.strand_start[k] + path.strand_end[k])
        labels[f"{model.name}.strand {k}"] = Label([write_at(text, mid, color=color or "tab:blue")])
    for arm, angle in zip(model.arms, pose.arm, strict=True):
        stops = "no stops" if arm.stops is None else "{:+g} to {:+g}\N{DEGREE SIGN}".format(*arm.stops)
        text = f"{arm.name} at {math.degrees(angle):+.1f}\N{DEGREE SIGN}\n{stops}"
        labels[f"{arm.name}.arm"] = Label([write_at(text, arm.pivot, color="0.3")])
    for points in travel:
        axis.plot(*factor * points.T, **TRAVEL_STYLE)


def arm_stop_lines(model: ChainModel, pose: DrivePose) -> list[Array]:
    """Lines [m] of a drive's arms and their guides, turned to either stop."""
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
    """Number of texts at a point of a drive's picture."""
    return sum(np.allclose(text.xy, point) for text in axis.texts)


def _strand_texts(model: ChainModel, pitches: Any) -> list[str]:
    """Texts of strands in a drive's picture: number of links, or of pitches."""
    try:
        found = [f"{links} links" for links in assemble_chain(model).strand_links]
    except DriveError:
        found = [f"{length:.2f} pitches" for length in pitches]
    return found[: len(model.strand_names)]


def _length_text(meters: float) -> str:
    """Text of a length [m] in a drive's picture, in a fitting unit."""
    unit, factor = display_unit("m", meters)
    return f"{factor * meters:.4g} {unit}"
