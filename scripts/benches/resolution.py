"""Changes by shorter steps where friction takes hold within a few steps, a ramp is over in some, or joints give way."""

import argparse
import math
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case, case_option

from benches.drives import drive_by_name
from benches.steps import EXAMPLES, SHORT
from warpchain import Drive, Limits, Record, simulate
from warpchain.assembly.timestep import automatic_step
from warpchain.drive.paths import changed_part

METRICS = ("tension_mean", "tension_q999", "tension_std", "friction_power")
TIMES = {"joint friction": (1.0, 5.0, 10.0, 20.0, 50.0), "ramp": (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)}
"""By what the friction coefficient of the joints and the driver's ramp are multiplied."""


@case(
    case_option("--copies", type=int, default=4, help="1e-9 pitches apart"),
    case_option("--of", nargs="+", choices=TIMES, default=list(TIMES), help="what is varied"),
    case_option("--drives", nargs="+", metavar="NAME", default=list(EXAMPLES), help="examples"),
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
        drive = drive_by_name(name)
        paths = {
            "joint friction": "chain.joint.friction",
            "ramp": f"sprockets.{drive.sprockets[drive.driver].name}.prescribed.ramp_time",
        }
        for what in asked.of:
            for times in TIMES[what]:
                varied = changed_part(drive, {paths[what]: times * drive.get_value(paths[what])})
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


START = (0.2, 0.4)
"""Window of a start [s]."""
STARTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "light motor, drum loaded early": {"shafts.drum.load.ramp_time": 0.1625, "shafts.motor.inertia": 0.002509},
    "light motor, stiff chain with play": {
        "shafts.motor.inertia": 0.002186,
        "sprockets.driven.inertia": 13.0,
        "chain.stiffness": 9.929e7,
        "chain.play": 3.535e-6,
        "chain.damping_ratio": 8.167e-4,
        "contact.sprocket.restitution": 0.6786,
    },
}
"""Starts of `conveyor`: what is changed of it."""


def start_metrics(drive: Drive, part: int, copies: int) -> list[dict[str, Any]]:
    """Metrics of copies of a start, 1e-9 pitches apart, at a part of the automatic step."""
    drive = changed_part(drive, {"run.duration": START[1], "run.step": automatic_step(drive) / part})
    run = simulate(drive, window=START, replicates=copies, replicate_by="perturbation", record=Record("none"),
                   limits=Limits(energy_change=math.inf))  # fmt: skip
    return run.metrics.to_pylist()


@case()
def starts(asked: argparse.Namespace) -> Iterator[Line]:
    """Starts of `conveyor` at the automatic step, at a half, a quarter and an eighth of it: the slack strand.

    python scripts/bench.py starts
    """
    warnings.simplefilter("ignore")
    slack = "driver->driven"
    yield ("conveyor", "step", "tension_q999 [N]", "joint_give [%]", "joints.resolution", "status")
    for words, values in STARTS.items():
        for part in (1, 2, 4, 8):
            (row,) = start_metrics(changed_part(drive_by_name("conveyor"), values), part, 1)
            give = f"{100.0 * row[f'{slack}.joint_give']:.2f}"
            fewest = f"{row['joints.resolution']:.0f}"
            yield (words, f"1/{part}", f"{row[f'{slack}.tension_q999']:.0f}", give, fewest, row["status"])


VARIED = {
    "conveyor": (
        "chain.damping_ratio",
        "chain.joint.friction",
        "contact.sprocket.restitution",
        "contact.sprocket.friction",
        "couplings.coupling.stiffness",
        "sprockets.driven.inertia",
        "shafts.motor.inertia",
        "shafts.motor.motor.ramp_time",
        "shafts.drum.inertia",
        "shafts.drum.load.torque",
        "shafts.drum.load.ramp_time",
    ),
    "motorcycle_drivetrain": (
        "chain.damping_ratio",
        "chain.joint.friction",
        "contact.sprocket.restitution",
        "contact.sprocket.friction",
    ),
}
"""Values that are multiplied at random by exp(0.5 x), x normal; so are stiffnesses of chains."""


@case(
    case_option("--count", type=int, default=16, help="starts of each drive"),
    case_option("--seed", type=int, default=1, help="of what is varied"),
    case_option("--drives", nargs="+", metavar="NAME", choices=VARIED, default=list(VARIED), help="examples"),
)
def gives(asked: argparse.Namespace) -> Iterator[Line]:
    """Random starts: how often a strand's 99.9 % tension changes by more than 5 % where the give of joints tells so.

    python scripts/bench.py gives

    Each at the automatic step and at half of it, held against a quarter of it; means of two copies 1e-9 pitches apart.
    A change of less than twice their scatter is none.
    """
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(asked.seed)
    found = []
    for name in asked.drives:
        for _ in range(asked.count):
            drive = drive_by_name(name)
            values = {path: drive.get_value(path) * math.exp(0.5 * rng.normal()) for path in VARIED[name]}
            values["chain.stiffness"] = drive.chain.stiffness * math.exp(0.5 * rng.normal())
            values["contact.sprocket.restitution"] = min(values["contact.sprocket.restitution"], 0.9)
            drive = changed_part(drive, values)
            whole, half, quarter = (start_metrics(drive, part, 2) for part in (1, 2, 4))
            found += [joint_give_and_change(drive, rows, quarter) for rows in (whole, half)]
    yield ("limit [%]", "runs", "suspect, and changes", "suspect, does not", "ok, but changes", "ok, does not")
    give, change = np.array(found).T
    for limit in (0.01, 0.02, 0.05, 0.1):
        suspect, changes = give > limit, change > 0.05
        counts = (suspect & changes, suspect & ~changes, ~suspect & changes, ~suspect & ~changes)
        yield (f"{100.0 * limit:g}", str(len(found)), *(str(int(each.sum())) for each in counts))


def joint_give_and_change(drive: Drive, rows: list[dict[str, Any]], finer: list[dict[str, Any]]) -> tuple[float, float]:
    """The largest `joint_give` of strands, and the change of a strand's `tension_q999` by finer steps over it."""
    most = 0.0
    for strand in drive.strand_names:
        own, other = (np.array([row[f"{strand}.tension_q999"] for row in of]) for of in (rows, finer))
        change, scatter = abs(own.mean() - other.mean()), own.std() + other.std()
        most = max(most, change / other.mean() if change > 2.0 * scatter else 0.0)
    return max(rows[0][f"{strand}.joint_give"] for strand in drive.strand_names), most
