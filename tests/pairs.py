"""Rows as blocks at float32 keep them beside those of float64, and kernels that compare the two."""

import numpy as np
import warp as wp

from warpchain.kernels.precision import as_float32
from warpchain.kernels.structs import types

BLOCKS = types(wp.float32, blocks=True)


def launched(kernel, count, *inputs, width=1, rows=None):
    """What a kernel writes for `count` threads, as (rows, width) float64, a row a thread unless told."""
    out = wp.zeros((rows or count, width), dtype=wp.float64, device="cpu")
    wp.launch(kernel, count, inputs=[*inputs, out], device="cpu")
    return out.numpy()


def given(values, dtype=wp.float64):
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")


def both(full, count=1, **values):
    """Rows of a struct of float64, and the same as blocks at float32 keep them, as arrays."""
    rows = np.zeros(count, dtype=full.numpy_dtype())
    for name, value in values.items():
        rows[name] = value
    made = getattr(BLOCKS, full.key)
    return given(rows, full), given(as_float32(rows, np.dtype(made.numpy_dtype())), made)
