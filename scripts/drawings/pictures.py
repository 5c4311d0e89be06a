"""Pictures of runs: a moving one, the viewer's, and those of reports."""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive
from matplotlib import style
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from warpchain import Record, simulate
from warpchain.results.engineering_report import engineering_report
from warpchain.results.nearest_parts import contact_force_vectors
from warpchain.results.outlines import guide_arm_tensioner_parts, pose_at_frame, teeth_parts
from warpchain.results.signals import forward_values, largest_contact_forces, strand_tension
from warpchain.view.figures.figure_style import strand_label
from warpchain.view.figures.part_figures import guide_load_figure
from warpchain.view.figures.shaft_figures import hub_force_figure
from warpchain.view.figures.sweep import order_cuts_figure, run_up_cuts
from warpchain.view.palette import curve_colors, tension_colormap, tension_scale_top

FRAMES, TEETH = 48, 6
"""Frames of the picture, and teeth of the driver that pass in them: its end then has the drive of its beginning."""
LASTS = 100
"""Milliseconds of a frame."""
COLORS = 128
DRIVERS = Path("/usr/share/vulkan/icd.d")
SOFTWARE = DRIVERS / "lvp_icd.x86_64.json"
DRIVE = case_option("drive", nargs="?", default="marine", help="name of an example drive (default marine)")


def last_teeth_frames(trajectory: Any) -> np.ndarray:
    """Frames of the recording that are shown: the last `TEETH` teeth of the driver, evenly."""
    drive = trajectory.drive
    teeth = drive.sprockets[drive.driver].teeth
    passed = forward_values(drive, trajectory.sprocket_angle, drive.driver) * teeth / (2.0 * np.pi)
    wanted = passed[-1] - TEETH + TEETH * np.arange(FRAMES) / FRAMES
    return np.searchsorted(passed, wanted).clip(0, len(passed) - 1)


def draw_frame(axis: Any, trajectory: Any, f: int, reach: float) -> None:
    """The drive, its chain and the forces at a frame; a newton is `reach` meters long."""
    model, x = trajectory.model, trajectory.position[f]
    pose = pose_at_frame(trajectory, f)
    for part, center in zip(teeth_parts(model, pose, 5), pose.center, strict=True):
        axis.fill(*part.points.T, fc="0.15", ec="0.5", lw=0.6)
        axis.annotate(part.name, center, fontsize=7, ha="center", va="center")
    for part in guide_arm_tensioner_parts(model, pose):
        axis.plot(*part.points.T, color="#be783c" if part.kind == "guide" else "0.5", lw=2.0)
    links = LineCollection(list(np.stack([x, np.roll(x, -1, axis=0)], axis=1)), cmap=tension_colormap(), lw=2.6)
    links.set_array(trajectory.tension[f])
    links.set_clim(0.0, tension_scale_top([trajectory]))
    axis.add_collection(links)
    for force, color in zip(contact_force_vectors(trajectory.at(slice(f, f + 1))), ("white", "#ff5050"), strict=True):
        on = force[0].any(axis=1)
        straight: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.006}
        axis.quiver(*x[on].T, *(reach * force[0, on]).T, color=color, **straight)
    low, high = trajectory.position.min(axis=(0, 1)), trajectory.position.max(axis=(0, 1))
    room = 0.06 * float((high - low).max())
    axis.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
    axis.axis("off")


def frame_figure(trajectory: Any, curves: dict[str, dict[str, np.ndarray]], f: int, reach: float) -> Figure:
    """One frame as a figure: the drive, and curves about the shown teeth."""
    made = Figure(figsize=(9.0, 5.4), layout="constrained")
    halves: Any = made.subfigures(1, 2, width_ratios=[0.36, 0.64])
    left, right = halves
    draw_frame(left.subplots(), trajectory, f, reach)
    time, colors = trajectory.time, curve_colors(trajectory.drive)
    last = time >= time[-1] - 2.2 * (time[-1] - time[last_teeth_frames(trajectory)[0]])
    panels = right.subplots(len(curves), 1, sharex=True)
    for panel, (label, lines) in zip(panels, curves.items(), strict=True):
        for name, values in lines.items():
            color = tuple(part / 255 for part in colors[name])
            panel.plot(time[last], values[last], color=color, lw=0.9, label=strand_label(name))
        panel.axvline(time[f], lw=0.8)
        panel.set_ylabel(label)
        panel.margins(x=0.0)
        panel.legend(fontsize=6.5, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    panels[-1].set_xlabel("time [s]")
    return made


@case(DRIVE)
def moving(asked: argparse.Namespace) -> Iterator[Line]:
    """A moving picture of an example drive: the chain in the color of its tension, forces, and curves.

    python scripts/figures.py moving [DRIVE]
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    trajectory: Any = simulate(example_drive(asked.drive))[0]
    drive, chosen = trajectory.drive, last_teeth_frames(trajectory)
    bodies = [*(s.name for s in drive.sprockets), *(g.name for g in drive.guides)]
    curves = {
        "strand tension [kN]": {name: strand_tension(trajectory, k) for k, name in enumerate(drive.strand_names)},
        "largest contact force [kN]": dict(zip(bodies, largest_contact_forces(trajectory), strict=True)),
    }
    curves = {label: {name: 1e-3 * force for name, force in lines.items()} for label, lines in curves.items()}
    arrows = np.concatenate([a[a.any(axis=-1)] for a in contact_force_vectors(trajectory.at(chosen))])
    span = float(np.ptp(trajectory.position[-1], axis=0).max())
    reach = 0.10 * span / float(np.quantile(np.hypot(*arrows.T), 0.99))
    pictures = []
    for f in chosen:
        with style.context(["dark_background", {"font.size": 8.0}]):
            canvas = FigureCanvasAgg(frame_figure(trajectory, curves, int(f), reach))
            canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    # the colors of all frames: the first, the middle and the last one side by side
    few = [np.asarray(pictures[k]) for k in (0, FRAMES // 2, FRAMES - 1)]
    colors = Image.fromarray(np.concatenate(few)).quantize(COLORS)
    first, *rest = [picture.quantize(palette=colors, dither=Image.Dither.NONE) for picture in pictures]
    path = asked.output / f"{asked.drive}.gif"
    first.save(path, save_all=True, append_images=rest, duration=LASTS, loop=0, optimize=True)
    yield str(path)


def missing_vulkan_reason() -> str | None:
    """The reason that the headless viewer cannot run here, or None."""
    return None if list(DRIVERS.glob("*.json")) else "no Vulkan driver (Debian: mesa-vulkan-drivers, libvulkan1)"


def save_screenshot(recording: Path, picture: Path, seconds: float) -> None:
    """Opens a recording in the headless viewer, goes to a simulated time and saves its picture."""
    if SOFTWARE.exists():
        os.environ.setdefault("VK_ICD_FILENAMES", str(SOFTWARE))
    from rerun.experimental import ViewerClient

    from warpchain.view.rerun.viewer import Viewer

    with Viewer(kind="headless") as viewer:
        client = ViewerClient.connect(viewer.data)
        client.open(str(recording))
        time.sleep(2.0)
        client.set_time("sim_time", duration=seconds, play_state="paused")
        time.sleep(2.5)
        client.save_screenshot(str(picture))


@case(
    DRIVE,
    case_option("--at", type=float, default=1.5, help="simulated time [s]"),
    case_option("--tab", help="tab of the viewer"),
)
def viewer(asked: argparse.Namespace) -> Iterator[Line]:
    """A picture of an example drive's run in the headless Rerun viewer.

    python scripts/figures.py viewer [DRIVE]
    python scripts/figures.py viewer car --at 0.15
    python scripts/figures.py viewer --tab tension

    Needs a Vulkan driver; in software, Debian's mesa-vulkan-drivers and libvulkan1. Writes DRIVE.png, or
    playback-TAB.png of a tab.
    """
    from PIL import Image

    from warpchain.view.rerun.run_playback import view

    picture = asked.output / (f"playback-{asked.tab}.png" if asked.tab else f"{asked.drive}.png")
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / f"{asked.drive}.rrd"
        view(simulate(example_drive(asked.drive)), save=recording, tab=asked.tab)
        save_screenshot(recording, picture, asked.at)
    Image.open(picture).convert("RGB").quantize(160).save(picture, optimize=True)  # a third of the size
    yield str(picture)


@case()
def report(asked: argparse.Namespace) -> Iterator[Line]:
    """Loads of a run-up of the timing drive on its shafts and its guide, as `warpchain report` shows them.

    python scripts/figures.py report

    Writes report-hubs.png, report-orders.png and report-guide.png.
    """
    table = {"time": [0.0, 1.0], "speed": [105.0, 600.0]}  # s, rad/s
    values = {"sprockets.crankshaft.prescribed.table": table, "run.duration": 1.0}
    drive = example_drive("engine", values)
    found = engineering_report(simulate(drive, record=Record(rate=20_000.0), window=(0.0, 1.0)))
    cuts = run_up_cuts(found)["force on the hub"]
    figures = {
        "report-hubs": hub_force_figure(found),
        "report-guide": guide_load_figure(found, 0),
        "report-orders": order_cuts_figure(found.model, "force on the hub", *cuts),
    }
    yield ("metric", "value")
    yield from found.metrics().items()
    yield figures
