"""Scatters of one quantity over another for Rerun, a dot a variant that tells its values when it is selected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.view.colors import Color
from warpchain.view.rerun.chart import Chart, around

if TYPE_CHECKING:
    import rerun as rr

INPUTS, METRICS = 3, 4
"""Most inputs and metrics that scatters are drawn for where none are named."""
WIDTH = 1.1
"""Width of a scatter over its height."""


@dataclass(frozen=True)
class Quantity:
    """What an axis is of.

    Attributes:
        name: a factor or metric.
        values: (R,) its values; dots are drawn where they are finite.
        unit: its unit, "" for none.
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""

    @property
    def title(self) -> str:
        """The name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Dots:
    """Dots of one kind.

    Attributes:
        kind: what they are called.
        color, size: how they look; the size in pixels.
        rows: (K,) which rows are drawn so.
    """

    kind: str
    color: Color
    size: float
    rows: NDArray[np.intp]


def log_scatter(
    stream: rr.RecordingStream,
    root: str,
    x: Quantity,
    y: Quantity,
    groups: Sequence[Dots],
    variants: NDArray[np.integer],
    ranged: NDArray[np.bool_] | None = None,
) -> Chart:
    """Logs one scatter.

    Args:
        root: first part of its path.
        x, y: what is drawn over each other.
        groups: the dots, the last ones on top.
        variants: (R,) number of each row's variant.
        ranged: (R,) rows that the vertical axis holds; None is all.
    """
    held = y.values if ranged is None else y.values[ranged]
    axes = around(x.values, x.name), around(held, "")
    chart = Chart(stream, (root, x.name, y.title), *axes, WIDTH, few=True)
    chart.frame()
    for dots in groups:
        rows = dots.rows[np.isfinite(x.values[dots.rows]) & np.isfinite(y.values[dots.rows])]
        if len(rows):
            words = [
                f"variant {variants[r]}: {x.name} = {x.values[r]:.6g}, {y.name} = {y.values[r]:.6g} {y.unit}".rstrip()
                for r in rows
            ]
            chart.dots(dots.kind, x.values[rows], y.values[rows], words, dots.color, dots.size)
    return chart
