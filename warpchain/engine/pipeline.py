"""Pipeline of a run in subensembles: some are packed while GPUs step others and threads compute metrics.

Results do not depend on the division. Where a GPU fails, another takes over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from queue import SimpleQueue
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.device_choice import DeviceChoice
from warpchain.engine.devices import choose_devices, gpus_by_name
from warpchain.engine.recorder import Recorder
from warpchain.engine.subensemble import DeviceSettings, Subensemble, SubensembleResult, Variants
from warpchain.errors import DeviceError, SimulationError, warn_caller
from warpchain.progress import COMPILING, ProgressReport, StopRequest
from warpchain.results.channels import WHOLE_FRAME, FrameLayout
from warpchain.results.metrics import join_ends

if TYPE_CHECKING:
    from warpchain.engine.checkpoint import StateKeeper

FEWEST_PER_SUBENSEMBLE = 2048
"""Fewest variants of a subensemble, of several a GPU."""

MOST_PER_GPU = 4
"""Most subensembles of a GPU."""

FIRST_WORK = 0.4
"""Work of a GPU's first subensemble over another's."""

DEALT_TOGETHER = 128
"""Variants of a stack in one subensemble."""


def split_variants(variants: Variants, gpus: int, most: int) -> list[Variants]:
    """Variants divided into at most `most` subensembles a GPU."""
    count = len(variants.drives)
    parts = min(count, gpus * max(1, min(most, count // (gpus * FEWEST_PER_SUBENSEMBLE)))) if gpus else 1
    if parts == 1 or _has_too_large_drive(variants):
        return [variants.select(np.ones(count, dtype=bool))]
    return [variants.select(chosen) for chosen in deal_variants(variants, parts, gpus)]


def deal_variants(variants: Variants, count: int, gpus: int) -> Iterator[NDArray[np.bool_]]:
    """Masks (V,) of `count` subensembles of about equal work."""
    work, together = variants.roller_steps, max(1, min(DEALT_TOGETHER, len(variants.drives) // (8 * count)))
    part, load = np.zeros(len(work), dtype=np.int64), np.zeros(count)
    if 1 < gpus < count:
        load[:gpus] = (1.0 - FIRST_WORK) * work.sum() / (count - (1.0 - FIRST_WORK) * gpus)
    for stack in sorted(variants.stacks, key=lambda stack: len(stack.members)):  # large kinds level out the small ones
        longest = stack.members[np.argsort(-work[stack.members], kind="stable")]
        pieces = 64 * count if len(longest) >= together * count else -(-len(longest) // together)
        for piece in (longest[k::pieces] for k in range(min(pieces, len(longest)))):
            part[piece] = load.argmin()
            load[part[piece[0]]] += work[piece].sum()
    return (part == k for k in range(count) if (part == k).any())


def _has_too_large_drive(variants: Variants) -> bool:
    """Whether a run's drive is larger than GPUs accept."""
    from warpchain.engine.gpu import MOST_LINKS, MOST_PARTNERS

    drives = [stack.one for stack in variants.stacks]
    rows = [1 + any(chain.is_silent for chain in drive.chains) for drive in drives]  # of a guide, also of backs
    partners = [len(d.sprockets) + k * len(d.guides) for d, k in zip(drives, rows, strict=True)]
    return any(d.links > MOST_LINKS or count > MOST_PARTNERS for d, count in zip(drives, partners, strict=True))


def plan_run(
    variants: Variants, frame: FrameLayout, device: str | None, settings: tuple[str, int], most: int
) -> tuple[list[Variants], Subensemble, DeviceChoice]:
    """Parts of a run, its first subensemble, and its devices.

    Args:
        device: as the user names it.
        most: subensembles of a GPU.

    Raises:
        DriveError: a chain of the first subensemble that does not fit.
        SimulationError: as `devices.devices_by_name`.
    """
    gpus = gpus_by_name(device)
    parts = split_variants(variants, len(gpus), most)
    part = Subensemble(parts[0], frame)
    times = float(variants.roller_steps.sum() / parts[0].roller_steps.sum())
    choice = choose_devices(device, part.packed, *settings, len(variants.drives), times)
    if len(parts) > 1 and choice.devices != gpus:  # not what they were cut for
        parts = split_variants(variants, 0 if choice.devices == ("cpu",) else len(choice.devices), most)
        part = Subensemble(parts[0], frame)
    if choice.devices == ("cpu",):
        part.packed = replace(part.packed, frame=WHOLE_FRAME)
    return parts, part, choice


class SubensembleQueue:
    """Queue that runs subensembles on GPUs, as a context.

    Args:
        make_recorders: gives a subensemble's recorder and state keeper.
        again: whether another GPU may repeat a failed subensemble.
        total: simulated time of all [s].
    """

    def __init__(
        self,
        settings: DeviceSettings,
        gpus: tuple[str, ...],
        make_recorders: Callable[[Subensemble], tuple[Recorder, StateKeeper | None]],
        again: bool,
        total: float,
        report: ProgressReport,
        stop: StopRequest,
    ) -> None:
        self._settings, self._make_recorders, self._again = settings, make_recorders, again
        self._free: SimpleQueue[str | None] = SimpleQueue()
        for gpu in gpus:
            self._free.put(gpu)
        self._gpus, self._failed = len(gpus), list[DeviceError]()
        self._steps, self._tables = (
            ThreadPoolExecutor(len(gpus), thread_name_prefix=f"warpchain {name}") for name in ("share", "metrics")
        )
        self._device = wp.get_device()
        self._running: list[Future[SubensembleResult]] = []
        self._numbers: list[NDArray[np.int64]] = []
        self._layouts: dict[int, Sequence[str]] = {}
        self._done: list[float] = []
        self._total, self._report, self._stop = total, report, stop
        self._compiling: dict[int, tuple[str, float, float]] = {}

    def __enter__(self) -> SubensembleQueue:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._stop.ask_to_stop()
        for pool in (self._steps, self._tables):
            pool.shutdown(wait=True, cancel_futures=kind is not None)
        wp.set_device(self._device)  # which threads set in turns

    def add(self, part: Subensemble) -> None:
        """Adds a subensemble to the queue, for the next free GPU.

        Raises:
            SimulationError: a variant that a GPU does not accept.
        """
        from warpchain.engine.gpu import gpu_refusal

        reason = gpu_refusal(part.packed, part.variants.numbers)
        if reason is not None:
            raise SimulationError(reason)
        self._numbers.append(part.variants.numbers)
        self._layouts |= dict(zip(part.variants.numbers.tolist(), part.layout_faults, strict=True))
        self._done.append(0.0)
        self._running.append(self._steps.submit(self._run_on_gpu, len(self._running), part))
        self._report_progress()

    def _run_on_gpu(self, number: int, part: Subensemble) -> SubensembleResult:
        """Result of a subensemble on a GPU, another if it fails; DeviceError where none is left."""

        def note(phase: str, done: float, total: float) -> None:
            """Notes a subensemble's progress, for the report of all."""
            if phase == "simulating":
                self._done[number] = max(self._done[number], done)
            if phase == COMPILING and done < total:
                self._compiling[number] = (phase, done, total)
            else:
                self._compiling.pop(number, None)

        while (gpu := self._free.get()) is not None:
            try:
                settings = replace(self._settings, device=gpu)
                outcome = part.run(settings, *self._make_recorders(part), note, self._stop)
                return replace(outcome, metric_blocks=self._tables.submit(outcome.metric_blocks).result)
            except DeviceError as error:
                self._failed.append(error)
                gpu = None
                if not self._again:
                    raise
                part = Subensemble(part.variants, part.packed.frame)  # settling moved it
            finally:
                if gpu is not None or len(self._failed) == self._gpus:
                    self._free.put(gpu)
        self._free.put(None)
        raise self._failed[-1]

    @property
    def layout_faults(self) -> list[Sequence[str]]:
        """Layout faults of the variants of all queued subensembles."""
        return [self._layouts[number] for number in sorted(self._layouts)]

    def joined_result(self) -> SubensembleResult:
        """Result of all variants, once all subensembles have run."""
        while wait(self._running, timeout=0.1).not_done:
            self._report_progress()
        self._report_progress()
        for error in self._failed:
            warn_caller(f"{error}; another GPU took what it had")
        outcomes = [future.result() for future in self._running]
        blocks = [block for outcome in outcomes for block in outcome.metric_blocks()]
        ended = join_ends([outcome.ends for outcome in outcomes], self._numbers)
        frames = {number: of for outcome in outcomes for number, of in outcome.trajectories.items()}
        measured = {number: of for outcome in outcomes for number, of in outcome.measured.items()}
        return SubensembleResult(ended, lambda: blocks, frames, max(of.end_time for of in outcomes), measured)

    def _report_progress(self) -> None:
        """Reports the progress of all subensembles; raises their errors."""
        for future in self._running:
            if future.done():
                future.result()
        compiling = list(self._compiling.values())
        self._report(*(compiling[0] if compiling else ("simulating", sum(self._done), self._total)))
