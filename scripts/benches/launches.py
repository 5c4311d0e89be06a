"""A GPU's launches counted on the host: how long its blocks have something to do."""

import argparse
from collections.abc import Iterator, Sequence
from heapq import heapify, heappop, heappush, heapreplace

import numpy as np
from common.cases import Line, case, case_option
from numpy.typing import NDArray

from benches.drives import RANGES, drive_by_name, varied_designs
from benches.gpu import DESIGNS
from warpchain import Record
from warpchain.engine.gpu import gpu_launch_steps
from warpchain.engine.launches import (
    LAUNCH_PARTS,
    Launch,
    launch_groups,
    metrics_start_steps,
    next_launch_steps,
    split_launches,
    steps_left,
)
from warpchain.engine.pipeline import MOST_PER_GPU, split_variants
from warpchain.engine.simulation import schedules_of
from warpchain.engine.subensemble import Variants
from warpchain.model.stacks import stacks_of_drives

DRIVES = np.dtype([("steps", int), ("window_start", int), ("window_end", int)])
PROGRESS = np.dtype([("step", int), ("diverged", int)])
MEASURED = 1.5
"""Time of a step with metrics, in steps without."""
Lanes = Sequence[Sequence[Launch]]


def counted_runs(steps: NDArray[np.integer]) -> NDArray[np.void]:
    """Variants of so many steps, measured over the latter half."""
    drives = np.zeros(len(steps), DRIVES)
    drives["steps"] = drives["window_end"] = steps
    drives["window_start"] = steps // 2
    return drives


def launch_calls(drives: NDArray[np.void], most: int, turn: int) -> Iterator[Lanes]:
    """Launches of a run, call by call and group by group, as the engine makes them."""
    progress = np.zeros(len(drives), PROGRESS)
    while (left := steps_left(drives, progress)).any():
        share, step = next_launch_steps(left, most), progress["step"]
        order = np.argsort(-share, kind="stable")
        parts, begins = launch_groups(order[share[order] > 0], turn), metrics_start_steps(drives, step)
        yield [list(split_launches(part, step, share, begins, LAUNCH_PARTS if len(parts) > 1 else 1)) for part in parts]
        progress["step"] += share


def slots_time(lanes: Lanes, slots: int, at: NDArray[np.integer]) -> float:
    """Time at which slots of a GPU have stepped variants through launches, a lane's one after another."""
    free, waiting = [0.0] * slots, [(0.0, 0, lane) for lane in range(len(lanes))]
    heapify(waiting)
    while waiting:
        ready, number, lane = heappop(waiting)
        launch, over = lanes[lane][number], ready
        each = (launch.end_steps - at[launch.variants]) * (MEASURED if launch.kernel == "measure" else 1.0)
        for length in each.tolist():
            ends = max(free[0], ready) + length
            heapreplace(free, ends)
            over = max(over, ends)
        at[launch.variants] = launch.end_steps
        if number + 1 < len(lanes[lane]):
            heappush(waiting, (over, number + 1, lane))
    return max(free)


def occupied_share(drives: NDArray[np.void], most: int, slots: int) -> float:
    """Time of a run in launches of at most so many steps, over that of as many steps spread evenly over all slots."""
    at = np.zeros(len(drives), int)
    taken = sum(slots_time(lanes, slots, at) for lanes in launch_calls(drives, most, slots))
    bare = np.minimum(metrics_start_steps(drives, at * 0), drives["steps"] + 1)
    return taken * slots / float((bare + MEASURED * (drives["steps"] + 1 - bare)).sum())


@case(
    case_option("--drives", nargs="+", choices=list(RANGES), default=["marine", "car"], help="default marine car"),
    case_option("--slots", type=int, default=1584, help="blocks that a GPU holds at once (default 1584)"),
)
def launches(asked: argparse.Namespace) -> Iterator[Line]:
    """Time of 10,000 designs in a GPU's launches, over that of as many steps spread evenly, counted on the host.

    python scripts/bench.py launches

    In the shares of one GPU; beside as many drives that all take their mean number of steps. A step with metrics counts
    1.5 without.
    """
    yield ("drive", "most of least steps", "of evenly spread", "drives of equal steps", "ratio")
    for name in asked.drives:
        drives = varied_designs(drive_by_name(name), name, DESIGNS)
        stacks = stacks_of_drives(drives, DESIGNS)
        schedules = schedules_of(drives, None, None, Record("none"), None, stacks)
        parts = split_variants(Variants(drives, schedules, stacks, np.arange(DESIGNS)), 1, MOST_PER_GPU)
        steps = np.array([schedule.steps for schedule in schedules])
        found = [
            sum(
                len(part.drives)
                / DESIGNS
                * occupied_share(counted_runs(each[part.numbers]), most_steps(part), asked.slots)
                for part in parts
            )
            for each in (steps, np.full(len(steps), int(steps.mean())))
        ]
        yield (name, steps.max() / steps.min(), *map(float, found), float(found[0] / found[1]))


def most_steps(members: Variants) -> int:
    """Most steps of a launch of some variants."""
    return gpu_launch_steps(float(sum(drive.links for drive in members.drives)), 2**31 - 1)
