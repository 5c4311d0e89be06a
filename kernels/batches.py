"""The window cut into batches of about equal length, at whose ends sums are noted.

With W steps in the window that begins at step a, note k (from 1) is taken at the first step that is a multiple of
the drive's `look_every` and at least a + k W / BATCHES, before that step is added. The window's end gives the last
batch; a window of fewer than BATCHES looks has no batches.
"""

import warp as wp

from .structs import Drive

BATCHES = wp.constant(20)
NOTES = wp.constant(19)
"""Notes that are taken in a window."""


@wp.func
def batches_ended(drive: Drive, step: int):
    """Batches that have ended at `step`, of those at whose ends notes are taken."""
    since = wp.max(step - drive.window_start, 0)
    window = wp.max(drive.window_end - drive.window_start, 1)
    batches = wp.int64(BATCHES)  # once: of two casts of a constant Warp may take one before the constant is set
    share = wp.float32(since) / wp.float32(window)  # the quotient or its neighbor: a division of int64 takes long
    ended = wp.int32(wp.min(share, wp.float32(1.0)) * wp.float32(batches))
    passed = wp.int64(wp.min(since, window)) * batches
    if wp.int64(ended) * wp.int64(window) > passed:
        ended = ended - 1
    if wp.int64(ended + 1) * wp.int64(window) <= passed:
        ended = ended + 1
    return wp.min(ended, NOTES)


@wp.func
def notes_due(drive: Drive, step: int):
    """The first note to take at `step`, a look in the window, and the one after the last."""
    return batches_ended(drive, step - drive.look_every), batches_ended(drive, step)
