"""A chain that wears: rollers climb the flanks as links lengthen, on the drive of compare_profiles.py.

    python scripts/wear_study.py [docs/images/wear.png]

The driven sprocket moves out as the chain grows, as a tensioner would have it. Radial places are means over a second of
running, taken by the pitches since a roller came to the driver.
"""

import argparse
import math
from pathlib import Path

import numpy as np
from compare_profiles import BEGIN, COLORS, PITCH, PROFILES, TEETH, drive
from matplotlib.axes import Axes

from warpchain import Drive, Record, Trajectory, simulate
from warpchain.results.scene import nearest_sprocket, tooth_outline

ELONGATIONS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03)
LINK = 40  # the one that is worn alone
SHOWN = "iso606, maximum gap"


def worn(profile: str, elongation: float) -> Drive:
    """The drive with all links longer by `elongation`, its sprockets as far apart as keeps the chain taut."""
    span = 29.5 * PITCH * (1.0 + elongation) * (1.0 + 1e-4)
    return drive(profile).with_values({"chain.elongation": elongation, "sprockets.driven.center": [span, 0.0]})


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


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("picture", nargs="?", type=Path, help="where to save the figure; default: nowhere")
    return made


def main() -> None:
    """Prints the table and draws the figure."""
    target = parser().parse_args().picture
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
    print("profile               elongation   climb on the driver   tension mean / max   losses of contacts   diverged")
    heights = []
    for v, (name, e) in enumerate(cases):
        where, radial = radial_places(run[v])
        heights.append(radial.max())
        losses = (rows[v]["driver.dissipated"] + rows[v]["driven.dissipated"]) / (1.2 - BEGIN)
        print(
            f"{name:20s} {100 * e:10.1f} % {100 * radial.max():16.2f} % {rows[v]['tension_mean']:14.0f} / "
            f"{rows[v]['tension_max']:.0f} N {losses:16.1f} W {rows[v]['diverged']:10d}"
        )
        if name == SHOWN:
            place.plot(where, 100.0 * radial, color=shades[ELONGATIONS.index(e)], label=f"{100 * e:g} %")
    percent = 100.0 * np.array(ELONGATIONS)
    for name, color in zip(PROFILES, COLORS, strict=True):
        mine = [v for v, case in enumerate(cases) if case[0] == name]
        climb.plot(percent, 100.0 * np.array(heights)[mine], "o-", color=color, label=name)
    climb.plot(percent, percent, "--", color="0.5", label="links of that length on every tooth")
    for k, label in enumerate(("the roller before", "its first roller", "its second roller", "the roller after")):
        where, radial = radial_places(run[len(cases)], slice(LINK - 1 + k, LINK + k))
        single.plot(where, 100.0 * radial, label=label)
        print(f"one link longer by 3 %: {label} up to {100 * radial.max():.2f} %")
    last = cases.index((SHOWN, ELONGATIONS[-1]))
    draw(picture, run[last])
    place.set(xlabel="pitches since arrival on the driver", ylabel="off the pitch circle [%]", title=SHOWN)
    place.legend(fontsize=8, ncols=2)
    climb.set(xlabel="elongation [%]", ylabel="off the pitch circle [%]", title="highest roller on the driver, mean")
    climb.legend(fontsize=8)
    single.set(xlabel="pitches since arrival on the driver", ylabel="off the pitch circle [%]")
    single.set_title(f"{SHOWN}, one link 3 % longer")
    single.legend(fontsize=8)
    for axes in (place, climb, single):
        axes.grid(alpha=0.3)
    if target is not None:
        figure.savefig(target, dpi=110)


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


if __name__ == "__main__":
    main()
