"""Figures of the whole chain: tension of all links over time, order spectra, contact force against the angle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.results.run import Trajectory
from warpchain.results.signals import (
    SPECTRUM_FLOOR,
    TOOTH_PASSINGS,
    contact_angles,
    order_spectra,
    peaks_over_time,
)
from warpchain.results.units import display_unit
from warpchain.view.colors import tension_colormap
from warpchain.view.figures.style import LINES, arrowed, key, panels
from warpchain.view.scale import scale_top

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROWS = 1200
"""Spells of time that the waterfall is drawn in."""
BIN = 1.0
"""Width of the bins of contact angles [degrees]."""
DOTS = 20_000
"""Most dots of one sprocket."""


def waterfall_figure(trajectory: Trajectory, top: float | None = None) -> Figure:
    """Tension of every link over time, time running down: each row the largest tension of its spell.

    Args:
        top: tension at the red end of the color scale [N]; None takes `scale_top`.
    """
    assert trajectory.tension is not None
    figure, (axis,) = panels(1, 7.0, "Tension of all links over time", trajectory.drive)
    _, rows = peaks_over_time(trajectory.tension, ROWS)
    top = scale_top([trajectory]) if top is None else top
    unit, factor = display_unit("N", top)
    extent = (-0.5, trajectory.drive.chain.links - 0.5, float(trajectory.time[-1]), 0.0)
    colors: Any = {"cmap": tension_colormap(), "vmin": 0.0, "vmax": factor * top}
    image = axis.imshow(factor * rows, aspect="auto", extent=extent, interpolation="nearest", **colors)
    axis.grid(False)
    axis.set_xlabel("link number")
    axis.set_ylabel("time [s]")
    figure.colorbar(image, ax=axis, label=f"link tension, largest of each spell [{unit}]", extend="both")
    return figure


def spectrum_figure(trajectory: Trajectory) -> Figure | None:
    """Order spectra of strand tensions and transmission errors, tooth-passing orders marked; None where none can be."""
    groups = order_spectra(trajectory)
    if not groups:
        return None
    drive = trajectory.drive
    driver = drive.sprockets[drive.driver]
    title = "Order spectra, latter half of the run"
    figure, axes = panels(len(groups), 3.4 * len(groups) + 0.9, title, drive)
    for axis, (label, spectra) in zip(axes, groups.items(), strict=True):
        for k, one in enumerate(spectra):
            color = LINES[k % len(LINES)]
            axis.semilogy(one.orders, one.amplitude, lw=0.8, color=color, label=arrowed(one.name))
        for k in range(1, TOOTH_PASSINGS + 1):
            mark = f"tooth passing, multiples of {driver.teeth}" if k == 1 else None
            axis.axvline(k * driver.teeth, color="black", lw=0.8, ls=":", label=mark)
        peak = max(float(one.amplitude.max()) for one in spectra)
        if peak > 0.0:
            axis.set_ylim(SPECTRUM_FLOOR * peak, 2.0 * peak)
        axis.set_xlim(0.0, (TOOTH_PASSINGS + 0.5) * driver.teeth)
        axis.set_ylabel(f"amplitude of\n{label}")
        key(axis)
    axes[-1].set_xlabel(f"order [multiples of the revolutions of {driver.name}]")
    return figure


def angle_figure(trajectory: Trajectory) -> Figure:
    """Contact force on the rollers against the angle since they reached each sprocket, latter half of the run."""
    drive = trajectory.drive
    count = len(drive.sprockets)
    title = "Contact force against angle on the sprocket, latter half of the run"
    figure, axes = panels(count, 2.5 * count + 0.9, title, drive, share=False)
    every = [contact_angles(trajectory, s) for s in range(count)]
    unit, factor = display_unit("N", max(float(found.force.max(initial=0.0)) for found in every))
    for s, (axis, sprocket) in enumerate(zip(axes, drive.sprockets, strict=True)):
        found = every[s]
        angle, force = np.degrees(found.angle), factor * found.force
        thin = slice(None, None, max(len(angle) // DOTS, 1))
        axis.plot(
            angle[thin],
            force[thin],
            ".",
            ms=1.5,
            color="0.7",
            rasterized=True,
            label="rollers at single frames, thinned out",
        )
        low, high = -1.5 * np.degrees(found.pitch), np.degrees(found.wrap + 1.5 * found.pitch)
        edges = np.arange(low, high + BIN, BIN)
        at = np.digitize(angle, edges) - 1
        centers = 0.5 * (edges[:-1] + edges[1:])
        top = 0.0
        for label, share, color in (("median", 0.5, "tab:blue"), ("99 % below", 0.99, "tab:red")):
            held = [np.quantile(force[at == k], share) if (at == k).any() else np.nan for k in range(len(centers))]
            axis.plot(centers, held, lw=1.2, color=color, label=label)
            top = max(top, float(np.nanmax(held)) if len(angle) else 0.0)
        for edge, name in ((0.0, "chain reaches the sprocket"), (np.degrees(found.wrap), "chain leaves it")):
            axis.axvline(edge, color="black", lw=0.8, ls="--" if edge == 0.0 else ":", label=name)
        axis.set_xlim(low, high)
        axis.set_ylim(0.0, 1.05 * top or 1.0)
        axis.set_ylabel(f"contact force [{unit}]")
        axis.set_title(f"{sprocket.name}, {sprocket.teeth} teeth", loc="left", fontsize=10)
    key(axes[0])
    axes[-1].set_xlabel("angle since the roller reached the sprocket, in the direction of travel [degrees]")
    return figure
