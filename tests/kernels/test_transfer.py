"""Transfers of a piece: inputs' tables at each precision, launches' steps, outputs, progress."""

import numpy as np
import pytest
import warp as wp

from warpchain.engine.arrays import array_type, dtype_of
from warpchain.kernels.gpu.transfer import transfer_kernels
from warpchain.kernels.precision import as_float32
from warpchain.kernels.structs import Drive, Progress


def array(values, dtype):
    return wp.array(values, dtype=dtype, device="cpu")


def progress(step, count=3):
    rows = np.zeros(count, dtype=Progress.numpy_dtype())
    rows["step"], rows["diverged"][1] = step, 1
    return rows


@pytest.mark.parametrize("real", [wp.float64, wp.float32])
def test_tables_come_in_the_devices_type_and_steps_from_where_variants_are(real):
    values = np.random.default_rng(0).normal(scale=1e3, size=7)
    table = array_type("ensemble", "tables", real, True)
    tables, ends = wp.zeros(7, dtype=table, device="cpu"), wp.zeros(9, dtype=wp.int32, device="cpu")
    beyond = np.arange(9, dtype=np.int32)
    intervals, drives = np.array([20, 0, 60], dtype=np.int32), wp.zeros(3, dtype=Drive, device="cpu")
    inputs = [array(values, wp.float64), tables, array(intervals, wp.int32), drives]
    inputs += [array(progress(500), Progress), array(beyond, wp.int32), ends]
    wp.launch(transfer_kernels(real)["take_inputs"], 9, inputs=inputs, device="cpu")
    np.testing.assert_array_equal(tables.numpy(), as_float32(values, dtype_of(table)))
    np.testing.assert_array_equal(drives.numpy()["frame_interval"], intervals)
    np.testing.assert_array_equal(ends.numpy(), 500 + beyond)


@pytest.mark.parametrize("real", [wp.float64, wp.float32])
@pytest.mark.parametrize("places", [[], [1], [0, 2, 4, 5]])  # fewer than variants, and more
def test_outputs_go_to_their_places_with_all_progress(real, places):
    values = np.random.default_rng(1).normal(size=6).astype(dtype_of(real))
    frames, found = wp.zeros(6, dtype=real, device="cpu"), wp.zeros(3, dtype=Progress, device="cpu")
    outputs = [array(np.array(places, dtype=np.int32), wp.int32), array(values, real), frames]
    threads = max(len(places), 3)
    inputs = [*outputs, array(progress(7), Progress), found]
    wp.launch(transfer_kernels(real)["give_outputs"], threads, inputs=inputs, device="cpu")
    np.testing.assert_array_equal(frames.numpy(), np.where(np.isin(np.arange(6), places), values, 0.0))
    np.testing.assert_array_equal(found.numpy(), progress(7))
