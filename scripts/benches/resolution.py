"""Changes by half the step where friction takes hold within a few steps, or a ramp is over in some."""

import argparse
import warnings
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case, option

from benches.drives import named
from benches.steps import EXAMPLES, SHORT
from warpchain import Record, simulate
from warpchain.assembly.timestep import automatic_step
from warpchain.drive.paths import changed

METRICS = ("tension_mean", "tension_q999", "tension_std", "friction_power")
TIMES = {"joint friction": (1.0, 5.0, 10.0, 20.0, 50.0), "ramp": (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)}
"""By what the friction coefficient of the joints and the driver's ramp are multiplied."""


@case(
    option("--copies", type=int, default=4, help="1e-9 pitches apart"),
    option("--of", nargs="+", choices=TIMES, default=list(TIMES), help="what is varied"),
    option("--drives", nargs="+", metavar="NAME", default=list(EXAMPLES), help="examples"),
)
def resolution(asked: argparse.Namespace) -> Iterator[Line]:
    """Examples with more and more friction in the joints, and shorter ramps, at the automatic step and at half of it.

    python scripts/bench.py resolution --of "joint friction"
    python scripts/bench.py resolution --of ramp --copies 1

    The change is that of the metric that changes most, of means between copies; their scatter stands beside it. The
    drift is the largest change of the mean tension over the window, over that mean.
    """
    warnings.simplefilter("ignore")
    yield ("drive", "times", "fewest steps", "drift [%]", "half the step changes", "by [%]", "scatter [%]", "status")
    for name in asked.drives:
        drive = named(name)
        paths = {
            "joint friction": "chain.joint.friction",
            "ramp": f"sprockets.{drive.sprockets[drive.driver].name}.prescribed.ramp_time",
        }
        for what in asked.of:
            for times in TIMES[what]:
                varied = changed(drive, {paths[what]: times * drive.get_value(paths[what])})
                whole, half = (
                    simulate(varied, replicates=asked.copies, replicate_by="perturbation", duration=SHORT.get(name),
                             step=automatic_step(varied) / parts, record=Record("none")).metrics
                    for parts in (1, 2)
                )  # fmt: skip
                fewest = min(
                    np.nanmin(np.asarray(whole[c], float)) for c in whole.column_names if c.endswith(".resolution")
                )
                found = {of: [np.asarray(table[of], float) for table in (whole, half)] for of in METRICS}
                changes = {of: a.mean() / b.mean() - 1.0 for of, (a, b) in found.items()}
                most = max(changes, key=lambda of: abs(changes[of]))
                scatter = found[most][0].std() / found[most][0].mean()
                drift = np.abs(np.asarray(whole["tension_drift"], float) / found["tension_mean"][0]).max()
                status = ", ".join(sorted(set(whole["status"].to_pylist())))
                numbers = f"{100.0 * changes[most]:+.1f}", f"{100.0 * scatter:.1f}"
                yield (name, f"{what} x {times:g}", f"{fewest:.0f}", f"{100.0 * drift:.1f}", most, *numbers, status)
