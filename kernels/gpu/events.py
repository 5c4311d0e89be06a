"""Events of a block's time loop: steps at which more happens than forces and motion."""

import warp as wp

from ..structs import DIVERGENCE_CHECK, Drive
from ..sums import MERGE_EVERY

EVENT = wp.constant(1)
"""Events of a block's step, as bits."""
LAST = wp.constant(2)
FRAME = wp.constant(4)
START = wp.constant(8)  # of the window
END = wp.constant(16)
ENDS = wp.constant(24)
EXTRA = wp.constant(28)  # what wants more of each roller than its motion: frames and the window's ends
CHECK = wp.constant(32)  # whether the variant diverged


@wp.func
def next_event(drive: Drive, step: int):
    """Next step after `step` with an event of the block's time loop."""
    event = (step // DIVERGENCE_CHECK + 1) * DIVERGENCE_CHECK
    if step < drive.window_end:
        event = wp.min(event, (step // MERGE_EVERY + 1) * MERGE_EVERY)
        event = wp.min(event, drive.window_end)
    if step < drive.window_start:
        event = wp.min(event, drive.window_start)
    if step == drive.window_start or step == drive.window_end:
        event = step + 1
    if drive.frame_interval > 0:
        event = wp.min(event, (step // drive.frame_interval + 1) * drive.frame_interval)
    if step < drive.steps:
        event = wp.min(event, drive.steps)
    return event


@wp.func
def event_flags(drive: Drive, step: int):
    """Events of `step` in the block's time loop, as bits."""
    flags = int(EVENT)
    if step == drive.steps:
        flags = flags | LAST
    if drive.frame_interval > 0:
        if step % drive.frame_interval == 0:
            flags = flags | FRAME
    if step == drive.window_start:
        flags = flags | START
    if step == drive.window_end:
        flags = flags | END
    if step % DIVERGENCE_CHECK == 0 or step == drive.steps:
        flags = flags | CHECK
    return flags
