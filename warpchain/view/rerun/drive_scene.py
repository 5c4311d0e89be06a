"""The drive in motion in Rerun: chain colored by tension, sprockets, guides, arms, contact forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.nearest_parts import roller_contact_forces
from warpchain.results.outlines import arm_outline, chain_line, guide_outline, tensioner_outline, tooth_outline
from warpchain.results.plate_outlines import pin_radius, plate_outlines
from warpchain.results.run import Trajectory, require_channels
from warpchain.view.palette import Color, curve_colors, packed_tension_colors, tension_color_steps
from warpchain.view.rerun.streams import (
    ComponentValues,
    entity_path,
    flipped_points,
    line_strip_array,
    list_array,
    send_columns,
    vector_array,
)

if TYPE_CHECKING:
    import rerun as rr

ARROW_LENGTH = 0.12
"""Longest contact-force arrow over the drive's size."""
STEEL, PLATES = (150, 155, 165), (105, 105, 110)
PLATE_ARC_POINTS = 3
"""Points of a plate's arcs in Rerun."""
COMMON_NAMES = "shafts"
"""Rerun's entity for common names of sprockets."""
DRAWN_FIRST = 5.0
"""Rerun's draw order of parts below rollers."""


def thinned_trajectory(trajectory: Trajectory, budget: int) -> Trajectory:
    """Trajectory at evenly spaced frames, at most `budget`."""
    count = len(trajectory.time)
    if count <= budget:
        return trajectory
    frames = np.unique(np.linspace(0, count - 1, budget).round().astype(np.intp))
    return trajectory.at(frames)


def log_drive(
    stream: rr.RecordingStream, root: str, shown: Trajectory, top: float, colors: Mapping[str, Color] | None = None
) -> None:
    """Logs the drive in motion to Rerun below `root`, colors up to `top` [N]."""
    (position,) = require_channels(shown, "position")
    x = flipped_points(position)
    colors = curve_colors(shown.model) if colors is None else colors
    _log_chain(stream, root, shown, x, top)
    _log_sprockets(stream, root, shown, colors)
    _log_guides(stream, root, shown, colors)
    _log_arms(stream, root, shown)
    _log_tensioners(stream, root, shown)
    _log_contact_arrows(stream, root, shown, x)


def sprockets_about_one_center(chains: Sequence[Trajectory]) -> list[list[tuple[int, int]]]:
    """Groups of sprockets, (chain, sprocket), that stand about one center."""
    groups: list[tuple[NDArray[np.floating], list[tuple[int, int]]]] = []
    for c, chain in enumerate(chains):
        for s, center in enumerate(require_channels(chain, "sprocket_center")[0][0]):
            held = next((members for place, members in groups if np.allclose(place, center)), None)
            if held is None:
                groups.append((center, [(c, s)]))
            else:
                held.append((c, s))
    return [members for _, members in groups if len(members) > 1]


def log_common_names(stream: rr.RecordingStream, chains: Sequence[Trajectory]) -> None:
    """Logs the names of sprockets about one center to Rerun, in one moving label."""
    import rerun as rr

    for members in sprockets_about_one_center(chains):
        names = [chains[c].model.sprockets[s].name for c, s in members]
        path = entity_path(COMMON_NAMES, names[0])
        label = rr.Points2D([[0.0, 0.0]], labels=["\n".join(names)], radii=[0.0], colors=[STEEL], show_labels=True)
        stream.log(path, label, static=True)
        c, s = members[0]
        center = require_channels(chains[c], "sprocket_center")[0][:, s]
        _log_turning(stream, path, chains[c], center, np.zeros(len(center)))


def log_chain_outline(stream: rr.RecordingStream, path: str, shown: Trajectory, color: tuple[int, int, int]) -> None:
    """Logs the moving chain to Rerun as a thin line."""
    import rerun as rr

    (position,) = require_channels(shown, "position")
    x = flipped_points(position)
    frames = len(x)
    line = ComponentValues(
        rr.LineStrips2D.descriptor_strips(), list_array(line_strip_array(chain_line(shown.model, x)), 1, frames)
    )
    send_columns(stream, path, shown.time, [line])
    style = rr.LineStrips2D.from_fields(colors=[color], radii=rr.Radius.ui_points(0.7))
    stream.log(path, style, static=True)


def _log_chain(stream: rr.RecordingStream, root: str, shown: Trajectory, x: NDArray[np.float32], top: float) -> None:
    """Logs the chain to Rerun: rollers colored by tension, or pins on plates."""
    import pyarrow as pa
    import rerun as rr

    (tension,) = require_channels(shown, "tension")
    frames, links = tension.shape
    line, points = rr.LineStrips2D, rr.Points2D
    chain, rollers = entity_path(root, "drive", "chain"), entity_path(root, "drive", "rollers")
    silent, pitch = shown.model.chain.is_silent, shown.model.chain.pitch
    style = line.from_fields(radii=[(0.03 if silent else 0.08) * pitch], colors=[PLATES], draw_order=DRAWN_FIRST)
    stream.log(chain, style, static=True)
    radius = pin_radius(shown.model) if silent else shown.model.chain.roller_radius
    stream.log(rollers, points.from_fields(radii=[radius]), static=True)
    if silent:
        (position,) = require_channels(shown, "position")
        strips, each = flipped_points(plate_outlines(shown.model, position, PLATE_ARC_POINTS)), links
    else:
        strips, each = chain_line(shown.model, x), 1
    drawn = ComponentValues(line.descriptor_strips(), list_array(line_strip_array(strips), each, frames))
    send_columns(stream, chain, shown.time, [drawn])
    colors = pa.array(packed_tension_colors(tension_color_steps(tension, top)).ravel())
    columns = [(points.descriptor_positions(), vector_array(x)), (points.descriptor_colors(), colors)]
    send_columns(
        stream,
        rollers,
        shown.time,
        [ComponentValues(what, list_array(values, links, frames)) for what, values in columns],
    )


def _log_sprockets(stream: rr.RecordingStream, root: str, shown: Trajectory, colors: Mapping[str, Color]) -> None:
    """Logs sprockets to Rerun: outlines once, place and angle each frame."""
    import rerun as rr

    sprocket_angle, sprocket_center = require_channels(shown, "sprocket_angle", "sprocket_center")
    for s, sprocket in enumerate(shown.model.sprockets):
        path = entity_path(root, "drive", "sprockets", sprocket.name)
        spoke = np.array([[0.0, 0.0], [0.8 * shown.model.pitch_radius(s), 0.0]])
        parts = [flipped_points(tooth_outline(shown.model, s)), flipped_points(spoke)]
        color, thin = colors.get(sprocket.name, STEEL), 0.05 * shown.model.chain.pitch
        stream.log(path, rr.LineStrips2D(parts, colors=[STEEL, color], radii=[thin, 1.6 * thin]), static=True)
        label = rr.Points2D([[0.0, 0.0]], labels=[sprocket.name], radii=[2.0 * thin], colors=[color])
        stream.log(entity_path(root, "drive", "sprockets", sprocket.name, "name"), label, static=True)
        _log_turning(stream, path, shown, sprocket_center[:, s], sprocket_angle[:, s])


def _log_guides(stream: rr.RecordingStream, root: str, shown: Trajectory, colors: Mapping[str, Color]) -> None:
    """Logs guide-bars to Rerun, those on arms in motion."""
    import rerun as rr

    for g, guide in enumerate(shown.model.guides):
        outline, path = guide_outline(shown.model, g), entity_path(root, "drive", "guides", guide.name)
        arm = shown.model.arm_of(g)
        if arm is not None and shown.arm_angle is not None:
            outline = outline - np.asarray(shown.model.arms[arm].pivot)
            _log_turning(
                stream,
                path,
                shown,
                arm_pivots(shown.model, shown.time, shown.arm_angle)[:, arm],
                shown.arm_angle[:, arm],
            )
        line = rr.LineStrips2D(
            [flipped_points(outline)], colors=[colors.get(guide.name, STEEL)], radii=[0.1 * shown.model.chain.pitch]
        )
        stream.log(path, line, static=True)


def _log_arms(stream: rr.RecordingStream, root: str, shown: Trajectory) -> None:
    """Logs arms to Rerun: pivots, lines to guides and tensioners."""
    import rerun as rr

    if shown.arm_angle is None:
        return
    model = shown.model
    for a, arm in enumerate(model.arms):
        path = entity_path(root, "drive", "arms", arm.name)
        parts = [flipped_points(line - np.asarray(arm.pivot)) for line in arm_outline(model, a)]
        radius = 0.05 * model.chain.pitch
        stream.log(path, rr.LineStrips2D(parts, colors=[STEEL], radii=[radius]), static=True)
        label = rr.Points2D([[0.0, 0.0]], labels=[arm.name], radii=[2.0 * radius], colors=[STEEL])
        stream.log(entity_path(root, "drive", "arms", arm.name, "name"), label, static=True)
        _log_turning(stream, path, shown, arm_pivots(model, shown.time, shown.arm_angle)[:, a], shown.arm_angle[:, a])


def _log_tensioners(stream: rr.RecordingStream, root: str, shown: Trajectory) -> None:
    """Logs tensioners to Rerun: fixed housings, moving plungers."""
    import rerun as rr

    for k, tensioner in enumerate(shown.model.tensioners):
        housing, plunger = tensioner_outline(shown.model, k)
        radius = 0.05 * shown.model.chain.pitch
        for name, outline, color in (("housing", housing, STEEL), ("plunger", plunger, PLATES)):
            line = rr.LineStrips2D([flipped_points(outline)], colors=[color], radii=[radius])
            stream.log(entity_path(root, "drive", "tensioners", tensioner.name, name), line, static=True)
        if shown.tensioner_extension is not None:
            along = np.asarray(tensioner.direction) / np.hypot(*tensioner.direction)
            place = np.zeros((len(shown.time), 3), np.float32)
            place[:, :2] = flipped_points(np.asarray(shown.tensioner_extension[:, k], dtype=float)[:, None] * along)
            moved = ComponentValues(
                rr.Transform3D.descriptor_translation(), list_array(vector_array(place), 1, len(shown.time))
            )
            send_columns(
                stream, entity_path(root, "drive", "tensioners", tensioner.name, "plunger"), shown.time, [moved]
            )


def _log_turning(
    stream: rr.RecordingStream, path: str, shown: Trajectory, pivot: NDArray[np.floating], angle: NDArray[np.floating]
) -> None:
    """Logs to Rerun that an entity turns about a pivot."""
    import rerun as rr

    count, kind = len(shown.time), rr.Transform3D
    place, turn = np.zeros((count, 3), np.float32), np.zeros((count, 4), np.float32)
    place[:, :2] = flipped_points(pivot)
    half = -0.5 * np.asarray(angle, dtype=float)
    turn[:, 2], turn[:, 3] = np.sin(half), np.cos(half)
    moved = ComponentValues(kind.descriptor_translation(), list_array(vector_array(place), 1, count))
    send_columns(
        stream,
        path,
        shown.time,
        [moved, ComponentValues(kind.descriptor_quaternion(), list_array(vector_array(turn), 1, count))],
    )


def _log_contact_arrows(stream: rr.RecordingStream, root: str, shown: Trajectory, x: NDArray[np.float32]) -> None:
    """Logs contact forces to Rerun as arrows, small ones left out."""
    import rerun as rr

    sprocket_force, guide_force = require_channels(shown, "sprocket_force", "guide_force")
    sample = np.concatenate([f[:: max(len(f) // 20, 1)].ravel() for f in (sprocket_force, guide_force)])
    pressed = sample[sample > 0.0]
    if not len(pressed):
        return
    largest = float(np.quantile(pressed, 0.99))  # rare impacts may reach further
    scale = np.array([1.0, -1.0]) * ARROW_LENGTH * float(np.ptp(x[0], axis=0).max()) / largest
    kind = rr.Arrows2D
    for name, arrows, color in zip(
        ("sprocket forces", "guide-bar forces"),
        roller_contact_forces(shown, 0.01 * largest),
        ((240, 240, 240), (255, 80, 80)),
        strict=True,
    ):
        path, lengths = entity_path(root, "drive", name), np.bincount(arrows.frame, minlength=len(x))
        tips = vector_array((arrows.force * scale).astype(np.float32))
        feet = vector_array(x[arrows.frame, arrows.roller])
        drawn = [(kind.descriptor_vectors(), tips), (kind.descriptor_origins(), feet)]
        send_columns(
            stream, path, shown.time, [ComponentValues(what, list_array(values, lengths)) for what, values in drawn]
        )
        width = 0.05 * shown.model.chain.pitch
        stream.log(path, kind.from_fields(colors=[color], radii=[width]), static=True)
