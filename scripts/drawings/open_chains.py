"""Figures of the open chains of docs/open-chains.md."""

import argparse
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example_drive

from warpchain import Limits, Record, simulate
from warpchain.view.figures.figure_style import panel_grid


@case()
def hoist(_: argparse.Namespace) -> Iterator[Line]:
    """Tension at the weight of `hoist` and `fork_lift`, its height, and how far it swings.

    python scripts/figures.py hoist

    Prints of each the largest tension at the weight over that at rest, and what is left over in the energy balance.
    """
    figure, axes = panel_grid(4, 2, 6.0, 2.1)
    yield ("drive", "at rest [kN]", "largest [kN]", "over that at rest", "risen [m]", "swing [mm]", "energy residual")
    for k, (name, end) in enumerate((("hoist", "load"), ("fork_lift", "carriage"))):
        drive = example_drive(name)
        run = simulate(drive, record=Record(rate=1000.0), window=(0.0, drive.run.duration), limits=Limits())
        (row,) = run.metrics.to_pylist()
        s = next(s for s, sprocket in enumerate(drive.sprockets) if sprocket.name == end)
        tension = np.asarray(run[0].tension, float)[:, 0 if s == 0 else drive.chain.links - 1]
        place = np.asarray(run[0].sprocket_center, float)[:, s]
        still = float(drive.sprockets[s].mass or 0.0) * 9.81
        pulling, rising = axes[2 * k : 2 * k + 2]
        pulling.plot(run[0].time, 1e-3 * tension)
        pulling.axhline(1e-3 * still, color="0.5", lw=0.8, ls="--", label="its weight")
        pulling.set_ylabel(f"{name}: tension [kN]")
        rising.plot(run[0].time, place[:, 1] - place[0, 1])
        rising.set_ylabel("height [m]")
        pulling.legend(fontsize=7, frameon=False)
        swing = 1e3 * float(np.ptp(place[:, 0]))
        risen = float(place[-1, 1] - place[0, 1])
        most = float(tension.max())
        yield (
            f"`{name}`", f"{1e-3 * still:.2f}", f"{1e-3 * most:.2f}", f"{most / still:.2f}", f"{risen:.3f}",
            f"{swing:.1f}", f"{row['energy_residual_relative']:.0e}",
        )  # fmt: skip
    for axis in axes:
        axis.margins(x=0.0)
    for axis in axes[-2:]:
        axis.set_xlabel("time [s]")
    yield {"hoist": figure}
