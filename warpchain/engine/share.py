"""Variants of a run that go through it together on one device: packed, settled, stepped, and what they came to.

A run is one share, or several where some can be stepped while others are packed (`engine.pipeline`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.stack_assembly import layout_faults_of_drives
from warpchain.drive import Drive
from warpchain.drive.stacks import Stack, split_stack, stack_of_chosen
from warpchain.engine.arrays import Engine
from warpchain.engine.chains import Rows
from warpchain.engine.devices import engine_on, frame_bytes, launch_steps, loading
from warpchain.engine.launches import shares, steps_left
from warpchain.engine.outcomes import PARTS, batch_durations, causes_of, engaged, split_sums
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.engine.recorder import Recorder, Recording
from warpchain.engine.settling import net_force, settle
from warpchain.progress import ProgressReport, StopRequest
from warpchain.results.channels import FrameLayout
from warpchain.results.metrics import ChainEnds, ColumnBlocks, VariantEnds, metric_blocks
from warpchain.results.run import Trajectory
from warpchain.results.schedule import MOST_STEPS, Schedule

if TYPE_CHECKING:
    from warpchain.archive.writer import ArchiveWriter
    from warpchain.engine.checkpoint import Keeper, States

LAUNCH_WORK = 20_000_000
"""Roller-steps of a variant in one launch at most, so that progress shows and Ctrl-C is heard."""

PERTURBATION = 1e-9
"""Standard deviation of each coordinate's displacement, in pitches."""


@dataclass(frozen=True)
class Members:
    """Variants of a run.

    Attributes:
        drives, schedules: theirs.
        stacks: the drives sorted into kinds, numbered from 0.
        numbers: (V,) what they are called in the run, ascending.
    """

    drives: Sequence[Drive]
    schedules: Sequence[Schedule]
    stacks: Sequence[Stack]
    numbers: NDArray[np.int64]

    @cached_property
    def work(self) -> NDArray[np.float64]:
        """(V,) roller-steps of each."""
        rollers = np.zeros(len(self.drives))
        for stack in self.stacks:
            rollers[stack.members] = stack.drive.links
        return rollers * (np.array([schedule.steps for schedule in self.schedules]) + 1.0)

    def part(self, chosen: NDArray[np.bool_]) -> Members:
        """Those that are chosen, (V,), in stacks that stay in the processor's caches."""
        kinds = (stack_of_chosen(stack, chosen) for stack in self.stacks if chosen[stack.members].any())
        stacks = [part for stack in kinds for part in split_stack(stack)]
        places = np.flatnonzero(chosen).tolist()
        drives, schedules = [self.drives[v] for v in places], [self.schedules[v] for v in places]
        return Members(drives, schedules, stacks, self.numbers[chosen])


@dataclass(frozen=True)
class How:
    """The device, precision and threads on which a share runs.

    Attributes:
        device: "cpu" or such as "cuda:0".
        precision: "float64" or "float32".
        cores: CPU threads.
    """

    device: str
    precision: str
    cores: int


@dataclass(frozen=True)
class Outcome:
    """The outcome of the variants of a share, or of all.

    Attributes:
        ended: how each ended.
        blocks: forms their metrics, numbered as in the run.
        frames: those recorded in memory, by their numbers in the run.
        at: when the last step was done, by `time.monotonic`.
    """

    ended: VariantEnds
    blocks: Callable[[], ColumnBlocks]
    frames: Mapping[int, Trajectory]
    at: float


class Share:
    """Variants that go through a run together, packed.

    Args:
        members: the variants.
        frame: how recorded frames lie.

    Raises:
        DriveError: for a drive whose chain does not fit; the message names the variant.
    """

    def __init__(self, members: Members, frame: FrameLayout) -> None:
        self.members = members
        self.rows = rows = Rows(members.drives, members.stacks)
        packed = pack(rows.drives, rows.spread(members.schedules), rows.stacks, rows.called(members.numbers))
        rows.couple(packed, members.numbers)
        self.packed = replace(packed, frame=frame)
        self.row_layouts = layout_faults_of_drives(rows.drives, self.packed.assemblies, rows.stacks)
        self.layouts = rows.layouts(self.row_layouts)

    def recorder(self, recording: Recording, count: int, archive: ArchiveWriter | None = None) -> Recorder:
        """Takes their frames, to memory or to an archive; of the memory of `count` variants they have their part."""
        members = self.members
        return Recorder(members.schedules, members.numbers, self.packed, recording, self.rows, count, archive)

    def keeper(self, states: States | None, how: How) -> Keeper | None:
        """Keeps their states, and gives them those that they begin with; None where none are asked for."""
        if states is None:
            return None
        from warpchain.engine.checkpoint import Keeper

        members, kind = self.members, f"{how.precision} {how.device.partition(':')[0]}"
        return Keeper(states, members.drives, members.schedules, members.numbers, kind)

    def run(
        self, how: How, recorder: Recorder, keeper: Keeper | None, report: ProgressReport, stop: StopRequest
    ) -> Outcome:
        """Settles the variants, steps them to their ends or until a stop is asked for, and tells what they came to."""
        drives, stacks, packed = self.rows.drives, self.rows.stacks, self.packed
        steps = launch_steps(how.device, packed, max(1, LAUNCH_WORK // int(packed.drives["rollers"].max())))
        settling, of = (drives, stacks) if keeper is None else (keeper.unsettled(), None)

        def settle_on(futures: list[Future[None]], done: Callable[[], tuple[float, float]]) -> bool:
            _await(futures, stop, lambda: report("settling", *done()))
            return not stop.is_asked

        settles = any(drive.run.settle for drive in settling)
        with loading(how.device, packed, how.precision, settles, how.cores, report, stop):
            lay_in_gaps(packed, drives)
            settled = settle(packed, settling, how.device, how.cores, steps, settle_on, of)
        left = net_force(packed, settled["residual"])
        perturb(packed, drives)
        if keeper is not None:
            keeper.prepare(packed, settled, left)
        steps = launch_steps(how.device, packed, recorder.launch_steps(steps, frame_bytes(how.device)))
        buffer_values = recorder.layout(steps)
        engine = engine_on(how.device, packed.at_precision(how.precision), how.cores)
        try:
            if keeper is not None:
                keeper.restore(engine)
            _march(engine, steps, buffer_values, recorder, report, stop, keeper)
            at = time.monotonic()
            state = engine.progress()
            diverged = state["diverged"] != 0
            rows = VariantEnds(
                drives,
                self.rows.spread(self.members.schedules),
                state["step"],
                diverged,
                settled,
                engaged(engine, drives, stacks),
                self.row_layouts,
                left,
                causes_of(engine, drives, diverged),
                stacks,
            )
            ended = self.rows.ended(rows, self.members.schedules, self.members.stacks)
            sums = engine.sums()
            blocks = partial(_blocks, ended, rows, self.rows.first, (sums, engine.packed), self.members.numbers)
            return Outcome(ended, blocks, recorder.trajectories(), at)
        finally:
            engine.close()


def _blocks(
    ended: VariantEnds,
    rows: VariantEnds,
    begins: NDArray[np.int64],
    sums: tuple[dict[str, NDArray[Any]], Packed],
    numbers: NDArray[np.int64],
) -> ColumnBlocks:
    """The metrics of variants, which are called `numbers`, from the sums of their rows, which begin at `begins`."""
    chains = np.diff(begins)

    def parts_of(variants: NDArray[np.intp]) -> list[ChainEnds]:
        found = [begins[variants] + c for c in range(int(chains[variants[0]]))]
        return [(rows.select_variants(mine), split_sums(*sums, mine)) for mine in found]

    return [(numbers[variants], columns) for variants, columns in metric_blocks(ended, parts_of)]


def _await(futures: list[Future[None]], stop: StopRequest, tick: Callable[[], None]) -> None:
    """Waits for a launch; on a request to stop, drops what has not begun. Raises what a launch raised."""
    pending = set(futures)
    while pending:
        _, pending = wait(pending, timeout=0.1)
        tick()
        if stop.is_asked:
            for future in pending:
                future.cancel()
    for future in futures:
        if not future.cancelled():
            future.result()


def _march(
    engine: Engine,
    steps: int,
    buffer_values: int,
    recorder: Recorder,
    report: ProgressReport,
    stop: StopRequest,
    keeper: Keeper | None = None,
) -> None:
    """Launches steps until every variant has ended; the frames of one are taken while the next runs."""
    drives = engine.packed.drives
    rollers, last = drives["rollers"].astype(float), drives["steps"].copy()
    total, simulated = float(((last + 1) * rollers).sum()), float((last * drives["step"]).sum())
    buffers = [engine.frame_buffer(buffer_values) for _ in range(2)]
    batched = bool(np.isfinite(batch_durations(drives, PARTS)).any())
    taken: tuple[Any, Any, Any] | None = None

    def tick() -> None:
        state = engine.progress()
        done = np.where(state["diverged"] == 1, last + 1, state["step"])
        report("simulating", simulated * (float((done * rollers).sum()) / total), simulated)

    before = engine.progress()
    turn = 0
    while ((before["step"] <= last) & (before["diverged"] == 0)).any() and not stop.is_asked:
        futures = engine.advance(_steps_of(engine, steps, before, keeper), buffers[turn])
        if batched:
            _load_ahead()
        if taken is not None:
            recorder.take(taken[0].numpy(), *taken[1:])
        _await(futures, stop, tick)
        after = engine.progress()
        if keeper is not None:
            keeper.take(engine, after)
        taken = (buffers[turn], before, after)
        before, turn = after, 1 - turn
    if taken is not None:
        recorder.take(taken[0].numpy(), *taken[1:])


def _steps_of(engine: Engine, most: int, progress: NDArray[Any], keeper: Keeper | None) -> int | NDArray[np.integer]:
    """Steps of a launch, `most` at most, so that it ends where a variant is to be kept."""
    ahead = np.full(len(progress), MOST_STEPS) if keeper is None else keeper.ahead(progress)
    if engine.balances:
        return shares(np.minimum(steps_left(engine.packed.drives, progress), ahead), most)
    return min(most, int(ahead.min()))


@cache
def _load_ahead() -> None:
    """Imports what metrics of batches need, which takes 0.3 s, while the engine is at work without Python's lock."""
    Thread(target=import_module, args=("scipy.special",)).start()


def lay_in_gaps(packed: Packed, drives: Sequence[Drive]) -> None:
    """Lays the rollers of drives with `run.seating` anywhere in the narrowest tooth gap, before settling.

    A roller's center has a disc of the gap's clearance to lie in, and is off where it was assembled by an even draw
    from it; rollers of strands too.
    """
    for v, drive in enumerate(drives):
        if drive.run.seating is not None:
            rows = packed.rows(v)
            random = np.random.default_rng(drive.run.seating)
            first, count = (int(packed.drives[name][v]) for name in ("first_sprocket", "sprockets"))
            narrowest = packed.sprockets["clearance"][first : first + count].min()
            off, way = np.sqrt(random.random(rows.shape[1])), random.uniform(0.0, 2.0 * np.pi, rows.shape[1])
            rows[0:2] += narrowest * off * np.array([np.cos(way), np.sin(way)])


def perturb(packed: Packed, drives: Sequence[Drive]) -> None:
    """Displaces the rollers of drives with `run.perturbation`, after settling; `packed` is in float64.

    The displacement is seeded, and far below what anyone could measure; chaos makes it large.
    """
    for v, drive in enumerate(drives):
        if drive.run.perturbation is not None:
            rows = packed.rows(v)
            random = np.random.default_rng(drive.run.perturbation)
            rows[0:2] += PERTURBATION * drive.chain.pitch * random.standard_normal(rows[0:2].shape)
