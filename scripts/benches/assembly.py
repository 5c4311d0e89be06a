"""Drives that differ, before the kernels."""

import argparse
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from typing import Any
from unittest import mock

import numpy as np
from common.cases import Line, case, case_option
from common.drives import Values, example_drive
from common.timing import function_times

from benches.drives import two_sprocket_kinds
from warpchain import Record, simulate
from warpchain.assembly import assemble
from warpchain.assembly.stack_assembly import assemble_stacks, layout_faults_of_drives
from warpchain.drive import Drive
from warpchain.drive.changed_copies import DriveChanges
from warpchain.engine import pack as packing
from warpchain.engine import simulation, start_warp, subensemble
from warpchain.engine.chain_rows import ChainRows
from warpchain.model.stacks import stacks_of_drives
from warpchain.study.run.row_drives import adjusted_drives
from warpchain.study.spec.study_tables import Adjust

STAGES = ("made", "by changes", "adjusted", "sorted", "steps", "assembled", "packed", "layouts")
ALONE = ("alone", "assembled alone", "fit alone")
NONE = Record("none")
SLOW = 10
"""Laying chains around guides takes its time: so many times fewer variants of a drive with arms."""


def varied_link_values(drive: Drive, unlike: str, random: np.random.Generator) -> Values:
    """Values of a variant's links: three worn ones, all worn, other outer ones, or play, each within a hundredth."""
    chain, about = drive.chain, 1.0 + 0.01 * random.random(drive.chain.links)
    places = {"worn": random.choice(chain.links, 3, replace=False), "each": np.arange(chain.links)}
    if unlike in places:
        return {"chain.worn_links": [{"link": int(k), "elongation": 0.003 * about[k]} for k in places[unlike]]}
    outer = {"elongation": 0.003 * about[0], "stiffness": 1.2 * chain.stiffness * about[1]}
    return {"": {}, "outer": {"chain.outer": outer}, "play": {"chain.play": 1e-3 * chain.pitch * about[0]}}[unlike]


def variant_values(drive: Drive, unlike: str, random: np.random.Generator) -> Values:
    """Values of a variant: each within a hundredth of the drive's own, the place within a fiftieth of a pitch."""

    def nearby_value(value: float) -> float:
        """A value up to a hundredth larger."""
        return value * (1.0 + 0.01 * float(random.random()))

    driver, last = drive.sprockets[drive.driver], drive.sprockets[-1]
    x, _ = drive.sprockets[1].center
    return {
        "chain.stiffness": nearby_value(drive.chain.stiffness),
        f"sprockets.{driver.name}.prescribed.speed": nearby_value(
            driver.prescribed.top_speed if driver.prescribed else 0.0
        ),
        f"sprockets.{drive.sprockets[1].name}.center.0": x + 0.02 * drive.chain.pitch * float(random.random() - 0.5),
        f"sprockets.{last.name}.load.torque": nearby_value(last.load.torque if last.load else 1.0),
        f"sprockets.{last.name}.inertia": nearby_value(last.inertia or 1.0),
        **varied_link_values(drive, unlike, random),
    }


@contextmanager
def note_least_time(times: dict[str, float], stage: str, count: int) -> Iterator[None]:
    """Notes the microseconds a variant that what is done inside takes, if it is the least so far."""
    begin = time.process_time()
    yield
    times[stage] = min(times.get(stage, np.inf), 1e6 * (time.process_time() - begin) / count)


def strain_adjustment(base: Drive) -> Adjust:
    """The second sprocket moved along x for the strain of the drive file."""
    return Adjust(sprocket=base.sprockets[1].name, direction=(1.0, 0.0), strain=float(assemble(base).strain))


def run_schedules(drives: list[Drive], stacks: Any) -> Any:
    """Whole runs without recordings."""
    return simulation.schedules_of(drives, None, None, NONE, None, stacks)


def stage_times(bases: list[Drive], unlike: str, count: int, rounds: int) -> dict[str, float]:
    """Microseconds a variant of each stage, and of one drive by itself."""
    random, times = np.random.default_rng(1), dict.fromkeys((*STAGES, *ALONE), np.inf)
    wanted = strain_adjustment(bases[0])
    for _ in range(rounds):
        values = [variant_values(bases[v % len(bases)], unlike, random) for v in range(count)]
        with note_least_time(times, "made", count):
            drives = [bases[v % len(bases)].with_values(each) for v, each in enumerate(values)]
        changes = [DriveChanges(base) for base in bases]
        with note_least_time(times, "by changes", count):
            for v, each in enumerate(values):
                changes[v % len(bases)].changed_drive(each)
        with note_least_time(times, "adjusted", count):
            adjusted_drives(drives, [wanted], [{}] * count)
        with note_least_time(times, "sorted", count):
            stacks = stacks_of_drives(drives)
        with note_least_time(times, "steps", count):
            when = run_schedules(drives, stacks)
        with note_least_time(times, "chains", count):
            rows = ChainRows(drives, stacks)
        with note_least_time(times, "assembled", count):
            assemblies = assemble_stacks(rows.stacks)
        with (
            note_least_time(times, "packed", count),
            mock.patch.object(packing, "assemble_stacks", return_value=assemblies),
        ):
            packing.pack(rows.models, when, rows.stacks)
        with note_least_time(times, "layouts", count):
            layout_faults_of_drives(rows.models, assemblies, rows.stacks)
    for drive in drives[:5] * rounds:
        with note_least_time(times, "alone", 1):
            stacks = stacks_of_drives([drive])
            rows = ChainRows([drive], stacks)
            packing.pack(rows.models, run_schedules([drive], stacks), rows.stacks)
        with note_least_time(times, "assembled alone", 1):
            assemble(drive)
        with note_least_time(times, "fit alone", 1):
            adjusted_drives([drive], [wanted], [{}])
    return times


def metrics_time(base: Drive, count: int) -> float:
    """Microseconds a variant to form the metrics of a run of a few steps on the CPU."""
    random, times = np.random.default_rng(2), []
    drives = [base.with_values({"run.settle": False} | variant_values(base, "", random)) for _ in range(count)]
    for _ in range(2):
        with function_times(time.thread_time, (subensemble, "metric_blocks"), (simulation, "metrics_table")) as found:
            simulate(drives, device="cpu", duration=40 * simulation.resolve_step(base), record=NONE)
        times.append(sum(found))
    return 1e6 * min(times) / count


@case(
    case_option("--drives", nargs="*", default=["marine", "engine", "car"], metavar="NAME", help="examples, or kinds"),
    case_option("--count", type=int, default=10_000, help="variants (of the car, a tenth of them)"),
    case_option(
        "--links", nargs="*", default=[""], choices=("worn", "each", "outer", "play"), help="ways links are unlike"
    ),
    case_option("--rounds", type=int, default=3),
    case_option("--metrics", action="store_true", help="simulate 2,000 variants for a few steps, too"),
)
def assembly(asked: argparse.Namespace) -> Iterator[Line]:
    """Many drives that differ: microseconds of CPU time a variant of each stage before the kernels, on one core.

    python scripts/bench.py assembly                       # marine, engine, car; 10,000, 10,000 and 1,000 variants
    python scripts/bench.py assembly --drives kinds        # two sprockets with 224 numbers of teeth and links
    python scripts/bench.py assembly --drives marine --count 1000 --links worn each outer play

    Stages: `made` by `Drive.with_values`, and by `Changes` as studies make them; `adjusted` as studies do, the second
    sprocket moved along x for the strain that the drive file has; `sorted` into stacks; `steps` resolved; `assembled`;
    `packed` into arrays (without assembling); `layouts` looked at; `metrics` formed of a run of a few steps. The least
    of some rounds counts; beside it what one variant takes alone: to sort and pack (`alone`), to assemble and to fit.
    Five values differ: stiffness, speed, the place of a sprocket, a load, an inertia; of unlike links (`--links`) also
    what they have of their own: three worn links which ones and by how much, every link's own wear, outer links'
    length and stiffness, the play.
    """
    start_warp()
    warnings.simplefilter("ignore")
    yield ("us a variant", "variants", *STAGES, "all packing", *ALONE)
    for name, links in product(asked.drives, asked.links):
        bases = two_sprocket_kinds() if name == "kinds" else [example_drive(name)]
        count = max(20, asked.count // SLOW) if bases[0].arms else asked.count
        times = stage_times(bases, links, count, asked.rounds)
        whole = sum(times[stage] for stage in ("sorted", "steps", "assembled", "packed"))
        yield (f"{name} {links}".strip(), count, *(times[of] for of in STAGES), whole, *(times[of] for of in ALONE))
    if asked.metrics:
        yield f"metrics of 2000 marine variants: {metrics_time(example_drive('marine'), 2000):.1f} us each"
