"""The picture of docs/architecture.md: the way of one value from the drive file to the force, and back."""

import argparse
from collections.abc import Iterator

from common.cases import ROOT, Line, case
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

FORTH = (
    ("Drive", "warpchain/drive/", "what the file says,\nchecked, in SI units", "chain.stiffness = 5e7"),
    ("Model", "warpchain/model/", "chains with their parts,\nsizes, stiffnesses, speeds", "model.chain.stiffness"),
    ("Assembly", "warpchain/assembly/", "the chain in its place,\nthe step's limit", "bounds the step"),
    ("Packed arrays", "warpchain/engine/pack.py", "rows of many drives,\na part each", "chains.stiffness"),
    ("Kernels", "kernels/physics/", "the time loop of\nkernels/cpu/ or gpu/", "link_force: the tension"),
)
BACK = (
    ("Run", "warpchain/results/run.py", "metrics, trajectories;\nto archive, view, study", "run.metrics"),
    ("Metrics", "warpchain/results/metrics.py", "columns of a registry,\njudged by limits", "tension_max [N]"),
    ("Outcomes", "warpchain/engine/window_sums.py", "sums of the variants,\nwhy one diverged", "ChainSums.tension_max"),
    ("Sums and frames", "kernels/sums.py", "added at each step,\nwritten at some", "the largest so far"),
)
"""Stages: name, place, what there is, and what the links' stiffness comes to there; those back from the right."""
LAST = len(FORTH) - 1
"""Column of the last stage forth, below which the first one back stands."""
WIDE, HIGH, APART, DOWN = 2.5, 1.35, 3.1, 2.15
"""Size of a box, and distances of their centers [in]."""


@case()
def architecture(_: argparse.Namespace) -> Iterator[Line]:
    """Draws the stages of a run, with what one value of the drive file is in each.

    python scripts/figures.py architecture
    """
    figure = Figure(figsize=(LAST * APART + WIDE + 0.2, DOWN + HIGH + 0.2))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set(xlim=(-0.1, LAST * APART + WIDE + 0.1), ylim=(-DOWN - 0.1, HIGH + 0.1))
    axis.axis("off")
    for row, stages in enumerate((FORTH, BACK)):
        for column, (name, place, what, value) in enumerate(stages, LAST + 1 - len(stages)):
            if not (ROOT / place).exists():
                raise SystemExit(f"architecture: no {place}")
            x, y = column * APART, -row * DOWN
            color = "#e8f0fa" if place.startswith("warpchain") else "#fdf0e0"
            axis.add_patch(_box(x, y, color))
            middle = x + 0.5 * WIDE
            axis.text(middle, y + 1.14, name, ha="center", va="center", weight="bold", fontsize=12)
            axis.text(middle, y + 0.91, place, ha="center", va="center", fontsize=8.5, family="monospace")
            axis.text(middle, y + 0.58, what, ha="center", va="center", fontsize=9.5)
            axis.text(middle, y + 0.18, value, ha="center", va="center", fontsize=9, color="#b03030", style="italic")
            if column < LAST:
                ends = (x + WIDE + 0.06, x + APART - 0.06)
                _draw_arrow(axis, *((e, y + 0.5 * HIGH) for e in (ends if row == 0 else ends[::-1])))
    _draw_arrow(axis, (LAST * APART + 0.5 * WIDE, -0.06), (LAST * APART + 0.5 * WIDE, HIGH - DOWN + 0.06))
    yield {"architecture": figure}


def _box(x: float, y: float, color: str) -> FancyBboxPatch:
    """Box with its lower left corner at (x, y)."""
    return FancyBboxPatch((x, y), WIDE, HIGH, boxstyle="round,pad=0,rounding_size=0.1", fc=color, ec="#606060")


def _draw_arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draws an arrow from start to end."""
    axis.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "#404040", "lw": 1.6})
