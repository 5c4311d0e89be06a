"""`simulate`: runs an ensemble of drives, from schedules to metrics and trajectories, with an orderly end on Ctrl-C."""

from __future__ import annotations

import datetime
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import Count, FiniteNumber, PositiveNumber, Workers, check_arguments
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive
from warpchain.drive.plugins import plugin_words
from warpchain.drive.replicates import REPLICATE_WAYS, CopyCount, Replicates, all_copies
from warpchain.drive.stack_math import maximum
from warpchain.engine.recorder import Recorder, RecordingOptions
from warpchain.errors import DriveError, LayoutWarning, SimulationError, SuspectWarning, warn_caller
from warpchain.gc_tuning import rare_collections
from warpchain.model import Model
from warpchain.model.stacks import Stack, first_refusal, first_refused_variant, stacks_of_drives
from warpchain.progress import Progress, interruptible_work, progress_reporter
from warpchain.results.judgement import Limits, judgement_warning
from warpchain.results.metrics import metrics_table
from warpchain.results.own_metrics import metric_channels, table_with_own_metrics
from warpchain.results.replicate_metrics import metrics_with_copies
from warpchain.results.run import Record, Run, RunInfo
from warpchain.results.schedule import LOOK_EVERY, Schedules, whole_steps
from warpchain.version import installed_version

if TYPE_CHECKING:
    from warpchain.archive.options import ArchiveOptions
    from warpchain.engine.checkpoint import StateKeeper, States

MEMORY = 2 * 2**30
"""Default memory budget [bytes]."""

SAMPLES_PER_PITCH = 16
"""Fewest samples a pitch of motion."""

SAMPLES_PER_WINDOW = 320
"""Fewest samples in a window."""

LONG_SAMPLE_INTERVAL = 2 * LOOK_EVERY
"""Steps between samples of a slow chain."""


@check_arguments(SimulationError)
@rare_collections()
def simulate(
    drives: Drive | Sequence[Drive],
    *,
    device: str | None = None,
    precision: Literal["float64", "float32"] = "float64",
    duration: PositiveNumber | None = None,
    step: PositiveNumber | Literal["auto"] | None = None,
    record: Record | None = None,
    window: tuple[FiniteNumber, FiniteNumber] | None = None,
    progress: Progress = False,
    memory: Count = MEMORY,
    archive: str | Path | None = None,
    archive_options: ArchiveOptions | None = None,
    overwrite: bool = False,
    workers: Workers | None = None,
    limits: Limits | None = None,
    replicates: CopyCount = 1,
    replicate_by: str = REPLICATE_WAYS[0],
    states: States | None = None,
) -> Run:
    """Simulation of drives, all at once: metrics and trajectories.

    A variant's result depends neither on the others nor on the number of threads, to the last bit.

    Args:
        drives: one or many, which may differ in every value.
        device: "cpu", "cuda" (all GPUs), "cuda:1", or None for those expected to finish first; their last bits
            differ.
        precision: "float64" or "float32".
        duration: simulated time [s]; None: each drive's own.
        step: time step [s], or "auto"; None: each drive's own.
        record: trajectories to keep; None: all.
        window: (start, end) of metrics [s]; None: the second half of the run.
        progress: True shows a bar; a function gets (phase, done, total): "compiling", in kernels; "settling", in
            drives; "simulating", in simulated time of all variants [s].
        memory: budget for sums and statistics, buffers and kept trajectories [bytes].
        archive: MCAP file for recorded frames, instead of memory.
        archive_options: how it is written.
        overwrite: replace an archive of that name.
        workers: CPU threads; None: all cores.
        limits: what a variant may come to and still be "ok" (column `status` of the metrics).
        replicates: copies of each drive that differ in how they begin; copy k of drive d is variant d * replicates + k;
            `run.summary` has their means.
        replicate_by: "build", at other phases within a tooth, rollers elsewhere in the gaps; "phase", at other phases;
            "perturbation", every roller displaced by some 1e-9 pitches.
        states: keeps where variants stand, so that longer runs go on from there (`warpchain.engine.checkpoint`).

    Returns:
        The run; if the user interrupts, what was computed until then, with `run.info.ended` "interrupted".

    Raises:
        DriveError: a chain that does not fit, or a step beyond its limit.
        SimulationError: an invalid argument, an unknown device, a window outside the run, or trajectories beyond the
            memory budget.

    Warns:
        LayoutWarning: strands that cross, guide-bars that cut through the chain or dent it by more than a pitch.
        SuspectWarning: variants that are not "ok": which, why, and what to change.
    """
    from warpchain.assembly.stack_assembly import layout_faults_line
    from warpchain.engine import start_warp
    from warpchain.engine.own_laws import add_laws
    from warpchain.engine.packed_ensemble import real_type
    from warpchain.engine.pipeline import MOST_PER_GPU, SubensembleQueue, plan_run
    from warpchain.engine.subensemble import DeviceSettings, Subensemble, Variants
    from warpchain.kernels.structs import types
    from warpchain.results.channels import frame_with_channels

    start_warp()
    add_laws()
    chosen = (drives,) if isinstance(drives, Drive) else tuple(drives)
    copies = Replicates(replicates, replicate_by)
    chosen = tuple(all_copies(chosen, copies))
    if not chosen:
        raise SimulationError("drives: none given; at least one is needed")
    plugins, measured = plugin_words(), metric_channels()
    if states is not None and measured:
        raise SimulationError("keep_states: not with a plug-in's metric that reads frames, which go on from no state")
    recording = RecordingOptions(record or Record(), precision, memory, archive, archive_options, overwrite, measured)
    stacks = stacks_of_drives(chosen, len(chosen))
    schedules = schedules_of(chosen, duration, step, recording.frames, window, stacks)
    cores = workers or available_cores()
    types(real_type(precision))  # an unknown precision ends here; made before threads of subensembles ask for them
    variants = Variants(chosen, schedules, stacks, np.arange(len(chosen)))
    frame = frame_with_channels(recording.frames.channels)
    most = (
        MOST_PER_GPU if archive is None else 1
    )  # one at a time writes to an archive, so that its files follow the time
    parts, first, (devices, why) = plan_run(variants, frame, device, (precision, cores), most)
    rest: Iterable[Subensemble] = (Subensemble(part, frame) for part in parts[1:])
    if archive is not None:
        rest = list(rest)  # what does not fit leaves no file
    created = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    steps = schedules.columns["step"]
    common = float(steps[0]) if (steps == steps[0]).all() else None
    info = RunInfo(
        installed_version(), ",".join(devices), precision, created=created, step=common, choice=why, plugins=plugins
    )
    if states is not None:
        states.prepare(len(chosen))
    kept = None if any(drive.chains for drive in chosen) else states
    settings, begin = DeviceSettings(devices[0], precision, cores), time.monotonic()
    with recording.open_archive(chosen, info) as writer:

        def make_recorders(part: Subensemble) -> tuple[Recorder, StateKeeper | None]:
            """Recorder of a subensemble's frames, and state keeper, if any."""
            return part.make_recorder(recording, len(chosen), writer), part.make_state_keeper(kept, settings)

        with progress_reporter(progress) as report, interruptible_work() as stop:
            if len(parts) == 1:
                _warn_caller(LayoutWarning, layout_faults_line(first.layout_faults))
                outcome = first.run(settings, *make_recorders(first), report, stop)
            else:
                total = float((schedules.columns["steps"] * steps).sum())
                with SubensembleQueue(settings, devices, make_recorders, writer is None, total, report, stop) as queue:
                    queue.add(first)
                    for part in rest:
                        queue.add(part)
                    _warn_caller(LayoutWarning, layout_faults_line(queue.layout_faults))
                    outcome = queue.joined_result()
        info = replace(info, ended="interrupted" if stop.is_asked else "complete", wall_time=outcome.end_time - begin)
        table = metrics_table(outcome.ends, outcome.metric_blocks(), limits)
        metrics = metrics_with_copies(table_with_own_metrics(table, chosen, outcome.measured), copies.count)
        _warn_caller(SuspectWarning, judgement_warning(metrics["status"].to_pylist(), metrics["reason"].to_pylist()))
        return Run(chosen, metrics, recording.finished_trajectories(writer, metrics, info, outcome.trajectories), info)


def available_cores() -> int:
    """CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@np.errstate(over="ignore")  # more steps than a number holds are refused
def schedules_of(
    drives: Sequence[Drive],
    duration: float | None,
    step: float | str | None,
    record: Record,
    window: tuple[float, float] | None,
    stacks: Sequence[Stack[Drive]] | None = None,
) -> Schedules:
    """Schedules of variants: steps, samples and window, in whole steps.

    Raises:
        DriveError: a step beyond a variant's limit.
        SimulationError: a window outside the run.
    """
    count = len(drives)
    recorded = record.indices(count)
    stacks = stacks_of_drives(drives) if stacks is None else stacks
    h, longest = _step_sizes(count, step, stacks)
    length, rate = np.zeros(count), np.zeros(count)
    for stack in stacks:
        length[stack.members] = stack.one.run.duration if duration is None else duration
    for v in recorded:
        rate[v] = drives[v].run.sample_rate if record.rate is None else record.rate

    def schedules(of: slice) -> Schedules:
        """Schedules of a range of variants."""
        return _schedules(of.start, h[of], longest[of], length[of], window, rate[of])

    try:
        return schedules(slice(0, count))
    except SimulationError:
        for v in range(count):  # the first that is refused
            schedules(slice(v, v + 1))
        raise


def _step_sizes(
    count: int, step: float | str | None, stacks: Sequence[Stack[Drive]]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Steps (V,) of variants [s], or DriveError, and most steps between samples."""
    found, longest = np.zeros(count), np.zeros(count, dtype=np.int64)
    refused: list[tuple[int, DriveError]] = []
    for stack in stacks:
        try:
            found[stack.members] = resolve_step(stack.one, step)
            longest[stack.members] = longest_sample_interval(stack.one, found[stack.members])
        except DriveError:
            refused.append(first_refused_variant(stack, lambda drive: resolve_step(drive, step)))
    if refused:
        raise first_refusal(refused)
    return found, longest


def _schedules(
    first: int,
    h: NDArray[np.float64],
    longest: NDArray[np.int64],
    length: NDArray[np.float64],
    window: tuple[float, float] | None,
    rate: NDArray[np.float64],
) -> Schedules:
    """Schedules of variants from number `first` on, in whole steps.

    Args:
        h: (V,) steps [s].
        longest: (V,) most steps between samples.
        length: (V,) simulated time [s].
        window: as of `simulate`.
        rate: (V,) of frames [Hz], 0 for none.

    Raises:
        SimulationError: too few or many steps, or an invalid window.
    """
    start, end = (0.5 * length, length) if window is None else (np.full_like(length, time) for time in window)
    of_step = f"s at a step of {h[0]:.4g} s"
    steps = np.maximum(1, whole_steps(f"duration = {length[0]:g} {of_step}", length / h))
    begin, stop = (whole_steps(f"window: {time[0]:g} {of_step}", time / h) for time in (start, end))
    if ((begin < 0) | (begin >= stop) | (stop > steps)).any():
        raise SimulationError(
            f"window = ({start[0]:g}, {end[0]:g}) s: allowed is 0 <= start < end <= duration = {length[0]:g} s "
            f"(variant {first})"
        )
    every, recorded = np.zeros_like(steps), rate > 0.0
    if recorded.any():
        period = np.full_like(h, np.inf)
        np.divide(1.0, rate * h, out=period, where=rate * h > 0.0)
        what = f"rate = {rate[0]:g} Hz: a sample's period at a step of {h[0]:.4g} s"
        every[recorded] = np.maximum(1, whole_steps(what, period[recorded]))
    sampled = sample_interval(longest, stop - begin)
    return Schedules({"step": h, "steps": steps, "window_start": begin, "window_end": stop, "frame_interval": every,
                      "sample_interval": sampled})  # fmt: skip


def longest_sample_interval(drive: Drive, step: float | NDArray[np.float64]) -> NDArray[np.int64]:
    """Most steps (V,) between samples, by chain speed; `step` in s."""
    moved = np.asarray(maximum(*(of.chain_speed * step / of.chain.pitch for of in Model(drive).chains)))
    return np.where(
        (moved > 0.0) & (SAMPLES_PER_PITCH * LONG_SAMPLE_INTERVAL * moved <= 1.0), LONG_SAMPLE_INTERVAL, LOOK_EVERY
    )


def sample_interval(longest: Any, window: Any) -> Any:
    """Steps between samples in windows of so many steps, at most `longest`."""
    return np.where(window >= SAMPLES_PER_WINDOW * longest, longest, LOOK_EVERY)


def _warn_caller(kind: type[Warning], line: str | None) -> None:
    """Warns as from `simulate`'s caller, if there is a line."""
    if line is not None:
        warn_caller(line, kind)
