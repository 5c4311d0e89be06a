"""The steps of many variants spread over a GPU's launches.

A block takes one variant through its steps of a launch, and a GPU holds so many blocks at once: a turn. A block ends
when its variant has taken its steps, and the next one takes its place; those with most steps begin first, so that the
last ones end at about the same time. Variants differ in how many steps they have left: each gets its share of them in
every launch, so that all come to their ends in the same one and a GPU is full until then.

Where there is more than a turn of variants they go in two groups, each on a stream of its own, whose launches are cut
into shorter ones: while the last blocks of one group run, blocks of the other fill the GPU, and the rest of a turn is
lost only once in `PARTS` launches.

Each variant is taken by the kernel without metrics to its own window, and by the one with metrics from there on. All
launches end at whole `UNIT`s of steps, where they leave no trace.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.kernels.structs import DIVERGENCE_CHECK

UNIT = int(DIVERGENCE_CHECK)

PARTS = 8
"""Launches that the steps of one are cut into."""


class Launch(NamedTuple):
    """A launch of a kernel: "advance", without metrics, or "measure".

    Attributes:
        variants: their numbers, in the order of their blocks.
        ends: the step that each ends before.
        begun: the step at which its frames' buffer was begun.
    """

    kernel: str
    variants: NDArray[np.integer]
    ends: NDArray[np.integer]
    begun: NDArray[np.integer]


def steps_left(drives: NDArray[Any], progress: NDArray[Any]) -> NDArray[np.int64]:
    """(V,) steps that each variant has yet to take; none where it diverged."""
    left = drives["steps"].astype(np.int64) + 1 - progress["step"]
    return np.where(progress["diverged"] != 0, 0, np.maximum(left, 0))


def shares(left: NDArray[np.integer], most: int) -> NDArray[np.integer]:
    """Steps of each variant in the next launch, of `left`, `most` at most: so that all end in the same one."""
    unit = UNIT if most >= UNIT else 1
    launches = max(1, -(-int(left.max(initial=0)) // most))
    return np.minimum(-(-left // (launches * unit)) * unit, left)


def groups(variants: NDArray[np.integer], turn: int) -> list[NDArray[np.integer]]:
    """Variants, those with most steps first, in two groups alike where there is more than a turn of them."""
    return [variants] if len(variants) <= turn else [variants[0::2], variants[1::2]]


def measured_from(drives: NDArray[Any], step: NDArray[np.integer]) -> NDArray[np.int64]:
    """(V,) the step from which each variant, now at `step`, goes with metrics: the last unit before its window."""
    begins = drives["window_start"].astype(np.int64) // UNIT * UNIT
    return np.where(drives["window_end"] < step, np.iinfo(np.int64).max, begins)


def launches_of(
    variants: NDArray[np.integer],
    step: NDArray[np.integer],
    share: NDArray[np.integer],
    begins: NDArray[np.integer],
    parts: int,
) -> Iterator[Launch]:
    """The launches that take variants on, one after the other.

    Args:
        variants: their numbers, those with most steps first.
        step: (V,) where each variant stands.
        share: (V,) how many steps it is to take.
        begins: (V,) from which step with metrics (`measured_from`).
        parts: that the steps are cut into.
    """
    step, share, begins = step[variants].astype(np.int64), share[variants], begins[variants]
    before = step
    for part in range(1, parts + 1):
        after = step + np.minimum(-(-share * part // (parts * UNIT)) * UNIT, share)
        for kernel, first, end in (
            ("advance", before, np.minimum(after, begins)),
            ("measure", np.maximum(before, begins), after),
        ):
            taken = end > first
            if taken.any():
                yield Launch(kernel, variants[taken], end[taken], step[taken])
        before = after
