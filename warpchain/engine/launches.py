"""Launches of a GPU: the steps of many variants divided among them.

A GPU holds so many variants' blocks at once: a turn. All variants end in the same launch; beyond a turn they go in two
groups, each on its own stream.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.kernels.structs import DIVERGENCE_CHECK

STEP_UNIT = int(DIVERGENCE_CHECK)

LAUNCH_PARTS = 8
"""GPU launches into which the steps of one are cut."""


class Launch(NamedTuple):
    """Launch of GPU kernel "advance", without metrics, or "measure"."""

    kernel: str
    variants: NDArray[np.integer]  # their numbers, in the order of their blocks
    end_steps: NDArray[np.integer]  # step before which each ends
    start_steps: NDArray[np.integer]  # step at which its buffer of frames begins


def steps_left(drives: NDArray[Any], progress: NDArray[Any]) -> NDArray[np.int64]:
    """Steps (V,) that variants have yet to take."""
    left = drives["steps"].astype(np.int64) + 1 - progress["step"]
    return np.where(progress["diverged"] != 0, 0, np.maximum(left, 0))


def next_launch_steps(left: NDArray[np.integer], most: int) -> NDArray[np.integer]:
    """Steps (V,) of variants in the next GPU launch."""
    unit = STEP_UNIT if most >= STEP_UNIT else 1
    launches = max(1, -(-int(left.max(initial=0)) // most))
    return np.minimum(-(-left // (launches * unit)) * unit, left)


def launch_groups(variants: NDArray[np.integer], turn: int) -> list[NDArray[np.integer]]:
    """Groups of variants, most steps first, for a GPU: two beyond a turn."""
    return [variants] if len(variants) <= turn else [variants[0::2], variants[1::2]]


def metrics_start_steps(drives: NDArray[Any], step: NDArray[np.integer]) -> NDArray[np.int64]:
    """Steps (V,) from which GPU launches take metrics."""
    begins = drives["window_start"].astype(np.int64) // STEP_UNIT * STEP_UNIT
    return np.where(drives["window_end"] < step, np.iinfo(np.int64).max, begins)


def split_launches(
    variants: NDArray[np.integer],
    step: NDArray[np.integer],
    share: NDArray[np.integer],
    begins: NDArray[np.integer],
    parts: int,
) -> Iterator[Launch]:
    """Yields the GPU launches that take variants' steps.

    Args:
        variants: numbers, most steps first.
        step: (V,) next step.
        share: (V,) steps to take.
        begins: (V,) steps from which metrics are taken.
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
