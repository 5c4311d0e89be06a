"""Order cuts over a run-up: amplitudes of orders against the driver's speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpchain.drive import Drive
from warpchain.results.handed_in import HandedIn
from warpchain.results.rotation import BLOCK, Cuts, order_cuts, rising, turns_of
from warpchain.results.signals import forward, strand_tension
from warpchain.results.units import shown
from warpchain.view.figures.style import LINES, Array, arrowed, panels, rpm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEWEST = 6
"""Blocks that a run-up must have."""
RISE = 1.25
"""Fastest over slowest block from which a run counts as one over speeds."""
MOST = 6
"""Orders that are cut."""
USUAL = (2.0, 4.0, 0.5, 1.0)
"""Orders that are cut where motions and loads excite fewer."""


def telling_orders(drive: Drive) -> list[float]:
    """Orders of the driver to be cut: what harmonics of motions and loads excite, tooth passing and its half."""
    from warpchain.assembly.tables import shaft_ratio

    teeth = drive.sprockets[drive.driver].teeth
    found: set[float] = set()
    for s, sprocket in enumerate(drive.sprockets):
        turns = teeth / sprocket.teeth
        for cause in (sprocket.prescribed, sprocket.load):
            for harmonic in () if cause is None else cause.harmonics:
                if harmonic.amplitude != 0.0:
                    found.add(round(harmonic.order / shaft_ratio(drive, s, harmonic.shaft) * turns, 9))
    found |= set(USUAL[: max(0, len(USUAL) - len(found))])
    return [*sorted(found - {float(teeth)})[: MOST - 1], float(teeth)]


def run_up_cuts(found: HandedIn) -> dict[str, tuple[str, dict[str, Cuts]]]:
    """Order cuts by what they are of: shaft speeds, tensions, hub forces, with unit; {} where speeds hardly differ.

    Taken over the whole recording, from where the driver turns forward for good.
    """
    drive, whole = found.drive, found.whole
    if any(getattr(whole, name) is None for name in ("sprocket_speed", "sprocket_angle", "position", "tension")):
        return {}
    turns = turns_of(whole)
    part = rising(turns)
    if len(turns[part]) < 64 or np.diff(turns[part]).max() > 0.25:
        return {}
    orders = telling_orders(drive)
    assert whole.sprocket_speed is not None

    def cuts(values: Array) -> Cuts:
        return order_cuts(whole.time[part], turns[part], np.nan_to_num(values[part]), orders)

    speeds = {p.name: forward(drive, whole.sprocket_speed, s) for s, p in enumerate(drive.sprockets)}
    first = cuts(next(iter(speeds.values())))
    if len(first.speed) < FEWEST or first.speed.max() < RISE * first.speed.min():
        return {}
    hubs = HandedIn(whole, 0.0, float(whole.time[-1])).hubs
    signals = {
        "speed of the shaft": ("rad/s", speeds),
        "tension at mid-strand": (
            "N", {arrowed(name): strand_tension(whole, k) for k, name in enumerate(drive.strand_names)},
        ),
        "force on the hub": (
            "N", {p.name: np.hypot(*hubs[:, s].T) for s, p in enumerate(drive.sprockets)},
        ),
    }  # fmt: skip
    return {title: (unit, {name: cuts(values) for name, values in of.items()}) for title, (unit, of) in signals.items()}


def cuts_figure(drive: Drive, title: str, unit: str, found: dict[str, Cuts]) -> Figure:
    """One panel a shaft or strand: amplitude of each order over the driver's speed."""
    figure, axes = panels(len(found), 1.9 * len(found) + 0.7, "", None)
    word, factor = shown(unit, *(cuts.amplitude for cuts in found.values()))
    for axis, (name, cuts) in zip(axes, found.items(), strict=True):
        for k, order in enumerate(cuts.orders):
            mark = "tooth passing" if order == drive.sprockets[drive.driver].teeth else f"order {order:g}"
            color = LINES[k % len(LINES)]
            axis.plot(rpm(1.0) * cuts.speed, factor * cuts.amplitude[:, k], color=color, lw=1.1, label=mark)
        axis.set_title(name, loc="left", fontsize=9)
        axis.set_ylim(0.0)
    figure.supylabel(f"amplitude of the {title} [{word}]", fontsize=10)
    axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    axes[-1].set_xlabel(f"speed of {drive.sprockets[drive.driver].name} [rpm], mean of {BLOCK:g} revolutions")
    return figure
