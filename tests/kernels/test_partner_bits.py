"""The partners of a thread's rollers as bits in registers, against sets of Python's."""

import numpy as np
import pytest
import warp as wp

from warpchain.kernels.gpu.block_kinds import BlockKind, BlockShape, Parts
from warpchain.kernels.gpu.block_structs import BITS
from warpchain.kernels.gpu.partner_bits import partner_bit_functions

# one number; three, the last not full; one roller; a number a roller, as there may be 31 partners
KINDS = [
    BlockKind(wp.float64, BlockShape(32, 6), Parts(3, 1)),
    BlockKind(wp.float64, BlockShape(32, 16), Parts(3, 1)),
    BlockKind(wp.float64, BlockShape(160, 1), Parts(4, 5)),
    BlockKind(wp.float64, BlockShape(32, 2), Parts(20, 11)),
]


def walked(kind: BlockKind):
    """A kernel that walks through what is in `near` but not in `before`: all, of teeth, of bars; and tells changes."""
    partner_bits = partner_bit_functions(kind)
    rollers_per_thread, threads, Bits = kind.shape.rollers_per_thread, kind.shape.threads, partner_bits.Bits
    most = rollers_per_thread * (kind.parts.sprockets + kind.parts.guides)

    @wp.func
    def walk(bits: Bits, seen: wp.array3d[int], thread: int, which: int):
        at = int(0)
        while partner_bits.has_any(bits):
            j, p = partner_bits.first_pair(bits, thread)
            bits = partner_bits.without_first_pair(bits)
            seen[which, thread, at] = wp.static(100) * j + p
            at = at + 1

    @wp.kernel(enable_backward=False)
    def walk_all(near: wp.array2d[int], before: wp.array2d[int], seen: wp.array3d[int], changed: wp.array[int]):
        thread = wp.tid()
        bits = Bits()
        old = Bits()
        for k in range(wp.static(rollers_per_thread)):
            bits = partner_bits.with_roller(bits, k, near[thread, k])
            old = partner_bits.with_roller(old, k, before[thread, k])
        walk(bits & ~old, seen, thread, 0)
        walk(partner_bits.of_sprockets(bits), seen, thread, 1)
        walk(partner_bits.of_guides(bits), seen, thread, 2)
        walk(bits | old, seen, thread, 3)
        changed[thread] = wp.where(bits == old, 0, 1)

    return walk_all, threads, most


WALKED = {f"{kind.shape.rollers_per_thread} rollers, {kind.parts}": (kind, *walked(kind)) for kind in KINDS}


@pytest.mark.parametrize("name", WALKED)
def test_walks_go_through_rollers_and_partners_in_order(name):
    kind, kernel, threads, most = WALKED[name]
    partners, count = kind.parts.sprockets + kind.parts.guides, 24
    assert partners <= BITS
    rng = np.random.default_rng(5)
    share = rng.choice([0.0, 0.1, 0.9], (count, 1, 1))
    near, before = (rng.random((count, kind.shape.rollers_per_thread, partners)) < share for _ in range(2))
    before[::3] = near[::3]  # nothing has changed
    seen = wp.full((4, count, most + 1), -1, dtype=int, device="cpu")
    changed = wp.zeros(count, dtype=int, device="cpu")
    words = [wp.array(of @ (1 << np.arange(partners)), dtype=int, device="cpu") for of in (near, before)]
    wp.launch(kernel, dim=count, inputs=[*words, seen, changed], device="cpu")
    teeth = np.arange(partners) < kind.parts.sprockets
    for which, of in enumerate((near & ~before, near & teeth, near & ~teeth, near | before)):
        for thread in range(count):
            wanted = [100 * (int(k) * threads + thread) + int(p) for k, p in np.argwhere(of[thread])]
            found = seen.numpy()[which, thread]
            assert found[found >= 0].tolist() == wanted
    assert changed.numpy().tolist() == (near != before).any(axis=(1, 2)).astype(int).tolist()
    assert 0 < changed.numpy().sum() < count
