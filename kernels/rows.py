"""Rows of values, one a roller, as both the CPU's and the GPU's kernels keep them: how they are read and written."""

from dataclasses import dataclass
from functools import cache

import warp as wp

STATE_ROWS = wp.constant(6)
"""A variant's rows in `structs.State.rollers`: x, y, vx, vy, and the low parts of x, y."""

LANES = wp.constant(4)
"""Rollers that the CPU's loops over rows take at a time; what lies beyond the chain's end is worked out, not read."""


@wp.func
def whole(n: int):
    """`n` rounded up to a multiple of `LANES`."""
    return (n + LANES - 1) & -LANES


@dataclass(frozen=True)
class Accessors:
    """How the values of a row are read and written."""

    load_row: wp.Function
    store_row: wp.Function


@cache
def accessors(Real: type) -> Accessors:
    """`load_row(array, i)` and `store_row(array, i, value)` for contiguous arrays of `Real`, without a stride.

    In Warp's debug build an index out of bounds ends the process, as it does for its own arrays.
    """

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); return a.data[i];")
    def load_row(a: wp.array[Real], i: int) -> Real: ...

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); a.data[i] = value;")
    def store_row(a: wp.array[Real], i: int, value: Real): ...

    return Accessors(load_row=load_row, store_row=store_row)
