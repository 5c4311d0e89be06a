"""Figures of one variant, after the paper's Figures 8 to 12: forces, strand displacement, tension, contact."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.archive_schema import tension_color
from warpchain.errors import ArchiveError
from warpchain.record import Run, Trajectory
from warpchain.recorded import recorded
from warpchain.scene import (
    contact_arrows,
    guide_outline,
    nearest_sprocket,
    strand_displacement,
    tooth_outline,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_figures(
    source: Run | str | Path, folder: str | Path, variant: int | None = None, kind: str = "png"
) -> list[Path]:
    """Draws the figures of one variant.

    Args:
        source: a run, or an archive's path.
        folder: where they go; made if need be.
        variant: which variant; None is the first recorded.
        kind: file ending, "png" or "svg".

    Returns:
        The files: drive, strand displacement, link tension, contact forces.

    Raises:
        ArchiveError: an archive that cannot be read, or a folder that cannot be written.
        SimulationError: a variant or channel that was not recorded.
    """
    import matplotlib

    matplotlib.use("Agg")
    trajectory = recorded(source, variant).trajectory
    roller = telling_roller(trajectory)
    figures = {
        "drive": drive_figure(trajectory),
        "strand-displacement": displacement_figure(trajectory),
        "link-tension": tension_figure(trajectory, roller),
        "contact-forces": contact_figure(trajectory, roller),
    }
    target = Path(folder)
    paths = []
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            path = target / f"{name}.{kind}"
            partial = target / f".{name}.{os.getpid()}.{kind}"
            figure.savefig(partial, dpi=130)
            partial.replace(path)
            paths.append(path)
    except OSError as error:
        raise ArchiveError(f"{target}: cannot be written ({error.strerror})") from None
    return paths


def telling_roller(trajectory: Trajectory) -> int:
    """The roller that guide-bars press hardest, or else sprockets."""
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    by_guides = trajectory.guide_force.max(axis=0)
    return int(np.argmax(by_guides if by_guides.max() > 0.0 else trajectory.sprocket_force.max(axis=0)))


def _figure(rows: int, height: float, title: str) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    figure.suptitle(title, fontsize=13)
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def displacement_figure(trajectory: Trajectory) -> Figure:
    """Mid-span transverse displacement of every strand over time (the paper's Figures 9 and 10)."""
    names = trajectory.drive.strand_names
    title = "Transverse displacement of each strand at mid-span"
    figure, axes = _figure(len(names), 2.2 * len(names) + 0.8, title)
    for k, (axis, name) in enumerate(zip(axes, names, strict=True)):
        values = 1e3 * strand_displacement(trajectory, k)
        axis.plot(trajectory.time, values, lw=0.8, color="tab:blue")
        axis.axhline(values.mean(), color="black", lw=0.8, ls="--", label=f"mean {values.mean():+.2f} mm")
        axis.set_ylabel("displacement [mm]\n(left of travel +)")
        axis.set_title(name.replace("->", " \N{RIGHTWARDS ARROW} "), loc="left", fontsize=10)
        axis.legend(loc="upper right", fontsize=8)
    axes[-1].set_xlabel("time [s]")
    return figure


def tension_figure(trajectory: Trajectory, link: int) -> Figure:
    """Tension of one link over time, with the spells on each sprocket shaded (Figure 11)."""
    assert trajectory.tension is not None
    figure, (axis,) = _figure(1, 4.2, f"Tension of link {link}")
    axis.plot(trajectory.time, 1e-3 * trajectory.tension[:, link], lw=0.7, color="tab:blue")
    axis.axhline(0.0, color="black", lw=0.6)
    _shade(axis, trajectory, link)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("link tension [kN]")
    axis.legend(loc="upper right", fontsize=8)
    return figure


def _shade(axis: Any, trajectory: Trajectory, roller: int) -> None:
    """Shades the spells that a roller is on each sprocket."""
    from itertools import groupby

    on = nearest_sprocket(trajectory)[:, roller]
    colors = ("tab:orange", "tab:green", "tab:purple", "tab:red", "tab:brown", "tab:cyan")
    named: set[int] = set()
    frame = 0
    for s, spell in groupby(on.tolist()):
        length = len(list(spell))
        if s >= 0:
            label = None if s in named else f"on {trajectory.drive.sprockets[s].name}"
            named.add(s)
            last = min(frame + length, len(trajectory.time) - 1)
            axis.axvspan(
                trajectory.time[frame], trajectory.time[last], color=colors[s % 6], alpha=0.15, lw=0, label=label
            )
        frame += length


def contact_figure(trajectory: Trajectory, roller: int) -> Figure:
    """Contact forces on one roller: of sprockets above, of guide-bars below (Figure 12)."""
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    figure, (above, below) = _figure(2, 5.6, f"Contact forces on roller {roller}")
    above.plot(trajectory.time, 1e-3 * trajectory.sprocket_force[:, roller], lw=0.7, color="tab:blue")
    above.set_ylabel("sprocket contact [kN]")
    _shade(above, trajectory, roller)
    above.legend(loc="upper right", fontsize=8)
    below.plot(trajectory.time, 1e-3 * trajectory.guide_force[:, roller], lw=0.7, color="tab:red")
    below.set_ylabel("guide-bar contact [kN]")
    below.set_xlabel("time [s]")
    return figure


def drive_figure(trajectory: Trajectory, frame: int | None = None) -> Figure:
    """The drive at one instant, the chain colored by tension, with the contact forces on it (Figure 8)."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.figure import Figure

    assert trajectory.position is not None
    assert trajectory.tension is not None
    assert trajectory.sprocket_angle is not None
    assert trajectory.sprocket_center is not None
    drive, f = trajectory.drive, len(trajectory.time) * 3 // 4 if frame is None else frame
    one = slice(f, f + 1)
    still = Trajectory(drive, trajectory.time[one], **{n: v[one] for n, v in trajectory.channels().items()})
    x = trajectory.position[f]
    span = np.ptp(x, axis=0)
    wide = span[0] >= span[1]
    figure = Figure(figsize=(11.0, 5.5) if wide else (6.5, 10.0), layout="constrained")
    axis = figure.subplots()
    for s, sprocket in enumerate(drive.sprockets):
        c, d = np.cos(trajectory.sprocket_angle[f, s]), np.sin(trajectory.sprocket_angle[f, s])
        outline = tooth_outline(drive, s) @ np.array([[c, d], [-d, c]]) + trajectory.sprocket_center[f, s]
        axis.fill(*outline.T, color="0.88", zorder=0)
        axis.plot(*outline.T, color="0.45", lw=0.7, zorder=1)
        axis.annotate(sprocket.name, trajectory.sprocket_center[f, s], ha="center", va="center", fontsize=9)
    for g, guide in enumerate(drive.guides):
        outline = guide_outline(drive, g)
        axis.plot(*outline.T, color="tab:brown", lw=3, zorder=1)
        axis.annotate(
            guide.name,
            outline.mean(axis=0),
            fontsize=8,
            color="tab:brown",
            ha="right",
            xytext=(-12, 0),
            textcoords="offset points",
        )
    top = max(float(np.percentile(trajectory.tension, 99.9)), 1.0)
    scale = ListedColormap(tension_color(np.linspace(0.0, top, 256), top) / 255.0)
    chain = LineCollection(
        list(np.stack([x, np.roll(x, -1, axis=0)], axis=1)), cmap=scale, norm=Normalize(0.0, 1e-3 * top), lw=3, zorder=3
    )
    chain.set_array(1e-3 * trajectory.tension[f])
    axis.add_collection(chain)
    figure.colorbar(chain, ax=axis, label="link tension [kN]", shrink=0.6)
    arrows = contact_arrows(still)
    largest = max(float(np.hypot(*np.moveaxis(a[0], -1, 0)).max()) for a in arrows)
    reach = 0.12 * float(span.max()) / largest if largest > 0.0 else 1.0
    for force, color, label in zip(
        arrows, ("black", "tab:red"), ("sprocket contact", "guide-bar contact"), strict=True
    ):
        tip = force[0] * reach
        axis.quiver(
            *x.T, *tip.T, angles="xy", scale_units="xy", scale=1.0, width=0.002, color=color, zorder=4, label=label
        )
    axis.plot([], [], " ", label=f"longest arrow {1e-3 * largest:.3g} kN")
    axis.set_aspect("equal")
    axis.legend(loc="upper right", fontsize=8)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_title(f"Forces on the chain at {trajectory.time[f]:.4g} s", fontsize=12)
    return figure
