"""Rows of values, one a roller, as both the CPU's and the GPU's kernels keep them: how they are read and written."""

from functools import cache
from types import SimpleNamespace

import warp as wp

STATE_ROWS = wp.constant(6)
"""A variant's rows in `structs.State.rollers`: x, y, vx, vy, and the low parts of x, y."""


@cache
def accessors(Real: type) -> SimpleNamespace:
    """`load(array, i)` and `store(array, i, value)` for contiguous arrays of `Real`, without a stride."""

    @wp.func_native("return a.data[i];")
    def load(a: wp.array[Real], i: int) -> Real: ...

    @wp.func_native("a.data[i] = value;")
    def store(a: wp.array[Real], i: int, value: Real): ...

    return SimpleNamespace(load=load, store=store)
