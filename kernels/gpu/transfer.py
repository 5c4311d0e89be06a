"""Transfers of a stepped run's piece from and to pinned memory, by kernels: graphs start them sooner than copies."""

from collections.abc import Mapping
from functools import cache

import warp as wp

from ..modules import own_module
from ..number import Pair, pair_from_float64
from ..structs import Drive, Progress


@cache
def transfer_kernels(Real: type) -> Mapping[str, wp.Kernel]:
    """Kernels "take_inputs" and "give_outputs" of a precision."""
    Value, table_value = (Pair, pair_from_float64) if Real is wp.float32 else (wp.float64, wp.float64)
    module = own_module(__file__, "transfer", Real)

    @wp.kernel(enable_backward=False, module=module)
    def take_inputs(
        inputs: wp.array[wp.float64],
        tables: wp.array[Value],
        intervals: wp.array[wp.int32],
        drives: wp.array[Drive],
        progress: wp.array[Progress],
        beyond: wp.array[wp.int32],
        ends: wp.array[wp.int32],
    ):
        """Takes inputs' tables and frame intervals from the host; sets launches' steps `beyond` the first variant's."""
        i = wp.tid()
        if i < inputs.shape[0]:
            tables[i] = table_value(inputs[i])
        if i < intervals.shape[0]:
            drives[i].frame_interval = intervals[i]
        if i < beyond.shape[0]:
            ends[i] = progress[0].step + beyond[i]

    @wp.kernel(enable_backward=False, module=module)
    def give_outputs(
        places: wp.array[wp.int32],
        frames: wp.array[Real],
        host_frames: wp.array[Real],
        progress: wp.array[Progress],
        host_progress: wp.array[Progress],
    ):
        """Gives the host the frames' values at some places, and all progress."""
        i = wp.tid()
        if i < places.shape[0]:
            host_frames[places[i]] = frames[places[i]]
        if i < progress.shape[0]:
            host_progress[i] = progress[i]

    return {"take_inputs": take_inputs, "give_outputs": give_outputs}
