"""What the block kernels' time loop does at some steps only, and when."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..structs import DIVERGENCE_CHECK, Drive, types
from ..sums import MERGE_EVERY

EVENT = wp.constant(1)
"""What can happen at a step, as bits."""
LAST = wp.constant(2)
FRAME = wp.constant(4)
START = wp.constant(8)  # of the window
END = wp.constant(16)
ENDS = wp.constant(24)
EXTRA = wp.constant(28)  # what wants more of each roller than its motion: frames and the window's ends
CHECK = wp.constant(32)  # whether the variant diverged


@wp.func
def next_event(drive: Drive, step: int):
    """The next step after `step` at which more happens than forces and motion."""
    event = (step // DIVERGENCE_CHECK + 1) * DIVERGENCE_CHECK
    if step < drive.window_end:
        event = wp.min(event, (step // MERGE_EVERY + 1) * MERGE_EVERY)
        event = wp.min(event, drive.window_end)
    if step < drive.window_start:
        event = wp.min(event, drive.window_start)
    if step == drive.window_start or step == drive.window_end:
        event = step + 1
    if drive.sample_every > 0:
        event = wp.min(event, (step // drive.sample_every + 1) * drive.sample_every)
    if step < drive.steps:
        event = wp.min(event, drive.steps)
    return event


@wp.func
def flags_of(drive: Drive, step: int):
    """What happens at `step`, as bits."""
    flags = int(EVENT)
    if step == drive.steps:
        flags = flags | LAST
    if drive.sample_every > 0:
        if step % drive.sample_every == 0:
            flags = flags | FRAME
    if step == drive.window_start:
        flags = flags | START
    if step == drive.window_end:
        flags = flags | END
    if step % DIVERGENCE_CHECK == 0 or step == drive.steps:
        flags = flags | CHECK
    return flags


@dataclass(frozen=True)
class EventFunctions:
    """Where frames go."""

    frame_at: wp.Function


@cache
def block_events(Real: type, sprockets: int, frame: Any) -> EventFunctions:
    """Where frames go, for drives of this number of sprockets; they lie as `frame` says (`frames.frame_writers`)."""
    kinds = types(Real)
    width = frame_writers(Real, frame).width

    @wp.func
    def frame_at(ensemble: kinds.Ensemble, state: kinds.State, variant: int, since: int, step: int):
        """Where the frame of `step` begins in a buffer that was begun `since` steps before this launch."""
        drive = ensemble.drives[variant]
        every = drive.sample_every
        first = state.progress[variant].step - since
        number = step // every - (first + every - 1) // every
        values = width(drive.rollers, wp.static(sprockets), drive.arms, drive.tensioners)
        return int(drive.first_value) + number * values

    return EventFunctions(frame_at=frame_at)
