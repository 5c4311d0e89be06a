"""A moving picture."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import case, option

FRAMES, TEETH = 48, 6
"""Frames of the picture, and teeth of the driver that pass in them: its end then meets its beginning."""
LASTS = 100
"""Milliseconds of a frame."""
GROUND, INK = "#0d0e10", "#c8c8c8"
COLORS = 128


def shown_frames(trajectory: Any) -> np.ndarray:
    """Frames of the recording that are shown: the last `TEETH` teeth of the driver, evenly."""
    from warpchain.results.signals import forward

    drive = trajectory.drive
    teeth = drive.sprockets[drive.driver].teeth
    passed = forward(drive, trajectory.sprocket_angle, drive.driver) * teeth / (2.0 * np.pi)
    wanted = passed[-1] - TEETH + TEETH * np.arange(FRAMES) / FRAMES
    return np.searchsorted(passed, wanted).clip(0, len(passed) - 1)


def parts(axis: Any, trajectory: Any, f: int, top: float, reach: float) -> None:
    """Sprockets, guide-bars, the chain and the forces at a frame."""
    from matplotlib.collections import LineCollection

    from warpchain.results.scene import contact_arrows, guide_outline, tooth_outline
    from warpchain.view.chosen import part_of
    from warpchain.view.palette import tension_colormap

    drive, x = trajectory.drive, trajectory.position[f]
    for s, sprocket in enumerate(drive.sprockets):
        c, d = np.cos(trajectory.sprocket_angle[f, s]), np.sin(trajectory.sprocket_angle[f, s])
        outline = tooth_outline(drive, s, 5) @ np.array([[c, d], [-d, c]]) + trajectory.sprocket_center[f, s]
        axis.fill(*outline.T, fc="#22262c", ec="#7c8490", lw=0.6)
        axis.annotate(sprocket.name, trajectory.sprocket_center[f, s], color=INK, fontsize=7, ha="center", va="center")
    for g in range(len(drive.guides)):
        axis.plot(*guide_outline(drive, g).T, color="#be783c", lw=2.0)
    links = LineCollection(list(np.stack([x, np.roll(x, -1, axis=0)], axis=1)), cmap=tension_colormap(), lw=2.6)
    links.set_array(trajectory.tension[f])
    links.set_clim(0.0, top)
    axis.add_collection(links)
    for force, color in zip(contact_arrows(part_of(trajectory, slice(f, f + 1))), ("white", "#ff5050"), strict=True):
        on = force[0].any(axis=1)
        straight: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.006}
        axis.quiver(*x[on].T, *(reach * force[0, on]).T, color=color, **straight)


def figure(trajectory: Any, curves: list[tuple[str, list[tuple[str, np.ndarray]]]], f: int, size: tuple) -> Any:
    """One frame as a figure."""
    from matplotlib.figure import Figure

    from warpchain.view.palette import scale_top, thing_colors

    top, longest = size
    colors = thing_colors(trajectory.drive)
    low, high = trajectory.position.reshape(-1, 2).min(axis=0), trajectory.position.reshape(-1, 2).max(axis=0)
    room = 0.06 * float((high - low).max())
    made = Figure(figsize=(9.0, 5.4), layout="constrained", facecolor=GROUND)
    halves: Any = made.subfigures(1, 2, width_ratios=[0.36, 0.64])
    left, right = halves
    axis = left.subplots()
    parts(axis, trajectory, f, top or scale_top([trajectory]), longest)
    axis.set_xlim(low[0] - room, high[0] + room)
    axis.set_ylim(low[1] - room, high[1] + room)
    axis.set_aspect("equal")
    axis.axis("off")
    last = trajectory.time >= trajectory.time[-1] - 2.2 * (
        trajectory.time[-1] - trajectory.time[shown_frames(trajectory)[0]]
    )
    for panel, (label, lines) in zip(right.subplots(len(curves), 1, sharex=True), curves, strict=True):
        panel.set_facecolor(GROUND)
        for name, values in lines:
            color = "#{:02x}{:02x}{:02x}".format(*colors[name])
            word = name.replace("->", " \N{RIGHTWARDS ARROW} ")
            panel.plot(trajectory.time[last], values[last], color=color, lw=0.9, label=word)
        panel.axvline(trajectory.time[f], color="white", lw=0.8)
        panel.set_ylabel(label, color=INK, fontsize=8)
        panel.tick_params(colors=INK, labelsize=7)
        panel.margins(x=0.0)
        panel.legend(fontsize=6.5, labelcolor=INK, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        for side in panel.spines.values():
            side.set_color("#50555c")
    panel.set_xlabel("time [s]", color=INK, fontsize=8)
    return made


@case(
    option("picture", type=Path, help="the .gif to write"),
    option("drive", nargs="?", default="marine", help="name of an example drive (default marine)"),
)
def moving(asked: argparse.Namespace) -> None:
    """A moving picture of an example drive: the chain in the color of its tension, forces, and curves.

    python scripts/figures.py moving docs/images/marine.gif [DRIVE]
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    from warpchain import load_drive, simulate
    from warpchain.drive.examples import drive_path
    from warpchain.results.scene import contact_arrows
    from warpchain.results.signals import largest_contacts, strand_tension
    from warpchain.view.chosen import part_of
    from warpchain.view.palette import scale_top

    trajectory: Any = simulate(load_drive(drive_path(asked.drive)))[0]
    drive, chosen = trajectory.drive, shown_frames(trajectory)
    tensions = [(name, 1e-3 * strand_tension(trajectory, k)) for k, name in enumerate(drive.strand_names)]
    bodies = [*(s.name for s in drive.sprockets), *(g.name for g in drive.guides)]
    contacts = [(n, 1e-3 * f) for n, f in zip(bodies, largest_contacts(trajectory), strict=True)]
    curves = [("strand tension [kN]", tensions), ("largest contact force [kN]", contacts)]
    arrows = np.concatenate([a[a.any(axis=-1)] for a in contact_arrows(part_of(trajectory, chosen))])
    span = float(np.ptp(trajectory.position[-1], axis=0).max())
    reach = 0.10 * span / float(np.quantile(np.hypot(*arrows.T), 0.99))
    pictures = []
    for f in chosen:
        canvas = FigureCanvasAgg(figure(trajectory, curves, int(f), (scale_top([trajectory]), reach)))
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    # the colors of all frames: the first, the middle and the last one side by side
    few = [np.asarray(pictures[k]) for k in (0, FRAMES // 2, FRAMES - 1)]
    colors = Image.fromarray(np.concatenate(few)).quantize(COLORS)
    first, *rest = [picture.quantize(palette=colors, dither=Image.Dither.NONE) for picture in pictures]
    first.save(asked.picture, save_all=True, append_images=rest, duration=LASTS, loop=0, optimize=True)
    print(asked.picture)
