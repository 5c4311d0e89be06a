"""Rows of values: which of them are unlike one value, as bits."""

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.kernels.native import LANES, row_access


def asking(Real):
    """Kernels that tell of every count which values are unlike one, and rounded up to whole lanes."""
    unlike, whole = row_access(Real).find_unlike, row_access(Real if Real in LANES else wp.float64).round_up

    @kernel
    def ask(values: wp.array[Real], first: int, value: Real, bits: wp.array[wp.uint64]):
        count = wp.tid()
        bits[count] = unlike(values, first, count, value)

    @kernel
    def lanes(rounded: wp.array[int]):
        rounded[wp.tid()] = whole(wp.tid())

    return ask, lanes


KERNELS = {Real: asking(Real) for Real in (wp.int32, wp.float32, wp.float64)}


@pytest.mark.parametrize("Real", KERNELS, ids=lambda kind: kind.__name__)
def test_bits_tell_which_values_are_unlike_one(Real):
    """Of every count up to 64, against numpy; values after them and before them do not matter."""
    held = np.random.default_rng(7).integers(-1, 1, 80)
    values = wp.array(held, dtype=Real, device="cpu")
    for first in (0, 5, 16):
        bits = wp.zeros(65, dtype=wp.uint64, device="cpu")
        wp.launch(KERNELS[Real][0], dim=65, inputs=[values, first, Real(-1), bits], device="cpu")
        expected = [sum(int(held[first + k] != -1) << k for k in range(count)) for count in range(65)]
        assert [int(found) for found in bits.numpy()] == expected


@pytest.mark.parametrize("Real", sorted(LANES, key=str), ids=lambda kind: kind.__name__)
def test_numbers_of_rollers_are_rounded_up_to_whole_lanes(Real):
    rounded = wp.zeros(40, dtype=int, device="cpu")
    wp.launch(KERNELS[Real][1], dim=40, inputs=[rounded], device="cpu")
    assert rounded.numpy().tolist() == [-(-n // LANES[Real]) * LANES[Real] for n in range(40)]
