"""Sums and largest values over all threads of a variant's block, used in settling."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from .block_kinds import BlockKind
from .sync import sync_functions, warp_lanes


@dataclass(frozen=True)
class BlockSumFunctions:
    """Sum functions over all threads of a block."""

    block_largest: wp.Function
    block_total: wp.Function


@cache
def block_sum_functions(kind: BlockKind) -> BlockSumFunctions:
    """Sum functions over all threads of block kernels."""
    Real, threads = kind.Real, kind.shape.threads
    kinds = kind.types
    Shared = kinds.Shared
    sync = sync_functions(kind)

    @wp.func
    def share_warp_values(shared: Shared, value: Real, i: int):
        """Shares a value of each warp of a block, in the memory of wrench parts."""
        sync.barrier()
        if i % warp_lanes() == 0:
            shared.wrench_parts[i // warp_lanes()] = value
        sync.barrier()

    @wp.func
    def block_largest(shared: Shared, value: Real, i: int):
        """Largest `value` of all threads of a block."""
        share_warp_values(shared, sync.warp_max(value), i)
        result = wp.float64(shared.wrench_parts[0])
        for w in range(1, threads // warp_lanes()):
            result = wp.max(result, wp.float64(shared.wrench_parts[w]))
        sync.barrier()
        return result

    @wp.func
    def block_total(shared: Shared, value: wp.float64, i: int):
        """Sum of `value` over all threads of a block."""
        share_warp_values(shared, Real(sync.warp_sum(value)), i)
        result = wp.float64(0.0)
        for w in range(threads // warp_lanes()):
            result = result + wp.float64(shared.wrench_parts[w])
        sync.barrier()
        return result

    return BlockSumFunctions(block_largest=block_largest, block_total=block_total)
