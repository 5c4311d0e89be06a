"""Figures after the paper's Figures 8 to 12: forces on the drive, strand displacement, link tension, contact forces."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.results.colors import full_scale
from warpchain.results.run import Trajectory
from warpchain.results.scene import (
    arm_outline,
    contact_arrows,
    guide_outline,
    nearest_sprocket,
    strand_displacement,
    tensioner_outline,
    tooth_outline,
    turned,
)
from warpchain.results.signals import guide_forces, last_round
from warpchain.view.chosen import part_of
from warpchain.view.colors import tension_colormap
from warpchain.view.figures.style import PARTS, about, arrowed, curve, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def telling_roller(trajectory: Trajectory) -> int:
    """The roller that guide-bars, or else sprockets, press hardest in the chain's last round."""
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    part = last_round(trajectory)
    by_guides = trajectory.guide_force[part].max(axis=0)
    return int(np.argmax(by_guides if by_guides.max() > 0.0 else trajectory.sprocket_force[part].max(axis=0)))


def displacement_figure(trajectory: Trajectory) -> Figure:
    """Transverse displacement of every strand at mid-span over time (the paper's Figures 9 and 10)."""
    names = trajectory.drive.strand_names
    title = "Transverse displacement of each strand at mid-span"
    figure, axes = panels(len(names), 2.2 * len(names) + 0.9, title, trajectory.drive)
    for k, (axis, name) in enumerate(zip(axes, names, strict=True)):
        values = 1e3 * strand_displacement(trajectory, k)
        mean = float(np.nanmean(values)) if np.isfinite(values).any() else np.nan
        curve(axis, trajectory.time, values, color="tab:blue")
        axis.axhline(mean, color="black", lw=0.8, ls="--", label=f"mean {mean:+.2f} mm")
        axis.set_ylabel("displacement [mm]\n(left of travel +)")
        axis.set_title(arrowed(name), loc="left", fontsize=10)
        axis.legend(loc="upper right", fontsize=8)
    axes[-1].set_xlabel("time [s]")
    return figure


def guide_figure(trajectory: Trajectory) -> Figure:
    """Force of every guide-bar on the chain over time, and how many rollers it presses."""
    drive, forces = trajectory.drive, guide_forces(trajectory)
    figure, axes = panels(2 * len(forces), 4.0 * len(forces) + 1.0, "Force of each guide-bar on the chain", drive)
    for g, (guide, (force, rollers)) in enumerate(zip(drive.guides, forces, strict=True)):
        above, below = axes[2 * g : 2 * g + 2]
        curve(above, trajectory.time, 1e-3 * force, color="tab:red")
        mean = 1e-3 * float(force.mean())
        above.axhline(mean, color="black", lw=0.8, ls="--", label=f"mean {mean:.2f} kN")
        above.set_ylabel("sum over rollers [kN]")
        above.set_title(guide.name, loc="left", fontsize=10)
        above.legend(loc="upper right", fontsize=8)
        curve(below, trajectory.time, rollers, color="0.4")
        below.set_ylabel("rollers pressed [1]")
    axes[-1].set_xlabel("time [s]")
    return figure


def tension_figure(trajectory: Trajectory, link: int) -> Figure:
    """Tension of one link over the chain's last round, with the spells on each sprocket shaded (Figure 11)."""
    trajectory = part_of(trajectory, last_round(trajectory))
    assert trajectory.tension is not None
    figure, (axis,) = panels(1, 4.4, f"Tension of link {link} over the chain's last round", trajectory.drive)
    curve(axis, trajectory.time, 1e-3 * trajectory.tension[:, link], color="tab:blue")
    axis.axhline(0.0, color="black", lw=0.6)
    _shade(axis, trajectory, link)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("link tension [kN]")
    return figure


def contact_figure(trajectory: Trajectory, roller: int) -> Figure:
    """Contact forces on one roller over the chain's last round: of sprockets above, of guide-bars below (Figure 12)."""
    trajectory = part_of(trajectory, last_round(trajectory))
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    figure, (above, below) = panels(
        2, 5.8, f"Contact forces on roller {roller} over the chain's last round", trajectory.drive
    )
    curve(above, trajectory.time, 1e-3 * trajectory.sprocket_force[:, roller], color="tab:blue")
    above.set_ylabel("contact with sprockets [kN]")
    _shade(above, trajectory, roller)
    curve(below, trajectory.time, 1e-3 * trajectory.guide_force[:, roller], color="tab:red")
    below.set_ylabel("contact with guide-bars [kN]")
    below.set_xlabel("time [s]")
    return figure


def _shade(axis: Any, trajectory: Trajectory, roller: int) -> None:
    """Shades the spells that a roller is on each sprocket, with a legend."""
    on = nearest_sprocket(trajectory, np.array([roller]))[:, 0]
    named: set[int] = set()
    frame = 0
    for s, spell in groupby(on.tolist()):
        length = len(list(spell))
        if s >= 0:
            label = None if s in named else f"on {trajectory.drive.sprockets[s].name}"
            named.add(s)
            last = min(frame + length, len(trajectory.time) - 1)
            span = trajectory.time[frame], trajectory.time[last]
            axis.axvspan(*span, color=PARTS[s % len(PARTS)], alpha=0.15, lw=0, label=label)
        frame += length
    if named:
        axis.legend(loc="upper right", fontsize=8)


def drive_figure(trajectory: Trajectory, frame: int | None = None) -> Figure:
    """The drive at one instant, the chain colored by tension, with the contact forces on it (Figure 8)."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    assert trajectory.position is not None
    assert trajectory.tension is not None
    drive, f = trajectory.drive, len(trajectory.time) * 3 // 4 if frame is None else frame
    x = trajectory.position[f]
    span = np.ptp(x, axis=0)
    figure = Figure(figsize=(11.0, 5.5) if span[0] >= span[1] else (6.5, 10.0), layout="constrained")
    axis = figure.subplots()
    _draw_parts(axis, trajectory, f)
    top = full_scale(trajectory.tension)
    links = np.stack([x, np.roll(x, -1, axis=0)], axis=1)
    chain = LineCollection(list(links), cmap=tension_colormap(), norm=Normalize(0.0, 1e-3 * top), lw=3, zorder=3)
    chain.set_array(1e-3 * trajectory.tension[f])
    axis.add_collection(chain)
    figure.colorbar(chain, ax=axis, label="link tension [kN]", shrink=0.6)
    arrows = contact_arrows(part_of(trajectory, slice(f, f + 1)))
    largest = max(float(np.hypot(*np.moveaxis(a[0], -1, 0)).max()) for a in arrows)
    reach = 0.12 * float(span.max()) / largest if largest > 0.0 else 1.0
    kinds = (("black", "contact with sprockets"), ("tab:red", "contact with guide-bars"))
    for force, (color, label) in zip(arrows, kinds, strict=True):
        pressed = force[0].any(axis=1)
        tips = (force[0, pressed] * reach).T
        straight: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002}
        axis.quiver(*x[pressed].T, *tips, **straight, color=color, zorder=4, label=label)
    axis.plot([], [], " ", label=f"longest arrow {1e-3 * largest:.3g} kN")
    axis.set_aspect("equal")
    axis.margins(x=0.12)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_title(f"Forces on the chain at {trajectory.time[f]:.4g} s\n{about(drive)}", fontsize=12)
    return figure


def _draw_parts(axis: Any, trajectory: Trajectory, f: int) -> None:
    """Sprockets and guide-bars as they are at a frame."""
    from matplotlib.patheffects import withStroke

    assert trajectory.sprocket_angle is not None
    assert trajectory.sprocket_center is not None
    drive = trajectory.drive
    halo = [withStroke(linewidth=2.0, foreground="white")]
    for s, sprocket in enumerate(drive.sprockets):
        c, d = np.cos(trajectory.sprocket_angle[f, s]), np.sin(trajectory.sprocket_angle[f, s])
        outline = tooth_outline(drive, s) @ np.array([[c, d], [-d, c]]) + trajectory.sprocket_center[f, s]
        axis.fill(*outline.T, color="0.88", zorder=0)
        axis.plot(*outline.T, color="0.45", lw=0.7, zorder=1)
        middle = {"ha": "center", "va": "center", "zorder": 5, "path_effects": halo}
        axis.annotate(sprocket.name, trajectory.sprocket_center[f, s], fontsize=9, **middle)
    angles = np.zeros(len(drive.arms)) if trajectory.arm_angle is None else trajectory.arm_angle[f]
    for g, guide in enumerate(drive.guides):
        outline, arm = guide_outline(drive, g), drive.arm_of(g)
        if arm is not None:
            outline = turned(outline, drive.arms[arm].pivot, float(angles[arm]))
        axis.plot(*outline.T, color="tab:brown", lw=3, zorder=1)
        below = {"xytext": (0, -4), "textcoords": "offset points", "ha": "center", "va": "top"}
        axis.annotate(guide.name, min(outline[[0, -1]], key=lambda end: end[1]), fontsize=8, color="tab:brown", **below)
    _draw_arms(axis, trajectory, f, angles)


def _draw_arms(axis: Any, trajectory: Trajectory, f: int, angles: Any) -> None:
    """Arms turned by `angles` (A,) [rad] and tensioners pushed out as they are at a frame."""
    drive = trajectory.drive
    for a, arm in enumerate(drive.arms):
        for line in arm_outline(drive, a):
            axis.plot(*turned(line, arm.pivot, float(angles[a])).T, color="0.45", lw=1.0, zorder=0)
        axis.plot(*arm.pivot, "o", color="0.45", ms=4, zorder=1)
    for k, tensioner in enumerate(drive.tensioners):
        housing, plunger = tensioner_outline(drive, k)
        out = 0.0 if trajectory.tensioner_extension is None else float(trajectory.tensioner_extension[f, k])
        moved = plunger + out * np.asarray(tensioner.direction) / np.hypot(*tensioner.direction)
        axis.fill(*moved.T, color="0.75", zorder=0)
        axis.fill(*housing.T, color="0.88", zorder=0)
        axis.plot(*housing.T, color="0.45", lw=0.7, zorder=1)
