"""Figures of modes: shapes drawn on the drive, and the Campbell diagram."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.results.outlines import DrivePose, OutlinePart, chain_line, guide_arm_tensioner_parts
from warpchain.view.figures.figure_style import LINE_COLORS, rpm_of_speed, strand_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from warpchain.modal.campbell import Campbell
    from warpchain.modal.eigenmodes import Modes
    from warpchain.modal.matrices import Array
    from warpchain.model import ChainModel


def carried_part_lines(model: ChainModel, bodies: Array) -> list[Array]:
    """Lines (P, 2) [m] of arms and of what they carry."""
    return [part.points for part in _drive_parts(model, bodies) if part.carried]


def fixed_part_lines(model: ChainModel) -> list[Array]:
    """Lines (P, 2) [m] of guides and housings."""
    bodies = np.zeros((model.first_arm_body + len(model.arms), 3))
    return [part.points for part in _drive_parts(model, bodies) if not part.carried]


def _drive_parts(model: ChainModel, bodies: Array) -> list[OutlinePart]:
    """Outlines of guides, arms and tensioners in a mode's pose."""
    count = len(model.sprockets)
    return guide_arm_tensioner_parts(
        model, DrivePose(bodies[:count, :2], bodies[:count, 2], bodies[model.first_arm_body :, 2])
    )


SWING_SIZE = 0.06
"""Largest drawn displacement of a mode, over the drive's size."""
SHAPE_COLUMNS, MOST_SHAPES = 4, 12


def mode_swing(modes: Modes, k: int, phase: float) -> list[tuple[Modes, NDArray[np.float64], NDArray[np.float64]]]:
    """Modes, rollers and bodies of chains at a phase of mode k."""
    size = SWING_SIZE * float(np.ptp(modes.position, axis=0).max())
    scale = size / max(float(np.abs(modes.shape[k]).max()), 1e-300)
    turn = scale * np.exp(1j * phase)
    most = float(np.abs(modes.bodies[k, :, 2]).max(initial=0.0)) * scale
    if most > 0.5:  # rather turned by half a radian at most
        turn *= 0.5 / most
    return [
        (own, own.position + (turn * own.shape[k]).real, own.placed + (turn * own.bodies[k]).real)
        for own in modes.of_chains()
    ]


def mode_shapes_figure(modes: Modes) -> Figure:
    """Figure of the first mode shapes."""
    from warpchain.view.figures.plain_figure import PlainFigure

    count = min(len(modes), MOST_SHAPES)
    columns = min(count, SHAPE_COLUMNS)
    lines = -(-count // columns)
    span = np.ptp(modes.position, axis=0)
    tall = float(np.clip(3.0 * span[1] / span[0], 1.4, 5.0))
    figure = PlainFigure(figsize=(3.1 * columns, (tall + 0.55) * lines + 0.6), layout="constrained")
    for k, axis in enumerate(figure.subplots(lines, columns, squeeze=False).ravel()):
        if k < count:
            _draw_shape(axis, modes, k)
        axis.set_aspect("equal")
        axis.axis("off")
    state = "at rest" if modes.speed == 0.0 else f"driver at {rpm_of_speed(modes.speed):.4g} rpm"
    figure.suptitle(
        f"Modes, {state}: the chain at both ends of its swing, spokes as far as sprockets turn", fontsize=11
    )
    return figure


def _draw_shape(axis: Any, modes: Modes, k: int) -> None:
    """Draws the shape of mode k into a figure's panel."""
    chain = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 91))
    for own in modes.of_chains():
        for line in fixed_part_lines(own.model):
            axis.plot(*line.T, color="peru", lw=1.2)
        axis.plot(*chain_line(own.model, own.position).T, color="0.75", lw=0.8)
    for phase, color in ((np.pi, LINE_COLORS[0]), (0.0, LINE_COLORS[1])):
        for own, rollers, bodies in mode_swing(modes, k, phase):
            axis.plot(*chain_line(own.model, rollers).T, color=color, lw=1.1)
            for s in range(len(own.model.sprockets)):
                x, y, _ = bodies[s]
                radius, angle = 0.82 * own.model.pitch_radius(s), bodies[s, 2] - own.placed[s, 2]
                if phase == 0.0:
                    axis.plot(x + radius * chain.real, y + radius * chain.imag, color="0.6", lw=0.8)
                axis.plot([x, x + radius * np.cos(angle)], [y, y + radius * np.sin(angle)], color=color, lw=1.1)
            for line in carried_part_lines(own.model, bodies):
                axis.plot(*line.T, color=color, lw=0.8)
    ratio = 100.0 * modes.damping_ratio[k]
    axis.set_title(f"{k + 1}: {modes.frequency[k]:.4g} Hz, {ratio:.2g} %\n{strand_label(modes.names[k])}", fontsize=8)


def mode_campbell_figure(found: Campbell) -> Figure:
    """Figure of a Campbell diagram."""
    from warpchain.view.figures.plain_figure import PlainFigure

    figure = PlainFigure(figsize=(11.0, 7.0), layout="constrained")
    axis = figure.subplots()
    speed = rpm_of_speed(1.0) * found.speed
    top = 1.08 * float(np.nanmax(found.frequency))
    ends = []
    for k in range(len(found.names)):
        axis.plot(speed, found.frequency[:, k], color=LINE_COLORS[k % len(LINE_COLORS)], lw=1.4)
        ends.append(found.frequency[np.flatnonzero(np.isfinite(found.frequency[:, k]))[-1], k])
    for k, place in enumerate(_label_heights(np.array(ends), 0.022 * top)):
        words, color = f"{k + 1}  {strand_label(found.names[k])}", LINE_COLORS[k % len(LINE_COLORS)]
        axis.annotate(words, (speed[-1], place), (4, 0), textcoords="offset points", fontsize=7, va="center",
                      color=color, annotation_clip=False)  # fmt: skip
    last = np.array([order.value * speed[-1] / 60.0 for order in found.orders])  # where their lines end, if within
    places = _label_heights(last, 0.022 * top)
    for order, place in zip(found.orders, places, strict=True):
        _draw_order_line(axis, order.value, f"{order.value:.4g}: {order.cause}", speed[-1], top, float(place))
    for crossing in found.crossings():
        axis.plot(rpm_of_speed(crossing.speed), crossing.frequency, "o", ms=3.0, color="black")
    for tongue in found.tongues():
        axis.plot(rpm_of_speed(tongue.speed), tongue.frequency, "D", ms=4.0, mfc="white", mec="tab:red", zorder=4)
    axis.plot([], [], "o", ms=3.0, color="black", label="an order meets a mode")
    axis.plot([], [], "D", ms=4.0, mfc="white", mec="tab:red", label="tooth frequency is twice the mode's")
    axis.set_xlim(speed[0], speed[-1])
    axis.set_ylim(0.0, top)
    axis.grid(alpha=0.3)
    axis.set_xlabel(f"speed of {found.drive.sprockets[found.drive.driver].name} [rpm]")
    axis.set_ylabel("frequency [Hz]")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    figure.suptitle("Campbell diagram of the modes; orders of the driver's revolution dashed", fontsize=11)
    return figure


def _label_heights(places: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Heights of a diagram's labels, moved up to lie `least` apart."""
    result = places.copy()
    rank = np.argsort(places)
    for below, above in itertools.pairwise(rank):
        result[above] = max(result[above], result[below] + least)
    return result


def _draw_order_line(axis: Any, order: float, words: str, end: float, top: float, place: float) -> None:
    """Draws an excitation order's line into a Campbell diagram."""
    at = min(end, 60.0 * top / order)
    axis.plot([0.0, at], [0.0, order * at / 60.0], "--", color="0.55", lw=0.8)
    short = words if len(words) <= 44 else words[:43] + "\N{HORIZONTAL ELLIPSIS}"
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5}
    style = {"textcoords": "offset points", "fontsize": 6.5, "color": "0.35", "bbox": box}
    if at < end:
        axis.annotate(short, (at, top), (0, 3), rotation=35, va="bottom", annotation_clip=False, **style)
    elif place < 0.96 * top:
        axis.annotate(short, (at, place), (-3, 2), ha="right", va="bottom", **style)
