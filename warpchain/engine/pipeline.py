"""A run in shares, so that variants are packed while others are stepped, and measured while others are stepped, too.

Packing and the table of metrics are Python's, steps are a GPU's: while a kernel runs, Python's lock is free. The main
thread packs share after share; each goes to one of the GPUs, in turn, where a thread settles and steps one share after
the other; what a share came to is made into metrics by further threads. A variant's result hangs on no other, so it
is what it is in a run of one share.

What is recorded, and what keeps states, goes in one share: frames are to come in the order of time.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from itertools import pairwise

import warp as wp

from warpchain.engine.device_choice import Choice
from warpchain.engine.devices import cuts_of, devices_for, gpus_named
from warpchain.engine.recorder import Recorder
from warpchain.engine.share import How, Members, Outcome, Share
from warpchain.errors import SimulationError
from warpchain.progress import COMPILING, ProgressReport, StopRequest
from warpchain.results.channels import FrameLayout
from warpchain.results.metrics import Blocks, Ended, joined

LEAST = 4096
"""Fewest variants of a share where a GPU gets several: fewer do not fill it to the end."""

WORTH = 1024
"""Fewest variants of a share where GPUs get one each: packing fewer takes no time."""

MOST = 4
"""Most shares of a GPU."""


def parts_of(members: Members, gpus: int) -> list[Members]:
    """Variants cut into the shares of so many GPUs, each of about the same work; all in one where it does not pay."""
    count = len(members.drives)
    parts = gpus * max(1, min(MOST, count // (gpus * LEAST))) if gpus else 1
    if parts == 1 or count < parts * WORTH or _too_large(members):
        return [members]
    return [members.part(a, b) for a, b in pairwise(cuts_of(members.work, parts)) if b > a]


def _too_large(members: Members) -> bool:
    """Whether there is a drive that a GPU does not take."""
    from warpchain.engine.gpu import MOST_LINKS, MOST_PARTNERS

    drives = [stack.drive for stack in members.stacks]
    return any(d.links > MOST_LINKS or len(d.sprockets) + len(d.guides) > MOST_PARTNERS for d in drives)


def begun(
    members: Members, frame: FrameLayout, device: str | None, how: tuple[str, int], whole: bool
) -> tuple[list[Members], Share, Choice]:
    """The shares of a run, the first of them packed, and the devices that it goes to.

    Args:
        members: all variants.
        frame: how recorded frames lie.
        device: as the user names it.
        how: precision, and CPU threads.
        whole: whether all go in one.

    Raises:
        DriveError: a chain of the first share that does not fit.
        SimulationError: as `devices.chosen_devices`.
    """
    gpus = () if whole else gpus_named(device)
    parts = parts_of(members, len(gpus))
    share = Share(parts[0], frame)
    choice = devices_for(device, share.packed, *how, times=float(members.work.sum() / parts[0].work.sum()))
    if len(parts) > 1 and choice.devices != gpus:  # not what they were cut for
        parts = parts_of(members, 0 if choice.devices == ("cpu",) else len(choice.devices))
        share = Share(parts[0], frame)
    return parts, share, choice


class Shares:
    """Shares under way; as a context, it ends when none is any more, all of them at once where something is raised.

    Args:
        how: how they are run, on GPUs.
        total: simulated time of all [s].
        report, stop: of the run. What shares report is passed on by the thread that calls.
    """

    def __init__(self, how: How, total: float, report: ProgressReport, stop: StopRequest) -> None:
        self._hows = [replace(how, devices=(device,)) for device in how.devices]
        self._gpus = [ThreadPoolExecutor(1, thread_name_prefix=f"warpchain {device}") for device in how.devices]
        self._tables = ThreadPoolExecutor(len(self._gpus), thread_name_prefix="warpchain metrics")
        self._device = wp.get_device()
        self._running: list[Future[tuple[Ended, float, Future[Blocks]]]] = []
        self._done: list[float] = []
        self._total, self._report, self._stop = total, report, stop
        self._compiling: dict[int, tuple[str, float, float]] = {}

    def __enter__(self) -> Shares:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._stop.ask()
        for pool in (*self._gpus, self._tables):
            pool.shutdown(wait=True, cancel_futures=kind is not None)
        wp.set_device(self._device)  # which threads set in turns

    def add(self, share: Share, recorder: Recorder) -> None:
        """Hands a share to the next GPU. Raises what a share before has raised.

        Raises:
            SimulationError: a variant that a GPU does not take.
        """
        from warpchain.engine.gpu import refusal

        reason = refusal(share.packed, share.members.first)
        if reason is not None:
            raise SimulationError(reason)
        number = len(self._running)
        self._done.append(0.0)

        def note(phase: str, done: float, total: float) -> None:
            if phase == "simulating":
                self._done[number] = done
            if phase == COMPILING and done < total:
                self._compiling[number] = (phase, done, total)
            else:
                self._compiling.pop(number, None)

        def run() -> tuple[Ended, float, Future[Blocks]]:
            outcome = share.run(self._hows[number % len(self._hows)], recorder, note, self._stop)
            return outcome.ended, outcome.at, self._tables.submit(outcome.blocks)

        self._running.append(self._gpus[number % len(self._gpus)].submit(run))
        self._tick()

    def outcome(self) -> Outcome:
        """Waits for all shares: what all variants came to."""
        while wait(self._running, timeout=0.1).not_done:
            self._tick()
        self._tick()
        ends, times, tables = zip(*[future.result() for future in self._running], strict=True)
        blocks = [block for table in tables for block in table.result()]
        return Outcome(joined(ends), lambda: blocks, max(times))

    def _tick(self) -> None:
        """Shows how far all are; raises what any has raised."""
        for future in self._running:
            if future.done():
                future.result()
        compiling = list(self._compiling.values())
        self._report(*(compiling[0] if compiling else ("simulating", sum(self._done), self._total)))
