"""The oil warp of a block, which advances the oil of all its variants, and requests to it."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import code_by_device
from .block_kinds import BlockKind

DONE = wp.constant(0)
"""Requests of a stroke to the oil warp: none,"""
STEP = wp.constant(1)  # a step,
METERED = wp.constant(2)  # one whose energies are wanted,
OVER = wp.constant(-1)  # and no more of them in this launch


NOWHERE = wp.constant(1 << 30)
"""Place in a block of a thread without a variant or launch."""


ASKED = "*(volatile int*)&strokes.data[k].asked"
REQUEST = code_by_device(f"__threadfence_block(); {ASKED} = what;", "strokes.data[k].asked = what;")
REQUESTED = code_by_device(
    f"const int what = {ASKED}; __threadfence_block(); return what;",
    "WP_TILE_SYNC(); return strokes.data[k].asked;",
)
LEAVE = """
    static int left = 0;
    const int all = (left / COUNT + 1) * COUNT;
    ++left;
    while (left < all) WP_TILE_SYNC();
"""
AWAIT = code_by_device(
    f"for (int k = 0; k < COUNT; ++k) while ({ASKED} > 0);\n__threadfence_block(); __syncwarp();",
    "for (int k = 0; k < COUNT; ++k) while (strokes.data[k].asked > 0) WP_TILE_SYNC();",
)


@dataclass(frozen=True)
class OilWarpFunctions:
    """Oil warp functions of a block."""

    place_in_launch: wp.Function
    set_request: wp.Function
    request_of: wp.Function
    await_oil: wp.Function
    end_thread: wp.Function
    request_oil_step: wp.Function


@cache
def oil_warp_functions(kind: BlockKind) -> OilWarpFunctions:
    """Oil warp functions of block kernels."""
    kinds, variants, tensioners = kind.types, kind.shape.variants_per_block, kind.parts.tensioners
    Shared, Stroke = kinds.Shared, kinds.Stroke

    @wp.func
    def place_in_launch(tid: int):
        """Number of a thread's variant in its launch, of the thread in it, and of the oil warp's tensioner, else -1."""
        block = tid // wp.static(kind.block_threads)
        at = tid - block * wp.static(kind.block_threads)
        place = at // wp.static(kind.shape.threads)
        i = at - place * wp.static(kind.shape.threads)
        k = int(-1)
        if wp.static(kind.has_oil_warp):
            if place == variants:
                place = i // tensioners
                k = i - place * tensioners
                if place >= variants:
                    place, k = NOWHERE, -1
        return block * variants + place, i, k

    @wp.func_native(REQUEST)
    def set_request(strokes: wp.array[Stroke], k: int, what: int):
        """Sets a stroke's request to the oil warp, after all earlier writes are visible."""

    @wp.func_native(REQUESTED)
    def request_of(strokes: wp.array[Stroke], k: int) -> int:
        """Request of a stroke to the oil warp; fibers yield meanwhile."""

    @wp.func_native(AWAIT.replace("COUNT", str(tensioners)))
    def await_oil(strokes: wp.array[Stroke]):
        """Waits until the oil warp has advanced all of a variant's tensioners; all threads together."""

    @wp.func_native(code_by_device("", LEAVE.replace("COUNT", str(kind.block_threads))))
    def end_thread():
        """Ends a thread of the oil warp or without a variant; fibers end together, for their barriers."""

    @wp.func
    def request_oil_step(shared: Shared, k: int, x: kinds.Number, rate: kinds.Real, metered: bool):
        """Requests a step of the oil of tensioner k from the oil warp."""
        shared.strokes[k].x = x
        shared.strokes[k].rate = rate
        set_request(shared.strokes, k, wp.where(metered, METERED, STEP))

    return OilWarpFunctions(
        place_in_launch=place_in_launch,
        set_request=set_request,
        request_of=request_of,
        await_oil=await_oil,
        end_thread=end_thread,
        request_oil_step=request_oil_step,
    )
