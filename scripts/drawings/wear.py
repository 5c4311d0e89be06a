"""A chain that wears."""

import argparse
import math
from pathlib import Path

import numpy as np
from common.cases import case, option
from matplotlib.axes import Axes

from drawings.profiles import BEGIN, COLORS, PITCH, PROFILES, TEETH, drive
from warpchain import Drive, Record, Trajectory, simulate
from warpchain.results.scene import nearest_sprocket, tooth_outline

ELONGATIONS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03)  # of the chain; its outer links have twice that
LINK = 40  # the one that is worn alone, an outer one
SHOWN = "iso606, maximum gap"


def worn(profile: str, elongation: float) -> Drive:
    """The drive with a chain worn by `elongation` as a whole, its sprockets as far apart as keeps the chain taut."""
    span = 29.5 * PITCH * (1.0 + elongation) * (1.0 + 1e-4)
    outer = {"elongation": 2.0 * elongation}
    return drive(profile).with_values({"chain.outer": outer, "sprockets.driven.center": [span, 0.0]})


def radial_places(trajectory: Trajectory, rollers: slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
    """Pitches since arrival on the driver, and there the rollers' mean radius over the pitch radius, less one."""
    assert trajectory.position is not None and trajectory.sprocket_center is not None
    arm = trajectory.position - trajectory.sprocket_center[:, None, 0]
    on = (nearest_sprocket(trajectory) == 0) & (trajectory.time > BEGIN)[:, None]
    arm, on = arm[:, rollers], on[:, rollers]
    # the driver is wrapped from its highest to its lowest point
    pitches = np.mod(np.arctan2(arm[..., 1], arm[..., 0])[on] - 0.5 * math.pi, 2.0 * math.pi) / (2.0 * math.pi / TEETH)
    radius = np.hypot(arm[..., 0], arm[..., 1])[on] / trajectory.drive.pitch_radius(0) - 1.0
    edges = np.arange(0.5, TEETH / 2 - 0.4, 0.25)
    total, _ = np.histogram(pitches, edges, weights=radius)
    count, _ = np.histogram(pitches, edges)
    return 0.5 * (edges[:-1] + edges[1:]), total / np.maximum(count, 1)


def draw(axes: Axes, trajectory: Trajectory) -> None:
    """The driver with its chain at the end of the run."""
    assert trajectory.position is not None and trajectory.sprocket_angle is not None
    outline = tooth_outline(trajectory.drive, 0)
    angle = trajectory.sprocket_angle[-1, 0]
    c, s = math.cos(angle), math.sin(angle)
    teeth = 1e3 * np.stack([outline[:, 0] * c - outline[:, 1] * s, outline[:, 0] * s + outline[:, 1] * c], axis=1)
    axes.fill(teeth[:, 0], teeth[:, 1], color="0.85", ec="0.4", linewidth=0.8)
    rollers = 1e3 * trajectory.position[-1]
    radius = 1e3 * trajectory.drive.chain.roller_radius
    turn = np.linspace(0.0, 2.0 * math.pi, 60)
    for x, y in rollers[rollers[:, 0] < 60.0]:
        axes.plot(x + radius * np.cos(turn), y + radius * np.sin(turn), color=COLORS[0], linewidth=1.0)
    round_trip = 1e3 * trajectory.drive.pitch_radius(0)
    axes.plot(round_trip * np.cos(turn), round_trip * np.sin(turn), ":", color="0.3", linewidth=0.8)
    axes.plot(*np.vstack([rollers, rollers[:1]]).T, color=COLORS[1], linewidth=0.8)
    axes.set(xlim=(-100, 60), ylim=(-95, 95), xlabel="[mm]", title=f"{SHOWN}, {100 * ELONGATIONS[-1]:g} % longer")
    axes.set_aspect("equal")


@case(option("picture", nargs="?", type=Path, help="where to save the figure; default: nowhere"))
def wear(asked: argparse.Namespace) -> None:
    """A chain that wears: rollers climb the flanks as outer links lengthen, on the drive of `profiles`.

    python scripts/figures.py wear [docs/images/wear.png]

    Wear lengthens outer links only, by twice what the chain grows on the whole. The driven sprocket moves out with it,
    as a tensioner would have it. Radial places are means over a second of running, taken by the pitches since a roller
    came to the driver.
    """
    target = asked.picture
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    cases = [(name, e) for name in PROFILES for e in ELONGATIONS]
    drives = [worn(PROFILES[name], e) for name, e in cases]
    drives.append(worn(PROFILES[SHOWN], 0.0).with_values({"chain.worn_links": [{"link": LINK, "elongation": 0.03}]}))
    run = simulate(drives, record=Record(variants="all", rate=2e3), window=(BEGIN, 1.2))
    rows = run.metrics.to_pylist()
    figure, ((place, climb), (picture, single)) = plt.subplots(2, 2, figsize=(11, 8.5), constrained_layout=True)
    shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, len(ELONGATIONS)))
    print(
        "profile               elongation   climb: outer / inner link follows   tension mean / max   losses of contacts"
    )
    heights = np.empty((len(cases), 2))
    for v, (name, e) in enumerate(cases):
        shade = shades[ELONGATIONS.index(e)]
        for first, style in enumerate(("-", "--")):
            where, radial = radial_places(run[v], slice(first, None, 2))
            heights[v, first] = radial.max()
            if name == SHOWN:
                label = None if first else f"{100 * e:g} %"
                place.plot(where, 100.0 * radial, style, color=shade, label=label)
        losses = (rows[v]["driver.dissipated"] + rows[v]["driven.dissipated"]) / (1.2 - BEGIN)
        print(
            f"{name:20s} {100 * e:10.1f} % {100 * heights[v, 0]:12.2f} % / {100 * heights[v, 1]:.2f} % "
            f"{rows[v]['tension_mean']:21.0f} / {rows[v]['tension_max']:.0f} N {losses:10.1f} W  {rows[v]['status']}"
        )
    percent = 100.0 * np.array(ELONGATIONS)
    for name, color in zip(PROFILES, COLORS, strict=True):
        mine = [v for v, case in enumerate(cases) if case[0] == name]
        climb.plot(percent, 100.0 * heights[mine, 0], "o-", color=color, label=f"{name}: an outer link follows")
        climb.plot(percent, 100.0 * heights[mine, 1], "o--", color=color, mfc="white", label=f"{name}: an inner one")
    climb.plot(percent, percent, ":", color="0.4", label="an outer and an inner link on every two teeth")
    for k, label in enumerate(("the roller before", "its first roller", "its second roller", "the roller after")):
        where, radial = radial_places(run[len(cases)], slice(LINK - 1 + k, LINK + k))
        single.plot(where, 100.0 * radial, label=label)
        print(f"one link longer by 3 %: {label} up to {100 * radial.max():.2f} %")
    last = cases.index((SHOWN, ELONGATIONS[-1]))
    draw(picture, run[last])
    place.set(xlabel="pitches since arrival on the driver", ylabel="off the pitch circle [%]")
    place.set_title(f"{SHOWN}; dashed: an inner link follows")
    place.legend(fontsize=8, ncols=2)
    climb.set(xlabel="elongation of the chain [%]", ylabel="off the pitch circle [%]")
    climb.set_title("highest rollers on the driver, mean")
    climb.legend(fontsize=8)
    single.set(xlabel="pitches since arrival on the driver", ylabel="off the pitch circle [%]")
    single.set_title(f"{SHOWN}, one link 3 % longer")
    single.legend(fontsize=8)
    for axes in (place, climb, single):
        axes.grid(alpha=0.3)
    if target is not None:
        figure.savefig(target, dpi=110)
