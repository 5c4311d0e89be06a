"""How many threads of a GPU one variant gets, and how many of its rollers each of them has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

THREADS = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 1024)
"""Sizes of blocks that have one roller a thread; longer chains have several on the largest."""

LONGEST_ON_A_WARP = 512
"""Links of the longest chain that one warp may have to itself."""

MANY = 6
"""Variants a multiprocessor from which a warp each is faster (docs/performance.md)."""


@dataclass(frozen=True, order=True)
class BlockShape:
    """Threads of a block, and how many rollers each has at most."""

    threads: int
    per: int

    @property
    def slots(self) -> int:
        """Rollers that the block has room for."""
        return self.threads * self.per

    def resident(self, precision: str, measuring: bool, wanted: int) -> int:
        """How many blocks the compiler is to make room for on a multiprocessor, `wanted` at most.

        This bounds the registers of a thread; taking metrics wants more of them, and of shared memory. What is best was
        measured on an H200 (docs/performance.md).
        """
        if self.threads == 32:
            most = {
                ("float64", False): (12, 12, 8),
                ("float64", True): (12, 12, 8),
                ("float32", False): (16, 12, 12),
                ("float32", True): (12, 12, 8),
            }[precision, measuring][(self.per > 4) + (self.per > 6)]
        else:
            most = (512 if precision == "float64" and self.threads <= 128 else 768) // self.threads
        return max(1, min(most, max(wanted, 2)))


def room_for(links: NDArray[np.integer]) -> NDArray[np.integer]:
    """The rollers that blocks for chains of so many links have room for, so that like chains share a kernel."""
    most = THREADS[-1]
    return np.where(links > most, -(-links // most) * most, np.array(THREADS)[np.searchsorted(THREADS[:-1], links)])


def block_shape(room: int, many: bool) -> BlockShape:
    """The block for chains of up to `room` links, as from `room_for`.

    Few variants are fastest with a roller a thread; of `many`, each is fastest on a warp of its own, which then waits
    for no other. Moments on sprockets are added up in the same order either way, so a variant's results do not
    depend on how many there are beside it.
    """
    if many and room <= LONGEST_ON_A_WARP:
        return BlockShape(32, -(-room // 32))
    threads = min(room, THREADS[-1])
    return BlockShape(threads, -(-room // threads))
