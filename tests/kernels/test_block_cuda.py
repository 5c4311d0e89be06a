"""Block kernels compiled for CUDA, where there is no GPU."""

import json
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
import warp as wp
from blocks import pack_for, some_of
from drives import example
from ptx import called, compiled

from warpchain.drive.examples import example_names
from warpchain.engine.gpu_kernels import Bucket, block_kind, kernel_kind, resident_variants, variant_kind_columns
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BY_SPEED, DECLARED, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import block_memory
from warpchain.results.channels import CHANNEL_NAMES, DEFAULT_FRAME, frame_with_channels
from warpchain.results.schedule import Schedule

LARGE = [
    (BlockKind(wp.float64, BlockShape(672, 1), Parts(3, 1), measuring=True, moving=True), 1),
    (BlockKind(wp.float64, BlockShape(800, 1), Parts(2, 0)), 1),
    (BlockKind(wp.float64, BlockShape(224, 1), Parts(31, 0), moving=True), 4),
]


@pytest.mark.parametrize(("kind", "blocks"), some_of(LARGE, [], LARGE[:1]))
def test_blocks_ask_for_no_more_shared_memory_than_there_is(tmp_path, kind, blocks):
    kernel = block_kernel(kind, blocks, DEFAULT_FRAME)  # ptxas refuses more than 48 KiB
    wp.compile_aot_module(kernel.module, device=None, arch=90, module_dir=str(tmp_path), use_ptx=False)
    assert [path for path in tmp_path.iterdir() if path.suffix == ".cubin"]


@pytest.mark.long
def test_what_a_kernel_cannot_declare_is_asked_for_at_launch(tmp_path):
    # 1,024 rollers at float64: 6 rows of 8 bytes, 49,152 of them, which no kernel may declare
    kind = BlockKind(wp.float64, BlockShape(256, 4, shared_bytes=232_448), Parts(2, 0))
    of = block_memory(kind)
    assert "rows" in of.places and of.asked >= 1024 * 48
    assert all(place % 16 == 0 for place in of.places.values())
    assert block_memory(replace(kind, shape=replace(kind.shape, shared_bytes=DECLARED))).asked == 0
    module = block_kernel(kind, 2, DEFAULT_FRAME).module
    wp.compile_aot_module(module, device=None, arch=90, module_dir=str(tmp_path), use_ptx=False)
    asked = json.loads(next(path for path in tmp_path.iterdir() if path.suffix == ".meta").read_text())
    assert all(bytes_ >= of.asked for name, bytes_ in asked.items() if name.endswith("forward_smem_bytes"))


def measuring(resident, shape, parts, real, frame=DEFAULT_FRAME, **more):
    """A kernel that takes metrics."""
    return block_kernel(BlockKind(real, shape, parts, measuring=True, **more), resident, frame)


WARPS, FEW, BENDING = BlockShape(32, 4), BlockShape(160, 1), {"integrator": 1, "friction": Friction(joints=BY_SPEED)}
FORMS = {
    "many": partial(measuring, 16, WARPS, Parts(2, 1)),
    "moving": partial(measuring, 4, FEW, Parts(2, 1), moving=True),
    "few": partial(measuring, 4, FEW, Parts(2, 1)),
    "rk4, bending": partial(measuring, 8, WARPS, Parts(2, 1), frame=frame_with_channels(CHANNEL_NAMES), **BENDING),
    "several chains": partial(
        measuring, 8, BlockShape(32, 5), Parts(4, 2, arms=1, tensioners=1, tied=1, geared=1, chains=2)
    ),
    "silent": partial(measuring, 8, BlockShape(32, 4), Parts(4, 2, chains=2), silent=True, friction=Friction(1)),
    "relax": lambda real: block_relax_kernel(BlockKind(real, FEW, Parts(2, 1)), 4),
}
CASES = [case for case in product([75, 90], FORMS, ["float64", "float32"]) if case[1:] != ("relax", "float32")]
"""All but settling at float32: a run settles at float64."""
USUAL = [
    (75, "several chains", "float32"),
    (90, "rk4, bending", "float64"),
    (90, "relax", "float64"),
    (90, "silent", "float32"),
]
"""What the oldest takes newer ones take; each takes up to a minute, and `test_number` compiles more at float32."""


@pytest.mark.parametrize(("arch", "form", "precision"), some_of(CASES, USUAL[-1:], USUAL))
def test_block_kernel_compiles_for_cuda_without_a_gpu(tmp_path, arch, form, precision):
    module = FORMS[form](getattr(wp, precision)).module
    wp.compile_aot_module(module, device=None, arch=arch, module_dir=str(tmp_path))
    assert [path for path in tmp_path.iterdir() if path.suffix in (".cubin", ".ptx")]


CALLS = [
    ("marine", "float64", "measure", 8),
    ("engine", "float32", "measure", 8),
    ("marine_lever", "float64", "measure", 8),
    ("bucket_elevator", "float32", "advance", 8),
    ("silent_timing", "float64", "advance", 1),
    *(
        pytest.param(*case, marks=pytest.mark.thorough)
        for case in product(example_names(), ("float64", "float32"), ("measure", "advance"), (8, 1))
        if case[2:] == ("measure", 8) or case[0] in ("bucket_elevator", "silent_timing")
    ),
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "precision", "kernel", "each"), CALLS)
def test_a_time_loop_calls_no_function_of_the_block(tmp_path, name, precision, kernel, each):
    # a call takes structs through memory, where the whole kernel then keeps them: marine took 1.2 times as long, car,
    # engine and motorcycle_drivetrain twice (docs/kernels.md)
    packed = pack_for([example(name)], [Schedule(1e-6, 100, 0, 100, 0)], precision)
    columns = {field: int(values[0]) for field, values in variant_kind_columns(packed).items()}
    kind = kernel_kind(kernel, Bucket(block_kind(packed.real, columns, each), np.zeros(1, int), None))
    assert not called(compiled(block_kernel(kind, resident_variants(kind), DEFAULT_FRAME), tmp_path))
