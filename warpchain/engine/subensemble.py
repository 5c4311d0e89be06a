"""Subensembles: variants that one device packs, settles and steps together."""

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
from warpchain.engine.arrays import Engine
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.devices import launch_frame_bytes, launch_step_limit, load_run_kernels, make_engine
from warpchain.engine.end_states import divergence_causes, engaged_fractions
from warpchain.engine.launches import next_launch_steps, steps_left
from warpchain.engine.pack import pack
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.engine.recorder import Recorder, RecordingOptions
from warpchain.engine.settling import largest_net_forces, settle_variants
from warpchain.engine.window_sums import LONG_BATCHES, batch_durations, split_sums
from warpchain.model import ChainModel
from warpchain.model.stacks import Stack, split_stack, stack_of_chosen
from warpchain.progress import ProgressReport, StopRequest
from warpchain.results.channels import FrameLayout
from warpchain.results.metrics import ChainEnds, ColumnBlocks, VariantEnds, metric_blocks
from warpchain.results.run import Trajectory
from warpchain.results.schedule import MOST_STEPS, Schedules

if TYPE_CHECKING:
    from warpchain.archive.writer import ArchiveWriter
    from warpchain.engine.checkpoint import StateKeeper, States

LAUNCH_WORK = 20_000_000
"""Most roller-steps of a variant in one launch."""

PERTURBATION = 1e-9
"""Standard deviation of perturbed coordinates, in pitches."""


@dataclass(frozen=True)
class Variants:
    """Variants of a run: drives, schedules, stacks."""

    drives: Sequence[Drive]
    schedules: Schedules
    stacks: Sequence[Stack[Drive]]  # numbered from 0
    numbers: NDArray[np.int64]  # (V,) in the run, ascending

    @cached_property
    def roller_steps(self) -> NDArray[np.float64]:
        """Rollers times steps (V,) of each variant."""
        rollers = np.zeros(len(self.drives))
        for stack in self.stacks:
            rollers[stack.members] = stack.one.links
        return rollers * (self.schedules.columns["steps"] + 1.0)

    def select(self, chosen: NDArray[np.bool_]) -> Variants:
        """Variants of a run that are `chosen` (V,), in stacks."""
        kinds = (stack_of_chosen(stack, chosen) for stack in self.stacks if chosen[stack.members].any())
        stacks = [part for stack in kinds for part in split_stack(stack)]
        drives = [self.drives[v] for v in np.flatnonzero(chosen).tolist()]
        return Variants(drives, self.schedules[chosen], stacks, self.numbers[chosen])


@dataclass(frozen=True)
class DeviceSettings:
    """Settings of a subensemble's device: precision and threads."""

    device: str  # "cpu" or such as "cuda:0"
    precision: str  # "float64" or "float32"
    cores: int  # CPU threads


SettledRows = tuple[NDArray[Any], NDArray[np.float64]]
"""`Settling` (rows,), and largest net force (rows,) [N] left on a roller."""


@dataclass(frozen=True)
class SubensembleResult:
    """Result of a subensemble: final states, metrics, trajectories."""

    ends: VariantEnds[Drive]
    metric_blocks: Callable[[], ColumnBlocks]  # gives the metrics, numbered as in the run
    trajectories: Mapping[int, Trajectory]  # recorded in memory, by numbers in the run
    end_time: float  # of the last step, by `time.monotonic` [s]
    measured: Mapping[int, Trajectory]  # frames in the window for plug-ins' metrics, by numbers in the run


class Subensemble:
    """Subensemble of a run's variants, packed; `frame` is the layout of frames.

    Raises:
        DriveError: a chain that does not fit.
    """

    def __init__(self, variants: Variants, frame: FrameLayout) -> None:
        self.variants = variants
        self.rows = rows = ChainRows(variants.drives, variants.stacks)
        v = rows.variant_of_row
        packed = pack(rows.models, variants.schedules[v], rows.stacks, variants.numbers[v])
        rows.couple_chains(packed, variants.numbers)
        self.packed = replace(packed, frame=frame)
        self.row_layout_faults = layout_faults_of_drives(rows.models, self.packed.assemblies, rows.stacks)
        self.layout_faults = rows.layout_faults(self.row_layout_faults)

    def make_recorder(self, recording: RecordingOptions, count: int, archive: ArchiveWriter | None = None) -> Recorder:
        """Recorder of the subensemble's frames."""
        variants = self.variants
        return Recorder(variants.schedules, variants.numbers, self.packed, recording, self.rows, count, archive)

    def make_state_keeper(self, states: States | None, settings: DeviceSettings) -> StateKeeper | None:
        """Keeper of the subensemble's checkpoints, or None."""
        if states is None:
            return None
        from warpchain.engine.checkpoint import StateKeeper

        variants, kind = self.variants, f"{settings.precision} {settings.device.partition(':')[0]}"
        return StateKeeper(states, variants.drives, variants.schedules, variants.numbers, kind)

    def run(
        self,
        settings: DeviceSettings,
        recorder: Recorder,
        keeper: StateKeeper | None,
        report: ProgressReport,
        stop: StopRequest,
    ) -> SubensembleResult:
        """Result of the subensemble, settled and stepped on a device."""
        packed = self.packed
        settled = self.settle(settings, keeper, report, stop)
        steps = launch_step_limit(
            settings.device,
            packed,
            recorder.launch_step_limit(self.launch_steps(settings.device), launch_frame_bytes(settings.device)),
        )
        buffer_values = recorder.lay_out_buffer(steps)
        engine = make_engine(settings.device, packed.at_precision(settings.precision), settings.cores)
        try:
            if keeper is not None:
                keeper.restore_states(engine)
            _launch_all_steps(engine, steps, buffer_values, recorder, report, stop, keeper)
            at = time.monotonic()
            ended, blocks = self.outcome(engine, settled)
            return SubensembleResult(ended, blocks, recorder.kept_trajectories(), at, recorder.measured_trajectories())
        finally:
            engine.close()

    def launch_steps(self, device: str) -> int:
        """Most steps of a subensemble's launch on a device."""
        return launch_step_limit(device, self.packed, max(1, LAUNCH_WORK // int(self.packed.drives["rollers"].max())))

    def settle(
        self, settings: DeviceSettings, keeper: StateKeeper | None, report: ProgressReport, stop: StopRequest
    ) -> SettledRows:
        """Settles and perturbs the subensemble's variants, once kernels are loaded."""
        models, stacks, packed = self.rows.models, self.rows.stacks, self.packed
        settling, of = (models, stacks) if keeper is None else (keeper.drives_to_settle(), None)

        def settle_on(futures: list[Future[None]], done: Callable[[], tuple[float, float]]) -> bool:
            """Waits for settling's launch; returns whether to go on."""
            _wait_for_launch(futures, stop, lambda: report("settling", *done()))
            return not stop.is_asked

        settles = any(of.run.settle for of in settling)
        with load_run_kernels(settings.device, packed, settings.precision, settles, settings.cores, report, stop):
            scatter_in_gaps(packed, models)
            steps = self.launch_steps(settings.device)
            settled = settle_variants(packed, settling, settings.device, settings.cores, steps, settle_on, of)
        left = largest_net_forces(packed, settled["residual"])
        perturb_rollers(packed, models)
        if keeper is not None:
            keeper.take_over_settling(packed, settled, left)
        return settled, left

    def outcome(
        self, engine: Engine, settling: SettledRows, stored: NDArray[np.float64] | None = None
    ) -> tuple[VariantEnds[Drive], Callable[[], ColumnBlocks]]:
        """Final states of the subensemble's variants, and a function of their metrics.

        `stored` (rows,) is energy [J] that left a drive's parts in the window.
        """
        models, stacks = self.rows.models, self.rows.stacks
        state, (settled, left) = engine.progress(), settling
        diverged = state["diverged"] != 0
        rows = VariantEnds(
            models,
            self.variants.schedules[self.rows.variant_of_row],
            state["step"],
            diverged,
            settled,
            engaged_fractions(engine, models, stacks),
            self.row_layout_faults,
            left,
            divergence_causes(engine, models, diverged),
            stacks,
        )
        ended = self.rows.variant_ends(rows, self.variants.schedules, self.variants.stacks)
        sums = engine.sums()
        if stored is not None:
            sums["chain"]["energy_start"] += stored
        return ended, partial(
            _metric_blocks, ended, rows, self.rows.first_rows, (sums, engine.packed), self.variants.numbers
        )


def _metric_blocks(
    ended: VariantEnds[Drive],
    rows: VariantEnds[ChainModel],
    begins: NDArray[np.int64],
    sums: tuple[dict[str, NDArray[Any]], PackedEnsemble],
    numbers: NDArray[np.int64],
) -> ColumnBlocks:
    """Metrics of a subensemble's variants, from their rows' sums."""
    chains = np.diff(begins)

    def chain_ends(variants: NDArray[np.intp]) -> list[ChainEnds]:
        """Ends and sums of each chain, of variants of equal chain numbers."""
        found = [begins[variants] + c for c in range(int(chains[variants[0]]))]
        return [(rows.select_variants(mine), split_sums(*sums, mine)) for mine in found]

    return [(numbers[variants], columns) for variants, columns in metric_blocks(ended, chain_ends)]


def _wait_for_launch(futures: list[Future[None]], stop: StopRequest, report_state: Callable[[], None]) -> None:
    """Waits for a subensemble's launch, reporting its state, or cancels the rest."""
    pending = set(futures)
    while pending:
        _, pending = wait(pending, timeout=0.1)
        report_state()
        if stop.is_asked:
            for future in pending:
                future.cancel()
    for future in futures:
        if not future.cancelled():
            future.result()


def _launch_all_steps(
    engine: Engine,
    steps: int,
    buffer_values: int,
    recorder: Recorder,
    report: ProgressReport,
    stop: StopRequest,
    keeper: StateKeeper | None = None,
) -> None:
    """Launches steps until every variant of a subensemble has ended."""
    drives = engine.packed.drives
    rollers, last = drives["rollers"].astype(float), drives["steps"].copy()
    total, simulated = float(((last + 1) * rollers).sum()), float((last * drives["step"]).sum())
    buffers = [engine.frame_buffer(buffer_values) for _ in range(2)]
    batched = bool(np.isfinite(batch_durations(drives, LONG_BATCHES)).any())
    taken: tuple[Any, Any, Any] | None = None

    def report_simulated_time() -> None:
        """Reports simulated time of a subensemble's variants [s]."""
        state = engine.progress()
        done = np.where(state["diverged"] == 1, last + 1, state["step"])
        report("simulating", simulated * (float((done * rollers).sum()) / total), simulated)

    before = engine.progress()
    turn = 0
    while ((before["step"] <= last) & (before["diverged"] == 0)).any() and not stop.is_asked:
        futures = engine.advance(_next_launch_steps(engine, steps, before, keeper), buffers[turn])
        if batched:
            _import_ahead()
        if taken is not None:
            recorder.take_frames(taken[0].numpy(), *taken[1:])
        _wait_for_launch(futures, stop, report_simulated_time)
        after = engine.progress()
        if keeper is not None:
            keeper.keep_due_states(engine, after)
        taken = (buffers[turn], before, after)
        before, turn = after, 1 - turn
    if taken is not None:
        recorder.take_frames(taken[0].numpy(), *taken[1:])


def _next_launch_steps(
    engine: Engine, most: int, progress: NDArray[Any], keeper: StateKeeper | None
) -> int | NDArray[np.integer]:
    """Steps of a subensemble's next launch, one number or (V,)."""
    ahead = np.full(len(progress), MOST_STEPS) if keeper is None else keeper.steps_ahead(progress)
    if engine.has_own_steps:
        return next_launch_steps(np.minimum(steps_left(engine.packed.drives, progress), ahead), most)
    return min(most, int(ahead.min()))


@cache
def _import_ahead() -> None:
    """Imports the modules of metrics, in a thread."""
    Thread(target=import_module, args=("scipy.special",)).start()


def scatter_in_gaps(packed: PackedEnsemble, models: Sequence[ChainModel]) -> None:
    """Scatters rollers of drives with `run.seating`."""
    for v, model in enumerate(models):
        if model.run.seating is not None:
            rows = packed.roller_rows(v)
            random = np.random.default_rng(model.run.seating)
            first, count = (int(packed.drives[name][v]) for name in ("first_sprocket", "sprockets"))
            narrowest = packed.sprockets["clearance"][first : first + count].min()
            off, way = np.sqrt(random.random(rows.shape[1])), random.uniform(0.0, 2.0 * np.pi, rows.shape[1])
            rows[0:2] += narrowest * off * np.array([np.cos(way), np.sin(way)])


def perturb_rollers(packed: PackedEnsemble, models: Sequence[ChainModel]) -> None:
    """Perturbs rollers of drives with `run.perturbation`."""
    for v, model in enumerate(models):
        if model.run.perturbation is not None:
            rows = packed.roller_rows(v)
            random = np.random.default_rng(model.run.perturbation)
            rows[0:2] += PERTURBATION * model.chain.pitch * random.standard_normal(rows[0:2].shape)
