"""Guides with profiles."""

import argparse
import math
import re
from pathlib import Path
from typing import Any

import matplotlib
from common.cases import case, option

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive, loads_drive

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "guides-and-tensioners.md"
SPACING = 5e-4


def drive() -> Drive:
    """The drive that stands in the document."""
    found = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found is not None
    return loads_drive(found.group(1))


def turned(points: NDArray[np.float64], pivot: tuple[float, float], angle: float) -> NDArray[np.float64]:
    """Points (n, 2) [m] turned about a pivot by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return (points - np.array(pivot)) @ np.array([[c, s], [-s, c]]) + np.array(pivot)


def draw(axes: Any, drive: Drive) -> None:
    """Pitch circles, faces, arms and tensioners."""
    for s, sprocket in enumerate(drive.sprockets):
        axes.add_patch(plt.Circle(sprocket.center, drive.pitch_radius(s), fill=False, color="0.6"))
        axes.text(*sprocket.center, sprocket.name, ha="center", va="center")
    for g, guide in enumerate(drive.guides):
        profile, a = drive.profile(g), drive.arm_of(g)
        face, centers = profile.points(SPACING), profile.offset_points(drive.guide_offset(g), SPACING)
        if a is not None:
            arm = drive.arms[a]
            axes.plot(*arm.pivot, "o", color="tab:red", markersize=5)
            for stop in arm.stops_rad:
                axes.plot(*turned(face, arm.pivot, stop).T, color="tab:blue", alpha=0.3, linewidth=1.0)
        axes.plot(*face.T, color="tab:blue", linewidth=2.0)
        axes.plot(*centers.T, color="tab:orange", linewidth=0.8, linestyle="--")
        joints = np.array([piece.start for piece in (*profile.face, profile.pieces[-1])])
        axes.plot(*joints.T, "k.", markersize=4)
        middle, heading = profile.at(0.5 * profile.face_length)
        side = (12.0 * math.sin(heading), -12.0 * math.cos(heading))
        place = {"ha": "right" if side[0] < 0 else "left", "va": "center"}
        axes.annotate(guide.name, middle, xytext=side, textcoords="offset points", **place)
    for tensioner in drive.tensioners:
        (x, y), (ux, uy) = tensioner.at, tensioner.unit_direction
        arrow = {"arrowstyle": "-|>", "color": "tab:red"}
        axes.annotate("", (x, y), xytext=(x - 0.03 * ux, y - 0.03 * uy), arrowprops=arrow)


@case(option("-o", "--output", type=Path, default=ROOT / "docs" / "images", help="folder of the figure"))
def guide_profiles(asked: argparse.Namespace) -> None:
    """The drive of docs/guides-and-tensioners.md: faces, rollers' centers over them, its arm at both stops.

    python scripts/figures.py guide-profiles [-o docs/images]
    """
    folder = asked.output
    figure, axes = plt.subplots(figsize=(5.0, 7.0), layout="constrained")
    draw(axes, drive())
    axes.set_aspect("equal")
    axes.margins(0.06)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.savefig(folder / "guide-profiles.png", dpi=110, bbox_inches="tight")
