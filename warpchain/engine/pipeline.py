"""A run in shares, so that variants are packed while others are stepped, and measured while others are stepped, too.

Packing and the table of metrics are Python's, steps are a GPU's: while a kernel runs, Python's lock is free. The main
thread packs share after share; the next GPU that is free takes it, settles and steps it in a thread; what a share came
to is made into metrics by further threads. A variant's result hangs on no other, so it is what it is in a run of one
share. Where a GPU fails, another takes its share, packed anew.
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

from warpchain.engine.device_choice import Choice
from warpchain.engine.devices import devices_for, gpus_named
from warpchain.engine.recorder import Recorder
from warpchain.engine.share import How, Members, Outcome, Share
from warpchain.errors import DeviceError, SimulationError, warn_caller
from warpchain.progress import COMPILING, ProgressReport, StopRequest
from warpchain.results.channels import WHOLE_FRAME, FrameLayout
from warpchain.results.metrics import join_ends

if TYPE_CHECKING:
    from warpchain.engine.checkpoint import Keeper

LEAST = 2048
"""Fewest variants that shares have on average where a GPU gets several: fewer do not fill it to the end."""

MOST = 4
"""Most shares of a GPU."""

FIRST = 0.4
"""Work of the first share of each of several GPUs over that of the others: so the last GPU begins early."""

APART = 128
"""Variants of a kind that go to one share: of each kind of them packing, stepping and measuring have their cost."""


def parts_of(members: Members, gpus: int, most: int) -> list[Members]:
    """Variants dealt to the shares of so many GPUs, `most` each at most; all in one without any."""
    count = len(members.drives)
    parts = min(count, gpus * max(1, min(most, count // (gpus * LEAST)))) if gpus else 1
    if parts == 1 or _too_large(members):
        return [members.part(np.ones(count, dtype=bool))]
    return [members.part(chosen) for chosen in deal_variants(members, parts, gpus)]


def deal_variants(members: Members, count: int, gpus: int) -> Iterator[NDArray[np.bool_]]:
    """Variants of each of so many shares, (V,): of about the same work, and of all lengths that a kind has.

    Where several GPUs get several, the first ones have `FIRST` of the others' work.
    """
    work, together = members.work, max(1, min(APART, len(members.drives) // (8 * count)))
    share, load = np.zeros(len(work), dtype=np.int64), np.zeros(count)
    if 1 < gpus < count:
        load[:gpus] = (1.0 - FIRST) * work.sum() / (count - (1.0 - FIRST) * gpus)
    for stack in sorted(members.stacks, key=lambda stack: len(stack.members)):  # large kinds level out the small ones
        longest = stack.members[np.argsort(-work[stack.members], kind="stable")]
        pieces = 64 * count if len(longest) >= together * count else -(-len(longest) // together)
        for piece in (longest[k::pieces] for k in range(min(pieces, len(longest)))):
            share[piece] = load.argmin()
            load[share[piece[0]]] += work[piece].sum()
    return (share == k for k in range(count) if (share == k).any())


def _too_large(members: Members) -> bool:
    """Whether there is a drive that a GPU does not take."""
    from warpchain.engine.gpu import MOST_LINKS, MOST_PARTNERS

    drives = [stack.drive for stack in members.stacks]
    return any(d.links > MOST_LINKS or len(d.sprockets) + len(d.guides) > MOST_PARTNERS for d in drives)


def begun(
    members: Members, frame: FrameLayout, device: str | None, how: tuple[str, int], most: int
) -> tuple[list[Members], Share, Choice]:
    """The shares of a run, the first of them packed, and the devices that it goes to.

    Args:
        members: all variants.
        frame: how recorded frames lie.
        device: as the user names it.
        how: precision, and CPU threads.
        most: shares of a GPU.

    Raises:
        DriveError: a chain of the first share that does not fit.
        SimulationError: as `devices.chosen_devices`.
    """
    gpus = gpus_named(device)
    parts = parts_of(members, len(gpus), most)
    share = Share(parts[0], frame)
    times = float(members.work.sum() / parts[0].work.sum())
    choice = devices_for(device, share.packed, *how, len(members.drives), times)
    if len(parts) > 1 and choice.devices != gpus:  # not what they were cut for
        parts = parts_of(members, 0 if choice.devices == ("cpu",) else len(choice.devices), most)
        share = Share(parts[0], frame)
    if choice.devices == ("cpu",):
        share.packed = replace(share.packed, frame=WHOLE_FRAME)
    return parts, share, choice


class Shares:
    """Shares under way; as a context, it ends when none is any more, all of them at once where something is raised.

    Args:
        how: how they are run.
        gpus: which run them, each one at a time.
        recorders: gives what takes a share's frames, and what keeps its states.
        again: whether a share whose GPU fails may go to another.
        total: simulated time of all [s].
        report, stop: of the run. What shares report is passed on by the thread that calls.
    """

    def __init__(
        self,
        how: How,
        gpus: tuple[str, ...],
        recorders: Callable[[Share], tuple[Recorder, Keeper | None]],
        again: bool,
        total: float,
        report: ProgressReport,
        stop: StopRequest,
    ) -> None:
        self._how, self._recorders, self._again = how, recorders, again
        self._free: SimpleQueue[str | None] = SimpleQueue()
        for gpu in gpus:
            self._free.put(gpu)
        self._gpus, self._failed = len(gpus), list[DeviceError]()
        self._steps, self._tables = (
            ThreadPoolExecutor(len(gpus), thread_name_prefix=f"warpchain {name}") for name in ("share", "metrics")
        )
        self._device = wp.get_device()
        self._running: list[Future[Outcome]] = []
        self._numbers: list[NDArray[np.int64]] = []
        self._layouts: dict[int, Sequence[str]] = {}
        self._done: list[float] = []
        self._total, self._report, self._stop = total, report, stop
        self._compiling: dict[int, tuple[str, float, float]] = {}

    def __enter__(self) -> Shares:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._stop.ask_to_stop()
        for pool in (self._steps, self._tables):
            pool.shutdown(wait=True, cancel_futures=kind is not None)
        wp.set_device(self._device)  # which threads set in turns

    def add(self, share: Share) -> None:
        """Hands a share to the next GPU that is free. Raises what a share before has raised.

        Raises:
            SimulationError: a variant that a GPU does not take.
        """
        from warpchain.engine.gpu import refusal

        reason = refusal(share.packed, share.members.numbers)
        if reason is not None:
            raise SimulationError(reason)
        self._numbers.append(share.members.numbers)
        self._layouts |= dict(zip(share.members.numbers.tolist(), share.layouts, strict=True))
        self._done.append(0.0)
        self._running.append(self._steps.submit(self._run, len(self._running), share))
        self._tick()

    def _run(self, number: int, share: Share) -> Outcome:
        """Runs a share on a GPU, and on another where that fails.

        Raises:
            DeviceError: no GPU is left, or the share is not to be run again.
        """

        def note(phase: str, done: float, total: float) -> None:
            if phase == "simulating":
                self._done[number] = max(self._done[number], done)
            if phase == COMPILING and done < total:
                self._compiling[number] = (phase, done, total)
            else:
                self._compiling.pop(number, None)

        while (gpu := self._free.get()) is not None:
            try:
                how = replace(self._how, device=gpu)
                outcome = share.run(how, *self._recorders(share), note, self._stop)
                return replace(outcome, blocks=self._tables.submit(outcome.blocks).result)
            except DeviceError as error:
                self._failed.append(error)
                gpu = None
                if not self._again:
                    raise
                share = Share(share.members, share.packed.frame)  # settling moved it
            finally:
                if gpu is not None or len(self._failed) == self._gpus:
                    self._free.put(gpu)
        self._free.put(None)
        raise self._failed[-1]

    @property
    def layouts(self) -> list[Sequence[str]]:
        """Faults of the layouts of all variants that were added, in the order of the run."""
        return [self._layouts[number] for number in sorted(self._layouts)]

    def outcome(self) -> Outcome:
        """Waits for all shares: what all variants came to."""
        while wait(self._running, timeout=0.1).not_done:
            self._tick()
        self._tick()
        for error in self._failed:
            warn_caller(f"{error}; another GPU took what it had")
        outcomes = [future.result() for future in self._running]
        blocks = [block for outcome in outcomes for block in outcome.blocks()]
        ended = join_ends([outcome.ended for outcome in outcomes], self._numbers)
        frames = {number: of for outcome in outcomes for number, of in outcome.frames.items()}
        return Outcome(ended, lambda: blocks, frames, max(outcome.at for outcome in outcomes))

    def _tick(self) -> None:
        """Shows how far all are; raises what any has raised."""
        for future in self._running:
            if future.done():
                future.result()
        compiling = list(self._compiling.values())
        self._report(*(compiling[0] if compiling else ("simulating", sum(self._done), self._total)))
