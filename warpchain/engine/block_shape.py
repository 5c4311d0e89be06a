"""How many threads of a GPU one variant gets, and how many of its rollers each of them has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.kernels.gpu.kind import DECLARED, WARP, BlockKind

ROOMS = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 896, 1024)
"""Rollers that blocks have room for; beyond, sixteenths of the next power of two, from 4,096 on whole 1,024."""

LONGEST_ON_A_WARP = 512
"""Links of the longest chain that one warp may have to itself."""

MANY = 6
"""Variants a multiprocessor from which a warp each is faster (docs/performance.md)."""

LOW_OCCUPANCY = 8
"""Most variants a multiprocessor at which a thread of theirs has registers for two contacts at once."""

VARIANTS_PER_BLOCK = 4
"""Variants of a block, a warp each, where going through the same code at the same time makes them faster."""

ROW = 16
"""Variants that a multiprocessor holds where they are abreast, and fewest where they are."""

LONGER_ROW = 20
"""The same of kernels that are short enough for the registers that threads then have, 96."""

BODY_WARP = 2
"""Most variants a multiprocessor at which each may have a warp for its bodies alone."""


@dataclass(frozen=True, order=True)
class BlockShape:
    """Threads of a block, and how many rollers each has at most."""

    threads: int
    rollers_per_thread: int
    body_warp: bool = False
    """Whether the last warp has no rollers, but moves the bodies."""
    shared_bytes: int = DECLARED
    """Most of shared memory that a block may have."""
    low_occupancy: bool = False
    """Whether so few are on a multiprocessor that a thread has registers for two contacts at once."""

    @property
    def slots(self) -> int:
        """Rollers that the threads could have."""
        return self.threads * self.rollers_per_thread

    @property
    def room(self) -> int:
        """Rollers that there is room for."""
        return self.slots - 32 * self.body_warp

    def variants_per_block(self, precision: str, measuring: bool, each: int, simple: bool) -> int:
        """How many variants a block has, of which a multiprocessor gets `each`; arguments as in `resident`.

        One on a warp has its own block unless several were measured to be faster: long code at float32, which is
        fetched once for all that are abreast.
        """
        if precision != "float32" or self.threads != WARP or self.rollers_per_thread > 6 or each < ROW or not simple:
            return 1
        return VARIANTS_PER_BLOCK if measuring or self.rollers_per_thread > 4 else 1

    def resident(self, precision: str, measuring: bool, wanted: int, simple: bool = False, row: int = 0) -> int:
        """How many variants the compiler is to make room for on a multiprocessor, `wanted` at most.

        This bounds the registers of a thread; taking metrics wants more of them, and of shared memory, and kernels of
        drives that are `simple` (`buckets.Bucket`) fewer. Where variants are abreast it holds `row`, which else is 0.
        What is best was measured on an H200 (docs/performance.md).
        """
        if row:
            most = row
        elif self.threads == WARP:
            most = {
                ("float64", False): (12, 12, 8),
                ("float64", True): (12, 12, 8),
                ("float32", False): (20, 16, 12),
                ("float32", True): (20, 16, 8),
            }[precision, measuring][(self.rollers_per_thread > 4) + (self.rollers_per_thread > 6)]
            if simple and precision == "float64" and self.rollers_per_thread <= (4 if measuring else 6):
                most = 14
        elif self.slots > LONGEST_ON_A_WARP and self.rollers_per_thread > 1:
            most = 2 if self.rollers_per_thread > 8 else 3 if precision == "float64" else 4
            most = most * 128 // self.threads
        else:
            most = (512 if precision == "float64" and self.threads <= 160 else 768) // self.threads
        return max(1, min(most, wanted))


def row_of(kind: BlockKind) -> int:
    """How many variants of a kind a multiprocessor holds that are abreast, 0 of those that are not."""
    if kind.variants_per_block == 1:
        return 0
    return LONGER_ROW if kind.rollers_per_thread <= 4 and not (kind.contact_friction or kind.joint_friction) else ROW


def room_for(links: NDArray[np.integer]) -> NDArray[np.integer]:
    """The rollers that blocks for chains of so many links have room for, so that like chains share a kernel."""
    most = ROOMS[-1]
    step = np.minimum(2 ** np.ceil(np.log2(np.maximum(links, most))).astype(int) // 8, most)
    return np.where(links > most, -(-links // step) * step, np.array(ROOMS)[np.searchsorted(ROOMS[:-1], links)])


def on_two_warps(room: int, each: int) -> bool:
    """Whether two warps a variant are fastest at float32, of `each` variants a multiprocessor (measured on an H200)."""
    return 160 < room <= 256 and 4 <= each <= 6


def block_shape(room: int, each: int, shared_bytes: int = DECLARED, precision: str = "float64") -> BlockShape:
    """The block for chains of up to `room` links, as from `room_for`, of which a multiprocessor gets `each` variants.

    Few variants are fastest with a roller a thread, and very few with a warp beside them for the bodies; of many, each
    is fastest on a warp of its own, which then waits for no other, and between these at float32 on two. Moments on
    bodies are added up in the same order either way, so a variant's results do not depend on how many there are beside
    it. Longer chains have up to 16 rollers a thread and `shared_bytes` of memory, however many they are.
    """
    if room > LONGEST_ON_A_WARP:
        threads = 1024 if room > 4096 else max(128, 2 ** (room - 1).bit_length() // 16)
        return BlockShape(threads, -(-room // threads), shared_bytes=shared_bytes)
    if precision == "float32" and on_two_warps(room, each):
        return BlockShape(64, -(-room // 64))
    if each >= MANY:
        return BlockShape(WARP, -(-room // WARP), low_occupancy=each <= LOW_OCCUPANCY and room <= 192)
    body_warp = each <= BODY_WARP and 32 < room < 512
    return BlockShape(room + 32 * body_warp, 1, body_warp)
