"""The steps of many variants divided into a GPU's launches.

A block steps one variant, and a GPU holds so many blocks at once: a turn. Variants with most steps begin first, and
each gets such a number of steps in every launch that all end in the same one. More than a turn of variants go in two
groups, each on a stream of its own, whose launches are cut into `LAUNCH_PARTS`: blocks of one group then fill the GPU
while the last blocks of the other run.

Each variant is stepped without metrics to its window, and with metrics from there on. Launches end at whole multiples
of `STEP_UNIT`, where that changes no bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.kernels.structs import DIVERGENCE_CHECK

STEP_UNIT = int(DIVERGENCE_CHECK)

LAUNCH_PARTS = 8
"""Launches into which the steps of one are cut."""


class Launch(NamedTuple):
    """A launch of a kernel: "advance", without metrics, or "measure".

    Attributes:
        variants: their numbers, in the order of their blocks.
        end_steps: the step before which each ends.
        start_steps: the step at which its buffer of frames begins.
    """

    kernel: str
    variants: NDArray[np.integer]
    end_steps: NDArray[np.integer]
    start_steps: NDArray[np.integer]


def steps_left(drives: NDArray[Any], progress: NDArray[Any]) -> NDArray[np.int64]:
    """(V,) steps that each variant has yet to take; none where it diverged."""
    left = drives["steps"].astype(np.int64) + 1 - progress["step"]
    return np.where(progress["diverged"] != 0, 0, np.maximum(left, 0))


def next_launch_steps(left: NDArray[np.integer], most: int) -> NDArray[np.integer]:
    """(V,) steps of each variant in the next launch, of `left`, `most` at most, so that all end in the same launch."""
    unit = STEP_UNIT if most >= STEP_UNIT else 1
    launches = max(1, -(-int(left.max(initial=0)) // most))
    return np.minimum(-(-left // (launches * unit)) * unit, left)


def launch_groups(variants: NDArray[np.integer], turn: int) -> list[NDArray[np.integer]]:
    """Variants, those with most steps first, in two groups alike where there is more than a turn of them."""
    return [variants] if len(variants) <= turn else [variants[0::2], variants[1::2]]


def metrics_start_steps(drives: NDArray[Any], step: NDArray[np.integer]) -> NDArray[np.int64]:
    """(V,) the step from which each variant, now at `step`, is stepped with metrics."""
    begins = drives["window_start"].astype(np.int64) // STEP_UNIT * STEP_UNIT
    return np.where(drives["window_end"] < step, np.iinfo(np.int64).max, begins)


def split_launches(
    variants: NDArray[np.integer],
    step: NDArray[np.integer],
    share: NDArray[np.integer],
    begins: NDArray[np.integer],
    parts: int,
) -> Iterator[Launch]:
    """The launches that take variants their steps, one after the other.

    Args:
        variants: their numbers, those with most steps first.
        step: (V,) the next step of each variant.
        share: (V,) steps that each is to take.
        begins: (V,) the step from which each is stepped with metrics (`metrics_start_steps`).
        parts: into how many launches the steps are cut.
    """
    step, share, begins = step[variants].astype(np.int64), share[variants], begins[variants]
    before = step
    for part in range(1, parts + 1):
        after = step + np.minimum(-(-share * part // (parts * STEP_UNIT)) * STEP_UNIT, share)
        for kernel, first, end in (
            ("advance", before, np.minimum(after, begins)),
            ("measure", np.maximum(before, begins), after),
        ):
            taken = end > first
            if taken.any():
                yield Launch(kernel, variants[taken], end[taken], step[taken])
        before = after
